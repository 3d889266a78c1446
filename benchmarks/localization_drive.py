# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A car drives a loop of one kilometre twice: the map of the first round locates it in the second.

Run from the repository root; two minutes of a core::

    make localization-demo                          # a fresh town, out/localization_demo.png
    python -m benchmarks.localization_drive --table # of docs/localization.md

Images go through range profiles and the imager (`benchmarks.support.drive_scene`): every ten
metres one of 48 m to the right of the car; two to four of them are looked for as one. The first
round is surveyed to some centimetres and makes the map. When the second begins, the survey ends
and half of the cars stand elsewhere. Images are formed with odometry, `Localizer` finds them in
the map, and a small Kalman filter, in the place of robot_localization, fuses what it finds with
the odometry. The filter also learns the scale of the wheels and the bias of the gyro, first from
the end of the survey, and the odometry of images is corrected by them.

The same drive without a map or a survey: images of the second round are found in those of the
first, and a pose graph of odometry and these loop closures is solved.
"""

from __future__ import annotations

import argparse
import json
import logging
import math
import multiprocessing
import pathlib

import numpy as np
from matplotlib.figure import Figure
from scipy import special
from tqdm import tqdm

from sar_imaging.exploitation.localization import Estimate, Guess, Localizer
from sar_imaging.exploitation.registration import register
from sar_imaging.formats.pose_graph import PoseEdge, write_g2o
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.imaging.image import Image, Report

from .support.drive_scene import (
    RESOLUTION_M,
    SPACING_M,
    STEP_M,
    compose,
    driven,
    echoes,
    formed,
    grid_beside,
    look_indices,
    loop,
    seen_from,
    town,
)
from .support.machine import machine
from .support.pose_graph_solver import solved
from .tables import table

RESULTS = pathlib.Path(__file__).parent / 'results' / 'localization_drive.json'
PICTURE = pathlib.Path('out/localization_demo.png')
WANTED_M, WANTED_DEG = 0.3, 0.3
EVERY = 20  # steps from image to image
SCALE, BIAS_RAD = 0.018, math.radians(0.009)  # of odometry: of the path, and in a metre of it
NOISE = np.array([0.01, 0.003, math.radians(0.02)])  # along, across and heading, in a metre
_SCALE_STD, _BIAS_STD_RAD = 0.03, math.radians(0.02)
_SURVEY_STD = np.array([0.05, 0.05, math.radians(0.1)])
_LEARNED = 400  # steps of the first round from which the filter learns scale and bias
_BETWEEN_HOUSES = 1.5  # by which covariances are too small there: no look directions are told
_LEAST_JOINED, _MOST_JOINED = 2, 4  # images that are looked for as one
_STEP_NS = 5e7  # 10 m/s
_KEY = 2  # every second image is a pose of the graph
_NEAR_M = 14.0  # poses whose images may show one place
_GATE = float(special.chdtri(3, 0.001))


def odometry(path: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n - 1, 3) steps that wheels and gyro tell of a path."""
    steps = seen_from(path[:-1], path[1:])
    way = np.hypot(steps[:, 0], steps[:, 1])
    told = steps + NOISE * np.sqrt(way)[:, None] * rng.standard_normal(steps.shape)
    told[:, :2] *= 1 + SCALE
    told[:, 2] += BIAS_RAD * way
    return told


def chained(start, steps) -> np.ndarray:
    """(n + 1, 3) poses after steps, from a start on."""
    poses = [np.asarray(start, float)]
    for step in steps:
        poses.append(compose(poses[-1], step))
    return np.array(poses)


