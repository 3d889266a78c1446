# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Plan of an image of one aperture by accelerated fast backprojection, Zhang et al. 2014."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from ...geometry.grids import MapGrid
from ...geometry.illumination import Illumination
from ...geometry.polar import PolarGrid
from ...memory import IMAGE_BYTES
from ...signal.radar import RadarParameters
from ..ambiguities import azimuth_warnings
from ..costs import costs
from ..echo_power import echoes_alike
from ..exact.points import extent, pixels_of
from ..plan import Plan
from ..polar_cover import PolarCover
from ..profiles import PhaseHistory, covered_ranges, reach_warnings, some_pixels
from .polar_grids import cover_for_fusion
from .subapertures import SubaperturePlan, plan_subapertures

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

_P = TypeVar('_P', bound='AfbpPlan')
_LEAST_DB, _MOST_DB = -90.0, -20.0  # targets
# Times as long as exact backprojection point by point: steep and wide apertures fill so wide a
# band along range that a sub-aperture image has hundreds of times as many pixels as the map
_MOST_TIMES = 30.0
_map_pixels = functools.lru_cache(maxsize=8)(some_pixels)  # the map stays, the aperture moves


@dataclasses.dataclass(frozen=True, eq=False)
class AfbpPlan(Plan):
    """How the image of an aperture is formed by AFBP.

    Attributes
    ----------
    tx_m, rx_m : (P, C, 3) float64
        Phase centres that it is for, metres.
    subapertures : SubaperturePlan
        Cut of the aperture, images of its parts and grids of their fusion.
    errors_db : mapping of str to float
        Predicted error against time-domain correlation by cause, dB, of a scene that is evenly
        bright.
    seconds : float
        Predicted time on one thread.
    n_bytes : int
        Memory that forming the image takes, bytes.
    """

    grid: MapGrid | PolarGrid
    tx_m: np.ndarray
    rx_m: np.ndarray
    subapertures: SubaperturePlan
    errors_db: Mapping[str, float]
    seconds: float
    n_bytes: int
    warnings: tuple[str, ...]

    @property
    def operations(self) -> dict[str, float]:
        """How often the operations of `CostModel` are done."""
        return _operations(self.grid, self.subapertures)

    @functools.cached_property
    def echoes_alike(self) -> float:
        """Mean number of echoes that an image does not tell apart, see `planning.echo_power`."""
        tx_m, rx_m = (centres_m.reshape(-1, 3) for centres_m in (self.tx_m, self.rx_m))
        return echoes_alike(tx_m, rx_m, *extent(pixels_of(self.grid)), self.subapertures.radar)

    def __str__(self) -> str:
        return str(self.subapertures)

    @classmethod
    def of(cls: type[_P], grid: MapGrid | PolarGrid, tx_m: np.ndarray, rx_m: np.ndarray,
           plan: SubaperturePlan, cover: PolarCover | None, **more: Any) -> _P:
        """Plan of an image from that of the sub-apertures of its polar image.

        `cover` tells how a map is made from that; None for a polar grid. The other arguments are
        attributes, `more` those of a subclass.

        Raises
        ------
        ValueError
            It takes many times as long as exact backprojection.
        """
        errors = plan.errors_db
        if cover is not None:
            errors |= {'polar to map': cover.polar_to_map_db, 'ends of profiles': cover.profile_db}
        pixels = _map_pixels(grid) if isinstance(grid, MapGrid) else some_pixels(grid)
        illumination = plan.amplitudes and plan.amplitudes.illumination
        start, stop = covered_ranges(plan.given, plan.n_samples)
        # phase histories repeat
        within = plan.source.periodic or start <= plan.range_m[0] <= plan.range_m[1] <= stop
        beyond = () if within else reach_warnings(pixels, tx_m, rx_m, plan.given, plan.n_samples,
                                                  illumination)
        warnings = (*plan.warnings, *beyond, *azimuth_warnings(pixels, tx_m, rx_m, plan.radar,
                                                               illumination))
        counts = _operations(grid, plan)
        seconds = costs().seconds(counts)
        # what sub-apertures take beside their pixels is no reason to refuse a small image
        _check_seconds(costs().seconds(counts | {'image': 1}),
                       tx_m[..., 0].size * math.prod(grid.shape))
        return cls(grid, tx_m.copy(), rx_m.copy(), plan, errors, seconds, _n_bytes(grid, plan),
                   warnings, **more)


