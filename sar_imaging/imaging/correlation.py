# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Time-domain correlation (TDC): the exact image, and the reference of every other imager.

Rosenberg & Gray, equations 7 and 8, evaluated in float64 with the exact two-way path of every
channel. `correlate` takes spectra; nothing is interpolated. `correlate_profiles` takes sampled
range profiles, whose value at a delay is the series of Knab (1979) over the samples around it.
Both go through a backend, as all imagers do.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike
from tqdm import tqdm

from ..backends import AUTO, optional_entry
from ..backends.protocol import Backend
from ..geometry.illumination import AntennaPattern, Illumination
from ..signal.pulses import PulseBlock
from ..signal.radar import SPEED_OF_LIGHT
from ..signal.spectra import band_spectrum
from .image import Report
from .methods import Method

_POINTS_PER_CALL = 4096
_SAMPLES_AT_ONCE = 2 ** 21  # bounds the float64 copies of a block, some 100 MB
_ROUNDING_DB = -200.0  # of float64: the reference of errors has next to none
_SERIES_ERROR_DB = -130.0  # of Knab's series: far below the -100 dB that float32 images reach
_LEAST_SPARE = 0.05  # share of the sample rate without signal; less makes Knab's series endless


class Correlation(Method):
    """Time-domain correlation, float64: the reference; hours for large images."""

    NAME, ILLUMINATION, BACKENDS = 'correlation', True, True

    def plan(self, tx_m: np.ndarray, rx_m: np.ndarray) -> Report:
        """See `Method`."""
        return self.describe(predicted_error_db=_ROUNDING_DB)

    def form(self, block: PulseBlock) -> np.ndarray:
        """See `Method`."""
        points = self.grid.points()
        image, _ = correlate_profiles(block, points.reshape(-1, 3), backend=self.options.backend,
                                      illumination=self.options.illumination)
        return image.astype(np.complex64).reshape(points.shape[:-1])


def correlate(frequencies_hz: ArrayLike, spectra: ArrayLike, tx_m: ArrayLike, rx_m: ArrayLike,
              points: ArrayLike, *, propagation_speed_m_per_s: float = SPEED_OF_LIGHT,
              illumination: Illumination | None = None, backend: str | Backend = AUTO,
              progress: bool = False) -> np.ndarray | tuple[np.ndarray, ...]:
    """Time-domain correlation (TDC) of spectra with the exact reference of every point.

    ``f(x) = sum_m sum_n sum_f S_mn(f) exp(+j 2 pi f tau_mn(x))`` with the two-way delay
    ``tau_mn(x) = (|tx_mn - x| + |rx_mn - x|) / c``; with illumination each term is multiplied by
    the two-way amplitude w_mn(x).

    Parameters
    ----------
    frequencies_hz : (K,) array_like
        Absolute frequencies, equally spaced, hertz.
    spectra : (P, C, K) complex array_like
        Spectra referred to zero delay, as `sar_imaging.signal.spectra.band_spectrum` gives them.
    tx_m, rx_m : (P, C, 3) array_like
        Transmit and receive phase centres, metres.
    points : (..., 3) array_like
        Positions to image, in the frame of the phase centres, metres.
    propagation_speed_m_per_s : float
        Speed of the waves, metres per second: c above.
    illumination : Illumination, optional
        Illumination of the P C echoes, channel by channel of each pulse.
    backend : str or Backend
        What computes it, see `sar_imaging.backends`.
    progress : bool
        Show a progress bar on standard error.

    Returns
    -------
    (...) complex128
        Image at the points.

    Raises
    ------
    ValueError
        Shapes disagree, the frequencies are not equally spaced, something is not finite, or the
        backend offers no correlation.

    Examples
    --------
    >>> from sar_imaging import concatenate
    >>> from sar_imaging.imaging.correlation import correlate
    >>> from sar_imaging.signal.spectra import band_spectrum
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(pulses_per_block=20))
    >>> frequencies_hz, spectra = band_spectrum(block)
    >>> value = correlate(frequencies_hz, spectra, block.tx_m, block.rx_m, [[10_000.0, 0.0, 0.0]])
    >>> print(f'{abs(value[0]):.2f}: every pulse and channel in phase')
    100.00: every pulse and channel in phase
    """
    frequencies = np.asarray(frequencies_hz, np.float64)
    spectra = np.ascontiguousarray(spectra, np.complex128)
    tx, rx = (np.ascontiguousarray(a, np.float64) for a in (tx_m, rx_m))
    points = np.asarray(points, np.float64)
    _check(frequencies, spectra, tx, rx, points)
    step = (frequencies[-1] - frequencies[0]) / max(len(frequencies) - 1, 1)
    cycles_per_m = (frequencies[0] / propagation_speed_m_per_s, step / propagation_speed_m_per_s)
    flat = np.ascontiguousarray(points.reshape(-1, 3))
    out = np.empty(len(flat), np.complex128)
    sums = optional_entry(backend, 'correlate_spectra')
    lit = () if illumination is None else (illumination,)
    with tqdm(total=len(flat), desc='correlation', unit='pixel', disable=not progress) as bar:
        for start in range(0, len(flat), _POINTS_PER_CALL):
            part = slice(start, min(start + _POINTS_PER_CALL, len(flat)))
            out[part] = sums(cycles_per_m, spectra, tx, rx, flat[part], *lit)
            bar.update(part.stop - part.start)
    return out.reshape(points.shape[:-1])


