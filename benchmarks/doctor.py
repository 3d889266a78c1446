# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Campaign of the doctor: faults injected into random recordings; which are named, and which not?

Run from the repository root: ``make doctor-campaign``, or ``python -m benchmarks.doctor``. Every
case follows from its seed and is written down at once, so that a campaign that was stopped goes
on where it was. Writes benchmarks/results/doctor.json and prints the tables of
docs/troubleshooting.md.

Of each case with a fault, the image is compared with that of the right recording: a fault is to be
named where it costs more than a decibel of contrast, or displaces the brightest scatterer by more
than a cell.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import json
import math
import pathlib
import time
from collections import Counter
from collections.abc import Callable

import numpy as np
from tqdm import tqdm

from sar_imaging.diagnosis.coherence import CoherenceProbe, profiles_of, resolved
from sar_imaging.diagnosis.diagnose import diagnose
from sar_imaging.diagnosis.doctor import examine
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.quality.measures import focus_figure

from .support.doctor_cases import KINDS, Case, measured_cases, right_case, turning
from .support.doctor_families import FAMILIES, family_case
from .support.doctor_faults import FAULTS, OF_IMAGES, NotApplicable
from .support.machine import machine

RESULTS = pathlib.Path(__file__).parent / 'results' / 'doctor.json'
RECORDS = pathlib.Path('out/doctor_campaign.jsonl')
RIGHT = 'none'
PARTS = ('simulated', 'families', 'measured')
NAMED, UNTOLD, MISSED, ACCUSED, WELL = 'named', 'could not tell', 'missed', 'accused', 'right'
_WITH_IMAGE = 2  # cases in which the image is looked at for faults of signals, too
_MEASURED_DRAWS = 1  # of each fault in each measured recording
_MOST_SEEDS = 4  # for each case that a fault needs; not all radars can have all faults
_WORSE_DB = 1.0  # of contrast, from which an image is measurably worse
_SIZE = 1 / 3  # of a size, by which it may be wrong
_MOST_PIXELS = 40_000_000  # times pulses, of the images that are compared
_CLOCK = 'clock offset'
_BY_NATURE = {'ground': {'coupling'}}  # the direct wave of its antennas is stronger than echoes


def judged(make: Callable[[], Case], seed: int, fault: str, *, image: bool) -> dict:
    """What is found in a recording with a fault, or in one without."""
    right = make()
    if image and right.attitude is None and right.kind not in FAMILIES:
        right = dataclasses.replace(right, attitude=turning(right.kind, seed,
                                                            right.block.n_pulses))
    case, entry = right, {'recording': right.kind, 'seed': seed, 'fault': fault,
                          'with_image': image}
    if fault != RIGHT:
        try:
            if fault in _BY_NATURE.get(case.kind, ()):
                raise NotApplicable
            case = FAULTS[fault][0](case, np.random.default_rng([seed, 7]))
        except NotApplicable:
            return entry | {'found': None}
    began = time.process_time()
    with_attitude = right.attitude is not None and (fault == RIGHT or fault in OF_IMAGES)
    attitude = right.attitude[np.isin(right.block.counter, case.block.counter)
                              ] if with_attitude else None
    examination = examine(case.block, case.grid if image else None, window=case.window,
                          attitude=attitude)
    diagnosis = examination.diagnosis
    found = {f.fault: f for f in examination.findings
             if f.fault not in _BY_NATURE.get(case.kind, ())}
    entry |= {
        'found': sorted(found), 'untold': list(examination.untold) if image else [],
        'alternatives': list(diagnosis.alternatives) if diagnosis is not None else [],
        'undecided': [] if diagnosis is None else list(diagnosis.undecided),
        'focus': None if diagnosis is None else round(diagnosis.coherence, 2),
        'seconds': round(time.process_time() - began, 2)}
    if right.kind not in KINDS and right.kind not in FAMILIES:
        entry |= _other_commands(case)
    if fault in OF_IMAGES:
        worse_db, moved_cells = severity(right, case)
        named = [f for name, f in found.items() if name in FAULTS[fault][1] and f.sizes]
        entry |= {'worse_db': round(worse_db, 1), 'moved_cells': round(moved_cells, 1),
                  'size_off': round(_size_off(fault, case.sizes, named[0].sizes), 3)
                  if case.sizes and named else None}
    return entry


def _other_commands(case: Case) -> dict:
    """What `image` and `evaluate` say of a recording, by the functions that they ask."""
    try:
        live = diagnose(case.block, case.grid, window=case.window)
        at_noise = focus_figure(_image(case)[1]).at_noise_level
    except ValueError as error:
        return {'image': 'refused', 'evaluate': f'refused: {str(error)[:60]}'}
    return {'image': 'at noise level' if at_noise else '-',
            'evaluate': live.mistake or ('at noise level' if at_noise else '-')}


