# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The scenarios of `simulate`: those of the papers, moving targets, two passes and more.

A configuration makes one as well: a few scatterers as the configured radar receives them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ...configuration.derived import derive
from ...configuration.settings import Acquisition, Imaging, Machine
from ...geometry.antenna import Antenna, Mount
from ...geometry.grids import MapGrid
from ...signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from ..movers import Mover
from ..noise import complex_gaussian
from ..scene import Clutter, Scatterer, letter_s
from ..trajectory import RasterScan, Trajectory, Vibration
from .countryside import countryside
from .scenario import Scenario, receive_array

_SEED = 1993
_GROUND_SEED = 1 << 32  # streams of the scene; those below are the noise of pulses
_PITCH_M = 0.3  # of the lattice of the ground, finer than the resolution of 0.5 m by 0.43 m
_GROUND_M = 26.0  # half of its sides
_CAR_DB = 20.0  # of each of its points, over one of the ground
_REFLECTOR_DB = 30.0

TERRACE_M = ((-10.0, 12.0), (4.0, 18.0))  # sides along x and y
TERRACE_HEIGHT_M = 1.5
CAR_M = {'first_pass': (-9.0, -8.0), 'second_pass': (8.0, -13.0)}
BASELINE_M = (0.3, 0.0, 1.4)  # from the first track to the second


def first_pass() -> Scenario:
    """The first of two passes over speckled ground with a terrace and a car."""
    return _pass('first_pass', 'First of two passes over speckled ground with a terrace of '
                 f'{TERRACE_HEIGHT_M:g} m and a car, slant range 1 km, 10 GHz, 300 MHz, range '
                 'compressed', (0.0, 0.0, 0.0), 1)


def second_pass() -> Scenario:
    """The second pass from a track beside the first, after the car has moved."""
    return _pass('second_pass', 'Second pass over the ground of first_pass, 1.4 m higher, after '
                 'the car has moved', BASELINE_M, 2)


def _pass(name: str, description: str, baseline_m: ArrayLike, seed: int) -> Scenario:
    radar = RadarParameters(carrier_hz=10e9, bandwidth_hz=300e6, sample_rate_hz=400e6,
                            first_sample_delay_s=2 * 952.0 / SPEED_OF_LIGHT)
    return Scenario(
        name=name, description=description, radar=radar, compressed=True, n_samples=260,
        # 0.25 m between pulses repeat a scatterer every 60 m in azimuth, beyond the ground
        prf_hz=400.0, n_pulses=140, pulses_per_aperture=140,
        trajectory=Trajectory(tuple(np.add((-707.0, 0.0, 707.0), baseline_m)), (0.0, 100.0, 0.0)),
        tx_offsets_m=((0.0, 0.0, 0.0),), rx_offsets_m=((0.0, 0.0, 0.0),),
        scatterers=(Scatterer('reflector', (18.0, 0.0, 0.0), 10 ** (_REFLECTOR_DB / 20)),),
        grid=MapGrid.from_size((0.0, 0.0, 0.0), 48.0, 48.0, 0.25),
        cut_half_width_m=(4.0, 4.0), noise_std=2.0, seed=seed, clutter=_scene(CAR_M[name]),
        notes='Invented; looks along +x, flies along +y')


def _scene(car_m: Sequence[float]) -> Clutter:
    """Ground with its terrace, the same in both passes, and the car."""
    along = np.arange(-_GROUND_M, _GROUND_M, _PITCH_M)
    x, y = (v.ravel() for v in np.meshgrid(along, along))
    (x0, x1), (y0, y1) = TERRACE_M
    raised = (x > x0) & (x < x1) & (y > y0) & (y < y1)
    ground = np.stack([x, y, np.where(raised, TERRACE_HEIGHT_M, 0.0)], axis=1)
    car = np.stack([v.ravel() for v in np.meshgrid(
        np.linspace(-2.2, 2.2, 6), np.linspace(-0.9, 0.9, 4), [0.4, 1.3])], axis=1)
    return Clutter(
        np.concatenate([ground, car + (*car_m, 0.0)]),
        np.concatenate([complex_gaussian(_SEED, _GROUND_SEED, len(ground)), 10 ** (_CAR_DB / 20)
                        * complex_gaussian(_SEED, _GROUND_SEED + 1, len(car))]))


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


