# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""One change in a copy of the tree and the tests that may notice it."""

from __future__ import annotations

import ast
import functools
import json
import os
import pathlib
import resource
import shutil
import signal
import time
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence

from .sample import Mutation
from .tests import around, units

CPU_S, CPU_FACTOR = 60.0, 4.0  # processor time that a run may need beyond the tests', and of it
COMPILING_S = 120.0  # that kernels may need, all of them
WALL_FACTOR = 4.0  # waiting counts too, and other work on the machine
COMPILERS = {'njit', 'jit', 'intrinsic', 'vectorize', 'guvectorize'}


class Runner:
    """Makes changes in a copy of a tree and runs tests there.

    Each run is a fork of this process, which has loaded what all of them need.

    Parameters
    ----------
    tree : pathlib.Path
        The tree without changes, with its compiled kernels.
    copy : pathlib.Path
        Where the changed copy is made.
    environment : mapping of str
        Variables that all runs get.
    """

    def __init__(self, tree: pathlib.Path, copy: pathlib.Path, environment: Mapping[str, str]):
        self._tree, self._copy = tree, copy
        os.environ |= environment
        os.environ.pop('PYTHONPATH', None)
        import hypothesis  # noqa: F401 here since the variables must stand before
        import matplotlib.pyplot  # noqa: F401
        import numba  # noqa: F401
        import scipy.spatial  # noqa: F401

    def result(self, mutation: Mutation, tests: Sequence[str], seconds: float) -> dict[str, str]:
        """Status of a change, the test that noticed it, and what that said."""
        if not tests:
            return {'status': 'survived', 'test': '', 'message': 'no test executes it'}
        shutil.rmtree(self._copy, ignore_errors=True)
        shutil.copytree(self._tree, self._copy)
        path = self._copy / mutation.file
        path.write_text(mutation.applied(path.read_text()))
        place = mutation.place((self._tree / mutation.file).read_text())
        reached = self._reached(mutation.file, place)
        for file, name in reached:
            folder, stem = (self._copy / file).parent / '__pycache__', pathlib.Path(file).stem
            for compiled in folder.glob(f'{stem}.{name}[-.]*nb[ci]'):
                compiled.unlink()
        limit_s = CPU_S + CPU_FACTOR * seconds + (COMPILING_S if reached else 0.0)
        return self._run(tests, limit_s)

    def _run(self, tests: Sequence[str], limit_s: float) -> dict[str, str]:
        mark = uuid.uuid4().hex
        answer = self._copy.with_name('answer.json')
        answer.unlink(missing_ok=True)
        begun = time.monotonic()
        child = os.fork()
        if not child:
            _test(self._tree, self._copy, tests, answer, mark, limit_s)
        while not (ended := os.waitpid(child, os.WNOHANG))[0]:
            if time.monotonic() - begun > WALL_FACTOR * limit_s:
                os.kill(child, signal.SIGKILL)
            time.sleep(0.05)
        _end_marked(mark)
        if answer.exists():
            return json.loads(answer.read_text())
        number = os.WTERMSIG(ended[1]) if os.WIFSIGNALED(ended[1]) else 0
        slow = number in (signal.SIGXCPU, signal.SIGKILL)
        return {'status': 'timeout' if slow else 'crash', 'test': '',
                'message': f'ended by signal {number}'}

    def _reached(self, file: str, line: int) -> set[tuple[str, str]]:
        """Files and names of functions that are compiled with what stands at a line."""
        names = around(ast.parse((self._tree / file).read_text()), line)[2]
        before: set[str] = set()
        while names != before:
            before = set(names)
            names |= {name for _, name, used in self._kernel_files if used & names}
        return {(file, name) for file, name, _ in self._kernel_files if name in names}

    @functools.cached_property
    def _kernel_files(self) -> list[tuple[str, str, set[str]]]:
        """Functions and constants of files with kernels: file, name, names used."""
        found = []
        for path in sorted((self._tree / 'sar_imaging').rglob('*.py')):
            tree = ast.parse(path.read_text())
            if any(COMPILERS & set(_used_by(getattr(node, 'decorator_list', ())))
                   for node in ast.walk(tree)):
                file = path.relative_to(self._tree).as_posix()
                found += [(file, name, _used(part)) for part, name in units(tree)]
        return found


def _used(unit: ast.stmt) -> set[str]:
    """Names that a function or assignment takes from outside."""
    own = {n.arg for n in ast.walk(unit) if isinstance(n, ast.arg)}
    own |= {n.id for n in ast.walk(unit)
            if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
    return set(_used_by([unit])) - own


def _used_by(nodes: Iterable[ast.AST]) -> Iterator[str]:
    for node in (n for top in nodes for n in ast.walk(top)):
        if isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.Attribute):
            yield node.attr


def _keep_kernels(tree: pathlib.Path, copy: pathlib.Path) -> None:
    """Let Numba take kernels of the copy from its cache that were compiled in the tree.

    It would compile all of a changed file again. Those that the change reaches are deleted.
    """
    from numba.core.caching import _SourceFileBackedLocatorMixin as Locator
    of_file = Locator.get_source_stamp

    def stamp(locator):
        file = locator._py_file
        locator._py_file = file.replace(str(copy), str(tree), 1)
        try:
            return of_file(locator)
        finally:
            locator._py_file = file

    Locator.get_source_stamp = stamp


class _Witness:
    """Notes the first test that fails."""

    def __init__(self):
        self.test, self.message = '', ''

    def pytest_runtest_logreport(self, report):
        if report.failed and not self.test:
            self.test = report.nodeid
            self.message = getattr(getattr(report.longrepr, 'reprcrash', None), 'message',
                                   str(report.longrepr))

    def pytest_collectreport(self, report):
        self.pytest_runtest_logreport(report)


def _test(tree: pathlib.Path, copy: pathlib.Path, tests: Sequence[str], answer: pathlib.Path,
          mark: str, limit_s: float) -> None:
    """In the fork: run the tests until one fails, write the answer, end."""
    status = {'status': 'crash', 'test': '', 'message': ''}
    try:
        import pytest
        os.setsid()
        os.chdir(copy)
        _keep_kernels(tree, copy)
        os.environ['MUTATION_MARK'] = mark
        resource.setrlimit(resource.RLIMIT_CPU, (int(limit_s), int(limit_s) + 5))
        log = os.open(answer.with_name('last.log'), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(log, 1)
        os.dup2(log, 2)
        witness = _Witness()
        listed = answer.with_name('tests.txt')
        listed.write_text('\n'.join(tests) + '\n')
        code = pytest.main(['-x', '-p', 'no:cacheprovider', '--hypothesis-seed=0',
                            f'@{listed}'], plugins=[witness])
        # A module of tests that cannot be imported ends in an error of usage as well.
        unknown = code == pytest.ExitCode.USAGE_ERROR and not witness.test
        status = {'status': 'survived' if code == 0 else 'unknown' if unknown else 'killed',
                  'test': witness.test, 'message': witness.message[:300]}
    except BaseException as error:
        status['message'] = repr(error)[:300]
    finally:
        answer.with_suffix('.part').write_text(json.dumps(status))
        answer.with_suffix('.part').replace(answer)
        os._exit(0)


def _end_marked(mark: str) -> None:
    """End processes that a run has left behind; they carry its mark."""
    for folder in pathlib.Path('/proc').glob('[0-9]*'):
        try:
            if f'MUTATION_MARK={mark}'.encode() in (folder / 'environ').read_bytes():
                os.kill(int(folder.name), signal.SIGKILL)
        except OSError:
            continue  # ended meanwhile, or another's
