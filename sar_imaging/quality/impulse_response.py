# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Impulse response width (IRW) and sidelobe ratios (PSLR, ISLR) of cuts and of scatterers."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.grids import MapGrid
from .interpolation import (
    TAPS,
    crop,
    interpolate_cut,
    project_on_plane,
    sample_baseband,
    to_baseband,
)

SHALLOW_NULL_DB = -6.0  # a first minimum above this does not separate a main lobe


class UnmeasurableError(ValueError):
    """The cut holds no main lobe that can be told from its surroundings.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.quality import UnmeasurableError, impulse_response
    >>> try:
    ...     impulse_response(np.linspace(0.0, 1.0, 32), spacing_m=0.1)
    ... except UnmeasurableError as error:  # it rises up to its end
    ...     print(error)
    the cut ends before the first null of the main lobe; it must reach beyond the main ...
    """


@dataclasses.dataclass(frozen=True)
class ImpulseResponse:
    """Width, sidelobe ratios and position of a cut through a point response.

    Parameters
    ----------
    irw_m : float
        Impulse response width: distance between the half-power points, metres.
    pslr_db : float
        Peak sidelobe ratio: highest intensity between a null and the end of the window over the
        peak intensity, decibels.
    islr_db : float
        Integrated sidelobe ratio: energy in the window outside the nulls over the energy
        between the nulls, decibels.
    peak_m : float
        Position of the peak from the first sample, metres.
    peak_db : float
        Peak amplitude, decibels relative to 1.
    nulls_m : (float, float)
        First minima before and after the peak, from the peak, metres.
    window_m : (float, float)
        Ends of the window of `pslr_db` and `islr_db`, from the peak, metres; nearer than asked
        for where the cut ends.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.quality import impulse_response
    >>> found = impulse_response(np.sinc(np.arange(-32, 33) / 2), spacing_m=0.25)
    >>> print(f'nulls at {found.nulls_m[0]:.2f} m and {found.nulls_m[1]:.2f} m from the peak')
    nulls at -0.50 m and 0.50 m from the peak
    """

    irw_m: float
    pslr_db: float
    islr_db: float
    peak_m: float
    peak_db: float
    nulls_m: tuple[float, float]
    window_m: tuple[float, float]


def impulse_response(cut: ArrayLike, spacing_m: float, *, half_width_m: float | None = None,
                     peak_near_m: float | None = None, oversampling: int = 32) -> ImpulseResponse:
    """Measure width, sidelobe ratios and position of a cut through a point response.

    The main lobe ends at the first minimum either side of the peak. An unweighted sinc over six
    nulls either side has an ISLR of -10.5 dB, a PSLR of -13.3 dB and an IRW of 0.886 of the
    distance from the peak to the first null.

    Parameters
    ----------
    cut : (N,) complex or float
        Uniform samples. Complex or signed: band-limited around zero and sampled at 1.25 times
        the Nyquist rate or more. Non-negative floats are amplitudes: their squares must be
        sampled as well, so at 2.5 times.
    spacing_m : float
        Distance between samples, metres.
    half_width_m : float, optional
        Half width of the window around the peak, metres; by default the whole cut.
    peak_near_m : float, optional
        Take the local maximum uphill from this position, metres from the first sample; by
        default the global maximum.
    oversampling : int
        Points per sample at which the band-limited signal is evaluated.

    Returns
    -------
    ImpulseResponse
        Figures accurate to about 0.001 dB and 0.01 % for a noise-free cut.

    Raises
    ------
    UnmeasurableError
        The peak is at the end of the cut, or a first minimum is missing or less than 6 dB below
        the peak: neighbours overlap or the response is not focused.
    ValueError
        The cut is not one-dimensional, has fewer than four samples, is zero or not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.quality import impulse_response
    >>> cut = np.sinc(np.arange(-32, 33) / 2)  # nulls 2 samples from the peak
    >>> found = impulse_response(cut, spacing_m=0.25, half_width_m=3.0)
    >>> print(f'{found.irw_m:.3f} m, PSLR {found.pslr_db:.1f} dB, ISLR {found.islr_db:.1f} dB')
    0.443 m, PSLR -13.3 dB, ISLR -10.5 dB
    """
    power = _fine_power(cut, oversampling)
    step = spacing_m / oversampling
    peak = _peak_index(power, None if peak_near_m is None else peak_near_m / step)
    centre, top = _vertex(power, peak)
    nulls = _null_index(power, peak, -1), _null_index(power, peak, +1)
    depth = 10 * np.log10(max(max(power[n] for n in nulls), 1e-30 * top) / top)
    if depth > SHALLOW_NULL_DB:
        raise UnmeasurableError(f'the first minimum is only {-depth:.1f} dB below the peak; '
                                'neighbours overlap or the response is not focused')
    half = np.inf if half_width_m is None else half_width_m / step
    window = (max(0.0, centre - half), min(power.size - 1.0, centre + half))
    pslr_db, islr_db = _sidelobe_ratios(power, top, nulls, window)
    irw = _crossing(power, peak, +1, top / 2) - _crossing(power, peak, -1, top / 2)
    return ImpulseResponse(
        irw_m=float(irw * step), pslr_db=pslr_db, islr_db=islr_db, peak_m=float(centre * step),
        peak_db=float(10 * np.log10(top)),
        nulls_m=((nulls[0] - centre) * step, (nulls[1] - centre) * step),
        window_m=((window[0] - centre) * step, (window[1] - centre) * step))


