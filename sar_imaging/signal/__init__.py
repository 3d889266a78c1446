# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Radar parameters, waveforms, pulse blocks and range compression.

- `radar`, `waveforms`, `dechirp`, `windows`: the radar, its pulse, FMCW ramps, spectral weights;
- `pulses`: blocks of multichannel pulses, and the buffer that puts a stream of them in order;
- `range_compression`: raw pulses of every waveform to range profiles;
- `positioning`, `tdm`: phase centres for pulses that come without, and for antennas in turn;
- `calibration`, `background`: channel errors, static echoes and antenna coupling;
- `spectra`, `magnitudes`: spectra of profiles, and numbers in a mistaken unit.
"""

from .pulses import PulseBlock, concatenate
from .radar import SPEED_OF_LIGHT, RadarParameters, Waveform

__all__ = ['SPEED_OF_LIGHT', 'PulseBlock', 'RadarParameters', 'Waveform', 'concatenate']
