"""Campaign of the doctor: faults injected into random recordings; which are named, and which not?

Run from the repository root: ``make doctor-campaign``, or ``python -m benchmarks.doctor``. Every
case follows from its seed and is written down at once, so that a campaign that was stopped goes
on where it was. Writes benchmarks/results/doctor.json and prints the table of
docs/troubleshooting.md.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import json
import pathlib
import time
from collections import Counter
from collections.abc import Callable

import numpy as np
from tqdm import tqdm

from sar_imaging.diagnosis.doctor import examine

from .support.doctor_cases import KINDS, Case, measured_cases, right_case, turning
from .support.doctor_faults import FAULTS, OF_IMAGES, NotApplicable
from .support.machine import machine

RESULTS = pathlib.Path(__file__).parent / 'results' / 'doctor.json'
RECORDS = pathlib.Path('out/doctor_campaign.jsonl')
RIGHT = 'none'
PARTS = ('simulated', 'measured')
_WITH_IMAGE = 2  # cases in which the image is looked at for faults of signals, too
_MEASURED_DRAWS = 2  # of each fault in each measured recording
_MOST_SEEDS = 4  # for each case that a fault needs; not all radars can have all faults


def judged(make: Callable[[], Case], seed: int, fault: str, *, image: bool) -> dict:
    """What is found in a recording with a fault, or in one without."""
    case = make()
    if image and case.attitude is None:
        case = dataclasses.replace(case, attitude=turning(case.kind, seed, case.block.n_pulses))
    numbers = case.block.counter
    entry = {'recording': case.kind, 'seed': seed, 'fault': fault, 'image': image}
    if fault != RIGHT:
        try:
            case = FAULTS[fault][0](case, np.random.default_rng([seed, 7]))
        except NotApplicable:
            return entry | {'found': None}
    began = time.process_time()
    with_attitude = fault == RIGHT or fault in OF_IMAGES
    attitude = case.attitude[np.isin(numbers, case.block.counter)] if with_attitude else None
    examination = examine(case.block, case.grid if image else None, window=case.window,
                          attitude=attitude)
    diagnosis = examination.diagnosis
    return entry | {
        'found': sorted({finding.fault for finding in examination.findings}),
        'focus': None if diagnosis is None else round(diagnosis.coherence, 2),
        'seconds': round(time.process_time() - began, 2)}


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


def measured(records: Records, faults, first: int) -> None:
    """Each fault in each measured recording that can have it, and these as they are."""
    for case in measured_cases():
        for fault in tqdm(faults, desc=case.kind, unit='fault'):
            image = fault in OF_IMAGES or fault == RIGHT
            for seed in range(first, first + (1 if fault == RIGHT else _MEASURED_DRAWS)):
                records.measure(lambda case=case: case, case.kind, seed, fault, image=image)


def tallied(entries, *, real: bool) -> dict:
    """Results by fault."""
    entries = [e for e in entries
               if e['found'] is not None and (e['recording'] not in KINDS) == real]
    right = [e for e in entries if e['fault'] == RIGHT]
    faults = {}
    for name, (_, wanted) in FAULTS.items():
        rows = [e for e in entries if e['fault'] == name]
        missed = [e for e in rows if not set(e['found']) & set(wanted)]
        faults[name] = {
            'first_seed': min((e['seed'] for e in rows), default=0),
            'injected': len(rows), 'named': len(rows) - len(missed),
            'missed': [[e['recording'], e['seed'], e['found']] for e in missed],
            'other_findings': Counter(
                f for e in rows for f in e['found'] if f not in wanted).most_common()}
    return {'right': len(right),
            'right_with_a_finding': [[e['recording'], e['seed'], e['found']]
                                     for e in right if e['found']],
            'faults': faults}


def merged(part: str, tally: dict) -> dict:
    """Results of a part; of what this campaign has no case of, those of the one before."""
    if not RESULTS.exists():
        return tally
    before = json.loads(RESULTS.read_text())[part]
    faults = {name: row if row['injected'] else before['faults'].get(name, row)
              for name, row in tally['faults'].items()}
    return (tally if tally['right'] else before) | {'faults': faults}


def main() -> None:
    """Run the campaign and write its results."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--cases', type=int, default=100, help='of each fault')
    parser.add_argument('--first', type=int, default=5000, help='seed of the first case')
    parser.add_argument('--only', nargs='+', choices=[RIGHT, *FAULTS], metavar='FAULT',
                        default=[RIGHT, *FAULTS])
    parser.add_argument('--part', choices=['simulated', 'measured', 'none'],
                        help='default: both; none tallies what there is')
    arguments = parser.parse_args()
    records = Records(RECORDS)
    if arguments.part in (None, 'simulated'):
        simulated(records, arguments.only, arguments.first, arguments.cases)
    if arguments.part in (None, 'measured'):
        measured(records, arguments.only, arguments.first)
    results = {'machine': machine()} | {
        part: merged(part, tallied(records.entries.values(), real=part == 'measured'))
        for part in PARTS}
    RESULTS.write_text(json.dumps(results, indent=1) + '\n')
    for name in FAULTS:
        cells = [results[part]['faults'][name] for part in PARTS]
        others = ', '.join(f'{other} ({n})' for cell in cells
                           for other, n in cell['other_findings'])
        print('| ' + ' | '.join([name, *(f'{c["named"]} of {c["injected"]}' if c['injected']
                                        else '–' for c in cells), others or '–']) + ' |')
    for part in PARTS:
        false = results[part]['right_with_a_finding']
        print(f'{part} recordings without fault, with a finding: {len(false)} of '
              f'{results[part]["right"]} {false or ""}')


if __name__ == '__main__':
    main()
