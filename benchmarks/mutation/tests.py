# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Which tests execute a line, the cheapest first.

`coverage` says which test runs which line. Compiled code it does not see, nor what happens when
a module is imported: there the tests count that run the lines where the name of the function or
of the constant stands, or the name of what mentions it, and so on.
"""

from __future__ import annotations

import ast
import collections
import functools
import json
import pathlib
from collections.abc import Iterable, Iterator

import coverage

VARIANT_S = 0.5  # what further parameters of the same test count as more, in seconds
FAR = 3.0  # times that a test counts which does not mirror the module
PACKAGES = ('sar_imaging', 'msg_conversions')


class Tests:
    """Tests by the line that they execute.

    Parameters
    ----------
    root : pathlib.Path
        The tree whose sources are looked at.
    data : pathlib.Path
        Database of `coverage` whose contexts are the names of tests.
    seconds : pathlib.Path
        JSON with the time of each test that passed.
    """

    def __init__(self, root: pathlib.Path, data: pathlib.Path, seconds: pathlib.Path):
        self._data = coverage.CoverageData(str(data))
        self._data.read()
        self._seconds = json.loads(seconds.read_text())
        self._files = {pathlib.Path(f).relative_to(root).as_posix(): f
                       for f in self._data.measured_files()}
        self._trees = {path.relative_to(root).as_posix(): ast.parse(path.read_text())
                       for package in PACKAGES for path in sorted((root / package).rglob('*.py'))}

    def of(self, file: str, line: int, budget_s: float) -> list[str]:
        """Tests that execute a line of a file, in the order to run them, within a time."""
        chosen, total = [], 0.0
        found = self._executing(file, line)
        variants = collections.Counter()
        cost = {}
        for test in sorted(found):
            function = test.partition('[')[0]
            cost[test] = (self._seconds[test] * (1.0 if _mirrors(test, file) else FAR)
                          + VARIANT_S * variants[function])
            variants[function] += 1
        for test in sorted(found, key=cost.get):
            if not chosen or total + self._seconds[test] <= budget_s:
                chosen.append(test)
                total += self._seconds[test]
        return chosen

    def seconds(self, tests: Iterable[str]) -> float:
        """How long these tests take together."""
        return sum(self._seconds[test] for test in tests)

    def _executing(self, file: str, line: int) -> set[str]:
        statement, functions, names = around(self._trees[file], line)
        tests = self._running(file, statement)
        if not tests and functions:
            tests = self._running(file, range(functions[0].lineno, functions[0].end_lineno + 1))
        return tests or self._mentioning(file, names)

    def _running(self, file: str, lines: Iterable[int]) -> set[str]:
        contexts = self._contexts(file)
        return {test for line in lines for test in contexts.get(line, ())
                if test in self._seconds}

    def _mentioning(self, file: str, names: set[str]) -> set[str]:
        """Tests that execute where names of a file stand, or what mentions these, and so on."""
        tests, seen = set(), set()
        waiting = {(file, name) for name in names}
        while waiting:
            seen.add(one := waiting.pop())
            for user, lines, holder in self._mentions.get(one[1], ()):
                if user != one[0] and pathlib.PurePath(one[0]).stem not in self._imports[user]:
                    continue  # another thing of this name
                found = self._running(user, lines)
                tests |= found
                if not found and holder and (user, holder) not in seen:
                    waiting.add((user, holder))
        return tests

    @functools.cached_property
    def _imports(self) -> dict[str, set[str]]:
        """Modules by the file that imports them or from them, without the packages' names."""
        return {file: {word for node in ast.walk(tree)
                       if isinstance(node, (ast.Import, ast.ImportFrom))
                       for text in (getattr(node, 'module', None) or '',
                                    *(alias.name for alias in node.names))
                       for word in text.split('.')}
                for file, tree in self._trees.items()}

    @functools.cached_property
    def _mentions(self) -> dict[str, list[tuple[str, range, str]]]:
        """Statements by the names in them: file, lines, name of the function or constant."""
        found = collections.defaultdict(list)
        for file, tree in self._trees.items():
            for top, holder in units(tree):
                for node in ast.walk(top):
                    name = getattr(node, 'id', getattr(node, 'attr', None))
                    if isinstance(name, str) and name != holder:
                        found[name].append((file, range(node.lineno, node.end_lineno + 1), holder))
        return found

    @functools.lru_cache(maxsize=8)  # noqa: B019 there is one such object
    def _contexts(self, file: str) -> dict[int, list[str]]:
        """Contexts of the lines in functions; the others run when a module is imported."""
        if file not in self._files:
            return {}
        inside = {line for f in ast.walk(self._trees[file]) if isinstance(f, ast.FunctionDef)
                  for line in range(f.body[0].lineno, f.end_lineno + 1)}
        found = self._data.contexts_by_lineno(self._files[file])
        return {line: found[line] for line in inside & found.keys()}


def units(tree: ast.Module) -> Iterator[tuple[ast.stmt, str]]:
    """Functions, methods and assignments of a module with the names that others know."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            for part in node.body:
                yield part, getattr(part, 'name', node.name)
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            for part in ast.walk(node):
                if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store):
                    yield node, part.id
        elif isinstance(node, ast.FunctionDef):
            yield node, node.name


def around(tree: ast.Module, line: int) -> tuple[range, list[ast.FunctionDef], set[str]]:
    """Lines of the statement at a line, the functions around, names that others know it by."""
    inside = [n for n in ast.walk(tree)
              if isinstance(n, ast.stmt) and n.lineno <= line <= n.end_lineno]
    inside.sort(key=lambda n: n.end_lineno - n.lineno)
    statement = inside[0]
    body = getattr(statement, 'body', None)
    last = body[0].lineno - 1 if body else statement.end_lineno
    functions = [n for n in inside if isinstance(n, ast.FunctionDef)]
    if functions:
        names = {functions[-1].name}
    else:
        names = {n.name for n in inside if isinstance(n, ast.ClassDef)}
        names |= {n.id for n in ast.walk(statement)
                  if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
    return range(statement.lineno, last + 1), functions, names


def _mirrors(test: str, file: str) -> bool:
    module, path = pathlib.PurePath(file), pathlib.PurePath(test.partition('::')[0])
    package = module.parts[1] if module.parts[0] == 'sar_imaging' else module.parts[0]
    return (package in path.parts and path.name == f'test_{module.name}'
            or path.name == f'test_{module.parent.name}.py')
