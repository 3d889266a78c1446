# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of pulses: all apertures of a recording, read once."""

from __future__ import annotations

import numpy as np
import pytest

from sar_imaging.geometry.alignment import Alignment
from sar_imaging.geometry.poses import PoseTable
from sar_imaging.recordings import recording
from sar_imaging.recordings.bag_io import raw_messages, read_blocks, read_truth, write_bag
from sar_imaging.recordings.pulse_source import open_apertures, open_pulses
from sar_imaging.signal.pulses import concatenate


def _same(one, other):
    for name in ('path', 'kind', 'radar', 'n_samples', 'compressed', 'datum', 'grid',
                 'scatterers', 'collection'):
        assert getattr(one, name) == getattr(other, name), name
    for name in ('counter', 'stamp_ns', 'tx_m', 'rx_m', 'area_m', 'message_ns'):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)
    pulses = [concatenate(list(source.blocks(np.inf))) for source in (one, other)]
    np.testing.assert_array_equal(pulses[0].samples, pulses[1].samples)
    np.testing.assert_array_equal(pulses[0].counter, one.counter)
    np.testing.assert_array_equal(pulses[0].tx_m, one.tx_m)
    assert pulses[0].radar == one.radar


def test_all_apertures_are_those_opened_one_by_one(spotlight_bag):
    found = open_apertures(spotlight_bag)
    assert [source.aperture for source in found] == [0, 1]
    for source in found:
        _same(source, open_pulses(spotlight_bag, aperture=source.aperture))


def test_a_recording_is_read_once_for_all_of_them(spotlight_bag, monkeypatch):
    read = []

    def counted(*arguments):
        read.append(arguments)
        return raw_messages(*arguments)

    monkeypatch.setattr(recording, 'raw_messages', counted)
    found = open_apertures(spotlight_bag)
    assert len(read) == 1
    n_all = sum(1 for _ in raw_messages(spotlight_bag))
    for source in found:
        [_ for _ in source.blocks(1e6)]
        assert len(list(raw_messages(*read[-1]))) <= n_all // 2 + 1  # those of the aperture alone


def test_cphd_has_one_aperture(spotlight_cphd):
    [found] = open_apertures(spotlight_cphd)
    other = open_pulses(spotlight_cphd)
    assert found.aperture is None and found.n_pulses == other.n_pulses


def test_pulses_placed_by_poses_have_the_geometric_radar(spotlight_bag, tmp_path):
    """As `locate` gives them: delays without the range bias."""
    alignment = Alignment(time_offset_s=0.01, range_bias_m=0.75)
    truth = read_truth(spotlight_bag) | {'alignment': alignment.as_dict()}
    blocks = [b for b in read_blocks(spotlight_bag)]
    stamps = np.concatenate([b.stamp_ns for b in blocks]) + 10_000_000
    centre = np.concatenate([b.phase_centre_m for b in blocks])
    bare = [type(b)(b.radar, b.compressed, b.stamp_ns, b.counter, b.samples[:, :1], None, None)
            for b in blocks]
    poses = PoseTable(stamps, centre, np.tile([0.0, 0.0, 0.0, 1.0], (len(stamps), 1)))
    write_bag(tmp_path / 'posed', bare, truth, poses=poses)
    for source in open_apertures(tmp_path / 'posed'):
        assert source.radar.first_sample_delay_s < blocks[0].radar.first_sample_delay_s
        _same(source, open_pulses(tmp_path / 'posed', aperture=source.aperture))


def test_messages_between_two_times(spotlight_bag):
    messages = list(raw_messages(spotlight_bag))
    start, stop = messages[2][0], messages[5][0]
    assert list(raw_messages(spotlight_bag, start, stop)) == messages[2:5]


def test_pulses_of_several_radars_are_refused(spotlight_bag, tmp_path):
    blocks = list(read_blocks(spotlight_bag))
    shorter = [type(b)(b.radar, b.compressed, b.stamp_ns, b.counter, b.samples[..., :200], b.tx_m,
                       b.rx_m) for b in blocks[5:]]
    write_bag(tmp_path / 'mixed', [*blocks[:5], *shorter], read_truth(spotlight_bag))
    with pytest.raises(RuntimeError, match='pulses of different radars or lengths'):
        open_apertures(tmp_path / 'mixed')
