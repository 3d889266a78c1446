# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""How many random mistakes in the code the tests notice.

Draws single changes of the source (`mutation.sample`), makes each in a copy of the tree and runs
the tests that execute the line (`mutation.tests`), the cheapest first, until one fails. Results
are written as they come; a campaign that was stopped goes on. Run it by `make mutation-campaign`.

    python -m benchmarks.mutations measure          which test executes which line, once
    python -m benchmarks.mutations run              draw, change, test
    python -m benchmarks.mutations again            survivors once more, after new tests
    python -m benchmarks.mutations judge KEY ...    note why a survivor cannot or need not die
    python -m benchmarks.mutations report           the table
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import datetime
import filecmp
import json
import os
import pathlib
import random
import shutil
import subprocess
import sys
import time

from .mutation.runs import Runner
from .mutation.sample import Mutation, draw
from .mutation.tests import PACKAGES, Tests
from .support.machine import machine

ROOT = pathlib.Path(__file__).resolve().parents[1]
RESULTS = pathlib.Path(__file__).with_name('results') / 'mutations.json'
WORK = ROOT / 'build' / 'mutation' / 'work'
FOLDERS = ('signal', 'geometry', 'autofocus', 'exploitation', 'quality', 'configuration',
           'simulation', 'diagnosis', 'msg_conversions', 'planning', 'backends', 'imaging',
           'streaming', 'nodes', 'formats', 'recordings', 'radiometry', 'archive', 'tools')
# Tests that start processes are measured one by one: processes know no test, but a variable.
IN_PROCESS = ('msg_conversions', 'geometry', 'signal', 'configuration', 'quality', 'simulation',
              'exploitation', 'autofocus', 'diagnosis', 'planning', 'backends', 'imaging',
              'streaming', 'formats', 'recordings', 'radiometry', 'archive', 'tools')
IN_PROCESSES = ('nodes',)
NOT_MEASURED = ('fault_campaign', 'two_hosts')  # minutes, or a network of its own
# One thread each: what threads share is not tried.
THREADS = dict.fromkeys(('NUMBA_NUM_THREADS', 'OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'), '1')
EQUIVALENT, SURVIVED, UNKNOWN = 'equivalent', 'survived', 'unknown'


def main() -> None:
    arguments = _arguments()
    work = arguments.work.resolve()
    if arguments.command == 'measure':
        measure(work, arguments.tests)
    elif arguments.command == 'run':
        run(work, arguments)
    elif arguments.command == 'again':
        again(work, arguments)
    elif arguments.command == 'judge':
        judge(arguments.results, arguments.key, arguments.verdict, arguments.reason)
    print(table(json.loads(arguments.results.read_text())['mutations'])
          if arguments.results.exists() else 'no results yet')


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--results', type=pathlib.Path, default=RESULTS)
    parser.add_argument('--work', type=pathlib.Path, default=WORK, help='where copies are made')
    commands = parser.add_subparsers(dest='command', required=True)
    measuring = commands.add_parser('measure')
    measuring.add_argument('tests', nargs='*', help='files of tests; all when none is named')
    for name in ('run', 'again'):
        running = commands.add_parser(name)
        running.add_argument('--budget-s', type=float, default=25.0,
                             help='tests of one change may take so long together')
        if name == 'run':
            running.add_argument('--count', type=int, default=310)
            running.add_argument('--seed', type=int, default=1)
            running.add_argument('--folders', nargs='+', default=FOLDERS)
    judging = commands.add_parser('judge')
    judging.add_argument('key', help='file: before -> after, or a part that only one has')
    judging.add_argument('verdict', choices=[EQUIVALENT, SURVIVED])
    judging.add_argument('reason')
    commands.add_parser('report')
    return parser.parse_args()