class Filter:
    """Extended Kalman filter of pose, scale of the wheels and bias of the gyro."""

    def __init__(self, pose, covariance):
        self.state = np.array([*pose, 0.0, 0.0])
        self.covariance = np.diag([0.0, 0.0, 0.0, _SCALE_STD**2, _BIAS_STD_RAD**2])
        self.covariance[:3, :3] = covariance

    def step(self, told) -> np.ndarray:
        """Go a step of the odometry; returns it as it is corrected."""
        scale, bias = self.state[3:]
        way = math.hypot(told[0], told[1]) / (1 + scale)
        step = np.array([*(told[:2] / (1 + scale)), told[2] - bias * way])
        c, s = math.cos(self.state[2]), math.sin(self.state[2])
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        slope = np.eye(5)
        slope[:2, 2] = turn[:2, :2] @ [-step[1], step[0]]
        slope[:3, 3] = turn @ [-step[0], -step[1], bias * way] / (1 + scale)
        slope[2, 4] = -way
        noise = np.zeros((5, 5))
        noise[:3, :3] = turn @ np.diag(NOISE**2 * way) @ turn.T
        self.state[:3] = compose(self.state[:3], step)
        self.covariance = slope @ self.covariance @ slope.T + noise
        return step

    def correct(self, pose, covariance) -> bool:
        """Use a pose that an image told; False where it is too improbable."""
        rest = np.asarray(pose) - self.state[:3]
        rest[2] = math.remainder(rest[2], 2 * math.pi)
        spread = self.covariance[:3, :3] + covariance
        if rest @ np.linalg.solve(spread, rest) > _GATE:
            return False
        gain = np.linalg.solve(spread, self.covariance[:3]).T
        self.state += gain @ rest
        left = np.eye(5)
        left[:, :3] -= gain
        self.covariance = left @ self.covariance @ left.T + gain @ covariance @ gain.T
        return True


# -------------------------------------------------------------------------------- images

