"""Position, width and sidelobes of a scatterer in a complex map, in range and azimuth."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from ..geometry.grids import MapGrid
from .baseband import crop, project_on_plane, sample_baseband, to_baseband
from .impulse_response import ImpulseResponse, UnmeasurableError, impulse_response
from .interpolation import TAPS

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

    def as_json(self) -> dict:
        """Fields for JSON: NaN and infinities become None."""
        def clean(value):
            if isinstance(value, tuple):
                return [clean(v) for v in value]
            return None if isinstance(value, float) and not math.isfinite(value) else value

        return {k: clean(v) for k, v in dataclasses.asdict(self).items()}


def measure_scatterer(image, grid: MapGrid, truth_m, *, aperture_centre_m,
                      wavenumber_rad_per_m: float, cut_half_width_range_m: float,
                      cut_half_width_azimuth_m: float, name: str = '',
                      neighbours_m: Sequence = ()) -> ScattererQuality:
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
    truth_xy = project_on_plane(truth_m, aperture_centre_m, grid.z_m)
    others = np.array([project_on_plane(p, aperture_centre_m, grid.z_m) for p in neighbours_m]
                      ).reshape(-1, 2)
    offset = truth_xy - np.asarray(aperture_centre_m[:2], float)
    along_range = offset / np.hypot(*offset)
    axes = np.stack([along_range, [-along_range[1], along_range[0]]])
    half_widths = np.array([cut_half_width_range_m, cut_half_width_azimuth_m], float)
    # the peak may lie a third of the window off: the chip must still hold the whole window
    margin = TAPS // 2 * grid.spacing_m
    half_size = np.abs(axes).T @ (half_widths * 4 / 3) + margin
    try:
        chip, chip_grid = crop(np.asarray(image), grid, truth_xy, half_size)
        chip = to_baseband(chip, chip_grid, aperture_centre_m, wavenumber_rad_per_m)
        peak_xy, amplitude = _find_peak(chip, chip_grid, truth_xy, axes, half_widths / 3, others)
    except ValueError as error:
        return ScattererQuality(name, reason=str(error))
    fields = {'name': name, 'peak_x_m': float(peak_xy[0]), 'peak_y_m': float(peak_xy[1]),
              'peak_amplitude': amplitude}
    fields['reason'] = _measure_cuts(chip, chip_grid, peak_xy, axes, half_widths,
                                     others - truth_xy, truth_xy, fields)
    return ScattererQuality(**fields)


def _measure_cuts(chip, grid: MapGrid, peak_xy, axes, half_widths, other_offsets, truth_xy,
                  fields: dict) -> str:
    """Fill `fields` with the figures of both cuts; return why some are missing."""
    responses, reasons = [None, None], []
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


def _find_peak(chip, grid: MapGrid, truth_xy, axes, radii, others) -> tuple[np.ndarray, float]:
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
    peak = np.clip(_vertex(points, power), (grid.x_m[0], grid.y_m[-1]),
                   (grid.x_m[-1], grid.y_m[0]))
    # not the paraboloid's value: over half a pixel around the peak that is 1 % too low
    return peak, float(np.abs(sample_baseband(chip, grid, peak[None]))[0])


def _vertex(points, power) -> np.ndarray:
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


def _measure_cut(chip, grid: MapGrid, peak_xy, direction, half_width_m: float
                 ) -> ImpulseResponse:
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
