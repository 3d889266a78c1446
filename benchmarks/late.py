# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Age of images: real processes fed at half, once and twice their radar's rate, cold at first.

Run from the repository root: ``python -m benchmarks.late`` (twenty minutes), or parts of it:
``python -m benchmarks.late --cases automotive_77ghz --map yes``. `sar_pipeline` gets its
parameters from a shipped configuration, and pulses of that radar from this process, one aperture
after the other over the same piece of track, from the moment at which it subscribes. Run
``compile_kernels`` before. Results are written one by one. Linux only.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import os
import pathlib
import re
import signal
import tempfile
import time
from collections.abc import Iterator

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image
from std_msgs.msg import Float32MultiArray

from sar_imaging.configuration.parameters import read_configuration
from sar_imaging.recordings import bag_io
from sar_imaging.signal.pulses import PulseBlock, concatenate
from sar_imaging.simulation.scenarios.catalogue import configured_scenario
from sar_imaging.tools.launching import find_config
from sar_imaging.tools.node_processes import (
    NO_LOG_FILES,
    PIPELINE,
    NodeProcesses,
    isolated_environment,
    parameters_from_truth,
    pipeline_parameters,
)

from .support.machine import machine

ROOT = pathlib.Path(__file__).parents[1]
RESULTS = ROOT / 'benchmarks' / 'results' / 'late.json'
COUNTRYSIDE, DEFAULT = 'countryside', 'sar_imaging'
CASES = (COUNTRYSIDE, DEFAULT, 'airborne_x_band', 'automotive_77ghz', 'drone_uwb')
# Rate and name: pulses come from the moment at which somebody takes them.
PHASES = ((1.0, 'start'), (0.5, 'half'), (1.0, 'once'), (2.0, 'twice'), (0.5, 'recovery'))
PHASE_S, PHASE_APERTURES = 8.0, 4  # the longer one
START_NS = 1_700_000_000 * 10**9
LEVELS = {b'\x00': 'OK', b'\x01': 'WARN', b'\x02': 'ERROR', b'\x03': 'STALE'}
LEFT_OUT = ('apertures_too_old', 'apertures_skipped', 'apertures_dropped')
PATIENCE_S = 60.0


