# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings to CPHD and back on the command line, and what is told of files."""

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest

from sar_imaging.formats.cphd import CphdReader
from sar_imaging.geometry.antenna import Antenna
from sar_imaging.geometry.earth import Datum
from sar_imaging.geometry.illumination import Pointing
from sar_imaging.imaging.imager import plan_image
from sar_imaging.recordings import bag_io, open_pulses, read_recording
from sar_imaging.recordings.truth import antenna_truth
from sar_imaging.signal.pulses import concatenate
from sar_imaging.tools.command import main

ROOT = Path(__file__).resolve().parents[3]
GOTCHA = ROOT.parent / 'shared/data/gotcha_pass1_hh'
HERE = ['--datum', '47', '8', '450', '30']


@pytest.fixture(autouse=True)
def _with_sarkit():
    pytest.importorskip('sarkit', reason='sarkit needs Python 3.11 and the extra "formats"')


def level_db(image, reference):
    difference = np.abs(image.samples - reference.samples).max()
    return 20 * np.log10(difference / np.abs(reference.samples).max() + 1e-30)


def image_of(blocks, grid):
    block = concatenate(list(blocks))
    return plan_image(grid, block.radar, block.n_samples, compressed=block.compressed,
                      method='correlation')(block)


def part_of(grid, n=24):
    """The same middle, fewer pixels, of twice the spacing."""
    return dataclasses.replace(grid, n_x=n, n_y=n, spacing_m=2 * grid.spacing_m)


@pytest.mark.parametrize('name', ['psf', 'countryside'])
def test_recording_to_cphd_and_back(tmp_path, name, capsys):
    """Raw chirps are compressed on the way; the image stays, of every channel."""
    source = ROOT / 'bags' / name
    assert main(['convert', str(source), str(tmp_path / 'a.cphd'), *HERE,
                 '--core-name', 'a test']) == 0
    assert main(['convert', str(tmp_path / 'a.cphd'), str(tmp_path / 'back'), *HERE]) == 0
    before, after = read_recording(source), read_recording(tmp_path / 'back')
    np.testing.assert_array_equal(after.stamp_ns, before.stamp_ns)
    np.testing.assert_allclose(after.phase_centre_m, before.phase_centre_m, atol=1e-8)
    assert after.datum == Datum(47, 8, 450, 30)
    assert after.truth['n_channels'] == before.truth['n_channels']
    assert after.truth['collection']['core_name'] == 'a test'
    assert after.grid.centre_m == pytest.approx(before.grid.centre_m, abs=1e-6)
    # and once more: nothing of the metadata is lost on the way
    assert main(['convert', str(tmp_path / 'back'), str(tmp_path / 'b.cphd')]) == 0
    with CphdReader(tmp_path / 'a.cphd') as one, CphdReader(tmp_path / 'b.cphd') as other:
        assert one.collection == other.collection
        assert one.radar.carrier_hz == other.radar.carrier_hz
        np.testing.assert_allclose(other.tx_m, one.tx_m, atol=1e-8)
        for first, second in zip(one.blocks(), other.blocks(), strict=True):
            assert level_db(second, first) < -130  # each way turns float32 samples once


def test_image_of_a_converted_recording(tmp_path):
    """Of profiles, which need no compression, the image is equal to the rounding of float32."""
    source = ROOT / 'bags' / 'spotlight'
    assert main(['convert', str(source), str(tmp_path / 'a.cphd'), *HERE]) == 0
    recording = read_recording(source)
    grid = part_of(recording.grid)
    pulses = concatenate(list(bag_io.read_blocks(source)))
    if not pulses.compressed:  # compare with what the writer compressed
        from sar_imaging.signal.range_compression import RangeCompressor
        pulses = RangeCompressor(pulses.radar, pulses.n_samples)(pulses)
    with CphdReader(tmp_path / 'a.cphd', datum=Datum(47, 8, 450, 30)) as reader:
        assert level_db(image_of(reader.blocks(), grid), image_of([pulses], grid)) < -120


