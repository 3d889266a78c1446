# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Random drone flights with a wrong clock: how often autofocus rescues them, and what it claims.

Run from the repository root::

    python -m benchmarks.autofocus_flights            # random flights
    python -m benchmarks.autofocus_flights --widths   # straight legs, each searched with 4 widths
    python -m benchmarks.autofocus_flights --out-of-reach   # the right offset cannot be tried
    python -m benchmarks.autofocus_flights --rails ../shared/data    # measured ones, likewise
    python -m benchmarks.autofocus_flights --tracks   # the corrected track and its covariance

Flights of `benchmarks.support.drone_flights`, UWB and FMCW in turn, hovering, turning
and on straight legs, with the poses' clock wrong by 0.03 to 2 s. Autofocus is told to expect 1, 3,
10 or 40 times the true error, 5 s at most. Of each flight one in three has profiles that end
within the image, so that a part of it leaves them; a moving reflector as bright as the brightest;
a reflector 20 dB brighter than all others; two gaps of a twentieth of the pulses. They go
through `nodes.images.autofocus.ImageFocus`, the class of the nodes, with its default parameters;
only the poses are handed over directly.
`benchmarks.autofocus_nodes` sends some of them through node processes.

*Right* means that the offset found leaves at most 1 rad rms of visible phase: what only displaces
the image does not count, and the response keeps 37 % of its peak power or more, the width of the
resolution. A claim is false unless it is right. *Refused* is a right offset whose image was not
used. *Focused* means a contrast within 5 % of that with the true offset; *worse* is an image that
was replaced by one that is neither right nor focused.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import pathlib
import time

import numpy as np
from scipy import special
from tqdm import tqdm

from benchmarks.support.drone_flights import (
    MOTIONS,
    POSE_NOISE_M,
    RADARS,
    DroneFlight,
    drone_flight,
)
from sar_imaging.autofocus.corrected_track import corrected_track
from sar_imaging.autofocus.live import BEYOND, live_autofocus
from sar_imaging.autofocus.models import OFFSET, Geometry
from sar_imaging.autofocus.offset_search import BEYOND_S, visible_phase
from sar_imaging.autofocus.track import PhaseCentreTrack, on_track
from sar_imaging.nodes import backprojection
from sar_imaging.nodes.images.autofocus import ImageFocus
from sar_imaging.nodes.runtime.stage import COMMON_PARAMETERS
from sar_imaging.quality import contrast
from sar_imaging.recordings import load
from sar_imaging.signal.positioning import locate
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.echoes import EchoSimulator
from sar_imaging.streaming.aperture import ApertureImager

from .support.machine import machine

RAILS = (('team5_rail', 'bwsi2019_team5_rail'), ('team6_rail_fitted', 'bwsi2019_team6_rail'))
RAIL_OFFSETS_S = (0.1, -0.25, -0.8, 2.0)
RESULTS = pathlib.Path(__file__).parent / 'results' / 'autofocus_flights.json'
WIDTH_RESULTS = RESULTS.with_name('autofocus_widths.json')
TRACK_RESULTS = RESULTS.with_name('autofocus_tracks.json')
OUT_OF_REACH_RESULTS = RESULTS.with_name('autofocus_out_of_reach.json')
RAIL_RESULTS = RESULTS.with_name('autofocus_rails.json')
OUT_OF_REACH_S, TOO_NARROW_S = 3.9, 1.0  # 3.25 s are tried of it
SMALLEST_S, LARGEST_S, WIDEST_S = 0.03, 2.0, 5.0
TIMES = (1.0, 3.0, 10.0, 40.0)  # of the true error, that is searched for
WIDTHS_S = (0.3, 1.0, 2.0, 5.0)
FOCUSED, RIGHT_RAD = 0.95, 1.0
DISTURBANCES = ('cut', 'mover', 'bright', 'gaps')
_N_PIXELS = 160
_BRIGHT = 10.0  # amplitude, of a reflector alone
_REACHED = 0.8  # of the image, along each axis, by profiles that were cut


