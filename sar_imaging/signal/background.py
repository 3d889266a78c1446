# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Remove static echoes and antenna coupling: the mean over slow time is subtracted.

The direct path from transmitter to receiver, reflections inside the radar and from its own
platform do not change from pulse to pulse, whereas the echoes of a scene that is passed by do.
`subtract_background` does the same for a whole recording at once.

A UWB radar samples the pulse at its carrier as real numbers (`Waveform.PASSBAND`);
`sar_imaging.signal.range_compression` turns them into the analytic signal at baseband. Its direct
path from transmitter to receiver and the reflections inside it exceed every echo, and they do not
change from pulse to pulse, whereas the scene of a moving platform does.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from .pulses import PulseBlock

FEWEST_PULSES = 8  # within a time constant; fewer would take the echoes for background


class BackgroundFilter:
    """Remove what does not move: the running average of each channel and sample.

    The average of pulses at the times t_n begins with their mean and then forgets with the time
    constant T: ``b_n = b_(n-1) + w_n (x_n - b_(n-1))`` with
    ``w_n = max(1 / n, 1 - exp(-(t_n - t_(n-1)) / T))``; the filter returns ``x_n - b_n``. Echoes
    of Doppler frequency f pass with the gain ``1 / sqrt(1 + 1 / (2 pi f T)^2)`` where f is far
    below the rate of the pulses: half of the power at ``f = 1 / (2 pi T)``. What does not move
    against the radar goes, a scatterer abeam of a straight track loses a notch of its Doppler
    band, and the first pulse, which is its own average, is zero.

    Parameters
    ----------
    time_constant_s : float
        T, seconds. Long against the time in which a scatterer passes the zero of its Doppler
        frequency, short against the time in which the background drifts.

    Raises
    ------
    ValueError
        The time constant is not positive and finite.

    Examples
    --------
    >>> import dataclasses
    >>> import numpy as np
    >>> from sar_imaging.signal.background import BackgroundFilter
    >>> from sar_imaging.simulation import SCENARIOS
    >>> remove = BackgroundFilter(time_constant_s=1.0)
    >>> for block in SCENARIOS['psf']().blocks(50):
    ...     coupled = dataclasses.replace(block, samples=block.samples + 100.0)
    ...     clean = remove(coupled)
    >>> print(f'{abs(coupled.samples).mean():.0f} before, {abs(clean.samples).mean():.1f} after')
    100 before, 0.0 after
    """

    def __init__(self, time_constant_s: float):
        if not (math.isfinite(time_constant_s) and time_constant_s > 0):
            raise ValueError(f'time_constant_s={time_constant_s} must be positive and finite')
        self.time_constant_s = float(time_constant_s)
        self.reset()

    def reset(self) -> None:
        """Forget the average; it begins anew with the next pulse."""
        self._kind: tuple[object, ...] | None = None
        self._average: np.ndarray | None = None
        self._count = self._last_ns = 0

    def __call__(self, block: PulseBlock) -> PulseBlock:
        """Block without background.

        The average begins anew where the radar, the shape or the kind of the samples changes, or
        time goes back.

        Parameters
        ----------
        block : PulseBlock
            Samples ``(P, C, N)``, raw or compressed, in the order of their times.

        Returns
        -------
        PulseBlock
            The same pulses; samples complex64.

        Raises
        ------
        ValueError
            The time constant spans fewer than eight pulses of the block: it would remove the
            echoes with the background.
        """
        self._check_rate(block.stamp_ns)
        kind = (block.radar, block.compressed, block.n_channels, block.n_samples)
        if self._average is None or kind != self._kind or block.stamp_ns[0] <= self._last_ns:
            self.reset()
            self._kind = kind
            self._average = np.zeros(block.samples.shape[1:], np.complex64)
            self._last_ns = int(block.stamp_ns[0])
        step_s = np.diff(block.stamp_ns, prepend=self._last_ns) * 1e-9
        weight = np.maximum(1 / (self._count + 1 + np.arange(block.n_pulses)),
                            -np.expm1(-step_s / self.time_constant_s)).astype(np.float32)
        samples = np.empty_like(block.samples)
        for n, pulse in enumerate(block.samples):
            np.subtract(pulse, self._average, out=samples[n])
            self._average += weight[n] * samples[n]
            samples[n] *= 1 - weight[n]
        self._count += block.n_pulses
        self._last_ns = int(block.stamp_ns[-1])
        return dataclasses.replace(block, samples=samples)

    def _check_rate(self, stamp_ns: np.ndarray) -> None:
        if len(stamp_ns) < 2:
            return
        interval_s = float(np.median(np.diff(stamp_ns))) * 1e-9
        if self.time_constant_s < FEWEST_PULSES * interval_s:
            raise ValueError(
                f'a time constant of {self.time_constant_s:g} s is too short to tell background '
                f'from echoes: pulses come every {interval_s:.4g} s; expected '
                f'{FEWEST_PULSES * interval_s:.4g} s or more')


def subtract_background(block: PulseBlock) -> PulseBlock:
    """Remove what is the same in all pulses of a block: the median of each channel and sample.

    Parameters
    ----------
    block : PulseBlock
        Raw samples or range profiles of at least three pulses from a moving platform; use a
        whole aperture. A scatterer that stays at one range for more than half of the pulses is
        taken for background.

    Returns
    -------
    PulseBlock
        The same pulses without background. The median is taken of real and imaginary parts
        separately.

    Raises
    ------
    ValueError
        There are fewer than three pulses.
    """
    if block.n_pulses < 3:
        raise ValueError(f'{block.n_pulses} pulses have no background to tell from echoes; '
                         'pass at least three pulses of a moving platform')
    samples = np.ascontiguousarray(block.samples)  # parts of others have no view as numbers
    parts = samples.view(np.float32).reshape(*samples.shape, 2)
    background = np.median(parts, axis=0)
    return dataclasses.replace(block, samples=(parts - background).view(np.complex64)[..., 0])
