# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Steps without nodes: what they count as underway, missing and dropped."""

import dataclasses
import time

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='the package of the nodes needs ROS')

from msg_conversions import subaperture_image
from msg_conversions.images import (
    complex_from_message,
    map_metadata_from_message,
    occupancy_from_message,
    quicklook_from_message,
)
from msg_conversions.quicklook import quicklook
from sar_imaging import backends
from sar_imaging.backends import DeviceError
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.nodes.afbp_fusion import FusionStep
from sar_imaging.nodes.backprojection import IMAGE, SUBAPERTURES, BackprojectionStep
from sar_imaging.nodes.pulse_buffer import PulseBufferStep
from sar_imaging.nodes.range_compression import RangeCompressionStep
from sar_imaging.nodes.runtime.parameters import ConfigurationError
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.streaming.subapertures import LiveSubapertures

from .step_bench import Outputs, make

CUT = 25  # pulses of a sub-aperture, of 100 in the apertures below
N_CUTS = 4


@pytest.fixture(name='grid', scope='module')
def grid_fixture(psf):
    g = psf.truth['grid']
    return MapGrid(tuple(g['centre_m']), g['n_x'], g['n_y'], g['spacing_m'])


@pytest.fixture(name='profiles', scope='module')
def profiles_fixture(psf):
    return RangeCompressor.for_block(psf.pulses)(psf.pulses)


@pytest.fixture(name='sent', scope='module')
def sent_fixture(grid, profiles):
    """Sub-aperture images of two apertures, one after the other."""
    stage = LiveSubapertures(grid, pulses_per_aperture=100, pulses_per_subaperture=CUT)
    sent = stage.add(profiles)
    assert [(s.aperture, s.number) for s in sent] == [(a, n) for a in (0, 1)
                                                      for n in range(N_CUTS)]
    return sent


# ------------------------------------------------------------------------------- fusion

def test_a_reset_counts_the_pulses_of_the_aperture_underway_alone(sent):
    step, _ = make(FusionStep)
    for sub in sent[:3]:
        assert step.process(sub) == []
    assert step.discard() == 3 * CUT
    assert step.discard() == 0
    [image] = [image for sub in sent[:N_CUTS] for image in step.process(sub)]
    assert image.final and step.discard() == 0


def test_a_reset_after_a_subaperture_of_the_next_aperture_counts_that_one(sent):
    step, _ = make(FusionStep, min_pulse_fraction=0.5)
    images = [image for sub in (*sent[:3], sent[4]) for image in step.process(sub)]
    assert [image.n_pulses for image in images] == [3 * CUT]
    assert step.discard() == CUT


def test_a_dropped_aperture_is_not_underway_any_more(sent):
    step, log = make(FusionStep, min_pulse_fraction=0.6)
    assert [image for sub in (*sent[:2], sent[5]) for image in step.process(sub)] == []
    step.update_counters()
    assert log['apertures_dropped'] == 1
    assert step.discard() == CUT


def test_a_duplicate_is_not_underway_twice(sent):
    step, log = make(FusionStep)
    for sub in (sent[0], sent[0], sent[1]):
        step.process(sub)
    step.update_counters()
    assert (log['subapertures_duplicate'], log['subapertures_fused']) == (1, 2)
    assert step.discard() == 2 * CUT


def test_after_a_flush_nothing_is_underway(sent):
    step, _ = make(FusionStep, min_pulse_fraction=0.5)
    step.process(sent[0])
    assert step.flush() == []
    assert 'fewer pulses than min_pulse_fraction=0.5' in step.nothing_formed()
    assert step.discard() == 0
    assert step.flush() == [] and step.nothing_formed() == 'no aperture is being fused'


def test_an_aperture_left_out_is_forgotten_and_counted(sent):
    step, log = make(FusionStep)
    for sub in sent[:2]:
        step.process(sub)
    assert step.skip(0) == [] and step.skip(None) == []
    assert log['subapertures_skipped'] == 2
    assert step.flush() == []
    step.process(sent[4])
    step.skip(None)  # none any more: what came since stays
    assert log['subapertures_skipped'] == 2 and step.discard() == CUT


@pytest.mark.parametrize(('numbers', 'missing'), [((0, 1, 2, 3), 0), ((0, 1), 2), ((3,), 3)])
def test_what_an_image_lacks_is_counted_when_it_is_final(sent, numbers, missing):
    step, log = make(FusionStep, images_every=1, min_pulse_fraction=0.0)
    step.create_outputs(Outputs())
    images = [image for n in numbers for image in step.process(sent[n])] + step.flush()
    for image in images:
        step.publish(image)
    assert log['images_final'] == 1 and log['images_progressive'] == len(images) - 1
    assert log['images_published'] == len(images)
    assert log['subapertures_missing'] == missing
    assert log['pulses_missing'] == log['pulses_missing_in_last_aperture'] == CUT * missing


# ------------------------------------------------------------------------------- backprojection