class Log:
    """Counters and lines, as the node's health takes them."""

    def __init__(self):
        self.values: dict[str, float | str] = {}
        self.lines: list[str] = []

    def count(self, key: str, n: int = 1) -> None:
        """Count."""
        self.values[key] = self.values.get(key, 0) + n

    def set(self, key: str, value: float) -> None:
        """Set a figure or a text."""
        self.values[key] = value

    tell = set

    def info(self, text: str) -> None:
        """Keep a line."""
        self.lines.append(text)

    warning = info


class AllPoses:
    """In place of `nodes.poses.known_positions`: all poses of a flight are known."""

    source, awaited = 'the flight', False

    def __init__(self, flight: DroneFlight, alignment, reach_s: float):
        self._flight, self._alignment, self._reach_ns = flight, alignment, round(reach_s * 1e9)

    def suffices(self, pulses) -> bool:
        """Nothing is waited for."""
        return True

    def around(self, pulses) -> PhaseCentreTrack:
        """Track of the poses around some pulses."""
        span = (int(pulses.stamp_ns[0]) - self._reach_ns, int(pulses.stamp_ns[-1])
                + self._reach_ns)
        return PhaseCentreTrack.of_poses(self._flight.track(), self._alignment,
                                         pulses.n_channels, span)


@dataclasses.dataclass(frozen=True)
class Case:
    """A flight, what is wrong with it, and the error that is expected."""

    seed: int
    flight: DroneFlight
    disturbances: tuple[str, ...]
    offset_s: float
    expected_s: float


