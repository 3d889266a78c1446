# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Calibrated brightness of the nodes: over real DDS, and what is refused."""

import dataclasses
import importlib.util
from pathlib import Path

import numpy as np
import pytest
import yaml

from msg_conversions.images import amplitude_from_message, complex_from_message
from msg_conversions.subaperture_wire import as_received
from sar_imaging.configuration.parameters import default_file, interpret, load_tree
from sar_imaging.configuration.positions import check_positions
from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.antenna import Antenna
from sar_imaging.geometry.illumination import Illumination, Pointing
from sar_imaging.nodes.afbp_fusion import FusionStep
from sar_imaging.nodes.backprojection import VOLUME, BackprojectionStep
from sar_imaging.nodes.runtime.parameters import ConfigurationError
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.streaming.subapertures import LiveSubapertures
from sar_imaging.tools.node_processes import PIPELINE

from ..step_bench import Outputs, make
from .test_image_files import PLACE, needs, written

SIZE_M2 = 37.7  # of the reflector: amplitude 1 in the range profiles, 10 km away


@pytest.fixture(name='constant')
def constant_fixture(tmp_path):
    """File of the constant by which the reflector has its size."""
    path = tmp_path / 'radar.yaml'
    path.write_text(yaml.safe_dump({'gain_m': float(1e8 / np.sqrt(SIZE_M2)),
                                    'noise_power': 1e-4}))
    return str(path)


@needs['rasterio']
def test_a_trihedral_has_its_cross_section_in_every_product(make_chain, psf, constant, tmp_path):
    import rasterio

    chain = make_chain(psf.truth, names=PIPELINE, backprojection=PLACE | {
        'radiometry.quantity': 'rcs', 'radiometry.constant_file': constant,
        'save.folder': str(tmp_path / 'out')})
    observer = chain.observer
    observer.send(psf.blocks(25))
    image = complex_from_message(observer.wait_for('image_complex', 1)[0])
    # 0.02 dB measured: the reflector stands on a pixel
    assert 20 * np.log10(np.abs(image).max()) == pytest.approx(10 * np.log10(SIZE_M2), abs=0.1)
    linear = amplitude_from_message(observer.wait_for('image', 1)[0])
    assert linear == pytest.approx(np.abs(image), rel=1e-6)
    observer.wait_for_counters('sar_pipeline', 'backprojection', responses_computed=1,
                               images_not_calibrated=0)
    told = observer.counters('sar_pipeline', 'backprojection')
    # noise of 1e-4 in each of 200 pulses and 5 channels, of which G^2 is the square of the sum
    expected = -40 - 10 * np.log10(1000) + 10 * np.log10(SIZE_M2)
    assert told['noise_equivalent_db'] == pytest.approx(expected, abs=0.1)
    assert chain.observer.counters('sar_pipeline', 'backprojection')['incidence_deg'] > 45
    assert 'dB of rcs, noise-equivalent' in chain.log('sar_pipeline')
    [path] = written(observer.trigger('sar_pipeline/save_image'))
    with rasterio.open(path) as file:
        tags = file.tags()
        assert (file.descriptions, file.units) == (('rcs',), ('dB',))
        assert np.nanmax(file.read(1)) == pytest.approx(10 * np.log10(SIZE_M2), abs=0.1)
    assert (tags['QUANTITY'], tags['UNIT']) == ('rcs', 'm^2')
    assert float(tags['NOISE_EQUIVALENT_DB']) == pytest.approx(expected, abs=0.1)
    if importlib.util.find_spec('sarkit') is not None:
        assert observer.set_parameter('sar_pipeline', 'save.format', 'sicd')[0]
        [path] = written(observer.trigger('sar_pipeline/save_image'))
        assert b'<BetaZeroSFPoly' in Path(path).read_bytes()


@pytest.mark.parametrize(('parameters', 'text'), [
    ({'radiometry.quantity': 'sigma0'}, 'expected the file of a radar constant'),
    ({'radiometry.constant_file': 'radar.yaml'}, 'radiometry.quantity=none and'),
    ({'radiometry.quantity': 'sigma0', 'radiometry.constant_file': '/nowhere'},
     '/nowhere is no file of a radar constant'),
    ({'radiometry.quantity': 'sigma0', 'radiometry.constant_file': 'radar.yaml', 'mode': VOLUME,
      'volume.height': 2.0}, 'cells have no area of ground; expected rcs')])
def test_what_contradicts_itself_is_refused_in_one_line(parameters, text):
    with pytest.raises(ConfigurationError, match=text) as caught:
        make(BackprojectionStep, **parameters)
    assert '\n' not in str(caught.value)
    configuration = interpret({'/**': {'ros__parameters': parameters}}, load_tree(default_file()))
    errors = [f.text for f in check_positions(configuration.nodes, None) if f.severity == 'error']
    assert errors  # check_config says so, too


