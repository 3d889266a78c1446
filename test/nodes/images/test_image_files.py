# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The last image as a file that knows where it is: asked for over real DDS, read by others."""

import dataclasses
import importlib.util
import re

import numpy as np
import pytest
from std_srvs.srv import Trigger

from msg_conversions.images import complex_from_message
from sar_imaging.geometry.earth import Datum, geographic_to_ecef
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.nodes.afbp_fusion import FusionStep
from sar_imaging.nodes.backprojection import BackprojectionStep
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.streaming.subapertures import LiveSubapertures
from sar_imaging.tools.node_processes import AFBP_NODES, NODES, PIPELINE

from ..poses.test_fixes import RELIABLE, Satellites
from ..poses.test_odometry import Platform, without_positions
from ..step_bench import Outputs, make

DATUM = Datum(69.5, 18.75, 95.0, heading_deg=-35.0)
PLACE = {'datum.source': 'parameters'} | {f'datum.{name}': value
                                          for name, value in vars(DATUM).items()}
needs = {name: pytest.mark.skipif(importlib.util.find_spec(name) is None,
                                  reason='the extra "formats" is not installed')
         for name in ('rasterio', 'sarkit', 'pyproj')}


def written(answer):
    """Paths that an answer names."""
    success, text = answer
    assert success, text
    return re.findall(r'wrote ([^,;]+?\.\w+)(?=[,;]|$)', text)


def peak_ecef(path):
    """Place of the brightest pixel of a GeoTIFF by its own projection, on the image plane."""
    import pyproj
    import rasterio

    with rasterio.open(path) as file:
        band = file.read(1)
        level = np.where(np.isnan(band), -np.inf, np.abs(band) if np.iscomplexobj(band) else band)
        row, column = np.unravel_index(level.argmax(), level.shape)
        x, y = file.xy(row, column)
        to_degrees = pyproj.Transformer.from_crs(file.crs, 'EPSG:4326', always_xy=True)
    longitude, latitude = to_degrees.transform(x, y)
    return latitude, longitude, band


@needs['rasterio']
@needs['pyproj']
@pytest.mark.parametrize('names', [NODES, PIPELINE], ids=['nodes', 'pipeline'])
def test_the_last_image_is_a_geotiff_at_its_place(make_chain, psf, tmp_path, names):
    folder = tmp_path / 'not' / 'there'
    chain = make_chain(psf.truth, names=names, backprojection=PLACE | {
        'save.folder': str(folder), 'save.format': 'geotiff_complex'})
    observer, node = chain.observer, names[-1]
    assert observer.trigger(f'{node}/save_image') == (
        False, 'no image was formed since save.folder was set')
    observer.send(psf.blocks(25))
    image = complex_from_message(observer.wait_for('image_complex', 1)[0])
    [path] = written(observer.trigger(f'{node}/save_image'))
    latitude, longitude, band = peak_ecef(path)
    np.testing.assert_array_equal(band, image)  # every bit of the samples
    reflector = psf.truth['scatterers'][0]['position_m']
    place = geographic_to_ecef(latitude, longitude, DATUM.to_geographic(reflector)[2])
    # half a pixel along both axes, and 2.5 mm of the projection
    limit_m = psf.truth['grid']['spacing_m'] / np.sqrt(2) + 0.0025
    assert np.linalg.norm(place - DATUM.to_ecef(reflector)) < limit_m
    assert [p.name for p in folder.iterdir()] == [path.rsplit('/', 1)[1]]  # nothing half written
    assert observer.set_parameter(node, 'save.format', 'geotiff')[0]
    assert written(observer.trigger(f'{node}/save_image')) == [path]
    level = 20 * np.log10(np.abs(image) + 1e-30)
    # float32 decibels
    np.testing.assert_allclose(peak_ecef(path)[2].max(), level.max(), rtol=0, atol=1e-4)
    assert observer.set_parameter(node, 'save.format', 'png')[0]
    [picture] = written(observer.trigger(f'{node}/save_image'))
    assert {p.suffix for p in folder.iterdir()} == {'.tif', '.png', '.pgw', '.prj', '.kml'}
    assert picture == path.replace('.tif', '.png')


@needs['sarkit']
def test_the_last_image_as_sicd(make_chain, psf, tmp_path):
    from sar_imaging.formats import read_sicd

    chain = make_chain(psf.truth, backprojection=PLACE | {
        'save.folder': str(tmp_path / 'out'), 'save.format': 'sicd'})
    observer = chain.observer
    observer.send(psf.blocks(25))
    image = complex_from_message(observer.wait_for('image_complex', 1)[0])
    [path] = written(observer.trigger('backprojection/save_image'))
    product = read_sicd(path)
    assert np.abs(product.image.samples).max() == pytest.approx(np.abs(image).max(), rel=1e-6)
    row, column = np.unravel_index(np.abs(product.image.samples).argmax(), product.image.shape)
    found = product.datum.to_ecef(product.image.grid.points()[row, column])
    expected = DATUM.to_ecef(psf.truth['scatterers'][0]['position_m'])
    assert np.linalg.norm(found - expected) < psf.truth['grid']['spacing_m'] / np.sqrt(2) + 0.004
    assert product.acquisition.n_pulses > 1  # the track is in it


