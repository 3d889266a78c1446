"""The Gotcha loader: on made-up files of the same form, and on the measured ones."""

from __future__ import annotations

import pathlib

import numpy as np
import pytest
from scipy.io import savemat

from sar_imaging.signal.pulses import concatenate
from sar_imaging.signal.radar import SPEED_OF_LIGHT, Waveform
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.tools.measured import load_gotcha
from sar_imaging.tools.recordings.bag_io import BagError, read_blocks, read_truth

MEASURED = pathlib.Path(__file__).parents[4] / 'shared' / 'data' / 'gotcha_pass1_hh'
POINTS = np.array([[-15.6, 21.6, 0.0], [30.0, -40.0, 1.5]])
AMPLITUDES = np.array([1.0, 0.4j])


def _write_file(path, azimuth_deg, **changes):
    """A file like the real ones: a circular arc at 10 km, float32 but for the samples."""
    azimuth = np.radians(azimuth_deg)
    radius, height = 7089.0, 7275.5
    # The rounded positions are the true ones here, so that the samples' phase is exact.
    position = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth),
                         np.full(azimuth.size, height)], axis=1).astype(np.float32).astype(float)
    r0 = np.linalg.norm(position, axis=1)
    frequency = 9.2880796e9 + 1.4713e6 * np.arange(424)
    path_m = np.linalg.norm(position[:, None] - POINTS, axis=2) - r0[:, None]
    phase = frequency[:, None, None] * path_m
    samples = np.exp(-4j * np.pi / SPEED_OF_LIGHT * phase) @ AMPLITUDES
    data = {'fp': samples.astype(np.complex64), 'freq': frequency.astype(np.float32)[:, None],
            'r0': r0.astype(np.float32)}
    data |= {name: position[:, i].astype(np.float32) for i, name in enumerate('xyz')}
    savemat(path, {'data': data | changes})


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / 'mat'
    path.mkdir()
    _write_file(path / 'az002.mat', np.linspace(1.0, 1.9, 11))
    _write_file(path / 'az001.mat', np.linspace(0.0, 0.9, 12))
    return path


def test_samples_follow_the_signal_model(folder):
    block = load_gotcha.read_folder(folder)
    radar = block.radar
    assert radar.waveform == Waveform.STEPPED_FREQUENCY and not block.compressed
    assert block.samples.shape == (23, 1, 424)
    assert radar.bandwidth_hz == pytest.approx(424 * 1.4713e6, rel=1e-6)
    np.testing.assert_array_equal(block.tx_m, block.rx_m)
    assert np.all(np.diff(block.tx_m[:, 0, 1]) > 0)  # files in the order of their names
    frequency = radar.carrier_hz + (np.arange(424) - 211.5) * radar.bandwidth_hz / 424
    delay = (2 * np.linalg.norm(block.tx_m - POINTS, axis=2) / SPEED_OF_LIGHT
             - radar.first_sample_delay_s)
    expected = np.exp(-2j * np.pi * frequency[:, None] * delay[:, None]) @ AMPLITUDES
    # Rounding the frequencies to float32, 512 Hz, turns points 60 m from the middle by 1e-3 rad.
    np.testing.assert_allclose(block.samples[:, 0], expected, rtol=0, atol=2e-3)


def test_bag_holds_all_pulses_as_one_aperture(folder, tmp_path, capsys):
    output = tmp_path / 'bag'
    assert load_gotcha.main([str(folder), '--output', str(output)]) == 0
    assert '23 pulses in 1 messages' in capsys.readouterr().out
    block = concatenate(list(read_blocks(output)))
    np.testing.assert_array_equal(block.counter, np.arange(23))
    np.testing.assert_array_equal(np.diff(block.stamp_ns), 10_000_000)
    truth = read_truth(output)
    assert truth['pulses_per_aperture'] == truth['n_pulses'] == 23
    assert truth['scatterers'][0]['position_m'] == [-15.60, 21.60, 0.0]
    assert truth['grid'] == {'centre_m': [0.0, 0.0, 0.0], 'n_x': 1001, 'n_y': 1001,
                             'spacing_m': 0.1}
    assert load_gotcha.main([str(folder), '--output', str(output)]) == 1
    assert '--force' in capsys.readouterr().err