def copy_tree(work: pathlib.Path) -> pathlib.Path:
    """Copy of the tracked files as they are now; unchanged ones keep their compiled code."""
    tree = work / 'tree'
    listed = subprocess.run(['git', 'ls-files', '-co', '--exclude-standard'], cwd=ROOT,
                            check=True, capture_output=True, text=True).stdout.split('\n')
    files = {f for f in listed if f and (ROOT / f).is_file()}
    code = False
    for file in sorted(files):
        target = tree / file
        if not target.exists() or not filecmp.cmp(ROOT / file, target, shallow=False):
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / file, target)
            code |= file.startswith(PACKAGES)
    for folder in (*PACKAGES, 'test'):
        for path in (tree / folder).rglob('*.py'):
            if path.relative_to(tree).as_posix() not in files:
                path.unlink()
    if code:  # kernels that inline functions of other files would not notice
        for path in (tree / 'sar_imaging').rglob('*.nb[ci]'):
            path.unlink()
    if not (work / 'shared').exists() and (ROOT.parent / 'shared').exists():
        (work / 'shared').symlink_to((ROOT.parent / 'shared').resolve())
    return tree


def measure(work: pathlib.Path, files: list[str]) -> None:
    """Run tests once under `coverage`; what is known of other tests is kept."""
    tree = copy_tree(work)
    (work / 'measure.ini').write_text(
        f'[run]\nsource = {",".join(PACKAGES)}\ndata_file = {work}/coverage\nparallel = true\n'
        'patch = subprocess\ncontext = ${MUTATION_TEST-}\n')
    files = files or [f'test/{name}' for name in (*IN_PROCESS, *IN_PROCESSES)]
    alone = [f for f in files if f.startswith(tuple(f'test/{n}' for n in IN_PROCESSES))]
    if together := [f for f in files if f not in alone]:
        _measured_run(work, together, {})
    if alone:
        listed = subprocess.run(
            [sys.executable, '-m', 'pytest', '-o', 'addopts=--import-mode=importlib', '-q',
             '--collect-only', '-m', 'not campaign', '-p', 'no:cacheprovider', *alone], cwd=tree,
            check=True, capture_output=True, text=True).stdout.split('\n')
        for test in listed:
            if '::' in test and not any(name in test for name in NOT_MEASURED):
                _measured_run(work, [test], {'MUTATION_TEST': test})
    subprocess.run([sys.executable, '-m', 'coverage', 'combine', '--append', '--quiet',
                    f'--rcfile={work}/measure.ini'], cwd=tree, check=True)


def _measured_run(work: pathlib.Path, tests: list[str], environment: dict[str, str]) -> None:
    subprocess.run(
        [sys.executable, '-m', 'coverage', 'run', f'--rcfile={work}/measure.ini', '-m', 'pytest',
         '-p', 'benchmarks.mutation.plugin', '-p', 'no:cacheprovider', *tests], cwd=work / 'tree',
        env=os.environ | THREADS | {'MUTATION_SECONDS': str(work / 'seconds.json')} | environment)


def run(work: pathlib.Path, arguments: argparse.Namespace) -> None:
    """Draw the sample and try each change that has no result yet."""
    tree = copy_tree(work)
    folders = [f if f in PACKAGES else f'sar_imaging/{f}' for f in arguments.folders]
    sample = {'seed': arguments.seed, 'count': arguments.count, 'folders': list(arguments.folders)}
    if arguments.results.exists():
        results = json.loads(arguments.results.read_text())
        if results['sample'] != sample:
            raise SystemExit(f'{arguments.results} holds the sample {results["sample"]}; '
                             'name another file by --results')
    else:
        results = {
            'machine': machine(), 'date': datetime.date.today().isoformat(), 'sample': sample,
            'commit': subprocess.run(['git', 'rev-parse', 'HEAD'], cwd=ROOT, check=True,
                                     capture_output=True, text=True).stdout.strip(),
            'mutations': [dataclasses.asdict(m) for m in draw(
                tree, folders, arguments.count, arguments.seed)]}
    _try(work, [m for m in results['mutations']
                if m.get('status', UNKNOWN) == UNKNOWN], results, arguments)


def again(work: pathlib.Path, arguments: argparse.Namespace) -> None:
    """Try survivors once more with the tests of now, those judged equivalent too."""
    copy_tree(work)
    results = json.loads(arguments.results.read_text())
    survivors = [m for m in results['mutations'] if m.get('status') == SURVIVED]
    _try(work, survivors, results, arguments)


