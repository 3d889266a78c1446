# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Domain FX: vectors are phase histories, ``exp(-j 2 pi f (tau - tau_SRP))`` for an echo at tau.

Every vector has its own reference delay tau_SRP, a block has one. Vectors are turned by
``exp(-j 2 pi f (tau_SRP - tau_ref))``, which is exact. A phase history is periodic in delay, with
the period ``1 / SCSS``. Where the reference moves so far that the windows of all vectors together
are longer than that, echoes would fold onto each other. Each vector's own period is then placed
in a longer window, zero outside, which is a phase history of smaller steps of frequency.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import fft

from ...signal.radar import RadarParameters, Waveform
from .container import CphdError
from .vectors import Vectors

_FINE = 64  # samples over which a ramp is computed before it is repeated
_LARGEST = {'CI2': 127, 'CI4': 32767}


def decode(raw: np.ndarray, amplitude: np.ndarray, sign: int) -> np.ndarray:
    """Samples of the phase convention ``exp(-j 2 pi f tau)`` from those of a file.

    Parameters
    ----------
    raw : (P, N) complex64 or (P, N, 2) integers
        As `Container.read_samples` gives them.
    amplitude : (P,) float64
        Factor of each vector.
    sign : int
        SGN of the file.

    Returns
    -------
    (P, N) complex64
    """
    if raw.ndim == 3:
        samples = raw.astype(np.float32).view(np.complex64)[..., 0]
    else:
        samples = raw.astype(np.complex64)
    if (amplitude != 1.0).any():
        samples = (samples * amplitude[:, None]).astype(np.complex64)
    return samples.conj() if sign > 0 else samples


def encode(samples: np.ndarray, amplitude: np.ndarray, sign: int, sample_type: str) -> np.ndarray:
    """Inverse of `decode`: (P, N) complex64, or (P, N, 2) integers, big endian."""
    if sign > 0:
        samples = samples.conj()
    if (amplitude != 1.0).any():
        samples = samples / amplitude[:, None]
    if sample_type == 'CF8':
        return samples.astype('>c8')
    parts = np.ascontiguousarray(samples, np.complex128).view(np.float64)
    largest = _LARGEST[sample_type]
    whole = np.clip(np.rint(parts), -largest - 1, largest)
    return whole.astype('>i1' if sample_type == 'CI2' else '>i2').reshape(*samples.shape, 2)


def full_scale(samples: np.ndarray, sample_type: str) -> np.ndarray:
    """(P,) float64 factors by which integers reach the largest sample of each vector."""
    if sample_type == 'CF8':
        return np.ones(len(samples))
    parts = np.ascontiguousarray(samples, np.complex64).view(np.float32)
    largest = np.abs(parts).max(axis=1).astype(np.float64)
    return np.where(largest > 0, largest, 1.0) / _LARGEST[sample_type]


def ramp(first_cycles: np.ndarray, step_cycles: np.ndarray, n: int) -> np.ndarray:
    """``exp(-j 2 pi (a + k b))`` for k = 0 ... n - 1.

    A product of coarse and fine turns: two complex exponentials for each 64 samples.

    Parameters
    ----------
    first_cycles, step_cycles : (P,) float64
        a and b, cycles.
    n : int
        Length of the ramps.

    Returns
    -------
    (P, n) complex128
    """
    fine = _turns(np.multiply.outer(step_cycles, np.arange(min(n, _FINE))))
    coarse = _turns(first_cycles[:, None]
                    + np.multiply.outer(step_cycles, np.arange(0, n, _FINE)))
    return (coarse[:, :, None] * fine[:, None]).reshape(len(fine), -1)[:, :n]


def _turns(cycles: np.ndarray) -> np.ndarray:
    return np.exp(-2j * np.pi * (cycles % 1.0))


UNTURNED_CYCLES = 1e-7  # less is not worth a turn: -124 dB
_OFF_LATTICE = 1e-6  # of a step, by which frequencies may lie beside it: -110 dB
_BAND_MARGIN = 0.01  # of a step, for rounding of FX1 and FX2
_LONGEST = 64  # times the period of a vector


