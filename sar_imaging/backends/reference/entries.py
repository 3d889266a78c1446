# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What imagers call: the operations, chained as plans say."""

from __future__ import annotations

import numpy as np

from ...geometry.grids import MapGrid
from ...geometry.polar import PolarGrid
from ...planning.afbp.polar_grids import UnifiedPolarGrids
from ...planning.afbp.subapertures import SubaperturePlan
from ...planning.exact.backprojection import BackprojectionPlan
from ...planning.exact.polar_image import PolarPlan
from ...planning.interpolators import design_interpolator
from ...planning.polar_cover import DEGREE, TAPS, range_axis
from ...signal.pulses import PulseBlock
from .fuse_bands import fuse_bands, fused_image
from .polar_to_map import polar_to_map
from .project_lines import project_lines
from .project_points import project_points
from .subaperture_beams import image_from_beams
from .upsample_azimuth import upsample_azimuth


class Backprojection:
    """Exact backprojection, as `backends.protocol.Backprojection` describes it.

    Parameters
    ----------
    plan : BackprojectionPlan
        What is computed.
    memory : optional
        Of no use here; other backends share it between imagers.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid
    >>> from sar_imaging.backends.reference import Backprojection
    >>> from sar_imaging.planning.exact.backprojection import plan_backprojection
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(4))
    >>> rows = [a.reshape(20, -1) for a in (block.samples, block.tx_m, block.rx_m)]
    >>> grid = MapGrid((10_000.0, 0.0, 0.0), 9, 9, 0.5)
    >>> plan = plan_backprojection(grid, block.radar, block.n_samples, *rows[1:], -60.0)
    >>> image = np.zeros(grid.shape, np.complex64)
    >>> Backprojection(plan).add(*rows, image)
    >>> print(f'{abs(image[4, 4]):.1f} of 4 pulses and 5 channels')
    20.0 of 4 pulses and 5 channels
    """

    memory = None

    def __init__(self, plan: BackprojectionPlan, memory: object = None) -> None:
        self.plan = plan

    def add(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, image: np.ndarray
            ) -> None:
        """Add echoes to an image."""
        grid, route = self.plan.grid, self.plan.route
        if isinstance(route, PolarPlan):
            assert isinstance(grid, MapGrid)  # as of all polar images
            polar_image = self._polar_image(route, samples, tx_m, rx_m)
            image += polar_to_map(polar_image, route.polar, grid, axis=route.axis,
                                  wavelength_m=route.wavelength_m, between=route.between,
                                  along=route.along)
            return
        points_m = grid.points().reshape(*image.shape, 3)  # whatever the route, exactly
        image += project_points(route.window, samples, route.resampling.n_padded, tx_m, rx_m,
                                points_m, self.plan.illumination)

    def _polar_image(self, route: PolarPlan, samples: np.ndarray, tx_m: np.ndarray,
                     rx_m: np.ndarray) -> np.ndarray:
        illumination = self.plan.illumination

        def project(echoes: slice, polar: PolarGrid) -> np.ndarray:
            return project_lines(route.window, samples[echoes], route.resampling.n_padded,
                                 tx_m[echoes], rx_m[echoes], polar,
                                 illumination and illumination.select(echoes))

        if route.parts is None:
            return project(slice(None), route.polar)
        parts = route.parts
        return upsample_azimuth([project(echoes, parts.coarse) for echoes in parts.echoes], parts)


