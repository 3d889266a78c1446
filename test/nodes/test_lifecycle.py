# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Life cycle, services, simulated time, several radars: how the nodes are operated."""

import signal
import subprocess
import sys

import numpy as np
from rosgraph_msgs.msg import Clock

from msg_conversions.images import complex_from_message, map_metadata_from_message

LARGEST_ERROR_DB = -80.0  # what backprojection plans for by default
GRID = {'grid.size_x': 20.0, 'grid.size_y': 10.0}
SLOW_NODE = """
import time
from sar_imaging.nodes.range_compression import RangeCompressionNode, RangeCompressionStep
from sar_imaging.nodes.runtime.managed import run

class SlowStep(RangeCompressionStep):
    def process(self, block):
        self.health.info('busy')
        time.sleep(120.0)

class SlowNode(RangeCompressionNode):
    STEPS = (SlowStep,)

raise SystemExit(run(SlowNode))
"""


def test_a_node_that_waits_for_its_manager(start_node, make_observer):
    name = 'backprojection'
    node = start_node(name, {'autostart': False, 'grid.spacing': 0.001, **GRID})
    observer = make_observer()
    observer.wait(lambda: observer.status(name), 'diagnostics')
    assert observer.state(name) == observer.status(name).message == 'unconfigured'
    for service in ('reset', 'form_image'):
        assert observer.trigger(f'{name}/{service}') == (
            False, 'the node is unconfigured; activate it first')

    # An impossible parameter refuses the configuration, and can be corrected.
    assert observer.set_parameter(name, 'max_image_pixels', 1000) == (True, '')
    assert not observer.change_state(name, 'configure')
    assert observer.state(name) == 'unconfigured'
    node.wait_for_log(name, 'configuration refused: the grid has 20001 x 10001 pixels, more '
                      'than max_image_pixels=1000; raise grid.spacing=0.001')
    assert observer.set_parameter(name, 'grid.spacing', 1.0) == (True, '')
    assert observer.change_state(name, 'configure')
    assert observer.state(name) == 'inactive'
    successful, reason = observer.set_parameter(name, 'grid.spacing', 0.5)
    assert not successful
    assert 'grid.spacing is read when the node is configured; deactivate it and clean' in reason
    assert observer.set_parameter(name, 'min_pulse_fraction', 0.25) == (True, '')
    assert not observer.node.count_subscribers('range_profiles')
    assert not observer.messages['map_metadata']

    assert observer.change_state(name, 'activate')
    node.wait_for_log(name, 'ready: /range_profiles -> /image, 21 x 11 pixels of 1 m')
    observer.wait(lambda: observer.node.count_subscribers('range_profiles'), 'the subscription')
    observer.wait(lambda: observer.status(name).message == 'waiting for input', 'diagnostics')
    [metadata] = observer.wait_for('map_metadata', 1)
    # Who joins late gets it, too.
    [again] = make_observer().wait_for('map_metadata', 1)
    assert again == metadata

    assert observer.change_state(name, 'deactivate')
    observer.wait(lambda: not observer.node.count_subscribers('range_profiles'), 'its end')
    assert observer.change_state(name, 'cleanup')
    observer.wait(lambda: not observer.node.count_publishers('image_complex'), 'their end')
    assert observer.set_parameter(name, 'grid.spacing', 0.5) == (True, '')
    assert observer.change_state(name, 'configure')
    assert observer.change_state(name, 'activate')
    _, metadata = observer.wait_for('map_metadata', 2)
    assert map_metadata_from_message(metadata).shape == (21, 41)

    assert observer.change_state(name, 'shutdown')
    assert observer.state(name) == 'finalized'
    node.check()
    assert node.stop(name) == 0
    assert 'Traceback' not in node.log(name)


def test_wrong_values_at_the_start_can_be_corrected(start_node, make_observer):
    wrong = {'pulse_buffer': [('pulses_per_block', 0, '=0; expected a whole number', 16)],
             'range_compression': [('oversampling', 'two', "='two'; expected a number", 2),
                                   ('window', 'box', ": window='box' is unknown", 'hamming')]}
    nodes = {name: start_node(name, {'autostart': False} | {p: value for p, value, *_ in values})
             for name, values in wrong.items()}
    observer = make_observer()
    for name, values in wrong.items():
        for parameter, _, reason, possible in values:
            assert not observer.change_state(name, 'configure')
            assert (f'configuration refused: parameter {parameter}{reason}'
                    in nodes[name].log(name))
            assert observer.set_parameter(name, parameter, possible) == (True, '')
        assert observer.change_state(name, 'configure')
        assert observer.change_state(name, 'activate')
        nodes[name].wait_for_log(name, 'ready: ')
        for parameter, impossible, *_ in values:
            assert not observer.set_parameter(name, parameter, impossible)[0]


