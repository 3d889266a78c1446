# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Derive quantities from radar, platform and settings, and find what cannot work. No ROS.

- `settings`, `parameters`, `positions`, `datum`: the configuration, from ROS parameter files too;
- `derived`: resolution, ambiguities, times and bytes;
- `constraints`: errors and warnings, each with the parameter to change;
- `report`, `startup`: the same in words, for `check_config` and at the start of a node.
"""

from .constraints import Finding, check
from .derived import Derived, derive
from .settings import Acquisition, Imaging, Machine

__all__ = ['Acquisition', 'Derived', 'Finding', 'Imaging', 'Machine', 'check', 'derive']
