# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Measurements of `reproduce_multichannel`: the experiments of Rosenberg & Gray, section 7.

Three imagers on the scenarios of the paper's table 1: time-domain correlation (TDC), the
wavenumber-domain imager and backprojection of zero-padded profiles, nearest sample (BP).
"""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from collections.abc import Callable, Sequence

import numpy as np

from sar_imaging.geometry import MapGrid
from sar_imaging.imaging.correlation import correlate
from sar_imaging.imaging.imager import plan_image
from sar_imaging.published.zero_padding import DELAYS, predicted_error_db
from sar_imaging.quality import (
    error_db,
    impulse_response,
    mean_square_error,
    signal_to_distortion_db,
)
from sar_imaging.signal.pulses import PulseBlock, concatenate
from sar_imaging.signal.radar import SPEED_OF_LIGHT
from sar_imaging.signal.spectra import band_spectrum
from sar_imaging.simulation.scenarios import RANGE_CENTRE_M, SCENARIOS

#: Sample rates tried, hertz: the paper states none. The first explains more of its figures.
RATES_HZ = (600e6, 400e6)
#: Half of the patch of the point spread function in range and azimuth, metres.
PATCH_M = (3.0, 15.0)
#: Zero-padding ratios whose cuts and images are drawn; the paper's text has 50, its caption 80.
SHOWN_RATIOS = (20, 50, 80, 150)
#: Zero-padding ratio of figures 10 and 11 and table 3.
COMPARISON_RATIO = 100
#: Where the pixel columns of the letter stand: spacing in 25ths of a range sample, or in metres.
PLACEMENTS = ('on samples', 'half-way between samples', '0.1 m grid')

Tick = Callable[[], object]


@functools.lru_cache(maxsize=4)
def recording(name: str, rate_hz: float) -> PulseBlock:
    """All pulses of a scenario of table 1, sampled at another rate in as many range bins."""
    scenario = SCENARIOS[name]()
    centre = scenario.n_samples // 2
    radar = dataclasses.replace(
        scenario.radar, sample_rate_hz=rate_hz,
        first_sample_delay_s=2 * RANGE_CENTRE_M / SPEED_OF_LIGHT - centre / rate_hz)
    return concatenate(list(dataclasses.replace(scenario, radar=radar).blocks()))


def tdc(block: PulseBlock, points) -> np.ndarray:
    """Time-domain correlation at points (..., 3), complex128."""
    return correlate(*band_spectrum(block), block.tx_m, block.rx_m, points)


def zero_padded(block: PulseBlock, grid_or_points, ratio: int, interpolator: str = 'nearest',
                delay: str = 'exact') -> np.ndarray:
    """Backprojection of the paper: nearest sample of zero-padded profiles, complex64."""
    return _image(block, grid_or_points, 'zero-padding', ratio=ratio, interpolator=interpolator,
                  delay=delay)


def wavenumber(block: PulseBlock, grid: MapGrid, **padding: float) -> np.ndarray:
    """Image in the wavenumber domain, complex64."""
    return _image(block, grid, 'wavenumber', taps=16, **padding)


def _image(block: PulseBlock, grid_or_points, method: str, **options) -> np.ndarray:
    return plan_image(grid_or_points, block.radar, block.n_samples, method=method,
                      **options)(block).samples


def ratios(quick: bool) -> list[int]:
    """Ratios 20 to 150; the quick choice has the shown ones and the multiples of 25."""
    if not quick:
        return list(range(20, 151))
    near = {z + d for z in range(25, 151, 25) for d in (-1, 0, 1)}
    return sorted(z for z in near.union(SHOWN_RATIOS) if z <= 150)


# ----------------------------------------------------------------------------- figures 5 and 6

@dataclasses.dataclass(frozen=True)
class PointSpread:
    """Cuts through the point spread function, range first, azimuth second.

    Parameters
    ----------
    rate_hz : float
        Sample rate, hertz.
    offset_m : list of (n,) float64
        Positions along each cut from the scatterer, metres.
    tdc_cut : list of (n,) complex128
        Cuts of TDC.
    null_m : list of float
        First nulls of TDC, metres.
    tdc_islr_db : list of float
        ISLR of TDC over the patch, dB.
    cut : dict of ratio to list of (n,) complex64
        Cuts of BP, `SHOWN_RATIOS` only.
    ratio : (Z,) int64
        Ratios of `islr_db`.
    islr_db : (Z, 2) float64
        ISLR of BP between the nulls of TDC, dB.
    """

    rate_hz: float
    offset_m: list[np.ndarray]
    tdc_cut: list[np.ndarray]
    null_m: list[float]
    tdc_islr_db: list[float]
    cut: dict[int, list[np.ndarray]]
    ratio: np.ndarray
    islr_db: np.ndarray

    def ratio_within(self, tolerance_db: float) -> list[int | None]:
        """First ratio from which the ISLR of each cut stays within a tolerance of TDC."""
        out = []
        for axis in range(2):
            off = np.abs(self.islr_db[:, axis] - self.tdc_islr_db[axis]) > tolerance_db
            after = int(np.flatnonzero(off)[-1]) + 1 if off.any() else 0
            out.append(int(self.ratio[after]) if after < len(off) else None)
        return out


def measure_point_spread(rate_hz: float, ratio: Sequence[int], tick: Tick) -> PointSpread:
    """Cuts and ISLR of TDC and BP over the paper's patch; `tick` is called for each ratio."""
    block = recording('psf', rate_hz)
    spacing = (0.02, 0.1)
    offset = [np.linspace(-p, p, 2 * round(p / s) + 1)
              for p, s in zip(PATCH_M, spacing, strict=True)]
    points = np.zeros((sum(map(len, offset)), 3))
    points[:, 0] = RANGE_CENTRE_M
    points[:len(offset[0]), 0] += offset[0]
    points[len(offset[0]):, 1] = offset[1]
    exact = np.split(tdc(block, points), [len(offset[0])])
    response = [impulse_response(np.abs(cut), s, half_width_m=p)
                for cut, s, p in zip(exact, spacing, PATCH_M, strict=True)]
    null = [0.5 * (r.nulls_m[1] - r.nulls_m[0]) for r in response]
    shown, islr = {}, []
    for z in ratio:
        cuts = np.split(zero_padded(block, points, z), [len(offset[0])])
        islr.append([islr_db(c, o, n) for c, o, n in zip(cuts, offset, null, strict=True)])
        if z in SHOWN_RATIOS:
            shown[z] = cuts
        tick()
    return PointSpread(rate_hz, offset, exact, null, [r.islr_db for r in response], shown,
                       np.array(ratio), np.array(islr))


