# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Sub-aperture images into fusion, as separate processes and as a pipeline, against exact ones."""

import dataclasses
import re

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import MapMetaData
from sensor_msgs.msg import Image

from msg_conversions import subaperture_image
from msg_conversions.images import complex_from_message, map_metadata_from_message
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.streaming.subapertures import LiveSubapertures
from sar_imaging.tools.node_processes import AFBP_NODES, PIPELINE

LARGEST_ERROR_DB = -60.0  # what backprojection plans for by default in this mode


def images_in_log(text):
    """Kind, aperture and pulses of the images that a log tells of, in their order."""
    found = re.findall(r'(progressive )?image of aperture (\d+): \d+ sub-apertures, (\d+) pulses',
                       text)
    return [('progressive' if kind else 'final', int(aperture), int(n_pulses))
            for kind, aperture, n_pulses in found]


def counters_around(recording, header, n_pulses):
    """Counters of adjoining pulses whose middle is the time of a header."""
    stamps = recording.pulses.stamp_ns
    middle = np.interp(header.stamp.sec * 10**9 + header.stamp.nanosec - int(stamps[0]),
                       stamps - stamps[0], recording.pulses.counter)
    first = round(middle - (n_pulses - 1) / 2)
    return np.arange(first, first + n_pulses)


def check_images(recording, chain, name, messages):
    """Images are those that the log tells of, and exact."""
    grid = map_metadata_from_message(chain.observer.wait_for('map_metadata', 1)[0])
    chain.wait_for_log(name, 'image of aperture', len(messages))  # written after each is sent
    told = images_in_log(chain.log(name))
    for message, (_, _, n_pulses) in zip(messages, told, strict=True):
        error_db = recording.error_db(complex_from_message(message), grid,
                                      counters_around(recording, message.header, n_pulses))
        assert error_db < LARGEST_ERROR_DB
    return told


def test_images_while_pulses_arrive_and_of_whole_apertures(make_chains, spotlight):
    # Both at once, as two radars on one robot; the recording loops.
    chains = make_chains(*(
        {'truth': spotlight.truth, 'names': names, 'mode': 'subapertures',
         'namespace': f'radar{number}', 'afbp_fusion': {'images_every': 2}}
        for number, names in enumerate((AFBP_NODES, PIPELINE))))
    where = (('radar0/afbp_fusion', 'stage'), ('radar1/sar_pipeline', 'afbp_fusion'))
    for passes in (1, 2):
        for chain in chains:
            chain.observer.send(spotlight.raw)
        # With each report the log takes new lines, which a quick machine may else use up.
        for chain, node in zip(chains, where, strict=True):
            chain.observer.wait_for_counters(*node, images_final=2 * passes)
    n_images, received = len(images_in_log(chains[0].log('afbp_fusion'))), []
    for chain, node in zip(chains, where, strict=True):
        received.append(chain.observer.wait_for('image_complex', n_images))
        chain.observer.wait_for_counters(
            *node, images_published=n_images, images_progressive=n_images - 4,
            subapertures_missing=0, subapertures_late=0, pulses_missing=0,
            pulses_missing_in_last_aperture=0)
    told = check_images(spotlight, chains[0], 'afbp_fusion', received[0])
    assert [t for t in told if t[0] == 'final'] == 2 * [('final', 0, 128), ('final', 1, 128)]
    assert len(told) >= 6
    for separate, direct in zip(*received, strict=True):
        assert direct.header == separate.header
        np.testing.assert_array_equal(complex_from_message(direct),
                                      complex_from_message(separate))
    for part in ('pulse_buffer', 'backprojection'):
        chains[1].observer.wait_for_counters('radar1/sar_pipeline', part, restarts=1)


def test_a_sliding_aperture_gives_an_image_with_every_subaperture(make_chain, spotlight):
    chain = make_chain(spotlight.truth, names=PIPELINE, mode='subapertures', backprojection={
        'subapertures.sliding': True, 'subapertures.pulses': 16})
    chain.observer.send(spotlight.raw)
    images = chain.observer.wait_for('image_complex', 9)  # pulses 0..127, 16..143, ..., 128..255
    assert check_images(spotlight, chain, 'sar_pipeline', images) == [
        ('final', min(number, 1), 128) for number in range(9)]