_HEIGHT_M, _TRACK_GROUND_M = 300.0, 400.0
# Name, x, y (m), amplitude in dB: none shares a row or a column with another.
_STRIPMAP_SCENE = (('silo', 0.0, 0.0, 0.0), ('barn', -9.0, -31.0, -3.0), ('mast', 8.0, 29.0, -6.0),
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
        trajectory=Trajectory(centre_m=(-_TRACK_GROUND_M, 0.0, _HEIGHT_M),
                              velocity_m_per_s=(0.0, 40.0, 0.0)),
        tx_offsets_m=((0.0, 0.0, 0.0),), rx_offsets_m=((0.0, 0.0, 0.0),),
        scatterers=tuple(Scatterer(name, (x, y, 0.0), 10 ** (db / 20))
                         for name, x, y, db in _STRIPMAP_SCENE),
        grid=MapGrid.from_size((0.0, 0.0, 0.0), 36.0, 120.0, 0.5), cut_half_width_m=(5.0, 2.0),
        noise_std=0.5, seed=6,
        antenna=Antenna('sinc', azimuth_width_deg=6.0, elevation_width_deg=20.0),
        mount=Mount('track', side='right',
                    depression_deg=float(np.degrees(np.arctan2(_HEIGHT_M, _TRACK_GROUND_M)))),
        notes='Invented; looks along +x, flies along +y; the beam lights 52 m of the ground')


# Share of half the grid along x and y, amplitude in dB: none in the row or column of another.
_PLACES = (('middle', 0.0, 0.0, 0.0), ('north_east', 0.55, 0.62, -3.0),
           ('north_west', -0.61, 0.47, -6.0), ('south_east', 0.43, -0.57, -6.0),
           ('south_west', -0.52, -0.66, -3.0))
_CUT_NULLS = 8  # half width of the cuts that measure sidelobes


def configured_scenario(name: str, acquisition: Acquisition, imaging: Imaging, *,
                        apertures: int = 1) -> Scenario:
    """Simulated recording of a configured radar over its configured scene.

    Parameters
    ----------
    name : str
        Name of the recording.
    acquisition : Acquisition
        Radar and track.
    imaging : Imaging
        Grid and length of the aperture.
    apertures : int
        Length of the recording in apertures; the configured position is its middle.

    Returns
    -------
    Scenario
        Five scatterers on the plane of the grid.

    Raises
    ------
    ValueError
        The configuration is impossible.
    """
    derived = derive(acquisition, imaging, Machine.this_one())
    grid = imaging.grid
    half_x, half_y = 0.5 * (grid.x_m[-1] - grid.x_m[0]), 0.5 * (grid.y_m[0] - grid.y_m[-1])
    x, y, z = grid.centre_m
    scatterers = tuple(Scatterer(place, (x + u * half_x, y + v * half_y, z), 10 ** (db / 20))
                       for place, u, v, db in _PLACES)
    receivers = tuple((x, y, z) for x, y, z in acquisition.receiver_offsets().tolist())
    return Scenario(
        name=name, description=f'Configured radar {name}, five scatterers',
        radar=acquisition.radar, compressed=acquisition.compressed,
        n_samples=acquisition.n_samples, prf_hz=acquisition.prf_hz,
        n_pulses=apertures * imaging.pulses_per_aperture,
        pulses_per_aperture=imaging.pulses_per_aperture,
        trajectory=Trajectory(centre_m=acquisition.centre_m,
                              velocity_m_per_s=acquisition.velocity_m_per_s),
        tx_offsets_m=((0.0, 0.0, 0.0),) * acquisition.n_channels, rx_offsets_m=receivers,
        scatterers=scatterers, grid=grid,
        cut_half_width_m=(_CUT_NULLS * derived.range_null_m, _CUT_NULLS * derived.azimuth_null_m),
        notes='Radar, platform and grid of a configuration file')


