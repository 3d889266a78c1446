"""Campaign of the doctor: faults injected into random recordings; which are named, and which not?

Run from the repository root: ``make doctor-campaign``, or ``python -m benchmarks.doctor``.
Writes benchmarks/results/doctor.json and prints the table of docs/troubleshooting.md.
"""

from __future__ import annotations

import argparse
import json
import pathlib
from collections import Counter

import numpy as np
from tqdm import tqdm

from sar_imaging.diagnosis.doctor import examine

from .support.doctor_cases import FAULTS, Case, NotApplicable, right_case
from .support.machine import machine

RESULTS = pathlib.Path(__file__).parent / 'results' / 'doctor.json'


def names_of(case: Case) -> set[str]:
    """Faults that are found in a case."""
    return {finding.fault for finding in examine(case.block, case.grid).findings}


def run(first: int, n: int) -> dict:
    """Results of cases with n seeds each."""
    injected, named, false = Counter(), Counter(), Counter()
    missed: dict[str, list[int]] = {name: [] for name in FAULTS}
    for seed in tqdm(range(first, first + n), unit='case'):
        case = right_case(seed)
        false.update(names_of(case) or {'none'})
        for name, (inject, wanted) in FAULTS.items():
            try:
                faulty = inject(case, np.random.default_rng([seed, 7]))
            except NotApplicable:
                continue
            injected[name] += 1
            if names_of(faulty) & set(wanted):
                named[name] += 1
            else:
                missed[name].append(seed)
    return {'first_seed': first, 'right_recordings': n,
            'right_recordings_with_a_finding': n - false['none'],
            'false_findings': {k: v for k, v in false.items() if k != 'none'},
            'faults': {name: {'injected': injected[name], 'named': named[name],
                              'missed_seeds': missed[name]} for name in FAULTS}}


def main() -> None:
    """Run the campaign and write its results."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--cases', type=int, default=100)
    parser.add_argument('--first', type=int, default=1000, help='seed of the first case')
    arguments = parser.parse_args()
    results = {'machine': machine(), **run(arguments.first, arguments.cases)}
    RESULTS.write_text(json.dumps(results, indent=2) + '\n')
    for name, row in results['faults'].items():
        print(f'| {name} | {row["named"]} of {row["injected"]} |')
    print(f'right recordings with a finding: {results["right_recordings_with_a_finding"]} of '
          f'{results["right_recordings"]} {results["false_findings"] or ""}')


if __name__ == '__main__':
    main()
