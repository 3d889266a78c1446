"""Multichannel synthetic aperture radar imaging for ROS 2."""

from .companion import check_companion

__version__ = '0.1.0'

check_companion()
