# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What nodes tell at their start follows from parameters and the first block alone."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from sar_imaging.configuration import derive
from sar_imaging.configuration.constraints import check_settings
from sar_imaging.configuration.parameters import (
    default_file,
    imaging_from_parameters,
    read_configuration,
)
from sar_imaging.configuration.startup import StartupReport, acquisition_of, report_block
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.scenarios.catalogue import configured_scenario

from .conftest import MACHINE


@pytest.fixture(scope='module')
def car():
    """Configuration of the car, its parameters by node, and its first two raw blocks."""
    configuration = read_configuration(default_file().with_name('automotive_77ghz.yaml'))
    acquisition, imaging = configuration.acquisition(), configuration.imaging()
    # As a radar on a vehicle counts on: three apertures, the middle one is the configured one.
    scenario = configured_scenario('car', acquisition, imaging, apertures=3)
    scenario = dataclasses.replace(scenario, scatterers=scenario.scatterers[:1])
    blocks = scenario.blocks(16)
    return configuration, [b for b, _ in zip(blocks, range(17), strict=False)]


def test_a_block_tells_radar_rate_and_track(car):
    configuration, blocks = car
    wanted, imaging = configuration.acquisition(), configuration.imaging()
    # The first pulses of the second aperture: its middle is where the file says.
    found = acquisition_of(blocks[16], imaging)
    # Stamps are rounded to 1 ns of 9.4 ms, positions to 1 um of 19 mm.
    assert found.prf_hz == pytest.approx(wanted.prf_hz, rel=1e-6)
    np.testing.assert_allclose(found.velocity_m_per_s, wanted.velocity_m_per_s, atol=3e-4)
    np.testing.assert_allclose(found.centre_m, wanted.centre_m, atol=1e-4)
    assert found.channel_spacing_m == pytest.approx(wanted.channel_spacing_m, abs=2e-6)
    assert (found.radar, found.n_samples, found.n_channels, found.compressed) == (
        wanted.radar, wanted.n_samples, wanted.n_channels, False)


@given(order=st.permutations(range(16)), missing=st.integers(0, 13))
@settings(max_examples=20)
def test_the_order_and_gaps_of_a_block_do_not_matter(car, order, missing):
    configuration, blocks = car
    kept = sorted({0, 15, *order[missing:]}, key=order.index)
    whole, part = (acquisition_of(b, configuration.imaging())
                   for b in (blocks[16], blocks[16].select(np.array(kept))))
    assert part.prf_hz == pytest.approx(whole.prf_hz)
    assert part.centre_m == pytest.approx(whole.centre_m)


def test_raw_blocks_are_reported_as_check_config_does(car):
    configuration, blocks = car
    parameters = {**configuration.nodes['range_compression'], **configuration.nodes[
        'backprojection']}
    report = report_block(parameters, blocks[16])
    assert (report.errors, report.warnings) == ((), ())
    derived = derive(configuration.acquisition(), configuration.imaging(), MACHINE)
    [line] = [line for line in report.lines if line.startswith('range resolution')]
    assert f'{derived.range_width_m:.3g} m' in line
    [line] = [line for line in report.lines if line.startswith('azimuth resolution')]
    assert f'{derived.azimuth_width_m:.3g} m' in line
    assert any(line.startswith('memory of backprojection') for line in report.lines)


def test_profiles_are_reported_from_the_parameters_of_backprojection_alone(car):
    configuration, blocks = car
    profiles = RangeCompressor.for_block(blocks[16])(blocks[16])
    report = report_block(configuration.nodes['backprojection'], profiles)
    assert (report.errors, report.warnings) == ((), ())
    assert any('window none' in line for line in report.lines)


def test_what_follows_from_the_track_is_a_warning(car):
    configuration, blocks = car
    far = configuration.nodes['backprojection'] | {'grid.centre_x': 1000.0}
    report = report_block(far, blocks[16])
    assert report.errors == report.warnings == ()
    assert any('nothing of it was recorded' in text for text in report.track.texts)


def flown(blocks, n_pulses, track):
    """Blocks of 16 pulses with other phase centres: (P,) positions along and across, metres."""
    for start in range(0, n_pulses, 16):
        counter = np.arange(start, start + 16)
        place = np.zeros((16, 1, 3))
        place[:, 0, 0], place[:, 0, 2] = track(counter)
        place = np.repeat(place, blocks[0].n_channels, axis=1)
        yield dataclasses.replace(
            blocks[0], counter=counter, stamp_ns=blocks[0].stamp_ns[0] + counter * 10**7,
            tx_m=place, rx_m=place)


@pytest.mark.parametrize(('track', 'verdict', 'after'), [
    (lambda n: (0.02 * n, 0 * n), True, 96),
    (lambda n: (0.02 * n + 0.005 * np.sin(n), 0 * n), True, 96),  # vibration
    # A raster: 48 steps to and fro, one to the next row; it turns in the fourth block.
    (lambda n: (0.02 * np.where(n // 48 % 2, 47 - n % 48, n % 48), 0.02 * (n // 48)), False, 64),
])
def test_a_track_proves_straight_before_it_is_warned_of(car, track, verdict, after):
    configuration, blocks = car
    far = configuration.nodes['backprojection'] | {'grid.centre_x': 1000.0,
                                                   'pulses_per_aperture': 128}
    passed = list(flown(blocks, 128, track))
    waiting = report_block(far, passed[0]).track
    verdicts = [waiting.straight(block) for block in passed[:after // 16]]
    assert verdicts == [None] * (len(verdicts) - 1) + [verdict]


def test_what_cannot_work_is_an_error(car):
    configuration, blocks = car
    parameters = configuration.nodes['backprojection']
    assert check_settings(imaging_from_parameters(parameters), MACHINE) == []
    coarse = dataclasses.replace(RangeCompressor.for_block(blocks[16], oversampling=1.0)(
        blocks[16]))
    [error] = report_block(parameters, coarse).errors
    assert 'backprojection needs 1.25: raise oversampling' in error
    [found] = check_settings(imaging_from_parameters(parameters | {'max_image_pixels': 100}),
                             MACHINE)
    assert found.severity == 'error'
    assert 'the grid has 301 x 301 pixels, more than max_image_pixels=100' in found.text
    with pytest.raises(ValueError, match='spacing_m=0.0 must be positive'):
        imaging_from_parameters(parameters | {'grid.spacing': 0.0})
    [error] = report_block(parameters | {'grid.spacing': 0.0}, blocks[16]).errors
    assert 'spacing_m=0.0 must be positive' in error


def test_blocks_that_tell_no_track(car):
    configuration, blocks = car
    parameters = configuration.nodes['backprojection']
    still = dataclasses.replace(blocks[0], tx_m=np.zeros_like(blocks[0].tx_m),
                                rx_m=np.zeros_like(blocks[0].rx_m))
    timeless = dataclasses.replace(blocks[0], stamp_ns=np.zeros_like(blocks[0].stamp_ns))
    bare = dataclasses.replace(blocks[0], tx_m=None, rx_m=None)
    for block in (blocks[0].select(slice(0, 1)), still, timeless, bare):
        assert report_block(parameters, block) == StartupReport()
