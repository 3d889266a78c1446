"""Remove antenna coupling and other static echoes of ultra-wideband passband radars.

A UWB radar samples the pulse at its carrier as real numbers (`Waveform.PASSBAND`);
`sar_imaging.signal.range_compression` turns them into the analytic signal at baseband. Its direct
path from transmitter to receiver and the reflections inside it exceed every echo, and they do not
change from pulse to pulse, whereas the scene of a moving platform does.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from .pulses import PulseBlock


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
