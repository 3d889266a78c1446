# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Random drone flights with unsynchronised clocks of radar and poses, to test autofocus on.

A drone hovers and drifts, flies into a turn, or flies straight and level legs between which it
hovers, and looks at a scene of some metres. The pulses
come without positions; the poses are those of the drone's navigation, on another clock. The
offset between the clocks is known here and is what autofocus has to find.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from sar_imaging.geometry.alignment import Alignment
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.poses import PoseTrack
from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters, Waveform
from sar_imaging.simulation.echoes import EchoSimulator

MOTIONS = ('hover', 'turn', 'legs')
RADARS = ('uwb', 'fmcw')
ANGLES_DEG = 5.0, 30.0  # of the aperture, seen from the scene
MARGIN_S = 7.0  # poses before the first and after the last pulse
CLOCK_S = 40.0  # the poses' clock minus the radar's
_POSE_RATE_HZ = 100.0
POSE_NOISE_M = 3e-4
_START_NS = 1_700_000_000_000_000_000
_ARM_M = np.array([[0.12, 0.05, -0.08]])
_HEIGHT_M = 3.0
_SWAY_M = 0.03, 0.2  # rms
_N_BRIGHT, _N_FAINT = 12, 90
_BRIGHT_DB, _FAINT_DB = (-10.0, 0.0), (-32.0, -18.0)
_WIDER = 1.6  # scene of the scatterers over the imaged one: some lie outside of the image
_LARGEST_SCENE = 0.6  # image over range
_PIXELS = 240
_PIXELS_PER_RESOLUTION = 2.0
_NOISE_DB = -14.0  # of a sample of the profiles, relative to the strongest scatterer's peak


@dataclasses.dataclass(frozen=True)
class DroneFlight:
    """Pulses, poses and true alignment of a simulated flight.

    Attributes
    ----------
    motion, radar_kind : str
        One of `MOTIONS` and one of `RADARS`.
    angle_deg : float
        Directions that the scene's middle was seen from, degrees.
    block : PulseBlock
        Raw pulses of the radar, without positions, times on its clock.
    stamp_ns : (N,) int64
        Times of the poses on their clock, nanoseconds.
    position_m : (N, 3) float64
        Positions of the drone, metres.
    quaternion : (N, 4) float64
        Its attitudes, x, y, z, w.
    alignment : Alignment
        The true one: lever arm and offset of the clocks.
    grid : MapGrid
        Where to image.

    Examples
    --------
    >>> from benchmarks.support.drone_flights import drone_flight
    >>> flight = drone_flight(1, motion='turn', radar_kind='uwb', n_pulses=32)
    >>> flight.track().__class__.__name__, flight.position_m.shape[1], flight.block.has_positions
    ('PoseTrack', 3, False)
    >>> late = flight.misaligned(0.25)
    >>> print(f'{late.time_offset_s - flight.alignment.time_offset_s:+.2f} s')
    +0.25 s
    """

    motion: str
    radar_kind: str
    angle_deg: float
    block: PulseBlock
    stamp_ns: np.ndarray
    position_m: np.ndarray
    quaternion: np.ndarray
    alignment: Alignment
    grid: MapGrid

    def track(self) -> PoseTrack:
        """The poses as a track."""
        out = PoseTrack()
        for pose in zip(self.stamp_ns.tolist(), self.position_m, self.quaternion, strict=True):
            out.add(*pose)
        return out

    def misaligned(self, offset_s: float) -> Alignment:
        """The alignment with an offset that is wrong by so many seconds."""
        return dataclasses.replace(self.alignment,
                                   time_offset_s=self.alignment.time_offset_s + offset_s)


