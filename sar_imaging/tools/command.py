# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""One program for all tools: `sar-imaging COMMAND ...`, such as `sar-imaging simulate psf`."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import sys
from collections.abc import Sequence
from pathlib import Path

import sar_imaging

from .program import ending_with_the_reader

#: Words of a command, and the module of this package whose `main` it is.
COMMANDS = {
    ('simulate',): 'simulate',
    ('simulate', 'archive'): 'simulate_archive',
    ('evaluate',): 'evaluate',
    ('check-config',): 'check_config',
    ('calibrate',): 'calibrate',
    ('layouts',): 'layouts',
    ('convert',): 'exchange.convert',
    ('info',): 'exchange.info',
    ('compile',): 'compile_kernels',
    ('measure-costs',): 'measure_costs',
    ('env',): 'environment',
    ('completion',): 'completion',
    ('load',): 'load',
    ('archive',): 'archive.archive',
    ('image',): 'products.image',
    ('radar-constant',): 'products.radar_constant',
    ('change',): 'products.change',
    ('map',): 'products.reference_map',
    ('locate',): 'products.locate',
    ('doctor',): 'products.doctor',
}

#: Commands that may change with each version, see docs/stability.md.
PROVISIONAL = (('simulate', 'archive'), ('archive',), ('measure-costs',), ('radar-constant',),
               ('change',), ('map',), ('locate',))

# What is said where a library is not installed that not every machine has.
_LACKING = {
    'rclpy': 'talks to ROS nodes and needs rclpy, which is not installed; docs/install.md has the '
             'ways to get it. sar-imaging image needs no ROS',
    'matplotlib': 'draws pictures and needs Matplotlib, which is not installed; install the '
                  "extra: pip install 'sar_imaging[tools]'"}


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; returns its exit status, 2 where there is no such command."""
    with ending_with_the_reader():
        try:
            return _main(list(sys.argv[1:] if argv is None else argv))
        except KeyboardInterrupt:  # before the command's work began, or after it
            print('interrupted', file=sys.stderr)
            return 130


def _main(words: list[str]) -> int:
    if not words or words[0] in ('-h', '--help'):
        print(overview())
        return 0 if words else 2
    if words[0] == '--version':
        print(sar_imaging.__version__)
        return 0
    for length in (2, 1):
        module = COMMANDS.get(tuple(words[:length]))
        if module is not None:
            return _run(module, words[length:])
    print(f'sar-imaging: there is no command {words[0]!r}\n\n{overview()}', file=sys.stderr)
    return 2


def _run(module: str, words: Sequence[str]) -> int:
    try:
        program = importlib.import_module(f'sar_imaging.tools.{module}')
    except ModuleNotFoundError as error:
        if error.name not in _LACKING:
            raise
        print(f'error: this command {_LACKING[error.name]}', file=sys.stderr)
        return 1
    return program.main(words)


def overview() -> str:
    """The commands, a line each."""
    width = max(len(' '.join(words)) for words in COMMANDS)
    rows = [f'  {" ".join(words):{width}} {"*" if words in PROVISIONAL else " "}'
            f'{_purpose(module)}' for words, module in COMMANDS.items()]
    return '\n'.join(['usage: sar-imaging COMMAND [ARGUMENTS]; each has --help', '', *rows, '',
                      '* provisional: may change with the next minor version'])


def _purpose(module: str) -> str:
    """First line of a module's docstring, without loading what it imports."""
    found = importlib.util.find_spec(f'sar_imaging.tools.{module}')
    assert found is not None and found.origin is not None
    return (ast.get_docstring(ast.parse(Path(found.origin).read_text())) or '').split('\n')[0]


if __name__ == '__main__':
    sys.exit(main())
