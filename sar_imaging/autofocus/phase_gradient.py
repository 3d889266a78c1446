# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Phase gradient autofocus of polar images (Wahl, Eichel, Ghiglia & Jakowatz 1994).

In the polar coordinates of its aperture an image of a small scene is a Fourier transform of the
aperture: the pulse sent at X along the track makes up the angular wavenumber ``-(k_c + kappa) X``
(Zhang et al., section II). An error of the half path that is the same for the whole scene is then
a phase of that wavenumber. It is estimated from all range bins together, whatever it looks like,
and taken out exactly, its motion through range included.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from ..geometry.polar import PolarGrid
from ..planning.afbp.polar_grids import UnifiedPolarGrids
from ..planning.interpolators import Interpolator
from ..quality.measures import contrast
from ..signal.radar import RadarParameters

_ITERATIONS = 16
_SHRINK = 0.75  # of the window from one iteration to the next, after the first three
_WIDE = 3
_NARROWEST = 12.0  # window in azimuth resolutions
_PARTS = 16  # intervals of range that are dealt out to two halves of the image
_WORST_DB = -10.0  # estimated error of an image that may replace another
# Positions along the track to one line of the spectrum: where lines fall at the aperture's ends
# would otherwise decide how much of it is corrected.
_FINER = 4
_DARK_DB = -12.0  # a range bin below this share of the brightest has no scatterer to follow


@dataclasses.dataclass(frozen=True)
class PhaseGradientResult:
    """What phase gradient autofocus did.

    Attributes
    ----------
    image : (n_alpha, n_range) complex64
        Corrected image where accepted, else the original.
    accepted : bool
        True when contrast rose by the margin asked for, and the error is estimated at -10 dB or
        better.
    contrast_before, contrast_after : float
        Of the original and of the corrected image, accepted or not.
    position_m : (U,) float64
        Positions along the track, ascending, metres from the grid's origin.
    half_path_m : (U,) float64
        Change of the half path there that focuses the image, without constant and line, metres;
        for `residual.along_sight` after interpolation to the pulses.
    last_step_rad : float
        Rms phase that the last iteration changed.
    error_db : float
        Estimated error of the corrected image, from what two halves of its range bins say
        differently, dB. Errors that differ over the scene are no part of it.
    """

    image: np.ndarray
    accepted: bool
    contrast_before: float
    contrast_after: float
    position_m: np.ndarray
    half_path_m: np.ndarray
    last_step_rad: float
    error_db: float


