"""Domain TOA: vectors are range profiles over the delay from that of the reference point.

The peak of an echo at tau has the phase ``-2 pi fx_C (tau - tau_SRP)``, in profiles of a block
``-2 pi f_c tau``: a vector is turned as a whole. Where profiles do not begin on one lattice of
delays they are shifted by the part of a sample, by a Fourier transform.
"""

from __future__ import annotations

import numpy as np
from scipy import fft

from ...signal.radar import RadarParameters
from .errors import CphdError
from .vectors import Vectors

_OFF_LATTICE = 1e-7  # of a sample, that needs no shift: -124 dB
_SAME_STEP = 1e-6  # of a sample, by which steps may add up over a profile
_SAME_CENTRE_HZ = 1e-2
_GUARD_SAMPLES = 64  # zeros behind a profile that is shifted
_LONGEST = 64  # times the length of a vector


class Profiles:
    """How vectors of domain TOA become compressed blocks.

    Parameters, attributes and errors as of `PhaseHistories`.
    """

    compressed = True

    def __init__(self, vectors: Vectors, n_samples: int):
        self.warnings: list[str] = []
        self._n_file = n_samples
        step = float(vectors.step.flat[0])
        centre_hz = vectors.fx_hz.mean(axis=-1)
        self._carrier_hz = float(centre_hz.flat[0])
        self._check(vectors, step, centre_hz)
        self._delay_s = vectors.reference_delay_s
        start = vectors.first + self._delay_s
        first_s = start.min()
        offset = (start - first_s) / step
        beside = np.abs(offset - np.rint(offset)).max()
        self.invertible = bool(beside <= _OFF_LATTICE)
        whole = np.rint(offset) if self.invertible else np.floor(offset)
        self._offset, self._part = whole.astype(np.int64), offset - whole
        self.n_samples = int(self._offset.max()) + n_samples + (not self.invertible)
        if self.n_samples > _LONGEST * n_samples:
            raise CphdError(f'profiles of {n_samples} samples begin at delays that differ by '
                            f'{self._offset.max()} samples; expected at most {_LONGEST} times '
                            'their length, read fewer vectors at once')
        if self._offset.max() >= n_samples:
            self.warnings.append('the profiles of some vectors do not overlap: no point is in the '
                                 'image with all pulses')
        if not self.invertible:
            self.warnings.append('profiles begin at parts of a sample and are shifted, which is '
                                 'exact but near their ends')
        low, high = vectors.fx_hz[..., 0].min(), vectors.fx_hz[..., 1].max()
        self.radar = RadarParameters(
            carrier_hz=self._carrier_hz, bandwidth_hz=float(high - low), sample_rate_hz=1 / step,
            first_sample_delay_s=float(first_s))

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
        offset, n = self._offset[rows, channel], self._n_file
        if not self.invertible:
            turned, n = self._shifted(turned, self._part[rows, channel]), n + 1
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

    def _shifted(self, profiles: np.ndarray, part: np.ndarray) -> np.ndarray:
        """(P, N + 1) profiles that begin `part` of a sample earlier."""
        n = fft.next_fast_len(self._n_file + 1 + _GUARD_SAMPLES)
        spectrum = fft.fft(profiles, n, axis=-1)
        spectrum *= np.exp(-2j * np.pi * np.multiply.outer(part, fft.fftfreq(n)))
        return fft.ifft(spectrum, axis=-1)[:, :self._n_file + 1]


