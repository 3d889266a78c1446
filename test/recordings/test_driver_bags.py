# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A simulated scene as each driver publishes it, with its traps, comes out where it belongs."""

from __future__ import annotations

import pathlib
import re

import numpy as np
import pytest
import yaml

from benchmarks.support import driver_messages as drivers
from benchmarks.support.driver_recordings import (
    DRIVERS,
    FMCW_KEYS,
    FRAMES,
    LOOPS,
    POINT,
    RX_M,
    START_NS,
    TX_M,
    flight,
    xwr,
)
from benchmarks.support.references import exact_image
from sar_imaging import numpy_files
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.recordings import (
    DescriptionError,
    arrays,
    find_description,
    load,
    open_pulses,
    read_description,
)
from sar_imaging.recordings.bag_io import read_truth
from sar_imaging.recordings.frames import FrameConverter
from sar_imaging.recordings.samples import KEYS
from sar_imaging.signal.radar import Waveform
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.tools.load import main

rosbags = pytest.importorskip('rosbags', reason='recordings need rosbags')


def prepare(folder, sent, ros1=False, messages=None, **changes):
    """Bag, poses and description of a recording in a folder."""
    drivers.record(folder / ('radar.bag' if ros1 else 'radar'), messages or sent.messages, ros1)
    pose_s = np.arange(-0.5, 2.0, 0.005)
    position, attitude = flight(pose_s)
    stamp = [f'{(START_NS + round(s * 1e9)) // 10**9}.{(START_NS + round(s * 1e9)) % 10**9:09d}'
             for s in pose_s]
    lines = [' '.join([t, *(f'{v:.9f}' for v in row)]) for t, row in zip(
        stamp, np.column_stack([position, attitude.as_quat()]), strict=True)]
    (folder / 'poses.tum').write_text('\n'.join(lines))
    tree = {**sent.description, 'poses': {'file': 'poses.tum'},
            'scene': {'centre_m': [0.4, 5, 0], 'size_m': [0.6, 0.6], 'spacing_m': 0.01}}
    tree['samples'] = {'file': 'radar.bag' if ros1 else 'radar', **tree['samples']}
    for key, value in changes.items():
        tree[key] = {**tree.get(key, {}), **value}
    (folder / 'd.yaml').write_text(yaml.safe_dump(tree))
    return folder / 'd.yaml'


def located(result):
    """Pulses with phase centres, wherever they come from."""
    from sar_imaging.signal.positioning import locate
    if result.poses is None:
        return result.block
    return locate(result.block, result.poses, result.alignment)


def peak(block):
    """Where the image is brightest."""
    profiles = RangeCompressor.for_block(block)(block)
    grid = MapGrid.from_size(POINT, 0.6, 0.6, 0.01)
    image = np.abs(exact_image(grid, profiles))
    row, column = np.unravel_index(image.argmax(), image.shape)
    return np.array([grid.x_m[column], grid.y_m[row]]), image.max()


@pytest.mark.parametrize('name', [*DRIVERS, 'xwr_raw ros1'])
def test_the_reflector_is_where_it_belongs(tmp_path, name):
    sent = DRIVERS[name.split()[0]]()
    path = prepare(tmp_path, sent, ros1=name.endswith('ros1'))
    result = load(path)
    block = located(result)
    assert result.warnings == ()
    [opened] = open_pulses(path).blocks()
    np.testing.assert_array_equal(opened.samples, block.samples)
    np.testing.assert_array_equal(opened.tx_m, block.tx_m)
    # Float32 fields of messages carry seven digits.
    for field in ('carrier_hz', 'chirp_rate_hz_per_s', 'first_sample_delay_s'):
        expected = getattr(sent.radar, field)
        assert getattr(block.radar, field) == pytest.approx(expected, rel=1e-6, abs=1e-18)
    assert block.radar.waveform == sent.radar.waveform
    # Whole numbers: half a step in each part; the factors of a driver magnify it by 1.2.
    np.testing.assert_allclose(block.samples, sent.samples, rtol=0, atol=0.9)
    loops = len(block.counter) // FRAMES
    away_s = (block.stamp_ns[::loops] - sent.frame_ns) * 1e-9
    assert np.abs(away_s).max() <= sent.late_s
    if not sent.late_s:
        np.testing.assert_array_equal(away_s, 0.0)
        np.testing.assert_allclose(block.tx_m, sent.centres[0], atol=2e-6)
        np.testing.assert_allclose(block.rx_m, sent.centres[1], atol=2e-6)
    found, level = peak(block)
    assert np.abs(found - POINT[:2]).max() <= 0.011 + (
        0.07 if sent.radar.first_sample_delay_s < 0 else 0.0)
    # All pulses of all channels in phase, less what a window that is not there would cost.
    assert level > 0.9 * 8000 * block.samples.shape[0] * block.samples.shape[1] * (
        0.5 if block.radar.waveform == Waveform.FMCW_REAL else 0.02
        if block.radar.waveform == Waveform.PASSBAND else 1.0)


