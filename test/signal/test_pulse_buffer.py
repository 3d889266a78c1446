# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Ordering, gaps, duplicates, restarts and block boundaries of the pulse buffer."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from sar_imaging.signal.pulses import PulseBlock, concatenate
from sar_imaging.signal.pulses.buffer import PulseBuffer
from sar_imaging.signal.pulses.sequence import COUNTER_MASK, counter_distance, describe_counters
from sar_imaging.signal.radar import RadarParameters

RADAR = RadarParameters(carrier_hz=10e9, bandwidth_hz=300e6, sample_rate_hz=400e6,
                        first_sample_delay_s=60e-6)
INTERVAL_NS = 1_000_000
WRAP = COUNTER_MASK + 1


def make_block(counters, *, epoch_ns=0, radar=RADAR, channels=2):
    """Pulses whose samples and positions carry their own number; time follows the counter."""
    counters = np.asarray(counters, np.int64)
    samples = np.empty((len(counters), channels, 3), np.complex64)
    samples[:] = (counters & 0xFFFF)[:, None, None] * (1 + 2j)
    positions = np.empty((len(counters), channels, 3))
    positions[:] = counters[:, None, None] / 7.0
    return PulseBlock(radar, False, epoch_ns + counters * INTERVAL_NS,
                      (counters & COUNTER_MASK).astype(np.uint32), samples, positions, positions)


def run(buffer, blocks):
    emitted = [b for block in blocks for b in buffer.push(block)]
    return emitted + buffer.flush()


def numbers(blocks):
    return np.concatenate([b.counter for b in blocks]).tolist() if blocks else []


def texts(buffer, kind):
    return [e.text for e in buffer.take_events() if e.kind == kind]


def balanced(buffer):
    s = buffer.statistics
    return s.received == s.emitted + s.duplicate + s.late + s.corrupt + buffer.held_pulses


@st.composite
def disturbed_streams(draw):
    """Pulses dropped, repeated and moved by at most the window, in blocks of any size."""
    window = draw(st.integers(0, 20))
    first = draw(st.sampled_from([0, 5, 1000, WRAP - 40]))
    total = draw(st.integers(1, 120))
    # Drawn for all pulses at once, as bits and as bytes: one draw each was seven times as slow.
    kept = draw(st.integers(1, 2**total - 1))
    counters = [first + i for i in range(total) if kept >> i & 1]
    # A pulse sorted by counter + delay, delay <= window, is never more than the window behind.
    repeated = draw(st.lists(st.sampled_from(counters), max_size=20))
    n = len(counters) + len(repeated)
    delays = draw(st.binary(min_size=n, max_size=n))
    arrivals = [(c + delay % (window + 1), c)
                for c, delay in zip(counters + repeated, delays, strict=True)]
    order = [c for _, c in sorted(arrivals, key=lambda a: a[0])]
    sizes = draw(st.lists(st.integers(1, 40), min_size=1, max_size=10))
    blocks, start = [], 0
    while start < len(order):
        size = sizes[len(blocks) % len(sizes)]
        blocks.append(order[start:start + size])
        start += size
    return window, counters, len(repeated), blocks


@settings(max_examples=300, deadline=None)
@given(stream=disturbed_streams(), per_aperture=st.integers(1, 70), per_block=st.integers(1, 40))
def test_every_surviving_pulse_comes_out_once_and_in_order(stream, per_aperture, per_block):
    window, counters, n_repeated, blocks = stream
    buffer = PulseBuffer(pulses_per_aperture=per_aperture, pulses_per_block=per_block,
                         reorder_window_pulses=window)
    emitted = run(buffer, [make_block(b) for b in blocks])

    result, expected = concatenate(emitted), make_block(counters)
    for field in ('counter', 'stamp_ns', 'samples', 'tx_m', 'rx_m'):
        np.testing.assert_array_equal(getattr(result, field), getattr(expected, field))

    s = buffer.statistics
    assert s.received == len(counters) + n_repeated
    assert (s.emitted, s.duplicate, s.late, s.corrupt) == (len(counters), n_repeated, 0, 0)
    assert s.missing == counters[-1] - counters[0] + 1 - len(counters)
    assert (s.restarts, buffer.held_pulses) == (0, 0)

    def place(counter):
        number = int(counter)
        return number // per_aperture, number % per_aperture // per_block

    places = [{place(c) for c in b.counter} for b in emitted]
    assert all(len(p) == 1 for p in places), 'a block spans two places of an aperture'
    assert all(a != b for a, b in itertools.pairwise(places)), 'a block was cut too early'