class PhaseHistories:
    """How vectors of domain FX become samples of blocks of stepped frequency.

    Parameters
    ----------
    vectors : Vectors
        All of them.
    n_samples : int
        Samples of a vector in the file.

    Attributes
    ----------
    radar : RadarParameters
        Radar parameters of the blocks.
    n_samples : int
        Samples of the blocks.
    compressed : bool
        False.
    warnings : list of str
        What of the file is not in the blocks.

    Raises
    ------
    CphdError
        Frequencies are not on one lattice, or reference delays are too different.
    """

    compressed = False

    def __init__(self, vectors: Vectors, n_samples: int):
        self.warnings: list[str] = []
        self._n_file = n_samples
        self._step = float(vectors.step.flat[0])
        self._delay_s = vectors.reference_delay_s
        self._place(vectors)
        self._choose_window(vectors)
        self.radar = RadarParameters(
            carrier_hz=self._carrier_hz, bandwidth_hz=self._n_band * self._step,
            sample_rate_hz=self._n_band * self._step, first_sample_delay_s=self._reference_s,
            waveform=Waveform.STEPPED_FREQUENCY)
        turn = self._delay_s - self._reference_s
        self._turned = bool(np.abs(turn * (self._carrier_hz + self.radar.bandwidth_hz)).max()
                            > UNTURNED_CYCLES)

    def _place(self, vectors: Vectors) -> None:
        """Where the samples of each vector stand on the lattice of the blocks."""
        spread = np.ptp(vectors.step) * self._n_file / self._step
        lowest = vectors.first.min()
        if not lowest > 0:  # NaN, too
            raise CphdError(f'SC0 is {lowest:g} Hz; expected positive frequencies in domain FX')
        offset = (vectors.first - lowest) / self._step
        beside = np.abs(offset - np.rint(offset)).max()
        if not (spread <= _OFF_LATTICE and beside <= _OFF_LATTICE):  # NaN, too
            raise CphdError(
                f'frequencies differ from vector to vector by parts of a step (SC0 by up to '
                f'{beside:.2g} steps, SCSS by {np.ptp(vectors.step):.3g} Hz of '
                f'{self._step:.6g} Hz); expected steps on one lattice, resample the vectors first')
        if offset.max() > _LONGEST * self._n_file:
            raise CphdError(f'SC0 differs by {np.ptp(vectors.first):.4g} Hz between vectors of '
                            f'{self._n_file * self._step:.4g} Hz, number '
                            f'{vectors.farthest(vectors.first)} departs most; image such bands '
                            'apart')
        offset = np.rint(offset).astype(np.int64)
        low, high = ((vectors.fx_hz - lowest) / self._step
                     + (-_BAND_MARGIN, _BAND_MARGIN)).transpose(2, 0, 1)
        low = np.maximum(np.ceil(low), offset)
        high = np.minimum(np.floor(high), offset + self._n_file - 1)
        if (high < low).any():
            raise CphdError('FX1 to FX2 holds none of the frequencies of some vectors')
        first, last = int(low.min()), int(high.max())
        self._n_band = last - first + 1
        if self._n_band < 2:
            raise CphdError('FX1 to FX2 holds a single frequency')
        self._offset = offset - first
        self._low, self._high = (np.stack([low, high]) - first).astype(np.int64)
        self._partial = bool((self._low > 0).any() or (self._high < self._n_band - 1).any())
        self._lowest_hz = lowest + first * self._step
        self._carrier_hz = self._lowest_hz + (self._n_band - 1) / 2 * self._step
        outside = self._n_file - self._n_band
        if outside > 0:
            self.warnings.append(f'{outside} of {self._n_file} frequencies lie outside of FX1 to '
                                 'FX2 in every vector and are left out')

    def _choose_window(self, vectors: Vectors) -> None:
        """Reference delay of the blocks, and how long their window has to be."""
        limits = self._delay_s[..., None] + vectors.toa_s
        earliest, latest = limits[..., 0].min(), limits[..., 1].max()
        self._reference_s = (earliest + latest) / 2
        self._middle_s = limits.mean(axis=-1)
        seen_by_all = limits[..., 1].min() - limits[..., 0].max()
        period_s = 1 / self._step
        if seen_by_all <= 0:
            self.warnings.append(
                'the delay windows of some vectors do not overlap: no point is in the image '
                f'with all pulses (the reference delay moves by {np.ptp(self._delay_s):.3g} s, '
                f'the windows are {np.median(np.ptp(vectors.toa_s, axis=-1)):.3g} s)')
        self.n_samples = self._n_band
        self._within = latest - earliest <= period_s * (1 + 1e-9)
        if self._within:
            return
        longer = (latest - earliest) / period_s
        if longer > _LONGEST:
            raise CphdError(f'delays of the vectors differ by {longer:.3g} times their '
                            f'unambiguous window of {period_s:.3g} s, number '
                            f'{vectors.farthest(self._middle_s)} departs most; expected at most '
                            f'{_LONGEST} times: correct that vector, or read fewer at once')
        self.n_samples = fft.next_fast_len(math.ceil(longer * self._n_band) + 1)
        self.warnings.append(
            f"the reference delay moves by {np.ptp(self._delay_s):.3g} s, more than a vector's "
            f'window leaves room for: blocks have {self.n_samples} frequencies instead of '
            f'{self._n_band}')

    def convert(self, samples: np.ndarray, rows: slice, channel: int) -> np.ndarray:
        """Samples of a block from those of some vectors.

        Parameters
        ----------
        samples : (P, N) complex64
            Samples of the file, with the sign of the package.
        rows : slice
            Which of the vectors they are.
        channel : int
            Of which channel.

        Returns
        -------
        (P, n_samples) complex64
        """
        band = self._placed(samples, rows, channel)
        delay = self._delay_s[rows, channel]
        if not self._within:
            return self._extended(band, delay, self._middle_s[rows, channel])
        return self._turn(band, delay - self._reference_s)

    def _placed(self, samples: np.ndarray, rows: slice, channel: int) -> np.ndarray:
        """(P, n_band) samples on the lattice of the blocks, zero where there is no signal."""
        offset = self._offset[rows, channel]
        if self._n_band == self._n_file and not offset.any():
            band = samples
        else:
            band = np.zeros((len(samples), self._n_band), np.complex64)
            for shift in np.unique(offset):
                first, last = max(shift, 0), min(shift + self._n_file, self._n_band)
                own = offset == shift
                band[own, first:last] = samples[own, first - shift:last - shift]
        if self._partial:
            index = np.arange(self._n_band)
            inside = ((index >= self._low[rows, channel][:, None])
                      & (index <= self._high[rows, channel][:, None]))
            band = np.where(inside, band, np.complex64(0))
        return band

    def _turn(self, band: np.ndarray, delay_s: np.ndarray) -> np.ndarray:
        if not self._turned:
            return band
        return (band * ramp(delay_s * self._lowest_hz, delay_s * self._step,
                            self._n_band)).astype(np.complex64)

    def _extended(self, band: np.ndarray, delay_s: np.ndarray,
                  middle_s: np.ndarray) -> np.ndarray:
        """Phase histories over the longer window, in which each vector has its own period."""
        n, n_out = self._n_band, self.n_samples
        bin_s = 1 / (n * self._step)
        first_bin = np.rint((middle_s - self._reference_s) / bin_s).astype(np.int64) - n // 2
        start_s = self._reference_s + first_bin * bin_s
        # Delays i * bin_s from there: sum_n x_n exp(+j 2 pi f_n (start + i bin - tau_SRP)) / N.
        turned = band * ramp((delay_s - start_s) * self._lowest_hz,
                             (delay_s - start_s) * self._step, n)
        bins = np.arange(n)
        profile = fft.ifft(turned, axis=-1) * np.exp(2j * np.pi * (self._lowest_hz * bin_s * bins
                                                                   % 1.0))
        step = self._step * n / n_out
        lowest_hz = self._carrier_hz - (n_out - 1) / 2 * step
        window = np.zeros((len(band), n_out), np.complex128)
        # A window starts n_out // 2 bins before the reference delay.
        place = first_bin[:, None] + bins + n_out // 2
        turn = np.exp(-2j * np.pi * (lowest_hz * bin_s * (place - n_out // 2) % 1.0))
        inside = (place >= 0) & (place < n_out)
        np.put_along_axis(window, np.where(inside, place, 0), np.where(inside, profile * turn, 0),
                          axis=1)
        start_turn = np.exp(2j * np.pi * (np.arange(n_out) * (n_out // 2) / n_out % 1.0))
        return (fft.fft(window, axis=-1) * start_turn).astype(np.complex64)