@pytest.mark.parametrize(('name', 'changes'), [
    ('xwr', {'samples': {'conjugate': False}}), ('xwr', {'samples': {'iq': 'pairs'}}),
    ('xwr_raw', {'samples': {'iq': 'iiqq', 'conjugate': True}}),
    ('infineon', {'samples': {'axes': ['rx', 'pulse', 'sample']}}),
    ('xwr', {'array': {'turn_order': [1, 0]}})])
def test_wrong_descriptions_do_not_focus(tmp_path, name, changes):
    sent = DRIVERS[name]()
    found, level = peak(located(load(prepare(tmp_path, sent, **changes))))
    whole = 8000 * sent.samples.shape[0] * sent.samples.shape[1]
    assert level < 0.6 * whole * (0.5 if sent.radar.waveform == Waveform.FMCW_REAL else 1.0)


def test_transmitters_may_send_in_another_order(tmp_path):
    sent = xwr()
    swapped = {'tx_m': TX_M[::-1].tolist(), 'turn_order': [1, 0]}
    block = located(load(prepare(tmp_path, sent, array=swapped)))
    order = [3, 4, 5, 0, 1, 2]
    np.testing.assert_allclose(block.tx_m, sent.centres[0][:, order], atol=2e-6)
    np.testing.assert_allclose(block.samples, sent.samples[:, order], atol=0.75)


def test_incomplete_missing_and_broken_frames_are_counted_and_named(tmp_path, capsys):
    sent = xwr()
    messages = list(sent.messages)
    messages[5][3]['complete'] = False
    broken = messages[9][3]['iq']
    broken['data'] = broken['data'][:-4]
    del messages[20:23]
    path = prepare(tmp_path, sent, messages=messages)
    assert main([str(path), '--output', str(tmp_path / 'bag')]) == 0
    err = capsys.readouterr().err
    assert '1 of 57 frames are incomplete and were left out: the driver lost packets' in err
    assert ('1 of 57 messages were refused; the last one: iq holds 3068 numbers; expected '
            '4 x 2 x 3 x 128') in err
    # Those three, and the one whose message was broken, by the period of the frames.
    assert '4 frames never came' in err
    block = located(load(path))
    gone = {4, 8, 19, 20, 21}
    kept = [f for f in range(FRAMES) if f not in gone]
    expected = np.concatenate([LOOPS * f + np.arange(LOOPS) for f in kept])
    np.testing.assert_array_equal(block.counter, expected)
    assert read_truth(tmp_path / 'bag')['pulses_per_aperture'] == FRAMES * LOOPS


@pytest.mark.parametrize(('changes', 'message'), [
    ({'samples': {'topic': '/other'}}, r'samples.topic: radar has no topic /other of a type IQ'),
    ({'samples': {'topic': 'xwr/iq'}}, 'did you mean /xwr/iq?'),
    ({'samples': {'iq': 'complex'}}, 'samples.iq: expected that of the messages, iiqq, got'),
    ({'samples': {'variable': 'adc'}}, 'samples.variable: expected none besides samples.topic'),
    ({'times': {'variable': 't'}}, 'times.variable: expected none besides samples.topic'),
    ({'samples': {'axes': ['rx', 'pulse', 'sample']}}, 'messages IQ tell them themselves; leave'),
    ({'array': {'tx_m': [[0, 0, 0]] * 3}}, 'array.tx_m: expected the places of 2 transmitters'),
    ({'array': {'turn_interval_s': 0.02}}, 'turn_interval_s: expected at most the 0.0001 s of a'),
    ({'frames': {'chirp_s': 0.1}}, 'seconds, 8 of which fit into a frame every 0.02 s, got 0.1'),
    ({'frames': {'chirp_s': 0}}, 'frames.chirp_s: expected a positive number of seconds, got 0'),
    ({'frames': {'period_s': -1}}, 'frames.period_s: expected a positive number of seconds'),
    ({'frames': {'latency_s': 3}}, 'latency_s: expected seconds, 0 to 1, got 3; a latency of'),
    ({'frames': {'stamps': 'end'}}, 'unknown key frames.stamps; did you mean stamp'),
    ({'frames': {'stamp': 'middle'}}, 'frames.stamp: expected one of start, end, receipt'),
    ({'radar': {'waveform': 'fmcw_real'}}, 'the messages hold complex samples; use fmcw')])