def _fine_power(cut: ArrayLike, oversampling: int) -> np.ndarray:
    """Intensity of the cut at `oversampling` points per sample."""
    cut = np.asarray(cut)
    if cut.ndim != 1 or cut.size < 4:
        raise ValueError(f'cut.shape={cut.shape}; expected one dimension and 4 samples or more')
    if not np.isfinite(cut).all() or not cut.any():
        raise ValueError('the cut is zero everywhere or contains NaN or infinity')
    fine = np.arange((cut.size - 1) * oversampling + 1) / oversampling
    if np.iscomplexobj(cut) or (cut < 0).any():
        return np.abs(interpolate_cut(cut.astype(complex), fine)) ** 2
    # the modulus has kinks at the nulls and is not band-limited, its square is
    return np.maximum(interpolate_cut(np.square(cut, dtype=float), fine), 0.0)


def _peak_index(power: np.ndarray, start: float | None) -> int:
    """Index of the global maximum, or of the local one uphill from `start`."""
    if start is None:
        peak = int(power.argmax())
    else:
        peak = int(np.clip(round(start), 0, power.size - 1))
        step = 1 if power[min(peak + 1, power.size - 1)] > power[peak] else -1
        while 0 <= peak + step < power.size and power[peak + step] > power[peak]:
            peak += step
    if peak in (0, power.size - 1):
        raise UnmeasurableError('the response has its maximum at the end of the cut; '
                                'no peak lies inside')
    return peak


def _vertex(power: np.ndarray, peak: int) -> tuple[float, float]:
    """Position and value of the maximum, by a parabola through the top tenth of the lobe.

    More than three points, because ripples of the interpolation outweigh the curvature between
    neighbouring points of a finely sampled lobe.
    """
    low = power < 0.9 * power[peak]
    reach = [int(side.argmax()) if side.any() else side.size
             for side in (low[peak::-1], low[peak:])]
    n = max(1, min(min(reach) - 1, peak, power.size - 1 - peak))
    x = np.arange(-n, n + 1) / n
    a, b, c = np.polynomial.polynomial.polyfit(x, power[peak - n:peak + n + 1], 2)
    offset = -b / (2 * c)
    return float(peak + offset * n), float(a + b * offset / 2)


def _null_index(power: np.ndarray, peak: int, step: int) -> int:
    """First minimum from the peak in direction `step`.

    A minimum counts when the power rises by a twentieth after it: more than any ripple of the
    interpolation, less than the smallest dip worth telling.
    """
    side = power[peak::step]
    lowest = np.minimum.accumulate(side)
    rises = side > 1.05 * lowest
    if not rises.any():
        raise UnmeasurableError('the cut ends before the first null of the main lobe; '
                                'it must reach beyond the main lobe on both sides')
    return peak + step * int(side[:rises.argmax()].argmin())


def _crossing(power: np.ndarray, peak: int, step: int, level: float) -> float:
    """Position where the main lobe falls through `level` in direction `step`."""
    side = power[peak::step]
    after = int(np.flatnonzero(side < level)[0])
    fraction = (side[after - 1] - level) / (side[after - 1] - side[after])
    return peak + step * (after - 1 + fraction)


