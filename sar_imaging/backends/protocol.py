# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What every backend offers: the four entries, and what they promise."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np

    from ..geometry.grids import MapGrid
    from ..geometry.illumination import Illumination
    from ..planning.afbp.polar_grids import UnifiedPolarGrids
    from ..planning.afbp.subapertures import SubaperturePlan
    from ..planning.exact.backprojection import BackprojectionPlan
    from ..signal.pulses import PulseBlock
    from ..signal.radar import RadarParameters
    from .edge_brightness import EdgeBrightness


class Backprojection(Protocol):
    """Adds range profiles to images by one plan."""

    plan: BackprojectionPlan
    memory: object  # what plans whose echoes are added in turn may share

    def add(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray,
            image: np.ndarray) -> None:
        """Add echoes to an image, one of each pulse and channel.

        Parameters
        ----------
        samples : (R, N) complex64
            Their profiles.
        tx_m, rx_m : (R, 3) float64
            Their phase centres, metres; those of the plan.
        image : (...) complex64
            Of the shape of the plan's grid. ``sum_r w_r(x) s_r(D_r(x)) exp(+j k_c D_r(x))`` is
            added to every pixel x that has a position, w_r of the plan's illumination, or 1;
            contiguous in C order.
        """


class SubapertureImager(Protocol):
    """Forms images of the sub-apertures of one plan."""

    plan: SubaperturePlan

    def image(self, number: int, block: PulseBlock, weights: np.ndarray | None = None,
              out: np.ndarray | None = None) -> np.ndarray:
        """Backproject one sub-aperture (Zhang et al., equation 6).

        Parameters
        ----------
        number : int
            Which sub-aperture; its nominal pulses are ``plan.sampling.pulses[number]``.
        block : PulseBlock
            Its range profiles, or its phase histories, with phase centres.
        weights : (P,) float32, optional
            Window over its pulses.
        out : (2, n_alpha, n_range) float32, optional
            Memory for the image.

        Returns
        -------
        (2, n_alpha, n_range) float32
            Real and imaginary part on `plan.coarse`, at range baseband: times
            ``exp(-j 4 pi (r - r_0) / lambda)``, r_0 the first range of `plan.coarse`.

        Raises
        ------
        ValueError
            The block does not match the plan, or there is no such sub-aperture.
        """


class SpectrumFusion(Protocol):
    """Fuses sub-aperture images of one grid, in any order, any subset (Zhang et al., II.B)."""

    grid: UnifiedPolarGrids

    @property
    def included(self) -> frozenset[int]:
        """Sub-apertures in the image."""

    def add(self, number: int, image: np.ndarray, centre_m: float) -> None:
        """Add a sub-aperture, or replace it where contributions are kept.

        Parameters
        ----------
        number : int
            Which sub-aperture; any number that tells it from the others.
        image : (n_alpha, n_range) complex64 or (2, n_alpha, n_range) float32
            On ``grid.coarse`` at range baseband, complex or as real and imaginary part.
        centre_m : float
            Middle of its band: of the derivatives of its half paths by direction over those by
            range, metres.

        Raises
        ------
        ValueError
            The image has another shape, the centre is not finite, or the sub-aperture is in
            already and contributions are not kept.
        """

    def remove(self, number: int) -> None:
        """Take a sub-aperture out of the image; needs ``keep=True``.

        Raises
        ------
        ValueError
            It is not in the image, or contributions are not kept.
        """

    def polar_image(self, centre_m: float = 0.0) -> np.ndarray:
        """Image of the sub-apertures that were added so far, real and imaginary part.

        Parameters
        ----------
        centre_m : float
            Middle of their bands, metres, where that is far from 0: the image is then given at
            baseband along direction, too.

        Returns
        -------
        (2, n_alpha, n_range) float32
            On ``grid.polar``, at range baseband: times ``exp(-j 4 pi (r - r_0) / lambda)`` and
            ``exp(-j 4 pi centre_m (alpha - alpha_0) / lambda)``, r_0 and alpha_0 the first range
            and direction of ``grid.polar``. Where the grid is for a map, frequencies along
            direction are multiplied by the gain of ``grid.between``.
        """

    def take_polar_image(self) -> np.ndarray:
        """As `polar_image`, in less memory: nothing is included any more."""

    def clear(self) -> None:
        """Begin another aperture on the same grid: nothing is included any more."""


