# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A car with a 77 GHz radar on its roof drives a loop through houses: echoes, and their images.

Scatterers of the scenes of `localization_scenes` stand before the radar as points: six of ground
in a square metre, drawn anew for each image; facades and corners of houses that face the radar;
cars and posts, and trees, lamps and fences beside the road. What stands hides what is behind it.
Echoes have their exact phase, lie in a range bin a sixteenth of a sample wide, and fall with range
and beam. The package's imager forms some looks of each place, whose powers are averaged.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import fft

from sar_imaging.compilation import njit
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.imaging.image import Image, Report
from sar_imaging.imaging.imager import plan_image
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters
from sar_imaging.signal.windows import window

from .localization_scenes import Scene, _axes, random_scene

RESOLUTION_M, SPACING_M = 0.5, 0.3
SIDE_M, ASIDE_M = 48.0, 30.0  # of an image, and how far to the right of the car its middle lies
STEP_M = 0.5  # of the path, and from look to look
LOOKS = 4
_LENGTH_M, _WIDTH_M, _CORNER_M = 330.0, 230.0, 70.0  # of the loop, about a kilometre long
_HEIGHT_M = 2.5  # of the antenna
_NEAR_M, _FAR_M, _BEAM_DEG = 8.0, 52.0, 40.0  # half the beam, -6 dB two ways
_CARRIER_HZ, _BANDWIDTH_HZ, _RATE_HZ = 76.5e9, 400e6, 600e6
_FINER = 16  # bins of a sample
_PULSES, _PULSE_STEP_M = 88, 0.0013  # 8 kHz at 10 m/s
_PER_M2, _PER_M = 6.0, 8.0  # points of ground and facades, and of corners with the ground
_NOISE = 0.01  # power in the middle of an image, of that of mean ground
_CELL_M2 = 0.25
_KERB_M = 5.0  # from the middle of the road
_HALF_M = 220.0  # of the town
_FROM_POST_M, _BESIDE_M = 5.0, (7.0, 12.0)  # along the road, and from its middle


def loop() -> np.ndarray:
    """(n, 3) x, y and heading at every half metre of the middle of the road, once around."""
    bend = _CORNER_M * math.pi / 2
    ends = np.cumsum([_LENGTH_M - 2 * _CORNER_M, bend, _WIDTH_M - 2 * _CORNER_M, bend] * 2)
    s = np.arange(0.0, ends[-1], STEP_M)
    heading = sum(math.pi / 2 * np.clip((s - start) / bend, 0.0, 1.0) for start in ends[::2])
    steps = np.diff(s, append=ends[-1])[:, None] * np.stack([np.cos(heading), np.sin(heading)], 1)
    place = np.cumsum(steps, axis=0) - steps
    return np.column_stack([place - place.mean(axis=0), heading])


