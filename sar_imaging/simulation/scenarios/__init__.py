# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Scenarios: a radar, its track and a scene, and the pulses that follow."""

from .catalogue import RANGE_CENTRE_M, SCENARIOS, WAVELENGTH_M, moving_targets
from .scenario import Scenario, receive_array

__all__ = ['RANGE_CENTRE_M', 'SCENARIOS', 'WAVELENGTH_M', 'Scenario', 'moving_targets',
           'receive_array']
