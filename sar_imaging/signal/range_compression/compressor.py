"""Range compression: turn raw pulses into range profiles that follow the signal model.

Output, whatever the waveform: ``s(tau) = sum_p a_p p(tau - tau_p) exp(-j 2 pi f_c tau_p)``
(Rosenberg & Gray, section 2) with the peak of a scatterer of unit amplitude equal to one, at the
sample spacing that the imager asks for. The work is planned once; a call is two FFTs, of a phase
history one.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ...device_arrays import beside, contiguous
from ..calibration import ChannelCalibration
from ..pulses import PulseBlock
from ..pulses.block import check_samples
from ..radar import RadarParameters, Waveform
from .band_filter import BandFilter
from .phase_history import GUARD_SAMPLES, PhaseHistoryPlan

RANGE_FILTERS = ('equalised', 'matched')
_PHASE_HISTORIES = (Waveform.STEPPED_FREQUENCY, Waveform.FMCW, Waveform.FMCW_REAL)


class RangeCompressor:
    """Turn raw pulses of one radar into range profiles; planned once.

    What is kept of the delay axis:

    - LFM: the profile starts at the delay of the first raw sample and ends where a pulse's last
      sample is the last raw one. Scatterers outside did not return a whole pulse.
    - stepped frequency: the whole unambiguous interval ``N / B``, half of it on each side of the
      reference delay `first_sample_delay_s`, and 16 samples more at each end (the profile is
      periodic; interpolators need neighbours).
    - FMCW: the same, but not before zero delay, where the interval then starts. A real converter
      tells half of the interval, beyond the reference delay.
    - passband samples and already compressed profiles: what came, resampled as one period of a
      periodic signal.

    Parameters
    ----------
    radar : RadarParameters
        Of the blocks to come.
    n_samples : int
        Fast-time samples N of the blocks to come.
    window : str
        Spectral weighting over the band, see `sar_imaging.signal.windows`.
    oversampling : float
        Output samples per ``1 / bandwidth``, at least 1. The output rate is the next one above
        ``oversampling * bandwidth_hz`` whose FFT is fast; `output_radar` tells it exactly.
        Profiles that come faster keep their rate.
    range_filter : {'equalised', 'matched'}
        For LFM. 'equalised' divides by the pulse's spectrum inside the band ``|f| <= B/2``, so
        that the response is the window's alone; 'matched' multiplies by its conjugate, which
        loses the least signal to noise but adds the Fresnel ripple of the pulse's spectrum to
        the window. `snr_loss_db` states the price.
    compressed : bool
        True when the blocks to come are range profiles already.
    range_window_m : (2,) floats, optional
        Nearest and farthest half-path distance to keep, metres, the latter possibly infinite;
        16 samples more at each end where there are any. By default everything above.
    calibration : ChannelCalibration, optional
        Errors of the channels' amplitude, phase and delay to remove.

    Raises
    ------
    ValueError
        A parameter is out of range, the waveform's parameters contradict each other, fewer
        raw samples come than one pulse is long, or the range window holds no sample.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import RangeCompressor
    >>> from sar_imaging.simulation import SCENARIOS
    >>> raw = next(SCENARIOS['psf_raw']().blocks())  # chirps of 1 microsecond
    >>> compress = RangeCompressor.for_block(raw, window='hamming')
    >>> profiles = compress(raw)
    >>> raw.samples.shape, profiles.samples.shape
    ((25, 5, 526), (25, 5, 193))
    >>> peak = np.abs(profiles.samples[0, 0]).argmax()
    >>> radar = profiles.radar
    >>> print(f'echo at {radar.range_start_m + peak * radar.sample_spacing_m:.1f} m, '
    ...       f'{compress.snr_loss_db:.1f} dB of signal to noise lost')
    echo at 10000.0 m, 1.4 dB of signal to noise lost
    """

    def __init__(self, radar: RadarParameters, n_samples: int, *, window: str = 'none',
                 oversampling: float = 2.0, range_filter: str = 'equalised',
                 compressed: bool = False, range_window_m: tuple[float, float] | None = None,
                 calibration: ChannelCalibration | None = None):
        if not (math.isfinite(oversampling) and oversampling >= 1.0):
            raise ValueError(f'oversampling={oversampling}; at least 1.0 output sample per '
                             '1 / bandwidth is needed')
        if range_filter not in RANGE_FILTERS:
            raise ValueError(f'range_filter={range_filter!r}; use one of '
                             f'{", ".join(RANGE_FILTERS)}')
        if n_samples < 2:
            raise ValueError(f'n_samples={n_samples}; a pulse needs at least two samples')
        if range_window_m is not None and not range_window_m[0] < range_window_m[1]:
            raise ValueError(f'range_window_m={range_window_m}; expected the nearest and a '
                             'larger farthest distance')
        self.radar = radar
        self.n_samples = n_samples
        self.compressed = compressed
        if compressed:
            plan = BandFilter.for_profiles(radar, n_samples, window, oversampling)
        elif radar.waveform in _PHASE_HISTORIES:
            plan = PhaseHistoryPlan(radar, n_samples, window, oversampling, range_window_m)
        elif radar.waveform == Waveform.PASSBAND:
            plan = BandFilter.for_passband(radar, n_samples, window, oversampling)
        else:
            plan = BandFilter.for_lfm(radar, n_samples, window, oversampling, range_filter)
        self._plan = plan
        self._output_radar = plan.output_radar
        self._kept = slice(0, plan.n_output)
        if range_window_m is not None and isinstance(plan, BandFilter):
            self._cut(range_window_m)
        self._pass_through = (isinstance(plan, BandFilter) and plan.changes_nothing
                              and calibration is None)
        self._set_calibration(calibration)

    def _set_calibration(self, calibration: ChannelCalibration | None) -> None:
        plan = self._plan
        self._calibration, self._gain, self._turn = calibration, plan.gain, None
        if calibration is None:
            return
        self._gain = (plan.gain * calibration.correction(plan.baseband_hz)).astype(np.complex64)
        if isinstance(plan, PhaseHistoryPlan) and calibration.delay_s.any():
            self._turn = plan.late_video_phase(calibration.delay_s)

    def _cut(self, range_window_m: tuple[float, float]) -> None:
        """Keep the range window of the filter's profiles."""
        radar, n = self._plan.output_radar, self._plan.n_output
        first, last = ((r - radar.range_start_m) / radar.sample_spacing_m
                       for r in range_window_m)
        start = max(0, math.floor(first) - GUARD_SAMPLES)
        stop = min(n, math.ceil(min(last, n)) + 1 + GUARD_SAMPLES)
        if first > n - 1 or last < 0:
            raise ValueError(f'range_window_m={range_window_m} lies outside the profiles, '
                             f'{radar.range_start_m:.2f} to '
                             f'{radar.range_start_m + (n - 1) * radar.sample_spacing_m:.2f} m')
        self._kept = slice(start, stop)
        self._output_radar = dataclasses.replace(
            radar, first_sample_delay_s=2 / radar.propagation_speed_m_per_s
            * (radar.range_start_m + start * radar.sample_spacing_m))

    @classmethod
    def for_block(cls, block: PulseBlock, **options) -> RangeCompressor:
        """Plan for blocks like `block`, raw or compressed; options as of the constructor."""
        return cls(block.radar, block.n_samples, compressed=block.compressed, **options)

    @property
    def output_radar(self) -> RadarParameters:
        """Parameters of the profiles: output sample rate and delay of the first sample."""
        return self._output_radar

    @property
    def n_output(self) -> int:
        """Samples of each output profile."""
        return self._kept.stop - self._kept.start

    @property
    def snr_loss_db(self) -> float:
        """Loss of peak signal to noise ratio against the matched filter without window, dB."""
        return self._plan.snr_loss_db

    def __call__(self, block: PulseBlock) -> PulseBlock:
        """Compress a block.

        Parameters
        ----------
        block : PulseBlock
            Samples ``(P, C, n_samples)`` of the planned radar.

        Returns
        -------
        PulseBlock
            Compressed, samples ``(P, C, n_output)`` complex64, positions and times unchanged; on
            the device where those of the block lie there. Profiles that need neither window nor
            another rate come back as they are, uncopied.

        Raises
        ------
        ValueError
            The block is of another radar, length or kind than planned for, has another number
            of channels than the calibration, or holds samples that are not finite.
        """
        self.check(block)
        check_samples(block.samples, block.counter)
        if self._pass_through and self.n_output == block.n_samples:
            return block
        return self.compressed_block(block, self.profiles(block.samples))

    def check(self, block: PulseBlock) -> None:
        """Check that a block is what was planned for, but for its samples.

        Raises
        ------
        ValueError
            As a call.
        """
        got = (block.radar, block.n_samples, block.compressed)
        if got != (self.radar, self.n_samples, self.compressed):
            raise ValueError(
                f'block with {block.n_samples} samples, compressed={block.compressed}, '
                f'{block.radar} does not match the plan for {self.n_samples} samples, '
                f'compressed={self.compressed}, {self.radar}; plan anew with '
                'RangeCompressor.for_block')
        if self._calibration is not None:
            self._calibration.check_channels(block.n_channels)

    def profiles(self, samples):
        """Range profiles of samples, unchecked.

        Parameters
        ----------
        samples : (P, C, n_samples) complex64
            Of the planned radar.

        Returns
        -------
        (P, C, n_output) complex64
            On the device where the samples lie there.
        """
        if not self._pass_through:
            samples = self._plan(samples, self._gain)
            if self._turn is not None:
                samples *= beside(self._turn, samples)
        return contiguous(samples[..., self._kept])

    def compressed_block(self, block: PulseBlock, profiles) -> PulseBlock:
        """A block with its range profiles in place of its samples."""
        return dataclasses.replace(block, radar=self._output_radar, compressed=True,
                                   samples=profiles)