@pytest.mark.data
def test_image_of_gotcha(tmp_path):
    """Measured pulses: loaded, converted, read; a few of them, so that it stays quick."""
    if not GOTCHA.is_dir():
        pytest.skip('the Gotcha files are not in ../shared/data')
    from sarkit.verification import CphdConsistency

    from sar_imaging.recordings import load
    from sar_imaging.tools.load import truth_of

    gotcha = load('gotcha', GOTCHA)
    block = gotcha.block.select(slice(0, None, 6))
    bag_io.write_bag(tmp_path / 'gotcha', [block], truth_of(gotcha, None))
    assert main(['convert', str(tmp_path / 'gotcha'), str(tmp_path / 'a.cphd'), *HERE]) == 0
    grid = dataclasses.replace(part_of(read_recording(tmp_path / 'gotcha').grid, 40),
                               centre_m=(-15.6, 21.6, 0.0))
    with CphdReader(tmp_path / 'a.cphd', datum=Datum(47, 8, 450, 30)) as reader:
        image = image_of(reader.blocks(), grid)
    reference = image_of([block], grid)
    assert level_db(image, reference) < -120
    row, column = np.unravel_index(np.abs(reference.samples).argmax(), grid.shape)
    assert np.hypot(grid.x_m[column] + 15.6, grid.y_m[row] - 21.6) < 1.0  # the reflector
    with open(tmp_path / 'a.cphd', 'rb') as file:
        checker = CphdConsistency.from_file(file, thorough=True)
        checker.check()
    assert checker.passes() and not checker.failures()


def test_info_of_recording_and_cphd(tmp_path, capsys):
    source = ROOT / 'bags' / 'countryside'
    main(['convert', str(source), str(tmp_path / 'a.cphd'), *HERE, '--collector-name', 'Drone'])
    capsys.readouterr()
    assert main(['info', str(source)]) == 0
    told = capsys.readouterr().out
    for word in ('recording countryside', 'where         not stated', 'GHz', 'UTC', 'channels',
                 'size'):
        assert word in told, told
    assert main(['info', str(tmp_path / 'a.cphd')]) == 0
    told = capsys.readouterr().out
    recording = read_recording(source)
    for word in ('CPHD 1.1.0, Drone', f'{recording.radar.carrier_hz / 1e9:.4g} GHz', 'N', 'E',
                 'domain TOA, CF8', 'footprint', f'{len(recording.counter)} of', 'spotlight'):
        assert word in told, told
    assert len(told.splitlines()) <= 24 and max(map(len, told.splitlines())) <= 160


def test_info_of_images(tmp_path, capsys):
    rasterio = pytest.importorskip('rasterio', reason='the extra "formats" is not installed')
    with rasterio.open(tmp_path / 'a.tif', 'w', driver='GTiff', width=30, height=20, count=1,
                       dtype='float32', crs='EPSG:32632',
                       transform=rasterio.transform.from_origin(400000, 5200000, 2, 2)) as file:
        file.write(np.ones((1, 20, 30), np.float32))
    assert main(['info', str(tmp_path / 'a.tif')]) == 0
    told = capsys.readouterr().out
    for word in ('GeoTIFF, 1 bands of float32', 'EPSG:32632', '20 by 30 pixels of 2 by 2 metre',
                 '46.', '7.'):
        assert word in told, told


def test_sicd_is_told_and_becomes_a_map(tmp_path, capsys):
    pytest.importorskip('rasterio', reason='the extra "formats" is not installed')
    from sar_imaging.formats import Acquisition, sicd_grid, write_sicd

    block = concatenate(list(bag_io.read_blocks(ROOT / 'bags/psf')))
    acquisition = Acquisition.of(block, collector='Drone')
    centre = read_recording(ROOT / 'bags/psf').grid.centre_m
    grid = sicd_grid(acquisition, centre, 20.0, 20.0)
    image = plan_image(grid, block.radar, block.n_samples, compressed=block.compressed)(block)
    write_sicd(tmp_path / 'a.nitf', image, Datum(47, 8, 450), acquisition)
    assert main(['info', str(tmp_path / 'a.nitf')]) == 0
    told = capsys.readouterr().out
    for word in ('SICD, Drone', f'{block.radar.carrier_hz / 1e9:.3g}', '46.99', ' E, height',
                 f'{image.shape[0]} by {image.shape[1]} pixels', 'ground plane', '-3 dB'):
        assert word in told, told
    assert main(['convert', str(tmp_path / 'a.nitf'), str(tmp_path / 'a.tif')]) == 0
    assert main(['info', str(tmp_path / 'a.tif')]) == 0
    assert 'GeoTIFF, 1 bands of float32' in capsys.readouterr().out


@pytest.mark.parametrize(('words', 'text'), [
    (['convert', 'bags/psf', 'a.cphd'], 'add --datum'),
    (['convert', 'bags/psf', 'a.cphd', '--datum', '47'], 'finite numbers, latitude'),
    (['convert', 'bags/psf', 'a.cphd', '--datum', '147', '8', '0'], 'latitude_deg=147'),
    (['convert', 'bags/psf', 'a.png'], 'no format has the end'),
    (['convert', 'bags/psf', 'a.tif'], 'which cannot be converted to GeoTIFF; these can'),
    (['convert', 'README.md', 'a'], 'neither CPHD'), (['convert', 'bags', 'a'], 'metadata.yaml'),
    (['convert', 'nowhere', 'a'], 'nowhere'), (['info', 'README.md'], 'neither CPHD'),
    (['info', 'nowhere'], 'nowhere')])
