# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""`sar-imaging change`: two recordings, CPHD or SICD files of known ground compared."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import pathlib

import numpy as np
import pytest

from sar_imaging.recordings import open_pulses
from sar_imaging.simulation.scenarios.catalogue import BASELINE_M, CAR_M, TERRACE_HEIGHT_M
from sar_imaging.tools.command import main

DATUM = ('47.3', '8.5', '400', '30')
# a third of the pixels in the middle of the terrace, of 193 by 193 of 0.25 m around 0, 0
TERRACE = np.s_[40:64, 84:112]


@pytest.fixture(scope='module')
def recordings(tmp_path_factory):
    """The recordings of both scenarios."""
    folder = tmp_path_factory.mktemp('passes')
    for name in CAR_M:
        assert main(['simulate', name, '--output', str(folder / name)]) == 0
    return tuple(folder / name for name in CAR_M)


@pytest.fixture(scope='module')
def compared(recordings, tmp_path_factory):
    """Folder of the comparison."""
    folder = tmp_path_factory.mktemp('compared')
    assert main(['change', *map(str, recordings), '--output', str(folder), '--datum', *DATUM]) == 0
    return folder


def test_changes_and_heights_are_told(compared):
    figures = json.loads((compared / 'comparison.json').read_text())
    assert figures['baseline_m'] == pytest.approx(BASELINE_M, abs=1e-5)
    largest = [change['position_m'][:2] for change in figures['change']['largest'][:2]]
    for place in CAR_M.values():  # half a car
        assert min(np.hypot(*np.subtract(place, found)) for found in largest) < 2.2
    assert figures['coherence']['median'] > 0.94
    assert 'Touzi' in figures['coherence']['formula']
    bands = np.load(compared / 'comparison.npz')
    assert np.nanmedian(bands['height_m'][TERRACE]) == pytest.approx(TERRACE_HEIGHT_M, rel=0.05)
    assert figures['height']['ambiguity_m'] == pytest.approx(8.8, abs=0.1)
    assert abs(figures['coregistration']['shift_px'][0]) < 0.05


def test_pictures_and_report_are_complete(compared):
    names = {'first.png', 'second.png', 'coherence.png', 'change.png', 'phase.png', 'height.png'}
    assert names <= {path.name for path in compared.iterdir()}
    text = (compared / 'report.html').read_text()
    assert text.count('src="data:image/png;base64,') == len(names)
    if importlib.util.find_spec('rasterio'):  # its absence is a warning
        assert 'No warnings' in text
    assert 'independent looks' in text
    assert 'pixels, coherence' in text and 'false alarm' in text


def test_the_map_of_the_comparison_lies_on_the_earth(compared):
    rasterio = pytest.importorskip('rasterio', reason='the extra formats is not installed')
    bands = np.load(compared / 'comparison.npz')
    with rasterio.open(compared / 'comparison.tif') as file:
        assert file.descriptions == tuple(bands)
        assert file.crs is not None and file.nodata is not None
        for number, values in enumerate(bands.values(), 1):
            np.testing.assert_array_equal(file.read(number), values.astype(np.float32))


def test_the_plane_of_track_errors_is_removed_when_asked(recordings, run, tmp_path):
    status, out, err = run('change', *recordings, '--output', tmp_path, '--remove-plane',
                           '--window', 9, '--false-alarm-rate', 1e-3)
    assert status == 0, err
    figures = json.loads((tmp_path / 'comparison.json').read_text())
    assert figures['phase']['removed'] and figures['window_px'] == 9
    assert figures['change']['false_alarm_rate'] == 1e-3
    assert 'per row and column, removed' in out
    assert not (tmp_path / 'comparison.tif').exists()  # its place on the Earth is not known


def test_cphd_tells_the_same_as_the_recordings(recordings, compared, run, tmp_path):
    pytest.importorskip('sarkit', reason='the extra formats is not installed')
    from sar_imaging.formats.cphd import write_cphd
    from sar_imaging.geometry.earth import Datum

    files = []
    for path in recordings:
        source = open_pulses(path)
        files.append(tmp_path / f'{path.name}.cphd')
        write_cphd(files[-1], source.blocks(1e9), Datum(47.3, 8.5, 400.0, 0.0), source.grid)
    status, out, err = run('change', *files, '--output', tmp_path / 'out', '--spacing', 0.25)
    assert status == 0, err
    figures = json.loads((tmp_path / 'out' / 'comparison.json').read_text())
    expected = json.loads((compared / 'comparison.json').read_text())
    assert figures['coherence']['median'] == pytest.approx(expected['coherence']['median'],
                                                           abs=0.005)
    assert figures['height']['ambiguity_m'] == pytest.approx(expected['height']['ambiguity_m'],
                                                             rel=0.01)
    largest = [change['position_m'][:2] for change in figures['change']['largest'][:2]]
    for place in CAR_M.values():
        assert min(np.hypot(*np.subtract(place, found)) for found in largest) < 2.2