class Drive:
    """Two rounds: true paths, odometry, and the town in each."""

    def __init__(self, seed: int):
        self.seed, rng = seed, np.random.default_rng([seed, 0])
        middle = loop()
        self.n = len(middle)
        first = town(rng)
        self.towns = first, first.changed(rng)
        self.true = [driven(middle, rng), driven(middle, rng)]
        self.told = odometry(np.concatenate(self.true), rng)  # also from round to round
        s = np.linspace(0.0, 2 * np.pi, self.n)
        self.surveyed = self.true[0] + np.column_stack([
            0.02 * np.sin(3 * s), 0.02 * np.cos(5 * s), math.radians(0.03) * np.sin(7 * s)])
        self.images_at = np.arange(EVERY // 2, self.n - EVERY // 2, EVERY)

    def steps(self, turn: int) -> np.ndarray:
        """(n - 1, 3) odometry of a round."""
        return self.told[turn * self.n:turn * self.n + self.n - 1]

    def profiles(self, turn: int, at: int) -> np.ndarray:
        """Range profiles of the looks at one pose."""
        rng = np.random.default_rng([self.seed, 1 + turn, at])
        return echoes(self.towns[turn], self.true[turn][look_indices(at)], rng)

    def images(self, job: tuple[int, int]) -> tuple[Image, Image | np.ndarray]:
        """Image in the car's own frame, and that of the survey, or the profiles, at one pose."""
        turn, at = job
        profiles, indices = self.profiles(turn, at), look_indices(at)
        believed = chained(np.zeros(3), self.steps(turn)[indices[0]:indices[-1]])
        own = seen_from(believed[at - indices[0]], believed)
        beside = formed(profiles, own, grid_beside(np.zeros(3)))
        if turn:
            return beside, profiles
        return beside, formed(profiles, self.surveyed[indices],
                              grid_beside(self.surveyed[at]))


def joined(images: list[Image]) -> Image:
    """Mean power of images whose pixels lie on one raster, as an amplitude."""
    ends = np.array([[i.grid.x_m[[0, -1]], i.grid.y_m[[-1, 0]]] for i in images])
    low, high = ends[..., 0].min(axis=0), ends[..., 1].max(axis=0)
    n_x, n_y = np.rint((high - low) / SPACING_M).astype(int) + 1
    grid = MapGrid((*(low + high) / 2, 0.0), int(n_x), int(n_y), SPACING_M)
    power, seen = np.zeros((2, *grid.shape), np.float32)
    for image in images:
        row, column = np.rint(grid.to_pixels(image.grid.x_m[0], image.grid.y_m[0])).astype(int)
        part = np.s_[row:row + image.shape[0], column:column + image.shape[1]]
        power[part] += image.samples**2
        seen[part] += image.samples > 0
    return Image(np.sqrt(power / np.maximum(seen, 1)), grid, images[0].carrier_hz,
                 Report('simulated', '', -40.0))


# --------------------------------------------------------------------- located in the map

def second_round(drive: Drive, reference: Image, images) -> dict:
    """Poses and what was found in the second round, image by image."""
    steps, estimator = drive.steps(1), surveyed_filter(drive)
    start = estimator.state[:3].copy()
    std = np.sqrt(np.diag(estimator.covariance))
    # layover is small with an antenna 2.5 m high: a tenth of a height
    localizer = Localizer(reference, resolution_m=RESOLUTION_M, search_m=10.0,
                          std_m=std[:2].max(), std_deg=math.degrees(std[2]))
    odometer, fused, found = [start], [start], []
    spread = [estimator.covariance[:3, :3]]
    way, strip = 0.0, []  # images since the latest estimate, each with its first look
    for k in range(1, drive.n):
        odometer.append(compose(odometer[-1], estimator.step(steps[k - 1])))
        way += math.hypot(*(odometer[-1] - odometer[-2])[:2])
        at, indices = k - 1, look_indices(k - 1)  # its last look was taken here
        if at in images:
            image = formed(images.pop(at), np.array(odometer)[indices], grid_beside(odometer[at]))
            strip = [*strip[1 - _MOST_JOINED:], (indices[0], image)]
            if len(strip) >= _LEAST_JOINED:
                answer = localizer.locate(joined([one for _, one in strip]), Guess(
                    (*odometer[at][:2], 0.0), odometer[at][2], way,
                    int(_STEP_NS * strip[0][0]), int(_STEP_NS * indices[-1])))
                found.append((at, answer))
                if isinstance(answer, Estimate):
                    moved, strip = seen_from(odometer[at], odometer[k]), []
                    estimator.correct(compose(answer.pose, moved),
                                      _BETWEEN_HOUSES * answer.covariance)
        fused.append(estimator.state[:3].copy())
        spread.append(estimator.covariance[:3, :3])
    return {'odometry': chained(start, steps), 'fused': np.array(fused),
            'spread': np.array(spread), 'found': found}


def surveyed_filter(drive: Drive) -> Filter:
    """The filter where the survey ends, after the last part of the first round."""
    first = drive.n - _LEARNED
    estimator = Filter(drive.surveyed[first], np.diag(_SURVEY_STD**2))
    for k in range(first, drive.n):
        estimator.step(drive.told[k])
        if k % EVERY == 0:
            estimator.correct(drive.surveyed[k + 1], np.diag(_SURVEY_STD**2))
    return estimator


def figures_of_map(drive: Drive, result: dict) -> dict:
    """What the second round was located by."""
    true, found = drive.true[1], result['found']
    error = _error(result['fused'], true)
    place, turn = np.hypot(error[:, 0], error[:, 1]), np.degrees(np.abs(error[:, 2]))
    used = [(k, a) for k, a in found if isinstance(a, Estimate)]
    lone = np.array([_error(a.pose, true[k]) for k, a in used])
    nees = [float(e @ np.linalg.solve(a.covariance, e))
            for e, (_, a) in zip(lone, used, strict=True)]
    fused_nees = np.einsum('ni,nij,nj->n', error, np.linalg.inv(result['spread']), error)
    lost = np.hypot(*(result['odometry'] - true)[:, :2].T)
    kinds = [a.kind for _, a in found if not isinstance(a, Estimate)]
    return {'images': len(found), 'located': len(used), 'refused': {
                kind: kinds.count(kind) for kind in dict.fromkeys(kinds)},
            'false': int(sum(n > _GATE for n in nees)),
            'image_error_m_median': _short(np.median(np.hypot(*lone[:, :2].T))),
            'image_error_deg_median': _short(np.median(np.degrees(np.abs(lone[:, 2])))),
            'image_nees': _short(np.mean(nees)),
            'error_m': [_short(f) for f in (np.median(place), place.max())],
            'error_deg': [_short(f) for f in (np.median(turn), turn.max())],
            'within': _short(np.mean((place <= WANTED_M) & (turn <= WANTED_DEG))),
            'fused_nees': _short(np.mean(fused_nees)),
            'odometry_m': [_short(f) for f in (np.median(lost), lost.max())],
            'odometry_deg': _short(np.degrees(np.abs(
                _error(result['odometry'], true)[:, 2])).max()),
            'drift_percent': _short(drift_percent(drive))}


def drift_percent(drive: Drive) -> float:
    """Error of odometry over 100 m of way, mean, as odometry is compared (KITTI)."""
    true = np.concatenate([path[:-1] for path in drive.true])
    steps = np.concatenate([drive.steps(0)[:-1], drive.told[drive.n - 1:drive.n], drive.steps(1)])
    told, n = chained(true[0], steps[:len(true) - 1]), round(100 / STEP_M)
    apart = seen_from(told[:-n], told[n:]) - seen_from(true[:-n], true[n:])
    return float(np.mean(np.hypot(apart[:, 0], apart[:, 1])))


def _error(pose, true) -> np.ndarray:
    """(..., 3) difference of poses, headings within half a turn."""
    error = np.subtract(pose, true)
    error[..., 2] = np.remainder(error[..., 2] + np.pi, 2 * np.pi) - np.pi
    return error


def _short(value) -> float:
    return float(f'{value:.3g}')


# ------------------------------------------------------------------- without map or survey

def closed(drive: Drive, beside: dict, path: pathlib.Path | None = None) -> dict:
    """Loop closures between both rounds, and the graph of poses before and after."""
    at = drive.images_at[::_KEY]
    keys = [(turn, k) for turn in (0, 1) for k in at]
    index = [turn * drive.n + k for turn, k in keys]
    odometer = chained(drive.true[0][0], drive.told)[index]
    true = np.concatenate(drive.true)[index]
    edges = [_odometry_edge(n, odometer) for n in range(len(keys) - 1)]
    guess, closures, zeros = odometer.copy(), [], np.zeros((len(keys), 3))
    for n in range(len(at), len(keys)):
        near = np.hypot(*(guess[:len(at), :2] - guess[n, :2]).T)
        reach = _NEAR_M if closures else 50.0
        for m in np.argsort(near)[:3 if closures else 8]:
            if near[m] > reach:
                break
            found = register(beside[keys[n]], beside[keys[m]], resolution_m=RESOLUTION_M,
                             search_m=20.0)
            if found.accepted:
                closures.append(PoseEdge.of_registration(found, zeros, int(m), n))
                guess = solved(odometer, [*edges, *closures])
                break
    if path:
        write_g2o(path, odometer, [*edges, *closures])
    return {'poses': guess, 'true': true, 'odometry': odometer, 'closures': closures,
            'n_first': len(at)}


def _odometry_edge(n: int, odometer) -> PoseEdge:
    """Edge of two neighbours: 2 % of the way, and the bias of the gyro."""
    step = seen_from(odometer[n], odometer[n + 1])
    way = math.hypot(*step[:2])
    std = np.array([0.02 * way, 0.02 * way, 1.5 * BIAS_RAD * way])
    return PoseEdge(n, n + 1, step, np.diag(std**-2))


def figures_of_graph(result: dict) -> dict:
    """How well poses of the second round are known among those of the first, and all of them."""
    edges, true, out = result['closures'], result['true'], {}
    apart = np.array([seen_from(seen_from(true[e.first], true[e.second]), e.relative)
                      for e in edges])
    nees = [float(d @ e.information @ d) for d, e in zip(apart, edges, strict=True)]
    n, second = result['n_first'], np.arange(result['n_first'], len(true))
    nearest = np.array([np.hypot(*(true[:n, :2] - true[k, :2]).T).argmin() for k in second])
    wanted = seen_from(true[nearest], true[second])
    for name in ('odometry', 'poses'):
        poses = result[name]
        error = _error(seen_from(poses[nearest], poses[second]), wanted)
        place = np.hypot(error[:, 0], error[:, 1])
        out[name] = {'error_m': [_short(np.median(place)), _short(place.max())],
                     'error_deg': [_short(np.degrees(f(np.abs(error[:, 2]))))
                                   for f in (np.median, np.max)],
                     'shape_m': _short(np.hypot(*(poses - true)[:, :2].T).max())}
    return out | {'poses_in_graph': len(true), 'closures': len(edges),
                  'false': int(sum(f > _GATE for f in nees)), 'nees': _short(np.mean(nees))}


# ------------------------------------------------------------------------------- results

def tables(results: dict) -> str:
    """Tables of docs/localization.md."""
    of_map, of_graph = results['map'], results['graph']
    rows = [['odometry', '', *of_map['odometry_m'], '', of_map['odometry_deg'], ''],
            ['images alone', f'{of_map["located"]} of {of_map["images"]}',
             of_map['image_error_m_median'], '', of_map['image_error_deg_median'], '',
             of_map['image_nees']],
            ['images and odometry, fused', '', *of_map['error_m'], *of_map['error_deg'],
             of_map['fused_nees']]]
    graph = [[name, f'{of_graph["closures"]} of {of_graph["poses_in_graph"] // 2}'
              if key == 'poses' else '', *of_graph[key]['error_m'], *of_graph[key]['error_deg'],
              of_graph[key]['shape_m']]
             for name, key in (('odometry', 'odometry'), ('pose graph', 'poses'))]
    return '\n\n'.join([
        table('second round, in the map', 'located', 'median error (m)', 'largest (m)',
              'median (°)', 'largest (°)', 'NEES (3)', rows=rows),
        table('second round, to the first', 'closures', 'median error (m)', 'largest (m)',
              'median (°)', 'largest (°)', 'shape, largest (m)', rows=graph)])


def picture(path: pathlib.Path, drive: Drive, reference: Image, located: dict) -> None:
    """Draw true, odometry's and fused track on the map, and the errors along the way."""
    true, fused = drive.true[1], located['fused']
    figure = Figure(figsize=(14.0, 7.0), dpi=80)
    columns = figure.add_gridspec(1, 2, width_ratios=(1.25, 1.0))
    town_axes = figure.add_subplot(columns[0])
    right = columns[1].subgridspec(2, 1, height_ratios=(1.2, 1.0))
    near, along = (figure.add_subplot(part) for part in right)
    grid, level = reference.grid, reference.samples
    seen = np.ma.masked_equal(level, 0.0)
    middle = 20 * np.log10(np.median(level[level > 0]))
    lost = np.hypot(*(located['odometry'] - true)[:, :2].T)
    middle_m = true[int(np.argmax(lost))]
    for axes in (town_axes, near):
        axes.set_facecolor('black')
        axes.imshow(20 * np.ma.log10(seen), cmap='gray', vmin=middle - 12, vmax=middle + 28,
                    extent=(grid.x_m[0], grid.x_m[-1], grid.y_m[-1], grid.y_m[0]))
        axes.plot(*true[:, :2].T, color='deepskyblue', lw=3, label='true')
        axes.plot(*located['odometry'][:, :2].T, color='red', lw=1.2, label='odometry')
        axes.plot(*fused[:, :2].T, '--', color='lime', lw=1.4, label='fused')
        axes.set_xlabel('x (m)')
    places = np.array([a.pose for _, a in located['found'] if isinstance(a, Estimate)])
    near.plot(*places[:, :2].T, 'o', mfc='none', mec='yellow', ms=7, label='images alone')
    near.set_xlim(middle_m[0] - 55, middle_m[0] + 55)
    near.set_ylim(middle_m[1] - 40, middle_m[1] + 40)
    town_axes.set_title('map of the first round, tracks of the second')
    near.legend(loc='upper right', fontsize=8)
    _draw_errors(along, drive, located, lost)
    figure.tight_layout()
    figure.savefig(path)


def _draw_errors(axes, drive: Drive, located: dict, lost) -> None:
    true, way = drive.true[1], STEP_M * np.arange(drive.n)
    error = _error(located['fused'], true)
    alone = [(way[k], np.hypot(*(a.pose - true[k])[:2])) for k, a in located['found']
             if isinstance(a, Estimate)]
    axes.semilogy(way, lost, color='red', label='odometry (m)')
    axes.semilogy(way, np.hypot(error[:, 0], error[:, 1]), color='green', label='fused (m)')
    axes.semilogy(way, np.degrees(np.abs(error[:, 2])), color='green', ls=':',
                  label='fused (°)')
    axes.semilogy(*np.array(alone).T, 'o', mfc='none', mec='goldenrod', ms=4,
                  label='images alone (m)')
    axes.axhline(WANTED_M, color='black', lw=0.8)
    axes.set_ylim(3e-3, 1e2)
    axes.set_xlabel('way of the second round (m)')
    axes.set_ylabel('error')
    axes.legend(loc='lower right', fontsize=8, ncol=2)


def run(seed: int, workers: int = 2, graph: pathlib.Path | None = None):
    """The whole drive: figures, and what the picture shows."""
    drive = Drive(seed)
    jobs = [(turn, int(at)) for turn in (0, 1) for at in drive.images_at]
    beside, profiles = {}, {}
    surveyed = []
    with multiprocessing.get_context('fork').Pool(workers, _start, [seed]) as pool:
        for job, (own, other) in zip(jobs, tqdm(pool.imap(_images, jobs), total=len(jobs),
                                                mininterval=5.0), strict=True):
            beside[job] = own
            if job[0]:
                profiles[job[1]] = other
            else:
                surveyed.append(other)
    image = joined(surveyed)
    located = second_round(drive, image, profiles)
    loops = closed(drive, beside, graph)
    figures = {'seed': seed, 'map': figures_of_map(drive, located),
               'graph': figures_of_graph(loops)}
    return figures, (drive, image, located)


def _start(seed: int) -> None:
    """Let a worker have a drive of its own, since scenes are no messages."""
    global _drive
    _quiet()
    _drive = Drive(seed)


def _images(job: tuple[int, int]):
    return _drive.images(job)


def _quiet() -> None:
    """Grids are wider than the beam: pixels that it does not light are ambiguous, and left out."""
    logging.getLogger('sar_imaging').setLevel(logging.ERROR)


def main() -> None:
    """Drive, and write picture, graph and figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seed', type=int, help='fresh by default')
    parser.add_argument('--workers', type=int, default=2)
    parser.add_argument('--results', type=pathlib.Path, help=f'such as {RESULTS.name}')
    parser.add_argument('--picture', type=pathlib.Path, default=PICTURE)
    parser.add_argument('--table', action='store_true', help='print the table of the results')
    arguments = parser.parse_args()
    if arguments.table:
        print(tables(json.loads(RESULTS.read_text())))
        return
    seed = np.random.SeedSequence().entropy % 2**31 if arguments.seed is None else arguments.seed
    arguments.picture.parent.mkdir(parents=True, exist_ok=True)
    _quiet()
    figures, (drive, reference, located) = run(seed, arguments.workers,
                                               arguments.picture.with_suffix('.g2o'))
    print(json.dumps(figures, indent=1))
    picture(arguments.picture, drive, reference, located)
    if arguments.results:
        arguments.results.write_text(json.dumps(figures | {'machine': machine()}, indent=1,
                                                ensure_ascii=False) + '\n')


if __name__ == '__main__':
    main()