def _try(work: pathlib.Path, entries: list[dict], results: dict,
         arguments: argparse.Namespace) -> None:
    # In random order: what is done when a campaign is stopped is a random sample as well.
    random.Random(results['sample']['seed']).shuffle(entries)
    tests = Tests(work / 'tree', work / 'coverage', work / 'seconds.json')
    runner = Runner(work / 'tree', work / 'mutated', THREADS)
    waiting = [entry.get('status') for entry in entries]
    for number, entry in enumerate(entries, 1):
        if entry.get('status') != waiting[number - 1]:
            continue  # another process that writes to the same results was quicker
        mutation = Mutation(**{f.name: entry[f.name] for f in dataclasses.fields(Mutation)})
        begun = time.monotonic()
        source = work / 'tree' / mutation.file
        line = mutation.place(source.read_text()) if source.exists() else None
        if line is None:
            print(f'{mutation.key}: these lines are gone', flush=True)
            continue
        chosen = tests.of(mutation.file, line, arguments.budget_s)
        result = runner.result(mutation, chosen, tests.seconds(chosen))
        message = result.pop('message')  # may hold paths of this machine
        entry |= result
        entry['tests'] = len(chosen)
        entry['seconds'] = round(time.monotonic() - begun, 1)
        if entry['status'] != SURVIVED:
            entry.pop('verdict', None), entry.pop('reason', None)
        _merge(arguments.results, results, entry)
        print(f'{number}/{len(entries)} {entry["seconds"]:.0f} s, {entry["tests"]} tests, '
              f'{entry["status"]} {entry["test"]}\n    {mutation.key}\n    {message}', flush=True)


def _merge(path: pathlib.Path, results: dict, entry: dict) -> None:
    """Write one result; verdicts that were noted meanwhile in the file are kept."""
    if path.exists():
        for ours, theirs in zip(results['mutations'], json.loads(path.read_text())['mutations'],
                                strict=True):
            if ours is not entry:
                ours.update(theirs)
    write(path, results)


def write(path: pathlib.Path, results: dict) -> None:
    """Write results whole or not at all."""
    part = path.with_suffix('.part')
    part.write_text(json.dumps(results, indent=1) + '\n')
    part.replace(path)


def judge(path: pathlib.Path, key: str, verdict: str, reason: str) -> None:
    """Note why a survivor is equivalent, or why it is left."""
    results = json.loads(path.read_text())
    found = [m for m in results['mutations'] if m.get('status') == SURVIVED
             and key in Mutation.key_of(m['file'], m['before'], m['after'])]
    if len(found) != 1:
        raise SystemExit(f'{len(found)} survivors hold {key!r}; name one')
    found[0] |= {'verdict': verdict, 'reason': reason}
    write(path, results)


def table(mutations: list[dict]) -> str:
    """Markdown: how many of each folder were killed."""
    rows = collections.defaultdict(collections.Counter)
    for m in mutations:
        if m.get('status', UNKNOWN) != UNKNOWN:
            state = m['status']
            if state == SURVIVED and m.get('verdict') == EQUIVALENT:
                state = EQUIVALENT
            drawn = m.get('was', m['file'])  # where the line stood then
            for name in (drawn.removeprefix('sar_imaging/').partition('/')[0], 'all'):
                rows[name][state if state in (SURVIVED, EQUIVALENT) else 'killed'] += 1
    lines = ['| folder | mutations | killed | equivalent | survived | killed of the others |',
             '|---|---|---|---|---|---|']
    for name in sorted(rows, key=lambda n: (n == 'all', n)):
        row = rows[name]
        count, others = sum(row.values()), row['killed'] + row[SURVIVED]
        lines.append(f'| {name} | {count} | {row["killed"]} | {row[EQUIVALENT]} '
                     f'| {row[SURVIVED]} | {row["killed"] / max(others, 1):.1%} |')
    return '\n'.join(lines)


if __name__ == '__main__':
    main()