def test_what_does_not_fit_is_told(tmp_path, changes, message):
    with pytest.raises(DescriptionError, match=message):
        load(prepare(tmp_path, xwr(), **changes))


@pytest.mark.parametrize(('name', 'changes', 'message'), [
    ('xwr', {'frames': {'period_s': 20}}, 'frames come every 0.02 s; expected frames.period_s'),
    ('infineon', {'frames': {'period_s': 0.017}}, 'frames come every 0.0'),
    ('xwr', {'array': {'rx_m': (1e3 * RX_M).tolist()}}, 'array.rx_m are 10 m apart')])
def test_doubtful_numbers_are_told(tmp_path, name, changes, message):
    warnings = load(prepare(tmp_path, DRIVERS[name](), **changes)).warnings
    assert any(message in text for text in warnings)


def test_a_period_that_spoils_the_times_is_told_with_what_comes_of_it(tmp_path):
    with pytest.raises(DescriptionError, match='the pulses need poses from .*; frames come every '
                       r'0\.0[12]\d* s; expected frames\.period_s=0\.03 s'):
        load(prepare(tmp_path, DRIVERS['cpsl'](), frames={'period_s': 0.03}))


def test_a_bag_that_does_not_fit_into_memory_is_refused_before_it_is_read(tmp_path, monkeypatch):
    path = prepare(tmp_path, xwr())
    monkeypatch.setattr(numpy_files, 'available_bytes', lambda: 1_000_000)

    def fail(*arguments):
        raise AssertionError('read before its size was checked')

    monkeypatch.setattr(arrays, 'read_bag_frames', fail)
    with pytest.raises(DescriptionError, match='radar takes .* of memory are free'):
        load(path)


def test_numbers_that_nobody_tells_are_named(tmp_path):
    sent = xwr()
    with pytest.raises(DescriptionError, match=r'radar\.waveform is missing.* no message of the '
                       r'driver told it either \(ChirpInfo, DeviceConfig\)'):
        load(prepare(tmp_path, sent, messages=sent.messages[1:]))
    with pytest.raises(DescriptionError, match=r'frames\.chirp_s is missing'):
        load(prepare(tmp_path / 'x', sent, messages=sent.messages[1:], radar=FMCW_KEYS | {
            'slope_hz_per_s': 40e12, 'sample_rate_hz': 5e6}) if (tmp_path / 'x').mkdir() is None
            else None)


PAGES = pathlib.Path(__file__).parents[2] / 'docs'
EXAMPLES = [(page, text) for page in ('drivers.md', 'loading.md') for text in re.findall(
    r'^```yaml\n(.*?)^```', (PAGES / page).read_text(), re.DOTALL | re.MULTILINE)]


@pytest.mark.parametrize(('page', 'text'), EXAMPLES, ids=lambda v: v[:30].split('\n')[0])
def test_descriptions_of_the_documentation_are_read(tmp_path, page, text):
    (tmp_path / 'd.yaml').write_text(text)
    top = read_description(tmp_path / 'd.yaml')
    if text.startswith('antenna:'):
        return  # a part, whose keys are known; test_antenna.py reads such parts
    if 'topic' not in top.section('samples', KEYS):
        if 'P440' in text or text.startswith('# satellite.yaml'):
            return  # test_p440_logs.py loads one, the page itself the other
        assert text == find_description('team5_rail').read_text()
        return
    converter = FrameConverter(top, tmp_path)
    assert top.section('samples', KEYS).text('topic').startswith('/')
    assert converter.statistics.received == 0
