# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A bad day: lost, repeated, swapped and broken blocks, killed nodes, wrong settings."""

import dataclasses
import signal

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float32MultiArray
from std_srvs.srv import Trigger

from msg_conversions.images import complex_from_message, map_metadata_from_message
from sar_imaging.recordings import bag_io
from sar_imaging.tools.node_processes import held_segments, parameters_from_truth

from ... import fork_server

LARGEST_ERROR_DB = -80.0  # what backprojection plans for by default


def changed(raw, change):
    """Serialised message after `change` was applied to the message."""
    message = deserialize_message(raw, Float32MultiArray)
    change(message)
    return serialize_message(message)


def random_bytes(message):
    """Overwrite a part of the samples with noise, as a broken memory or cable would."""
    data = np.frombuffer(message.data, np.uint8)
    data[-40_000:-30_000] = np.random.default_rng(3).integers(0, 256, 10_000, np.uint8)


def cut_data(message):
    del message.data[-1000:]


def wrong_magic(message):
    message.data[0] = 1.0


def with_huge_sample(raw, row):
    """Finite, but its energy is not: a bit flipped in the exponent of one sample."""
    block = bag_io.deserialise(raw)
    samples = block.samples.copy()
    samples[row, 2, 100] = 1e30
    return bag_io.serialise(dataclasses.replace(block, samples=samples))


def test_lost_repeated_swapped_and_broken_blocks(make_chain, spotlight):
    # 256 pulses in blocks of 25, apertures 0..127 and 128..255.
    raw = [bag_io.serialise(b) for b in spotlight.blocks(25)]
    stream = [raw[0], raw[1],                                   # 50..74 lost
              raw[3], raw[3],                                   # 75..99 twice
              changed(raw[4], cut_data),                        # 100..124 cut short
              raw[5], raw[7], raw[6],                           # 150..199 swapped
              changed(raw[8], random_bytes),                    # 222 and 223 overwritten
              changed(raw[8], wrong_magic), b'\x00\x01\x00\x00garbage',
              with_huge_sample(raw[9], row=5), raw[10]]         # 230 broken
    lost = np.r_[50:75, 100:125, 222, 223, 230]
    survivors = np.setdiff1d(np.arange(256), lost)

    chain = make_chain(spotlight.truth)
    chain.observer.send(stream)
    images = chain.observer.wait_for('image_complex', 2)
    grid = map_metadata_from_message(chain.observer.wait_for('map_metadata', 1)[0])
    for message, (first, last) in zip(images, [(0, 128), (128, 256)], strict=True):
        inside = survivors[(first <= survivors) & (survivors < last)]
        error_db = spotlight.error_db(complex_from_message(message), grid, inside)
        assert error_db < LARGEST_ERROR_DB

    # The garbage is no message at all: the middleware drops it before a node can see it.
    chain.observer.wait_for_counters(
        'pulse_buffer', blocks_received=12, blocks_rejected=2, blocks_dropped=0,
        pulses_received=25 * 9 + 6, pulses_emitted=len(survivors), pulses_missing=len(lost),
        pulses_duplicate=25, pulses_late=0, pulses_corrupt=3, restarts=0, errors=0)
    chain.observer.wait_for_counters(
        'backprojection', images_published=2, pulses_imaged=len(survivors),
        pulses_missing=len(lost), pulses_missing_in_last_aperture=3, errors=0)
    assert chain.observer.status('pulse_buffer').level > DiagnosticStatus.OK
    assert chain.observer.status('backprojection').level > DiagnosticStatus.OK

    log = chain.log('pulse_buffer')
    for text in ('pulses 50..74 missing (25)', 'pulses 100..124 missing (25)',
                 'pulses 222..223 missing (2)', 'pulses 230 missing (1)',
                 'dropped duplicate pulses: 75..99 (25)',
                 'below 2e+13: 222..223 (2)', 'below 2e+13: 230 (1)',
                 'magic number'):
        assert text in log
    assert log.count('rejected a message of /pulses: ') == 2
    chain.wait_for_log('backprojection',
                       r'aperture 0: 78 pulses, missing 50\.\.74, 100\.\.124 \(50\)')
    chain.wait_for_log('backprojection',
                       r'aperture 1: 125 pulses, missing 222\.\.223, 230 \(3\)')


