"""Domain TOA: vectors are range profiles over the delay from that of the reference point.

The peak of an echo at tau has the phase ``-2 pi fx_C (tau - tau_SRP)``, in profiles of a block
``-2 pi f_c tau``: a vector is turned as a whole. By one Fourier transform profiles that do not
begin on one lattice of delays are shifted by a part of a sample, those of fewer samples than
imaging needs are resampled, and integers lose the noise that rounding adds beyond the band.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import fft

from ...planning.aliasing_error import cosine_fall
from ...signal.radar import RadarParameters
from .container import CphdError
from .vectors import Vectors

_OFF_LATTICE = 1e-7  # of a sample, that needs no shift: -124 dB
_SAME_STEP = 1e-6  # of a sample, by which steps may add up over a profile
_SAME_CENTRE_HZ = 1e-2
_LONGEST = 64  # times the length of a vector
# Samples per 1 / bandwidth: of files (the standard: 1.1 or more), for imaging, and those of the
# band that integers keep.
_LEAST_RATE, _RATE, _INTEGER_RATE = 1.09, 1.25, 1.1
# Of a filter, in 1 / bandwidth, times the share of the band over which it falls: what ends there
# changes by -94 dB, by less than -60 dB at a fifth of it (`RangeGate.end_error`).
_REACH, _TOLD_REACH = 24.0, 0.2


class Profiles:
    """How vectors of domain TOA become compressed blocks.

    Parameters, attributes and errors as of `PhaseHistories`; `integers` are rounded samples.
    """

    compressed = True

    def __init__(self, vectors: Vectors, n_samples: int, integers: bool = False):
        self.warnings: list[str] = []
        self._n_file = n_samples
        step = float(vectors.step.flat[0])
        centre_hz = vectors.fx_hz.mean(axis=-1)
        self._carrier_hz = float(centre_hz.flat[0])
        self._check(vectors, step, centre_hz)
        bandwidth_hz = float(np.ptp(vectors.fx_hz))
        rate = 1 / (step * bandwidth_hz)
        if rate < _LEAST_RATE:
            raise CphdError(f'SCSS of {step:.6g} s gives {rate:.3f} samples per 1 / bandwidth of '
                            f'FX1 to FX2, {bandwidth_hz:.6g} Hz; the standard asks for 1.1')
        self._delay_s = vectors.reference_delay_s
        start = vectors.first + self._delay_s
        first_s = start.min()
        offset = (start - first_s) / step
        moved = np.abs(offset - np.rint(offset)).max() > _OFF_LATTICE or rate < _RATE
        self._gain = None
        if moved or integers:
            ratio = self._design(rate, min(rate, _INTEGER_RATE) if integers else rate)
            step, offset = step / ratio, offset * ratio
            n_samples = math.ceil((n_samples - 1) * ratio) + 1 + bool(moved)
        whole = np.floor(offset) if moved else np.rint(offset)
        if whole.max() > _LONGEST * n_samples:
            raise CphdError(f'profiles of {n_samples} samples begin at delays that differ by '
                            f'{whole.max():.4g} samples, number {vectors.farthest(start)} departs '
                            f'most; expected at most {_LONGEST} times their length: correct that '
                            'vector, or read fewer at once')
        self._offset, self._part, self._n_own = whole.astype(np.int64), offset - whole, n_samples
        self.n_samples = int(self._offset.max()) + n_samples
        if self._offset.max() >= n_samples:
            self.warnings.append('the profiles of some vectors do not overlap: no point is in the '
                                 'image with all pulses')
        self.radar = RadarParameters(
            carrier_hz=self._carrier_hz, bandwidth_hz=bandwidth_hz,
            sample_rate_hz=max(1 / step, _RATE * bandwidth_hz),  # which rounding may miss
            first_sample_delay_s=float(first_s))

    def _design(self, rate: float, last: float) -> float:
        """Choose transforms and a filter that falls from the band to `last` bandwidths.

        The ends of profiles ring as far as the filter reaches: the more gently it falls, the
        less. Returns how many samples there will be for one.
        """
        reach = math.ceil(_REACH / (last - 1) * rate)
        n_in = self._n_in = fft.next_fast_len(self._n_file + 1 + reach)
        n_out = self._n_out = n_in if rate >= _RATE else fft.next_fast_len(
            math.ceil(n_in * _RATE / rate))
        bins = np.arange(n_in // 2 + 1)
        self._gain = cosine_fall((2 * rate * bins / n_in - 1) / (last - 1)) * (n_out / n_in)
        cause = ('hold integers' if last < rate else 'begin at parts of a sample' if n_in == n_out
                 else f'have {rate:.3g} samples per 1 / bandwidth, imaging needs {_RATE}')
        self.warnings.append(f'profiles {cause}, and are filtered, which changes about '
                             f'{_TOLD_REACH * reach:.0f} samples at either end')
        return n_out / n_in

    def _check(self, vectors: Vectors, step: float, centre_hz: np.ndarray) -> None:
        if np.ptp(vectors.step) * self._n_file / step > _SAME_STEP:
            raise CphdError(f'SCSS differs by {np.ptp(vectors.step):.3g} s between vectors; '
                            'expected one sample spacing, resample the vectors first')
        if np.ptp(centre_hz) > _SAME_CENTRE_HZ:
            raise CphdError(f'the middle of the band differs by {np.ptp(centre_hz):.4g} Hz '
                            'between vectors of domain TOA; expected one, image such bands apart')

    def convert(self, samples: np.ndarray, rows: slice, channel: int) -> np.ndarray:
        """Samples of a block from those of some vectors, as `PhaseHistories.convert`."""
        turned = samples * self._turns(rows, channel)[:, None]
        offset, n = self._offset[rows, channel], self._n_own
        if self._gain is not None:
            turned = self._filtered(turned, self._part[rows, channel])
        if n == self.n_samples and not offset.any():
            return turned.astype(np.complex64)
        out = np.zeros((len(samples), self.n_samples), np.complex64)
        for shift in np.unique(offset):
            own = offset == shift
            out[own, shift:shift + n] = turned[own]
        return out

    def _turns(self, rows, channel: int) -> np.ndarray:
        cycles = self._carrier_hz * self._delay_s[rows, channel]
        return np.exp(-2j * np.pi * (cycles % 1.0))

    def _filtered(self, profiles: np.ndarray, part: np.ndarray) -> np.ndarray:
        """Profiles (P, N) in the blocks' sampling, beginning `part` of a sample, (P,), earlier."""
        bins = np.arange(-(self._n_in // 2), (self._n_in + 1) // 2)
        spectrum = np.zeros((len(profiles), self._n_out), np.complex128)
        spectrum[:, bins] = (fft.fft(profiles, self._n_in, axis=-1)[:, bins]
                             * self._gain[np.abs(bins)]
                             * np.exp(-2j * np.pi / self._n_out * np.multiply.outer(part, bins)))
        return fft.ifft(spectrum, axis=-1)[:, :self._n_own]
