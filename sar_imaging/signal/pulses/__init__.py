# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Blocks of multichannel pulses: their counters, order in a stream, and apertures."""

from .block import PulseBlock, check_frame, check_profiles, concatenate

__all__ = ['PulseBlock', 'check_frame', 'check_profiles', 'concatenate']
