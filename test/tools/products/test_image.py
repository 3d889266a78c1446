# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""`sar-imaging image`: from a file to picture, figures, standard formats and report."""

from __future__ import annotations

import base64
import json
import pathlib
import re
import shutil

import numpy as np
import pytest
import yaml

from sar_imaging.formats.cphd import CphdReader
from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.earth import Datum
from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality import error_db, measure_scatterer
from sar_imaging.recordings import pulse_source
from sar_imaging.signal.magnitudes import SPEED_OF_LIGHT
from sar_imaging.tools.products.figures import save_acquisition_png

DATUM = Datum(47.3, 8.5, 430.0, 20.0)  # of the CPHD file
GOTCHA = pathlib.Path(__file__).parents[4] / 'shared' / 'data' / 'gotcha_pass1_hh'
BAGS = pathlib.Path(__file__).parents[3] / 'bags'
PNG = b'\x89PNG\r\n\x1a\n'


def test_a_recording_becomes_image_figures_and_report(spotlight, run, tmp_path):
    status, out, err = run('image', spotlight, '--output', tmp_path / 'out')
    assert status == 0, err
    quality = json.loads((tmp_path / 'out' / 'quality.json').read_text())
    image = np.load(tmp_path / 'out' / 'image.npy')
    source = pulse_source.open_pulses(spotlight)
    assert image.shape == source.grid.shape == tuple(quality['shape'])
    assert (tmp_path / 'out' / 'image.png').read_bytes().startswith(PNG)
    # The direct way from the pulses, without files and blocks between.
    [block] = source.blocks(1e12)
    direct = plan_image(source.grid, source.radar, source.n_samples, compressed=False,
                        method='exact', target_db=-80.0)(block)
    assert error_db(image, direct.samples) < -60.0
    assert quality['measured_error']['error_db'] < -60.0
    assert quality['predicted_error_db'] < -60.0
    for measured in quality['scatterers']:
        assert abs(measured['position_error_range_m']) < 0.02
        assert abs(measured['position_error_azimuth_m']) < 0.02
    assert len(quality['scatterers']) == len(source.scatterers) > 5
    assert 'aperture 1 of 0, 1' in out and 'dB measured' in out
    assert 'the grid that the recording proposes' in err


def test_the_report_holds_everything_by_itself(spotlight, run, tmp_path):
    assert run('image', spotlight, '--output', tmp_path, '--target-db=-50')[0] == 0
    text = (tmp_path / 'report.html').read_text()
    pictures = re.findall(r'src="data:image/png;base64,([^"]+)"', text)
    assert len(pictures) == 2
    assert all(base64.b64decode(data).startswith(PNG) for data in pictures)
    assert not re.findall(r'(?:src|href)="(?!data:)', text)  # nothing is loaded from elsewhere
    quality = json.loads((tmp_path / 'quality.json').read_text())
    for told in ('aperture 1 of 0, 1 is imaged', '10 GHz, 500 MHz', 'raw pulses',
                 'range to the middle', f'{quality["predicted_error_db"]:.1f} dB predicted',
                 '-50 dB wanted'):
        assert told in text
    assert set(p.name for p in tmp_path.iterdir()) == {'image.npy', 'image.png', 'quality.json',
                                                       'report.html'}