def backprojection(grid, **parameters):
    return make(BackprojectionStep, **{
        'mode': IMAGE, 'grid.centre_x': grid.centre_m[0], 'grid.centre_y': grid.centre_m[1],
        'grid.centre_z': grid.centre_m[2], 'grid.size_x': 4.0, 'grid.size_y': 8.0,
        'grid.spacing': 0.2} | parameters)


def test_the_share_of_pulses_may_change_while_an_aperture_is_filled(grid, profiles):
    step, log = backprojection(grid, min_pulse_fraction=0.5)
    assert step.process(profiles.select(slice(0, 49))) == [] == step.flush()
    assert 'min_pulse_fraction=0.5' in step.nothing_formed()
    assert step.process(profiles.select(slice(100, 149))) == []
    step.parameters['min_pulse_fraction'] = 0.49
    [image] = step.flush()
    assert image.n_pulses == 49
    assert step.flush() == [] and step.nothing_formed() == 'no aperture is being filled'
    step.update_counters()
    assert (log['pulses_imaged'], log['apertures_dropped']) == (98, 1)


def test_only_the_aperture_left_out_is_forgotten(grid, profiles):
    step, log = backprojection(grid)
    step.process(profiles.select(slice(0, 30)))
    step.skip(7)  # the stages before may be further on
    step.skip(None)
    assert log['pulses_skipped'] == 0
    step.skip(0)
    assert log['pulses_skipped'] == 30
    assert step.discard() == 0
    step.process(profiles.select(slice(100, 112)))
    assert step.discard() == 12


def test_what_cannot_be_imaged_is_said_once_and_refused_every_time(grid, profiles):
    step, log = backprojection(grid)
    radar = profiles.radar
    coarse = dataclasses.replace(profiles, radar=dataclasses.replace(
        radar, bandwidth_hz=radar.sample_rate_hz))
    for _ in range(3):
        with pytest.raises(ValueError, match='backprojection needs 1.25: raise oversampling'):
            step.process(coarse)
    assert len([line for line in log.lines if line.startswith('derived quantities')]) == 1
    assert len(step.process(profiles)) == 2  # of another radar all is judged anew
    assert len([line for line in log.lines if line.startswith('derived quantities')]) == 2


def test_a_device_that_is_not_there_is_told_at_the_start(grid, monkeypatch):
    def fail():
        raise DeviceError('the CUDA driver finds no device')

    monkeypatch.setattr(backends, 'require_device', fail)
    with pytest.raises(ConfigurationError,
                       match=r'^parameter backend: the CUDA driver finds no device$'):
        backprojection(grid, backend='cuda')


STRIP = 'the image follows the antenna'


def strip(grid, **parameters):
    """Step of a strip: 30 m of flight in an aperture of 100 pulses, images of 20 m of it."""
    return backprojection(grid, mode=SUBAPERTURES, pulses_per_aperture=100, **{
        'grid.size_y': 20.0, 'subapertures.follow': True, 'subapertures.pulses': CUT,
        'subapertures.follow_ahead': 0.0, 'subapertures.follow_left': -10e3} | parameters)


def test_gaps_of_a_strip_are_warned_of_once_the_track_is_straight(grid, profiles):
    step, log = strip(grid)
    for start in range(0, 200, CUT):
        step.process(profiles.select(slice(start, start + CUT)))
        told = [line for line in log.lines if line.startswith(STRIP)]
        assert len(told) == (start + CUT >= 75)
    assert 'm in between are never imaged; raise grid.size_y to 29.9' in told[0]
    step, log = strip(grid, **{'grid.size_y': 40.0})
    step.process(profiles)
    assert not any(line.startswith(STRIP) for line in log.lines)


def test_a_raster_is_not_warned_of_what_its_first_row_carried_on_would_be(grid, profiles):
    to_and_fro = np.r_[0:50, 50:0:-1, 0:50, 50:0:-1]
    places = {name: getattr(profiles, name)[to_and_fro] for name in ('tx_m', 'rx_m')}
    step, log = strip(grid)
    for start in range(0, 200, CUT):
        block = profiles.select(slice(start, start + CUT))
        step.process(dataclasses.replace(block, **{
            name: place[start:start + CUT] for name, place in places.items()}))
    assert not any(line.startswith(STRIP) for line in log.lines)
    assert any('the track is not straight' in line for line in log.lines)