class SubapertureImager:
    """First stage of AFBP, as `backends.protocol.SubapertureImager` describes it.

    Parameters
    ----------
    plan : SubaperturePlan
        Sub-apertures, grids and profiles.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid, concatenate
    >>> from sar_imaging.backends.reference import SubapertureImager
    >>> from sar_imaging.planning.afbp.polar_grids import cover_for_fusion
    >>> from sar_imaging.planning.afbp.subapertures import plan_subapertures
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['psf']().blocks())).select(slice(0, 40))
    >>> grid = MapGrid((10_000.0, 0.0, 0.0), 33, 33, 0.5)
    >>> aperture = block.tx_m, block.rx_m, block.radar, block.n_samples
    >>> cover, polar_db = cover_for_fusion(grid, *aperture, -40.0, None)
    >>> plan = plan_subapertures(cover.polar, block.radar, block.n_samples, block.tx_m, block.rx_m,
    ...                          target_db=polar_db, cover=cover, pulses_per_subaperture=20)
    >>> image = SubapertureImager(plan).image(0, block.select(plan.sampling.pulses[0]))
    >>> print(f'{np.hypot(*image).max():.0f} of 20 pulses and 5 channels')
    94 of 20 pulses and 5 channels
    """

    def __init__(self, plan: SubaperturePlan) -> None:
        self.plan = plan

    def image(self, number: int, block: PulseBlock, weights: np.ndarray | None = None,
              out: np.ndarray | None = None) -> np.ndarray:
        """Backproject one sub-aperture (Zhang et al., equation 6)."""
        plan = self.plan
        plan.check_block(number, block)
        samples = block.samples.reshape(-1, plan.n_samples)
        tx_m, rx_m = (centres.reshape(-1, 3) for centres in block.centres_m)
        weights = np.ones(block.n_pulses) if weights is None else weights
        samples = samples * np.repeat(weights, plan.n_channels)[:, None]
        if plan.beams is None:
            image = project_lines(plan.source, samples, plan.resampling.n_padded, tx_m, rx_m,
                                  plan.coarse, plan.illumination_of(block))
        else:
            nodes = plan.weighed_by(block)
            parts = [*nodes] if isinstance(nodes, tuple) else [None]
            image = np.sum([image_from_beams(plan, samples[k::len(parts)], tx_m[k::len(parts)],
                                             rx_m[k::len(parts)], one)
                            for k, one in enumerate(parts)], axis=0)
        out = np.empty((2, *image.shape), np.float32) if out is None else out
        out[:] = image.real, image.imag
        return out


class SpectrumFusion:
    """Second stage of AFBP, as `backends.protocol.SpectrumFusion` describes it.

    Contributions are kept as images; their spectra are summed when an image is wanted.

    Parameters
    ----------
    grid : UnifiedPolarGrids
        Grids of the sub-apertures and of their fused image.
    keep : bool
        Keep contributions, so that they can be replaced and removed.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid, concatenate
    >>> from sar_imaging.backends.reference import SpectrumFusion, SubapertureImager
    >>> from sar_imaging.planning.afbp.polar_grids import cover_for_fusion
    >>> from sar_imaging.planning.afbp.subapertures import plan_subapertures
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['psf']().blocks())).select(slice(0, 40))
    >>> grid = MapGrid((10_000.0, 0.0, 0.0), 33, 33, 0.5)
    >>> aperture = block.tx_m, block.rx_m, block.radar, block.n_samples
    >>> cover, polar_db = cover_for_fusion(grid, *aperture, -40.0, None)
    >>> plan = plan_subapertures(cover.polar, block.radar, block.n_samples, block.tx_m, block.rx_m,
    ...                          target_db=polar_db, cover=cover, pulses_per_subaperture=20)
    >>> stage, fusion = SubapertureImager(plan), SpectrumFusion(plan.fusion_grid)
    >>> for number, pulses in enumerate(plan.sampling.pulses):
    ...     image = stage.image(number, block.select(pulses))
    ...     fusion.add(number, image, plan.sampling.centre[number])
    >>> sorted(fusion.included), fusion.polar_image().dtype.name
    ([0, 1], 'float32')
    """

    def __init__(self, grid: UnifiedPolarGrids, *, keep: bool = False) -> None:
        self.grid, self._keep = grid, keep
        self._contributions: dict[int, tuple[np.ndarray, float]] = {}

    @property
    def included(self) -> frozenset[int]:
        """Sub-apertures in the image."""
        return frozenset(self._contributions)

    def add(self, number: int, image: np.ndarray, centre_m: float) -> None:
        """Add a sub-aperture, or replace it where contributions are kept."""
        self.grid.check_contribution(image, centre_m)
        if number in self._contributions and not self._keep:
            raise ValueError(f'sub-aperture {number} is in the image already; fuse with keep=True '
                             'to replace contributions')
        self._contributions[number] = _complex(image).astype(np.complex128), centre_m

    def remove(self, number: int) -> None:
        """Take a sub-aperture out of the image; needs ``keep=True``."""
        if not self._keep or number not in self._contributions:
            raise ValueError(f'sub-aperture {number} cannot be removed: ' + (
                'it is not in the image' if self._keep else 'contributions are not kept'))
        del self._contributions[number]

    def polar_image(self, centre_m: float = 0.0) -> np.ndarray:
        """Image of the sub-apertures that were added so far."""
        spectrum = fuse_bands(self.grid, self._contributions.values())
        image = fused_image(self.grid, spectrum, centre_m)
        return np.stack([image.real, image.imag]).astype(np.float32)

    def take_polar_image(self) -> np.ndarray:
        """As `polar_image`; nothing is included any more."""
        image = self.polar_image()
        self.clear()
        return image

    def clear(self) -> None:
        """Begin another aperture on the same grid: nothing is included any more."""
        self._contributions.clear()