def plan_afbp(grid: MapGrid | PolarGrid, radar: RadarParameters, n_samples: int, tx_m: ArrayLike,
              rx_m: ArrayLike, *, target_db: float, pulses_per_subaperture: int | None = None,
              compressed: bool = True, weighting: str = 'none',
              illumination: Illumination | None = None) -> AfbpPlan:
    """Plan the image of an aperture; arguments as of `imaging.imager.plan_image`.

    `tx_m` and `rx_m`, (P, C, 3), are those of the whole aperture; multichannel paths are exact.
    The origin of a polar grid should lie in its middle. Sub-apertures have the length that is
    quickest unless `pulses_per_subaperture` tells it. `illumination` is that of all echoes.

    Raises
    ------
    ValueError
        The geometry does not allow the target, with the reason; exact backprojection images any.
    """
    tx_m, rx_m = np.asarray(tx_m, np.float64), np.asarray(rx_m, np.float64)
    check_arguments(grid, target_db, tx_m, rx_m)
    if compressed and weighting != 'none':
        raise ValueError(f'weighting={weighting!r} is for phase histories (compressed=False); '
                         'profiles are weighted by range compression')
    band = None if compressed else PhaseHistory(radar, n_samples, weighting)
    cover: PolarCover | None = None
    if isinstance(grid, MapGrid):
        cover, target_db = cover_for_fusion(grid, tx_m, rx_m, radar, n_samples, target_db, band,
                                            illumination=illumination)
        polar = cover.polar
    else:
        polar = grid
    plan = plan_subapertures(polar, radar, n_samples, tx_m, rx_m, target_db=target_db, cover=cover,
                             pulses_per_subaperture=pulses_per_subaperture, band=band,
                             illumination=illumination)
    return AfbpPlan.of(grid, tx_m, rx_m, plan, cover)


def check_arguments(grid: object, target_db: float, tx_m: np.ndarray, rx_m: np.ndarray) -> None:
    """Refuse what AFBP cannot image, with a ValueError."""
    if not isinstance(grid, MapGrid | PolarGrid):
        raise ValueError(f'grid is a {type(grid).__name__}; AFBP images a MapGrid or a PolarGrid; '
                         'use exact backprojection')
    if not _LEAST_DB <= target_db <= _MOST_DB:
        raise ValueError(f'target_db={target_db}; expected {_LEAST_DB:g} to {_MOST_DB:g} dB')
    if tx_m.shape != rx_m.shape or tx_m.ndim != 3 or tx_m.shape[-1] != 3 or not tx_m.size:
        raise ValueError(f'tx_m.shape={tx_m.shape}, rx_m.shape={rx_m.shape}; expected '
                         '(pulses, channels, 3) for both')


def _check_seconds(seconds: float, n_pairs: int) -> None:
    """Refuse with a ValueError what takes far longer than adding each echo to each pixel."""
    times = seconds / costs().seconds({'image': 1, 'point_pixel': n_pairs})
    if times > _MOST_TIMES:
        raise ValueError(f'AFBP would take {seconds:.2g} s here, {times:.0f} times as long as '
                         'exact backprojection point by point: its images need too many pixels '
                         'for this aperture; use exact backprojection')


def _operations(grid: MapGrid | PolarGrid, plan: SubaperturePlan) -> dict[str, float]:
    n_echoes = plan.n_channels * sum(p.stop - p.start for p in plan.sampling.pulses)
    seen = plan.n_subapertures if plan.amplitudes is None else len(plan.amplitudes.seen)
    counts: dict[str, float] = {
        'image': 1 + seen,
        'map_pixel': grid.n_x * grid.n_y if isinstance(grid, MapGrid) else 0}
    n_echoes = n_echoes * seen / plan.n_subapertures
    counts |= plan.image_operations(n_echoes, seen)
    return counts | plan.fusion_grid.operations(seen)


def _n_bytes(grid: MapGrid | PolarGrid, plan: SubaperturePlan) -> int:
    """Fused spectrum, two sub-aperture images, and the image: a map may take the spectrum's."""
    fused, coarse = plan.fusion_grid, plan.coarse
    spectrum = fused.n_fine * len(fused.range_wavenumbers)
    n_bytes = 0 if plan.amplitudes is None else plan.amplitudes.n_bytes(
        coarse, plan.beams.segment if plan.beams else plan.resampling.segment)
    return n_bytes + IMAGE_BYTES * (spectrum + 2 * coarse.n_alpha * coarse.n_range
                                    + math.prod(grid.shape))
