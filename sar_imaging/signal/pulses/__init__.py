"""Blocks of multichannel pulses, their counters, and the buffer that orders a stream of them."""

from .block import PulseBlock, check_frame, check_profiles, concatenate

__all__ = ['PulseBlock', 'check_frame', 'check_profiles', 'concatenate']
