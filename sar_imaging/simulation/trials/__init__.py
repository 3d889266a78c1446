# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Former place of `sar_imaging.simulation`, which a warning names; goes with the next release."""

from ...names import moved

__getattr__ = moved(
    __name__, 'sar_imaging.simulation', ('FlawedAperture', 'flawed_aperture'),
    DroneFlight='benchmarks.support.drone_flights:DroneFlight',
    drone_flight='benchmarks.support.drone_flights:drone_flight',
    RandomCase='benchmarks.support.random_cases:RandomCase',
    random_case='benchmarks.support.random_cases:random_case')
