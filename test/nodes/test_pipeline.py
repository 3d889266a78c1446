# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""All stages in one process: the images of the separate nodes, to the last bit."""

import re

import numpy as np
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Float32MultiArray

from msg_conversions import pulse_block
from msg_conversions.images import (
    complex_from_message,
    map_metadata_from_message,
    occupancy_from_message,
)
from sar_imaging.tools.node_processes import NODES, PIPELINE

LARGEST_ERROR_DB = -80.0  # what backprojection plans for by default
# Profiles whose sample rate is no number that a message holds exactly.
COMPRESSION = {'range_compression': {'window': 'hamming', 'oversampling': 1.7}}


def test_the_pipeline_gives_the_images_of_the_separate_nodes(make_chains, spotlight):
    n_images = spotlight.truth['n_pulses'] // spotlight.truth['pulses_per_aperture']
    chains = make_chains(*(
        {'truth': spotlight.truth, 'names': names, 'namespace': f'radar{number}', **COMPRESSION}
        for number, names in enumerate((NODES, PIPELINE))))
    for chain in chains:
        chain.observer.send(spotlight.raw)
    received = [chain.observer.wait_for('image_complex', n_images) for chain in chains]
    for separate, direct in zip(*received, strict=True):
        assert direct.header == separate.header
        np.testing.assert_array_equal(complex_from_message(direct),
                                      complex_from_message(separate))


def test_everything_about_a_pipeline(make_chain, make_observer, spotlight):
    truth, blocks = spotlight.truth, spotlight.blocks(25)
    chain = make_chain(truth, names=PIPELINE, backprojection={'aperture_timeout_s': 3600.0})
    observer = chain.observer
    grid = map_metadata_from_message(observer.wait_for('map_metadata', 1)[0])
    for topic in ('pulse_blocks', 'range_profiles'):
        assert observer.node.count_publishers(topic) == 1

    # Half an aperture on request; what the buffer holds is part of it.
    observer.send(blocks[:4])
    observer.wait_for_progress('sar_pipeline', 99)
    assert observer.trigger('sar_pipeline/form_image') == (
        True, 'image of aperture 0: 100 pulses, missing 100..127 (28)')
    [image] = observer.wait_for('image_complex', 1)
    error_db = spotlight.error_db(complex_from_message(image), grid, np.arange(100))
    assert error_db < LARGEST_ERROR_DB
    assert observer.trigger('sar_pipeline/form_image') == (False, 'no aperture is being filled')

    # Who comes late gets the map of the latest image, and profiles while it listens.
    observer.subscribe(OccupancyGrid, 'obstacle_map', QoSProfile(
        depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    [occupancy_grid] = observer.wait_for('obstacle_map', 1)
    assert occupancy_grid.header == image.header
    cells, map_grid = occupancy_from_message(occupancy_grid)
    assert map_grid == grid
    row, column = (round(float(v)) for v in grid.to_pixels(
        *truth['scatterers'][0]['position_m'][:2]))
    assert cells[row, column] == 100 and np.mean(cells == 0) > 0.5
    observer.subscribe(Float32MultiArray, 'range_profiles')
    chain.wait_for_log('sar_pipeline', 'subscriber on .*range_profiles joined')
    observer.send(blocks[4:])
    observer.wait_for('image_complex', 2)
    # Topics keep no order among each other: the image may overtake the last profiles.

    def received():
        return [pulse_block.from_message(m) for m in observer.messages['range_profiles']]

    observer.wait(lambda: sum(b.n_pulses for b in received()) >= 156, 'profiles of 156 pulses')
    profiles = received()
    assert [b.compressed for b in profiles] == [True] * len(profiles)
    assert np.concatenate([b.counter for b in profiles]).tolist() == list(range(100, 256))
    observer.wait_for('obstacle_map', 2)

    # Each stage has its own part in the diagnostics.
    observer.wait_for_counters('sar_pipeline', blocks_received=len(blocks), blocks_rejected=0,
                               blocks_dropped=0, apertures_skipped=0, errors=0)
    observer.wait_for_counters('sar_pipeline', part='pulse_buffer', pulses_received=256,
                               pulses_emitted=256, pulses_missing=0)
    observer.wait_for_counters('sar_pipeline', part='range_compression', plans_made=1)
    observer.wait_for_counters('sar_pipeline', part='backprojection', images_published=2,
                               pulses_imaged=228, pulses_late=28)
    assert observer.counters('sar_pipeline')['memory_megabytes'] > 10
    observer.send([spotlight.pulses.select(slice(0, 10))])
    observer.wait_for_progress('sar_pipeline', 9)
    success, message = observer.trigger('sar_pipeline/reset')
    assert (success, message) == (True, 'dropped 0 pulses that waited and 10 underway')


def test_whole_apertures_are_imaged_by_afbp(make_chain, spotlight):
    """`method: auto` would take exact backprojection for so small an image."""
    chain = make_chain(spotlight.truth, names=PIPELINE,
                       backprojection={'method': 'afbp', 'target_db': -50.0})
    chain.observer.send(spotlight.blocks(32))
    images = chain.observer.wait_for('image_complex', 1)
    grid = map_metadata_from_message(chain.observer.wait_for('map_metadata', 1)[0])
    error_db = spotlight.error_db(complex_from_message(images[0]), grid, np.arange(128))
    assert error_db < -50.0
    chain.wait_for_log('sar_pipeline', 'image of aperture 0: 128 pulses, missing none, by afbp')


def test_a_pipeline_that_cannot_keep_up_leaves_out_whole_apertures(make_chain, psf):
    length, blocks = psf.truth['pulses_per_aperture'], psf.blocks(25)
    chain = make_chain(psf.truth, names=PIPELINE, backprojection={
        'grid.spacing': 0.02, 'worker_queue_size': 10, 'queue_depth': 200})
    observer = chain.observer
    grid = map_metadata_from_message(observer.wait_for('map_metadata', 1)[0])
    observer.send([b for n in range(8) for b in psf.later(blocks, n)])  # at once
    observer.wait_for_counters('sar_pipeline', blocks_received=8 * len(blocks), blocks_waiting=0)
    observer.send(psf.later(blocks, 8))
    chain.wait_for_log('sar_pipeline', f'image of aperture 8: {length} pulses, missing none')
    observer.wait_for_counters('sar_pipeline', blocks_received=9 * len(blocks), messages_lost=0)
    counters = observer.counters('sar_pipeline')
    n_images = 9 - int(counters['apertures_skipped'])
    assert 1 < n_images < 9
    assert counters['blocks_dropped'] > 0
    observer.wait_for_counters('sar_pipeline', part='backprojection', images_published=n_images,
                               pulses_missing=0)
    log = chain.log('sar_pipeline')
    # The worker may take a block between the refusal and its report; a burst is told in part.
    told = len(re.findall(r'is left out: \d+ blocks wait already', log))
    untold = sum(map(int, re.findall(r'(\d+) more messages were not logged', log)))
    assert 0 < told <= 9 - n_images <= told + untold
    for image in observer.wait_for('image_complex', n_images):
        error_db = psf.error_db(complex_from_message(image), grid, np.arange(length))
        assert error_db < LARGEST_ERROR_DB
