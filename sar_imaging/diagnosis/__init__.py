"""What went wrong with an image: mistakes in samples, positions and clocks, named."""

from .diagnose import Diagnosis, diagnose
from .track import track_doubts

__all__ = ['Diagnosis', 'diagnose', 'track_doubts']