def test_a_node_deactivated_within_an_aperture_images_the_next_one(make_chain, psf):
    length = psf.truth['pulses_per_aperture']
    blocks = psf.blocks(25)
    chain = make_chain(psf.truth)
    observer = chain.observer
    [metadata] = observer.wait_for('map_metadata', 1)
    half = len(blocks) // 2
    observer.send(blocks[:half])
    n_sent = sum(b.n_pulses for b in blocks[:half])
    observer.wait_for_progress('backprojection', n_sent - 1)
    assert observer.change_state('backprojection', 'deactivate')
    chain.wait_for_log('backprojection', f'deactivated: dropped 0 pulses that waited and {n_sent}')
    observer.wait_for_counters('backprojection', pulses_discarded=n_sent, images_published=0)
    assert observer.status('backprojection').message == 'inactive'

    assert observer.change_state('backprojection', 'activate')
    chain.wait_for_log('backprojection', 'publisher on /range_profiles joined', 2)
    chain.wait_for_log('range_compression', 'subscriber on .* joined', 2)
    observer.send(psf.later(blocks, 1))
    [image] = observer.wait_for('image_complex', 1)
    chain.wait_for_log('backprojection', f'aperture 1: {length} pulses, missing none')
    grid = map_metadata_from_message(metadata)
    error_db = psf.error_db(complex_from_message(image), grid, np.arange(length))
    assert error_db < LARGEST_ERROR_DB


def test_ctrl_c_in_the_midst_of_long_work(ros_environment, make_observer, psf, tmp_path):
    """Nobody would receive what the work gives, and launch kills a process after 10 s."""
    log = tmp_path / 'log'
    with log.open('wb') as file:
        process = subprocess.Popen([sys.executable, '-c', SLOW_NODE], stdout=file, stderr=file,
                                   env=ros_environment)
    try:
        observer = make_observer('pulse_blocks')
        observer.wait(lambda: observer.joined or process.poll() is not None, 'the subscription')
        assert process.poll() is None, log.read_text()
        observer.send(psf.blocks(25)[:1])
        observer.wait(lambda: b'busy' in log.read_bytes(), 'the block in work')
        process.send_signal(signal.SIGINT)
        assert process.wait(60.0) == 0
    finally:
        process.kill()
    assert 'Traceback' not in log.read_text()


def test_images_on_request_and_reset(make_chain, spotlight):
    chain = make_chain(spotlight.truth, backprojection={'aperture_timeout_s': 3600.0})
    observer = chain.observer
    [metadata] = observer.wait_for('map_metadata', 1)
    blocks = spotlight.blocks(25)
    assert observer.trigger('backprojection/form_image') == (False, 'no aperture is being filled')

    observer.send(blocks[:4])
    observer.wait_for_progress('backprojection', 99)
    assert observer.trigger('backprojection/form_image') == (
        True, 'image of aperture 0: 100 pulses, missing 100..127 (28)')
    [image] = observer.wait_for('image_complex', 1)
    error_db = spotlight.error_db(complex_from_message(image),
                                  map_metadata_from_message(metadata), np.arange(100))
    assert error_db < LARGEST_ERROR_DB
    observer.wait_for_counters('backprojection', images_published=1, pulses_discarded=0)
    figures = observer.counters('backprojection')
    assert figures['predicted_error_db'] < LARGEST_ERROR_DB
    assert 0 < figures['last_image_seconds']
    assert 0 < figures['image_latency_seconds']
    assert 0 <= figures['queue_fill'] <= 1
    assert 10 < figures['memory_megabytes'] < 10_000

    observer.send([spotlight.pulses.select(slice(128, 138))])
    observer.wait_for_progress('backprojection', 137)
    successful, message = observer.trigger('backprojection/form_image')
    assert not successful
    assert 'fewer pulses than min_pulse_fraction=0.5' in message

    assert observer.set_parameter('pulse_buffer', 'flush_timeout_s', 3600.0) == (True, '')
    observer.send(spotlight.later([spotlight.pulses.select(slice(0, 100))], 2))
    observer.wait_for_progress('pulse_buffer', 355)
    assert observer.trigger('pulse_buffer/reset') == (
        True, 'dropped 0 pulses that waited and 100 underway')
    observer.wait_for_counters('pulse_buffer', pulses_discarded=100)
    assert observer.set_parameter('pulse_buffer', 'flush_timeout_s', 0.01) == (True, '')
    observer.send(spotlight.later([spotlight.pulses.select(slice(0, 80))], 3))
    observer.wait_for_progress('backprojection', 463)
    assert observer.trigger('backprojection/reset') == (
        True, 'dropped 0 pulses that waited and 80 underway')
    assert observer.trigger('range_compression/reset') == (True, 'no pulses were underway')

    observer.send(spotlight.later(blocks, 4))
    images = observer.wait_for('image_complex', 3)
    for image, first in zip(images[-2:], (0, 128), strict=True):
        error_db = spotlight.error_db(
            complex_from_message(image), map_metadata_from_message(metadata),
            np.arange(first, first + 128))
        assert error_db < LARGEST_ERROR_DB
    # Of aperture 1 too few pulses came, of aperture 2 none.
    observer.wait_for_counters('backprojection', images_published=3, apertures_dropped=2,
                               pulses_discarded=80, pulses_late=0)


