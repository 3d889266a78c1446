# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What is told of types is counted in programs of a few lines."""

import ast

from benchmarks.release.stated_types import casts, functions, ignores, in_part


def test_lines_that_are_let_pass_are_counted(tmp_path):
    program = tmp_path / 'program.py'
    program.write_text("a = 1  # type: ignore[assignment]\nb = '# type: ignore'\n"
                       'c = 2  #type:ignore\n')
    assert ignores(program) == [1, 3]


def test_types_that_are_told_are_counted():
    assert casts(ast.parse('x = cast(int, y) + typing.cast(int, z) + y.astype(int)')) == 2


def test_functions_state_all_types_or_not():
    given = ast.parse("""
class A:
    def __init__(self, x: int): ...
    def __len__(self) -> int: ...
    def f(self, x, *, y: int) -> int: ...
def g(*x: int, **y) -> int: ...
def h(x: int): ...
""")
    assert [*functions(given)] == [False, False, True, True, False]


def test_packages_that_are_checked_in_part_are_named():
    assert 'sar_imaging.compilation' in in_part()
    assert not {'sar_imaging.planning.*', 'sar_imaging.imaging.*'} & {*in_part()}
