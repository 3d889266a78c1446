# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What stays outside a full queue: whole apertures, whatever the blocks look like."""

import threading
import time

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='the package of the nodes needs ROS')

from sar_imaging.nodes.runtime.health import Tally
from sar_imaging.nodes.runtime.inlet import PulseBlocks
from sar_imaging.nodes.runtime.overload import APERTURES, BLOCKS, FAULTS, AgeLimit, Load
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters

LENGTH = 16
PATIENCE_S = 30.0
RADAR = RadarParameters(carrier_hz=1e10, bandwidth_hz=1e8, sample_rate_hz=2e8,
                        first_sample_delay_s=1e-6)


def block(first, last):
    counters = np.arange(first, last + 1)
    return PulseBlock(RADAR, True, counters, counters, np.zeros((len(counters), 1, 1)))


class Slow:
    """A worker that waits for `work` before each item; none of them is too old for it."""

    def __init__(self, policy, capacity):
        self.done, self.said = [], []  # pulses, and what the steps were told with the pulses done
        self._permits = threading.Semaphore(0)
        self._worked = threading.Semaphore(0)
        self._busy = threading.Semaphore(0)
        health = Tally('stage', counters=FAULTS, faults=FAULTS)
        health.warning = lambda text: None
        self.worker = Load(
            self._work, PulseBlocks(LENGTH),
            {'worker_queue_size': capacity, 'worker_queue_megabytes': 1.0, 'overload': policy,
             'max_age_s': 1e6}, health,
            lambda aperture: self.said.append((aperture, len(self.done))),
            on_error=lambda error: None)
        self.worker.start()

    def _work(self, item, kept, received_s):
        self._busy.release()
        self._permits.acquire(timeout=PATIENCE_S)
        self.done += kept.counter.tolist()
        self._worked.release()

    def put(self, first, last):
        """Counters of the pulses dropped by offering a block."""
        dropped = self.worker.offer(block(first, last), time.monotonic())
        return [c for b in dropped for c in b.counter.tolist()]

    def wait_until_busy(self):
        assert self._busy.acquire(timeout=PATIENCE_S)

    def work(self, n_blocks):
        for _ in range(n_blocks):
            self._permits.release()
            assert self._worked.acquire(timeout=PATIENCE_S)

    def finish(self):
        self._permits.release(100)
        self.worker.call(lambda: None).result(PATIENCE_S)

    def stop(self):
        self._permits.release(100)
        self.worker.stop()


@pytest.fixture
def make_slow():
    made = []

    def make(policy, capacity):
        made.append(Slow(policy, capacity))
        return made[-1]

    yield make
    for slow in made:
        slow.stop()


def pulses(first, last):
    return list(range(first, last + 1))


def test_the_newest_aperture_is_left_out_as_a_whole(make_slow):
    slow = make_slow(APERTURES, capacity=4)
    assert slow.put(0, 7) == []
    slow.wait_until_busy()
    for first in (8, 16, 20, 24):
        assert slow.put(first, first + (7 if first == 8 else 3)) == []
    assert slow.put(28, 31) == pulses(16, 31)  # three that waited, and itself
    assert slow.worker.skipped == 1
    slow.work(2)  # the rest of aperture 0
    slow.worker.call(lambda: None).result(PATIENCE_S)
    assert slow.said == [(1, 16)]
    assert slow.put(32, 47) == []
    slow.finish()
    assert slow.done == [*pulses(0, 15), *pulses(32, 47)]
    assert slow.said == [(1, 16), (None, 16)]


def test_no_aperture_begins_until_half_of_the_queue_is_free(make_slow):
    slow = make_slow(APERTURES, capacity=2)
    slow.put(0, 0)
    slow.wait_until_busy()
    assert [slow.put(c, c) for c in (1, 2)] == [[], []]
    assert slow.put(16, 16) == [16]
    assert slow.put(17, 31) == pulses(17, 31)
    assert slow.put(32, 33) == [32, 33]  # two blocks of aperture 0 wait
    assert slow.worker.skipped == 2
    slow.work(1)
    slow.wait_until_busy()
    assert slow.put(34, 47) == pulses(34, 47)
    assert slow.put(48, 49) == []
    slow.finish()
    assert slow.done == [0, 1, 2, 48, 49]


@pytest.mark.parametrize(('worked', 'admitted'), [(1, False), (9, False), (10, True)])
def test_the_next_aperture_waits_until_no_more_than_half_of_the_queue_waits(make_slow, worked,
                                                                            admitted):
    slow = make_slow(APERTURES, capacity=20)
    slow.put(0, 0)
    slow.wait_until_busy()
    for _ in range(20):
        assert slow.put(1, 1) == []
    assert slow.put(16, 16) == [16]
    for _ in range(worked):
        slow.work(1)
        slow.wait_until_busy()
    assert slow.worker.waiting == 20 - worked
    assert slow.put(32, 33) == ([] if admitted else [32, 33])
    assert slow.worker.skipped == (None if admitted else 2)


def test_blocks_across_apertures_are_divided(make_slow):
    slow = make_slow(APERTURES, capacity=2)
    slow.put(0, 0)
    slow.wait_until_busy()
    slow.put(1, 12)
    slow.put(13, 20)  # ends in aperture 1: its end leaves, the rest stays
    assert slow.put(21, 30) == pulses(21, 30)
    slow.work(2)
    assert slow.put(31, 40) == [31]
    slow.finish()
    assert slow.done == [*pulses(0, 20), *pulses(32, 40)]
    assert slow.said == [(1, 21), (None, 21)]