def random_case(seed: int) -> Case:
    """One of each kind of disturbance for a third of the seeds; error and width at random."""
    rng = np.random.default_rng([seed, 17])
    disturbances = tuple(name for name in DISTURBANCES if rng.random() < 1 / 3)
    flight = drone_flight(seed, motion=MOTIONS[seed // 2 % 3], radar_kind=RADARS[seed % 2],
                          n_pixels=_N_PIXELS)
    size_s = np.exp(rng.uniform(*np.log([SMALLEST_S, LARGEST_S])))
    expected_s = min(TIMES[seed % 4 if seed % 8 < 4 else -1 - seed % 4] * size_s, WIDEST_S)
    return Case(seed, disturbed(flight, disturbances, rng), disturbances,
                float(rng.choice([-1.0, 1.0]) * size_s), float(expected_s))


def out_of_reach(seed: int) -> Case:
    """A flight whose clock is wrong by more than is tried."""
    case = random_case(seed)
    return dataclasses.replace(case, expected_s=TOO_NARROW_S, offset_s=float(
        np.copysign(OUT_OF_REACH_S, case.offset_s)))


def disturbed(flight: DroneFlight, disturbances, rng) -> DroneFlight:
    """The flight with more echoes, or with fewer pulses."""
    block, grid = flight.block, flight.grid
    true = locate(block, flight.track(), flight.alignment)
    half_m = 0.5 * grid.n_x * grid.spacing_m
    time_s = (block.stamp_ns - block.stamp_ns[0])[:, None, None] * 1e-9
    samples = block.samples
    for name, amplitude, speed_m_per_s in (('mover', 1.0, 0.3), ('bright', _BRIGHT, 0.0)):
        if name in disturbances:
            direction = rng.uniform(0, 2 * np.pi)
            moved_m = speed_m_per_s * time_s * [np.cos(direction), np.sin(direction), 0.0]
            point = np.array([[*rng.uniform(-0.6, 0.6, 2) * half_m, 0.0]])
            echo = EchoSimulator(block.radar, block.n_samples, compressed=False, points_m=point,
                                 amplitudes=np.array([amplitude + 0j]))
            samples = samples + echo(true.tx_m - moved_m, true.rx_m - moved_m)
    block = dataclasses.replace(block, samples=samples)
    if 'gaps' in disturbances:
        n = block.n_pulses
        missing = np.concatenate([np.arange(at, at + n // 20) for at in rng.integers(
            n // 10, 9 * n // 10 - n // 20, 2)])
        block = block.select(np.setdiff1d(np.arange(n), missing))
    return dataclasses.replace(flight, block=block)


def cut(profiles, true, grid):
    """Profiles that reach a part of the image alone."""
    half = 0.5 * _REACHED * grid.n_x * grid.spacing_m
    corners = np.array([[x, y, 0.0] for x in (-half, half) for y in (-half, half)])
    path = np.linalg.norm(true.tx_m[:, 0, None] - corners, axis=-1)
    radar = profiles.radar
    first, last = (int((r - radar.range_start_m) / radar.sample_spacing_m)
                   for r in (path.min(), path.max()))
    first = max(first, 0)
    delay_s = (radar.first_sample_delay_s + 2 * first * radar.sample_spacing_m
               / radar.propagation_speed_m_per_s)
    return dataclasses.replace(
        profiles, radar=dataclasses.replace(radar, first_sample_delay_s=delay_s),
        samples=profiles.samples[..., first:last + 2].copy())


def measure(case: Case) -> dict:
    """One flight: what autofocus says, and what is true."""
    flight, offset_s, expected_s = case.flight, case.offset_s, case.expected_s
    poses, alignment = flight.track(), flight.misaligned(offset_s)
    located, true = (locate(flight.block, poses, a) for a in (alignment, flight.alignment))
    profiles = RangeCompressor.for_block(located)(located)
    if 'cut' in case.disturbances:
        profiles = cut(profiles, true, flight.grid)
    imager = ApertureImager(flight.grid, pulses_per_aperture=profiles.n_pulses, keep_pulses=True)
    profiles = dataclasses.replace(profiles, counter=np.arange(profiles.n_pulses, dtype=np.uint32))
    [wanted] = imager.add(dataclasses.replace(profiles, tx_m=true.tx_m, rx_m=true.rx_m))
    imager.reset()
    [product] = imager.add(profiles)
    parameters = {p.name: p.default for p in (*backprojection.PARAMETERS,
                                              *COMMON_PARAMETERS)}
    log = Log()
    focus = ImageFocus(parameters | {'autofocus.time_offset': expected_s}, flight.grid, log)
    focus.positions = AllPoses(flight, alignment, focus.reach_s + BEYOND_S)
    began, cpu = time.perf_counter(), time.process_time()
    [result] = focus.take([product])
    seconds, cpu = time.perf_counter() - began, time.process_time() - cpu
    accepted = bool(log.values.get('autofocus_accepted', 0))
    found_s = log.values.get('autofocus_time_offset_s', 0.0)

    def visible(at_s: float) -> float:
        moved = locate(flight.block, poses, flight.misaligned(at_s))
        return visible_phase(Geometry(true.tx_m, true.rx_m), Geometry(moved.tx_m, moved.rx_m),
                             [flight.grid.centre_m], profiles.radar.wavenumber_rad_per_m)

    true_contrast = contrast(wanted.image)
    relative, before = (contrast(p.image) / true_contrast if np.any(p.image) else 0.0
                        for p in (result, product))
    left_s = offset_s + found_s if accepted else offset_s
    phase_found, phase_before, phase = map(visible, (offset_s + found_s, offset_s, left_s))
    claimed = bool(log.values.get('autofocus_claimed', 0))
    right = phase <= RIGHT_RAD
    return {
        'seed': case.seed, 'motion': flight.motion, 'radar': flight.radar_kind,
        'angle_deg': round(flight.angle_deg, 1), 'disturbances': case.disturbances,
        'offset_s': round(offset_s, 4), 'expected_s': round(expected_s, 3),
        'left_s': round(offset_s + found_s, 4),
        'visible_rad': [round(phase_before, 2), round(phase_found, 2)],
        'contrast_relative': [round(before, 3), round(relative, 3)],
        'found': bool(phase_found <= RIGHT_RAD), 'right_before': bool(phase_before <= RIGHT_RAD),
        'replaced': accepted, 'right': bool(right), 'focused': bool(relative >= FOCUSED),
        'claimed': claimed, 'falsely_claimed': bool(claimed and not right),
        'refused': bool(phase_found <= RIGHT_RAD and not right),
        'worse': bool(accepted and not right and relative < FOCUSED),
        'verdict': result.verdict, 'details': result.details, 'seconds': round(seconds, 2),
        'cpu_s': round(cpu, 2)}


def measure_track(case: Case) -> dict:
    """One flight: errors of its track before and after, and what the covariance says of them."""
    flight, poses, alignment = case.flight, case.flight.track(), case.flight.misaligned(
        case.offset_s)
    located, true = (locate(flight.block, poses, a) for a in (alignment, flight.alignment))
    profiles = RangeCompressor.for_block(located)(located)
    if 'cut' in case.disturbances:
        profiles = cut(profiles, true, flight.grid)
    reach_ns = round((BEYOND * case.expected_s + BEYOND_S) * 1e9)
    track = PhaseCentreTrack.of_poses(poses, alignment, profiles.n_channels, (
        int(profiles.stamp_ns[0]) - reach_ns, int(profiles.stamp_ns[-1]) + reach_ns))
    began = time.process_time()
    result = live_autofocus(flight.grid, time_offset_s=case.expected_s,
                            track=track).process(profiles)
    row = {'seed': case.seed, 'motion': flight.motion, 'radar': flight.radar_kind,
           'offset_s': round(case.offset_s, 4), 'expected_s': round(case.expected_s, 3),
           'claimed': result.report.success, 'refused': '',
           'cpu_s': [round(time.process_time() - began, 2)]}
    try:
        found = corrected_track(result, on_track(profiles, track, scale_s=case.expected_s),
                                flight.grid, position_std_m=POSE_NOISE_M)
    except ValueError as error:
        return row | {'refused': str(error)}
    row['cpu_s'].append(round(time.process_time() - began - row['cpu_s'][0], 2))
    before, after = (np.linalg.norm(p - true.tx_m[:, 0], axis=-1) for p in (
        profiles.tx_m[:, 0], found.position_m))
    left_s, std_s = case.offset_s + found.parameters[OFFSET], found.std[OFFSET]
    spread = np.linalg.eigvalsh(found.covariance_m2[profiles.n_pulses // 2])
    return row | {
        'error_m': [float(f'{np.sqrt(np.mean(e**2)):.3g}') for e in (before, after)],
        'left_s': float(f'{left_s:.3g}'), 'std_s': float(f'{std_s:.3g}'),
        'nees': float(f'{(left_s / std_s)**2:.3g}'),
        'std_m': [float(f'{np.sqrt(v):.3g}') for v in spread]}


def summary_of_tracks(rows) -> dict:
    """Errors of tracks and NEES, of flights whose focus is claimed and of all that are used."""
    out = {'flights': len(rows)}
    for name, some in (('claimed', [r for r in rows if r['claimed'] and not r['refused']]),
                       ('used', [r for r in rows if not r['refused']])):
        if some:
            before, after = np.array([r['error_m'] for r in some]).T
            nees = np.array([r['nees'] for r in some])
            out[name] = {
                'flights': len(some), 'error_m_median': [
                    float(f'{np.median(e):.3g}') for e in (before, after)],
                'left_of_error_median': float(f'{np.median(after / before):.3g}'),
                'at_most_a_third': int(np.sum(after <= before / 3)),
                'nees': round(float(nees.mean()), 2), 'nees_median': round(float(
                    np.median(nees)), 2), 'beyond_99.9_percent': int(np.sum(nees > 10.83)),
                'nees_bounds': [round(float(b), 2) for b in special.chdtri(
                    len(some), [0.975, 0.025]) / len(some)]}
    return out


def summary(rows) -> dict:
    """Counts over all flights, by width, by radar, motion and disturbance."""
    def times(row):
        return row['expected_s'] / abs(row['offset_s'])

    kinds = {
        'all': lambda r: True,
        **{f'{low:g} to {high:g} times the error': lambda r, a=low, b=high: a <= times(r) < b
           for low, high in ((0.5, 2.0), (2.0, 5.0), (5.0, 20.0), (20.0, 50.0))},
        **{f'{radar}, {motion}': lambda r, a=radar, b=motion: (r['radar'], r['motion']) == (a, b)
           for radar in RADARS for motion in MOTIONS},
        **{name: lambda r, a=name: a in r['disturbances'] for name in DISTURBANCES}}
    out = {}
    for name, belongs in kinds.items():
        some = [r for r in rows if belongs(r)]
        if some:
            out[name] = {'flights': len(some)} | {
                key: sum(r[key] for r in some) for key in (
                    'right_before', 'found', 'right', 'focused', 'replaced', 'claimed',
                    'falsely_claimed', 'refused', 'worse')} | {
                'median_cpu_s': round(float(np.median([r['cpu_s'] for r in some])), 2)}
    return out


def width_cases(seed: int):
    """Straight legs of 800 pulses, UWB: two errors of the clock, each with all widths."""
    flight = dataclasses.replace(drone_flight(seed, motion='legs', radar_kind='uwb',
                                              n_pixels=_N_PIXELS, n_pulses=800))
    rng = np.random.default_rng(seed)
    for offset_s in (float(rng.choice([0.03, 0.1, -0.2, 0.25])), float(rng.choice([-0.8, 2.0]))):
        for expected_s in WIDTHS_S:
            if expected_s >= abs(offset_s):
                yield Case(seed, flight, ('cut',), offset_s, expected_s)


def rail_cases(data: pathlib.Path):
    """Measured rail passes, with several errors of the clock and all widths."""
    for name, folder in RAILS:
        rail = load(name, data / folder)
        poses = rail.poses
        flight = DroneFlight('rail', name, 0.0, rail.block, poses.stamp_ns,
                             poses.position_m, poses.quaternion, rail.alignment, rail.scene.grid)
        for offset_s in RAIL_OFFSETS_S:
            for expected_s in WIDTHS_S:
                if expected_s >= abs(offset_s):
                    yield Case(0, flight, (), offset_s, expected_s)


def main() -> None:
    """Measure and write the results, which grow flight by flight."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n', 1)[0])
    parser.add_argument('--flights', type=int, default=200, metavar='N')
    parser.add_argument('--first', type=int, default=60_000, metavar='SEED')
    parser.add_argument('--widths', action='store_true', help='straight legs with all widths')
    parser.add_argument('--out-of-reach', action='store_true', help='too narrow a search')
    parser.add_argument('--rails', type=pathlib.Path, metavar='FOLDER', help='measured passes')
    parser.add_argument('--tracks', action='store_true', help='corrected tracks, covariances')
    parser.add_argument('--output', type=pathlib.Path, help=f'instead of {RESULTS.name}')
    parser.add_argument('--go-on', action='store_true',
                        help='keep the flights in the output and measure those that lack')
    parser.add_argument('--minutes', type=float, default=1e9, help='stop after so many')
    arguments = parser.parse_args()
    began = time.monotonic()
    output = arguments.output or (RAIL_RESULTS if arguments.rails else
                                  WIDTH_RESULTS if arguments.widths else
                                  OUT_OF_REACH_RESULTS if arguments.out_of_reach else
                                  TRACK_RESULTS if arguments.tracks else RESULTS)
    results = {'machine': machine(), 'summary': {}, 'flights': []}
    if arguments.go_on:
        results = json.loads(output.read_text())
    known = {(row['seed'], row['radar'], row['offset_s'], row['expected_s'])
             for row in results['flights']}
    seeds = range(arguments.first, arguments.first + arguments.flights)
    cases = (rail_cases(arguments.rails) if arguments.rails else
             (case for seed in seeds for case in width_cases(seed)) if arguments.widths else
             map(out_of_reach if arguments.out_of_reach else random_case, seeds))
    for case in tqdm(cases):
        key = case.seed, case.flight.radar_kind, round(case.offset_s, 4), round(case.expected_s, 3)
        if key in known or time.monotonic() - began > 60 * arguments.minutes:
            continue
        results['flights'].append((measure_track if arguments.tracks else measure)(case))
        results['summary'] = (summary_of_tracks if arguments.tracks else summary)(
            results['flights'])
        output.write_text(json.dumps(results, indent=1) + '\n')


if __name__ == '__main__':
    main()
