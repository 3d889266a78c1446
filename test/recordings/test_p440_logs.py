# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Logs of a P440 as its maker's programs write them."""

from __future__ import annotations

import pathlib
import re

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from benchmarks.support.references import exact_image
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.recordings import DescriptionError, load, open_pulses
from sar_imaging.recordings.data_files import read_log, read_variable
from sar_imaging.signal.positioning import locate
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.echoes import EchoSimulator

# As the maker's manual has them: delays in ps, steps of 32 bins of 1.907 ps, 61.035 ps a sample.
START_PS, STEP_BINS, N, P = 20_000, 32, 256, 60
STEP_S = 32 / (512 * 1.024e9)
POINT = [0.3, 4.5, 0.0]
HOST_S, EVERY_S = 1_763_000_000.25, 0.04
HEADS = (
    'Timestamp, Config, NodeId, ScanStartPs, ScanStopPs, ScanResolutionBins, '
    'BaseIntegrationIndex\n1763000000.1, Config, 100, 20000, 35625, 32, 11\n'
    'Timestamp, MrmControlRequest, MessageId, ScanCount, IntervalTimeMicroseconds\n'
    '1763000000.2, MrmControlRequest, 1, 65535, 40000\n'
    'Timestamp, MrmFullScanInfo, MessageId, SourceId, EmbeddedTimestamp, Reserved, Reserved, '
    'Reserved, Reserved, ScanStartPs, ScanStopPs, ScanStepBins, Filtering, AntennaId, Reserved, '
    'NumSamplesTotal, ScanData\n')


def line(i, samples, *, short=False, filtering=1, start_ps=START_PS, antenna=0):
    """A scan as MRM-RET writes it, or the sample application."""
    reserved, mode = ('', '') if short else ('0, 0, 0, 0, ', '0, ')
    host_s = f'{HOST_S + EVERY_S * i:.0f}' if short else f'{HOST_S + EVERY_S * i:.3f}'
    return (f'{host_s}, MrmFullScanInfo, {i}, 100, {5000 + 40 * i}, {reserved}{start_ps}, 35564, '
            f'{STEP_BINS}, {filtering}, {antenna}, {mode}{len(samples)}, '
            + ', '.join(map(str, samples)) + '\n')


def echoes():
    """(P, N) whole numbers, and the (P, 3) track at the times of the scans."""
    track_m = np.stack([np.linspace(-0.6, 0.6, P), np.zeros(P), np.full(P, 1.0)], axis=-1)
    radar = RadarParameters(3.95e9, 1.5e9, 1 / STEP_S, START_PS * 1e-12,
                            waveform=Waveform.PASSBAND)
    samples = EchoSimulator(radar, N, compressed=False, points_m=[POINT],
                            amplitudes=[30_000.0])(track_m[:, None], track_m[:, None])
    return np.rint(samples[:, 0].real).astype(int), track_m


def page_example():
    page = (pathlib.Path(__file__).parents[2] / 'docs' / 'loading.md').read_text()
    return next(text for text in re.findall(r'^```yaml\n(.*?)^```', page, re.DOTALL | re.MULTILINE)
                if 'P440' in text)


