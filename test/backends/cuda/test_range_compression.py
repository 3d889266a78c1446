# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Range compression on the device against the processor's, from samples here and there."""

import dataclasses
import logging

import numpy as np
import pytest

from sar_imaging.backends import DeviceError, samples as of_samples
from sar_imaging.backends.cuda import transfers
from sar_imaging.backends.cuda.arrays import given, xp
from sar_imaging.backends.samples import compress, to_device
from sar_imaging.device_arrays import on_device, to_host
from sar_imaging.geometry import MapGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.memory import granting
from sar_imaging.signal import PulseBlock, RadarParameters, Waveform
from sar_imaging.signal.calibration import ChannelCalibration
from sar_imaging.signal.range_compression import RangeCompressor

AGREE_DB = -120.0  # measured -136 dB in the simulator: float32 transforms of another library
CALIBRATION = ChannelCalibration([1.0, 0.9], [0.0, 20.0], [0.0, 2e-10])
RADARS = {
    'LFM': RadarParameters(10e9, 300e6, 400e6, 6.2e-6, pulse_length_s=2e-7,
                           chirp_rate_hz_per_s=1.5e15),
    'stepped frequency': RadarParameters(10e9, 300e6, 300e6, 6.2e-6,
                                         waveform=Waveform.STEPPED_FREQUENCY),
    'falling FMCW': RadarParameters(10e9, 300e6, 2e6, 1e-7, waveform=Waveform.FMCW,
                                    chirp_rate_hz_per_s=-3e12),
    'real FMCW': RadarParameters(10e9, 300e6, 2e6, 1e-7, waveform=Waveform.FMCW_REAL,
                                 chirp_rate_hz_per_s=3e12),
    'passband': RadarParameters(1e9, 300e6, 4e9, 6.2e-6, waveform=Waveform.PASSBAND)}


def noise(radar, n_samples=200, compressed=False):
    """Pulses of noise from places beside x = 930 m, and their integers."""
    rng = np.random.default_rng(3)
    pairs = rng.integers(-2 ** 12, 2 ** 12, (5, 2, n_samples, 2), dtype=np.int16)
    tx = np.zeros((5, 2, 3))
    tx[..., 1] = np.arange(10).reshape(5, 2)
    samples = pairs.astype(np.float32).view(np.complex64)[..., 0]
    return PulseBlock(radar, compressed, np.arange(5), np.arange(5), samples, tx, tx), pairs


@pytest.mark.parametrize('name', RADARS)
def test_profiles_are_those_of_the_processor(name, error_db, monkeypatch):
    """Of all waveforms, calibrated, in pieces, from complex numbers and from integers."""
    monkeypatch.setattr(transfers, '_PIECE_BYTES', 2 * 2 * 8 * 400)
    block, pairs = noise(RADARS[name])
    compressor = RangeCompressor.for_block(block, window='hamming', calibration=CALIBRATION)
    wanted = compressor(block)
    integers = dataclasses.replace(block, samples=to_device(pairs))
    np.testing.assert_array_equal(to_host(integers.samples), block.samples)
    for some, backend in ((block, 'cuda'), (integers, 'cuda'), (integers, 'auto')):
        found = compress(compressor, some, backend)
        assert on_device(found.samples) and found.radar == wanted.radar and found.compressed
        assert error_db(to_host(found.samples), wanted.samples) < AGREE_DB
    assert error_db(to_host(compressor(integers).samples), wanted.samples) < AGREE_DB


def test_profiles_that_come_are_cut_there(error_db):
    block, _ = noise(RADARS['LFM'], compressed=True)
    compressor = RangeCompressor.for_block(block, oversampling=1.0, range_window_m=(940.0, 960.0))
    found = compress(compressor, block, 'cuda')
    np.testing.assert_array_equal(to_host(found.samples), compressor(block).samples)


def test_raw_pulses_are_compressed_and_imaged_there(error_db, monkeypatch):
    """Profiles stay on the device, and the image comes back where the samples came from here."""
    block, _ = noise(RADARS['LFM'])
    grid = MapGrid((945.0, 5.0, 0.0), 6, 6, 0.25)
    compressed = []
    monkeypatch.setattr(transfers, 'given', lambda array: compressed.append(1) or given(array))
    there = dataclasses.replace(block, samples=given(xp.asarray(block.samples)))
    images = [plan_image(grid, block.radar, block.n_samples, compressed=False, method='exact',
                         backend=name)(some).samples
              for name, some in (('cpu', block), ('cuda', block), ('cuda', there))]
    assert len(compressed) > 2
    assert not on_device(images[1]) and on_device(images[2])
    for image in images[1:]:
        assert error_db(to_host(image), images[0]) < -100.0  # sums in another order


def test_what_is_not_finite_is_refused(monkeypatch):
    block, _ = noise(RADARS['LFM'])
    samples = block.samples.copy()
    samples[3, 1, 7] = np.inf
    broken = dataclasses.replace(block, samples=samples)
    with pytest.raises(ValueError, match=r'1 of 2000 samples are NaN or infinite, in 1 of 5 '
                                         r'pulses \(3 \(1\)\)'):
        compress(RangeCompressor.for_block(block), broken, 'cuda')


def test_what_does_not_fit_is_refused_and_the_processor_takes_over(monkeypatch, caplog):
    block, pairs = noise(RADARS['LFM'])
    compressor = RangeCompressor.for_block(block)
    with granting(10_000), pytest.raises(DeviceError, match=(
            r'5 x 2 x \d+ samples needs 0.0\d+ MB of device memory, 0.010 MB are free; take')):
        compress(compressor, block, 'cuda')
    there = dataclasses.replace(block, samples=to_device(pairs))
    with granting(10_000), caplog.at_level(logging.WARNING):
        found = compress(compressor, there, 'auto')
    np.testing.assert_array_equal(found.samples, compressor(block).samples)
    assert len(caplog.messages) == 1 and caplog.messages[0].endswith('; the processor computes')
    with pytest.raises(ValueError, match="CUDA device, where backend='cpu' does not reach them"):
        compress(compressor, there, 'cpu')


@pytest.mark.parametrize(('worth', 'calls'), [(True, 1), (False, 0)])
def test_the_device_where_the_way_is_worth_it(monkeypatch, worth, calls):
    """By predicted times; profiles of samples of the host come back."""
    block, _ = noise(RADARS['LFM'])
    compressor, made = RangeCompressor.for_block(block), []
    monkeypatch.setattr(of_samples, '_worth_the_way', lambda *_: worth)
    monkeypatch.setattr(of_samples, '_entry', lambda name: lambda *arguments: made.append(
        name) or getattr(transfers, name)(*arguments))
    assert isinstance(compress(compressor, block).samples, np.ndarray)
    assert made == ['compress'] * calls