def _sidelobe_ratios(power: np.ndarray, top: float, nulls: tuple[int, int],
                     window: tuple[float, float]) -> tuple[float, float]:
    """PSLR and ISLR in decibels; positions in samples of `power`."""
    total = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2)])

    def energy(start: float, stop: float) -> float:
        return np.diff(np.interp([start, stop], np.arange(power.size), total))[0]

    sides = [(window[0], nulls[0]), (nulls[1], window[1])]
    parts = [power[int(np.ceil(a)):int(np.floor(b)) + 1] for a, b in sides if b > a]
    highest = max((p.max() for p in parts if p.size), default=0.0)
    side_energy = sum(energy(a, b) for a, b in sides if b > a)
    with np.errstate(divide='ignore'):
        return (float(10 * np.log10(highest / top)),
                float(10 * np.log10(side_energy / energy(*nulls))))


CUT_POINTS_PER_PIXEL = 8
LABELS = ('range', 'azimuth')


@dataclasses.dataclass(frozen=True)
class ScattererQuality:
    """Position, widths and sidelobe ratios of a scatterer; NaN where they were not measured.

    Range is the horizontal direction from the aperture centre to the scatterer, azimuth is range
    turned by +90 degrees about the vertical.

    Parameters
    ----------
    name : str
        Name of the scatterer.
    irw_range_m, irw_azimuth_m : float
        Impulse response widths at half power, metres on the ground.
    pslr_range_db, pslr_azimuth_db : float
        Peak sidelobe ratios, decibels.
    islr_range_db, islr_azimuth_db : float
        Integrated sidelobe ratios, decibels.
    position_error_range_m, position_error_azimuth_m : float
        Measured minus true position, metres.
    peak_x_m, peak_y_m : float
        Measured position, imaging frame, metres.
    peak_amplitude : float
        Magnitude of the image there.
    window_range_m, window_azimuth_m : (float, float)
        Ends of the sidelobe windows from the peak, metres.
    reason : str
        Why figures are missing; empty when none is.

    Examples
    --------
    >>> from sar_imaging.quality import ScattererQuality
    >>> tree = ScattererQuality('tree', irw_range_m=0.44, reason='a neighbour stands in azimuth')
    >>> figures = tree.as_json()
    >>> figures['irw_range_m'], figures['irw_azimuth_m'], figures['reason']
    (0.44, None, 'a neighbour stands in azimuth')
    """

    name: str
    irw_range_m: float = math.nan
    irw_azimuth_m: float = math.nan
    pslr_range_db: float = math.nan
    pslr_azimuth_db: float = math.nan
    islr_range_db: float = math.nan
    islr_azimuth_db: float = math.nan
    position_error_range_m: float = math.nan
    position_error_azimuth_m: float = math.nan
    peak_x_m: float = math.nan
    peak_y_m: float = math.nan
    peak_amplitude: float = math.nan
    window_range_m: tuple[float, float] = (math.nan, math.nan)
    window_azimuth_m: tuple[float, float] = (math.nan, math.nan)
    reason: str = ''

    def as_json(self) -> dict[str, object]:
        """Fields for JSON: NaN and infinities become None."""
        def clean(value: object) -> object:
            if isinstance(value, tuple):
                return [clean(v) for v in value]
            return None if isinstance(value, float) and not math.isfinite(value) else value

        return {k: clean(v) for k, v in dataclasses.asdict(self).items()}


