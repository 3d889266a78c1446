# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Index of recordings."""

import numpy as np
import pytest

from sar_imaging.geometry.earth import Datum
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.recordings import bag_io, recording, truth as recorded_truth

START_NS = 1_700_000_000_000_000_000


def make_truth(radar, **more):
    return recorded_truth.make_truth(
        scenario='test', description='', scatterers=[],
        grid=MapGrid((1.0, 2.0, 0.0), 5, 7, 0.5), pulses_per_aperture=8, n_pulses=20,
        n_channels=1, cut_half_width_m=(1.0, 1.0), radar=radar, compressed=True, **more)


@pytest.fixture
def truth(make_block):
    return make_truth(make_block(0, 1).radar)


@pytest.fixture
def bag(tmp_path, make_block, truth):
    blocks = [make_block(first, 5) for first in (0, 5, 10, 15)]
    bag_io.write_bag(tmp_path / 'bag', blocks, truth)
    return tmp_path / 'bag'


def test_index(bag, make_block):
    got = recording.read_recording(bag)
    assert (got.n_messages, got.n_unreadable) == (4, 0)
    np.testing.assert_array_equal(got.counter, np.arange(20))
    np.testing.assert_array_equal(got.message, np.repeat(np.arange(4), 5))
    assert got.radar == make_block(0, 1).radar
    assert got.grid == MapGrid((1.0, 2.0, 0.0), 5, 7, 0.5)


def test_apertures(bag):
    got = recording.read_recording(bag).apertures(8)
    assert [(a.number, a.n_pulses, a.last_message) for a in got] == [(0, 8, 1), (1, 8, 3),
                                                                     (2, 4, 3)]
    assert (got[1].first_ns, got[1].last_ns) == (START_NS + 80_000_000, START_NS + 150_000_000)


def test_phase_centre_between_pulses_is_exact_to_the_nanosecond(bag):
    got = recording.read_recording(bag).phase_centre_at(START_NS + 125_000_001)
    # 100 m/s times 1 ns; float64 of 2023 in seconds would be off by 0.02 mm
    np.testing.assert_allclose(got, (0, 12.5 + 1e-7, 500), rtol=0, atol=1e-9)


def test_unreadable_messages_are_counted_not_fatal(bag, monkeypatch):
    messages = list(bag_io.raw_messages(bag))
    messages[2] = (messages[2][0], messages[2][1][:40])
    monkeypatch.setattr(recording, 'raw_messages', lambda path: iter(messages))
    got = recording.read_recording(bag)
    assert (got.n_messages, got.n_unreadable, got.counter.size) == (4, 1, 15)
    assert [a.n_pulses for a in got.apertures(8)] == [8, 3, 4]
    monkeypatch.setattr(recording, 'raw_messages', lambda path: iter(messages[2:3]))
    with pytest.raises(bag_io.BagError, match='none of 1 messages holds a pulse block'):
        recording.read_recording(bag)


def test_recording_without_positions(tmp_path, make_block, truth):
    bag_io.write_bag(tmp_path / 'bag', [make_block(0, 5, positions=False)], truth)
    got = recording.read_recording(tmp_path / 'bag')
    assert got.phase_centre_m is None
    for places in (lambda: got.phase_centre_at(START_NS), lambda: got.centres_m):
        with pytest.raises(ValueError, match='its pulses have no phase centres, and no poses'):
            places()


def test_the_datum_of_a_recording(tmp_path, make_block, bag):
    assert recording.read_recording(bag).datum is None
    datum = Datum(-33.25, 179.999999987654321, 12.5, heading_deg=-77.125)
    block = make_block(0, 5)
    bag_io.write_bag(tmp_path / 'placed', [block], make_truth(block.radar, datum=datum))
    assert recording.read_recording(tmp_path / 'placed').datum == datum  # to the bit


def test_an_impossible_datum_of_a_recording_is_told(tmp_path, make_block, truth):
    for number, (fields, message) in enumerate([
            ({'latitude_deg': 91.0, 'longitude_deg': 0.0}, 'latitude_deg=91; expected -90 to 90'),
            ({'latitude_deg': 47.0}, "missing 1 required positional argument: 'longitude_deg'")]):
        path = tmp_path / f'bag{number}'
        bag_io.write_bag(path, [make_block(0, 5)], truth | {'datum': fields})
        with pytest.raises(bag_io.BagError, match=f'the datum of the recording: .*{message}'):
            _ = recording.read_recording(path).datum