def islr_db(cut, offset_m, null_m: float) -> float:
    """ISLR between given nulls; a distorted cut may have none of its own.

    Parameters
    ----------
    cut : (n,) complex
        Equally spaced samples; all of them count.
    offset_m : (n,) float64
        Their positions from the scatterer, metres.
    null_m : float
        Half width of the main lobe, metres.

    Returns
    -------
    float
        dB.
    """
    energy = np.concatenate([[0], np.cumsum(0.5 * (np.abs(cut[1:]) ** 2 + np.abs(cut[:-1]) ** 2))])
    main = np.diff(np.interp([-null_m, null_m], offset_m, energy))[0]
    return 10 * math.log10((energy[-1] - main) / main)


# ----------------------------------------------------------------------------- figures 7, 8, 9

@dataclasses.dataclass(frozen=True)
class LetterImages:
    """The letter 'S': grid, TDC image and BP images by ratio, with their SDR in dB."""

    grid: MapGrid
    tdc: np.ndarray
    image: dict[int, np.ndarray]
    sdr_db: dict[int, float]


def form_letter_images(rate_hz: float, spacing_m: float, tick: Tick) -> LetterImages:
    """Images of the whole swath of 7 m by 50 m, figures 7 and 8."""
    block = recording('letter_s', rate_hz)
    grid = MapGrid.from_size((RANGE_CENTRE_M, 0.0, 0.0), 7.0, 50.0, spacing_m)
    exact = tdc(block, grid.points())
    tick()
    image = {}
    for z in SHOWN_RATIOS:
        image[z] = zero_padded(block, grid, z)
        tick()
    return LetterImages(grid, exact, image,
                        {z: signal_to_distortion_db(i, exact) for z, i in image.items()})