# ------------------------------------------------------------------ Rosenberg & Gray, table 1

RANGE_CENTRE_M = 10_000.0
WAVELENGTH_M = SPEED_OF_LIGHT / 10e9
# The paper does not state the sample rate. 400 MHz makes multiples of 25, where its figure 9 has
# bumps, upsample to a multiple of the carrier; docs/reproduce/multichannel.md argues for 600 MHz
# and gives the figures for both. The exact image is the same to 0.02 dB.
SAMPLE_RATE_HZ = 400e6


def _table_1(name: str, description: str, scatterers: Sequence[Scatterer], *, grid: MapGrid,
             n_samples: int = 126, raw: bool = False) -> Scenario:
    pulse_length_s = 400 / SAMPLE_RATE_HZ if raw else 0.0
    bin_of_centre = n_samples // 2  # as in an FFT of the profile
    radar = RadarParameters(
        carrier_hz=10e9, bandwidth_hz=300e6, sample_rate_hz=SAMPLE_RATE_HZ,
        first_sample_delay_s=(2 * RANGE_CENTRE_M / SPEED_OF_LIGHT
                              - bin_of_centre / SAMPLE_RATE_HZ),
        pulse_length_s=pulse_length_s,
        chirp_rate_hz_per_s=300e6 / pulse_length_s if raw else 0.0, waveform=Waveform.LFM)
    return Scenario(
        name=name, description=description, radar=radar, compressed=not raw,
        n_samples=n_samples + 400 if raw else n_samples, prf_hz=667.0, n_pulses=200,
        pulses_per_aperture=200,
        trajectory=Trajectory(centre_m=(0.0, 0.0, 0.0), velocity_m_per_s=(0.0, 200.0, 0.0)),
        # All channels share the transmitter in the middle of the receive array (equation 3).
        tx_offsets_m=((0.0, 0.0, 0.0),) * 5, rx_offsets_m=receive_array(5, WAVELENGTH_M / 2),
        scatterers=tuple(scatterers), grid=grid, cut_half_width_m=(3.0, 15.0),
        notes='Rosenberg & Gray, Multichannel SAR Imaging with Backprojection, table 1; x is '
              'range in the slant plane, y azimuth')


def _patch_grid() -> MapGrid:
    return MapGrid.from_size((RANGE_CENTRE_M, 0.0, 0.0), 8.0, 40.0, 0.1)


def psf() -> Scenario:
    """One scatterer in the middle of the patch: the point spread function."""
    return _table_1('psf', 'Point spread function of Rosenberg & Gray: one scatterer at 10 km, '
                    '5 channels, 200 pulses, range compressed',
                    [Scatterer('centre', (RANGE_CENTRE_M, 0.0, 0.0))], grid=_patch_grid())


def psf_raw() -> Scenario:
    """The same as raw chirps of 1 microsecond."""
    return _table_1('psf_raw', 'As psf, but raw LFM pulses of 1 microsecond',
                    [Scatterer('centre', (RANGE_CENTRE_M, 0.0, 0.0))], grid=_patch_grid(),
                    raw=True)


def two_scatterers() -> Scenario:
    """Middle and top right corner of the patch, for figures 10 and 11 of the paper."""
    return _table_1('two_scatterers', 'Two scatterers of Rosenberg & Gray: middle and top right '
                    'corner of the 6 m x 30 m patch',
                    [Scatterer('centre', (RANGE_CENTRE_M, 0.0, 0.0)),
                     Scatterer('corner', (RANGE_CENTRE_M + 3.0, 15.0, 0.0))],
                    grid=_patch_grid())