def test_the_window_is_that_of_the_profiles(constant):
    parameters = {'radiometry.quantity': 'sigma0', 'radiometry.constant_file': constant,
                  'window': 'hamming'}
    configuration = interpret({'/**': {'ros__parameters': parameters}}, load_tree(default_file()))
    findings = check_positions(configuration.nodes, None)
    assert len(findings) == 2  # of both nodes that calibrate
    assert all('radiometry.window=none, but range profiles have window=hamming' in f.text
               for f in findings)
    with pytest.raises(ConfigurationError, match='radiometry.window=none, but'):
        make(BackprojectionStep, **parameters)  # as in sar_pipeline


def test_an_image_without_brightness_is_counted_and_not_published(psf, constant):
    """Of a radar that stood still; the step lives on."""
    step, log = make(BackprojectionStep, **{
        'pulses_per_aperture': 200, 'grid.centre_x': 10_000.0, 'grid.size_x': 10.0,
        'grid.size_y': 10.0, 'grid.spacing': 0.5, 'radiometry.quantity': 'beta0',
        'radiometry.constant_file': constant})
    outputs = Outputs('image_complex')
    step.create_outputs(outputs)
    profiles = RangeCompressor.for_block(psf.pulses)(psf.pulses)
    still = np.broadcast_to(profiles.tx_m[:1], profiles.tx_m.shape)
    for product in step.process(dataclasses.replace(profiles, tx_m=still, rx_m=still)):
        step.publish(product)
    assert outputs.sent['image_complex'] == []
    assert log['images_not_calibrated'] == 1
    assert any('brightness cannot be told: the radar stood still' in line for line in log.lines)
    for product in [*step.process(dataclasses.replace(
            profiles, counter=profiles.counter + 200)), *step.flush()]:
        step.publish(product)
    assert len(outputs.sent['image_complex']) == 1


@pytest.mark.parametrize('sliding', [False, True])
@pytest.mark.parametrize('weighted', [False, True])
def test_fused_images_have_the_cross_section_too(psf, constant, weighted, sliding):
    """From messages of sub-apertures, which tell where their ends were, and of each channel."""
    profiles = RangeCompressor.for_block(psf.pulses)(psf.pulses)
    target = np.array(psf.truth['scatterers'][0]['position_m'])
    pattern, options = None, {}
    if weighted:
        antenna = Antenna('gaussian', azimuth_width_deg=1.0)
        pattern, options = antenna.amplitudes(), {
            'antenna.pattern': 'gaussian', 'antenna.azimuth_width': 1.0}
        looks = Pointing.steered(profiles.phase_centre_m, target + [0.0, 90.0, 0.0])
        lit = Illumination.of_pulses(pattern, looks, profiles.tx_m, profiles.rx_m)
        amplitude = lit.amplitude(target).reshape(200, -1, 1).astype(np.float32)
        assert 20 * np.log10(amplitude.mean()) < -3
        profiles = dataclasses.replace(profiles, pointing=looks,
                                       samples=profiles.samples * amplitude)
    grid = MapGrid(tuple(target), 21, 21, 0.5)
    live = LiveSubapertures(grid, pulses_per_aperture=100, pulses_per_subaperture=25,
                            illumination=pattern, sliding=sliding)
    step, log = make(FusionStep, **options, **{
        'radiometry.quantity': 'rcs', 'radiometry.constant_file': constant,
        'strip_max_pixels': 10_000})
    outputs = Outputs('image_complex')
    step.create_outputs(outputs)
    for sent in (as_received(part) for part in live.add(profiles)):
        for product in step.process(sent):
            step.publish(product)
    peaks = [np.abs(complex_from_message(message)).max()
             for message in outputs.sent['image_complex']]
    assert len(peaks) >= (5 if sliding else 2)
    # 0.02 dB measured: the pixel on the reflector, tracks between ends, -60 dB of AFBP
    assert 20 * np.log10(peaks) == pytest.approx(
        np.full(len(peaks), 10 * np.log10(SIZE_M2)), abs=0.1)
    assert log['images_not_calibrated'] == 0 and log['responses_computed'] >= 1
    strip, _ = step._strip.form()
    assert 20 * np.log10(np.abs(strip).max()) == pytest.approx(10 * np.log10(SIZE_M2), abs=0.1)


def test_sub_apertures_that_were_weighed_otherwise_give_no_brightness(psf, constant):
    profiles = RangeCompressor.for_block(psf.pulses)(psf.pulses)
    live = LiveSubapertures(MapGrid((10_000.0, 0.0, 0.0), 21, 21, 0.5), pulses_per_aperture=100,
                            pulses_per_subaperture=25)
    step, log = make(FusionStep, **{
        'radiometry.quantity': 'rcs', 'radiometry.constant_file': constant,
        'antenna.pattern': 'gaussian', 'antenna.azimuth_width': 1.0})
    outputs = Outputs('image_complex')
    step.create_outputs(outputs)
    for sent in live.add(profiles):
        for product in step.process(sent):
            step.publish(product)
    assert outputs.sent['image_complex'] == []
    assert log['images_not_calibrated'] == 2
    assert any('set antenna.pattern and what belongs to it' in line for line in log.lines)
