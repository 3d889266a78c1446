# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Random valid radars, tracks, maps and scenes, to test predicted errors on.

A case follows from its seed alone. Tracks are those that radars fly, drive and are carried on,
and some that nobody should: climbing steeply, stopping, going over the same ground again.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import scipy.fft

from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.echoes import scene_spectrum, two_way_delays

_EARTH_RADIUS_M = 6.4e6
_MOST_ROWS = 480  # pulses x channels: keeps a case to about a second
_MOST_DEPTH = 600.0  # resolution cells that a map is deep, seen from the whole track
_MOST_WORK = 1e7  # pulses x channels x frequencies x scatterers
_SCENES = ('within', 'everywhere')  # the map; all that the pulses tell apart


@dataclasses.dataclass(frozen=True)
class RandomCase:
    """Pulses of one radar over one scene, and the map that is wanted of them.

    Attributes
    ----------
    grid : MapGrid
        The map.
    profiles : PulseBlock
        Range profiles with phase centres.
    pulses : PulseBlock
        What correlation takes: phase histories that the profiles were made of, or the profiles.
    traits : dict of str to int, float or str
        What tells cases apart: seed, track, range, elevation, channels and so on.

    Examples
    --------
    >>> from benchmarks.support.random_cases import random_case
    >>> case = random_case(4)
    >>> case.profiles.compressed, case.traits['seed']
    (True, 4)
    """

    grid: MapGrid
    profiles: PulseBlock
    pulses: PulseBlock
    traits: dict[str, int | float | str]

    @property
    def scale(self) -> float:
        """Correlation of `pulses` over the image of `profiles`."""
        return 1.0 if self.pulses.compressed else float(self.pulses.n_samples)


@dataclasses.dataclass(frozen=True)
class Family:
    """What radars, ranges and apertures are drawn from; each is a least value and a largest one.

    Attributes
    ----------
    carrier_hz, angle_rad, range_m : (float, float)
        Carrier, angle of the aperture as seen from the scene, and range; a map that is nearly as
        wide as the least range lies as much further away.
    most_channels : int
        As many receivers as may be drawn.
    """

    carrier_hz: tuple[float, float] = (1e9, 40e9)
    angle_rad: tuple[float, float] = (0.005, 0.5)
    range_m: tuple[float, float] = (100.0, 5e4)
    most_channels: int = 5


#: By name: satellites, aircraft and drones; robots, with up to eight receivers; wide apertures.
FAMILIES = {'far': Family(), 'near': Family((4e9, 8e10), (0.05, 0.8), (3.0, 100.0), 8),
            'wide': Family(angle_rad=(0.5, 1.8), range_m=(10.0, 1e4))}


