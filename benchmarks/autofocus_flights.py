"""Random drone flights with a wrong clock: how often autofocus rescues them, and what it claims.

Run from the repository root::

    python -m benchmarks.autofocus_flights

Flights of `sar_imaging.simulation.trials.drone_flights`, UWB and FMCW in turn, hovering and
turning, with the poses' clock wrong: by up to 0.3 s in one half of them, which autofocus is told
to expect 0.4 s for, by 0.3 to 2 s in the other half, told 2 s. They go through
`nodes.images.autofocus.ImageFocus`, the class of the nodes, with its default parameters; only the
poses are handed over directly.
`benchmarks.autofocus_nodes` sends some of them through node processes.

*Focused* means a contrast within 5 % of that with the true offset; *right* that the offset found
leaves at most 1 rad rms of visible phase; a claim is false unless it is both; *worse* is an image
that was replaced by one that is not focused and has more visible phase error or less contrast than
before.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import pathlib
import time

import numpy as np
from tqdm import tqdm

from sar_imaging.autofocus.models import Geometry
from sar_imaging.autofocus.offset_search import visible_phase
from sar_imaging.autofocus.track import PhaseCentreTrack
from sar_imaging.nodes import backprojection_steps
from sar_imaging.nodes.images.autofocus import ImageFocus
from sar_imaging.nodes.runtime.stage import COMMON_PARAMETERS
from sar_imaging.quality import contrast
from sar_imaging.signal.positioning import locate
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.trials.drone_flights import RADARS, DroneFlight, drone_flight
from sar_imaging.streaming.aperture import ApertureImager

from .support.machine import machine

RESULTS = pathlib.Path(__file__).parent / 'results' / 'autofocus_flights.json'
SMALL_S, LARGE_S = 0.3, 2.0
EXPECTED_S = {True: 0.4, False: 2.0}  # that the parameter tells, by whether the offset is small
FOCUSED, RIGHT_RAD = 0.95, 1.0


class Log:
    """Counters and lines, as the node's health takes them."""

    def __init__(self):
        self.values: dict[str, float] = {}
        self.lines: list[str] = []

    def count(self, key: str, n: int = 1) -> None:
        """Count."""
        self.values[key] = self.values.get(key, 0) + n

    def set(self, key: str, value: float) -> None:
        """Set a figure."""
        self.values[key] = value

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


def random_offset_s(seed: int) -> float:
    """Small for even seeds, large for odd ones, of either sign."""
    rng = np.random.default_rng([seed, 17])
    size = rng.uniform(0.0, SMALL_S) if seed // 2 % 2 == 0 else rng.uniform(SMALL_S, LARGE_S)
    return float(rng.choice([-1.0, 1.0]) * size)


