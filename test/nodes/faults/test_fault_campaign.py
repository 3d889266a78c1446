# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Faults at random moments while pulses keep coming: the next aperture must be right.

FAULT_ROUNDS repeats every case with other random numbers and FAULT_SEED chooses them;
`make fault-campaign` does both. A failure names its seed.
"""

import os
import re
import signal
import time

import numpy as np
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float32MultiArray

from msg_conversions import WireFormatError, pulse_block
from sar_imaging.recordings import bag_io
from sar_imaging.tools.node_processes import AFBP_NODES, NODES, PIPELINE

from .flight import BLOCK, Flight

pytestmark = pytest.mark.campaign

FIRST_SEED = int(os.environ.get('FAULT_SEED', '5'))
SEEDS = range(FIRST_SEED, FIRST_SEED + int(os.environ.get('FAULT_ROUNDS', '1')))
DAMAGED_SHARE, DAMAGED_BYTES = 0.01, 5  # of messages, and of the bytes of one
IMAGE = (r'image of aperture (\d+): (?:\d+ sub-apertures, )?(\d+) pulses, '
         r'(?:(\d+) missing|missing (?:none|.*\((\d+)\)))')
DROPPED = r'\baperture (\d+) dropped: (\d+) of \d+ pulses'
SKIPPED = r'no pulse came of apertures (\d+)(?:\.\.(\d+))? \(\d+\)'


def with_setups(*setups):
    """Decorator: the test flies with these nodes, in these modes of backprojection."""
    return pytest.mark.parametrize(('names', 'mode', 'seed'), [
        pytest.param(names, mode, seed, id=f'{names[-1]}-{mode}-{seed}')
        for names, mode in setups for seed in SEEDS])


@pytest.fixture(name='rng')
def rng_fixture(seed):
    return np.random.default_rng(seed)


@pytest.fixture(name='flight')
def flight_fixture(make_chain, psf, names, mode):
    return Flight(make_chain(psf.truth, names=names, mode=mode), psf, mode)


def told_of(log):
    """Apertures that the imager tells about, with the pulses it has or lacks of each."""
    told = {}
    for number, n_pulses, *n_missing in re.findall(IMAGE, log):
        told[int(number)] = int(n_pulses), int(''.join(n_missing) or 0)
    for number, n_pulses in re.findall(DROPPED, log):
        told[int(number)] = int(n_pulses), None
    for first, last in re.findall(SKIPPED, log):
        told |= {number: (0, None) for number in range(int(first), int(last or first) + 1)}
    return told


@with_setups((AFBP_NODES, 'subapertures'), (PIPELINE, 'image'))
def test_nodes_killed_at_random_moments(flight, rng, names, mode):
    chain = flight.chain
    excused = set()
    imaging = [name for name in names if name in (*AFBP_NODES[2:], *PIPELINE)]

    def told():
        return told_of('\n'.join(chain.log(name) for name in imaging))

    for name in rng.permutation(sorted(chain.running)):
        flight.fly_messages(rng.integers(1, 12))
        killed_in = flight.aperture
        chain.kill(name)
        chain.start(name)
        # Discovery decides which aperture is the first to reach the new process whole.
        last = max(told())
        complete = flight.wait_for_complete_image(killed_in + 1, f'kill -9 of {name}')
        chain.check()  # no other node has ended
        flight.assert_next_aperture_right(f'the restart of {name}')
        if name in imaging:  # what it would have told died with it; its start is in the log
            excused |= set(range(last + 1, complete))
    assert set(range(max(told()) + 1)) - set(told()) <= excused
    # Fusion takes sub-apertures that never came for equally long ones.
    assert all(n_missing is None or n_pulses + n_missing == flight.length
               or (mode == 'subapertures' and n_pulses + n_missing >= flight.length)
               for n_pulses, n_missing in told().values())


# ------------------------------------------------------------------------- a bad stream

def overwrite(flight, rng, change):
    """Send the next message after `change` was applied to its floats or bytes."""
    flight.fly_messages(rng.integers(1, 7))
    cdr = bytearray(bag_io.serialise(flight.next_block()))
    change(cdr, cdr.index(np.float32(0x534152).tobytes()))  # where the data begin
    flight.observer.send([bytes(cdr)])


def put_float(cdr, at, value):
    cdr[at:at + 4] = np.float32(value).tobytes()


def bits_anywhere(flight, rng):
    def change(cdr, start):
        for at in rng.integers(4, len(cdr), 5):
            cdr[at] ^= 1 << rng.integers(8)
    overwrite(flight, rng, change)


def bits_of_the_layout(flight, rng):
    def change(cdr, start):
        cdr[rng.integers(4, start)] ^= 1 << rng.integers(8)
    overwrite(flight, rng, change)


def bits_of_the_header(flight, rng):
    def change(cdr, start):
        for at in rng.integers(start, start + 96, 2):
            cdr[at] ^= 1 << rng.integers(8)
    overwrite(flight, rng, change)


def cut_short(flight, rng):
    overwrite(flight, rng, lambda cdr, start: cdr.__delitem__(
        slice(int(rng.integers(start, len(cdr))), None)))


def not_a_number(flight, rng):
    overwrite(flight, rng, lambda cdr, start: put_float(
        cdr, start + 4 * int(rng.integers(24, (len(cdr) - start) // 4)), np.nan))


def epoch_beyond_ros_time(flight, rng):
    # The highest 16 bits: 2^62 ns, in the year 2116.
    overwrite(flight, rng, lambda cdr, start: put_float(cdr, start + 4 * 7, 0x4000))


def epoch_of_another_day(flight, rng):
    overwrite(flight, rng, lambda cdr, start: put_float(cdr, start + 4 * 6, 77))


def huge_counter(flight, rng):
    # The higher 16 bits of the first pulse's counter.
    overwrite(flight, rng, lambda cdr, start: put_float(
        cdr, start + 4 * 25, rng.integers(2, 60_000)))


def energy_without_end(flight, rng):
    overwrite(flight, rng, lambda cdr, start: put_float(cdr, len(cdr) - 4, 1e30))


def burst(flight, rng):
    """Four apertures at many times the radar's rate."""
    for _ in range(4 * len(flight.blocks)):
        flight.send_next()