def drone_flight(seed: int, *, motion: str | None = None, radar_kind: str | None = None,
                 n_pixels: int = _PIXELS, n_pulses: int | None = None) -> DroneFlight:
    """Simulate a random flight of a drone, with poses on a clock of their own.

    5 to 9 s long, seen over 5 to 30 degrees (logarithmically even) from 7 to 11 m (UWB, 3.2 to
    4.7 GHz) or 10 to 16 m (FMCW, 10 GHz, 1 GHz). Gusts move it by 0.03 to 0.2 m rms at 0.1 to
    0.6 Hz. 12 scatterers of 0 to -10 dB, 90 of -18 to
    -32 dB, noise; two fifths of the way to each side more scatterers lie around the image. Poses
    at 100 Hz with 0.3 mm of noise.

    Parameters
    ----------
    seed : int
        Of everything random.
    motion : str, optional
        One of `MOTIONS`: 'hover' drifts, 'turn' flies into a turn of 30 to 150 degrees, 'legs'
        flies straight for 2 to 4 s, hovers for 1 to 2 s, and so on; at random if left out.
    radar_kind : str, optional
        One of `RADARS`; at random if left out.
    n_pixels : int
        Along each side of the image.
    n_pulses : int, optional
        Pulses of the aperture; 380 of UWB and 512 of FMCW if left out.

    Returns
    -------
    DroneFlight
        Pulses, poses and the truth.

    Raises
    ------
    ValueError
        The motion or the radar is unknown.

    Examples
    --------
    >>> from benchmarks.support.drone_flights import drone_flight
    >>> flight = drone_flight(1, motion='hover', radar_kind='fmcw', n_pulses=32)
    >>> flight.block.n_pulses, flight.block.radar.waveform.name, flight.grid.shape
    (32, 'FMCW', (240, 240))
    """
    rng = np.random.default_rng(seed)
    motion, radar_kind = (given or str(rng.choice(kinds)) for given, kinds in (
        (motion, MOTIONS), (radar_kind, RADARS)))
    if motion not in MOTIONS or radar_kind not in RADARS:
        raise ValueError(f'motion={motion!r}, radar_kind={radar_kind!r}; use one of '
                         f'{", ".join(MOTIONS)} and one of {", ".join(RADARS)}')
    angle_deg = float(np.exp(rng.uniform(*np.log(ANGLES_DEG))))
    duration_s = rng.uniform(5.0, 9.0)
    range_m = rng.uniform(*((7.0, 11.0) if radar_kind == 'uwb' else (10.0, 16.0)))
    moving = {'hover': _hovering, 'turn': _turning, 'legs': _legs}[motion](rng, duration_s)
    track = _placed(moving, _sway(rng), duration_s, range_m, math.radians(angle_deg))
    radar, n_samples, default_pulses = _radar(radar_kind)
    time_s = np.linspace(0.0, duration_s, n_pulses or default_pulses)
    resolution_m = min(radar.range_resolution_m,
                       radar.wavelength_m / 2 / math.radians(angle_deg))
    grid = MapGrid((0.0, 0.0, 0.0), n_pixels, n_pixels, min(
        resolution_m / _PIXELS_PER_RESOLUTION, _LARGEST_SCENE * range_m / n_pixels))
    half_m = min(0.5 * _WIDER * n_pixels * grid.spacing_m, 0.5 * range_m)
    samples = _echoes(rng, radar, n_samples, half_m, *_phase_centres(track, time_s))
    block = PulseBlock(radar, False, _START_NS + np.rint(time_s * 1e9).astype(np.int64),
                       np.arange(len(time_s)), samples)
    pose_s = np.arange(-MARGIN_S, duration_s + MARGIN_S, 1 / _POSE_RATE_HZ)
    position, attitude = track(pose_s)
    position = position + POSE_NOISE_M * rng.standard_normal(position.shape)
    stamp_ns = _START_NS + np.rint((pose_s + CLOCK_S) * 1e9).astype(np.int64)
    return DroneFlight(motion, radar_kind, angle_deg, block, stamp_ns, position,
                       attitude.as_quat(), Alignment(_ARM_M, _ARM_M, CLOCK_S), grid)


def _radar(kind: str) -> tuple[RadarParameters, int, int]:
    """Radar, samples of a pulse, pulses of an aperture."""
    if kind == 'uwb':
        return (RadarParameters(3.95e9, 1.5e9, 16.384e9, 6e-9, waveform=Waveform.PASSBAND),
                1920, 380)
    return fmcw_parameters(start_frequency_hz=9.5e9, slope_hz_per_s=1e12, sample_rate_hz=320e3,
                           n_samples=320, adc_start_s=1e-6), 320, 512


def _waves(rng, n: int, lowest_hz: float, highest_hz: float) -> Callable:
    """A smooth random function of time, 1 in rms."""
    frequency, phase = rng.uniform(lowest_hz, highest_hz, n), rng.uniform(0, 2 * np.pi, n)
    size = rng.rayleigh(1.0, n) / frequency  # slow ones are larger
    size *= math.sqrt(2) / np.linalg.norm(size)

    def at(time_s):
        return np.sin(2 * np.pi * frequency * time_s[:, None] + phase) @ size

    return at


def _sway(rng) -> Callable:
    """What gusts do to a drone: along, across and vertical, metres."""
    waves = [_waves(rng, 4, 0.1, 0.6) for _ in range(3)]
    size_m = rng.uniform(*_SWAY_M) * np.array([1.0, 1.0, 0.5])

    def at(time_s):
        return np.stack([wave(time_s) for wave in waves], axis=1) * size_m

    return at


def _hovering(rng, duration_s: float) -> Callable:
    """Drift of a hovering drone, in a unit of length that `_placed` chooses."""
    along, across = (_waves(rng, 3, 0.04, 0.15) for _ in range(2))
    drift = rng.choice([-1.0, 1.0]) / duration_s

    def at(time_s):
        return np.stack([drift * time_s + 0.2 * along(time_s), 0.15 * across(time_s),
                         0 * time_s], axis=1)

    return at


def _turning(rng, duration_s: float) -> Callable:
    """Forward flight that goes over into a turn, in a unit of length that `_placed` chooses."""
    turn = math.radians(rng.choice([-1, 1]) * rng.uniform(30, 150))
    begin, takes = rng.uniform(0.0, 0.6) * duration_s, rng.uniform(0.4, 1.0) * duration_s
    fine_s = np.arange(-MARGIN_S - 1.0, duration_s + MARGIN_S + 1.0, 0.01)
    u = np.clip((fine_s - begin) / takes, 0.0, 1.0)
    heading = turn * u * u * (3 - 2 * u) - turn / 2
    path = np.cumsum(0.01 / duration_s * np.stack([np.cos(heading), np.sin(heading)], axis=1),
                     axis=0)

    def at(time_s):
        x, y = (np.interp(time_s, fine_s, p) for p in path.T)
        return np.stack([x, y, 0 * x], axis=1)

    return at


