"""Radar parameters, waveforms, windows, pulse blocks and range compression."""

from .pulses import PulseBlock, concatenate
from .radar import SPEED_OF_LIGHT, RadarParameters, Waveform

__all__ = ['SPEED_OF_LIGHT', 'PulseBlock', 'RadarParameters', 'Waveform', 'concatenate']