def measure_scatterer(image: ArrayLike, grid: MapGrid, truth_m: ArrayLike, *,
                      aperture_centre_m: ArrayLike, wavenumber_rad_per_m: float,
                      cut_half_width_range_m: float, cut_half_width_azimuth_m: float,
                      name: str = '', neighbours_m: Sequence[ArrayLike] = ()) -> ScattererQuality:
    """Measure the response of one scatterer of known position.

    The brightest pixel within a third of the cut windows around the truth, nearer to it than to
    any neighbour, is refined to a hundredth of a pixel; cuts along range and azimuth through it
    are measured by `impulse_response`. Sidelobe ratios are left out when a neighbour stands in
    the window of the cut.

    Parameters
    ----------
    image : (n_y, n_x) complex
        Image on `grid` with the carrier phase of backprojection.
    grid : MapGrid
        Pixel positions.
    truth_m : (3,) float
        True position, imaging frame, metres. Off the plane of the grid the error is taken from
        where layover puts it.
    aperture_centre_m : (3,) float
        Phase centre in the middle of the aperture, metres.
    wavenumber_rad_per_m : float
        ``4 pi f_c / c``.
    cut_half_width_range_m, cut_half_width_azimuth_m : float
        Half widths of the sidelobe windows, metres; shortened where the image ends.
    name : str
        Name for the result.
    neighbours_m : sequence of (3,) float
        True positions of the other scatterers, metres.

    Returns
    -------
    ScattererQuality
        Figures; what cannot be measured is NaN and has a reason.

    Examples
    --------
    >>> from sar_imaging import MapGrid, concatenate, plan_image
    >>> from sar_imaging.quality import measure_scatterer
    >>> from sar_imaging.simulation import SCENARIOS
    >>> profiles = concatenate(list(SCENARIOS['psf']().blocks()))
    >>> grid = MapGrid((10_000.0, 0.0, 0.0), 48, 72, 0.25)
    >>> image = plan_image(grid, profiles.radar, profiles.n_samples)(profiles)
    >>> found = measure_scatterer(
    ...     image, grid, (10_000.0, 0.0, 0.0), aperture_centre_m=(0.0, 0.0, 0.0),
    ...     wavenumber_rad_per_m=profiles.radar.wavenumber_rad_per_m,
    ...     cut_half_width_range_m=3.0, cut_half_width_azimuth_m=8.0)
    >>> print(f'{found.irw_range_m:.2f} m by {found.irw_azimuth_m:.2f} m')
    0.44 m by 2.21 m
    """
    centre_m = np.asarray(aperture_centre_m, float)
    truth_xy = project_on_plane(truth_m, centre_m, grid.z_m)
    others = np.array([project_on_plane(p, centre_m, grid.z_m) for p in neighbours_m]
                      ).reshape(-1, 2)
    offset = truth_xy - centre_m[:2]
    along_range = offset / np.hypot(*offset)
    axes = np.stack([along_range, [-along_range[1], along_range[0]]])
    half_widths = np.array([cut_half_width_range_m, cut_half_width_azimuth_m], float)
    # the peak may lie a third of the window off: the chip must still hold the whole window
    margin = TAPS // 2 * grid.spacing_m
    half_size = np.abs(axes).T @ (half_widths * 4 / 3) + margin
    try:
        chip, chip_grid = crop(np.asarray(image), grid, truth_xy, half_size)
        chip = to_baseband(chip, chip_grid, centre_m, wavenumber_rad_per_m)
        peak_xy, amplitude = _find_peak(chip, chip_grid, truth_xy, axes, half_widths / 3, others)
    except ValueError as error:
        return ScattererQuality(name, reason=str(error))
    fields: dict[str, Any] = {'name': name, 'peak_x_m': float(peak_xy[0]),
                              'peak_y_m': float(peak_xy[1]), 'peak_amplitude': amplitude}
    fields['reason'] = _measure_cuts(chip, chip_grid, peak_xy, axes, half_widths,
                                     others - truth_xy, truth_xy, fields)
    return ScattererQuality(**fields)


def _measure_cuts(chip: np.ndarray, grid: MapGrid, peak_xy: np.ndarray, axes: np.ndarray,
                  half_widths: np.ndarray, other_offsets: np.ndarray, truth_xy: np.ndarray,
                  fields: dict[str, Any]) -> str:
    """Fill `fields` with the figures of both cuts; return why some are missing."""
    responses: list[ImpulseResponse | None] = [None, None]
    reasons = []
    for axis, label in enumerate(LABELS):
        fields[f'position_error_{label}_m'] = float((peak_xy - truth_xy) @ axes[axis])
        try:
            responses[axis] = _measure_cut(chip, grid, peak_xy, axes[axis], half_widths[axis])
        except UnmeasurableError as error:
            reasons.append(f'{label}: {error}')
    lobes = [h / 3 if r is None else max(map(abs, r.nulls_m))
             for r, h in zip(responses, half_widths, strict=True)]
    for axis, (label, response) in enumerate(zip(LABELS, responses, strict=True)):
        if response is None:
            continue
        fields[f'irw_{label}_m'] = response.irw_m
        fields[f'window_{label}_m'] = response.window_m
        along, across = (other_offsets @ axes.T)[:, [axis, 1 - axis]].T
        in_window = (along >= response.window_m[0]) & (along <= response.window_m[1])
        if (in_window & (np.abs(across) < 2 * lobes[1 - axis])).any():
            reasons.append(f'{label}: another scatterer stands in the sidelobe window')
            continue
        fields[f'pslr_{label}_db'] = response.pslr_db
        fields[f'islr_{label}_db'] = response.islr_db
    return '; '.join(reasons)