@pytest.mark.parametrize('value', [np.nan, 1e15])
def test_corrupt_profiles_cost_their_pulse_alone(start_node, make_observer, psf, value):
    """Of a range compression of one's own: nothing else has looked at them before."""
    blocks = psf.blocks(25)
    samples = blocks[1].samples.copy()
    samples[4, 0, 3] = value
    blocks[1] = dataclasses.replace(blocks[1], samples=samples)
    node = start_node('backprojection', parameters_from_truth(psf.truth)['backprojection'])
    observer = make_observer('range_profiles')
    observer.wait(lambda: observer.joined, 'a subscriber of the profiles')
    observer.send(blocks)
    image = complex_from_message(observer.wait_for('image_complex', 1)[0])
    grid = map_metadata_from_message(observer.wait_for('map_metadata', 1)[0])
    others = np.setdiff1d(np.arange(200), [29])
    assert psf.error_db(image, grid, others) < LARGEST_ERROR_DB
    observer.wait_for_counters('backprojection', pulses_corrupt=1, blocks_rejected=0)
    node.wait_for_log('backprojection', r'numbers below 2e\+13: 29 \(1\)')


def test_any_node_killed_and_restarted_while_the_others_live_on(make_chain, psf):
    truth, blocks = psf.truth, psf.blocks(25)
    length = truth['pulses_per_aperture']
    chain = make_chain(truth)
    observer = chain.observer
    grid = map_metadata_from_message(observer.wait_for('map_metadata', 1)[0])

    for number, name in enumerate(('pulse_buffer', 'range_compression', 'backprojection')):
        disturbed = psf.later(blocks, 2 * number)
        whole = psf.later(blocks, 2 * number + 1)
        half = len(blocks) // 2
        observer.send(disturbed[:half])
        last = int(disturbed[half - 1].counter[-1])
        observer.wait_for_progress('pulse_buffer', last)
        chain.kill_and_restart(name)
        observer.send(disturbed[half:] + whole)

        stamp = np.mean([b.stamp_ns[[0, -1]].astype(float) for b in (whole[0], whole[-1])])
        [image] = observer.wait(
            lambda t=stamp: [m for m in observer.messages['image_complex']
                             if abs(m.header.stamp.sec * 1e9 + m.header.stamp.nanosec - t) < 1e8],
            f'the aperture after the restart of {name}')
        chain.wait_for_log('backprojection', f'image of aperture {2 * number + 1}: '
                           f'{length} pulses, missing none')
        error_db = psf.error_db(complex_from_message(image), grid, np.arange(length))
        assert error_db < LARGEST_ERROR_DB, name
        chain.check()  # no other node has ended


def test_input_that_pauses_is_reported_and_its_aperture_closed(make_chain, spotlight):
    chain = make_chain(spotlight.truth, pulse_buffer={'stall_timeout_s': 1.0},
                       backprojection={'aperture_timeout_s': 1.0})
    blocks = spotlight.blocks(25)
    chain.observer.send(blocks[:4])
    [image] = chain.observer.wait_for('image_complex', 1)
    assert image.header.frame_id == 'map'
    chain.wait_for_log('backprojection', r'aperture 0: 100 pulses, missing 100\.\.127')
    chain.wait_for_log('pulse_buffer', 'input stalled: nothing on /pulses')
    chain.observer.send(blocks[4:6])
    chain.wait_for_log('pulse_buffer', 'input continues')
    # 100..127 come after their aperture was imaged.
    chain.observer.wait_for_counters('backprojection', pulses_late=28, apertures_dropped=1)
    chain.wait_for_log('backprojection', r'closed before: 100\.\.127 \(28\)')


def test_a_full_queue_is_counted_and_logged(make_chain, spotlight):
    # After its window the buffer publishes 128 blocks at once, while compression is planned.
    chain = make_chain(spotlight.truth, pulse_buffer={'pulses_per_block': 1},
                       range_compression={'worker_queue_size': 1, 'overload': 'drop_blocks'})
    observer = chain.observer
    observer.send(spotlight.blocks(8))
    observer.wait(lambda: observer.counters('range_compression').get('blocks_dropped', 0) > 0,
                  'dropped blocks')
    chain.wait_for_log('range_compression', 'dropped pulses .* wait already')


