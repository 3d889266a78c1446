# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Find images in reference maps: simulated revisits, places that are not there, measured passes.

Run from the repository root; measured data lie in ``../shared/data``::

    python -m benchmarks.localization                    # all, fresh seeds, some ten minutes
    python -m benchmarks.localization --parts absent --trials 20
    python -m benchmarks.localization --table            # of docs/localization.md

Most scenes are made directly as images (`benchmarks.support.localization_scenes`): point-spread
function, speckle, layover and shadows of their geometry. Those of the parts *pulses* and *passes*
go through range profiles and the imager. With phases, the reference is a map that was written with
its complex image and read again. An accepted place is *false* where its error exceeds what
its own covariance says once in a thousand times (``e' C^-1 e > 16.27``). Features of OpenCV
(AKAZE, ORB, matched by RANSAC) are tried on the same images where version 4 of it is installed, as
opencv-python-headless<5; it is no dependency.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import json
import math
import pathlib
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Iterator

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Polygon
from scipy import ndimage, special
from tqdm import tqdm

from sar_imaging.exploitation.localization import Estimate, Guess
from sar_imaging.exploitation.map_update import GrowingMap
from sar_imaging.exploitation.registration import (
    LookDirection,
    Registration,
    Speckle,
    measured_resolution_m,
    register,
)
from sar_imaging.formats.reference_map import (
    Pass,
    ReferenceMap,
    read_reference_map,
    write_reference_map,
)
from sar_imaging.geometry.grids import MapGrid, PlaneGrid
from sar_imaging.geometry.track import plane_rotation
from sar_imaging.imaging.image import Image, Report
from sar_imaging.imaging.imager import plan_image
from sar_imaging.recordings import load
from sar_imaging.signal.positioning import locate
from sar_imaging.signal.range_compression import RangeCompressor

from .support.localization_scenes import (
    CELL_M,
    FAMILIES,
    image_of,
    random_scene,
    repeated_scene,
)
from .support.machine import machine
from .tables import table

RESULTS = pathlib.Path(__file__).parent / 'results' / 'localization.json'
DATA = pathlib.Path(__file__).parents[2] / 'shared' / 'data'
GATE = float(special.chdtri(3, 0.001))
IMAGE_M, MAP_M = 70.0, 120.0
NEAR_DEG = 5.0
#: Wrong by as much, features have found something else.
_RIGHT_M, _RIGHT_RAD = 1.5, math.radians(2.0)
_LEAST_INLIERS = 12


@dataclasses.dataclass
class Trial:
    """One registration beside the truth.

    Attributes
    ----------
    kind : str
        What trials are counted together.
    accepted : bool
    error_m, error_deg : float
        Of the translation and of the rotation.
    nees : float
        Error squared, normalised by the covariance.
    probability : float
        Of a false match.
    refusal : str
    seconds : float
    look_deg : float
        Angle between the look directions.
    overlap : float
        Share of the image in the reference, true.
    features : dict
        By the name of a feature: 'right', 'false' or 'none'.
    """

    kind: str
    accepted: bool
    error_m: float
    error_deg: float
    nees: float
    probability: float
    refusal: str
    seconds: float
    look_deg: float = 0.0
    overlap: float = 1.0
    features: dict = dataclasses.field(default_factory=dict)


def tried(kind: str, image: Image, reference: Image, translation_m, rotation_rad: float,
          features: bool = False, facts: dict | None = None, **options) -> Trial:
    """Register an image and compare with the truth."""
    started = time.perf_counter()
    found = register(image, reference, **options)
    seconds = time.perf_counter() - started
    error = np.array([*(found.translation_m - translation_m), found.rotation_rad - rotation_rad])
    known = np.isfinite(found.covariance).all()
    nees = float(error @ np.linalg.solve(found.covariance, error)) if known else math.nan
    return Trial(kind, found.accepted, float(np.hypot(*error[:2])), math.degrees(abs(error[2])),
                 nees, found.false_match_probability, found.refusal, seconds, **(facts or {}),
                 features=_features(image, reference, translation_m, rotation_rad)
                 if features else {})


# ------------------------------------------------------------------------------ simulated

def drives(seed: int, n: int) -> Iterator[Trial]:
    """Revisits: another place, heading and look direction, half of the movable objects gone.

    Three of five look within 5 degrees of the map's direction, the others from 5 to 30; overlaps
    are from a half to all.
    """
    for k in range(n):
        rng = np.random.default_rng([seed, 1, k])
        family = list(FAMILIES)[k % len(FAMILIES)]
        apart = rng.uniform(0.0, NEAR_DEG) if rng.random() < 0.6 else rng.uniform(NEAR_DEG, 30.0)
        yield _drive(rng, family, apart * rng.choice([-1.0, 1.0]), family)


def absent(seed: int, n: int) -> Iterator[Trial]:
    """Places that are not in the map: another scene of the same family."""
    for k in range(n):
        family = list(FAMILIES)[k % len(FAMILIES)]
        rng = np.random.default_rng([seed, 2, k])
        yield _drive(rng, family, rng.uniform(-NEAR_DEG, NEAR_DEG), family, elsewhere=True)


def _drive(rng, family: str, apart_deg: float, kind: str, elsewhere: bool = False) -> Trial:
    scene = random_scene(rng, family, MAP_M / 2)
    look = LookDirection(rng.uniform(0.0, 360.0), rng.uniform(10.0, 30.0))
    later = LookDirection(look.azimuth_deg + apart_deg, look.grazing_deg + rng.uniform(-1.0, 1.0))
    offset, turned = rng.uniform(-5.0, 5.0, 2), rng.uniform(-3.0, 3.0)
    centre = rng.uniform(-1.0, 1.0, 2) * (MAP_M / 2 - IMAGE_M / 4)
    share = np.prod(np.clip((MAP_M / 2 - np.abs(centre)) / IMAGE_M + 0.5, 0.0, 1.0))
    while share < 0.5:  # of the image in the map
        centre *= 0.95
        share = np.prod(np.clip((MAP_M / 2 - np.abs(centre)) / IMAGE_M + 0.5, 0.0, 1.0))
    reference = image_of(scene, rng, MAP_M, look)
    seen = random_scene(rng, family, MAP_M / 2) if elsewhere else scene.changed(rng)
    image = image_of(seen, rng, IMAGE_M, later, centre_m=centre, turned_deg=turned,
                     believed_m=tuple(centre - offset))
    return tried(kind, image, reference, offset, math.radians(turned), features=True, look=later,
                 reference_look=look, height_std_m=FAMILIES[family],
                 facts={'look_deg': abs(apart_deg), 'overlap': float(share)})


def repeated(seed: int, n: int) -> Iterator[Trial]:
    """Equal posts at equal distances, seen again from about the same direction."""
    for k in range(n):
        rng = np.random.default_rng([seed, 3, k])
        scene = repeated_scene(rng, MAP_M)
        look = LookDirection(rng.uniform(0.0, 360.0), rng.uniform(10.0, 30.0))
        offset, turned = rng.uniform(-5.0, 5.0, 2), rng.uniform(-3.0, 3.0)
        image = image_of(scene, rng, IMAGE_M, look, centre_m=offset, turned_deg=turned,
                         believed_m=(0.0, 0.0))
        yield tried('repeated', image, image_of(scene, rng, MAP_M, look), offset,
                    math.radians(turned), features=True)


def pulses(seed: int, n: int) -> Iterator[Trial]:
    """Clutter and reflectors before the shipped X-band radar: range profiles, then the imager.

    The points are moved, not the radar: the same as poses that are wrong.
    """
    platform = _platform()
    for k in range(n):
        rng = np.random.default_rng([seed, 4, k])
        points = np.concatenate([rng.uniform(-40.0, 40.0, (6000, 2)),
                                 rng.uniform(-25.0, 25.0, (15, 2))])
        power = random_scene(rng, 'open ground', 40.0).ground(points[:6000])
        level = np.concatenate([np.sqrt(power), 10 ** (rng.uniform(8.0, 20.0, 15) / 20)])
        offset, turned = rng.uniform(-2.0, 2.0, 2), math.radians(rng.uniform(-2.0, 2.0))
        pair = [_seen(platform, places, level * np.exp(2j * np.pi * rng.random(len(level))))
                for places in (points, (points - offset) @ plane_rotation(turned))]
        yield tried('pulses', pair[1], pair[0], offset, turned)


def passes(seed: int, n: int) -> Iterator[Trial]:
    """A pass that is repeated with the same radar within 6 m of the first track, 5 km away.

    10 to 80 % of the power of the ground has other speckle than before, half of the reflectors
    stand elsewhere, and there is noise 3 to 20 dB below the ground.
    """
    platform = _platform()
    middle, track = np.array(platform.grid.centre_m), platform.apertures[0]
    for k in range(n // 2):
        rng = np.random.default_rng([seed, 8, k])
        points = np.concatenate([rng.uniform(-31.0, 31.0, (14000, 2)),
                                 rng.uniform(-25.0, 25.0, (30, 2))])
        power = random_scene(rng, 'open ground', 40.0).ground(points[:14000])
        level = np.concatenate([np.sqrt(power), 10 ** (rng.uniform(5.0, 14.0, 30) / 20)])
        offset, turned = rng.uniform(-2.0, 2.0, 2), math.radians(rng.uniform(-2.0, 2.0))
        first, new = np.exp(2j * np.pi * rng.random((2, len(level))))
        share = rng.uniform(0.1, 0.8)
        later = np.where(np.arange(len(level)) < 14000,
                         math.sqrt(1 - share) * first + math.sqrt(share) * new, first)
        places = points.copy()
        places[-15:] = rng.uniform(-25.0, 25.0, (15, 2))
        tracks = track, track + [0.0, rng.uniform(-0.3, 0.3), rng.uniform(-6.0, 6.0)]
        rotation = plane_rotation(turned)  # ground and track, as poses tell them that are wrong
        believed = tracks[1].copy()
        believed[:, :2] = (believed[:, :2] - middle[:2] - offset) @ rotation + middle[:2]
        faint_db = rng.uniform(-20.0, -3.0)
        reference = _seen(platform, points, level * first, rng, faint_db)
        platform.apertures[0] = believed
        image = _seen(platform, (places - offset) @ rotation, level * later, rng, faint_db)
        platform.apertures[0] = track
        yield from _with_and_without('passes', image, reference, offset, turned,
                                     track.mean(axis=0))


@functools.cache
def _platform():
    from .support.obstacle_scenes import Platform

    return Platform('airborne_x_band', 50.0, n_apertures=1)


def _seen(platform, places, amplitudes, rng=None, noise_db: float | None = None) -> Image:
    """Image of points (N, 2) about the middle, with noise so many dB above the median."""
    at = np.column_stack([places, np.zeros(len(places))]) + np.array(platform.grid.centre_m)
    spectra = platform.spectra(0, at, amplitudes)
    samples = platform.image(0, spectra)
    if noise_db is not None:
        median_db = 10 * math.log10(float(np.median(np.abs(samples) ** 2)))
        samples = platform.image(0, spectra + platform.noise(rng, median_db + noise_db))
    return Image(samples, platform.grid, platform.radar.carrier_hz, Report('exact', '', -60.0))


def _with_and_without(kind: str, image: Image, reference: Image, translation_m, rotation_rad,
                      phase_centre_m, **options) -> Iterator[Trial]:
    """Two trials of one pair of images: by amplitudes alone, and by a map that holds phases."""
    yield tried(kind, image, reference, translation_m, rotation_rad, **options)
    look = LookDirection.between(reference.grid.centre_m, phase_centre_m)
    amplitude = dataclasses.replace(reference, samples=np.abs(reference.samples))
    made = ReferenceMap(
        amplitude, (Pass('first', look, 0, Speckle(reference, tuple(phase_centre_m))),),
        np.ones(reference.shape, np.uint16), measured_resolution_m(reference), 0.0)
    with tempfile.TemporaryDirectory() as folder:
        write_reference_map(folder, made)
        kept = read_reference_map(folder)
    yield tried(f'{kind}, phases', image, kept.image, translation_m, rotation_rad,
                speckle=kept.speckle[0], **options)


# ------------------------------------------------------------------------------- measured

def patches(seed: int, n: int) -> Iterator[Trial]:
    """Patches of an image of one degree of Gotcha in that of another, 100 m wide."""
    images = _degrees()
    for k in range(n):
        rng = np.random.default_rng([seed, 5, k])
        one, other = rng.choice(4, 2, replace=False)
        side = (20.0, 40.0, 60.0)[k % 3]
        image, offset = _patch(rng, images[one], side, 20.0)
        yield tried(f'{side:.0f} m', image, images[other], offset, 0.0, search_deg=2.0,
                    facts={'look_deg': float(abs(one - other))})


def grown(seed: int, n: int) -> Iterator[Trial]:
    """Patches of 40 m of Gotcha's fourth degree, before and after a map of the first has grown.

    It grows by patches of 60 m of the second and the third degree, where they are found in it.
    """
    images = _degrees()
    first = dataclasses.replace(images[0], samples=np.abs(images[0].samples))
    cell = measured_resolution_m(images[0])
    for k in range(n // 2):
        rng = np.random.default_rng([seed, 7, k])
        growing = GrowingMap(dataclasses.replace(first, samples=first.samples.copy()),
                             np.ones(first.shape, np.uint16), cell, [])
        for more in (1, 2) * 4:
            image, offset = _patch(rng, images[more], 60.0, 2.0)
            found = register(image, growing.image, search_m=5.0, search_deg=2.0)
            if found.accepted:
                growing.add(image, _estimate(image, found))
        image, offset = _patch(rng, images[3], 40.0, 20.0)
        for kind, reference in (('before', first), ('after', growing.image)):
            yield tried(kind, image, reference, offset, 0.0, search_deg=2.0,
                        facts={'look_deg': 3.0})


def _degrees() -> list[Image]:
    """Four images of a degree of Gotcha each, of one place of 100 m."""
    grid = MapGrid.from_size((0.0, 0.0, 0.0), 100.0, 100.0, 0.25)
    block = _profiles('gotcha', 'gotcha_pass1_hh')
    return [_formed(block.select(part), grid)
            for part in np.array_split(np.arange(block.n_pulses), 4)]


def _patch(rng, image: Image, side_m: float, most_m: float) -> tuple[Image, np.ndarray]:
    """A square of an image that is believed elsewhere, and the displacement (2,), metres."""
    grid = image.grid
    pixels = round(side_m / grid.spacing_m)
    row, column = rng.integers(0, np.array(grid.shape) - pixels + 1)
    offset = rng.uniform(-most_m, most_m, 2)
    middle = _places(grid, row + (pixels - 1) / 2, column + (pixels - 1) / 2) - offset
    return dataclasses.replace(
        image, samples=image.samples[row:row + pixels, column:column + pixels],
        grid=MapGrid((*middle, 0.0), pixels, pixels, grid.spacing_m)), offset


def _estimate(image: Image, found: Registration) -> Estimate:
    """What a robot would be told that stands where the image's middle is."""
    middle = found.pivot_m
    frame = middle + found.translation_m - plane_rotation(found.rotation_rad) @ middle
    pose = np.array([*(middle + found.translation_m), found.rotation_rad])
    return Estimate(pose, found.covariance, np.array([*frame, found.rotation_rad]),
                    Guess((*middle, 100.0), 0.0, 0.0, 0, 1), found, expected=True)


_PASSES = {  # description, folder, middle, side and spacing of the map, metres
    'gotcha': ('gotcha_pass1_hh', (0.0, 0.0, 0.0), 80.0, 0.2),
    'team6_rail_fitted': ('bwsi2019_team6_rail', None, 5.0, 0.05),
    'team5_rail': ('bwsi2019_team5_rail', None, 5.0, 0.05)}


def halves(seed: int, n: int) -> Iterator[Trial]:
    """Odd pulses of a pass on a map of the even ones, with poses wrong by 0 to 2 m and 0 to 5°."""
    return _shared(seed, n, lambda pulses: (np.arange(0, pulses, 2), np.arange(1, pulses, 2)))


def windows(seed: int, n: int) -> Iterator[Trial]:
    """The last four fifths of a pass on a map of the first ones: they share three quarters."""
    return _shared(seed, n, lambda pulses: (np.arange(pulses * 4 // 5),
                                            np.arange(pulses // 5, pulses)))


def _shared(seed: int, n: int, split: Callable[[int], tuple[np.ndarray, np.ndarray]]
            ) -> Iterator[Trial]:
    for name, (folder, middle, side, spacing) in _PASSES.items():
        block = _profiles(name, folder)
        if middle is None:
            middle = load(name, DATA / folder).scene.grid.centre_m
        grid = MapGrid.from_size(middle, side, side, spacing)
        first, later = (block.select(part) for part in split(block.n_pulses))
        phase_centre = first.tx_m.reshape(-1, 3).mean(axis=0)
        reference = _formed(first, grid)
        small = MapGrid.from_size(middle, 0.7 * side, 0.7 * side, spacing)
        for k in range(n // len(_PASSES) // 2 + 1):
            rng = np.random.default_rng([seed, 6, k])
            offset = rng.uniform(-2.0, 2.0, 2) if k else np.zeros(2)
            offset *= min(1.0, side / 20)  # rooms are small: not more than the search
            turned = math.radians(rng.uniform(-5.0, 5.0)) if k else 0.0
            image = dataclasses.replace(
                _formed(later, _moved(small, offset, math.degrees(turned))), grid=small)
            yield from _with_and_without(name, image, reference, offset, turned, phase_centre,
                                         search_m=min(5.0, side / 4), search_deg=6.0)


def _places(grid: MapGrid, row, column) -> np.ndarray:
    """(..., 2) x and y of fractional rows and columns."""
    return np.stack([grid.x_m[0] + np.multiply(column, grid.spacing_m),
                     grid.y_m[0] - np.multiply(row, grid.spacing_m)], axis=-1)


def _moved(grid: MapGrid, offset, turned_deg: float) -> PlaneGrid:
    """Where the pixels of a map lie if they are believed on it."""
    c, s = math.cos(math.radians(turned_deg)), math.sin(math.radians(turned_deg))
    u, v = np.array([c, s, 0.0]) * grid.spacing_m, np.array([-s, c, 0.0]) * grid.spacing_m
    # a PlaneGrid has its row 0 at the largest v, as a map at the largest y
    first = np.array(grid.centre_m) + [*offset, 0.0] - u * (grid.n_x - 1) / 2 \
        + v * (grid.n_y - 1) / 2
    return PlaneGrid(tuple(first), tuple(u), tuple(-v), grid.n_x, grid.n_y)


@functools.cache
def _profiles(name: str, folder: str):
    if not (DATA / folder).is_dir():
        raise FileNotFoundError(f'{DATA / folder} is missing; expected the measured data there')
    measured = load(name, DATA / folder)
    block = measured.block
    if not block.has_positions:
        block = locate(block, measured.poses, measured.alignment)
    return RangeCompressor.for_block(block)(block)


def _formed(block, grid) -> Image:
    return plan_image(grid, block.radar, block.n_samples, block.tx_m, block.rx_m)(block)


# ----------------------------------------------------------------------- speed, features

def speed() -> dict:
    """Time of a 1 Mpx image in a map of 16 Mpx, and the memory it takes beside them."""
    rng = np.random.default_rng(1)
    power = np.exp(8 * ndimage.gaussian_filter(rng.standard_normal((4000, 4000), np.float32), 3))

    def seen(part, centre):
        draw = rng.standard_normal((*part.shape, 2), np.float32).view(np.complex64)[..., 0]
        return Image(np.sqrt(part) * draw, MapGrid((*centre, 0.0), *part.shape[::-1], 0.25), 1e10,
                     Report('simulated', '', -60.0))

    reference = seen(power, (0.0, 0.0))
    image = seen(power[1000:2024, 1200:2224], (-75.0, 127.0))
    seconds = []
    for _ in range(7):
        started = time.process_time()
        register(image, reference)
        seconds.append(time.process_time() - started)
    tracemalloc.start()  # slows it down, hence apart
    register(image, reference)
    taken = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    images = sum(one.samples.nbytes for one in (image, reference))
    return {'seconds_median': round(float(np.median(seconds)), 3),
            'seconds_best': round(min(seconds), 3), 'memory_mb': round(taken / 1e6),
            'images_mb': round(images / 1e6)}


def _features(image: Image, reference: Image, translation_m, rotation_rad) -> dict[str, str]:
    """What AKAZE and ORB with RANSAC find, where OpenCV 4 is installed."""
    try:
        import cv2
        from cv2 import AKAZE_create, ORB_create  # OpenCV 5 has no AKAZE
    except ImportError:
        return {}
    cv2.setNumThreads(1)
    found = {}
    for name, detector, norm in (('AKAZE', AKAZE_create(), cv2.NORM_HAMMING),
                                 ('ORB', ORB_create(2000), cv2.NORM_HAMMING)):
        places, words = zip(*(_described(detector, one) for one in (image, reference)),
                            strict=True)
        if any(w is None for w in words):
            found[name] = 'none'
            continue
        matches = cv2.BFMatcher(norm, crossCheck=True).match(*words)
        one = np.array([places[0][m.queryIdx] for m in matches]).reshape(-1, 2)
        other = np.array([places[1][m.trainIdx] for m in matches]).reshape(-1, 2)
        found[name] = _by_ransac(cv2, one, other, image, translation_m, rotation_rad)
    return found


def _described(detector, image: Image):
    """Places of key points, metres, and their descriptors."""
    level = 10 * np.log10(ndimage.gaussian_filter(np.abs(image.samples) ** 2, 1.0) + 1e-9)
    grey = np.clip((level - np.median(level) + 10) * 255 / 30, 0, 255).astype(np.uint8)
    points, words = detector.detectAndCompute(grey, None)
    column, row = np.array([p.pt for p in points]).reshape(-1, 2).T
    return _places(image.grid, row, column), words


def _by_ransac(cv2, one, other, image, translation_m, rotation_rad) -> str:
    if len(one) < _LEAST_INLIERS:
        return 'none'
    matrix, inliers = cv2.estimateAffinePartial2D(one, other, ransacReprojThreshold=1.0)
    if matrix is None or inliers.sum() < _LEAST_INLIERS:
        return 'none'
    pivot = np.array(image.grid.centre_m[:2])
    error = matrix[:, :2] @ pivot + matrix[:, 2] - pivot - translation_m
    turned = math.atan2(matrix[1, 0], matrix[0, 0]) - rotation_rad
    right = np.hypot(*error) < _RIGHT_M and abs(turned) < _RIGHT_RAD
    return 'right' if right else 'false'


# ------------------------------------------------------------------------------- figures

PARTS: dict[str, tuple[Callable[[int, int], Iterator[Trial]], int]] = {
    'drives': (drives, 300), 'absent': (absent, 200), 'repeated': (repeated, 100),
    'pulses': (pulses, 20), 'passes': (passes, 100), 'patches': (patches, 480),
    'halves': (halves, 400), 'windows': (windows, 400), 'grown': (grown, 160)}


def summary(trials: list[Trial]) -> dict:
    """Figures of trials that are counted together."""
    used = [t for t in trials if t.accepted]
    out = {'trials': len(trials), 'accepted': len(used),
           'false': int(sum(not t.nees <= GATE for t in used)),
           'nearest_right': int(sum(t.error_m < _RIGHT_M for t in trials)),
           'seconds_median': round(float(np.median([t.seconds for t in trials])), 3)}
    if used:
        error, turned, nees = (np.array([getattr(t, name) for t in used])
                               for name in ('error_m', 'error_deg', 'nees'))
        bounds = special.chdtri(3 * len(used), [0.975, 0.025]) / len(used)
        out |= {'error_m_median': round(float(np.median(error)), 4),
                'error_m_95_percent': round(float(np.percentile(error, 95)), 4),
                'error_deg_median': round(float(np.median(turned)), 4),
                'nees': round(float(nees.mean()), 2),
                'nees_median': round(float(np.median(nees)), 2),
                'nees_bounds': [round(float(b), 2) for b in bounds]}
    for name in sorted({name for t in trials for name in t.features}):
        answers = [t.features.get(name, 'none') for t in trials]
        out[name] = {'right': answers.count('right'), 'false': answers.count('false')}
    return out


def figures(part: str, trials: list[Trial]) -> dict:
    """Figures of a part, by kind."""
    if part == 'absent':  # there is no truth: whatever is accepted is false
        trials = [dataclasses.replace(t, nees=math.inf, error_m=math.inf, features={
            k: 'none' if v == 'none' else 'false' for k, v in t.features.items()}) for t in trials]
    groups = {kind: [t for t in trials if t.kind == kind] for kind in
              dict.fromkeys(t.kind for t in trials)}
    if part == 'drives':
        near = [t for t in trials if t.look_deg <= NEAR_DEG]
        groups = {f'{kind}, {name}': [t for t in group if (t.look_deg <= NEAR_DEG) == within]
                  for kind, group in groups.items() for name, within in (
                      ('within 5°', True), ('5° to 30°', False))}
        groups |= {'all, within 5°': near,
                   'all, 5° to 30°': [t for t in trials if t.look_deg > NEAR_DEG]}
    return {kind: summary(group) for kind, group in groups.items() if group}


def tables(results: dict) -> str:
    """Tables of docs/localization.md."""
    rows = []
    for part in PARTS:
        for kind, f in results.get(part, {}).get('figures', {}).items():
            nees = f'{f["nees"]} ({f["nees_bounds"][0]} to {f["nees_bounds"][1]})' \
                if f.get('nees', math.inf) < math.inf else ''
            rows.append([part, kind, f['trials'], f['accepted'], f['false'],
                         f.get('error_m_median', ''), f.get('error_deg_median', ''), nees])
    features = [[part, kind, f['accepted'], f['false'], *(
        f'{f[name]["right"]}, {f[name]["false"]}' for name in ('AKAZE', 'ORB'))]
        for part in PARTS for kind, f in results.get(part, {}).get('figures', {}).items()
        if 'ORB' in f]
    return '\n\n'.join([
        table('part', 'scenes', 'trials', 'accepted', 'false', 'error, median (m)',
              'error, median (°)', 'NEES (95 % bounds)', rows=rows),
        table('part', 'scenes', 'accepted', 'false', 'AKAZE right, false', 'ORB right, false',
              rows=features)])


def picture(path: pathlib.Path) -> None:
    """Draw a match with its covariance, and a refusal."""
    rng = np.random.default_rng(11)
    scene = random_scene(rng, 'buildings', MAP_M / 2)
    looks, centre, offset = (LookDirection(40.0, 20.0), LookDirection(48.0, 20.5)), (8, 5), (4, -3)
    reference = image_of(scene, rng, MAP_M, looks[0])
    image = image_of(scene.changed(rng), rng, IMAGE_M, looks[1], centre_m=centre, turned_deg=3.0,
                     believed_m=tuple(np.subtract(centre, offset)))
    found = register(image, reference, look=looks[1], reference_look=looks[0],
                     height_std_m=FAMILIES['buildings'])
    posts = repeated_scene(rng, MAP_M)
    street = image_of(posts, rng, MAP_M, looks[0])
    refused = register(image_of(posts, rng, IMAGE_M, looks[0], centre_m=(2.0, 1.0),
                                believed_m=(0.0, 0.0)), street)
    figure = Figure(figsize=(13.0, 4.6), dpi=80)
    axes = figure.subplots(1, 3)
    _show(axes[0], image, 'image, where odometry puts it')
    _show(axes[1], reference, 'map; image by odometry (red), registered (green)')
    _show(axes[2], street, 'repeated structure: refused, with its candidates')
    x, y = image.grid.x_m[[0, -1, -1, 0]], image.grid.y_m[[0, 0, -1, -1]]
    corners = np.column_stack([x, y])
    axes[1].add_patch(Polygon(corners, fill=False, edgecolor='red'))
    axes[1].add_patch(Polygon(found.corrected(corners), fill=False, edgecolor='lime'))
    variances, directions = np.linalg.eigh(found.covariance[:2, :2])
    axes[1].add_patch(Ellipse(
        found.corrected(found.pivot_m), *(60 * np.sqrt(variances)), facecolor='lime', alpha=0.6,
        angle=math.degrees(math.atan2(directions[1, 0], directions[0, 0]))))
    places = np.array([c.translation_m for c in refused.candidates])
    axes[2].plot(places[:, 0], places[:, 1], 'o', mfc='none', mec='orange', ms=10)
    figure.tight_layout()
    figure.savefig(path)


def _show(axes, image: Image, title: str) -> None:
    half, grid = image.grid.spacing_m / 2, image.grid
    axes.imshow(20 * np.log10(np.abs(image.samples)), cmap='gray', vmin=-18, vmax=22, extent=(
        grid.x_m[0] - half, grid.x_m[-1] + half, grid.y_m[-1] - half, grid.y_m[0] + half))
    axes.set_title(title, fontsize=10)
    axes.set_xlabel('x (m)')


def main() -> None:
    """Run the parts asked for, and write their results as they come."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--parts', nargs='+', choices=[*PARTS, 'speed'], default=[*PARTS, 'speed'])
    parser.add_argument('--trials', type=int, help='of each part')
    parser.add_argument('--seed', type=int, help='fresh by default')
    parser.add_argument('--results', type=pathlib.Path, default=RESULTS)
    parser.add_argument('--table', action='store_true', help='print the tables of the results')
    parser.add_argument('--picture', type=pathlib.Path, help='draw the picture of the page')
    arguments = parser.parse_args()
    if arguments.picture:
        picture(arguments.picture)
        return
    results = json.loads(arguments.results.read_text()) if arguments.results.exists() else {}
    if arguments.table:
        print(tables(results))
        return
    seed = np.random.SeedSequence().entropy % 2**31 if arguments.seed is None else arguments.seed
    for part in arguments.parts:
        if part == 'speed':
            results[part] = speed()
        else:
            run, n = PARTS[part]
            n = arguments.trials or n
            trials = list(tqdm(run(seed, n), total=n, desc=part, mininterval=5.0))
            results[part] = {'seed': int(seed), 'cell_m': CELL_M, 'figures': figures(part, trials)}
            for t in trials:
                if t.accepted and not t.nees <= GATE:
                    print(f'false: {t}')
        results['machine'] = machine()
        arguments.results.write_text(json.dumps(results, indent=1, ensure_ascii=False) + '\n')


if __name__ == '__main__':
    main()