def test_what_cannot_be_done_is_told(words, text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    words = [str(tmp_path / w) if w.startswith('a') and i == 2 else w for i, w in enumerate(words)]
    assert main(words) == 1
    assert text in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('words', [['convert', 'bags/psf', 'a.cphd', *HERE], ['info', 'b.cphd']])
def test_a_missing_library_is_one_line(words, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'sarkit.cphd', None)
    (tmp_path / 'b.cphd').write_bytes(b'CPHD/1.1.0')
    words = [str(tmp_path / w) if w.endswith('.cphd') else str(ROOT / w) if '/' in w else w
             for w in words]
    assert main(words) == 1
    [line] = capsys.readouterr().err.strip().splitlines()
    assert 'needs sarkit' in line and 'pip install sar_imaging[formats]' in line


def test_existing_targets_are_kept(tmp_path, capsys):
    words = ['convert', str(ROOT / 'bags/psf'), str(tmp_path / 'a.cphd'), *HERE]
    assert main(words) == 0 and main(words) == 1 and main([*words, '--force']) == 0
    assert 'exists already' in capsys.readouterr().err


def test_integers_and_other_domain(tmp_path):
    first = ['convert', str(ROOT / 'bags/psf'), str(tmp_path / 'a.cphd'), *HERE]
    assert main([*first, '--sample-type', 'CI4']) == 0
    assert main(['convert', str(tmp_path / 'a.cphd'), str(tmp_path / 'b.cphd'), '--mode-type',
                 'STRIPMAP']) == 0
    with CphdReader(tmp_path / 'a.cphd') as one, CphdReader(tmp_path / 'b.cphd') as other:
        assert (one.container.sample_type, other.container.sample_type) == ('CI4', 'CF8')
        assert other.collection.mode_type == 'STRIPMAP'
        [first], [second] = one.blocks(), other.blocks()
        assert level_db(second, first) < -130


def lit_recording(path, pointing=True):
    """A recording that tells its antenna, whose beam is narrower than its scene."""
    block = bag_io.read_blocks(ROOT / 'bags' / 'psf')
    block = concatenate(list(block))
    looks = Pointing.steered(block.phase_centre_m, (10_000.0, 8.0, 0.0))
    truth = bag_io.read_truth(ROOT / 'bags' / 'psf') | antenna_truth(
        Antenna('gaussian', azimuth_width_deg=0.3, elevation_width_deg=20.0))
    bag_io.write_bag(path, [dataclasses.replace(block, pointing=looks if pointing else None)],
                     truth)
    return path


def test_the_antenna_of_a_recording_goes_to_cphd_and_back(tmp_path, capsys):
    """Images of both files are weighed alike."""
    source = lit_recording(tmp_path / 'lit')
    assert main(['convert', str(source), str(tmp_path / 'a.cphd'), *HERE]) == 0
    assert main(['convert', str(tmp_path / 'a.cphd'), str(tmp_path / 'b.cphd')]) == 0
    assert main(['convert', str(tmp_path / 'b.cphd'), str(tmp_path / 'back'), *HERE]) == 0
    assert 'warning' not in capsys.readouterr().out
    here, images = Datum(47, 8, 450, 30), []
    for path in (source, tmp_path / 'a.cphd', tmp_path / 'back'):
        opened = open_pulses(path, datum=here)
        [block] = opened.profiles(1e9)
        images.append(plan_image(part_of(read_recording(source).grid), block.radar,
                                 block.n_samples, method='correlation',
                                 illumination=opened.illumination)(block))
    plain = plan_image(images[0].grid, block.radar, block.n_samples, method='correlation')(block)
    assert level_db(plain, images[0]) > -30  # the antenna does darken it
    for image in images[1:]:
        # -117 dB measured: tables of 257 points, of DCX and then of angles
        assert level_db(image, images[0]) < -100


def test_an_antenna_whose_pulses_tell_no_pointing_is_left_out(tmp_path, capsys):
    source = lit_recording(tmp_path / 'lit', pointing=False)
    assert main(['convert', str(source), str(tmp_path / 'a.cphd'), *HERE]) == 0
    assert 'written without its antenna' in capsys.readouterr().out
    assert open_pulses(tmp_path / 'a.cphd').illumination is None