def test_every_product_goes_to_who_listens(grid, profiles):
    step, log = backprojection(grid, frame_id='odom', **{
        'quicklook.dynamic_range_db': 40.0, 'grid.size_x': 8.0, 'grid.size_y': 40.0})
    outputs = Outputs('image_complex', 'image_quicklook')
    step.create_outputs(outputs)
    images = step.process(profiles)
    for image in images:
        step.publish(image)
    sent = outputs.sent
    assert {topic: len(messages) for topic, messages in sent.items()} == {
        'image_complex': 2, 'image': 0, 'image_quicklook': 2, 'map_metadata': 1,
        'obstacle_map': 0, 'obstacles': 0}
    for image, message, levels in zip(images, sent['image_complex'], sent['image_quicklook'],
                                         strict=True):
        np.testing.assert_array_equal(complex_from_message(message), image.image)
        np.testing.assert_array_equal(
            quicklook_from_message(levels),
            quicklook(np.abs(image.image), 40.0, 'clutter'))
        stamp = message.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == image.stamp_ns
        assert 0 <= stamp.nanosec < 10**9
        assert message.header.frame_id == levels.header.frame_id == 'odom'
    assert map_metadata_from_message(sent['map_metadata'][0]) == images[0].grid
    # Who comes late gets the map of the latest image, once.
    for _ in range(2):
        outputs.join('obstacle_map')
    [occupied] = sent['obstacle_map']
    cells, where = occupancy_from_message(occupied)
    assert where == images[0].grid and occupied.header == sent['image_complex'][1].header
    # The scene has one scatterer, in the middle; see test_obstacle_products.
    assert cells[where.n_y // 2, where.n_x // 2] == 100
    assert set(np.unique(cells)) <= {-1, 0, 100}
    assert (log['images_published'], log['pulses_missing']) == (2, 0)


def test_the_work_on_an_image_is_counted_from_the_one_before(grid, profiles):
    step, log = backprojection(grid)
    step.create_outputs(Outputs())
    began = time.perf_counter()
    step.received_s = time.monotonic()
    [first] = step.process(profiles.select(slice(0, 100)))
    step.publish(first)
    assert 0 < log['image_latency_seconds'] <= 1.001 * (time.monotonic() - step.received_s)
    assert 0 < log['last_image_seconds'] <= 1.001 * (time.perf_counter() - began)
    step.process(profiles.select(slice(100, 120)))
    step.discard()
    began = time.perf_counter()
    [again] = step.process(profiles.select(slice(100, 200)))
    step.publish(again)
    # Four digits are published.
    assert 0 < log['last_image_seconds'] <= 1.001 * (time.perf_counter() - began)


def test_subapertures_are_messages_for_who_listens(grid, profiles):
    step, log = backprojection(grid, mode=SUBAPERTURES, **{'subapertures.pulses': CUT})
    outputs = Outputs()
    step.create_outputs(outputs)
    subapertures = step.process(profiles)
    assert len(subapertures) == 2 * N_CUTS
    step.publish(subapertures[0])
    assert outputs.sent['subaperture_images'] == []
    outputs.join('subaperture_images')
    step.publish(subapertures[1])
    [message] = outputs.sent['subaperture_images']
    received = subaperture_image.from_message(message)
    np.testing.assert_array_equal(received.image, subapertures[1].image)
    assert (received.number, received.aperture) == (1, 0)
    assert log['subapertures_published'] == 2
    assert step.describe(subapertures[-1]) == (
        'sub-aperture 3 of aperture 1: pulses 175..199, 0 missing')


def test_a_strip_joins_final_images_and_is_forgotten_with_them(sent):
    step, _ = make(FusionStep, strip_max_pixels=10**6, images_every=1)
    outputs = Outputs('strip/image_complex')
    step.create_outputs(outputs)
    images = [image for sub in sent for image in step.process(sub)]
    assert [image.final for image in images] == ([False] * (N_CUTS - 1) + [True]) * 2
    for image in images:
        step.publish(image)
    [first, second] = outputs.sent['strip/image_complex']
    np.testing.assert_array_equal(complex_from_message(first), images[N_CUTS - 1].image)
    assert (second.height, second.width) == images[-1].grid.shape  # in the same place
    step.discard()
    step.publish(images[-1])
    np.testing.assert_array_equal(complex_from_message(outputs.sent['strip/image_complex'][2]),
                                  images[-1].image)


# ------------------------------------------------------------------------------- pulse buffer

def test_a_buffer_lets_go_of_what_it_holds_when_an_aperture_is_left_out(psf):
    step, log = make(PulseBufferStep)
    assert step.process(psf.pulses.select(slice(0, 20))) == []
    assert step.skip(None) == []
    [block] = step.skip(0)
    assert block.n_pulses == 20
    assert step.process(psf.pulses.select(slice(20, 30))) == []
    assert step.discard() == 10
    step.update_counters()
    assert (log['pulses_received'], log['pulses_emitted'], log['pulses_missing']) == (30, 20, 0)


@pytest.mark.parametrize(('kind', 'parameters', 'text'), [
    (PulseBufferStep, {}, ' -> /pulse_blocks, 32 pulses per block, 100 per aperture, reorder '
     'window 128 pulses'),
    (PulseBufferStep, {'pose.source': 'odometry'}, ' with positions from odometry -> '
     '/pulse_blocks, 32 pulses per block, 100 per aperture, reorder window 128 pulses'),
    (RangeCompressionStep, {}, ' -> /range_profiles, window none, 2 samples per null spacing'),
    (RangeCompressionStep, {'background_s': 0.5}, ' -> /range_profiles, window none, 2 samples '
     'per null spacing, background averaged over 0.5 s subtracted'),
    (FusionStep, {}, ' -> /image in frame map, final images only'),
    (FusionStep, {'images_every': 3}, ' -> /image in frame map, an image every 3 sub-apertures')])
def test_the_first_line_says_what_a_step_does(kind, parameters, text):
    step, _ = make(kind, **parameters)
    step.create_outputs(Outputs())
    assert step.summary() == text