@dataclasses.dataclass(frozen=True)
class Distortion:
    """SDR and MSE of the letter against ratio, equations 20 and 21.

    Parameters
    ----------
    rate_hz : float
        Sample rate, hertz.
    ratio : (Z,) int64
        Zero-padding ratios.
    sdr_db : dict of placement to (Z,) float64
        dB.
    mse : dict of placement to (Z,) float64
        For an image of TDC whose maximum is 1.
    predicted_db : (Z,) float64
        SDR if positions between two samples were spread evenly and no error left the image, dB.
    """

    rate_hz: float
    ratio: np.ndarray
    sdr_db: dict[str, np.ndarray]
    mse: dict[str, np.ndarray]
    predicted_db: np.ndarray

    def bumps_db(self, placement: str) -> dict[int, float]:
        """SDR at each ratio above the mean of the two neighbouring ratios, dB."""
        sdr, z = self.sdr_db[placement], self.ratio
        return {int(z[i]): float(sdr[i] - 0.5 * (sdr[i - 1] + sdr[i + 1]))
                for i in range(1, len(z) - 1) if z[i + 1] - z[i - 1] == 2}


def measure_distortion(rate_hz: float, ratio: Sequence[int], tick: Tick) -> Distortion:
    """SDR and MSE for three placements of the pixel columns, figure 9."""
    block = recording('letter_s', rate_hz)
    points = {p: letter_points(p, block.radar.sample_spacing_m) for p in PLACEMENTS}
    ends = np.cumsum([len(p) for p in points.values()])[:-1]
    together = np.concatenate(list(points.values()))
    exact = tdc(block, together)
    exact_parts = np.split(exact, ends)
    sdr, mse = ({p: [] for p in PLACEMENTS} for _ in range(2))
    for z in ratio:
        parts = np.split(zero_padded(block, together, z), ends)
        for placement, image, reference in zip(PLACEMENTS, parts, exact_parts, strict=True):
            sdr[placement].append(signal_to_distortion_db(image, reference))
            mse[placement].append(mean_square_error(image, reference)
                                  / np.abs(reference).max() ** 2)
        tick()
    predicted = [-predicted_error_db('nearest', z, block.radar) for z in ratio]
    return Distortion(rate_hz, np.array(ratio), {p: np.array(v) for p, v in sdr.items()},
                      {p: np.array(v) for p, v in mse.items()}, np.array(predicted))


def letter_points(placement: str, sample_m: float) -> np.ndarray:
    """Pixels of the letter's swath with columns placed as named, (n, 3) metres.

    The columns 'on samples' are 8/25 of a range sample apart. At the paper's range centre, which
    is a sample, they meet samples of the zero-padded profile at every ratio that is a multiple of
    25. Those 'half-way' are shifted by 1/50 of a sample.
    """
    spacing = 0.1 if placement == '0.1 m grid' else 8 / 25 * sample_m
    shift = sample_m / 50 if placement == 'half-way between samples' else 0.0
    n = int(3.5 / spacing)
    x = RANGE_CENTRE_M + shift + np.arange(-n, n + 1) * spacing
    y = np.linspace(-25.0, 25.0, 41)
    return np.stack([*(a.ravel() for a in np.meshgrid(x, y)), np.zeros(x.size * y.size)], axis=-1)


# --------------------------------------------------------------------------- figures 10 and 11