def _size_off(fault: str, true: tuple[float, ...], told: tuple[float, ...]) -> float:
    """Error of a size that was told over the true one; of an arm, along what was told of it."""
    true, told = np.array(true), np.array(told)
    if len(true) == 3:  # the turns tell some directions of an arm
        return abs(float(true @ told) / max(float(told @ told), 1e-9) - 1)
    nothing = 0.0 if fault == _CLOCK else 1.0  # rates and factors
    return abs(float((told[0] - nothing) / (true[0] - nothing)) - 1)


def severity(right: Case, wrong: Case) -> tuple[float, float]:
    """Loss of the image's contrast, decibels, and way of its brightest pixel, in cells.

    Of the same pulses: where a fault leaves out some, those are no part of its harm.
    """
    kept = np.isin(right.block.counter, wrong.block.counter)
    right = dataclasses.replace(right, block=right.block.select(kept))
    (points, before), (places, after) = (
        (places, np.square(np.abs(image), dtype=float)) for places, image in
        map(_image, (right, wrong)))
    contrasts = [float(image.std() / max(image.mean(), 1e-300)) for image in (before, after)]
    grid = resolved(right.grid, right.block)
    way = np.linalg.norm(points[before.argmax()] - places[after.argmax()])
    return (10 * math.log10(contrasts[0] / max(contrasts[1], 1e-9)),
            float(way) / max(right.block.radar.range_resolution_m, 2 * grid.spacing_m))


