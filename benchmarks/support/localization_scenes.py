# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Random scenes seen again from another place, made directly as images, without pulses.

An image is the convolution of speckle and of points with the response of the geometry: a rectangle
of spatial frequencies along range and cross-range with Hamming weights, turned with the look
direction. Points lie at exact places between pixels, displaced towards the radar by their height.
Walls are bright where they face the radar and lie over the ground before them, and what stands
casts a shadow. Speckle, noise and phases of points are drawn anew for every image. Range
curvature, errors of the track and ambiguities are left out.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from scipy import fft, ndimage

from sar_imaging.exploitation.registration import LookDirection
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.imaging.image import Image, Report

#: Families of scenes, and the root mean square of heights over the grid that a user would tell,
#: metres: houses of 3 to 9 m make about a fifteenth of an image.
FAMILIES = {'open ground': 0.3, 'reflectors': 0.7, 'car park': 0.7, 'buildings': 1.5}
CELL_M = 0.5  # width of the response along both axes, -3 dB
SPACING_M = 0.35
_POSTS = {'open ground': 6, 'reflectors': 25, 'car park': 10, 'buildings': 12}  # in 120 m
_HAMMING_WIDTH = 0.886 * 1.47
_NOISE = 0.03  # power, of that of mean ground
_CAR_M = 4.5, 1.8
_MARGIN = 24  # pixels beyond an image
_GROUND_M = 0.5  # spacing of the power of ground


@dataclasses.dataclass(frozen=True)
class Scene:
    """The ground and what stands on it.

    Attributes
    ----------
    ground : callable
        Power in a cell at places (..., 2), metres.
    points : (K, 7) float64
        x, y and height, metres; amplitude over the root mean square of ground of unit power;
        azimuth of the looks that see it and half their width, degrees; its box, -1 for none.
    boxes : (B, 7) float64
        x, y, length and width, metres, heading, degrees, height, metres, whether it moves.
    """

    ground: Callable[[np.ndarray], np.ndarray]
    points: np.ndarray
    boxes: np.ndarray

    def changed(self, rng: np.random.Generator, share: float = 0.5) -> Scene:
        """The scene later: so many of what moves have gone, and as many others come."""
        keep = (self.boxes[:, 6] == 0) | (rng.random(len(self.boxes)) > share)
        others = self.boxes[~keep].copy()
        others[:, :2] += rng.uniform(-15.0, 15.0, (len(others), 2))
        numbers = np.append(np.where(keep, np.cumsum(keep) - 1, -2), -1)  # -2: gone
        points = self.points.copy()
        points[:, 6] = numbers[points[:, 6].astype(int)]
        more = [_on_car(rng, box, np.count_nonzero(keep) + k) for k, box in enumerate(others)]
        return Scene(self.ground, np.concatenate([points[points[:, 6] > -2], *more]),
                     np.concatenate([self.boxes[keep], others]))


def random_scene(rng: np.random.Generator, family: str, half_m: float) -> Scene:
    """A scene of a family within so many metres about the origin."""
    share = (half_m / 60.0) ** 2
    posts = _posts(rng, rng.poisson(_POSTS[family] * share) + 1, half_m)
    houses, cars = np.zeros((0, 7)), np.zeros((0, 7))
    if family == 'buildings':
        houses = _houses(rng, rng.poisson(6 * share) + 1, half_m)
    if family in ('car park', 'buildings'):
        rows = max(1, round((5 if family == 'car park' else 2) * share))
        cars = np.concatenate([_parked(rng, half_m) for _ in range(rows)])
    on_cars = [_on_car(rng, car, len(houses) + k) for k, car in enumerate(cars)]
    return Scene(_ground(rng, half_m), np.concatenate([posts, *on_cars]),
                 np.concatenate([houses, cars]))


def repeated_scene(rng: np.random.Generator, half_m: float) -> Scene:
    """Equal posts at equal distances along one direction or two, on ground without structure."""
    along = rng.uniform(0.0, math.pi)
    steps = rng.uniform(5.0, 12.0, 2) if rng.random() < 0.5 else (rng.uniform(5.0, 12.0), 1e6)
    number = [np.arange(-n, n + 1) for n in (math.ceil(2 * half_m / s) for s in steps)]
    u, v = (step * k.ravel() for step, k in zip(steps, np.meshgrid(*number), strict=True))
    posts = np.zeros((len(u), 7))
    posts[:, 0] = np.cos(along) * u - np.sin(along) * v
    posts[:, 1] = np.sin(along) * u + np.cos(along) * v
    posts[:, 3], posts[:, 5], posts[:, 6] = 10 ** (rng.uniform(12.0, 25.0) / 20), 360.0, -1
    return Scene(lambda places: np.ones(places.shape[:-1], np.float32), posts, np.zeros((0, 7)))


