# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The tool calibrate: a recording with channel errors in, a YAML file out."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from sar_imaging.geometry.grids import MapGrid
from sar_imaging.recordings.bag_io import write_bag
from sar_imaging.recordings.truth import make_truth
from sar_imaging.signal.calibration import ChannelCalibration
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters
from sar_imaging.simulation.echoes import EchoSimulator
from sar_imaging.tools import calibrate

RADAR = RadarParameters(carrier_hz=10e9, bandwidth_hz=300e6, sample_rate_hz=400e6,
                        first_sample_delay_s=2 * 480.0 / 299_792_458.0)
ERRORS = ChannelCalibration([1.1, 0.8, 1.15], np.radians([-60.0, 100.0, -40.0]),
                            np.array([0.2, -0.3, 0.1]) / 300e6)
POINT = (500.0, 2.0, 0.0)


@pytest.fixture(scope='module')
def block():
    tx = np.zeros((128, 3, 3))
    tx[:, :, 1] = 0.5 * (np.arange(128) - 63.5)[:, None]
    rx = tx + np.array([[0, -0.1, 0], [0, 0, 0], [0, 0.1, 0]])
    simulate = EchoSimulator(RADAR, 160, compressed=True, amplitudes=[1.0, 0.5],
                             points_m=[POINT, (510.0, -3.0, 0.0)])
    frequency = np.fft.fftfreq(160, 1 / RADAR.sample_rate_hz)
    samples = np.fft.ifft(np.fft.fft(simulate(tx, rx)) / ERRORS.correction(frequency))
    count = np.arange(128)
    return PulseBlock(RADAR, True, 10**18 + count * 10**7, count, samples, tx, rx)


GRID = MapGrid.from_size((504.0, 0.0, 0.0), 20.0, 20.0, 0.25)


@pytest.fixture
def bag(block, tmp_path):
    truth = make_truth(scenario='x', description='', scatterers=[], grid=GRID,
                       pulses_per_aperture=128, n_pulses=128, n_channels=3,
                       cut_half_width_m=(3.0, 3.0), radar=RADAR, compressed=True)
    write_bag(tmp_path / 'bag', [block], truth)
    return tmp_path / 'bag'


def _assert_errors(found, *, amplitude=0.001, phase_deg=0.1, delay_cells=0.005):
    relative = np.exp(1j * (found.phase_rad - ERRORS.phase_rad))
    turned = np.degrees(np.angle(relative * np.conj(relative.mean())))
    factor = found.amplitude / ERRORS.amplitude
    late = (found.delay_s - ERRORS.delay_s) * RADAR.bandwidth_hz
    assert np.abs(turned).max() < phase_deg
    assert np.abs(factor / np.exp(np.log(factor).mean()) - 1).max() < amplitude
    assert np.abs(late - late.mean()).max() < delay_cells


@pytest.mark.parametrize('source', [
    ['--reflector', *map(str, POINT)], ['--find-reflector'], []])
def test_errors_of_a_recording_go_to_a_file(bag, tmp_path, capsys, source):
    output = tmp_path / 'channels.yaml'
    assert calibrate.main([str(bag), '--output', str(output), *source]) == 0
    out = capsys.readouterr().out
    assert ('coherence' if not source else 'reflector at (500.0') in out
    assert 'channel 2: amplitude' in out
    # measured 0.01 %, 0.008 degrees, 0.0006 cells
    _assert_errors(ChannelCalibration.load(output))


def test_delays_may_be_left_out(block):
    calibration, _ = calibrate.calibrate(block, GRID, reflector_m=POINT, delays=False)
    assert not calibration.delay_s.any()
    _assert_errors(dataclasses.replace(calibration, delay_s=ERRORS.delay_s))


def test_what_cannot_be_calibrated_is_told(bag, block, tmp_path, capsys):
    output = tmp_path / 'channels.yaml'
    for arguments, message in (([str(tmp_path), '--aperture', '0'], 'without metadata.yaml'),
                               ([str(bag), '--aperture', '3'], 'has no aperture 3'),
                               ([str(bag), '--reflector', '400', '0', '0'], 'profiles cover'),
                               ([str(bag), '--reflector', '523', '0', '0'], 'stands out')):
        assert calibrate.main([*arguments, '--output', str(output)]) == 1
        assert message in capsys.readouterr().err
    assert not output.exists()
    one = dataclasses.replace(block, samples=block.samples[:, :1], tx_m=block.tx_m[:, :1],
                              rx_m=block.rx_m[:, :1])
    with pytest.raises(calibrate.CalibrationFailed, match='one channel'):
        calibrate.calibrate(one, GRID)
    with pytest.raises(calibrate.CalibrationFailed, match='without phase centres'):
        calibrate.calibrate(dataclasses.replace(block, tx_m=None, rx_m=None), GRID)
