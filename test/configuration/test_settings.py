# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Every limit of the settings, just inside and just outside."""

import math

import pytest

from sar_imaging.configuration import Machine
from sar_imaging.configuration.derived import LEAST_SPEED_M_PER_S, derive

from .conftest import MACHINE, make_acquisition, make_imaging

LIMITS = [
    (make_acquisition, 'n_samples', 1, 0), (make_acquisition, 'n_channels', 1, 0),
    (make_acquisition, 'prf_hz', 1e-9, 0.0), (make_acquisition, 'prf_hz', 1e9, math.inf),
    (make_acquisition, 'channel_spacing_m', 0.0, -1e-9),
    (make_acquisition, 'beamwidth_rad', 0.0, -1e-9),
    (make_acquisition, 'beamwidth_rad', math.pi, math.pi + 1e-9),
    *((make_imaging, name, 1, 0) for name in ('pulses_per_aperture', 'pulses_per_block',
                                              'queue_depth', 'worker_queue_size')),
]


@pytest.mark.parametrize(('make', 'name', 'inside', 'outside'), LIMITS)
def test_settings_are_possible_up_to_their_limits(make, name, inside, outside):
    assert getattr(make(**{name: inside}), name) == inside
    with pytest.raises(ValueError, match=name):
        make(**{name: outside})


@pytest.mark.parametrize(('near', 'far', 'kept'), [
    (0.0, 0.0, None), (100.0, 0.0, (100.0, math.inf)), (0.0, 100.0, (0.0, 100.0)),
    (99.9, 100.0, (99.9, 100.0))])
def test_the_range_window_is_what_near_and_far_say(near, far, kept):
    assert make_imaging(near_range=near, far_range=far).range_window_m == kept


@pytest.mark.parametrize('near', [100.0, 100.1])
def test_a_far_end_before_the_near_one_is_refused(near):
    with pytest.raises(ValueError, match='far_range=100 lies before near_range=100'):
        make_imaging(near_range=near, far_range=100.0)


def test_a_platform_moves_from_its_least_speed_on():
    imaging = make_imaging()
    for share in (1.01, 0.99):
        acquisition = make_acquisition(velocity_m_per_s=(0.0, share * LEAST_SPEED_M_PER_S, 0.0))
        if share > 1:
            assert derive(acquisition, imaging, MACHINE).aperture_m > 0
        else:
            with pytest.raises(ValueError, match='the platform stands still'):
                derive(acquisition, imaging, MACHINE)


@pytest.mark.parametrize('arguments', [(0.0, 0), (3e8, 0), (0.0, 10**9), (3e8, 10**9)])
def test_what_is_not_given_of_the_machine_is_that_of_this_one(arguments):
    rate, memory = arguments
    machine = Machine.this_one(rate, memory)
    assert (machine.rate_source == 'given') == (rate > 0)
    assert machine.rate_per_s == rate or (not rate and machine.rate_per_s > 1e7)
    assert machine.memory_bytes == memory or (not memory and machine.memory_bytes > 10**6)