@pytest.mark.parametrize('waveform', ['stepped_frequency', 'fmcw'])
def test_the_window_of_a_recording_weighs_its_image(run, tmp_path, waveform):
    """Sidelobes in range are those of the Taylor window, 35 dB below; -13 dB without."""
    along = np.linspace(-0.5, 0.5, 64)
    track_m = np.stack([along, 0 * along, 0 * along], axis=-1)
    frequency_hz = 10e9 + 4e6 * np.arange(256)
    away_m = np.linalg.norm(track_m - [0, 10.0, 0], axis=1)[:, None]
    echoes = np.exp(-4j * np.pi / SPEED_OF_LIGHT * frequency_hz * away_m)
    np.savez(tmp_path / 'd.npz', s=echoes, p=track_m)
    radar = {'stepped_frequency': {'carrier_hz': float(frequency_hz.mean()), 'bandwidth_hz':
                                   256 * 4e6, 'reference_range_m': 0},
             'fmcw': {'start_frequency_hz': 10e9, 'slope_hz_per_s': 4e13, 'sample_rate_hz': 1e7}}
    (tmp_path / 'd.yaml').write_text(yaml.safe_dump({
        'samples': {'file': 'd.npz', 'variable': 's', 'axes': ['pulse', 'sample']},
        'radar': {'waveform': waveform, **radar[waveform]}, 'times': {'interval_s': 0.01},
        'positions': {'variable': 'p'},
        'scene': {'centre_m': [0, 10, 0], 'size_m': [2, 4], 'spacing_m': 0.04, 'cut_m': [1.5, 0.9],
                  'window': 'taylor:4:35', 'scatterers': {'point': [0, 10, 0]}}}))
    assert run('load', tmp_path / 'd.yaml', '--output', tmp_path / 'bag')[0] == 0
    assert run('image', tmp_path / 'bag', '--output', tmp_path / 'out')[0] == 0
    quality = json.loads((tmp_path / 'out' / 'quality.json').read_text())
    [point] = quality['scatterers']
    # measured -35.17 dB with both waveforms
    assert quality['window'] == 'taylor:4:35' and point['pslr_range_db'] < -34.5
    assert quality['measured_error']['error_db'] < -60.0
    assert run('image', tmp_path / 'bag', '--output', tmp_path / 'sicd', '--format', 'sicd',
               '--datum', 47.3, 8.5, 430)[0] == 0
    [point] = json.loads((tmp_path / 'sicd' / 'quality.json').read_text())['scatterers']
    assert point['pslr_range_db'] == pytest.approx(-13.3, abs=0.4)


def test_the_track_of_a_single_pulse_is_drawn(tmp_path):
    save_acquisition_png(tmp_path / 'a.png', np.ones((1, 3)), np.zeros((4, 3)))
    assert (tmp_path / 'a.png').read_bytes().startswith(PNG)


def test_little_memory_gives_the_same_image_in_blocks(spotlight, run, tmp_path):
    for name, more in (('whole', ()), ('blocks', ('--memory', '0.012'))):
        assert run('image', spotlight, '--output', tmp_path / name, *more)[0] == 0
    whole, blocks = (np.load(tmp_path / name / 'image.npy') for name in ('whole', 'blocks'))
    # both within the target of -60 dB; their difference is at most twice as large
    assert error_db(blocks, whole) < -54.0
    source = pulse_source.open_pulses(spotlight)
    sizes = [block.samples.nbytes for block in source.blocks(0.1 * 0.012e9)]
    assert len(sizes) > 1 and max(sizes) <= 0.1 * 0.012e9


def test_cphd_shows_the_same_scene_as_the_recording(spotlight, cphd, run, tmp_path):
    status, out, err = run('image', cphd, '--output', tmp_path, '--spacing', 0.125)
    assert status == 0, err
    quality = json.loads((tmp_path / 'quality.json').read_text())
    assert quality['format'] == 'CPHD' and quality['measured_error']['error_db'] < -60.0
    assert 'the area that the file names' in err
    # The brightest place lies where the recording's brightest scatterer stands on the Earth.
    source = pulse_source.open_pulses(spotlight)
    image, grid = np.load(tmp_path / 'image.npy'), MapGrid(*(
        quality['grid'][name] for name in ('centre_m', 'n_x', 'n_y', 'spacing_m')))
    row, column = np.unravel_index(np.abs(image).argmax(), image.shape)
    peak = DATUM.from_ecef(Datum(**quality['datum']).to_ecef(grid.positions(row, column)))
    apart = min(np.linalg.norm(peak - s['position_m']) for s in source.scatterers)
    assert apart < 0.125  # metres: a pixel


def test_standard_products_are_where_the_scatterers_are(cphd, run, tmp_path):
    rasterio = pytest.importorskip('rasterio')
    status, _, err = run('image', cphd, '--output', tmp_path, '--format', 'sicd,geotiff,png')
    assert status == 0, err
    quality = json.loads((tmp_path / 'quality.json').read_text())
    with rasterio.open(tmp_path / 'image.tif') as file:
        assert file.shape == tuple(quality['shape'])
        assert file.crs is not None
    from sar_imaging.formats import read_sicd

    product = read_sicd(tmp_path / 'image.nitf')
    image = np.load(tmp_path / 'image.npy')
    peak = np.abs(product.image.samples).max()
    assert peak == pytest.approx(np.abs(image).max(), rel=1e-6)