def _image(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (K, 3) and image (K,) of a case; 0 where it cannot be compressed."""
    try:
        profiles = profiles_of(case.block, case.window)
    except ValueError:
        return case.grid.points().reshape(-1, 3), np.zeros(case.grid.n_x * case.grid.n_y)
    grid = resolved(case.grid, case.block)
    rows = min(1024, case.block.n_pulses * case.block.n_channels)
    coarser = math.sqrt(max(1.0, grid.n_x * grid.n_y * rows / _MOST_PIXELS))
    grid = MapGrid(grid.centre_m, int(grid.n_x / coarser), int(grid.n_y / coarser),
                   coarser * grid.spacing_m)
    probe = CoherenceProbe(grid, 2 * _MOST_PIXELS).fixed(profiles)
    return probe.points, probe.sums(profiles)


def outcome(entry: dict) -> str:
    """How an entry counts."""
    if entry['fault'] == RIGHT:
        return ACCUSED if entry['found'] else UNTOLD if entry['untold'] else WELL
    wanted = FAULTS[entry['fault']][1]
    if {*entry['found'], *entry.get('alternatives', ())} & set(wanted):
        return NAMED  # alone, or as one of several mistakes that explain the image as well
    if entry['found']:
        return MISSED
    return UNTOLD if entry['untold'] or set(entry['undecided']) & set(wanted) else MISSED


def worse(entry: dict) -> bool:
    """Whether a fault is to be named: it shows in the samples, or the image is worse by it."""
    return (entry['fault'] not in OF_IMAGES or entry['worse_db'] > _WORSE_DB
            or entry['moved_cells'] > 1)


class Records:
    """Entries of a campaign, kept in a file."""

    def __init__(self, path: pathlib.Path):
        self._path = path
        lines = path.read_text().splitlines() if path.exists() else []
        self.entries = {self._key(entry): entry for entry in map(json.loads, lines)}

    @staticmethod
    def _key(entry: dict):
        return entry['recording'] in KINDS or entry['recording'], entry['seed'], entry['fault']

    def measure(self, make: Callable[[], Case], kind: str, seed: int, fault: str, *,
                image: bool) -> dict:
        """The entry of a case: the one that is kept, or a new one."""
        key = kind in KINDS or kind, seed, fault
        if key not in self.entries:
            entry = judged(make, seed, fault, image=image)
            self.entries[key] = entry
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with self._path.open('a') as file:
                file.write(json.dumps(entry) + '\n')
        return self.entries[key]


def simulated(records: Records, faults, first: int, n: int) -> None:
    """As many cases of each fault as are asked for, all faults in the same recordings."""
    injected = Counter()
    for seed in tqdm(range(first, first + _MOST_SEEDS * n), unit='recording'):
        wanted = [fault for fault in faults if injected[fault] < n]
        if not wanted:
            break
        make = functools.cache(functools.partial(right_case, seed))
        for fault in wanted:
            image = fault in OF_IMAGES or fault == RIGHT or injected[fault] < _WITH_IMAGE
            entry = records.measure(make, KINDS[seed % len(KINDS)], seed, fault, image=image)
            injected[fault] += entry['found'] is not None


def families(records: Records, faults, first: int, n: int) -> None:
    """Each fault in so many recordings of each family."""
    for seed in tqdm(range(first, first + n), unit='recording of each family'):
        for name in FAMILIES:
            make = functools.cache(functools.partial(family_case, name, seed))
            for fault in faults:
                records.measure(make, name, seed, fault,
                                image=fault in OF_IMAGES or fault == RIGHT)


def measured(records: Records, faults, first: int) -> None:
    """Each fault in each measured recording that can have it, and these as they are."""
    for case in measured_cases():
        for fault in tqdm(faults, desc=case.kind, unit='fault'):
            image = fault in OF_IMAGES or fault == RIGHT
            for seed in range(first, first + (1 if fault == RIGHT else _MEASURED_DRAWS)):
                records.measure(lambda case=case: case, case.kind, seed, fault, image=image)


def part_of(entry: dict) -> str:
    """The part of the campaign that an entry is of."""
    return ('simulated' if entry['recording'] in KINDS else
            'families' if entry['recording'] in FAMILIES else 'measured')


def tallied(entries, key: Callable[[dict], str]) -> dict:
    """Results by fault, or by whatever `key` says, of entries."""
    out: dict[str, dict] = {}
    for entry in entries:
        if entry['found'] is None:
            continue
        row = out.setdefault(key(entry), {
            'first_seed': entry['seed'], 'right': Counter(), 'worse': Counter(),
            'as_sharp': Counter(), 'as_good': Counter(), 'sizes': 0, 'sizes_wrong': 0,
            'cases': []})
        row['first_seed'] = min(row['first_seed'], entry['seed'])
        kind = outcome(entry)
        row['right' if entry['fault'] == RIGHT else
            'worse' if worse(entry) else 'as_good'][kind] += 1
        if worse(entry) and entry.get('worse_db', math.inf) <= _WORSE_DB:
            row['as_sharp'][kind] += 1  # of the worse: displaced, and as much in focus
        if entry.get('size_off') is not None:
            row['sizes'] += 1
            row['sizes_wrong'] += entry['size_off'] > _SIZE
        if kind in (MISSED, ACCUSED) and (kind == ACCUSED or worse(entry)):
            row['cases'].append([entry['recording'], entry['seed'], entry['fault'],
                                 entry['found']])
    return out


def _table(title: str, rows: dict) -> None:
    print(f'\n| {title} | named | could not tell | missed, or another named | of all these'
          ' displaced, but as sharp: named, could not tell, missed | as good: named, could not'
          ' tell, not named | sizes right | right recordings: accused, could not tell, '
          'nothing wrong |\n|' + 8 * '---|')
    for name, row in rows.items():
        w, s, g, r = (row[key] for key in ('worse', 'as_sharp', 'as_good', 'right'))
        total = sum(w.values())
        print(f'| {name} | {w[NAMED]} of {total} | {w[UNTOLD]} | {w[MISSED]} | '
              f'{s[NAMED]}, {s[UNTOLD]}, {s[MISSED]} | {g[NAMED]}, {g[UNTOLD]}, {g[MISSED]} | '
              f'{row["sizes"] - row["sizes_wrong"]} of {row["sizes"]} | '
              f'{r[ACCUSED]}, {r[UNTOLD]}, {r[WELL]} |')


def _commands_table(entries: list[dict]) -> None:
    """What three commands say of the measured recordings, with and without each fault."""
    print('\n| recording | fault | contrast lost, moved by | `doctor` | `image` | `evaluate` |\n|'
          + 6 * '---|')
    for e in entries:
        if e['found'] is None:
            continue
        loss = (f'{e["worse_db"]:.1f} dB, {e["moved_cells"]:.0f} cells' if 'worse_db' in e
                else '–')
        said = ', '.join(e['found']) or '; '.join(
            [*e['untold'], *(f'cannot tell {name}' for name in e['undecided'])]) or '–'
        others = (e.get(command, 'not run') for command in ('image', 'evaluate'))
        print('| ' + ' | '.join([e['recording'], e['fault'], loss, said, *others]) + ' |')


def main() -> None:
    """Run the campaign and write its results."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--cases', type=int, default=100, help='of each fault')
    parser.add_argument('--first', type=int, default=5000, help='seed of the first case')
    parser.add_argument('--only', nargs='+', choices=[RIGHT, *FAULTS], metavar='FAULT',
                        default=[RIGHT, *FAULTS])
    parser.add_argument('--part', choices=[*PARTS, 'none'],
                        help='default: all; none tallies what there is')
    parser.add_argument('--records', type=pathlib.Path, default=RECORDS,
                        help='where cases are written down (default: %(default)s)')
    arguments = parser.parse_args()
    records = Records(arguments.records)
    if arguments.part in (None, 'simulated'):
        simulated(records, arguments.only, arguments.first, arguments.cases)
    if arguments.part in (None, 'families'):
        families(records, arguments.only, arguments.first, max(1, arguments.cases // 10))
    if arguments.part in (None, 'measured'):
        measured(records, arguments.only, arguments.first)
    by_part = {part: [e for e in records.entries.values() if part_of(e) == part]
               for part in PARTS}
    results = {'machine': machine()} | {
        part: {'by_fault': tallied(entries, lambda e: e['fault']),
               'by_recording': tallied(entries, lambda e: e['recording'])}
        for part, entries in by_part.items()}
    RESULTS.write_text(json.dumps(results, indent=1) + '\n')
    for part in PARTS:
        for by in ('by_fault', 'by_recording'):
            _table(f'{part}, {by.replace("_", " ")}', results[part][by])
    _commands_table(by_part['measured'])


if __name__ == '__main__':
    main()
