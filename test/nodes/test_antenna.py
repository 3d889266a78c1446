# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The antenna in the nodes: where it looks, what it lights, and what is refused."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='the package of the nodes needs ROS')

from sar_imaging.configuration.parameters import default_file, interpret, load_tree
from sar_imaging.configuration.positions import check_positions
from sar_imaging.geometry.illumination import Pointing
from sar_imaging.nodes.antenna import POINTING_PARAMETERS
from sar_imaging.nodes.backprojection import (
    PARAMETERS as IMAGER_PARAMETERS,
    BackprojectionStep,
)
from sar_imaging.nodes.pulse_buffer import PulseBufferStep
from sar_imaging.nodes.runtime.parameters import ConfigurationError

from .step_bench import make

TRACK = {'antenna.pointing': 'track', 'antenna.side': 'right', 'antenna.depression': 20.0}


def emitted(step, block):
    out = [b for part in np.array_split(np.arange(block.n_pulses), 7)
           for b in step.process(block.select(part))]
    return [*out, *step.flush()]


def test_pulses_get_their_pointing_block_by_block(psf):
    """Beside the track, as if all its pulses were known at once."""
    step, _ = make(PulseBufferStep, **TRACK)
    blocks = emitted(step, psf.pulses)
    assert len(blocks) > 5
    expected = Pointing.beside_track(psf.pulses.phase_centre_m, -1, np.radians(20))
    found = np.concatenate([b.pointing.boresight for b in blocks])
    # the track is straight: only rounding in messages differs
    np.testing.assert_allclose(found, expected.boresight, atol=1e-9)


def test_pulses_keep_the_pointing_that_they_tell(psf):
    looks = Pointing.steered(psf.pulses.phase_centre_m, (1.0, 2.0, 3.0))
    told = dataclasses.replace(psf.pulses, pointing=looks)
    blocks = emitted(make(PulseBufferStep)[0], told)
    np.testing.assert_allclose(np.concatenate([b.pointing.boresight for b in blocks]),
                               looks.boresight, atol=1e-12)
    turning, _ = make(PulseBufferStep, **{
        'antenna.pointing': 'rotation', 'antenna.rotation_rate': 36.0,
        'antenna.rotation_start_s': float(psf.pulses.stamp_ns[0]) * 1e-9})
    [first, *_] = emitted(turning, told)
    time_s = (first.stamp_ns - psf.pulses.stamp_ns[0]) * 1e-9
    # the parameter has the time of a start in 2023 to a quarter of a microsecond
    np.testing.assert_allclose(first.pointing.boresight[:, 1], np.sin(np.radians(36) * time_s),
                               atol=1e-6)


def test_pulses_of_a_platform_at_rest_are_dropped_and_counted(psf):
    step, log = make(PulseBufferStep, **TRACK)
    still = np.broadcast_to(psf.pulses.tx_m[:1], psf.pulses.tx_m.shape)
    assert emitted(step, dataclasses.replace(psf.pulses, tx_m=still, rx_m=still)) == []
    step.update_counters()
    assert log['pulses_without_pointing'] == psf.pulses.n_pulses
    [line] = [line for line in log.lines if 'antenna.pointing=track' in line]
    assert 'the platform does not move' in line


@pytest.mark.parametrize(('step', 'parameters', 'text'), [
    (PulseBufferStep, {'antenna.pointing': 'platform'}, 'expected pose.source odometry, pose, tf'),
    (PulseBufferStep, {'antenna.pointing': 'platform', 'pose.source': 'fix'}, 'have no attitude'),
    (PulseBufferStep, {'antenna.pointing': 'platform', 'pose.source': 'odometry',
                       'antenna.boresight': [0.0, 0.0, 1.0]}, 'antenna boresight'),
    (BackprojectionStep, {'antenna.pattern': 'sinc'}, 'azimuth width 0 degrees; expected more'),
    (BackprojectionStep, {'antenna.pattern': 'measured'}, 'antenna.pattern_file='),
    (BackprojectionStep, {'antenna.pattern': 'measured', 'antenna.pattern_file': '/nowhere'},
     '/nowhere cannot be read'),
    (BackprojectionStep, {'antenna.pattern_file': 'a.yaml'}, 'antenna.pattern=none and')])
def test_impossible_antennas_are_refused_in_one_line(step, parameters, text):
    with pytest.raises(ConfigurationError, match=text) as caught:
        make(step, **parameters)
    assert '\n' not in str(caught.value) and 'antenna.' in str(caught.value)
    tree = {'/**': {'ros__parameters': parameters}}
    configuration = interpret(tree, load_tree(default_file()))
    errors = [f.text for f in check_positions(configuration.nodes, None) if f.severity == 'error']
    assert any(error in str(caught.value) for error in errors)  # check_config says the same


def test_words_that_no_antenna_has_are_refused():
    for parameter in (*POINTING_PARAMETERS, *IMAGER_PARAMETERS):
        if parameter.name in ('antenna.pointing', 'antenna.pattern', 'antenna.side'):
            with pytest.raises(ConfigurationError, match="'oblique' is unknown; use one of"):
                parameter.coerce('oblique')
        elif parameter.name in ('antenna.boresight', 'antenna.up', 'antenna.target'):
            with pytest.raises(ConfigurationError, match='2 numbers; expected x, y, z'):
                parameter.coerce([1.0, 2.0])
