"""What the fusion of AFBP must know besides the sub-aperture images themselves."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np

from ...geometry.polar import PolarGrid
from ...signal.radar import SPEED_OF_LIGHT
from ..guard_taper import taper_band
from ..interpolators import Interpolator, design_interpolator
from ..polar_to_map import DEAPODISED_TAPS, DEGREE

_MAX_PIXELS = 2 ** 31  # of each grid; far beyond any memory, and safe to multiply


@dataclasses.dataclass(frozen=True)
class FusionSizes:
    """Sizes of the polar grids that sub-apertures share, coarse and fused.

    Attributes
    ----------
    n_coarse, n_fine : int
        Directions of a sub-aperture image and of the fused one over the same extent, guards
        included.
    n_guard, beta : float
        Coarse directions of each guard, and shape of the taper over it.
    n_coarse_range, n_fine_range : int
        Ranges of a sub-aperture image, and of the fused one over the same extent, guards
        included: those of `polar` lie in the middle.
    """

    polar: PolarGrid
    n_coarse: int
    n_fine: int
    n_guard: float
    beta: float
    n_coarse_range: int
    n_fine_range: int

    @property
    def extent(self) -> float:
        """Extent of both grids in direction cosine, guards included."""
        return self.n_fine * self.polar.alpha_spacing

    @property
    def fine_guard(self) -> int:
        """Fine directions of the guard before the first one of `polar`."""
        return math.ceil(self.n_guard * self.n_fine / self.n_coarse)

    @property
    def range_extent_m(self) -> float:
        """Extent of both grids in range, guards included, metres."""
        return self.n_fine_range * self.polar.range_spacing_m

    @property
    def fine_range_guard(self) -> int:
        """Fine ranges of the guard before the first one of `polar`."""
        return (self.n_fine_range - self.polar.n_range) // 2

    @property
    def range_guard(self) -> int:
        """Whole coarse ranges of each guard."""
        return self.fine_range_guard * self.n_coarse_range // self.n_fine_range

    def operations(self, n_subapertures: int) -> dict[str, float]:
        """How often fusing so many sub-aperture images does the operations of `CostModel`."""
        return {'subaperture': n_subapertures,
                'coarse_pixel': n_subapertures * self.n_coarse * self.n_coarse_range,
                'fine_pixel': self.n_fine * self.n_fine_range}


@dataclasses.dataclass(frozen=True)
class UnifiedPolarGrids(FusionSizes):
    """Polar grids that the sub-apertures of an aperture share, coarse and fused.

    Together with the middle of each sub-aperture's band it is all that `SpectrumFusion` needs:
    the plan of the backprojection stays with the first stage.

    Parameters
    ----------
    half_range : float
        Largest frequency of the images along range, relative to the carrier's, rad/m.
    carrier_hz : float
        Centre frequency of the range profiles, hertz.
    range_oversampling, alpha_oversampling : float
        By how much `polar` is sampled more finely than its image needs, to be interpolated to a
        map; both 1 where the image itself is wanted.
    propagation_speed_m_per_s : float
        Speed of the waves, metres per second.

    Raises
    ------
    ValueError
        A number is impossible, or the guards leave the plane.
    """

    half_range: float
    carrier_hz: float
    range_oversampling: float = 1.0
    alpha_oversampling: float = 1.0
    propagation_speed_m_per_s: float = SPEED_OF_LIGHT

    def __post_init__(self):
        for name in ('n_guard', 'half_range', 'carrier_hz', 'propagation_speed_m_per_s'):
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise ValueError(f'{name}={value} must be positive and finite')
        if not 0 <= self.beta <= 700:  # where the Kaiser window overflows
            raise ValueError(f'beta={self.beta}; expected 0 to 700')
        for name in ('range_oversampling', 'alpha_oversampling'):
            if not 1.0 <= getattr(self, name) < math.inf:
                raise ValueError(f'{name}={getattr(self, name)}; expected 1 or more')
        if not 0 < self.n_coarse_range <= self.n_fine_range or self.range_guard < 1:
            raise ValueError(f'n_coarse_range={self.n_coarse_range}, n_fine_range='
                             f'{self.n_fine_range}; expected at least as many fine ranges as '
                             f'coarse ones, the {self.polar.n_range} wanted ones and a guard at '
                             'either end')
        if not 2 * self.n_guard < self.n_coarse:
            raise ValueError(f'n_coarse={self.n_coarse} directions do not hold two guards of '
                             f'n_guard={self.n_guard:g}')
        if self.fine_guard + self.polar.n_alpha > self.n_fine:
            raise ValueError(f'n_fine={self.n_fine} directions do not hold the '
                             f'{self.polar.n_alpha} wanted ones and a guard')
        n_alpha = max(self.n_coarse, self.n_fine)
        if self.n_fine_range * n_alpha > _MAX_PIXELS:
            raise ValueError(f'{n_alpha} directions x {self.n_fine_range} ranges; expected at '
                             f'most {_MAX_PIXELS} pixels')
        if self.half_range > 2 * self.wavenumber_rad_per_m:
            raise ValueError(f'half_range={self.half_range:g} rad/m exceeds the carrier itself')
        self.coarse  # noqa: B018 refuses guards that leave the plane

    @functools.cached_property
    def coarse(self) -> PolarGrid:
        """Grid of the sub-aperture images: it reaches beyond `polar` by the guards.

        Raises ValueError where these leave the plane.
        """
        polar = self.polar
        try:
            return dataclasses.replace(
                polar, n_alpha=self.n_coarse, alpha_spacing=self.extent / self.n_coarse,
                alpha_start=polar.alpha_start - self.fine_guard * polar.alpha_spacing,
                n_range=self.n_coarse_range,
                range_spacing_m=self.range_extent_m / self.n_coarse_range,
                range_start_m=polar.range_start_m - self.fine_range_guard * polar.range_spacing_m)
        except ValueError as error:
            raise ValueError(f'the guards around the polar grid leave the plane: {error}; use '
                             'exact backprojection') from error

    @functools.cached_property
    def between(self) -> Interpolator | None:
        """Between lines, to a map; the spectrum is deapodised for it. None for no map."""
        if self.alpha_oversampling == 1:
            return None
        return design_interpolator(self.alpha_oversampling, taps=DEAPODISED_TAPS, degree=DEGREE,
                                   deapodised=True)

    @functools.cached_property
    def range_wavenumbers(self) -> np.ndarray:
        """(K,) float64 two-way wavenumbers K_r of the images along range, rad/m, ascending.

        Those of the carrier's bin, in the middle, and as many on either side as the band has that
        tapers over the guards widen.
        """
        step = 2 * math.pi / self.range_extent_m
        band = self.half_range + taper_band(self.range_guard * self.coarse.range_spacing_m)
        most = min(math.ceil(band / step), (self.n_coarse_range - 1) // 2)
        return self.wavenumber_rad_per_m + np.arange(-most, most + 1) * step

    @property
    def wavelength_m(self) -> float:
        """Wavelength at the carrier, metres."""
        return self.propagation_speed_m_per_s / self.carrier_hz

    @property
    def wavenumber_rad_per_m(self) -> float:
        """Two-way wavenumber at the carrier, radians per metre of half path."""
        return 4.0 * math.pi * self.carrier_hz / self.propagation_speed_m_per_s

    def check_contribution(self, image, centre_m: float) -> None:
        """Raise ValueError for what is no image on `coarse`, or a centre that is not finite."""
        shape = self.n_coarse, self.n_coarse_range
        expected = shape if np.iscomplexobj(image) else (2, *shape)
        if image.shape != expected:
            raise ValueError(f'image.shape={image.shape}; expected {expected}')
        if not math.isfinite(centre_m):
            raise ValueError(f'centre_m={centre_m}; expected a finite number of metres')

    def check_for_map(self) -> None:
        """Raise ValueError where images are too coarse to be interpolated to a map."""
        if self.between is None:
            raise ValueError('the fused image is not sampled finely enough to be interpolated to '
                             'a map; plan it for a MapGrid')
