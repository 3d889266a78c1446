# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Diagnose pulses and images: name the fault of samples, channels, positions or clocks."""

from .diagnose import Diagnosis, diagnose
from .doctor import Examination, examine
from .track import track_doubts

__all__ = ['Diagnosis', 'Examination', 'diagnose', 'examine', 'track_doubts']