@needs['rasterio']
def test_fused_images_and_strips_are_written_and_sicd_is_refused(make_chain, psf, tmp_path):
    chain = make_chain(psf.truth, names=AFBP_NODES, afbp_fusion=PLACE | {
        'save.folder': str(tmp_path / 'out'), 'strip_max_pixels': 10**6})
    observer = chain.observer
    observer.send(psf.blocks(25))
    observer.wait_for('image_complex', 1)
    paths = written(observer.trigger('afbp_fusion/save_image'))
    assert [path.rsplit('/', 1)[1].split('_')[0] for path in paths] == ['image', 'strip']
    assert observer.set_parameter('afbp_fusion', 'save.format', 'sicd')[0]
    success, text = observer.trigger('afbp_fusion/save_image')
    assert not success and 'do not tell where each pulse was sent, which SICD needs' in text
    success, text = observer.trigger('backprojection/save_image')
    assert not success and 'ask afbp_fusion' in text
    observer.wait_for_counters('afbp_fusion', errors=0)


def test_what_is_missing_is_said_in_the_answer_and_the_node_lives_on(make_chain, psf, tmp_path):
    chain = make_chain(psf.truth)
    observer = chain.observer
    success, text = observer.trigger('backprojection/save_image')
    assert not success and text.startswith('parameter save.folder is empty: set the folder')
    (tmp_path / 'file').write_text('')
    success, text = observer.set_parameter('backprojection', 'save.folder',
                                           str(tmp_path / 'file' / 'x'))
    assert not success and text.endswith(f'{tmp_path}/file is no folder')
    assert observer.set_parameter('backprojection', 'save.folder', str(tmp_path / 'new' / 'x'))[0]
    observer.send(psf.blocks(25))
    observer.wait_for('image_complex', 1)
    success, text = observer.trigger('backprojection/save_image')
    assert not success and text == ('nobody says where on the Earth the frame is: set '
                                    'datum.source')
    assert not observer.set_parameter('backprojection', 'save.format', 'jpeg')[0]
    assert observer.trigger('backprojection/reset')[0]
    observer.wait_for_counters('backprojection', errors=0)


def test_a_folder_that_cannot_be_made_is_told(make_chain, psf, tmp_path):
    chain = make_chain(psf.truth, backprojection=PLACE | {'save.folder': str(tmp_path / 'file')})
    (tmp_path / 'file').write_text('')  # since the parameter was checked
    observer = chain.observer
    observer.send(psf.blocks(25))
    observer.wait_for('image_complex', 1)
    success, text = observer.trigger('backprojection/save_image')
    assert not success and 'file' in text
    chain.wait_for_log('backprojection', 'nothing was saved: ')
    observer.wait_for_counters('backprojection', errors=0)


def test_without_the_extra_the_answer_says_how_to_install_it(make_chain, psf, tmp_path,
                                                             ros_environment, monkeypatch):
    hidden = tmp_path / 'hidden'
    hidden.mkdir()
    (hidden / 'rasterio.py').write_text('raise ModuleNotFoundError("No module named rasterio")\n')
    monkeypatch.setitem(ros_environment, 'PYTHONPATH',
                        f'{hidden}:{ros_environment["PYTHONPATH"]}')
    chain = make_chain(psf.truth, names=PIPELINE,
                       backprojection=PLACE | {'save.folder': str(tmp_path / 'out')})
    observer = chain.observer
    observer.send(psf.blocks(25))
    observer.wait_for('image_complex', 1)
    success, text = observer.trigger('sar_pipeline/save_image')
    assert not success and 'install the extra: pip install sar_imaging[formats]' in text
    observer.wait_for_counters('sar_pipeline', errors=0)


