"""Trajectories, phase centres and image grids."""

from .grids import MapGrid

__all__ = ['MapGrid']