def _posts(rng, n: int, half_m: float) -> np.ndarray:
    posts = np.zeros((n, 7))
    posts[:, :2] = rng.uniform(-half_m, half_m, (n, 2))
    posts[:, 2] = rng.exponential(0.8, n)
    posts[:, 3] = 10 ** (rng.uniform(8.0, 25.0, n) / 20)
    posts[:, 4], posts[:, 5] = rng.uniform(0.0, 360.0, n), rng.choice([25.0, 360.0], n)
    posts[:, 6] = -1
    return posts


def _houses(rng, n: int, half_m: float) -> np.ndarray:
    houses = np.zeros((n, 7))
    houses[:, :2] = rng.uniform(-half_m, half_m, (n, 2))
    houses[:, 2], houses[:, 3] = rng.uniform(8.0, 22.0, n), rng.uniform(6.0, 12.0, n)
    houses[:, 4] = rng.uniform(0.0, 20.0) + 90.0 * rng.integers(0, 2, n)
    houses[:, 5] = rng.uniform(3.0, 9.0, n)
    return houses


def _parked(rng, half_m: float) -> np.ndarray:
    """A row of cars side by side, with gaps."""
    heading, step = rng.uniform(0.0, 180.0), rng.uniform(2.6, 3.2)
    place = np.flatnonzero(rng.random(rng.integers(6, 16)) < 0.7)
    cars = np.zeros((len(place), 7))
    way = np.array([math.cos(math.radians(heading)), math.sin(math.radians(heading))])
    cars[:, :2] = (rng.uniform(-half_m, half_m, 2) + step * np.multiply.outer(place, way)
                   + rng.normal(0.0, 0.15, (len(place), 2)))
    cars[:, 2:4] = _CAR_M
    cars[:, 4] = heading + 90.0 + rng.normal(0.0, 2.0, len(place))
    cars[:, 5:] = 1.4, 1.0
    return cars


def _on_car(rng, box: np.ndarray, number: int) -> np.ndarray:
    """Scatterers of a parked car."""
    n = rng.integers(3, 7)
    inside = rng.uniform(-0.5, 0.5, (n, 2)) * _CAR_M
    points = np.zeros((n, 7))
    points[:, :2] = box[:2] + inside @ _axes(box[4])
    points[:, 2] = rng.uniform(0.0, 1.4, n)
    points[:, 3] = 10 ** (rng.uniform(8.0, 20.0, n) / 20)
    points[:, 4], points[:, 5] = rng.uniform(0.0, 360.0, n), rng.uniform(5.0, 40.0, n)
    points[:, 6] = number
    return points


def _axes(heading_deg: float) -> np.ndarray:
    """(2, 2) directions along and across a heading, in rows."""
    c, s = math.cos(math.radians(heading_deg)), math.sin(math.radians(heading_deg))
    return np.array([[c, s], [-s, c]])


def _ground(rng, half_m: float) -> Callable[[np.ndarray], np.ndarray]:
    """Fields of three brightnesses with a texture, and up to two roads."""
    n = math.ceil(2 * (half_m + 30.0) / _GROUND_M)
    fields = ndimage.gaussian_filter(rng.standard_normal((n, n)), 30)
    level = rng.normal(0.0, 3.0, 3)[np.digitize(fields / fields.std(), [-0.6, 0.5])]
    texture = ndimage.gaussian_filter(rng.standard_normal((n, n)), rng.uniform(1.0, 3.0))
    level += rng.uniform(0.5, 2.0) * texture / texture.std()
    places = (np.arange(n) - (n - 1) / 2) * _GROUND_M
    x, y = places[None], places[:, None]
    for _ in range(rng.integers(0, 3)):
        angle, offset, bend = (rng.uniform(0.0, math.pi), rng.uniform(-half_m, half_m),
                               rng.uniform(-1.0, 1.0) / 200)
        along = y * math.cos(angle) - x * math.sin(angle)
        across = x * math.cos(angle) + y * math.sin(angle) - offset + bend * along**2
        level[np.abs(across) < rng.uniform(2.0, 5.0)] -= 8.0
    power = (10 ** (level / 10)).astype(np.float32)

    def ground(at):
        index = at / _GROUND_M + (n - 1) / 2
        return ndimage.map_coordinates(power, [index[..., 1], index[..., 0]], order=1,
                                       mode='nearest')

    return ground