@settings(max_examples=100, deadline=None)
@given(order=st.lists(st.integers(0, 300), min_size=1, max_size=100), size=st.integers(1, 9),
       window=st.integers(0, 30))
def test_statistics_add_up_for_any_stream(order, size, window):
    buffer = PulseBuffer(pulses_per_aperture=50, pulses_per_block=8, reorder_window_pulses=window)
    for start in range(0, len(order), size):
        buffer.push(make_block(order[start:start + size]))
        assert balanced(buffer)
    buffer.flush()
    assert balanced(buffer)
    assert buffer.held_pulses == 0


def test_blocks_are_cut_at_multiples_of_the_block_length_and_at_apertures():
    buffer = PulseBuffer(pulses_per_aperture=50, pulses_per_block=32, reorder_window_pulses=0)
    emitted = run(buffer, [make_block(range(0, 40)), make_block(range(40, 120))])
    assert [(int(b.counter[0]), b.n_pulses) for b in emitted] == [
        (0, 32), (32, 18), (50, 32), (82, 18), (100, 20)]
    assert buffer.statistics.apertures_started == 3


def test_a_block_is_emitted_when_its_last_pulse_came():
    buffer = PulseBuffer(pulses_per_aperture=64, pulses_per_block=32, reorder_window_pulses=16)
    assert numbers(buffer.push(make_block(range(0, 31)))) == []
    assert numbers(buffer.push(make_block([31]))) == list(range(32))
    assert numbers(buffer.push(make_block(range(32, 64)))) == list(range(32, 64))


def test_a_block_with_missing_end_is_emitted_once_the_window_passed():
    buffer = PulseBuffer(pulses_per_aperture=64, pulses_per_block=32, reorder_window_pulses=8)
    assert numbers(buffer.push(make_block(range(0, 30)))) == []
    assert numbers(buffer.push(make_block(range(32, 39)))) == []
    assert numbers(buffer.push(make_block(range(39, 42)))) == list(range(30))
    assert texts(buffer, 'missing') == ['pulses 30..31 missing (2)']


def test_blocks_in_order_are_passed_on_without_copying_samples():
    buffer = PulseBuffer(pulses_per_aperture=64, pulses_per_block=32, reorder_window_pulses=0)
    block = make_block(range(64))
    first, second = run(buffer, [block])
    assert np.shares_memory(first.samples, block.samples)
    assert np.shares_memory(second.samples, block.samples)


