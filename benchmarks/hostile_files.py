# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Every reader against hostile and damaged files: one line, in time, nothing lost or executed.

Run from the repository root: ``python -m benchmarks.hostile_files [--readers NAME ...]``; with
``--most 40`` each file is damaged in so many ways, drawn at random. Each command runs in a process
of its own, forked from one that has imported the package, with 2 GB of address space and 10 s of
a processor. It has to end with an exit status of a command and, where that is an error, one line
of bounded length that names the file. The folder of the inputs has to be as before.
"""

from __future__ import annotations

import argparse
import collections
import json
import math
import os
import pathlib
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Sequence

from .support.hostile.any_file import CANARY, SECRET
from .support.hostile.readers import CALLS, READERS, Reader, digests, kinds_of
from .support.machine import machine

RESULTS = pathlib.Path(__file__).parent / 'results' / 'hostile_files.json'
MEMORY_BYTES, LIMIT_S = 2 * 10**9, 10.0
_PATIENCE = 6
LONGEST_LINE = 1000  # characters: 500 of another library's error, and what we say around it
# What a person cannot use: names of Python's exceptions as they are, and of its codecs.
_WEAK = re.compile(r'codec can|Expecting value|Traceback|object at 0x|'
                   r'(?<!it is damaged \()(?<!\w)\w+Error\b')


def run(words: Sequence[str], within: pathlib.Path, limit_s: float = LIMIT_S, *,
        before: Callable[[], object] = lambda: None, stop: tuple[float, int] | None = None,
        memory_bytes: int = MEMORY_BYTES) -> tuple[int | str, str, float]:
    """Run a command in a forked process within the limits.

    Parameters
    ----------
    words : sequence of str
        Command and arguments.
    within : Path
        The working folder.
    limit_s : float
        Longest time of a processor; six times as long by the clock, on machines that do much else.
    before : callable
        Called in the process before the command.
    stop : (float, int), optional
        Seconds after which a signal is sent, and its number.
    memory_bytes : int
        Largest address space.

    Returns
    -------
    status : int or str
        Exit status, or why there is none.
    text : str
        What it wrote to standard error.
    seconds : float
    """
    read, write = os.pipe()  # whose 64 kB are more than a command has to say
    start = time.monotonic()
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # until the child can be asked
    child = os.fork()
    if not child:
        _child(words, write, within, limit_s, before, memory_bytes)
    os.close(write)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    if stop is not None:
        time.sleep(stop[0])
        os.kill(child, stop[1])  # a process that has ended waits to be asked for its status
    while time.monotonic() - start < _PATIENCE * limit_s + 2:  # SIGALRM comes first
        ended, status, used = os.wait4(child, os.WNOHANG)
        if ended:
            break
        time.sleep(0.002)
    else:
        os.kill(child, signal.SIGKILL)
        _, status, used = os.wait4(child, 0)
    seconds = used.ru_utime + used.ru_stime
    code = os.waitstatus_to_exitcode(status)
    if code < 0:
        slow = dict.fromkeys((-signal.SIGALRM, -signal.SIGXCPU, -signal.SIGKILL), 'too slow')
        code = slow.get(
            code, f'signal {signal.Signals(-code).name}')
    with open(read, errors='replace') as told:
        return code, told.read(), seconds


def _child(words: Sequence[str], told: int, within: pathlib.Path, limit_s: float,
           before: Callable[[], object], memory_bytes: int) -> None:
    """Run it in this process, which never returns."""
    status = 99
    try:
        resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_REAL, _PATIENCE * limit_s)
        resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(limit_s), math.ceil(limit_s) + 1))
        nowhere = os.open(os.devnull, os.O_RDWR)
        for target, source in ((0, nowhere), (1, nowhere), (2, told)):
            os.dup2(source, target)
        sys.stderr = open(2, 'w', closefd=False, errors='backslashreplace')
        sys.stdout = open(1, 'w', closefd=False)
        os.chdir(within)
        before()
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        status = _command(words)
    except SystemExit as error:
        status = error.code if isinstance(error.code, int) else 1
    except KeyboardInterrupt:  # before the command began
        status = 130
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        try:
            sys.stderr.flush()
        finally:
            os._exit(status)


def _forked(call: Callable[[], object]) -> None:
    """Call in a process of its own: threads that images start must not be here before a fork."""
    if not (child := os.fork()):
        try:
            call()
        finally:
            os._exit(0)
    os.waitpid(child, 0)


def _command(words: Sequence[str]) -> int:
    from sar_imaging.tools import command
    from sar_imaging.tools.program import run_command

    if words[0] == 'read':
        return run_command(lambda: f'{CALLS[words[1]](pathlib.Path(words[2]))}')
    return command.main(list(words))


def faults(status: int | str, text: str, names: Sequence[str], before: dict, after: dict,
           out: pathlib.Path) -> list[str]:
    """What is wrong with the end of a command."""
    found = []
    lines = [line for line in text.splitlines() if not line.startswith('warning: ')]
    if lines[-1:] and ' cannot work: ' in lines[-1]:  # check-config tells each error in a line
        lines = [f'error: {lines[-1]}']
    if (longest := max(map(len, text.splitlines()), default=0)) > LONGEST_LINE:
        found.append(f'a line of {longest} characters')
    if status not in (0, 1, 3):
        found.append(f'ended with {status}')
    elif status == 1:
        errors = [line for line in lines if line.startswith('error: ')]
        if len(errors) != 1 or len(lines) != 1:
            found.append(f'{len(lines)} lines')
        elif not any(name in lines[0] for name in names):
            found.append('names no file')
        if out.exists() and any(p.is_file() for p in out.rglob('*')):
            found.append('left files')
    if weak := _WEAK.search(text):
        found.append(f'weak word {weak[0]}')
    if SECRET in text:
        found.append('told a secret')
    if any(pathlib.Path(name).name == CANARY for name in after):
        found.append('executed')
    if before != after:
        found.append('changed its inputs')
    return found


def campaign(reader: Reader, most: int, seed: int) -> dict:
    """Figures and faults of one reader: some of the ways to damage its file, drawn at random."""
    with tempfile.TemporaryDirectory() as place:
        folder = pathlib.Path(place)
        valid, work, out = folder / 'valid', folder / 'work', folder / 'out'
        valid.mkdir()
        _forked(lambda: reader.make(valid))
        content = (valid / reader.file).read_bytes()
        kinds = kinds_of(reader, content, range(100 * seed, 100 * seed + 10))
        known = len(kinds)
        drawn = random.Random(seed).sample(range(known), min(most, known))
        kinds = [kinds[i] for i in sorted(drawn)]
        found: dict = {'known': known, 'kinds': len(kinds), 'runs': 0, 'read': 0, 'refused': 0,
                       'longest_s': 0.0, 'faults': []}
        endings: collections.Counter[str] = collections.Counter()
        for told, damage in [('valid', None), *kinds]:
            shutil.rmtree(work, ignore_errors=True)
            shutil.copytree(valid, work)
            os.mkfifo(work / 'pipe')
            (work / 'secret').write_text(SECRET)
            if damage is not None:
                damage(work / reader.file)
            before = digests(work)
            for pattern in reader.commands:
                shutil.rmtree(out, ignore_errors=True)
                out.mkdir()
                words = [w.format(file=work / reader.file, folder=work, out=out) for w in pattern]
                status, text, seconds = run(words, work)
                names = (pathlib.Path(reader.file).name, 'bag', 'rail', 'poses')
                wrong = faults(status, text, names, before, digests(work), out)
                if damage is None and status not in (0, 3):
                    wrong.append('the valid file is refused')
                if damage is not None:
                    found['runs'] += 1
                    found['read' if status in (0, 3) else 'refused'] += 1
                found['longest_s'] = max(found['longest_s'], round(seconds, 2))
                endings[re.sub(r'[\d.]+', '#', text)[:60]] += 1
                if wrong:
                    found['faults'].append([told, words[0], '; '.join(wrong), text[-600:]])
    return found


def prepare(images: bool = True) -> None:
    """Import and compile what the commands need, before processes are forked."""
    os.environ.update(OMP_NUM_THREADS='1', NUMBA_NUM_THREADS='1')
    import importlib

    importlib.import_module('sar_imaging.tools.command')
    for module in ('info', 'convert'):
        importlib.import_module(f'sar_imaging.tools.exchange.{module}')
    for module in ('products.image', 'products.change', 'products.doctor', 'check_config',
                   'products.radar_constant', 'calibrate', 'load', 'layouts',
                   'archive.archive', 'simulate', 'simulate_archive', 'measure_costs'):
        importlib.import_module(f'sar_imaging.tools.{module}')
    for module in ('h5py', 'rasterio', 'sarkit.cphd', 'sarkit.sicd', 'scipy.io', 'jbpy',
                   'rosbags.rosbag2', 'rosbags.highlevel', 'pyproj'):
        importlib.import_module(module)
    if not images:
        return
    with tempfile.TemporaryDirectory() as place:  # kernels: threads must not begin before a fork
        folder = pathlib.Path(place)
        next(r for r in READERS if r.name == 'bag, MCAP').make(folder)
        run(('image', f'{folder}/bag', '--output', f'{folder}/out'), folder,
            limit_s=600.0)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns 1 where a fault was found."""
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument('--readers', nargs='+', help='parts of their names (default: all)')
    p.add_argument('--most', type=int, default=10**9, help='kinds of damage of each reader')
    p.add_argument('--seed', type=int, default=0, help='by which they are drawn')
    p.add_argument('--output', type=pathlib.Path, help='file for the results')
    arguments = p.parse_args(argv)
    chosen = [reader for reader in READERS if not arguments.readers
              or any(n in reader.name for n in arguments.readers)]
    prepare(images=any(words[0] == 'image' for reader in chosen for words in reader.commands))
    results: dict = {'machine': machine(), 'memory_bytes': MEMORY_BYTES, 'limit_s': LIMIT_S,
                     'seed': arguments.seed, 'readers': {}}
    for reader in chosen:
        found = campaign(reader, arguments.most, arguments.seed)
        results['readers'][reader.name] = found
        print(f'{reader.name:22} {found["kinds"]:5} of {found["known"]:5} kinds '
              f'{found["runs"]:5} runs, '
              f'{found["read"]:5} read, {found["refused"]:5} refused, at most '
              f'{found["longest_s"]:5.2f} s, {len(found["faults"])} faults', flush=True)
        for told, words, wrong, text in found['faults']:
            print(f'    {told} | {words} | {wrong} | {text.strip()[-220:]!r}', flush=True)
        if arguments.output:
            arguments.output.write_text(json.dumps(results, indent=1) + '\n')
    return int(any(found['faults'] for found in results['readers'].values()))


if __name__ == '__main__':
    sys.exit(main())