def test_a_file_in_another_frame_is_brought_into_that_of_the_first(recordings, compared, run,
                                                                   tmp_path):
    pytest.importorskip('sarkit', reason='the extra formats is not installed')
    from sar_imaging.formats.cphd import write_cphd
    from sar_imaging.geometry.earth import Datum
    from sar_imaging.geometry.grids import MapGrid

    own, other = Datum(47.3, 8.5, 400.0, 0.0), Datum(47.3001, 8.4999, 405.0, 70.0)
    files = [tmp_path / 'a.cphd', tmp_path / 'b.cphd']
    sources = [open_pulses(path) for path in recordings]
    write_cphd(files[0], sources[0].blocks(1e9), own, sources[0].grid)
    moved = [dataclasses.replace(block, **{
        name: other.from_ecef(own.to_ecef(getattr(block, name))) for name in ('tx_m', 'rx_m')})
        for block in sources[1].blocks(1e9)]
    centre = other.from_ecef(own.to_ecef([0.0, 0.0, 0.0]))
    write_cphd(files[1], moved, other, MapGrid.from_size(centre, 48.0, 48.0, 0.25))
    status, _, err = run('change', *files, '--output', tmp_path / 'out', '--spacing', 0.25)
    assert status == 0, err
    figures = json.loads((tmp_path / 'out' / 'comparison.json').read_text())
    expected = json.loads((compared / 'comparison.json').read_text())
    # the Earth's curve over 10 m and the rounding of float64 at its radius are below 1e-8 m
    assert figures['coherence']['median'] == pytest.approx(expected['coherence']['median'],
                                                           abs=0.005)
    assert figures['baseline_m'] == pytest.approx(BASELINE_M, abs=1e-3)


def test_little_memory_compares_a_smaller_part(recordings, run, tmp_path):
    status, _, err = run('change', *recordings, '--output', tmp_path, '--memory', 0.008,
                         '--centre', 0, 0, '--spacing', 0.25)
    assert status == 0, err
    figures = json.loads((tmp_path / 'comparison.json').read_text())
    assert figures['shape'][0] * figures['shape'][1] < 30_000
    assert any('--memory' in reason for reason in figures['chosen'])


def test_sicd_files_of_one_grid_tell_the_same(recordings, compared, run, tmp_path):
    pytest.importorskip('sarkit', reason='the extra formats is not installed')
    files = []
    for path in recordings:
        status, _, err = run('image', path, '--output', tmp_path / path.name, '--format', 'sicd',
                             '--datum', *DATUM)
        assert status == 0, err
        files.append(tmp_path / path.name / 'image.nitf')
    status, _, err = run('change', *files, '--output', tmp_path / 'out')
    assert status == 0, err
    figures = json.loads((tmp_path / 'out' / 'comparison.json').read_text())
    expected = json.loads((compared / 'comparison.json').read_text())
    # the same samples, turned: only averages at the edges and the noise floor's quantile differ
    assert figures['coherence']['median'] == pytest.approx(expected['coherence']['median'],
                                                           abs=0.002)
    # a track as a polynomial differs by less than a millimetre from the pulses' places
    assert figures['height']['ambiguity_m'] == pytest.approx(expected['height']['ambiguity_m'],
                                                             rel=0.005)
    assert figures['change']['changed_share'] == pytest.approx(
        expected['change']['changed_share'], rel=0.05)


def test_files_that_do_not_belong_together_are_refused(recordings, run, tmp_path):
    bags = pathlib.Path(__file__).parents[3] / 'bags'
    (tmp_path / 'image.nitf').write_bytes(b'NITF02.10')
    for first, second, message in (
            (recordings[0], bags / 'psf', 'do both see one scene'),
            (recordings[0], tmp_path / 'image.nitf', 'compare two files of one kind'),
            (recordings[0], tmp_path / 'none', 'does not exist')):
        status, _, err = run('change', first, second, '--output', tmp_path / 'out')
        assert status == 1 and message in err and 'Traceback' not in err
    assert not (tmp_path / 'out').exists()
