# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings with a wrong clock through real node processes over DDS, with and without autofocus.

Run from the repository root::

    python -m benchmarks.autofocus_nodes ../shared/data

Pass A of the team 5 rail, the team 6 rail and random drone flights, each as a bag of raw pulses
and odometry whose clock is wrong; through `sar_pipeline` and through separate nodes in turn. The
contrast of the image that came is compared with that of an image with the right offset; of the
rails that is the sharpest of offsets around the one that came with the data.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import pathlib
import re
import tempfile

import numpy as np
from tqdm import tqdm

from benchmarks.support.drone_flights import MOTIONS, RADARS, drone_flight
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.poses import PoseTable
from sar_imaging.quality import contrast
from sar_imaging.recordings import bag_io, load
from sar_imaging.recordings.bag_io import split
from sar_imaging.recordings.truth import make_truth
from sar_imaging.signal.positioning import locate
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.tools import evaluate
from sar_imaging.tools.node_processes import (
    NodeProcesses,
    isolated_environment,
    node_names,
    parameters_from_truth,
    pipeline_parameters,
)

from .autofocus_flights import FOCUSED
from .support.machine import machine
from .support.references import exact_image

RESULTS = pathlib.Path(__file__).parent / 'results' / 'autofocus_nodes.json'
RAILS = (('bwsi2019_team5_rail', (-2.0, -1.0, -0.3, 0.1, 1.0, 2.0)),
         ('bwsi2019_team6_rail', (-1.0, 0.3)))
FLIGHTS, FIRST_SEED = 12, 70_000
EXPECTED_S = 2.0
AROUND_S = np.arange(-0.06, 0.061, 0.02)  # of a rail's offset, where the sharpest image is


@dataclasses.dataclass(frozen=True)
class Case:
    """A recording and its right alignment."""

    name: str
    block: PulseBlock
    poses: PoseTable
    alignments: list
    grid: MapGrid
    offset_s: float


def cases(data: pathlib.Path):
    """All of them, one after the other."""
    for folder, offsets in RAILS:
        name = folder.split('_', 1)[1]
        rail = load(name if name == 'team5_rail' else 'team6_rail_fitted', data / folder)
        found = rail.alignment
        around = [dataclasses.replace(found, time_offset_s=found.time_offset_s + step)
                  for step in AROUND_S]
        for offset_s in offsets:
            yield Case(folder, rail.block, rail.poses, around, rail.scene.grid, offset_s)
    for k in range(FLIGHTS):
        flight = drone_flight(FIRST_SEED + k, motion=MOTIONS[k % 2], radar_kind=RADARS[k // 2 % 2])
        poses = PoseTable(flight.stamp_ns, flight.position_m, flight.quaternion)
        offset_s = float(np.random.default_rng(k).uniform(-2.0, 2.0))
        yield Case(f'flight {FIRST_SEED + k}, {flight.radar_kind}, {flight.motion}, '
                   f'{flight.angle_deg:.0f} degrees', flight.block, poses, [flight.alignment],
                   flight.grid, offset_s)


def true_contrast(case: Case) -> tuple[float, object]:
    """Contrast with the right alignment, and this alignment."""
    track, out = case.poses.track(), []
    for alignment in case.alignments:
        located = locate(case.block, track, alignment)
        profiles = RangeCompressor.for_block(located)(located)
        image = exact_image(case.grid, profiles)
        out.append((contrast(image), alignment))
    return max(out, key=lambda pair: pair[0])


def through_nodes(case: Case, alignment, folder: pathlib.Path, *, pipeline: bool,
                  expected_s: float) -> tuple[np.ndarray, str]:
    """Image and log of the nodes that image a bag."""
    truth = make_truth(
        scenario='autofocus', description=case.name, scatterers=[], grid=case.grid,
        pulses_per_aperture=case.block.n_pulses, n_pulses=case.block.n_pulses, n_channels=1,
        cut_half_width_m=(1.0, 1.0), radar=case.block.radar, compressed=False,
        alignment=alignment)
    bag = folder / 'bag'
    bag_io.write_bag(bag, split(case.block), truth, poses=case.poses)
    parameters = parameters_from_truth(truth)
    # a busy machine may pause within an aperture
    parameters['backprojection'] |= {'autofocus.time_offset': expected_s,
                                     'aperture_timeout_s': 300.0}
    environment = isolated_environment({k: v for k, v in os.environ.items()
                                        if k != 'ROS_DOMAIN_ID'})
    os.environ.update(environment)
    arguments = [str(bag), '--output', str(folder / 'out'), '--timeout', '600']
    with NodeProcesses(pipeline_parameters(parameters) if pipeline else parameters,
                       folder / 'log', environment,
                       nodes=node_names('image', pipeline=pipeline)) as nodes:
        if evaluate.main(arguments + ['--pipeline'] * pipeline):
            raise RuntimeError(f'no image of {case.name}; see the lines above')
        log = nodes.log_file('sar_pipeline' if pipeline else 'backprojection').read_text()
    return np.load(folder / 'out' / 'image.npy'), log


def measure(case: Case, *, pipeline: bool) -> dict:
    """One recording: what the nodes publish and say."""
    wanted, right = true_contrast(case)
    wrong = dataclasses.replace(right, time_offset_s=right.time_offset_s + case.offset_s)
    with tempfile.TemporaryDirectory() as folder:
        image, log = through_nodes(case, wrong, pathlib.Path(folder), pipeline=pipeline,
                                   expected_s=EXPECTED_S)
    [line] = re.findall('image of aperture 0: .*', log)
    before = float(re.search(r'contrast ([\d.]+) -> ', line)[1])
    relative = contrast(image) / wanted
    claimed = 'focused by autofocus' in line or 'focused already' in line
    row = {'name': case.name, 'nodes': 'sar_pipeline' if pipeline else 'separate',
           'offset_s': round(case.offset_s, 3), 'contrast_true': round(wanted, 2),
           'contrast_relative': [round(before / wanted, 3), round(relative, 3)],
           'focused': bool(relative >= FOCUSED), 'claimed': claimed,
           'falsely_claimed': bool(claimed and relative < FOCUSED),
           'worse': bool(relative < 0.99 * before / wanted), 'log': line}
    tqdm.write(json.dumps(row))
    return row


def main() -> None:
    """Measure and write the results, which grow case by case."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n', 1)[0])
    parser.add_argument('data', type=pathlib.Path, help='folder with the rail recordings')
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    results = {'machine': machine(), 'summary': {}, 'cases': []}
    for k, case in enumerate(cases(arguments.data)):
        results['cases'].append(measure(case, pipeline=k % 2 == 0))
        results['summary'] = {'cases': k + 1} | {
            key: sum(row[key] for row in results['cases'])
            for key in ('focused', 'claimed', 'falsely_claimed', 'worse')}
        arguments.output.write_text(json.dumps(results, indent=1) + '\n')


if __name__ == '__main__':
    main()