def test_a_recording_of_one_aperture_in_a_loop_gets_in_again(make_slow):
    slow = make_slow(APERTURES, capacity=1)
    slow.put(0, 7)
    slow.wait_until_busy()
    slow.put(8, 11)
    assert slow.put(12, 15) == pulses(8, 15)
    slow.work(1)
    assert slow.put(0, 7) == []  # the loop: from the end to the beginning
    slow.finish()
    assert slow.done == [*pulses(0, 7), *pulses(0, 7)]
    assert slow.said == [(0, 8), (None, 8)]


def test_a_late_block_of_the_aperture_left_out_does_not_hide_the_loop(make_slow):
    slow = make_slow(APERTURES, capacity=1)
    slow.put(0, 7)
    slow.wait_until_busy()
    slow.put(8, 11)
    assert slow.put(12, 15) == pulses(8, 15)
    assert slow.put(8, 8) == [8]  # half an aperture behind the furthest: late, no loop
    assert slow.worker.skipped == 0
    slow.work(1)
    assert slow.put(7, 10) == []  # further behind
    assert slow.worker.skipped is None
    slow.finish()
    assert slow.done == [*pulses(0, 7), *pulses(7, 10)]


def test_single_blocks_are_dropped_when_that_is_wanted(make_slow):
    slow = make_slow(BLOCKS, capacity=1)
    slow.put(0, 0)
    slow.wait_until_busy()
    assert [slow.put(c, c) for c in (1, 2)] == [[], [2]]
    slow.work(1)
    slow.wait_until_busy()
    assert slow.put(3, 3) == []
    slow.finish()
    assert slow.done == [0, 1, 3]
    assert slow.said == []


def fly(load_of, n_apertures=12, aperture_s=1.0, wanted_s=0.0, at_end=0.0):
    """Ages of the images, apertures left out, and when waiting was seen to grow.

    `load_of(aperture)` is work over duration; a share of it is done with the last block.
    """
    skipped, ages, growing, now = [], {}, [], 0.0
    limit = AgeLimit(PulseBlocks(LENGTH), skipped.append)
    for first in range(0, n_apertures * LENGTH, 2):
        number, received = first // LENGTH, (first + 2) / LENGTH * aperture_s
        item = block(first, first + 1)
        item.stamp_ns[:] = item.counter.astype(np.int64) * round(1e9 * aperture_s / LENGTH)
        now = max(now, received)
        if limit.admit(item, received, now, wanted_s)[0] is not None:
            last = at_end if (first + 2) % LENGTH == 0 else 0.0
            now += load_of(number) * ((1 - at_end) * 2 / LENGTH + last) * aperture_s
            ages[number] = now - received
        if limit.growing:
            growing.append(now)
    return {n: age for n, age in ages.items() if n not in skipped}, skipped, growing


@pytest.mark.parametrize('load', [1.1, 1.25, 1.5, 2.0])
def test_growing_waits_are_seen_within_two_apertures_and_as_long_as_they_last(load):
    *_, growing = fly(lambda number: load if 4 <= number < 8 else 0.5, n_apertures=20)
    assert 4 < growing[0] <= 6 + load * 2 / LENGTH  # and the work on a block
    assert growing[-1] < 12


@pytest.mark.parametrize('at_end', [0.0, 0.7])
@pytest.mark.parametrize('load', [0.5, 0.8])
def test_a_stage_that_keeps_up_does_not_fall_behind_where_it_gets_more_to_do(load, at_end):
    *_, growing = fly(lambda number: load if number > 4 else 0.2, at_end=at_end)
    assert not growing


@pytest.mark.parametrize(('load', 'left_out'), [(0.5, 0), (0.95, 0), (1.5, 3), (2.0, 5),
                                                (3.0, 7)])
def test_images_are_no_older_than_two_apertures_and_a_stage_that_keeps_up_loses_none(load,
                                                                                    left_out):
    ages, skipped, _ = fly(lambda number: load)
    # Work of three apertures for one is too slow: its images are the youngest that can be had.
    assert max(ages.values()) <= max(2.0, load)
    assert len(skipped) >= left_out and (left_out or not skipped)
    assert len(ages) + len(skipped) == 12


def test_the_aperture_after_one_that_was_left_out_hardly_waited():
    ages, skipped, _ = fly(lambda number: 1.5, n_apertures=60)
    # It waited for a quarter of the limit at most, half an aperture more at its end, and a block.
    assert all(ages[number] < 1.2 for number in ages if number - 1 in skipped)
    assert len(ages) >= 0.95 * 60 / 1.5  # as many images as can be


def test_work_that_is_far_too_slow_still_gives_images():
    ages, *_ = fly(lambda number: 5.0, n_apertures=30)
    assert len(ages) >= 4


def test_a_stage_that_fell_behind_catches_up_within_two_apertures():
    ages, skipped, _ = fly(lambda number: 2.0 if number < 4 else 0.5)
    assert max(skipped) <= 5
    assert all(ages[number] < 0.3 for number in range(6, 12))


def test_a_wrong_counter_within_a_block_is_no_aperture_to_compare_with():
    limit = AgeLimit(PulseBlocks(LENGTH), lambda aperture: None)
    for now, counters in enumerate(([0, 1], [16, 2**31, 17], [18, 19], [32, 33], [34, 35])):
        item = block(0, len(counters) - 1)
        item.counter[:] = counters
        assert limit.admit(item, now, now, 10.0)[0] is item