def lost_and_repeated(flight, rng):
    flight.fly_messages(rng.integers(1, 7))
    block = flight.next_block()
    flight.next_block()
    flight.observer.send([block] * 4)


def recording_begins_again(flight, rng):
    """A player in a loop, cut off within an aperture."""
    flight.fly_messages(rng.integers(1, 7))
    flight.begin_again()


def radar_restarts(flight, rng):
    """Counters begin anew and time goes on."""
    flight.fly_messages(rng.integers(1, 7))
    flight.clock_s += flight.aperture + 60
    flight.begin_again()


def radar_clock_jumps(flight, rng):
    """As after the first fix of a satellite receiver, forwards and backwards."""
    flight.fly_messages(rng.integers(1, 7))
    flight.clock_s += int(rng.integers(-10_000, 10_000))


def silence(flight, rng):
    """Longer than pulse_buffer holds pulses back."""
    flight.fly_messages(rng.integers(1, 7))
    until = time.monotonic() + 0.7
    flight.observer.wait(lambda: time.monotonic() > until, 'a pause')


def wrong_quality_of_service(flight, rng):
    flight.observer.node.create_publisher(
        Float32MultiArray, 'pulses', QoSProfile(depth=1,
                                                reliability=ReliabilityPolicy.BEST_EFFORT))


DISTURBANCES = (bits_anywhere, bits_of_the_layout, bits_of_the_header, cut_short, not_a_number,
                epoch_beyond_ros_time, epoch_of_another_day, huge_counter, energy_without_end,
                burst, lost_and_repeated, recording_begins_again, radar_restarts,
                radar_clock_jumps, silence, wrong_quality_of_service)
REJECTED = (epoch_beyond_ros_time,)  # whatever the random numbers are


@with_setups((NODES, 'image'), (PIPELINE, 'subapertures'))
def test_a_bad_stream(flight, rng, names):
    for disturb in rng.permutation(DISTURBANCES):
        disturb(flight, rng)
        # What was sent of this aperture may be spoiled, and its rest be of two.
        flight.finish_aperture()
        flight.assert_next_aperture_right(disturb.__name__)
        flight.chain.check()
    observer, first = flight.observer, names[0]
    part = 'stage' if first == 'pulse_buffer' else 'pulse_buffer'

    def counters():
        return observer.counters(first) | observer.counters(first, part)

    least = {'blocks_rejected': len(REJECTED), 'pulses_missing': BLOCK, 'restarts': 2,
             'pulses_duplicate': 3 * BLOCK, 'pulses_corrupt': 1, 'qos_incompatible': 1}
    observer.wait(lambda: all(counters().get(key, 0) >= value for key, value in least.items()),
                  f'reports of {least}')
    for name in flight.chain.running:
        assert observer.counters(name)['errors'] == 0, flight.chain.log(name)


@with_setups((NODES, 'image'), (PIPELINE, 'subapertures'))
def test_one_percent_of_the_messages_damaged(flight, rng, names):
    rejected = []

    def damage(cdr):
        if rng.random() >= DAMAGED_SHARE:
            return cdr
        damaged = bytearray(cdr)
        for at in rng.integers(4, len(cdr), DAMAGED_BYTES):
            damaged[at] = rng.integers(256)
        try:
            message = deserialize_message(bytes(damaged), Float32MultiArray)
            pulse_block.from_message(message)
        except WireFormatError as error:
            rejected.append(str(error))
        except Exception:  # what the middleware drops fails in many ways
            pass
        return bytes(damaged)

    flight.damage = damage
    flight.fly_messages(1000)
    flight.damage = bytes
    flight.assert_next_aperture_right('damaged messages')
    flight.chain.check()
    flight.observer.wait_for_counters(names[0], blocks_rejected=len(rejected))
    for name in flight.chain.running:
        assert flight.observer.counters(name)['errors'] == 0, flight.chain.log(name)


# ------------------------------------------------------------------------- the end, the beginning

@with_setups((AFBP_NODES, 'subapertures'), (PIPELINE, 'image'))
def test_ctrl_c_while_imaging_and_late_joiners(flight, rng):
    names = sorted(flight.chain.running)
    flight.fly_messages(rng.integers(1, 12))
    for name in rng.permutation(names):
        flight.fly_messages(rng.integers(0, 5))
        flight.chain.signal(name, signal.SIGINT)
    for name in names:
        assert flight.chain.exit_code(name) == 0, flight.chain.log(name)
    for name in rng.permutation(names):  # in any order, while pulses come
        flight.chain.start(name)
        flight.fly_messages(rng.integers(0, 20))
    flight.wait_for_complete_image(flight.aperture, 'a new start')
    flight.assert_next_aperture_right('a new start')
