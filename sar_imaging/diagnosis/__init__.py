"""Diagnose images out of focus: name the mistake in samples, positions or clocks."""

from .diagnose import Diagnosis, diagnose
from .track import track_doubts

__all__ = ['Diagnosis', 'diagnose', 'track_doubts']