def test_the_number_wraps_around_like_the_radar_counter():
    buffer = PulseBuffer(pulses_per_aperture=1000, pulses_per_block=32, reorder_window_pulses=4)
    emitted = run(buffer, [make_block(range(WRAP - 10, WRAP - 2)),
                           make_block(range(WRAP + 3, WRAP + 12))])
    assert numbers(emitted) == [*range(WRAP - 10, WRAP - 2), *range(3, 12)]
    assert texts(buffer, 'missing') == [f'pulses {WRAP - 2}..2 missing (5)']
    assert all(len({int(c) // 1000 for c in b.counter}) == 1 for b in emitted)
    assert buffer.statistics.restarts == 0


def test_a_jump_forward_is_a_gap_reported_once():
    buffer = PulseBuffer(pulses_per_aperture=64, reorder_window_pulses=16)
    emitted = run(buffer, [make_block(range(120)), make_block(range(145, 260))])
    assert numbers(emitted) == [*range(120), *range(145, 260)]
    assert texts(buffer, 'missing') == ['pulses 120..144 missing (25)']
    assert buffer.statistics.missing == 25


def test_a_jump_of_a_billion_pulses_costs_no_memory():
    buffer = PulseBuffer(pulses_per_aperture=64, reorder_window_pulses=16)
    run(buffer, [make_block(range(32)), make_block(range(10**9, 10**9 + 32))])
    assert buffer.statistics.missing == 10**9 - 32


def test_late_pulses_are_told_from_duplicates():
    buffer = PulseBuffer(pulses_per_aperture=64, reorder_window_pulses=16)
    emitted = run(buffer, [make_block([*range(20), *range(24, 64)]), make_block([22, 23, 40]),
                           make_block(range(64, 70))])
    assert numbers(emitted) == [*range(20), *range(24, 70)]
    s = buffer.statistics
    assert (s.missing, s.late, s.duplicate) == (4, 2, 1)
    events = buffer.take_events()
    assert 'dropped pulses that came late: 22..23 (2)' in [e.text for e in events]
    assert 'dropped duplicate pulses: 40 (1)' in [e.text for e in events]


def test_the_start_within_an_aperture_is_reported():
    buffer = PulseBuffer(pulses_per_aperture=200, reorder_window_pulses=0)
    run(buffer, [make_block(range(232, 300))])
    assert texts(buffer, 'start') == ['pulse sequence starts at 232, 32 pulses into its aperture']


def test_after_a_flush_the_sequence_goes_on():
    buffer = PulseBuffer(pulses_per_aperture=64, reorder_window_pulses=16)
    emitted = run(buffer, [make_block(range(40))]) + run(buffer, [make_block(range(50, 64))])
    assert [(int(b.counter[0]), b.n_pulses) for b in emitted] == [(0, 32), (32, 8), (50, 14)]
    assert texts(buffer, 'missing') == ['pulses 40..49 missing (10)']


def test_a_looping_recording_begins_a_new_sequence_reported_once():
    buffer = PulseBuffer(pulses_per_aperture=50, reorder_window_pulses=32)
    recording = [make_block(range(i, i + 32)) for i in range(0, 192, 32)]
    emitted = run(buffer, recording * 3)
    assert numbers(emitted) == list(range(192)) * 3
    s = buffer.statistics
    assert (s.restarts, s.late, s.duplicate, s.missing) == (2, 0, 0, 0)
    assert len(texts(buffer, 'restart')) == 2


def test_a_recording_that_loops_with_its_last_block_is_seen_on_flush():
    buffer = PulseBuffer(pulses_per_aperture=50, reorder_window_pulses=8)
    emitted = run(buffer, [make_block(range(100)), make_block(range(20))])
    assert numbers(emitted) == [*range(100), *range(20)]
    assert buffer.statistics.restarts == 1


def test_a_restarted_radar_is_known_by_old_counters_with_new_times():
    buffer = PulseBuffer(pulses_per_aperture=50, reorder_window_pulses=128)
    # 40 pulses back is inside the window: only the time tells that these are new pulses.
    emitted = run(buffer, [make_block(range(60)),
                           make_block(range(20), epoch_ns=10**10),
                           make_block(range(20, 40), epoch_ns=10**10)])
    assert numbers(emitted) == [*range(60), *range(40)]
    assert buffer.statistics.restarts == 1


def test_a_straggling_block_is_late_and_does_not_restart_the_sequence():
    buffer = PulseBuffer(pulses_per_aperture=50, reorder_window_pulses=16)
    emitted = run(buffer, [make_block(range(32, 192)), make_block(range(0, 32)),
                           make_block(range(192, 224))])
    assert numbers(emitted) == list(range(32, 224))
    s = buffer.statistics
    assert (s.restarts, s.late, s.missing) == (0, 32, 0)
    assert texts(buffer, 'late') == ['dropped pulses that came late: 0..31 (32)']


def test_a_wild_counter_costs_one_block_and_not_the_rest_of_the_stream():
    buffer = PulseBuffer(pulses_per_aperture=64, reorder_window_pulses=16)
    stray = dataclasses.replace(make_block(range(64, 96)),
                                counter=np.arange(5_000_000, 5_000_032, dtype=np.uint32))
    emitted = run(buffer, [make_block(range(64)), stray, make_block(range(96, 192))])
    assert numbers(emitted) == [*range(64), *range(5_000_000, 5_000_032), *range(96, 192)]


@pytest.mark.parametrize('change', [
    {'radar': dataclasses.replace(RADAR, carrier_hz=9e9)}, {'channels': 3}])
def test_a_changed_configuration_flushes_and_begins_anew(change):
    buffer = PulseBuffer(pulses_per_aperture=64, reorder_window_pulses=16)
    emitted = run(buffer, [make_block(range(40)), make_block(range(40, 64), **change)])
    assert numbers(emitted) == list(range(64))
    assert [b.n_pulses for b in emitted] == [32, 8, 24]
    assert buffer.statistics.configuration_changes == 1
    assert len(texts(buffer, 'configuration')) == 1


@pytest.mark.parametrize('value', [np.nan, np.inf, 1e25, 1e15])
def test_pulses_with_impossible_samples_are_dropped_and_missing(value):
    buffer = PulseBuffer(pulses_per_aperture=64, reorder_window_pulses=0)
    block = make_block(range(64))
    block.samples[10:12, 1, 2] = value
    emitted = run(buffer, [block])
    assert numbers(emitted) == [*range(10), *range(12, 64)]
    assert (buffer.statistics.corrupt, buffer.statistics.missing) == (2, 2)
    assert balanced(buffer)
    events = {e.kind: e.text for e in buffer.take_events()}
    assert '10..11 (2)' in events['corrupt']
    assert events['missing'] == 'pulses 10..11 missing (2)'


def test_a_block_without_positions_is_refused():
    block = dataclasses.replace(make_block(range(4)), tx_m=None, rx_m=None)
    with pytest.raises(ValueError, match='no phase centres; .* or set pose.source to odometry'):
        PulseBuffer(pulses_per_aperture=4).push(block)
    buffer = PulseBuffer(pulses_per_aperture=4, positions_required=False)
    assert numbers(run(buffer, [block])) == [0, 1, 2, 3]


@pytest.mark.parametrize('arguments', [
    {'pulses_per_aperture': 0}, {'pulses_per_aperture': 1, 'pulses_per_block': 0},
    {'pulses_per_aperture': 1, 'reorder_window_pulses': -1}])
def test_impossible_lengths_are_refused(arguments):
    with pytest.raises(ValueError, match=next(reversed(arguments))):
        PulseBuffer(**arguments)


def test_counter_distance_crosses_the_wrap():
    assert counter_distance(np.array([0, 5], np.uint32), WRAP - 3).tolist() == [3, 8]
    assert int(counter_distance(WRAP - 3, 0)) == -3


def test_long_lists_of_counters_are_shortened():
    assert describe_counters([1, 2, 3, 7]) == '1..3, 7 (4)'
    assert describe_counters(range(0, 100, 2)) == '0, 2, 4, 6, 8, 10, ... (50)'


def test_a_reset_drops_what_is_held_and_begins_anew():
    buffer = PulseBuffer(pulses_per_aperture=100, pulses_per_block=10, reorder_window_pulses=20)
    buffer.push(make_block([*range(50, 70), *range(71, 87)]))  # 70 may still come
    held = buffer.held_pulses
    assert held == 16
    assert buffer.reset() == held
    assert (buffer.held_pulses, buffer.statistics.reset) == (0, held)
    # Earlier counters are neither late nor a restart: the sequence is a new one.
    assert numbers(run(buffer, [make_block(range(10, 40))])) == list(range(10, 40))
    s = buffer.statistics
    assert (s.late, s.restarts, s.missing) == (0, 0, 0)
    assert s.received == s.emitted + s.reset


def test_a_single_straggler_delivered_twice_does_not_restart_the_sequence():
    buffer = PulseBuffer(pulses_per_aperture=50, reorder_window_pulses=16)
    emitted = run(buffer, [make_block(range(32, 192)), make_block([3]), make_block([3]),
                           make_block(range(192, 224))])
    assert numbers(emitted) == list(range(32, 224))
    s = buffer.statistics
    assert (s.restarts, s.late, s.missing) == (0, 2, 0)