def letter() -> Scenario:
    """Sample image of the paper: the letter S in a swath of 50 m by 7 m, 130 range bins."""
    return _table_1('letter_s', "Sample image of Rosenberg & Gray: the letter 'S' made of point "
                    'scatterers, 50 m x 7 m',
                    letter_s((RANGE_CENTRE_M, 0.0, 0.0)), n_samples=130,
                    grid=MapGrid.from_size((RANGE_CENTRE_M, 0.0, 0.0), 7.0, 50.0, 0.1))


# ------------------------------------------------------------------------- a light aircraft

# Name, x, y on the ground (m), amplitude in dB: neighbours share neither a row nor a column of
# the image within the width of a cut, and the weakest stand far from the strongest.
_SPOTLIGHT_SCENE = (
    ('corner_reflector', 0.0, 0.0, 0.0),
    ('north_west', -15.3, 16.2, -3.0),
    ('north', -4.1, 11.9, -12.0),
    ('north_east', 13.8, 14.3, -6.0),
    ('west', -17.6, 3.4, -9.0),
    ('east', 17.2, -3.7, -9.0),
    ('gate_post_1', 6.3, 6.9, -15.0),
    ('gate_post_2', 9.6, 9.4, -15.0),
    ('south_west', -11.2, -14.8, -6.0),
    ('south_east', 10.7, -17.1, -3.0),
)


def spotlight() -> Scenario:
    """Small aircraft at 500 m looking at ten scatterers on the ground; two apertures."""
    sample_rate_hz, n_pulse = 600e6, 180
    pulse_length_s = n_pulse / sample_rate_hz
    radar = RadarParameters(
        carrier_hz=10e9, bandwidth_hz=500e6, sample_rate_hz=sample_rate_hz,
        # The grid lies between 982 and 1020 m.
        first_sample_delay_s=2 * 975.0 / SPEED_OF_LIGHT,
        pulse_length_s=pulse_length_s, chirp_rate_hz_per_s=500e6 / pulse_length_s,
        waveform=Waveform.LFM)
    track = Trajectory(
        centre_m=(-866.0, 0.0, 500.0), velocity_m_per_s=(0.0, 25.0, 0.0),
        polynomial=((0.03, 0.02, -0.02), (-0.01, 0.0, 0.005)),
        vibrations=(Vibration((0.05, 0.02, 0.08), 0.7, 0.2), Vibration((0.002, 0.0, 0.003), 11.0)),
        broadband_m=(0.0005, 0.0005, 0.0005), seed=11)
    return Scenario(
        name='spotlight',
        description='Light aircraft at 500 m, slant range 1 km, 10 GHz, 500 MHz, 5 channels, raw '
                    'LFM pulses, ten scatterers, noise, two apertures on a perturbed track',
        radar=radar, compressed=False, n_samples=384,
        # 0.3125 m between pulses repeat a scatterer every 48 m in azimuth: beyond the 40 m grid.
        prf_hz=80.0, n_pulses=256, pulses_per_aperture=128, trajectory=track,
        tx_offsets_m=((0.0, 0.0, 0.0),) * 5, rx_offsets_m=receive_array(5, WAVELENGTH_M / 2),
        scatterers=tuple(Scatterer(name, (x, y, 0.0), 10 ** (db / 20))
                         for name, x, y, db in _SPOTLIGHT_SCENE),
        grid=MapGrid.from_size((0.0, 0.0, 0.0), 40.0, 40.0, 0.125),
        cut_half_width_m=(2.4, 2.4), noise_std=0.5, seed=2014, resolution_bits=14,
        notes='Invented, with the figures of a light aircraft; looks along +x, flies along +y')


# ------------------------------------------------------------------------- moving targets