@needs['rasterio']
@pytest.mark.parametrize('names', [NODES, PIPELINE], ids=['nodes', 'pipeline'])
def test_a_datum_that_pulse_buffer_finds_reaches_the_images(make_chain, psf, tmp_path, names):
    pulses = psf.pulses
    found = {'datum.source': 'fix'}
    chain = make_chain(
        psf.truth, names=names,
        pulse_buffer=found | RELIABLE | {
            'pose.source': 'odometry', 'pose.wait_s': 60.0,
            'datum.heading_deg': DATUM.heading_deg, 'antenna.rx': (
                pulses.rx_m - pulses.tx_m[:, :1])[0].ravel().tolist()},
        # The heading is that of the frame in all nodes, as in a file's section for all.
        backprojection=found | {'save.folder': str(tmp_path), 'datum.heading_deg':
                                DATUM.heading_deg})
    observer, node = chain.observer, names[-1]
    platform, sky = Platform(observer), Satellites(observer)
    observer.send([without_positions(b) for b in psf.blocks(25)])
    seconds = (pulses.stamp_ns - pulses.stamp_ns[0]) * 1e-9
    track = np.polynomial.polynomial.polyfit(seconds, pulses.tx_m[:, 0], 1)

    def fly(first, stop):
        for step in range(first, stop):  # hundredths of a second
            stamp = pulses.stamp_ns[0] + step * 10**7
            place = track[0] + 0.01 * step * track[1]
            platform.send(stamp, place, frame=psf.truth['frame'])
            sky.send_fix(stamp, place, status=0 if step > 40 else -1)

    fly(-10, 40)
    observer.wait_for('image_complex', 1)
    success, text = observer.trigger(f'{node}/save_image')
    assert not success and text.startswith('nothing came on /datum yet, which pulse_buffer publ')
    fly(40, 60)
    chain.wait_for_log(node, 'from datum')
    [path] = written(observer.trigger(f'{node}/save_image'))
    latitude, longitude, _ = peak_ecef(path)
    reflector = psf.truth['scatterers'][0]['position_m']
    place = geographic_to_ecef(latitude, longitude, DATUM.to_geographic(reflector)[2])
    limit_m = psf.truth['grid']['spacing_m'] / np.sqrt(2) + 0.0025
    assert np.linalg.norm(place - DATUM.to_ecef(reflector)) < limit_m


def test_imaging_goes_on_while_a_disk_is_slow(make_chain, psf, tmp_path, ros_environment,
                                              monkeypatch):
    hidden, awake = tmp_path / 'hidden', tmp_path / 'awake'
    hidden.mkdir()
    # Stands for a slow disk: writing begins by importing it.
    (hidden / 'rasterio.py').write_text(
        f'import pathlib, time\nprint("a slow disk", flush=True)\n'
        f'while not pathlib.Path({str(awake)!r}).exists():\n    time.sleep(0.02)\n'
        'raise OSError("no space left")\n')
    monkeypatch.setitem(ros_environment, 'PYTHONPATH',
                        f'{hidden}:{ros_environment["PYTHONPATH"]}')
    chain = make_chain(psf.truth, names=PIPELINE,
                       backprojection=PLACE | {'save.folder': str(tmp_path / 'out')})
    observer = chain.observer
    observer.send(psf.blocks(25))
    observer.wait_for('image_complex', 1)
    client = observer.node.create_client(Trigger, 'sar_pipeline/save_image')
    observer.wait(client.service_is_ready, 'the service')
    answer = client.call_async(Trigger.Request())
    chain.wait_for_log('sar_pipeline', 'a slow disk')
    observer.send(psf.later(psf.blocks(25), 1))
    observer.wait_for('image_complex', 2)
    assert observer.trigger('sar_pipeline/form_image')[1] == 'no aperture is being filled'
    assert not answer.done()
    awake.touch()
    observer.wait(answer.done, 'the answer')
    assert (answer.result().success, answer.result().message) == (False, 'no space left')
    observer.wait_for_counters('sar_pipeline', errors=0)


def two_radars(psf):
    """60 pulses of a radar, and a second later as many of another, whose counters begin anew."""
    profiles = RangeCompressor.for_block(psf.pulses)(psf.pulses).select(slice(0, 60))
    return profiles, dataclasses.replace(
        profiles, radar=dataclasses.replace(profiles.radar, carrier_hz=9e9),
        stamp_ns=profiles.stamp_ns + 10**9, tx_m=profiles.tx_m + 5.0, rx_m=profiles.rx_m + 5.0)


@needs['sarkit']
def test_an_image_that_another_radar_ends_is_told_with_its_own_pulses(psf, tmp_path):
    from sar_imaging.formats import read_sicd

    step, _ = make(BackprojectionStep, **PLACE, **{
        'grid.centre_x': 10_000.0, 'grid.size_x': 10.0, 'grid.size_y': 10.0,
        'grid.spacing': 0.4, 'save.folder': str(tmp_path), 'save.format': 'sicd'})
    step.create_outputs(Outputs())
    for sent, ended in zip(two_radars(psf), ([], None), strict=True):
        images = step.process(sent)
        assert ended is None or images == ended
    [image] = images
    step.publish(image)
    [path] = written((True, step.saving()()))
    product, first = read_sicd(path), two_radars(psf)[0]
    assert product.image.carrier_hz == pytest.approx(10e9)
    apart_m = np.linalg.norm(product.acquisition.centre_m.mean(axis=0)
                             - first.phase_centre_m.mean(axis=0))
    assert apart_m < 1.0  # the other radar is 8.7 m away


def test_a_fused_image_has_the_carrier_of_its_sub_apertures(psf):
    first, second = two_radars(psf)
    parts = [part for radar in (first, second) for live in [LiveSubapertures(
        MapGrid((10_000.0, 0.0, 0.0), 21, 21, 0.5), pulses_per_aperture=100,
        pulses_per_subaperture=20)] for part in (*live.add(radar), *live.flush())]
    step, _ = make(FusionStep, min_pulse_fraction=0.1)
    images = [image for part in parts for image in step.process(part)] + step.flush()
    assert [image.carrier_hz for image in images] == [10e9, 9e9]
