"""Image tiles around bright points, which autofocus focuses instead of the whole image."""

from .points import bright_points
from .tiles import Tiles

__all__ = ['Tiles', 'bright_points']
