"""Scenario `raster_scan`: a radar on a scanner of two axes, which resolves height."""

from __future__ import annotations

from ...geometry.grids import MapGrid
from ...signal.radar import SPEED_OF_LIGHT, RadarParameters
from ..scene import Scatterer
from ..trajectory import RasterScan
from .scenario import Scenario

_ROWS, _PER_ROW, _STEP_M = 24, 24, 0.015
_PULSE_S = 60 / 1.5e9
# Name, x, y, z (m), amplitude in dB: no two share a height, a distance or a direction.
_SHELF = (('lamp', -0.40, 3.70, 1.05, 0.0), ('kettle', 0.33, 3.58, 0.72, -3.0),
          ('tin', 0.45, 4.24, 0.36, -2.0), ('box', -0.15, 4.36, 0.15, 0.0),
          ('bottle', 0.06, 3.94, 0.51, -5.0))


def raster_scan() -> Scenario:
    """24 GHz radar on a scanner of 35 cm by 35 cm before five things at different heights."""
    half_m = (_PER_ROW - 1) * _STEP_M / 2
    return Scenario(
        name='raster_scan',
        description='24 GHz radar on a scanner of 35 cm by 35 cm, 24 rows of 24 places, 1 GHz, '
                    'raw LFM pulses, five things at different heights 4 m away, noise: a volume',
        radar=RadarParameters(carrier_hz=24e9, bandwidth_hz=1e9, sample_rate_hz=1.5e9,
                              first_sample_delay_s=2 * 1.0 / SPEED_OF_LIGHT,
                              pulse_length_s=_PULSE_S, chirp_rate_hz_per_s=1e9 / _PULSE_S),
        compressed=False, n_samples=124, prf_hz=100.0, n_pulses=_ROWS * _PER_ROW,
        pulses_per_aperture=_ROWS * _PER_ROW,
        trajectory=RasterScan((-half_m, 0.0, 0.6 - half_m), (_STEP_M, 0.0, 0.0),
                              (0.0, 0.0, _STEP_M), _PER_ROW, 100.0),
        tx_offsets_m=((0.0, 0.0, 0.0),), rx_offsets_m=((0.0, 0.0, 0.0),),
        scatterers=tuple(Scatterer(name, (x, y, z), 10 ** (db / 20))
                         for name, x, y, z, db in _SHELF),
        # A reflector appears again after wavelength x range / 2 / step, 1.7 m.
        grid=MapGrid.from_size((0.0, 4.0, 0.0), 1.2, 1.2, 0.03), height_m=1.2,
        cut_half_width_m=(0.5, 0.3), noise_std=0.3, seed=24,
        notes='Invented; looks along +y, scans along x and z')