class PhaseGradient:
    """Phase gradient autofocus (PGA) of polar images, planned for one grid.

    Parameters
    ----------
    polar : PolarGrid
        Polar grid of the images; its origin in the middle of the aperture, its directions sampled
        at least 1.1 times finer than the aperture resolves.
    radar : RadarParameters or UnifiedPolarGrids
        Radar parameters of the profiles that the images were made of, or of their fusion.
    aperture_m : (float, float)
        First and last position of the phase centres along the grid's track, metres from its
        origin.
    margin : float
        Relative gain of contrast from which the corrected image is accepted.

    Raises
    ------
    ValueError
        The grid samples directions too coarsely for the aperture.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import concatenate, plan_image
    >>> from sar_imaging.autofocus.phase_gradient import PhaseGradient
    >>> from sar_imaging.geometry import PolarGrid
    >>> from sar_imaging.simulation import SCENARIOS
    >>> profiles = concatenate(list(SCENARIOS['psf']().blocks()))
    >>> polar = PolarGrid((0.0, 0.0, 0.0), (0.0, 1.0), -1, 0.0, 9_990.0, 0.3, 64,
    ...                   -0.005, 1e-4, 101)
    >>> image = plan_image(polar, profiles.radar, profiles.n_samples)(profiles)
    >>> refocus = PhaseGradient(polar, profiles.radar, aperture_m=(-30.0, 30.0))
    >>> bend_m = 0.01 * np.cos(refocus.position_m / 5.0)
    >>> found = refocus(refocus.correct(image, bend_m))  # a track that bends by 1 cm
    >>> found.accepted, found.contrast_after > found.contrast_before
    (True, True)
    """

    def __init__(self, polar: PolarGrid, radar: RadarParameters | UnifiedPolarGrids,
                 aperture_m: tuple[float, float], *, margin: float = 0.005) -> None:
        self.polar, self.margin = polar, margin
        self._wavenumber = radar.wavenumber_rad_per_m
        self._ends = min(aperture_m), max(aperture_m)
        needed = 2 * math.pi / self._wavenumber / (1.1 * (self._ends[1] - self._ends[0]))
        if polar.alpha_spacing > needed:
            raise ValueError(f'alpha_spacing={polar.alpha_spacing:.3g} is too coarse for an '
                             f'aperture of {self._ends[1] - self._ends[0]:.1f} m; sample '
                             f'directions by {needed:.3g} or finer')
        n = polar.n_alpha
        self._angular = -2 * np.pi * fft.fftfreq(n, polar.alpha_spacing)
        # Angular wavenumbers in the order of ascending position along the track
        finer = -2 * np.pi * fft.fftfreq(_FINER * n, polar.alpha_spacing)
        order = np.argsort(finer)
        position = finer[order] / self._wavenumber
        inside = (position >= self._ends[0]) & (position <= self._ends[1])
        self._bins, self.position_m = order[inside], position[inside]

    def __call__(self, image: np.ndarray) -> PhaseGradientResult:
        """Estimate and correct.

        Parameters
        ----------
        image : (n_alpha, n_range) complex64
            With the carrier phase of backprojection, as `plan_image` makes it on this grid.

        Returns
        -------
        PhaseGradientResult

        Raises
        ------
        ValueError
            The image does not have the shape of the grid.
        """
        expected = (self.polar.n_alpha, self.polar.n_range)
        if np.shape(image) != expected:
            raise ValueError(f'image.shape={np.shape(image)} does not match the grid; expected '
                             f'(n_alpha, n_range)={expected}')
        before = contrast(image)
        half_path, step = self._estimate(image)
        corrected = self.correct(image, half_path)
        after = contrast(corrected)
        error_db = self._error_db(image)
        accepted = after > (1 + self.margin) * before and error_db <= _WORST_DB
        return PhaseGradientResult(corrected if accepted else image, accepted, before, after,
                                   self.position_m, half_path, step, error_db)

    def at_baseband(self, image: np.ndarray, between: Interpolator | None = None
                    ) -> PhaseGradientResult:
        """The same for an image at range baseband, as `SpectrumFusion` makes it.

        Parameters
        ----------
        image : (n_alpha, n_range) complex64
            Without the carrier phase of backprojection.
        between : Interpolator, optional
            Whose gain the image has along direction: `UnifiedPolarGrids.between`. It would make
            sidelobes of the aperture's ends, so it is taken out before.

        Returns
        -------
        PhaseGradientResult
            Its image is like the given one.
        """
        gain = np.ones(self.polar.n_alpha)
        if between is not None:
            gain = between.gain(fft.fftfreq(self.polar.n_alpha))
        result = self(self._baseband(_weighted(image, 1 / gain), +1).astype(np.complex64))
        if not result.accepted:
            return dataclasses.replace(result, image=image)
        return dataclasses.replace(result, image=_weighted(
            self._baseband(result.image, -1), gain).astype(np.complex64))

    def correct(self, image: np.ndarray, half_path_m: ArrayLike) -> np.ndarray:
        """Image whose half paths are changed, each position along the track by its own amount.

        Every range wavenumber is turned by its own phase ``(k_c + kappa) h(X)``, with X the
        position that its angular wavenumber belongs to.

        Parameters
        ----------
        image : (n_alpha, n_range) complex64
            Image with its carrier phase.
        half_path_m : (U,) array_like
            Change of the half path at `position_m`, metres.

        Returns
        -------
        (n_alpha, n_range) complex64
        """
        spectrum = fft.fft2(self._baseband(image, -1))
        k = self._wavenumber + 2 * np.pi * fft.fftfreq(self.polar.n_range,
                                                       self.polar.range_spacing_m)
        position = self._angular[:, None] / k
        change = np.interp(position, self.position_m, np.asarray(half_path_m))
        spectrum *= np.exp(1j * np.remainder(k * change, 2 * np.pi))
        return self._baseband(fft.ifft2(spectrum), +1).astype(np.complex64)

    def _baseband(self, image: np.ndarray, sign: int) -> np.ndarray:
        """Image times ``exp(sign j k_c (r - r_0))``."""
        r = self.polar.range_m - self.polar.range_start_m
        cycles = np.remainder(self._wavenumber / (2 * np.pi) * r, 1.0)
        return image * np.exp(sign * 2j * np.pi * cycles)

    def _widths(self) -> Iterator[int]:
        """Windows around the brightest pixels, lines: all first, then narrower."""
        cell = 2 * np.pi / self._wavenumber / (self._ends[1] - self._ends[0])
        least = math.ceil(_NARROWEST * cell / self.polar.alpha_spacing)
        n = self.polar.n_alpha
        for i in range(_ITERATIONS):
            yield min(n, max(least, round(n * _SHRINK ** max(0, i - _WIDE))))

    def _estimate(self, image: np.ndarray) -> tuple[np.ndarray, float]:
        """Change of the half path, metres, and rms phase of the last iteration, radians."""
        half_path, step = np.zeros(len(self.position_m)), math.inf
        work = self._baseband(image, -1)
        for width in self._widths():
            change = self._step(work, width)
            half_path = _without_line(half_path + change)
            work = self._baseband(self.correct(image, half_path), -1)
            step = float(np.sqrt(np.mean(change ** 2))) * self._wavenumber
        return half_path, step

    def _error_db(self, image: np.ndarray) -> float:
        """Error of an estimate, from those of two halves of the ranges alone."""
        half = np.arange(self.polar.n_range) * _PARTS // self.polar.n_range % 2
        one, other = (self._estimate(np.where(half == h, image, 0))[0] for h in (0, 1))
        rad = self._wavenumber * float(np.sqrt(np.mean((one - other) ** 2))) / 2
        return 20 * math.log10(rad + 1e-12)

    def _step(self, work: np.ndarray, width: int) -> np.ndarray:
        """Change of the half path by the phase gradient."""
        power = np.square(np.abs(work)).max(axis=0)
        bins = np.flatnonzero(power >= power.max() * 10 ** (_DARK_DB / 10))
        n = self.polar.n_alpha
        peaks = np.abs(work[:, bins]).argmax(axis=0)
        rows = (peaks + np.arange(n)[:, None]) % n  # brightest pixel first
        centred = np.take_along_axis(work[:, bins], rows, axis=0)
        after = width // 2 + 1
        before = min(width // 2, n - after)
        padded = np.zeros((_FINER * n, len(bins)), centred.dtype)
        padded[:after] = centred[:after]
        padded[_FINER * n - before:] = centred[n - before:]
        aperture = fft.fft(padded, axis=0)[self._bins]
        gradient = np.sum(np.conj(aperture[:-1]) * aperture[1:], axis=1)
        phase = np.concatenate([[0.0], np.cumsum(np.angle(gradient))])
        return -_without_line(phase) / self._wavenumber


def _weighted(image: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """Image whose frequencies along direction are multiplied by a gain."""
    return fft.ifft(fft.fft(image, axis=0) * gain[:, None], axis=0)


def _without_line(values: np.ndarray) -> np.ndarray:
    """Values less the straight line that fits them best: it only moves the image."""
    u = np.arange(len(values))
    return values - np.polyval(np.polyfit(u, values, 1), u)