def form_map(polar_image: np.ndarray, fusion: UnifiedPolarGrids, grid: MapGrid,
             centre_m: float = 0.0, *, overwrite: bool = False) -> np.ndarray:
    """Interpolate a fused image to a map, as `backends.protocol.Backend` describes it.

    Parameters
    ----------
    polar_image : (2, n_alpha, n_range) float32
        Fused image at range baseband, see `SpectrumFusion.polar_image`.
    fusion : UnifiedPolarGrids
        Its grids.
    grid : MapGrid
        The map.
    centre_m : float
        As given to `SpectrumFusion.polar_image`, metres.
    overwrite : bool
        Whether the map may lie in the memory of the polar image.

    Returns
    -------
    (n_y, n_x) complex64
        Image with the carrier phase of each pixel's range.

    Raises
    ------
    ValueError
        The grid is not for a map.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid, concatenate
    >>> from sar_imaging.backends.reference import SpectrumFusion, SubapertureImager, form_map
    >>> from sar_imaging.planning.afbp.polar_grids import cover_for_fusion
    >>> from sar_imaging.planning.afbp.subapertures import plan_subapertures
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['psf']().blocks())).select(slice(0, 40))
    >>> grid = MapGrid((10_000.0, 0.0, 0.0), 33, 33, 0.5)
    >>> aperture = block.tx_m, block.rx_m, block.radar, block.n_samples
    >>> cover, polar_db = cover_for_fusion(grid, *aperture, -40.0, None)
    >>> plan = plan_subapertures(cover.polar, block.radar, block.n_samples, block.tx_m, block.rx_m,
    ...                          target_db=polar_db, cover=cover, pulses_per_subaperture=20)
    >>> stage, fusion = SubapertureImager(plan), SpectrumFusion(plan.fusion_grid)
    >>> for number, pulses in enumerate(plan.sampling.pulses):
    ...     image = stage.image(number, block.select(pulses))
    ...     fusion.add(number, image, plan.sampling.centre[number])
    >>> image = form_map(fusion.polar_image(), plan.fusion_grid, grid)
    >>> image.shape, f'{abs(image[16, 16]):.0f} of 40 pulses and 5 channels'
    ((33, 33), '200 of 40 pulses and 5 channels')
    """
    fusion.check_for_map()
    assert fusion.between is not None  # as was checked
    polar = fusion.polar
    along = design_interpolator(fusion.range_oversampling, taps=TAPS, degree=DEGREE)
    image = polar_to_map(_complex(polar_image), polar, grid, axis=range_axis(polar, grid),
                         wavelength_m=fusion.wavelength_m, between=fusion.between, along=along)
    _, alpha = polar.from_map(grid.x_m, grid.y_m[:, None])
    cycles = 2 * centre_m / fusion.wavelength_m * (alpha - polar.alpha_start)
    return (image * np.exp(2j * np.pi * np.fmod(cycles, 1.0))).astype(np.complex64)


def _complex(image: np.ndarray) -> np.ndarray:
    return image if np.iscomplexobj(image) else image[0] + 1j * image[1]