#: Names of the imagers compared in figures 10 and 11.
IMAGERS = ('TDC', 'wavenumber, as published', f'BP, ratio {COMPARISON_RATIO}',
           'wavenumber, default')


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Two scatterers by every imager: grid, images, and figures by imager's name.

    `corner_db` is the corner scatterer's level relative to the centre's, less the same of TDC;
    `ghost_db` the highest level around the corner's mirror place at the opposite range edge
    relative to the centre; `sdr_db` the signal to distortion ratio against TDC; all in dB.
    """

    rate_hz: float
    grid: MapGrid
    image: dict[str, np.ndarray]
    corner_db: dict[str, float]
    ghost_db: dict[str, float]
    sdr_db: dict[str, float]


def compare_imagers(rate_hz: float, spacing_m: float, tick: Tick) -> Comparison:
    """Centre and corner scatterer on the exact 6 m by 30 m patch."""
    block = recording('two_scatterers', rate_hz)
    grid = MapGrid.from_size((RANGE_CENTRE_M, 0.0, 0.0), 2 * PATCH_M[0], 2 * PATCH_M[1],
                             spacing_m)
    form = (lambda: tdc(block, grid.points()),
            lambda: wavenumber(block, grid, range_padding=1.0, azimuth_padding=1.0),
            lambda: zero_padded(block, grid, COMPARISON_RATIO),
            lambda: wavenumber(block, grid))
    image = {}
    for name, make in zip(IMAGERS, form, strict=True):
        image[name] = make()
        tick()
    level = {name: _corner_levels(i, spacing_m) for name, i in image.items()}
    exact = image['TDC']
    return Comparison(
        rate_hz, grid, image,
        {name: v[0] - level['TDC'][0] for name, v in level.items()},
        {name: v[1] for name, v in level.items()},
        {name: signal_to_distortion_db(i, exact) for name, i in image.items() if name != 'TDC'})


def _corner_levels(image, spacing_m: float) -> tuple[float, float]:
    """Levels of the top right corner, and around the top left one, to the centre, dB."""
    magnitude = np.abs(image)
    centre = magnitude[tuple(n // 2 for n in magnitude.shape)]
    near = max(1, round(0.25 / spacing_m)) + 1  # half a resolution cell
    ghost = magnitude[:near, :near].max()
    return tuple(20 * math.log10(float(v / centre)) for v in (magnitude[0, -1], ghost))


def measure_delays(rate_hz: float, tick: Tick) -> dict[str, dict[str, float]]:
    """Error against TDC of each way to treat a channel's delay, by interpolator, dB.

    On the point spread function's patch. The accurate interpolator shows what the paper's
    approximations cost, the nearest sample that it hides them.
    """
    block = recording('psf', rate_hz)
    grid = MapGrid.from_size((RANGE_CENTRE_M, 0.0, 0.0), 2 * PATCH_M[0], 2 * PATCH_M[1], 0.25)
    exact = tdc(block, grid.points())
    errors = {}
    for interpolator, ratio in (('nearest', COMPARISON_RATIO), ('cubic', 16)):
        errors[interpolator] = {
            delay: error_db(zero_padded(block, grid, ratio, interpolator, delay), exact)
            for delay in DELAYS}
        tick()
    return errors


# ------------------------------------------------------------------------------- tables 2 and 3

def complexity(n_samples: int, n_pulses: int, n_channels: int, n_pixels: int, ratio: int
               ) -> dict[str, float]:
    """Operations of the three imagers by the paper's table 2."""
    padded = ratio * n_samples
    return {'TDC': float(n_samples ** 2 * n_pulses ** 2 * n_channels),
            'wavenumber': float(n_samples * n_pulses * n_channels),
            'BP': (n_pixels + padded * math.log2(padded)) * n_pulses * n_channels}


def measure_run_times(rate_hz: float, spacing_m: float, tick: Tick) -> dict[str, float]:
    """Seconds of each imager on the point spread function's patch, second run, best of two."""
    block = recording('psf', rate_hz)
    grid = MapGrid.from_size((RANGE_CENTRE_M, 0.0, 0.0), 2 * PATCH_M[0], 2 * PATCH_M[1],
                             spacing_m)
    points = grid.points()
    form = {'TDC': lambda: tdc(block, points),
            'wavenumber': lambda: wavenumber(block, grid),
            'BP': lambda: zero_padded(block, grid, COMPARISON_RATIO),
            'exact': lambda: _image(block, grid, 'exact', target_db=-80.0)}
    seconds = {}
    for name, make in form.items():
        make()  # compiles or loads what it needs
        runs = []
        for _ in range(2):
            start = time.perf_counter()
            make()
            runs.append(time.perf_counter() - start)
        seconds[name] = min(runs)
        tick()
    return seconds