def random_case(seed: int, track: str | Callable | None = None, family: str = 'far', *,
                beyond: bool = False) -> RandomCase:
    """Simulate pulses of a random radar, track and scene.

    Radars, ranges and apertures are those of a family. Bandwidths reach 30 % of the carrier,
    elevations 75 degrees; maps have 64 to 128 pixels a side. Half of the cases have coordinates
    with offsets of the Earth's size, a quarter are phase histories, a third have noise; in a
    tenth each the profiles are too short for the map, and the receivers stand far from the
    transmitter.

    Parameters
    ----------
    seed : int
        Of everything.
    track : str or function, optional
        One of `TRACKS`, or one of your own like these; the seed chooses if left out.
    family : str
        One of `FAMILIES`.
    beyond : bool
        A single scatterer lies right beyond the map, instead of a scene.

    Returns
    -------
    RandomCase
        The same one for the same seed.

    Examples
    --------
    >>> from benchmarks.support.random_cases import random_case
    >>> case = random_case(3)
    >>> print(case.traits['track'], case.grid.shape, case.profiles.n_pulses, 'pulses')
    climbing (66, 69) 36 pulses
    """
    rng, drawn_from = np.random.default_rng(seed), FAMILIES[family]
    # Drawn in any case, so that a track can be asked for.
    drawn = tuple(TRACKS)[rng.integers(len(TRACKS))]
    track = TRACKS.get(track or drawn, track)
    carrier = _between(*drawn_from.carrier_hz, rng)
    wavelength = SPEED_OF_LIGHT / carrier
    angle = _between(*drawn_from.angle_rad, rng)
    azimuth = wavelength / (2 * angle)
    bandwidth = min(SPEED_OF_LIGHT / (2 * azimuth * 3 ** rng.uniform(-1, 1)), 0.3 * carrier)
    n_x, n_y = (int(n) for n in rng.integers(64, 129, 2))
    elevation = math.radians(rng.choice([rng.uniform(0, 40), rng.uniform(40, 75)]))
    resolution = SPEED_OF_LIGHT / (2 * bandwidth) / math.cos(elevation)
    spacing = rng.uniform(0.25, 0.6) * min(azimuth, resolution)
    width = spacing * max(n_x, n_y)
    nearest = max(drawn_from.range_m[0], 1.2 * width)
    range_m = _between(nearest, max(drawn_from.range_m[1], nearest), rng)
    n_channels = int(rng.integers(1, drawn_from.most_channels + 1))
    n_pulses = int(np.clip(rng.uniform(1.2, 2.5) * width / azimuth, 24, _MOST_ROWS // n_channels))
    centre = range_m * np.array([-math.cos(elevation), 0.0, math.sin(elevation)])
    path = track(rng, np.linspace(-0.5, 0.5, n_pulses), angle * range_m, centre)
    path[:, 2] += max(0.0, -1.2 * path[:, 2].min())  # not below the ground
    tx, rx = _antennas(rng, path, wavelength, range_m, n_channels)
    turn, offset = _placement(rng)
    grid = MapGrid(tuple(offset), n_x, n_y, spacing)
    tx, rx = tx @ turn + offset, rx @ turn + offset
    scene = _SCENES[rng.integers(2)]
    points, amplitudes = _scatterers(rng, grid, n_pulses * azimuth / width
                                     if scene == 'everywhere' else 0.95)
    if beyond:
        scene, points, amplitudes = 'beyond', _beyond(rng, grid), np.ones(1)
    name = track.__name__.strip('_').replace('_', ' ')
    traits = {'seed': seed, 'family': family, 'track': name, 'range_m': range_m,
              'channels': n_channels, 'pulses': n_pulses, 'elevation_deg': math.degrees(elevation),
              'angle_deg': math.degrees(angle), 'carrier_ghz': carrier * 1e-9,
              'pixels': n_x * n_y, 'width': width / range_m, 'scene': scene,
              'offset': 'Earth' if np.any(offset) else 'none'}
    return _with_pulses(rng, grid, tx, rx, carrier, bandwidth, points, amplitudes, traits)


def _between(least, largest, rng) -> float:
    return least * (largest / least) ** rng.random()


# ------------------------------------------------------------------------------------ tracks
# Each takes random numbers, the shares of the pulses (P,) from -0.5 to 0.5, the length of an
# aperture seen from its side and its centre as seen from the middle of the scene, metres; it
# returns positions (P, 3). The scene lies along +x.

def _straight(rng, u, length, centre):
    u = u + rng.choice([0.0, rng.uniform(-0.4, 0.4)]) * (u ** 2 - 1 / 12)
    return centre + np.outer(u * length, [0.0, 1.0, 0.0])


def _squinted(rng, u, length, centre):
    squint = math.radians(rng.uniform(15, 65)) * rng.choice([-1, 1])
    way = np.array([math.sin(squint), math.cos(squint), rng.uniform(-0.1, 0.1)])
    return centre + np.outer(u * length / math.cos(squint), way)


def _curved(rng, u, length, centre):
    """A turn towards the scene or away from it, of up to two radians."""
    angle = rng.uniform(0.1, 2.0) * rng.choice([-1, 1])
    radius, turn = length / angle, u * angle
    return centre + radius * np.c_[1 - np.cos(turn), np.sin(turn), 0 * u]


def _spiral(rng, u, length, centre):
    """Around the scene, or a corkscrew along the track."""
    distance = math.hypot(*centre)
    if rng.random() < 0.5:
        turn = u * length / distance
        grown = 1 + rng.uniform(-0.1, 0.1) * u
        ground, height = -centre[0] * grown, centre[2] * (1 + rng.uniform(-0.2, 0.2) * u)
        return np.c_[-ground * np.cos(turn), ground * np.sin(turn), height]
    radius, turn = length * rng.uniform(0.01, 0.15), 2 * np.pi * rng.uniform(0.5, 5) * u
    return centre + np.c_[radius * np.cos(turn), length * u, radius * np.sin(turn)]


def _perturbed(rng, u, length, centre):
    """A random walk and a vibration, up to a twentieth of the aperture."""
    size = length * 10 ** rng.uniform(-4, math.log10(0.05))
    walk = np.cumsum(rng.normal(0, 1, (len(u), 3)), axis=0) / math.sqrt(len(u))
    shake = np.sin(rng.uniform(0.2, 3) * np.arange(len(u)))[:, None] * rng.normal(0, 0.3, 3)
    return _straight(rng, u, length, centre) + size * (walk + shake)


def _back_and_forth(rng, u, length, centre):
    passes = rng.uniform(1.5, 4)
    turn = (u + 0.5) * passes
    along = np.abs((turn + 1) % 2 - 1) - 0.5
    aside = rng.normal(0, 0.01 * length, 3) * rng.integers(0, 2)
    return centre + np.outer(along * length, [0.0, 1.0, 0.0]) + np.outer(u, aside)


def _climbing(rng, u, length, centre):
    """Up to straight up, over several degrees of elevation."""
    climb = math.radians(rng.uniform(10, 90)) * rng.choice([-1, 1])
    heading = rng.uniform(-0.5, 0.5)
    way = [math.cos(climb) * math.sin(heading), math.cos(climb) * math.cos(heading),
           math.sin(climb)]
    return centre + np.outer(u * length * rng.uniform(1, 3), way)


def _stopping(rng, u, length, centre):
    """Stands still for a tenth to two thirds of the pulses."""
    share, begin = rng.uniform(0.1, 0.67), rng.random()
    t = u + 0.5
    begin *= 1 - share
    begin = rng.choice([0.0, begin, 1 - share])
    moved = np.where(t < begin, t, np.maximum(begin, t - share)) / (1 - share)
    return centre + np.outer((moved - 0.5) * length, [0.0, 1.0, 0.0])


TRACKS = {'straight': _straight, 'squinted': _squinted, 'curved': _curved, 'spiral': _spiral,
          'perturbed': _perturbed, 'back and forth': _back_and_forth, 'climbing': _climbing,
          'stopping': _stopping}


# ------------------------------------------------------------------------- radar and scene

def _antennas(rng, path, wavelength, range_m, n_channels):
    """(P, C, 3) transmitters and receivers, metres."""
    tx = np.repeat(path[:, None], n_channels, axis=1)
    rx = tx.copy()
    apart = rng.choice([0.5, rng.uniform(0.5, 10)]) * wavelength
    way = np.array([0.0, 1.0, 0.0]) if rng.random() < 0.7 else rng.normal(0, 0.6, 3)
    rx += (np.arange(n_channels) - (n_channels - 1) / 2)[:, None] * apart * way
    if rng.random() < 0.1:
        rx += rng.normal(0, 0.03 * range_m, 3) * [1, 1, 0]
    return tx, rx


def _placement(rng):
    """Turn of all coordinates about the vertical, and their offset, metres."""
    heading = rng.choice([0.0, rng.uniform(-np.pi, np.pi)])
    cos, sin = math.cos(heading), math.sin(heading)
    turn = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    return turn, rng.integers(0, 2) * rng.uniform(-1, 1, 3) * _EARTH_RADIUS_M


def _scatterers(rng, grid, extent):
    """Positions (S, 3) over so much of the map in both directions, metres, and amplitudes."""
    n = int(rng.integers(10, 41)) if extent < 1 else 250
    size = grid.spacing_m * np.array([grid.n_x, grid.n_y])
    places = np.array(grid.centre_m) + np.c_[
        (rng.random((n, 2)) - 0.5) * extent * size, np.zeros(n)]
    strength = 10 ** (-rng.uniform(0, 1) * rng.random(n))
    return places, strength * np.exp(2j * np.pi * rng.random(n))


def _beyond(rng, grid):
    """(1, 3) position within half a map beyond one of its edges, metres."""
    place = rng.uniform(-0.5, 0.5, 2)
    place[rng.integers(2)] = rng.choice([-1, 1]) * rng.uniform(0.52, 1.0)
    return np.array([[*(grid.centre_m[:2] + place * grid.spacing_m * [grid.n_x, grid.n_y]),
                      grid.z_m]])


def _with_pulses(rng, grid, tx, rx, carrier, bandwidth, points, amplitudes, traits) -> RandomCase:
    stepped, short = rng.random() < 0.25, rng.random() < 0.1
    corners = grid.points()[::grid.n_y - 1, ::grid.n_x - 1].reshape(-1, 3)
    edges = two_way_delays(tx, rx, np.vstack([corners, grid.centre_m]))
    low, high = float(edges.min()), float(edges.max())
    bandwidth = min(bandwidth, _MOST_DEPTH / (high - low))
    rate = rng.uniform(1.3, 2.5) * bandwidth
    spare = (-rng.uniform(0.02, 0.3) * (high - low) if short
             else rng.uniform(30, 120) / (rate - bandwidth))
    middle, duration = 0.5 * (low + high), max(high - low + 2 * spare, 20 / bandwidth)
    traits |= {'relative_bandwidth': bandwidth / carrier, 'depth': duration * bandwidth,
               'waveform': 'stepped' if stepped else 'profiles', 'short': int(short),
               'noise_db': -math.inf}
    most = max(40, int(_MOST_WORK / (tx[..., 0].size * duration * bandwidth)))
    points, amplitudes = points[:most], amplitudes[:most]
    delays = two_way_delays(tx, rx, points)
    if stepped:
        n_bins = math.ceil(duration * bandwidth)
        first, step, reference = -(n_bins - 1) / 2, bandwidth / n_bins, middle
    else:
        n_samples = scipy.fft.next_fast_len(math.ceil(duration * rate))
        step = rate / n_samples
        half = int(0.5 * bandwidth / step)
        first, n_bins, reference = -half, 2 * half + 1, middle - 0.5 * n_samples / rate
    spectrum = scene_spectrum(carrier, first, n_bins, step, delays, amplitudes, reference)
    if rng.random() < 1 / 3:
        traits['noise_db'] = rng.uniform(-30, 10)
        size = 10 ** (traits['noise_db'] / 20) * math.sqrt(np.mean(np.abs(spectrum) ** 2) / 2)
        spectrum += size * (rng.normal(size=spectrum.shape) + 1j * rng.normal(size=spectrum.shape))
    if stepped:
        radar = RadarParameters(carrier, bandwidth, bandwidth, reference,
                                waveform=Waveform.STEPPED_FREQUENCY)
        samples = spectrum
    else:
        radar = RadarParameters(carrier, bandwidth, rate, reference)
        padded = np.zeros((*delays.shape[:2], n_samples), complex)
        padded[..., np.arange(first, first + n_bins)] = spectrum
        samples = scipy.fft.ifft(padded, axis=-1) * (n_samples / n_bins)
    number = np.arange(len(tx))
    pulses = PulseBlock(radar, not stepped, stamp_ns=number * 1_000_000, counter=number,
                        samples=samples, tx_m=tx, rx_m=rx)
    profiles = RangeCompressor.for_block(pulses)(pulses) if stepped else pulses
    return RandomCase(grid, profiles, pulses, traits)
