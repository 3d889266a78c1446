# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What the type checker looks at, and what it is told to let pass.

Run from the repository root: ``python -m benchmarks.release.stated_types``; it runs mypy, with the
settings of pyproject.toml, and ends with its status.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10, where pytest brings it
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = 'msg_conversions', 'sar_imaging'
IGNORE = re.compile(r'#\s*type:\s*ignore')


def ignores(path: Path) -> list[int]:
    """Lines of a file whose types the checker is told to let pass."""
    with path.open('rb') as file:
        return [token.start[0] for token in tokenize.tokenize(file.readline)
                if token.type == tokenize.COMMENT and IGNORE.search(token.string)]


def casts(tree: ast.AST) -> int:
    """How often a type is told that the checker does not find by itself."""
    return sum(isinstance(node, ast.Call) and ast.unparse(node.func) in ('cast', 'typing.cast')
               for node in ast.walk(tree))


def functions(tree: ast.AST) -> Iterator[bool]:
    """Of each function, whether it states the types of all that it takes, or of what it gives."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs,
                     node.args.vararg, node.args.kwarg]
            given = [a for a in given if a is not None and a.arg not in ('self', 'cls')]
            yield all(a.annotation for a in given) and (
                node.returns is not None or node.name == '__init__' and bool(given))


def in_part() -> list[str]:
    """Packages in which some kinds of errors are not looked for."""
    settings = tomllib.loads((ROOT / 'pyproject.toml').read_text())['tool']['mypy']
    return sorted({name for override in settings['overrides']
                   if override.get('disable_error_code') for name in override['module']})


def main() -> int:
    """Print the counts and run the checker; returns its exit status."""
    paths = [path for package in PACKAGES for path in sorted((ROOT / package).rglob('*.py'))]
    trees = [ast.parse(path.read_text()) for path in paths]
    stated = [one for tree in trees for one in functions(tree)]
    passed = {path.relative_to(ROOT).as_posix(): len(ignores(path)) for path in paths}
    print(f'{sum(stated)} of {len(stated)} functions state their types; the others are compiled, '
          'or write what is')
    print(f'{sum(passed.values())} lines are let pass (`type: ignore`), in '
          f'{sum(map(bool, passed.values()))} modules; {sum(map(casts, trees))} types are told '
          '(`cast`)')
    print(f'some kinds of errors are not looked for in {", ".join(in_part())}', flush=True)
    return subprocess.run([sys.executable, '-m', 'mypy'], cwd=ROOT).returncode


if __name__ == '__main__':
    raise SystemExit(main())