def _find_peak(chip: np.ndarray, grid: MapGrid, truth_xy: np.ndarray, axes: np.ndarray,
               radii: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, float]:
    """Position (2,) and magnitude of the strongest local maximum near the truth."""
    points = grid.points()[..., :2]
    allowed = np.sum(((points - truth_xy) @ axes.T / radii) ** 2, axis=-1) <= 1
    distance = np.linalg.norm(points - truth_xy, axis=-1)
    for other in others:
        allowed &= distance <= np.linalg.norm(points - other, axis=-1)
    if not allowed.any():
        raise UnmeasurableError('no pixel lies in the search ellipse around the true position; '
                                'widen the cut window or refine the grid')
    row, column = np.unravel_index(np.argmax(np.where(allowed, np.abs(chip), -1)), chip.shape)
    peak = np.array([grid.x_m[column], grid.y_m[row]])
    if not np.abs(chip[row, column]) > 0:
        raise UnmeasurableError('the image is zero around the true position')
    start = peak
    for step, half in ((grid.spacing_m / 8, 10), (grid.spacing_m / 16, 8)):
        offsets = np.arange(-half, half + 1) * step
        x, y = np.meshgrid(peak[0] + offsets, peak[1] + offsets)
        points = np.stack([np.clip(x, grid.x_m[0], grid.x_m[-1]),
                           np.clip(y, grid.y_m[-1], grid.y_m[0])], axis=-1)
        power = np.abs(sample_baseband(chip, grid, points)) ** 2
        peak = points[np.unravel_index(power.argmax(), power.shape)]
    if np.abs(peak - start).max() > 1.2 * grid.spacing_m:
        raise UnmeasurableError('the image has no local maximum near the true position; a '
                                'stronger neighbour covers it')
    peak = np.clip(_paraboloid_vertex(points, power), (grid.x_m[0], grid.y_m[-1]),
                   (grid.x_m[-1], grid.y_m[0]))
    # not the paraboloid's value: over half a pixel around the peak that is 1 % too low
    return peak, float(np.abs(sample_baseband(chip, grid, peak[None]))[0])


def _paraboloid_vertex(points: np.ndarray, power: np.ndarray) -> np.ndarray:
    """Place of the maximum of a paraboloid fitted to the power at (..., 2) points."""
    middle = points.reshape(-1, 2).mean(axis=0)
    x, y = (points.reshape(-1, 2) - middle).T
    scale = max(np.ptp(x), np.ptp(y))
    x, y = x / scale, y / scale
    terms = np.stack([np.ones_like(x), x, y, x * x / 2, x * y, y * y / 2], axis=1)
    c = np.linalg.lstsq(terms, power.ravel(), rcond=None)[0]
    hessian = np.array([[c[3], c[4]], [c[4], c[5]]])
    offset = -np.linalg.solve(hessian, c[1:3])
    if np.linalg.eigvalsh(hessian)[1] >= 0 or np.abs(offset).max() > 1:
        raise UnmeasurableError('the image has no local maximum near the true position; a '
                                'stronger neighbour covers it')
    return middle + scale * offset


def _measure_cut(chip: np.ndarray, grid: MapGrid, peak_xy: np.ndarray, direction: np.ndarray,
                 half_width_m: float) -> ImpulseResponse:
    """Impulse response of the cut through the peak, as far as the image reaches."""
    step = grid.spacing_m / CUT_POINTS_PER_PIXEL
    lower = np.array([grid.x_m[0], grid.y_m[-1]]) - 1e-9 * grid.spacing_m
    upper = np.array([grid.x_m[-1], grid.y_m[0]]) + 1e-9 * grid.spacing_m
    with np.errstate(divide='ignore', invalid='ignore'):
        reach = np.sort([(lower - peak_xy) / direction, (upper - peak_xy) / direction], axis=0)
    # two points beyond the window: the cut's own peak may be a little off
    stop = min(half_width_m + 2 * step, np.nanmin(reach[1]))
    start = max(-half_width_m - 2 * step, np.nanmax(reach[0]))
    first, last = math.ceil(start / step), math.floor(stop / step)
    points = peak_xy + np.arange(first, last + 1)[:, None] * step * direction
    cut = sample_baseband(chip, grid, np.clip(points, lower, upper))
    if cut.size < 4:
        raise UnmeasurableError('the peak lies at the edge of the image')
    return impulse_response(cut, step, half_width_m=half_width_m, peak_near_m=-first * step,
                            oversampling=4)