def _legs(rng, duration_s: float) -> Callable:
    """Legs and hovers in turn, in a unit of length that `_placed` chooses."""
    first_s, last_s = -MARGIN_S - 1.0, duration_s + MARGIN_S + 1.0
    ends_s, speeds = [first_s - rng.uniform(0.0, 4.0)], []
    while ends_s[-1] < last_s:
        speeds.append(0.0 if len(speeds) % 2 else rng.choice([-1.0, 1.0], p=[0.2, 0.8]))
        ends_s.append(ends_s[-1] + rng.uniform(1.0, 2.0) * (2.0 if speeds[-1] else 1.0))
    fine_s = np.arange(first_s, last_s, 0.01)
    speed = np.array(speeds)[np.searchsorted(ends_s, fine_s, side='right') - 1]
    ramp = np.hanning(round(rng.uniform(0.5, 1.0) / 0.01))  # of a drone that changes its speed
    path = np.cumsum(np.convolve(speed, ramp / ramp.sum(), mode='same')) * 0.01 / duration_s

    def at(time_s):
        x = np.interp(time_s, fine_s, path)
        return np.stack([x, 0 * x, 0 * x], axis=1)

    return at


def _placed(moving: Callable, sway: Callable, duration_s: float, range_m: float,
            angle_rad: float) -> Callable:
    """Track and attitudes: the motion scaled to the angle wanted, seen from the scene's middle."""
    inside = np.linspace(0.0, duration_s, 400)
    middle, level = moving(inside).mean(axis=0), sway(inside).mean(axis=0)
    back = np.array([0.0, -math.sqrt(range_m ** 2 - _HEIGHT_M ** 2), _HEIGHT_M])

    def place(time_s, scale):
        return scale * (moving(time_s) - middle) + sway(time_s) - level + back

    def angle(scale):
        x, y, _ = place(inside, scale).T
        return np.ptp(np.arctan2(x, -y))

    low, high = 0.0, 0.5 * range_m
    while angle(high) < angle_rad and high < 100 * range_m:
        high *= 2
    for _ in range(40):
        scale = 0.5 * (low + high)
        low, high = (scale, high) if angle(scale) < angle_rad else (low, scale)

    def track(time_s):
        ahead = (place(time_s + 0.05, scale) - place(time_s - 0.05, scale)) / 0.1
        # the nose stays towards the scene and sways; tilt follows the speed
        yaw = math.pi / 2 + 0.1 * np.sin(0.9 * time_s)
        tilt = np.clip(0.03 * ahead, -0.2, 0.2)
        return place(time_s, scale), Rotation.from_euler(
            'ZYX', np.stack([yaw, tilt[:, 1], tilt[:, 0]], axis=1))

    return track


def _phase_centres(track: Callable, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return Alignment(_ARM_M, _ARM_M).phase_centres(*track(time_s), 1)


def _echoes(rng, radar, n_samples: int, half_m: float, tx_m, rx_m) -> np.ndarray:
    n = _N_BRIGHT + _N_FAINT
    points = np.zeros((n, 3))
    points[:, :2] = half_m * rng.uniform(-1, 1, (n, 2))
    points[:_N_BRIGHT * 2 // 3, :2] *= 0.9 / _WIDER  # most of the bright ones are in the image
    last_m = radar.range_start_m + (n_samples - 1) * radar.sample_spacing_m
    while radar.waveform == Waveform.PASSBAND and (beyond := np.linalg.norm(
            tx_m - points, axis=-1).max(axis=0) > last_m).any():
        points[beyond] *= 0.7  # else the record would not hold their echoes
    level_db = np.concatenate([rng.uniform(*_BRIGHT_DB, _N_BRIGHT), rng.uniform(*_FAINT_DB,
                                                                               _N_FAINT)])
    amplitudes = 10 ** (level_db / 20) * np.exp(2j * np.pi * rng.random(n))
    simulate = EchoSimulator(radar, n_samples, compressed=False, points_m=points,
                             amplitudes=amplitudes)
    samples = np.concatenate([simulate(*part) for part in zip(
        np.array_split(tx_m, 8), np.array_split(rx_m, 8), strict=True)])
    # of a profile; compression gains what it sums
    noise = 10 ** (_NOISE_DB / 20) * np.sqrt(n_samples if radar.waveform != Waveform.PASSBAND
                                             else radar.sample_rate_hz / radar.bandwidth_hz / 2)
    if radar.waveform == Waveform.PASSBAND:
        return samples + noise * rng.standard_normal(samples.shape)
    return samples + noise / math.sqrt(2) * (rng.standard_normal(samples.shape)
                                             + 1j * rng.standard_normal(samples.shape))
