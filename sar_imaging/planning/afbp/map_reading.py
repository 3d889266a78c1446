"""Errors on the map of a track that may differ from the one planned for.

The fused image is sampled for the local frequencies of the foreseen track. Those of the track that
was flown may lie where the interpolation errs more: beyond its band, or all at one end of it. And
profiles may end elsewhere on the map than foreseen.
"""

from __future__ import annotations

import numpy as np

from ...geometry.half_paths import half_paths, sample_paths
from ...geometry.illumination import Illumination
from ...geometry.polar import PolarGrid
from ..echo_power import echo_powers
from ..error_budget import total_db
from ..polar_cover import PolarCover

_SAMPLES_PER_SIDE = 5  # map positions at which errors are looked up
_WAVENUMBERS = 5  # of the band
_PULSES = 64  # of a sub-aperture or a window


def reading_db(cover: PolarCover, polar: PolarGrid, tx_m, rx_m,
               illumination: Illumination | None = None, *, centred: bool = False) -> float:
    """Mean error of both passes of the interpolation to a map, relative to the echoes' power, dB.

    Parameters
    ----------
    cover : PolarCover
        Of the map, with the interpolators.
    polar : PolarGrid
        Of the fused image: that of `cover`, or one with fewer lines.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres that were flown, metres.
    illumination : Illumination, optional
        Of the P C echoes; pixels that they do not light stay out.
    centred : bool
        The image is read at baseband along direction, as those of sliding apertures are.
    """
    (tx_m, rx_m), (r, alpha), lines, paths = _of_some_echoes(cover, polar, tx_m, rx_m,
                                                            illumination)
    slope_alpha = half_paths(tx_m, rx_m, lines[0], polar.by_direction(r, alpha))[1]
    # along a line of the map the direction changes with range, too
    ahead = (lines[0][:, cover.axis] - polar.origin_m[cover.axis]) / r
    alpha_by_range = (polar.track[cover.axis] / ahead - alpha) / r
    radar = cover.window.radar
    k = np.linspace(*radar.wavenumbers_rad_per_m, _WAVENUMBERS)[:, None, None]
    along_range = (k * (paths.derivatives[0] + slope_alpha * alpha_by_range)
                   - radar.wavenumber_rad_per_m)
    along_alpha = k * slope_alpha
    if centred:
        along_alpha -= (0.5 * (slope_alpha.min() + slope_alpha.max())
                        * radar.wavenumber_rad_per_m)
    weight = echo_powers(tx_m, rx_m, cover.grid.centre_m, cover.grid.spacing_m * np.array(
        [[cover.grid.n_x, 0, 0], [0, cover.grid.n_y, 0]]), radar)
    return total_db(*(
        interpolator.mean_error_db(paths.with_lit(frequency) * (spacing / (2 * np.pi)), weight)
        for interpolator, frequency, spacing in (
            (cover.between, along_alpha, polar.alpha_spacing),
            (cover.along, along_range, polar.range_spacing_m))))


def ends_db(cover: PolarCover, polar: PolarGrid, tx_m, rx_m,
            illumination: Illumination | None = None) -> float:
    """Error on the map because profiles end, dB; arguments as of `reading_db`."""
    paths = _of_some_echoes(cover, polar, tx_m, rx_m, illumination)[-1]
    return cover.window.mean_end_error_db(
        paths.length, oversampling=cover.lattice.oversampling(cover.window.radar), lit=paths.lit)


def _of_some_echoes(cover, polar, tx_m, rx_m, illumination):
    """Of samples of the map, seen by echoes of some pulses.

    Phase centres, two (R, 3); range and direction, (S,) each; positions and derivatives of the
    lines; `Paths` of them all.
    """
    step = max(1, len(tx_m) // _PULSES)
    if illumination is not None:
        number = np.arange(len(illumination.centre_m)).reshape(len(tx_m), -1)
        illumination = illumination.select(number[::step].ravel())
    centres = [c[::step].reshape(-1, 3) for c in (tx_m, rx_m)]
    place = polar.from_map(*(v.ravel() for v in np.meshgrid(*(
        np.linspace(v[0], v[-1], _SAMPLES_PER_SIDE) for v in (cover.grid.x_m, cover.grid.y_m)))))
    lines = polar.lines(*place)
    paths = sample_paths(*centres, lines)
    if illumination is not None:
        paths = illumination.of_paths(paths, lines[0])
    return centres, place, lines, paths