class ApertureFusion(Protocol):
    """Both stages of AFBP of whole apertures by one plan, some sub-apertures at a time.

    A backend may lack it.
    """

    plan: SubaperturePlan

    def polar_image(self, block: PulseBlock, weights: np.ndarray | None = None,
                    brightness: EdgeBrightness | None = None, *, progress: bool = False
                    ) -> np.ndarray:
        """Fuse the images of all sub-apertures.

        Parameters
        ----------
        block : PulseBlock
            Pulses of the aperture.
        weights : (P,) float32, optional
            Window over them.
        brightness : EdgeBrightness, optional
            Counts the images of the sub-apertures.
        progress : bool
            Show a bar.

        Returns
        -------
        (2, n_alpha, n_range) float32
            As of `SpectrumFusion.polar_image`.
        """


class TrialImages(Protocol):
    """Quick images of few pixels of one aperture, for the many geometries that a search tries.

    Good to a tenth of the amplitude or so, which tells a focused image from others. A backend may
    lack it.

    Attributes
    ----------
    length : int
        Pixels of a piece of a line.
    """

    length: int

    def image(self, tx_m: np.ndarray, rx_m: np.ndarray, starts_m: np.ndarray,
              step_m: np.ndarray, range_bias_m: float = 0.0) -> np.ndarray:
        """Backproject the profiles from some phase centres onto short pieces of lines.

        Parameters
        ----------
        tx_m, rx_m : (..., 3) float64
            Phase centres of the profiles, metres.
        starts_m, step_m : (K, 3), (3,) float64
            First pixel of each piece, and from pixel to pixel, metres.
        range_bias_m : float
            By how much the ranges of the profiles are too large, metres.

        Returns
        -------
        (2, K, length) float32
            Real and imaginary part.
        """


class Correlation(Protocol):
    """Time-domain correlation in float64, the reference of all images; a backend may lack it.

    Formulas and arguments are those of `backends.reference.correlation`.
    """

    def correlate_spectra(self, cycles_per_m: tuple[float, float], spectra: np.ndarray,
                          tx_m: np.ndarray, rx_m: np.ndarray, points_m: np.ndarray,
                          illumination: Illumination | None = None) -> np.ndarray:
        """Correlate spectra, (N,) complex128 at points (N, 3)."""

    def correlate_profiles(self, radar: RadarParameters, samples: np.ndarray, tx_m: np.ndarray,
                           rx_m: np.ndarray, points_m: np.ndarray, half: int, sharpness: float,
                           illumination: Illumination | None = None
                           ) -> tuple[np.ndarray, np.ndarray]:
        """Correlate profiles at points; image, and which of the points they cover."""


class Backend(Protocol):
    """What a backend's package must offer to the imagers.

    One with a true attribute ``DEVICE_ARRAYS`` takes arrays of CuPy for samples and images as
    well, and may return images, spectra and maps as such arrays.
    """

    def Backprojection(self, plan: BackprojectionPlan, memory: object = None) -> Backprojection:
        """Exact backprojection by a plan.

        Parameters
        ----------
        plan : BackprojectionPlan
            What is computed, and how.
        memory : object, optional
            The backend's work space, shared with other plans whose echoes are added in turn.
        """

    def SubapertureImager(self, plan: SubaperturePlan) -> SubapertureImager:
        """First stage of AFBP by a plan."""

    def SpectrumFusion(self, grid: UnifiedPolarGrids, *, keep: bool = False) -> SpectrumFusion:
        """Second stage of AFBP.

        Parameters
        ----------
        grid : UnifiedPolarGrids
            Grid of the sub-aperture images and of the fused one.
        keep : bool
            Keep each contribution, so that `SpectrumFusion.remove` and replacing are possible.
        """

    def form_map(self, polar_image: np.ndarray, fusion: UnifiedPolarGrids, grid: MapGrid,
                 centre_m: float = 0.0, *, overwrite: bool = False) -> np.ndarray:
        """Interpolate a fused image to a map and put its carrier back.

        Parameters
        ----------
        polar_image : (2, n_alpha, n_range) float32
            From `SpectrumFusion`.
        fusion : UnifiedPolarGrids
            Its grid, oversampled as it says.
        grid : MapGrid
            Map; ``fusion.polar`` covers it, finely enough to be interpolated.
        centre_m : float
            As given to `SpectrumFusion.polar_image`.
        overwrite : bool
            The polar image is not needed any more: its memory may become that of the map.

        Returns
        -------
        (n_y, n_x) complex64
            ``f(x) = sum_m sum_n s_mn(D_mn(x)) exp(+j k_c D_mn(x))``.

        Raises
        ------
        ValueError
            The grid is not for a map.
        """