def test_images_that_follow_the_platform_are_joined_to_a_strip(make_chain, spotlight):
    truth, track = spotlight.truth, spotlight.pulses.phase_centre_m[:, :2]
    flight = (track[-1] - track[0]) / np.linalg.norm(track[-1] - track[0])
    to_scene = np.array(truth['grid']['centre_m'])[:2] - track.mean(axis=0)
    chain = make_chain(truth, names=PIPELINE, mode='subapertures', backprojection={
        'subapertures.follow': True, 'subapertures.follow_ahead': float(flight @ to_scene),
        'subapertures.follow_left': float(flight[0] * to_scene[1] - flight[1] * to_scene[0]),
        'grid.size_x': 20.0, 'grid.size_y': 20.0}, afbp_fusion={'strip_max_pixels': 10**6})
    observer = chain.observer
    observer.subscribe(Image, 'strip/image_complex')
    observer.subscribe(MapMetaData, 'strip/map_metadata')
    chain.wait_for_log('sar_pipeline', 'subscriber on .*strip/image_complex joined')
    observer.send(spotlight.raw)
    strip = complex_from_message(observer.wait_for('strip/image_complex', 2)[1])
    whole = map_metadata_from_message(observer.wait_for('strip/map_metadata', 2)[1])
    assert strip.shape == whole.shape
    patches = [complex_from_message(m) for m in observer.wait_for('image_complex', 2)]
    grids = [map_metadata_from_message(m) for m in observer.wait_for('map_metadata', 2)]
    middles = [track[n:n + 128].mean(axis=0) for n in (0, 128)]
    shift = np.subtract(grids[1].centre_m, grids[0].centre_m)[:2]
    # The middle of the first aperture, 40 m long, is foreseen from its beginning.
    np.testing.assert_allclose(shift, middles[1] - middles[0], atol=10.0)
    for number, (patch, grid) in enumerate(zip(patches, grids, strict=True)):
        counters = np.arange(128 * number, 128 * (number + 1))
        assert spotlight.error_db(patch, grid, counters) < LARGEST_ERROR_DB
        row, column = (round(float(v)) for v in whole.to_pixels(*grid.centre_m[:2]))
        middle = [v // 2 for v in patch.shape]
        assert strip[row, column] == patch[middle[0], middle[1]]


@pytest.fixture(scope='module')
def two_apertures(psf):
    """Sub-aperture images of the recording's aperture and of the same one later."""
    grid, length = psf.truth['grid'], psf.truth['pulses_per_aperture']
    first = LiveSubapertures(
        MapGrid(tuple(grid['centre_m']), grid['n_x'], grid['n_y'], grid['spacing_m']),
        pulses_per_aperture=length, pulses_per_subaperture=50)
    plan = RangeCompressor.for_block(psf.pulses)
    images = []
    for n in range(2):
        block = dataclasses.replace(psf.pulses, counter=psf.pulses.counter + n * length,
                                    stamp_ns=psf.pulses.stamp_ns + n * 10**9)
        images += first.add(plan(block))
    assert [(i.aperture, i.number) for i in images] == [(n, i) for n in (0, 1) for i in range(4)]
    return images


def test_subapertures_late_twice_in_disorder_and_never(start_node, make_observer, psf,
                                                       two_apertures):
    node = start_node('afbp_fusion', {'frame_id': 'odom'})
    observer = make_observer('subaperture_images')
    node.wait_for_log('afbp_fusion', 'subscriber on .*image_complex joined')
    observer.wait(lambda: observer.joined, 'the subscription')
    assert observer.trigger('afbp_fusion/form_image') == (False, 'no aperture is being fused')

    messages = [subaperture_image.to_message(i) for i in two_apertures]
    corrupt = subaperture_image.to_message(two_apertures[0])
    corrupt.data[-1] = float('nan')
    observer.send_messages([messages[2], messages[0], corrupt, messages[0], messages[3],
                            messages[1], messages[1]])
    [image] = observer.wait_for('image_complex', 1)
    grid = map_metadata_from_message(observer.wait_for('map_metadata', 1)[0])
    assert image.header.frame_id == 'odom'
    error_db = psf.error_db(complex_from_message(image), grid, np.arange(200))
    assert error_db < LARGEST_ERROR_DB

    observer.send_messages([messages[6], messages[4], messages[7]])
    observer.wait_for_progress('afbp_fusion', 399)
    assert observer.trigger('afbp_fusion/form_image') == (
        True, 'image of aperture 1: 3 sub-apertures, 150 pulses, 50 missing')
    image = observer.wait_for('image_complex', 2)[1]
    came = np.r_[0:50, 100:200]
    assert psf.error_db(complex_from_message(image), grid, came) < LARGEST_ERROR_DB
    observer.send_messages([messages[5]])
    observer.wait_for_counters(
        'afbp_fusion', subapertures_fused=7, subapertures_late=2, subapertures_duplicate=1,
        subapertures_missing=1, pulses_missing=50, blocks_rejected=1, images_final=2, errors=0)
    assert observer.status('afbp_fusion').level > DiagnosticStatus.OK
    assert observer.counters('afbp_fusion')['predicted_error_db'] < LARGEST_ERROR_DB
    observer.send_messages(messages[:1])
    observer.wait_for_counters('afbp_fusion', subapertures_late=3)  # it waits no more
    assert observer.trigger('afbp_fusion/reset') == (True, 'no pulses were underway')