def test_two_radars_side_by_side(make_chains, psf, spotlight):
    # The second one's pulses come on a topic of somebody else's choice.
    chains = make_chains(
        {'truth': psf.truth, 'namespace': 'radar1'},
        {'truth': spotlight.truth, 'namespace': 'radar2', 'pulses': '/antenna/pulses',
         'arguments': ['-r', 'pulses:=/antenna/pulses']})
    recordings = psf, spotlight
    for a, b in zip(psf.raw, spotlight.raw, strict=False):
        chains[0].observer.send([a])
        chains[1].observer.send([b])
    n_sent = min(len(psf.raw), len(spotlight.raw))
    for chain, recording in zip(chains, recordings, strict=True):
        chain.observer.send(recording.raw[n_sent:])
    for number, (chain, recording) in enumerate(zip(chains, recordings, strict=True), 1):
        truth, observer = recording.truth, chain.observer
        length = truth['pulses_per_aperture']
        n_images = truth['n_pulses'] // length
        images = observer.wait_for('image_complex', n_images)
        grid = map_metadata_from_message(observer.wait_for('map_metadata', 1)[0])
        for aperture, image in enumerate(images):
            counters = np.arange(aperture * length, (aperture + 1) * length)
            error_db = recording.error_db(complex_from_message(image), grid, counters)
            assert error_db < LARGEST_ERROR_DB
        observer.wait_for_counters(
            f'radar{number}/pulse_buffer', pulses_received=truth['n_pulses'], pulses_missing=0)
        observer.wait_for_counters(f'radar{number}/backprojection', images_published=n_images)
        assert observer.trigger('backprojection/reset') == (True, 'no pulses were underway')


def test_simulated_time_that_jumps_changes_nothing(make_chain, spotlight):
    simulated = {name: {'use_sim_time': True}
                 for name in ('pulse_buffer', 'range_compression', 'backprojection')}
    chain = make_chain(spotlight.truth, **simulated)
    observer = chain.observer
    clock = observer.node.create_publisher(Clock, '/clock', 10)
    observer.wait(lambda: clock.get_subscription_count() == 3, 'three readers of /clock')

    def set_time(second):
        message = Clock()
        message.clock.sec = second

        def all_read():
            clock.publish(message)  # again and again, as a player does: readers are best effort
            return set(simulated) == {
                a.status[0].name.split(':')[0] for a in observer.messages['/diagnostics']
                if a.header.stamp.sec == second}

        observer.wait(all_read, f'all nodes to read {second} s')

    blocks = spotlight.blocks(25)
    for loop in range(2):  # as a player in a loop, with leaps in the middle of an aperture
        observer.send(blocks[:3])
        observer.wait_for_progress('pulse_buffer', 74)
        set_time(100_000 + loop)
        set_time(1000 + loop)
        for name in simulated:
            chain.wait_for_log(name, r'time jumped back by 9.9e\+04 s', loop + 1)
        observer.send(blocks[3:])
        images = observer.wait_for('image_complex', 2 * (loop + 1))
    for first, again in zip(images[:2], images[2:], strict=True):
        assert again.header == first.header
        np.testing.assert_array_equal(complex_from_message(again), complex_from_message(first))
    observer.wait_for_counters('backprojection', images_published=4, restarts=1, pulses_late=0,
                               pulses_missing=0)