def measure(seed: int) -> dict:
    """One flight: what autofocus says, and what is true."""
    flight = drone_flight(seed, radar_kind=RADARS[seed % 2])
    offset_s = random_offset_s(seed)
    expected_s = EXPECTED_S[abs(offset_s) <= SMALL_S]
    poses, alignment = flight.track(), flight.misaligned(offset_s)
    located = locate(flight.block, poses, alignment)
    profiles = RangeCompressor.for_block(located)(located)
    true = locate(flight.block, poses, flight.alignment)
    imager = ApertureImager(flight.grid, pulses_per_aperture=profiles.n_pulses, keep_pulses=True)
    [wanted] = imager.add(dataclasses.replace(profiles, tx_m=true.tx_m, rx_m=true.rx_m))
    imager.reset()
    [product] = imager.add(profiles)
    parameters = {p.name: p.default for p in (*backprojection_steps.PARAMETERS,
                                              *COMMON_PARAMETERS)}
    log = Log()
    focus = ImageFocus(parameters | {'autofocus.time_offset': expected_s}, flight.grid, log)
    focus.positions = AllPoses(flight, alignment, focus.reach_s)
    began, cpu = time.perf_counter(), time.process_time()
    [result] = focus.take([product])
    seconds, cpu = time.perf_counter() - began, time.process_time() - cpu
    accepted = bool(log.values.get('autofocus_accepted', 0))
    found_s = log.values.get('autofocus_time_offset_s', 0.0)
    left_s = offset_s + (found_s if accepted else 0.0)

    def visible(at_s: float) -> float:
        moved = locate(flight.block, poses, flight.misaligned(at_s))
        return visible_phase(Geometry(true.tx_m, true.rx_m), Geometry(moved.tx_m, moved.rx_m),
                             [flight.grid.centre_m], profiles.radar.wavenumber_rad_per_m)

    true_contrast = contrast(wanted.image)
    relative = contrast(result.image) / true_contrast
    before = contrast(product.image) / true_contrast
    phase, phase_before = visible(left_s), visible(offset_s)
    focused = relative >= FOCUSED
    claimed = bool(log.values.get('autofocus_claimed', 0))
    return {
        'seed': seed, 'motion': flight.motion, 'radar': flight.radar_kind,
        'angle_deg': round(flight.angle_deg, 1), 'offset_s': round(offset_s, 4),
        'left_s': round(left_s, 4), 'visible_rad': [round(phase_before, 2), round(phase, 2)],
        'contrast_true': round(true_contrast, 2),
        'contrast_relative': [round(before, 3), round(relative, 3)],
        'focused': bool(focused), 'focused_before': bool(before >= FOCUSED),
        'replaced': accepted, 'claimed': claimed,
        'falsely_claimed': claimed and not (focused and phase <= RIGHT_RAD),
        'worse': accepted and not focused and (phase > phase_before or relative < before),
        'verdict': result.verdict, 'details': result.details, 'seconds': round(seconds, 2),
        'cpu_s': round(cpu, 2)}


def summary(rows) -> dict:
    """Shares over all flights, by size of the offset, by radar, motion and angle."""
    kinds = {
        'all': lambda r: True, 'within 0.3 s': lambda r: abs(r['offset_s']) <= SMALL_S,
        '0.3 to 2 s': lambda r: abs(r['offset_s']) > SMALL_S,
        **{f'{radar}, {motion}': lambda r, a=radar, b=motion: (r['radar'], r['motion']) == (a, b)
           for radar in RADARS for motion in ('hover', 'turn')},
        '5 to 12 degrees': lambda r: r['angle_deg'] <= 12.0,
        '12 to 30 degrees': lambda r: r['angle_deg'] > 12.0}
    out = {}
    for name, belongs in kinds.items():
        some = [r for r in rows if belongs(r)]
        if some:
            out[name] = {'flights': len(some)} | {
                key: sum(r[key] for r in some) for key in (
                    'focused_before', 'focused', 'replaced', 'claimed', 'falsely_claimed',
                    'worse')} | {
                'focused_share': round(sum(r['focused'] for r in some) / len(some), 3),
                'median_cpu_s': round(float(np.median([r['cpu_s'] for r in some])), 2)}
    return out


def main() -> None:
    """Measure and write the results, which grow flight by flight."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n', 1)[0])
    parser.add_argument('--flights', type=int, default=200, metavar='N')
    parser.add_argument('--first', type=int, default=50_000, metavar='SEED')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    parser.add_argument('--go-on', action='store_true',
                        help='keep the flights in the output and measure those that lack')
    arguments = parser.parse_args()
    results = {'machine': machine(), 'summary': {}, 'flights': []}
    if arguments.go_on:
        results = json.loads(arguments.output.read_text())
    known = {flight['seed'] for flight in results['flights']}
    wanted = range(arguments.first, arguments.first + arguments.flights)
    for seed in tqdm([seed for seed in wanted if seed not in known]):
        results['flights'].append(measure(seed))
        results['summary'] = summary(results['flights'])
        arguments.output.write_text(json.dumps(results, indent=1) + '\n')


if __name__ == '__main__':
    main()
