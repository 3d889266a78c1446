"""Small tiles around bright points: the part of an image that autofocus looks at."""

from .points import bright_points
from .tiles import Tiles

__all__ = ['Tiles', 'bright_points']