def test_overlay_and_catalogue_entry(cphd, run, tmp_path):
    pytest.importorskip('rasterio')
    pystac = pytest.importorskip('pystac')
    status, out, err = run('image', cphd, '--output', tmp_path, '--format', 'kml,stac,sicd')
    assert status == 0, err
    assert {'overlay.png', 'overlay.kml', 'overlay.pgw', 'image.json'} <= {
        path.name for path in tmp_path.iterdir()}
    assert 'overlay.kml' in out
    item = pystac.Item.from_file(str(tmp_path / 'image.json'))
    assert {pathlib.Path(asset.href).name for asset in item.assets.values()} == {
        'image.png', 'image.nitf', 'overlay.png', 'overlay.kml'}
    assert item.assets['kml'].href.endswith('overlay.kml')
    west, south, east, north = item.bbox
    assert west < DATUM.longitude_deg < east and south < DATUM.latitude_deg < north


def test_names_and_marking_go_from_cphd_to_sicd(spotlight, run, tmp_path):
    pytest.importorskip('sarkit', reason='the extra formats is not installed')
    import sarkit.sicd

    from sar_imaging.formats.cphd import Collection, write_cphd

    source = pulse_source.open_pulses(spotlight)
    file = tmp_path / 'named.cphd'
    named = Collection(collector_name='Drone 7', core_name='Field 3', classification='RESTRICTED',
                       polarisations=(('V', 'H'),) * source.n_channels)
    write_cphd(file, source.blocks(1e9), DATUM, source.grid, collection=named)
    status, _, err = run('image', file, '--output', tmp_path, '--format', 'sicd', '--size', 10)
    assert status == 0, err
    with open(tmp_path / 'image.nitf', 'rb') as file, sarkit.sicd.NitfReader(file) as reader:
        tree, header = reader.metadata.xmltree, reader.metadata.file_header_part
    told = {name: tree.findtext(f'{{*}}{path}') for name, path in (
        ('collector', 'CollectionInfo/{*}CollectorName'), ('core', 'CollectionInfo/{*}CoreName'),
        ('marking', 'CollectionInfo/{*}Classification'),
        ('polarisation', 'ImageFormation/{*}TxRcvPolarizationProc'))}
    assert told == {'collector': 'Drone 7', 'core': 'Field 3', 'marking': 'RESTRICTED',
                    'polarisation': 'V:H'}
    assert header.security.clas == 'R'


def test_slant_plane(spotlight, run, tmp_path):
    status, _, err = run('image', spotlight, '--output', tmp_path, '--plane', 'slant', '--size',
                         '30', '20', '--spacing', '0.2')
    assert status == 0, err
    quality = json.loads((tmp_path / 'quality.json').read_text())
    assert quality['shape'] == [101, 151] and quality['grid']['type'] == 'PlaneGrid'
    assert quality['measured_error']['error_db'] < -60.0


@pytest.mark.data
def test_gotcha_as_cphd_shows_its_reflector(run, tmp_path):
    pytest.importorskip('sarkit', reason='the extra formats is not installed')
    if not GOTCHA.exists():
        pytest.skip(f'needs the measured files in {GOTCHA.name}')
    for words in (('load', 'gotcha', GOTCHA, '--output', tmp_path / 'bag'),
                  ('convert', tmp_path / 'bag', tmp_path / 'gotcha.cphd', '--datum', 39.78,
                   -84.08, 230),
                  ('image', tmp_path / 'gotcha.cphd', '--output', tmp_path / 'out', '--size', 20,
                   '--centre', -15, 22)):
        status, _, err = run(*words)
        assert status == 0, err
    quality = json.loads((tmp_path / 'out' / 'quality.json').read_text())
    assert quality['measured_error']['error_db'] < -60.0
    grid = MapGrid(*(quality['grid'][k] for k in ('centre_m', 'n_x', 'n_y', 'spacing_m')))
    with CphdReader(tmp_path / 'gotcha.cphd') as reader:
        centre, wavenumber = reader.tx_m.mean(axis=(0, 1)), reader.radar.wavenumber_rad_per_m
    found = measure_scatterer(
        np.load(tmp_path / 'out' / 'image.npy'), grid, (-15.60, 21.60, 0.0),
        aperture_centre_m=centre, wavenumber_rad_per_m=wavenumber, cut_half_width_range_m=3.0,
        cut_half_width_azimuth_m=3.0)
    # (-15.60, 21.60) m by a float64 backprojection made without this project
    assert np.hypot(found.peak_x_m + 15.60, found.peak_y_m - 21.60) < 0.03
    assert found.irw_azimuth_m == pytest.approx(0.285, rel=0.03)


