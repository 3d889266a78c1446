"""What follows from radar, platform and settings, and what of it cannot work. No ROS."""

from .constraints import Finding, check
from .derived import Derived, derive
from .settings import Acquisition, Imaging, Machine

__all__ = ['Acquisition', 'Derived', 'Finding', 'Imaging', 'Machine', 'check', 'derive']
