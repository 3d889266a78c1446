"""Channel errors put into simulated profiles and estimated from them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from sar_imaging.imaging.calibration import (
    balance_channels,
    calibrate_at_reflector,
    find_reflector,
)
from sar_imaging.signal.calibration import ChannelCalibration
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters, Waveform
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.echoes import EchoSimulator

CELL_S = 1 / 3.75e9  # of the simulated radar
RADAR = RadarParameters(carrier_hz=61.9e9, bandwidth_hz=3.75e9, sample_rate_hz=3.75e9,
                        first_sample_delay_s=2 * 2.0 / 299_792_458.0,
                        waveform=Waveform.STEPPED_FREQUENCY)
ERRORS = ChannelCalibration(
    [1.2, 0.8, 1.0, 1.1, 0.9, 1.25, 0.85, 1.0], np.radians([-25, 40, 10, -35, 20, 5, -30, 15]),
    CELL_S * np.array([0.3, -0.2, 0.1, -0.3, 0.2, 0.0, -0.25, 0.15]))


def _array(n_pulses, spacing_m):
    """(P, 8, 3) transmit and receive phase centres: a line of eight moving along itself."""
    channel = 1.25e-3 * (np.arange(8) - 3.5)
    place = (np.arange(n_pulses) - (n_pulses - 1) / 2) * spacing_m
    x = place[:, None] + 2 * channel
    return (np.stack([f, 0 * f, 0 * f], axis=-1) for f in (0 * x + place[:, None], x))


def _profiles(points, amplitudes, n_pulses, spacing_m, errors=ERRORS, noise=0.0):
    tx, rx = _array(n_pulses, spacing_m)
    samples = EchoSimulator(RADAR, 128, compressed=False, points_m=points,
                            amplitudes=amplitudes)(tx, rx)
    frequency = (np.arange(128) - 63.5) * RADAR.bandwidth_hz / 128
    samples = samples / errors.correction(frequency)
    rng = np.random.default_rng(7)
    samples += noise * rng.standard_normal((*samples.shape, 2)).view(complex)[..., 0]
    count = np.arange(n_pulses)
    block = PulseBlock(RADAR, False, count, count, samples, tx, rx)
    return RangeCompressor.for_block(block)(block)


def _assert_near(found, expected, *, amplitude, phase_deg, delay_cells):
    """Relative errors agree: factor, degrees, resolution cells."""
    relative = np.exp(1j * (found.phase_rad - expected.phase_rad))
    phase = np.degrees(np.angle(relative * np.conj(relative.mean())))
    late = (found.delay_s - expected.delay_s) / CELL_S
    factor = found.amplitude / expected.amplitude
    assert np.abs(phase).max() < phase_deg
    assert np.abs(late - late.mean()).max() < delay_cells
    assert np.abs(factor / np.exp(np.mean(np.log(factor))) - 1).max() < amplitude


def test_reflector_tells_the_errors():
    place = np.array([0.21, 1.93, 0.08])
    profiles = _profiles([place, [-0.3, 2.1, 0.0]], [1.0, 0.5], 16, 2.5e-3, noise=0.3)
    found = calibrate_at_reflector(profiles, place)
    # Noise and the neighbour's sidelobes: measured 0.9 %, 0.9 degrees, 0.006 cells
    _assert_near(found, ERRORS, amplitude=0.02, phase_deg=1.5, delay_cells=0.015)
    # Relative to the mean of the channels, in phase that of their phasors.
    assert abs(np.angle(np.exp(1j * found.phase_rad).sum())) < 1e-6
    assert abs(np.log(found.amplitude).sum()) < 1e-6 and abs(found.delay_s.sum()) < 1e-18
    again = calibrate_at_reflector(found.apply(profiles), place)
    _assert_near(again, ChannelCalibration.none(8), amplitude=1e-3, phase_deg=0.1,
                 delay_cells=1e-3)


def test_reflector_is_found_without_calibration():
    place = np.array([0.05, 1.93, 0.0])
    profiles = _profiles([place, [-0.2, 2.2, 0.0]], [1.0, 0.5], 128, 1.2e-3)
    x, y = np.meshgrid(np.arange(-0.3, 0.31, 0.01), np.arange(1.7, 2.3, 0.015))
    found = find_reflector(profiles, np.stack([x, y, 0 * x], axis=-1))
    # half a pixel; the channels' delays have the mean zero
    assert np.abs(found - place)[:2].max() <= 0.01


def test_reflector_out_of_reach_is_told():
    profiles = _profiles([[0.0, 1.93, 0.0]], [1.0], 4, 2.5e-3)
    with pytest.raises(ValueError, match=r'no peak within 0\.160 m'):
        calibrate_at_reflector(profiles, [0.0, 1.6, 0.0])


def _scene(n=40):
    rng = np.random.default_rng(11)
    points = np.stack([rng.uniform(-0.7, 0.7, n), rng.uniform(1.75, 2.2, n), 0 * np.zeros(n)],
                      axis=1)
    amplitudes = rng.rayleigh(1.0, n) * np.exp(2j * np.pi * rng.uniform(size=n))
    x, y = np.meshgrid(np.arange(-0.75, 0.76, 0.02), np.arange(1.7, 2.25, 0.02))
    return points, amplitudes, np.stack([x, y, 0 * x], axis=-1)


def test_long_aperture_is_balanced_by_coherence():
    points, amplitudes, pixels = _scene()
    profiles = _profiles(points, amplitudes, 128, 1.2e-3, noise=0.3)
    result = balance_channels(profiles, pixels)
    assert result.method == 'coherence' and result.coherence > 0.7
    # measured 0.4 %, 0.06 degrees, 0.0004 cells, 1.3 dB
    _assert_near(result.calibration, ERRORS, amplitude=0.01, phase_deg=0.3, delay_cells=2e-3)
    assert result.peak_gain_db > 0.8


def _without_slope(calibration):
    """The errors without what is linear along the channels, which the scene cannot tell."""
    n = np.arange(8) - 3.5
    phase, delay = (v - n * (n @ v) / (n @ n) for v in (calibration.phase_rad,
                                                        calibration.delay_s))
    return dataclasses.replace(calibration, phase_rad=phase, delay_s=delay)


def test_array_that_resolves_only_as_a_whole_is_balanced_by_sharpness():
    points, amplitudes, pixels = _scene(12)
    profiles = _profiles(points, amplitudes, 3, 20e-3, noise=0.1)
    result = balance_channels(profiles, pixels)
    assert result.method == 'sharpness' and result.coherence < 0.4
    # measured 1.2 %, 1.4 degrees, 0.01 cells, 1.2 dB
    _assert_near(_without_slope(result.calibration), _without_slope(ERRORS), amplitude=0.03,
                 phase_deg=3.0, delay_cells=0.03)
    assert result.peak_gain_db > 0.8


@pytest.mark.parametrize(('change', 'message'), [
    (lambda b: dataclasses.replace(b, samples=b.samples[:, :1], tx_m=b.tx_m[:, :1],
                                   rx_m=b.rx_m[:, :1]), 'nothing to be balanced against'),
    (lambda b: dataclasses.replace(b, samples=0 * b.samples), 'has no echo in the pixels')])
def test_blocks_without_anything_to_balance_are_refused(change, message):
    profiles = _profiles([[0.0, 1.93, 0.0]], [1.0], 4, 2.5e-3)
    with pytest.raises(ValueError, match=message):
        balance_channels(change(profiles), [[0.0, 1.93, 0.0], [0.0, 1.95, 0.0]])


def test_no_pulse_is_refused():
    profiles = _profiles([[0.0, 1.93, 0.0]], [1.0], 4, 2.5e-3)
    with pytest.raises(ValueError, match='no pulse'):
        calibrate_at_reflector(profiles.select(slice(0, 0)), [0.0, 1.93, 0.0])