@pytest.mark.usefixtures('whole_end')
def test_ctrl_c_ends_a_node_orderly_even_twice(start_node):
    # tests of the other two, which need files, have such an end as well
    nodes = {name: start_node(name) for name in fork_server.NODES
             if name not in ('localization', 'radar_driver')}
    for name, node in nodes.items():
        node.wait_for_log(name, 'activation done')
        node.signal(name, signal.SIGINT)
        node.signal(name, signal.SIGINT)  # as `ros2 launch` forwards it
    for name, node in nodes.items():
        assert node.exit_code(name) == 0, node.log(name)
        assert 'Traceback' not in node.log(name)


@pytest.mark.parametrize('deactivated', [False, True])
def test_the_end_while_blocks_and_a_service_wait(start_node, make_observer, psf, deactivated):
    # Large enough that work on the blocks sent takes seconds.
    parameters = parameters_from_truth(psf.truth)['backprojection']
    node = start_node('backprojection', parameters | {'grid.size_y': 400.0, 'grid.spacing': 0.02})
    observer = make_observer('range_profiles')
    observer.wait(lambda: observer.joined, 'the subscription')
    client = observer.node.create_client(Trigger, 'backprojection/form_image')
    observer.wait(client.service_is_ready, 'the service')
    observer.send([b for n in range(4) for b in psf.later(psf.blocks(25), n)])
    observer.wait_for('backprojection/progress', 1)
    answer = client.call_async(Trigger.Request())
    observer.wait_for('backprojection/progress', len(observer.messages['backprojection/progress'])
                      + 2)
    assert not answer.done()
    segments = held_segments(node.pid('backprojection'))
    assert sum(s.stat().st_size for s in segments) > 16 * 2**20  # `small_segments` are so large
    if deactivated:
        assert observer.change_state('backprojection', 'deactivate')
        observer.wait(answer.done, 'the answer')
        assert answer.result().message == 'the node was deactivated meanwhile'
        node.wait_for_log('backprojection', r'deactivated: dropped [1-9]\d+ pulses that waited')
    node.signal('backprojection', signal.SIGINT)
    assert node.exit_code('backprojection') == 0, node.log('backprojection')
    assert 'image of aperture 3' not in node.log('backprojection')
    assert 'Traceback' not in node.log('backprojection')
    assert not [segment for segment in segments if segment.exists()]


IMPOSSIBLE = [
    ('pulse_buffer', {'pulses_per_block': 0},
     'parameter pulses_per_block=0; expected a whole number from 1 to 65536 (pulses)'),
    ('pulse_buffer', {'flush_timeout_s': 'soon'},
     "parameter flush_timeout_s='soon'; expected a number from 0.01 to 3600.0 (s)"),
    ('pulse_buffer', {'qos_overrides./pulses.subscription.reliability': 'sometimes'},
     'QoS override of pulses'),
    ('range_compression', {'window': 'box'}, "window='box' is unknown; use one of none"),
    ('backprojection', {'grid.spacing': 0.001}, 'raise grid.spacing=0.001, or max_image_pixels'),
    ('backprojection', {'pulses_per_aperture': 1.5},
     'parameter pulses_per_aperture=1.5; expected a whole number'),
]


def test_an_impossible_parameter_ends_the_node_with_one_clear_line(start_node):
    nodes = [start_node(name, parameters) for name, parameters, _ in IMPOSSIBLE]
    for node, (name, _, message) in zip(nodes, IMPOSSIBLE, strict=True):
        assert node.exit_code(name) == 1
        [line] = [line for line in node.log(name).splitlines() if '[INFO]' not in line]
        assert '[ERROR]' in line
        assert f'[{name}]: ' in line
        assert message in line


def test_a_whole_number_is_accepted_for_a_double(start_node):
    node = start_node('backprojection', {'grid.spacing': 1, 'grid.size_x': 20,
                                         'grid.size_y': 10, 'grid.centre_x': -5})
    node.wait_for_log('backprojection', r'21 x 11 pixels of 1 m around \(-5, 0, 0\) m')