@pytest.mark.parametrize(('words', 'message'), [
    (['--format', 'geotiff'], 'give --datum LATITUDE LONGITUDE HEIGHT'),
    (['--format', 'geotiff', '--plane', 'slant', '--datum', '1', '2', '3'], 'geotiff hold maps'),
    (['--plane', 'slant', '--brightness', 'gamma0', '--radar-constant', 'radar.yaml'],
     'gamma0 is by square metre of the ground'),
    (['--datum', '91', '0', '0'], 'latitude_deg=91'),
    (['--aperture', '7'], 'has no aperture 7; it has 0, 1'),
    (['--centre', '400', '0'], 'give --centre a place in the scene'),
    (['--size', '3000', '--spacing', '0.01'], 'ask for a smaller --size'),
    (['--datum', '47', '8'], 'expected 3 to 4 finite numbers'),
    (['--size', '1', '2', '3'], 'expected 1 to 2 finite numbers'),
    (['--centre', '1', 'nan'], 'expected 2 to 3 finite numbers'),
    (['--memory', '-1'], 'expected a positive number of GB')])
def test_what_cannot_be_done_is_told_before_the_work(spotlight, run, tmp_path, words, message):
    status, _, err = run('image', spotlight, '--output', tmp_path / 'out', *words)
    assert status == 1 and message in err and 'Traceback' not in err
    assert not (tmp_path / 'out').exists()


@pytest.fixture(scope='module')
def bare(spotlight, tmp_path_factory):
    """The recording as `ros2 bag record` would have made it: nothing but messages."""
    path = tmp_path_factory.mktemp('bare') / 'spotlight'
    shutil.copytree(spotlight, path)
    metadata = yaml.safe_load((path / 'metadata.yaml').read_text())
    metadata['rosbag2_bagfile_information']['custom_data'] = {}
    (path / 'metadata.yaml').write_text(yaml.safe_dump(metadata))
    return path


def test_a_recording_without_truth_needs_its_middle_and_no_more(bare, run, tmp_path):
    status, _, err = run('image', bare, '--output', tmp_path)
    assert status == 1
    assert 'does not state where its scene is: give --centre X Y Z' in err
    status, _, err = run('image', bare, '--output', tmp_path, '--centre', 0, 0,
                         '--target-db=-50')
    assert status == 0, err
    assert 'what the profiles cover without ambiguity' in err
    quality = json.loads((tmp_path / 'quality.json').read_text())
    assert quality['measured_error']['error_db'] < -50.0
    assert quality['measured_error']['covered_share'] > 0.99
    # all of it
    assert quality['pulses'] == 2 * pulse_source.open_pulses(BAGS / 'spotlight').n_pulses


def test_other_files_are_refused_by_name(run, tmp_path):
    (tmp_path / 'text.cphd').write_text('hello')
    (tmp_path / 'folder').mkdir()
    for name, message in (('text.cphd', "begins with b'hello': neither CPHD"),
                          ('folder', 'is a folder without metadata.yaml'),
                          ('nothing', 'does not exist')):
        status, _, err = run('image', tmp_path / name, '--output', tmp_path / 'out')
        assert status == 1 and message in err


@pytest.mark.parametrize('words', [['--format', 'jpeg'], ['--size', '1,2'], ['--centre', 'x']])
def test_words_that_mean_nothing_are_refused(spotlight, run, words, tmp_path):
    with pytest.raises(SystemExit) as end:
        run('image', spotlight, '--output', tmp_path, *words)
    assert end.value.code == 2