def driven(middle: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n, 3) poses of a driver who keeps to the middle of a road within about a metre."""
    s = np.arange(len(middle)) / len(middle)
    aside = sum(rng.uniform(0.2, 0.5) * np.sin(2 * np.pi * (n * s + rng.random()))
                for n in (5, 9, 16))
    place = middle[:, :2] + aside[:, None] * np.stack(
        [-np.sin(middle[:, 2]), np.cos(middle[:, 2])], axis=1)
    ahead = np.roll(place, -1, axis=0) - np.roll(place, 1, axis=0)
    return np.column_stack([place, np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))])


def compose(pose, seen) -> np.ndarray:
    """(..., 3) x, y and heading of what is seen from a pose, in the frame of the pose."""
    pose, seen = np.asarray(pose, float), np.asarray(seen, float)
    c, s = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x, y = seen[..., 0], seen[..., 1]
    return np.stack([pose[..., 0] + c * x - s * y, pose[..., 1] + s * x + c * y,
                     pose[..., 2] + seen[..., 2]], axis=-1)


def seen_from(pose, other) -> np.ndarray:
    """(..., 3) other poses, seen from a pose; headings within half a turn."""
    apart = np.asarray(other, float) - np.asarray(pose, float)
    c, s = np.cos(np.asarray(pose)[..., 2]), np.sin(np.asarray(pose)[..., 2])
    x, y = apart[..., 0], apart[..., 1]
    return np.stack([c * x + s * y, c * y - s * x,
                     np.remainder(apart[..., 2] + np.pi, 2 * np.pi) - np.pi], axis=-1)


def town(rng: np.random.Generator) -> Scene:
    """Houses, parked cars and posts beside a road that has trees, lamps and fences on its side."""
    scene, middle = random_scene(rng, 'buildings', _HALF_M), loop()
    road = middle[::4, :2]

    def from_road(places):
        return np.hypot(*np.moveaxis(places[:, None] - road, -1, 0)).min(axis=1)

    free = from_road(scene.boxes[:, :2]) > _KERB_M + np.hypot(*scene.boxes[:, 2:4].T) / 2
    number = np.append(np.where(free, np.cumsum(free) - 1, -2), -1)
    points = scene.points.copy()
    points[:, 6] = number[points[:, 6].astype(int)]
    off = from_road(points[:, :2]) > _KERB_M
    beside = middle[rng.random(len(middle)) < STEP_M / _FROM_POST_M]
    posts = np.zeros((len(beside), 7))
    posts[:, :2] = compose(beside, np.column_stack([
        np.zeros(len(beside)), -rng.uniform(*_BESIDE_M, len(beside)), np.zeros(len(beside))])
    )[:, :2]
    posts[:, 3], posts[:, 5:] = 10 ** (rng.uniform(8.0, 25.0, len(beside)) / 20), (360.0, -1.0)
    return Scene(scene.ground, np.concatenate([points[off & (points[:, 6] > -2)], posts]),
                 scene.boxes[free])


def look_indices(at: int) -> np.ndarray:
    """(LOOKS,) indices into a path of the middles of the looks around one pose."""
    return np.arange(at - LOOKS // 2, at - LOOKS // 2 + LOOKS)


def echoes(scene: Scene, poses: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(LOOKS, P, N) complex64 range profiles at true poses, with noise."""
    middle = poses[len(poses) // 2]
    points, amplitude = _scatterers(scene, middle, rng)
    bins = fft.next_fast_len(math.ceil((_FAR_M + 16.0) / _fine_m()))
    out = np.empty((len(poses), _PULSES, bins // _FINER), np.complex64)
    for look, pose in zip(out, poses, strict=True):
        sums = np.zeros((_PULSES, bins), np.complex128)
        gain = amplitude * _gain(points, pose)
        _add(_centres(pose), points, gain, 4 * math.pi * _CARRIER_HZ / SPEED_OF_LIGHT,
             1 / _fine_m(), sums)
        look[:] = _band_limited(sums)
    draw = rng.standard_normal((*out.shape, 2)).view(complex)[..., 0]
    return out + (math.sqrt(_NOISE * _CELL_M2 * _PULSES / 2) * draw).astype(np.complex64)


def formed(profiles: np.ndarray, poses: np.ndarray, grid: MapGrid) -> Image:
    """Amplitude of looks formed with believed poses; 0 beyond the beam and the profiles."""
    radar = _radar()
    power = np.zeros(grid.shape, np.float32)
    for samples, pose in zip(profiles, poses, strict=True):
        centres = _centres(pose)[:, None]
        block = PulseBlock(radar, True, np.arange(_PULSES) * 142_857, np.arange(_PULSES),
                           samples[:, None], centres, centres)
        imager = plan_image(grid, radar, samples.shape[1], centres, centres, method='exact',
                            target_db=-40.0)
        power += np.square(np.abs(imager(block).samples))
    distance, off = _polar(grid.points()[..., :2], poses[len(poses) // 2])
    lit = (distance > _NEAR_M) & (distance < _FAR_M) & (np.abs(off) < math.radians(_BEAM_DEG))
    level = np.sqrt(power * (distance / ASIDE_M) ** 4 / len(poses))
    return Image(np.where(lit, level, 0.0).astype(np.float32), grid, _CARRIER_HZ,
                 Report('exact', '', -40.0))


def grid_beside(pose: np.ndarray) -> MapGrid:
    """Grid to the right of a pose, its pixels on one raster for all poses."""
    middle = compose(pose, [0.0, -ASIDE_M, 0.0])[:2]
    n = round(SIDE_M / SPACING_M)
    return MapGrid((*(np.rint(middle / SPACING_M) * SPACING_M), 0.0), n, n, SPACING_M)


def _fine_m() -> float:
    return SPEED_OF_LIGHT / (2 * _RATE_HZ * _FINER)


def _radar() -> RadarParameters:
    return RadarParameters(_CARRIER_HZ, _BANDWIDTH_HZ, _RATE_HZ, 0.0)


def _centres(pose: np.ndarray) -> np.ndarray:
    """(P, 3) phase centres of a look; the car drives straight on for 14 cm."""
    along = (np.arange(_PULSES) - (_PULSES - 1) / 2) * _PULSE_STEP_M
    return np.stack([pose[0] + along * math.cos(pose[2]), pose[1] + along * math.sin(pose[2]),
                     np.full(_PULSES, _HEIGHT_M)], axis=1)


def _polar(places, pose) -> tuple[np.ndarray, np.ndarray]:
    """Distance on the ground, metres, and angle from the middle of the beam, radians."""
    at = seen_from(pose, np.concatenate([places, np.zeros((*places.shape[:-1], 1))], axis=-1))
    return np.hypot(at[..., 0], at[..., 1]), np.arctan2(at[..., 0], -at[..., 1])


def _gain(points, pose) -> np.ndarray:
    """Amplitude by beam and range, 1 in the middle of an image."""
    distance, off = _polar(points[:, :2], pose)
    return 0.5 ** ((off / math.radians(_BEAM_DEG)) ** 2) * (ASIDE_M / distance) ** 2


def _scatterers(scene: Scene, pose, rng) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) points that the radar sees around one pose, and their complex amplitudes."""
    near = np.hypot(*(scene.boxes[:, :2] - pose[:2]).T) < _FAR_M + 15.0
    number = np.full(len(scene.boxes) + 1, -1)
    number[:-1][near] = np.arange(near.sum())
    boxes = scene.boxes[near]
    aside = np.array([math.sin(pose[2]), -math.cos(pose[2])])
    half = _FAR_M + 4.0
    n = round(_PER_M2 * 2 * half * half)
    along, across = rng.uniform(-half, half, n), rng.uniform(0.0, half, n)
    ground = np.zeros((n, 4))
    ground[:, :2] = pose[:2] + across[:, None] * aside + along[:, None] * [-aside[1], aside[0]]
    ground[:, 3] = np.sqrt(scene.ground(ground[:, :2]) / _PER_M2)
    toward = np.degrees(np.arctan2(*(pose[:2] - scene.points[:, :2]).T[::-1]))
    off = np.abs((scene.points[:, 4] - toward + 180.0) % 360.0 - 180.0)
    things = scene.points[off <= scene.points[:, 5]]
    solid = np.column_stack([things[:, :3], things[:, 3] * math.sqrt(_CELL_M2)])
    walls = [_walls(box, pose, rng) for box in boxes]
    points = np.concatenate([ground, solid, *walls])
    own = np.concatenate([np.full(n, -1), number[things[:, 6].astype(int)], *(
        np.full(len(w), k) for k, w in enumerate(walls))])
    distance, angle = _polar(points[:, :2], pose)
    seen = (distance > 3.0) & (distance < _FAR_M + 4.0) & (
        np.abs(angle) < math.radians(1.5 * _BEAM_DEG))
    points, own = points[seen], own[seen]
    free = ~_hidden(points[:, :3], own, boxes, pose)
    points = points[free]
    return points[:, :3], points[:, 3] * np.exp(2j * np.pi * rng.random(len(points)))


def _walls(box, pose, rng) -> np.ndarray:
    """(N, 4) points of the sides of a box that face the radar, and their amplitudes."""
    axes, half, height = _axes(box[4]), box[2:4] / 2, box[5]
    corner = (15.0 if height > 2.0 else 3.0) * math.sqrt(_CELL_M2)  # with the ground, a metre
    out = []
    for axis in (0, 1):
        for side in (-1.0, 1.0):
            normal, middle = side * axes[axis], box[:2] + side * half[axis] * axes[axis]
            sight = pose[:2] - middle
            facing = float(normal @ sight / np.hypot(*sight))
            if facing < 0.1:
                continue
            length = 2 * half[1 - axis]
            for n, top, power in (
                    (round(_PER_M2 * length * height), height, 1.5 * facing / _PER_M2),
                    (round(_PER_M * length), 0.0, corner * facing**4 / _PER_M)):
                along = rng.uniform(-0.5, 0.5, n) * length
                points = np.full((n, 4), math.sqrt(power))
                points[:, :2] = middle + along[:, None] * axes[1 - axis]
                points[:, 2] = rng.uniform(0.0, top, n)
                out.append(points)
    return np.concatenate(out) if out else np.zeros((0, 4))


def _hidden(points, own, boxes, pose) -> np.ndarray:
    """Whether a box other than its own stands between a point and the antenna, or over it."""
    hidden = np.zeros(len(points), bool)
    for number, box in enumerate(boxes):
        axes = _axes(box[4])
        start, end = (pose[:2] - box[:2]) @ axes.T, (points[:, :2] - box[:2]) @ axes.T
        with np.errstate(divide='ignore'):
            cuts = np.sort(np.stack([(side * box[2:4] / 2 - start) / (end - start)
                                     for side in (-1.0, 1.0)]), axis=0)
        enter, leave = cuts[0].max(axis=1), np.minimum(cuts[1].min(axis=1), 1.0)
        height = _HEIGHT_M + leave * (points[:, 2] - _HEIGHT_M)  # the lowest while over the box
        hidden |= (own != number) & (enter < leave) & (leave > 0) & (
            np.minimum(height, _HEIGHT_M + np.maximum(enter, 0) * (points[:, 2] - _HEIGHT_M))
            < box[5])
    return hidden


def _band_limited(sums: np.ndarray) -> np.ndarray:
    """(P, N) profiles of the radar's band from sums in fine bins."""
    n = sums.shape[1] // _FINER
    spectrum = fft.fft(sums, axis=1)
    half = int(_BANDWIDTH_HZ / _RATE_HZ * n / 2)
    kept = np.zeros((len(sums), n), complex)
    index = np.arange(-half, half + 1)
    weights = window('hamming', len(index))
    kept[:, index] = spectrum[:, index] * weights
    return fft.ifft(kept, axis=1) * (n / weights.sum())


@njit(fastmath=True)
def _add(centres, points, gain, wavenumber, per_m, sums):
    """Add the echo of each point to its bin of each pulse."""
    for p in range(len(centres)):
        x, y, z = centres[p]
        for i in range(len(points)):
            distance = math.sqrt((points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2
                                 + (points[i, 2] - z) ** 2)
            phase = wavenumber * distance
            sums[p, int(distance * per_m + 0.5)] += gain[i] * complex(math.cos(phase),
                                                                      -math.sin(phase))