def correlate_profiles(block: PulseBlock, points: ArrayLike, *,
                       illumination: AntennaPattern | None = None, backend: str | Backend = AUTO
                       ) -> tuple[np.ndarray, np.ndarray]:
    """Time-domain correlation (TDC) of range profiles with the exact reference of every point.

    ``f(x) = sum_m sum_n s_mn(tau_mn(x)) exp(+j 2 pi f_c tau_mn(x))``. The profile s is read at the
    place u of the delay, in samples, by Knab's approximate prolate series (Knab
    1979), ``s(u) = sum_k s[k] sinc(u - k) cosh(a sqrt(1 - ((u - k) / h)^2)) / cosh(a)`` with
    ``a = pi h (1 - B / f_s)``; h is so long that its error ``1 / sinh(a)`` is -130 dB. A value
    depends on the h samples on either side alone. So it does not matter whether a profile is
    periodic or where it was cut, unlike for a Fourier transform of the whole profile.

    Parameters
    ----------
    block : PulseBlock
        Range profiles with phase centres, sampled faster than the bandwidth.
    points : (K, 3) array_like
        Positions to image, in the frame of the phase centres, metres.
    illumination : AntennaPattern, optional
        Two-way amplitude w_mn(x) by which each term is multiplied; the block tells its pointing.
    backend : str or Backend
        What computes it, see `sar_imaging.backends`.

    Returns
    -------
    image : (K,) complex128
        Image at the points. A delay outside a profile contributes nothing.
    covered : (K,) bool
        False where a delay of a lit point comes within h samples of the end of a profile. The
        value there depends on samples that nobody has; they were taken as zero.

    Raises
    ------
    ValueError
        The pulses are raw, have no phase centres or are sampled too slowly, there is an
        illumination and nobody tells their pointing, a point or a sample is not finite, or the
        backend offers no correlation.

    References
    ----------
    J. J. Knab, Interpolation of band-limited functions using the approximate prolate series, IEEE
    Transactions on Information Theory 25, 1979.

    Examples
    --------
    >>> from sar_imaging.imaging.correlation import correlate_profiles
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(pulses_per_block=20))
    >>> image, covered = correlate_profiles(block, [[10_000.0, 0.0, 0.0], [10_023.0, 0.0, 0.0]])
    >>> print(f'{abs(image[0]):.2f}', covered.tolist())  # the second is at the profiles' end
    100.00 [True, False]
    """
    radar, points = block.radar, np.ascontiguousarray(points, np.float64)
    if not block.compressed or block.tx_m is None or block.rx_m is None:
        raise ValueError('correlate_profiles needs range profiles with phase centres; compress '
                         'raw pulses first and give every pulse its position')
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f'points.shape={points.shape}; expected (K, 3)')
    for name, array in (('points', points), ('samples', block.samples)):
        if not np.isfinite(array).all():
            raise ValueError(f'{name} contains NaN or infinity')
    spare = 1.0 - radar.bandwidth_hz / radar.sample_rate_hz
    if spare < _LEAST_SPARE:
        raise ValueError(f'profiles sampled at {radar.sample_rate_hz:g} Hz for a bandwidth of '
                         f'{radar.bandwidth_hz:g} Hz; sample them at '
                         f'{1 / (1 - _LEAST_SPARE):.2f} times the bandwidth or more')
    sharpness = math.asinh(10 ** (-_SERIES_ERROR_DB / 20))
    lit: tuple[Illumination, ...] = ()
    if illumination is not None:
        lit = Illumination.of_pulses(illumination, block.pointing, block.tx_m, block.rx_m),
    pulses = (np.ascontiguousarray(a) for a in (block.samples, block.tx_m, block.rx_m))
    return optional_entry(backend, 'correlate_profiles')(
        radar, *pulses, points, math.ceil(sharpness / np.pi / spare), sharpness, *lit)