@pytest.mark.parametrize(('changes', 'message'), [
    ({'freq': np.linspace(9.2e9, 9.9e9, 424)}, 'other frequencies'),
    ({'fp': np.zeros((424, 7), np.complex64)}, 'does not match'),
    ({'r0': np.full(11, 10_158.0, np.float32)}, 'motion compensation to the origin')])
def test_files_that_do_not_fit_are_refused(folder, changes, message):
    _write_file(folder / 'az002.mat', np.linspace(1.0, 1.9, 11), **changes)
    with pytest.raises(BagError, match=message):
        load_gotcha.read_folder(folder)


def test_uneven_frequencies_are_refused(tmp_path):
    _write_file(tmp_path / 'az001.mat', np.linspace(0, 1, 5),
                freq=9.3e9 + 1.5e6 * np.arange(424) ** 1.01)
    with pytest.raises(BagError, match='expected a uniform grid'):
        load_gotcha.read_folder(tmp_path)


def test_other_files_are_refused(tmp_path, capsys):
    assert load_gotcha.main([str(tmp_path), '--output', str(tmp_path / 'bag')]) == 1
    assert 'holds no .mat file' in capsys.readouterr().err
    savemat(tmp_path / 'other.mat', {'image': np.zeros(3)})
    with pytest.raises(BagError, match=r'other\.mat is not a Gotcha file'):
        load_gotcha.read_folder(tmp_path)
    (tmp_path / 'other.mat').write_bytes(b'no MATLAB at all')
    with pytest.raises(BagError, match=r'other\.mat is not a Gotcha file'):
        load_gotcha.read_folder(tmp_path)
    assert not (tmp_path / 'bag').exists()


@pytest.mark.data
@pytest.mark.skipif(not MEASURED.is_dir(), reason='needs the AFRL Gotcha files in '
                    '../shared/data/gotcha_pass1_hh beside the repository')
def test_measured_reflectors_focus_where_they_stand():
    block = load_gotcha.read_folder(MEASURED)
    assert block.n_pulses == 469
    profiles = RangeCompressor.for_block(block, oversampling=16.0)(block)
    radar = profiles.radar
    truth = load_gotcha.gotcha_truth(block)
    for scatterer in truth['scatterers']:
        x0, y0, _ = scatterer['position_m']
        offsets = np.linspace(-0.5, 0.5, 21)
        x, y = np.meshgrid(x0 + offsets, y0 + offsets)
        points = np.stack([x, y, np.zeros_like(x)], axis=-1)
        image = np.zeros(x.shape, complex)
        for position, samples in zip(profiles.tx_m[:, 0], profiles.samples[:, 0], strict=True):
            delay = 2 * np.linalg.norm(points - position, axis=-1) / SPEED_OF_LIGHT
            where = (delay - radar.first_sample_delay_s) * radar.sample_rate_hz
            image += (np.interp(where, np.arange(samples.size), samples)
                      * np.exp(2j * np.pi * (radar.carrier_hz * delay % 1.0)))
        row, column = np.unravel_index(np.abs(image).argmax(), image.shape)
        # The pixels are 5 cm apart, a sixth of the resolution.
        assert np.hypot(x[row, column] - x0, y[row, column] - y0) <= 0.05 * np.sqrt(2) + 1e-9
        # The brightest point of a profile is the first reflector plus what lies at its range;
        # measured 0.71 of it for both reflectors after allowing for their amplitudes. Pulses
        # without a common phase would leave 1 / sqrt(469) = 0.05.
        level = np.abs(image[row, column]) / block.n_pulses
        brightest = np.abs(profiles.samples[:, 0]).max(axis=1).mean()
        assert level == pytest.approx(
            0.71 * brightest * 10 ** (scatterer['amplitude_db'] / 20), rel=0.05)