@dataclasses.dataclass(frozen=True)
class Case:
    """What a node is fed with, and how it is configured."""

    loop: PulseBlock  # a piece of track, flown again and again
    prf_hz: float
    pulses_per_aperture: int
    pulses_per_message: int
    parameters: dict
    files: tuple[pathlib.Path, ...]

    def messages(self) -> Iterator[tuple[float, int, bytes]]:
        """Time in seconds and counter of the last pulse of each message, and the message."""
        first = 0
        while True:
            rows = np.arange(first, first + self.pulses_per_message)
            block = self.loop.select(rows % self.loop.n_pulses)
            stamps = START_NS + np.rint(1e9 * rows / self.prf_hz).astype(np.int64)
            block = dataclasses.replace(block, counter=rows.astype(np.uint32), stamp_ns=stamps)
            yield rows[-1] / self.prf_hz, int(rows[-1]), bag_io.serialise(block)
            first += self.pulses_per_message

    def aperture_at(self, stamp_ns: int) -> int:
        """Number of the aperture that an image's stamp lies in."""
        return int((stamp_ns - START_NS) * 1e-9 * self.prf_hz // self.pulses_per_aperture)


def make_case(name: str) -> Case:
    """Pulses and parameters of a shipped configuration, or of a recording."""
    if name in (COUNTRYSIDE, DEFAULT):
        bag = ROOT / 'bags' / COUNTRYSIDE
        truth = bag_io.read_truth(bag)
        pulses = concatenate(list(bag_io.read_blocks(bag)))
        prf_hz = 1e9 / float(np.median(np.diff(pulses.stamp_ns)))
        if name == COUNTRYSIDE:
            parameters = pipeline_parameters(parameters_from_truth(truth))
            parameters[PIPELINE[0]].pop('max_age_s')  # as the nodes have it
            return Case(pulses, prf_hz, truth['pulses_per_aperture'], 24, parameters, ())
        path = find_config(name)
        node = read_configuration(path).nodes['backprojection']
        length = node['pulses_per_aperture']
        return Case(_longer(pulses, length), prf_hz, length, 32, {}, (path,))
    path = find_config(name)
    configuration = read_configuration(path)
    acquisition, imaging = configuration.acquisition(), configuration.imaging()
    length = imaging.pulses_per_aperture
    scenario = configured_scenario(name, acquisition, imaging)
    block = configuration.nodes['pulse_buffer']['pulses_per_block']
    return Case(concatenate(list(scenario.blocks(block))), acquisition.prf_hz, length, block, {},
                (path,))


def _longer(pulses: PulseBlock, n_pulses: int) -> PulseBlock:
    """So many pulses: the same again, each time further along the track."""
    index = np.arange(n_pulses)
    track = pulses.phase_centre_m
    step = (track[-1] - track[0]) * pulses.n_pulses / (pulses.n_pulses - 1)
    shift = (index // pulses.n_pulses)[:, None, None] * step
    longer = pulses.select(index % pulses.n_pulses)
    return dataclasses.replace(longer, counter=index.astype(np.uint32), tx_m=longer.tx_m + shift,
                               rx_m=longer.rx_m + shift)


class Watch:
    """The node's process, and an observer that feeds it; use it in a ``with`` statement."""

    def __init__(self, case: Case, folder: pathlib.Path, with_map: bool):
        self._case, self._stack = case, contextlib.ExitStack()
        self.ages: dict[int, float] = {}  # by aperture
        self.levels: list[tuple[float, str, str]] = []  # time, level, text; where they change
        self.counters: dict[str, float] = {}
        self.sent_s: dict[int, float] = {}  # last pulse of each aperture
        self.maps = 0
        self.nodes = self._stack.enter_context(NodeProcesses(
            case.parameters, folder, os.environ, nodes=PIPELINE, files=case.files))
        context = rclpy.Context()
        rclpy.init(args=list(NO_LOG_FILES), context=context)
        self._stack.callback(rclpy.try_shutdown, context=context)
        node = rclpy.create_node('late', context=context)
        self._executor = SingleThreadedExecutor(context=context)
        self._stack.callback(self._executor.shutdown)
        self._executor.add_node(node)
        self._publisher = node.create_publisher(Float32MultiArray, 'pulses', QoSProfile(depth=200))
        node.create_subscription(Image, 'image', self._on_image, 50)
        node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 50)
        if with_map:
            node.create_subscription(OccupancyGrid, 'obstacle_map', self._on_map, QoSProfile(
                depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))

    def __enter__(self) -> Watch:
        return self

    def __exit__(self, *exception) -> None:
        self._stack.close()

    def spin_until(self, due_s: float) -> None:
        """Receive until a time has come."""
        while (remaining := due_s - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=remaining)

    def wait_for_taker(self) -> None:
        """Wait until the node, or what prepares it, subscribes to the pulses."""
        deadline = time.monotonic() + PATIENCE_S
        while not self._publisher.get_subscription_count():
            self.nodes.check()
            if time.monotonic() > deadline:
                raise TimeoutError('nobody subscribes to the pulses')
            self._executor.spin_once(timeout_sec=0.02)

    def send(self, last: int, cdr: bytes) -> None:
        """Send a message whose last pulse has this counter."""
        self._executor.spin_once(timeout_sec=0)
        self._publisher.publish(cdr)
        self.sent_s.setdefault((last + 1) // self._case.pulses_per_aperture - 1, time.monotonic())

    def _on_image(self, message: Image) -> None:
        number = self._case.aperture_at(message.header.stamp.sec * 10**9
                                        + message.header.stamp.nanosec)
        self.ages[number] = time.monotonic() - self.sent_s.get(number, np.nan)

    def _on_map(self, message: OccupancyGrid) -> None:
        self.maps += 1

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            with contextlib.suppress(ValueError):  # texts
                for pair in status.values:
                    if pair.key in LEFT_OUT:
                        self.counters[pair.key] = float(pair.value)
            if status.name == 'sar_pipeline: stage':
                level = LEVELS[status.level]
                text = re.sub(r'\d+(\.\d+)?', '#', status.message)
                if not self.levels or self.levels[-1][1:] != (level, text):
                    self.levels.append((time.monotonic(), level, text))


def measure(name: str, with_map: bool) -> dict:
    """Feed a node through all phases; what came of it in each."""
    case = make_case(name)
    phases = {}
    with tempfile.TemporaryDirectory() as folder, Watch(
            case, pathlib.Path(folder), with_map) as watch:
        watch.wait_for_taker()
        messages, begun = case.messages(), time.monotonic()
        aperture_s = case.pulses_per_aperture / case.prf_hz
        sent_to = due = 0.0  # on the clock of the pulses, and on this machine's from the start
        for rate, phase in PHASES:
            until = sent_to + max(PHASE_S * rate, PHASE_APERTURES * aperture_s)
            first, started = int(sent_to // aperture_s), begun + due
            before = dict(watch.counters)
            while sent_to < until:
                time_s, last, cdr = next(messages)
                due += (time_s - sent_to) / rate
                sent_to = time_s
                watch.spin_until(begun + due)
                watch.send(last, cdr)
            phases[phase] = {'rate': rate, 'started': started, 'before': before,
                             'apertures': (first, int((sent_to + 0.5 / case.prf_hz)
                                                      // aperture_s))}
        watch.spin_until(time.monotonic() + 2.5)  # the last image and diagnostics
        watch.nodes.check()
        ends = [p['started'] for p in phases.values()][1:] + [time.monotonic()]
        afters = [p['before'] for p in phases.values()][1:] + [watch.counters]
        return {'aperture_s': round(aperture_s, 3), 'load': round(os.getloadavg()[0], 1),
                'maps': watch.maps, 'phases': {
            phase: describe(watch, values, end, after, aperture_s)
            for (phase, values), end, after in zip(phases.items(), ends, afters, strict=True)}}


def describe(watch: Watch, phase: dict, end: float, after: dict, aperture_s: float) -> dict:
    """Ages, apertures left out and levels of a phase; seconds from its beginning."""
    first, last = phase['apertures']
    ages = {n: age for n, age in watch.ages.items() if first <= n < last}
    figures = np.array(list(ages.values()))
    started = phase['started']
    before = [text for text in watch.levels if text[0] < started][-1:]
    levels = [(round(max(t - started, 0.0), 1), level, text) for t, level, text in (
        *before, *(text for text in watch.levels if started <= text[0] < end))]
    result = {'rate': phase['rate'], 'apertures': last - first, 'images': len(ages),
              'age_s': dict(zip(('p50', 'p99', 'max'), np.percentile(
                  figures, [50, 99, 100]).round(3).tolist(), strict=True)) if ages else {},
              'counted': {k: int(after.get(k, 0) - phase['before'].get(k, 0)) for k in LEFT_OUT
                          if after.get(k, 0) > phase['before'].get(k, 0)},
              'levels': levels}
    young = next((n for n in sorted(ages) if all(
        age < 0.3 for other, age in ages.items() if other >= n)), None)
    if young is not None:
        result['below_0.3_s_after_apertures'] = young - first
    warned = next((t for t, level, _ in levels if level != 'OK'), None)
    if warned is not None:
        result['warned_after_apertures'] = round(warned * phase['rate'] / aperture_s, 2)
    return result


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--cases', nargs='+', choices=CASES, default=CASES)
    parser.add_argument('--map', nargs='+', choices=('no', 'yes'), default=('no', 'yes'),
                        help='with a subscriber of the obstacle map or without')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends the nodes, too
    os.environ.update(isolated_environment())
    results = (json.loads(arguments.output.read_text()) if arguments.output.exists() else {})
    for name in arguments.cases:
        for with_map in arguments.map:
            key = f'{name}, {"with" if with_map == "yes" else "without"} map'
            results[key] = measure(name, with_map == 'yes')
            results['machine'] = machine()
            arguments.output.write_text(json.dumps(results, indent=1) + '\n')
            print(key, json.dumps(results[key], indent=1), flush=True)


if __name__ == '__main__':
    main()
