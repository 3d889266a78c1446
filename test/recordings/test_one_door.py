# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""One flight as arrays, as a recording and as CPHD: each comes out with the same fields."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from sar_imaging.geometry.earth import Datum
from sar_imaging.geometry.poses import PoseTable
from sar_imaging.recordings import SourceError, open_pulses
from sar_imaging.recordings.kinds import UnknownKindError
from sar_imaging.signal.pulses import concatenate
from sar_imaging.tools.command import main

P, N, DATUM = 40, 64, Datum(47.3, 8.5, 430.0, 20.0)
START_S = 1_700_000_000


@pytest.fixture
def description(tmp_path):
    """Description of arrays with poses of their own clock, a lever arm and a range bias."""
    rng = np.random.default_rng(3)
    samples = rng.standard_normal((P, 1, N, 2)) @ [1, 1j]
    time_s = START_S + 0.01 * np.arange(P)
    pose_s = START_S + 0.01 * np.arange(-50, P + 50)
    along = pose_s - START_S
    np.savez(tmp_path / 'flight.npz', echoes=samples.astype(np.complex64), sent_s=time_s,
             pose_s=pose_s, place_m=np.stack([0 * along, 5 * along, 0 * along + 1], axis=-1))
    (tmp_path / 'flight.yaml').write_text(yaml.safe_dump({
        'name': 'flight',
        'samples': {'file': 'flight.npz', 'variable': 'echoes',
                    'axes': ['pulse', 'channel', 'sample']},
        'radar': {'waveform': 'stepped_frequency', 'carrier_hz': 10e9, 'bandwidth_hz': 0.5e9},
        'times': {'variable': 'sent_s'},
        'poses': {'times': 'pose_s', 'positions': 'place_m'},
        'alignment': {'lever_arm_m': [0.1, 0.2, 0.3], 'range_bias_m': 0.05},
        'scene': {'centre_m': [8, 1, 0], 'size_m': [4, 4], 'spacing_m': 0.1, 'frame': 'odom',
                  'window': 'hamming', 'datum': {
                      'latitude_deg': 47.3, 'longitude_deg': 8.5, 'height_m': 430.0,
                      'heading_deg': 20.0}}}))
    return tmp_path / 'flight.yaml'


def test_each_kind_of_file_has_the_same_fields(description, tmp_path):
    pytest.importorskip('sarkit', reason='the extra formats is not installed')
    bag, cphd = tmp_path / 'bag', tmp_path / 'flight.cphd'
    assert main(['load', str(description), '--output', str(bag)]) == 0
    assert main(['convert', str(bag), str(cphd)]) == 0
    arrays = open_pulses(description)
    recording, file = open_pulses(bag), open_pulses(cphd, datum=DATUM)
    assert [s.kind for s in (arrays, recording, file)] == ['description', 'recording', 'CPHD']

    for name in ('radar', 'n_samples', 'compressed', 'frame', 'datum', 'grid', 'scatterers',
                 'cut_half_width_m', 'proposed_window', 'window'):
        assert getattr(arrays, name) == getattr(recording, name), name
    assert arrays.frame == 'odom' and arrays.datum == DATUM
    assert arrays.proposed_window == 'hamming'
    for name in ('stamp_ns', 'position_m', 'quaternion'):
        np.testing.assert_array_equal(getattr(arrays.poses, name), getattr(recording.poses, name))
    assert isinstance(arrays.poses, PoseTable)
    assert arrays.alignment.as_dict() == recording.alignment.as_dict()

    assert file.radar.carrier_hz == pytest.approx(arrays.radar.carrier_hz)
    assert file.radar.bandwidth_hz == pytest.approx(arrays.radar.bandwidth_hz, rel=1e-6)
    assert (file.datum, file.poses, file.alignment) == (DATUM, None, None)
    np.testing.assert_allclose(file.area_m.mean(axis=0), arrays.area_m.mean(axis=0), atol=1e-6)
    for source in (arrays, recording, file):
        np.testing.assert_array_equal(source.counter, np.arange(P))
        assert (source.n_pulses, source.n_channels) == (P, 1)
        pulses = concatenate(list(source.blocks(n_bytes=P * N * 8 / 4)))
        assert pulses.radar == source.radar and pulses.compressed == source.compressed
        np.testing.assert_array_equal(pulses.counter, source.counter)
        np.testing.assert_array_equal(pulses.tx_m, source.tx_m)
        # of the flight, by its own formula; CPHD counts from the centre of the Earth
        expected = np.array([0.1, 0.2, 1.3]) + [[0.0, 0.05 * n, 0.0] for n in range(P)]
        np.testing.assert_allclose(source.tx_m[:, 0], expected, atol=1e-6)
        # CPHD has times since the start in float64, the start in microseconds
        np.testing.assert_allclose(source.stamp_ns - START_S * 10**9,
                                   10_000_000 * np.arange(P), atol=2_000)
    blocks = [concatenate(list(source.blocks())) for source in (arrays, recording)]
    np.testing.assert_array_equal(blocks[0].samples, blocks[1].samples)


def test_commands_open_descriptions_too(description, tmp_path, capsys):
    assert main(['image', str(description), '--output', str(tmp_path / 'out')]) == 0
    assert (tmp_path / 'out' / 'image.png').exists()
    assert main(['info', str(description)]) == 0
    assert 'description flight.yaml' in capsys.readouterr().out
    assert main(['doctor', str(description)]) in (3, 4)  # noise, which cannot tell


def test_arrays_are_opened_by_the_description_of_their_name(description, tmp_path):
    assert open_pulses(tmp_path / 'flight.npz').n_pulses == P
    (tmp_path / 'alone.npz').write_bytes((tmp_path / 'flight.npz').read_bytes())
    with pytest.raises(UnknownKindError, match='need a description, alone.yaml beside them'):
        open_pulses(tmp_path / 'alone.npz')
    assert open_pulses(description, tmp_path / 'alone.npz').n_pulses == P
    few = open_pulses(description, changes={'times.use_s': [START_S, START_S + 0.055]})
    assert few.n_pulses == 6


def test_what_cannot_be_opened_is_told(tmp_path, spotlight_bag):
    with pytest.raises(SourceError, match='does not exist; expected the folder of a recording, a'):
        open_pulses(tmp_path / 'none')
    with pytest.raises(SourceError, match='is recording, which holds its data itself'):
        open_pulses(spotlight_bag, tmp_path)
    (tmp_path / 'a.tif').write_bytes(b'II*\0' + bytes(20))
    with pytest.raises(SourceError, match='is GeoTIFF, an image; expected pulses'):
        open_pulses(tmp_path / 'a.tif')
