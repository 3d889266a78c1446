"""Polar image of a block: its grid, how its lines read the profiles, and what it costs.

On unified polar coordinates around the aperture centre the half path is nearly the range itself,
so that image lines read the profiles in step.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import TYPE_CHECKING

from ...geometry.grids import MapGrid
from ...geometry.half_paths import Paths, sample_paths
from ...geometry.illumination import Illumination
from ...geometry.polar import PolarGrid
from ...signal.radar import RadarParameters
from ..costs import costs
from ..error_budget import EXACT_SHARES, PASSES_DB, error_budget
from ..interpolators import Interpolator
from ..plan import Plan
from ..polar_cover import PolarCover, cover_map
from ..profiles.range_gate import RangeGate
from ..profiles.range_resampling import RangeResampling, plan_resampling, resampling_error_db
from .azimuth_upsampling import AzimuthParts, plan_parts

if TYPE_CHECKING:
    from .lit_lines import LitLines

_SAMPLES_PER_SIDE = 5  # positions at which the geometry is bounded


@dataclasses.dataclass(frozen=True, eq=False)
class PolarPlan(Plan):
    """Polar image of a block that meets an error target on the map.

    Attributes
    ----------
    lattice : RangeResampling
        How its lines read the profiles.
    window : RangeGate
        Part of the profiles that it needs.
    axis : int
        Map axis along which the second pass of the resampling goes.
    between, along : Interpolator
        Of the resampling: between lines and along them.
    parts : AzimuthParts or None
        Cut into parts with fewer lines each; None where all echoes go straight to `polar`.
    cost : float
        Nanoseconds per map pixel.
    lit : LitLines or None
        Knots of the echoes' amplitudes; None where all pixels are lit alike.
    """

    polar: PolarGrid
    lattice: RangeResampling
    window: RangeGate
    range_m: tuple[float, float]
    axis: int
    between: Interpolator
    along: Interpolator
    parts: AzimuthParts | None
    wavelength_m: float
    errors_db: Mapping[str, float]
    cost: float
    lit: LitLines | None = None


def plan_polar(grid: MapGrid, tx_m, rx_m, radar: RadarParameters, n_samples: int,
               target_db: float, illumination: Illumination | None = None) -> PolarPlan | None:
    """Plan the polar image of echoes of phase centres, with `illumination` of these.

    Returns
    -------
    PolarPlan or None
        None where the map is tiny, too near, all around, or not ahead of the aperture.
    """
    budget, planner = error_budget(target_db, EXACT_SHARES), None
    profiles_db, map_db = budget['range profiles'], budget['polar to map'] - PASSES_DB
    cover_of = functools.partial(cover_map, grid, tx_m, rx_m, radar, n_samples,
                                 lattice_db=profiles_db, illumination=illumination)
    if illumination is not None:
        from .lit_polar import LitPolar  # only images with illumination need it

        planner = LitPolar(illumination, tx_m, rx_m, radar)
    cover = planner.cover(cover_of, map_db) if planner else cover_of(map_db)
    if cover is None:
        return None
    polar, n_pixels = cover.polar, grid.n_x * grid.n_y
    if polar.n_range * polar.n_alpha > 3 * n_pixels + 100_000:
        return None
    parts = (planner.parts if planner else plan_parts)(cover, budget['azimuth upsampling'])
    lattice = None
    if parts is not None:
        lattice = _lattice_of_parts(parts, cover, tx_m, rx_m, profiles_db, illumination)
    if lattice is None:
        lattice, parts = cover.lattice, None
    lit, lines = None, polar if parts is None else parts.coarse
    if planner:
        lattice, lit = planner.lines(lines, lattice, parts, profiles_db, budget['illumination'])
        if lattice is None:
            return None
    errors = {'range profiles': lattice.predicted_error_db, 'polar to map': cover.resampling_db,
              'ends of profiles': cover.profile_db}
    cost = lattice.cost * len(tx_m)
    if parts is not None:
        errors['azimuth upsampling'], cost = parts.error_db, parts.cost
    if lit is not None:
        errors['illumination'] = lit.predicted_error_db
        echo_cost = lattice.cost * len(tx_m) * lines.n_alpha / polar.n_alpha
        cost -= echo_cost * (1 - lit.share)
    return PolarPlan(polar, lattice, cover.window, cover.range_m, cover.axis, cover.between,
                     cover.along, parts, radar.wavelength_m, errors,
                     cost * (polar.n_range * polar.n_alpha / n_pixels) + costs().map_pixel, lit)


def _sampled_paths(polar: PolarGrid, tx_m, rx_m, illumination: Illumination | None) -> Paths:
    """Half paths to samples of a grid, and which echoes light these."""
    lines = polar.lines(*polar.sampled(_SAMPLES_PER_SIDE, _SAMPLES_PER_SIDE))
    paths = sample_paths(tx_m, rx_m, lines)
    return paths if illumination is None else illumination.of_paths(paths, lines[0])


def _lattice_of_parts(parts: AzimuthParts, cover: PolarCover, tx_m, rx_m, target_db: float,
                      illumination: Illumination | None) -> RangeResampling | None:
    """Lattice that is as good where echoes are added part by part, to lines far beyond the map.

    That of the map where it will do, None where none does.
    """
    coarse, window = parts.coarse, cover.window
    paths = dataclasses.replace(_sampled_paths(coarse, tx_m, rx_m, illumination),
                                parts=tuple(echoes.start for echoes in parts.echoes))
    error_db = resampling_error_db(cover.lattice, paths, window.radar)
    if error_db <= target_db:
        return dataclasses.replace(cover.lattice, predicted_error_db=error_db)
    return plan_resampling(paths, coarse.range_spacing_m, coarse.n_range, window.radar,
                           window.n_samples, target_db)