_SCENE = 1 << 32  # streams of the scene; those below are the noise of pulses
# Name, x, y (m), velocity along x and y (m/s), amplitude: 4 to 8 dB below the clutter of a cell.
_CARS = (('car_1', -12.0, 4.0, 2.1, 0.0, 0.19), ('car_2', 9.0, -11.0, -2.9, 1.0, 0.15),
         ('car_3', 2.0, 24.0, 4.4, -1.0, 0.12))


def moving_targets(seed: int = 6, *, movers: tuple[Mover, ...] | None = None,
                   texture_shape: int = 2) -> Scenario:
    """Scenario of cars on spiky clutter: five channels 0.17 m apart, two apertures.

    The array does not fit the pulse rate: the phase centres of neighbouring channels stand 0.85
    of the way from pulse to pulse apart.

    Parameters
    ----------
    seed : int
        Seed of the clutter and of the noise.
    movers : tuple of Mover, optional
        Instead of the three cars.
    texture_shape : int
        Shape of the Gamma distribution of the clutter's power from scatterer to scatterer: 1 is
        very spiky, 10 nearly homogeneous.

    Returns
    -------
    Scenario

    Examples
    --------
    >>> from sar_imaging.simulation.scenarios import moving_targets
    >>> scenario = moving_targets()
    >>> for car in scenario.movers:
    ...     print(car.name, [round(float(v), 1) for v in car.velocity_m_per_s])
    car_1 [2.1, 0.0, 0.0]
    car_2 [-2.9, 1.0, 0.0]
    car_3 [4.4, -1.0, 0.0]
    """
    n = 1200  # one for every two resolution cells
    # The power of Gaussian numbers is exponential: uniform by its own distribution, Gamma in sums.
    power = np.abs([complex_gaussian(seed, _SCENE + i, n) for i in range(2 + texture_shape)]) ** 2
    places = 29.5 * (2 * np.exp(-power[:2].T) - 1)
    amplitudes = (0.3 * complex_gaussian(seed, _SCENE + len(power), n)
                  * np.sqrt(power[2:].mean(axis=0)))
    if movers is None:
        movers = tuple(Mover(name, (x, y, 0.0), (v_x, v_y, 0.0), a)
                       for name, x, y, v_x, v_y, a in _CARS)
    radar = RadarParameters(carrier_hz=10e9, bandwidth_hz=150e6, sample_rate_hz=200e6,
                            first_sample_delay_s=2 * 952.0 / SPEED_OF_LIGHT)
    return Scenario(
        name='moving_targets',
        description='Aircraft at 150 m/s, slant range 1 km, 10 GHz, 150 MHz, 5 channels, range '
                    'profiles of clutter with three slow cars, noise, two apertures',
        radar=radar, compressed=True, n_samples=128, prf_hz=1500.0, n_pulses=240,
        pulses_per_aperture=120,
        trajectory=Trajectory(centre_m=(-866.0, 0.0, 500.0), velocity_m_per_s=(0.0, 150.0, 0.0)),
        tx_offsets_m=((0.0, 0.0, 0.0),) * 5, rx_offsets_m=receive_array(5, 0.17),
        scatterers=tuple(Scatterer(f'clutter_{i}', (x, y, 0.0), a)
                         for i, ((x, y), a) in enumerate(zip(places, amplitudes, strict=True))),
        grid=MapGrid.from_size((0.0, 0.0, 0.0), 60.0, 60.0, 0.5), cut_half_width_m=(6.0, 6.0),
        noise_std=0.3, seed=seed, resolution_bits=20, movers=movers,
        notes='Invented; clutter 18 dB above the noise in the image of a channel; looks along '
              '+x, flies along +y')


SCENARIOS: dict[str, Callable[[], Scenario]] = {
    'psf': psf, 'psf_raw': psf_raw, 'two_scatterers': two_scatterers, 'letter_s': letter,
    'spotlight': spotlight, 'moving_targets': moving_targets, 'countryside': countryside,
    'first_pass': first_pass, 'second_pass': second_pass, 'raster_scan': raster_scan,
    'stripmap': stripmap}
