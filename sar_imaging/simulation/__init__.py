# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated radar data: scenes, tracks and the echoes that a receiver would record.

- `scene`, `movers`, `shadows`, `jammer`, `noise`, `trajectory`: what there is and how it moves;
- `echoes`: the echoes, over the exact two-way path of every channel;
- `scenarios`: ready ones by name, those of the papers among them, and one from a configuration;
- `track_errors`: apertures whose positions are wrong in a known way, to try autofocus on.
"""

from .echoes import EchoSimulator
from .jammer import Jammer
from .movers import Mover
from .scenarios import SCENARIOS, Scenario
from .scene import Scatterer
from .track_errors import FlawedAperture, flawed_aperture
from .trajectory import RasterScan, Trajectory, Vibration

__all__ = ['SCENARIOS', 'EchoSimulator', 'FlawedAperture', 'Jammer', 'Mover', 'RasterScan',
           'Scatterer', 'Scenario', 'Trajectory', 'Vibration', 'flawed_aperture']