def image_of(scene: Scene, rng: np.random.Generator, side_m: float, look: LookDirection, *,
             centre_m=(0.0, 0.0), believed_m=None, turned_deg: float = 0.0) -> Image:
    """Image of which a pixel believed at p lies at ``centre + R(turned) (p - believed)``."""
    believed = centre_m if believed_m is None else believed_m
    grid = MapGrid.from_size((*believed, 0.0), side_m, side_m, SPACING_M)
    n = fft.next_fast_len(grid.n_x + 2 * _MARGIN)
    axis = (np.arange(n) - (grid.n_x - 1) / 2 - _MARGIN) * SPACING_M
    axes = _axes(turned_deg)
    places = np.stack(np.meshgrid(axis, -axis), axis=-1) @ axes + centre_m
    power = _with_boxes(scene, places, look)
    draw = rng.standard_normal((n, n, 2), np.float32).view(np.complex64)[..., 0]
    spectrum = fft.fft2(np.sqrt(power / 2) * draw)
    response = _response(n, math.radians(look.azimuth_deg - turned_deg))
    seen = _points(scene, look)
    at = (seen[:, :2] + seen[:, 2:3] * look.layover - centre_m) @ axes.T
    inside = (np.abs(at) < -axis[0]).all(axis=1)
    spectrum += _spectrum_of_points(at[inside], seen[inside, 3], rng, axis)
    samples = fft.ifft2(spectrum * response)[_MARGIN:, _MARGIN:][:grid.n_y, :grid.n_x]
    std = math.sqrt(np.mean(response**2) * _NOISE / 2)
    draw = rng.standard_normal((*grid.shape, 2)).view(complex)[..., 0]
    return Image((samples + std * draw).astype(np.complex64), grid, 10e9,
                 Report('simulated', '', -60.0))


def _response(n: int, azimuth: float) -> np.ndarray:
    """Hamming-weighted rectangle of spatial frequencies along range and cross-range."""
    fx, fy = fft.fftfreq(n, SPACING_M)[None], -fft.fftfreq(n, SPACING_M)[:, None]
    band = _HAMMING_WIDTH / CELL_M
    c, s = math.cos(azimuth), math.sin(azimuth)
    return np.prod([np.where(np.abs(f) < band / 2, 0.54 + 0.46 * np.cos(2 * np.pi * f / band), 0.0)
                    for f in (fx * c + fy * s, fy * c - fx * s)], axis=0)


def _points(scene: Scene, look: LookDirection) -> np.ndarray:
    """Points that show themselves to a look."""
    off = np.abs((scene.points[:, 4] - look.azimuth_deg + 180.0) % 360.0 - 180.0)
    return scene.points[off <= scene.points[:, 5]]


def _spectrum_of_points(at, amplitude, rng, axis) -> np.ndarray:
    """Spectrum of points of random phases, whose peaks exceed speckle by their amplitudes."""
    n = len(axis)
    response = _response(n, 0.0)
    gain = amplitude * np.exp(2j * np.pi * rng.random(len(amplitude)))
    gain *= math.sqrt(np.mean(response**2)) / np.mean(response)
    turns = -2j * np.pi * fft.fftfreq(n, SPACING_M)
    right, down = (np.exp(np.multiply.outer(v - axis[0], turns)) for v in (at[:, 0], -at[:, 1]))
    return (gain[:, None] * down).T @ right


def _with_boxes(scene: Scene, places: np.ndarray, look: LookDirection) -> np.ndarray:
    """Power of ground, with roofs and walls displaced towards the radar, and shadows."""
    power = scene.ground(places)
    lay = float(np.linalg.norm(look.layover))
    toward = look.layover / lay
    for box in scene.boxes:
        reach = box[2] + box[3] + box[5] * max(lay, 1 / lay) + 2.0
        near = np.hypot(*np.moveaxis(places - box[:2], -1, 0)) < reach
        if near.any():
            power[near] = _box(power[near], places[near] - box[:2], box, toward, lay)
    return power


def _box(power, at, box, toward, lay) -> np.ndarray:
    """Power at places (N, 2) from the middle of a box."""
    axes, half, height = _axes(box[4]), box[2:4] / 2, box[5]

    def along(length, step):
        return np.linspace(0.0, length, max(2, math.ceil(length / step)))

    def on_box(places):
        return (np.abs(places @ axes.T) < half).all(axis=1)

    shadow = np.any([on_box(at + t * toward) for t in along(height / lay, 0.4)], axis=0)
    power = np.where(shadow, np.float32(0.03), np.float32(1.0)) * power
    power[on_box(at - height * lay * toward)] += 0.5
    for axis in (0, 1):
        facing = axes[axis] @ toward
        if abs(facing) < 0.1:
            continue

        def on_wall(places, axis=axis, facing=facing):
            place = places @ axes.T * np.sign(facing)
            return ((np.abs(place[:, axis] - half[axis]) < 0.25)
                    & (np.abs(place[:, 1 - axis]) < half[1 - axis]))

        wall = np.any([on_wall(at - t * toward) for t in along(height * lay, 0.25)], axis=0)
        power[wall] += 1.5 * abs(facing)
        power[on_wall(at)] += (15.0 if height > 2 else 3.0) * facing**4  # with the ground
    return power
