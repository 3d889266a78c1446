"""Phase histories as they came: the band of a periodic range profile."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ...signal.radar import RadarParameters, Waveform
from ...signal.windows import window as window_weights


class PhaseHistory:
    """What `Profiles` needs of a phase history; stands where a `RangeGate` does for profiles.

    The lattice of the profiles is one inverse transform away from the frequencies of a pulse;
    range compression first and the lattice from its profiles take three. The profile repeats with
    the unambiguous range.

    Parameters
    ----------
    radar, n_samples : RadarParameters, int
        Of the pulses, stepped frequency, and their frequencies K.
    weighting : str
        Spectral weighting over the band, see `sar_imaging.signal.windows`.

    Attributes
    ----------
    radar : RadarParameters
        Of the profiles: the carrier is the middle one of the frequencies (the upper one of the
        two where their number is even), so that it has a bin of its own.
    n_samples, zero : int
        Number of frequencies, and which of them is the carrier.
    range_start_m, phase_range_m : float
        Half path where the period around the reference delay starts, and at which the carrier
        phase of the profiles is zero, the reference; metres.
    period_m : float
        Unambiguous range, metres.

    Raises
    ------
    ValueError
        The waveform is another.
    """

    periodic = True

    def __init__(self, radar: RadarParameters, n_samples: int, weighting: str = 'none'):
        if radar.waveform != Waveform.STEPPED_FREQUENCY:
            raise ValueError(f'waveform {radar.waveform.name.lower()} cannot be imaged from raw '
                             'pulses; apply range compression (RangeCompressor) first')
        step_hz = radar.bandwidth_hz / n_samples
        self.n_samples, self.zero = int(n_samples), int(n_samples) // 2
        self.radar = dataclasses.replace(
            radar, sample_rate_hz=radar.bandwidth_hz,
            carrier_hz=radar.carrier_hz + (self.zero - (n_samples - 1) / 2) * step_hz)
        self.period_m = radar.propagation_speed_m_per_s / (2 * step_hz)
        self.phase_range_m = radar.range_start_m
        self.range_start_m = radar.range_start_m - self.period_m / 2
        weights = window_weights(weighting, n_samples)
        # The profile starts half a period before the reference: half a cycle from bin to bin.
        sign = 1 - 2 * ((np.arange(n_samples) - self.zero) % 2)
        self._gain = (sign * weights / weights.sum()).astype(np.float32)

    def mean_end_error_db(self, range_m, n_axes: int = 2,
                          oversampling: float = math.inf, lit=None) -> float:
        """-inf: what is periodic has no ends."""
        return -math.inf

    def gain(self, n_padded: int, oversampling: float = math.inf) -> np.ndarray:
        """(K,) float32 factor of each frequency; `n_padded` is K."""
        return self._gain