@pytest.mark.parametrize('short', [False, True])
def test_the_reflector_of_a_log_is_where_it_belongs(tmp_path, short):
    """The description of the page, with poses by the clock of the computer in a CSV file."""
    samples, track_m = echoes()
    lines = [HEADS]
    for i, scan in enumerate(samples):
        lines += [line(i, scan, short=short), line(i, scan // 3, short=short, filtering=4),
                  f'{HOST_S + EVERY_S * i:.3f}, MrmDetectionListInfo, {i}, 1, 17, 300\n']
    (tmp_path / 'rail.csv').write_text(''.join(lines))
    pose_s = 5.0 + np.arange(-0.5, EVERY_S * P + 0.5, 0.01)  # by the clock of the radar, plus 2 s
    x = np.interp(pose_s, 5.0 + EVERY_S * np.arange(P), track_m[:, 0])
    (tmp_path / 'poses.csv').write_text('time,x,y,z\n' + ''.join(
        f'{t + 2:.3f},{1e3 * a:.4f},0,1000\n' for t, a in zip(pose_s, x, strict=True)))
    (tmp_path / 'rail.yaml').write_text(page_example())
    loaded = load(tmp_path / 'rail.yaml')
    assert loaded.warnings == ()
    np.testing.assert_array_equal(loaded.block.samples[:, 0], samples)
    np.testing.assert_array_equal(np.diff(loaded.block.stamp_ns), 40_000_000)
    block = locate(loaded.block, loaded.poses, loaded.alignment)
    np.testing.assert_allclose(block.tx_m[:, 0], track_m, atol=1e-6)
    source = open_pulses(tmp_path / 'rail.csv')  # by the description of its name
    [opened] = source.blocks()
    np.testing.assert_array_equal(opened.samples, block.samples)
    np.testing.assert_array_equal(opened.tx_m, block.tx_m)
    assert opened.radar == block.radar == source.radar
    profiles = RangeCompressor.for_block(block)(block)
    grid = MapGrid.from_size(POINT, 0.8, 0.8, 0.02)
    image = np.abs(exact_image(grid, profiles))
    row, column = np.unravel_index(image.argmax(), image.shape)
    assert abs(grid.x_m[column] - POINT[0]) < 0.011 and abs(grid.y_m[row] - POINT[1]) < 0.011


def test_variables_of_a_log(tmp_path):
    samples, _ = echoes()
    path = tmp_path / 'a.log'
    path.write_text(HEADS + ''.join(line(i, scan) for i, scan in enumerate(samples)))
    np.testing.assert_allclose(read_variable(path, 'time_s'), 5.0 + EVERY_S * np.arange(P))
    np.testing.assert_allclose(read_variable(path, 'host_time_s'),
                               HOST_S + EVERY_S * np.arange(P), rtol=0, atol=6e-4)
    assert read_variable(path, 'range_start_m') == pytest.approx(0.5 * SPEED_OF_LIGHT * 20e-9)
    # the 9.149 mm that the data set of a P440 in the gallery states
    assert read_variable(path, 'range_bin_m') == pytest.approx(0.009149, abs=5e-7)
    with pytest.raises(DescriptionError, match='has no variable scans; it has host_time_s, range'):
        read_variable(path, 'scans')


@pytest.mark.parametrize(('lines', 'message'), [
    (lambda s: [line(0, s)[:-40]], 'line 6 is no whole MrmFullScanInfo'),
    (lambda s: [line(0, s), '17, MrmFullScanInfo, x\n'], 'line 7 is no whole MrmFullScanInfo'),
    (lambda s: [line(0, s, filtering=2)], 'holds no raw scans but 1 filtered ones'),
    (lambda s: [line(0, s), line(1, s, start_ps=1)], 'ScanStartPs of 1, 20000; expected one'),
    (lambda s: [line(0, s), line(1, s, antenna=1)], 'AntennaId of 0, 1; expected one setting'),
    (lambda s: [line(0, s), line(1, s[:8])], 'scans of 8 to 256 samples; expected one length')])
def test_what_is_no_log_is_told(tmp_path, lines, message):
    path = tmp_path / 'a.txt'
    path.write_text(HEADS + ''.join(lines(echoes()[0][0])))
    with pytest.raises(DescriptionError, match=message):
        read_log(path)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.one_of(
    st.text(max_size=40),
    st.lists(st.one_of(st.integers(-2**40, 2**40), st.floats(), st.text(max_size=3)), max_size=20)
    .map(lambda values: '1.5, MrmFullScanInfo, ' + ', '.join(map(str, values)))), max_size=6))
def test_no_line_brings_anything_but_a_clear_error(tmp_path_factory, lines):
    path = tmp_path_factory.mktemp('log') / 'a.log'
    path.write_text('\n'.join(lines), encoding='utf-8', errors='replace')
    try:
        assert read_log(path)['scan'].dtype == np.int32
    except DescriptionError as error:
        assert 'a.log' in str(error)
