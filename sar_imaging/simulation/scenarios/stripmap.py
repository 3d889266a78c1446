"""Scenario `stripmap`: an antenna whose beam passes over the scene."""

from __future__ import annotations

import numpy as np

from ...geometry.grids import MapGrid
from ...geometry.illumination import Antenna, Mount
from ...signal.radar import SPEED_OF_LIGHT, RadarParameters
from ..scene import Scatterer
from ..trajectory import Trajectory
from .scenario import Scenario

_HEIGHT_M, _GROUND_M = 300.0, 400.0
# Name, x, y (m), amplitude in dB: none shares a row or a column with another.
_SCENE = (('silo', 0.0, 0.0, 0.0), ('barn', -9.0, -31.0, -3.0), ('mast', 8.0, 29.0, -6.0),
          ('fence', 4.0, -16.0, -10.0), ('tank', -5.0, 15.0, -8.0))


def stripmap() -> Scenario:
    """Aircraft whose beam of 6 degrees looks to the right; each scatterer is lit for a while."""
    sample_rate_hz, n_pulse = 200e6, 80
    pulse_length_s = n_pulse / sample_rate_hz
    radar = RadarParameters(carrier_hz=10e9, bandwidth_hz=150e6, sample_rate_hz=sample_rate_hz,
                            first_sample_delay_s=2 * 450.0 / SPEED_OF_LIGHT,
                            pulse_length_s=pulse_length_s,
                            chirp_rate_hz_per_s=150e6 / pulse_length_s)
    return Scenario(
        name='stripmap',
        description='Light aircraft at 300 m with a beam of 6 degrees to its right, slant range '
                    '500 m, 10 GHz, 150 MHz, raw LFM pulses, five scatterers, noise',
        radar=radar, compressed=False, n_samples=160 + n_pulse, prf_hz=320.0, n_pulses=1280,
        pulses_per_aperture=1280,
        trajectory=Trajectory(centre_m=(-_GROUND_M, 0.0, _HEIGHT_M),
                              velocity_m_per_s=(0.0, 40.0, 0.0)),
        tx_offsets_m=((0.0, 0.0, 0.0),), rx_offsets_m=((0.0, 0.0, 0.0),),
        scatterers=tuple(Scatterer(name, (x, y, 0.0), 10 ** (db / 20))
                         for name, x, y, db in _SCENE),
        grid=MapGrid.from_size((0.0, 0.0, 0.0), 36.0, 120.0, 0.5), cut_half_width_m=(5.0, 2.0),
        noise_std=0.5, seed=6,
        antenna=Antenna('sinc', azimuth_width_deg=6.0, elevation_width_deg=20.0),
        mount=Mount('track', side='right',
                    depression_deg=float(np.degrees(np.arctan2(_HEIGHT_M, _GROUND_M)))),
        notes='Invented; looks along +x, flies along +y; the beam lights 52 m of the ground')