def correlate_pulses(blocks: PulseBlock | Iterable[PulseBlock], points: np.ndarray, *,
                     illumination: AntennaPattern | None = None, progress: bool = False
                     ) -> tuple[np.ndarray, np.ndarray]:
    """Time-domain correlation (TDC) of range profiles or phase histories, summed over all blocks.

    Profiles go through `correlate_profiles`, phase histories through `correlate`. Takes little
    memory besides the blocks.

    Parameters
    ----------
    blocks : PulseBlock or iterable of PulseBlock
        Pulses with phase centres.
    points : (K, 3) float64
        Positions to image, in the frame of the phase centres, metres.
    illumination : AntennaPattern, optional
        Two-way amplitude by which each term is multiplied; the blocks tell its pointing.
    progress : bool
        Show a progress bar on standard error.

    Returns
    -------
    image : (K,) complex128
        Image at the points.
    covered : (K,) bool
        As of `correlate_profiles`; phase histories cover all points.

    Raises
    ------
    ValueError
        A block has no phase centres or cannot be correlated.
    """
    known = [blocks] if isinstance(blocks, PulseBlock) else blocks
    total = blocks.n_pulses if isinstance(blocks, PulseBlock) else None
    out, covered = np.zeros(len(points), np.complex128), np.ones(len(points), bool)
    with tqdm(total=total, desc='verification', unit='pulse', disable=not progress) as bar:
        for block in known:
            if block.tx_m is None or block.rx_m is None:
                raise ValueError('the block has no phase centres; correlation needs the transmit '
                                 'and receive position of every pulse and channel')
            step = max(1, _SAMPLES_AT_ONCE // max(1, block.n_channels * block.n_samples))
            for start in range(0, block.n_pulses, step):
                rows = slice(start, start + step)
                part = block.select(rows)
                if part.compressed:
                    image, inside = correlate_profiles(part, points, illumination=illumination)
                    out += image
                    covered &= inside
                else:
                    out += correlate(
                        *band_spectrum(part), block.tx_m[rows], block.rx_m[rows], points,
                        propagation_speed_m_per_s=part.radar.propagation_speed_m_per_s,
                        illumination=None if illumination is None else Illumination.of_pulses(
                            illumination, part.pointing, block.tx_m[rows], block.rx_m[rows]))
                bar.update(part.n_pulses)
    return out, covered


def _check(frequencies: np.ndarray, spectra: np.ndarray, tx: np.ndarray, rx: np.ndarray,
           points: np.ndarray) -> None:
    if spectra.ndim != 3 or spectra.shape[-1] != len(frequencies):
        raise ValueError(f'spectra.shape={spectra.shape} does not match '
                         f'{len(frequencies)} frequencies; expected (pulses, channels, K)')
    expected = (*spectra.shape[:2], 3)
    for name, array in (('tx_m', tx), ('rx_m', rx)):
        if array.shape != expected:
            raise ValueError(f'{name}.shape={array.shape}; expected {expected}, one position '
                             'per pulse and channel')
    if points.shape[-1:] != (3,):
        raise ValueError(f'points.shape={points.shape}; expected (..., 3)')
    for name, array in (('frequencies_hz', frequencies), ('spectra', spectra), ('tx_m', tx),
                        ('rx_m', rx), ('points', points)):
        if not np.isfinite(array).all():
            raise ValueError(f'{name} contains NaN or infinity')
    steps = np.diff(frequencies)
    if steps.size and np.ptp(steps) > 1e-6 * np.abs(steps).max() + 1e-15 * frequencies.max():
        raise ValueError('frequencies_hz are not equally spaced: steps from '
                         f'{steps.min()} to {steps.max()} Hz')
