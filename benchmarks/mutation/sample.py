# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Random single changes of the source: a sign, a bound, a number, a dropped condition.

The operators are those of cosmic-ray. Of each symbol only the replacements that a person might
type by mistake are drawn: a sum that becomes a shift ends in an error of types and tests nothing.
"""

from __future__ import annotations

import ast
import dataclasses
import difflib
import itertools
import pathlib
import random
from collections.abc import Iterator, Mapping, Sequence

from cosmic_ray.ast import Visitor, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator

OPERATORS = [f'core/{name}' for name in (
    *(f'ReplaceBinaryOperator_{pair}' for pair in (
        'Add_Sub', 'Sub_Add', 'Mul_Div', 'Div_Mul', 'FloorDiv_Mul', 'Mod_FloorDiv', 'Pow_Mul',
        'LShift_RShift', 'RShift_LShift', 'BitAnd_BitOr', 'BitOr_BitAnd', 'BitXor_BitOr')),
    *(f'ReplaceComparisonOperator_{pair}' for pair in (
        'Eq_NotEq', 'NotEq_Eq', 'Is_IsNot', 'IsNot_Is', 'Lt_LtE', 'LtE_Lt', 'Gt_GtE', 'GtE_Gt',
        'Lt_GtE', 'LtE_Gt', 'Gt_LtE', 'GtE_Lt')),
    'ReplaceUnaryOperator_Delete_USub', 'ReplaceUnaryOperator_Delete_Not', 'AddNot',
    'ReplaceTrueWithFalse', 'ReplaceFalseWithTrue', 'ReplaceAndWithOr', 'ReplaceOrWithAnd',
    'ReplaceBreakWithContinue', 'ReplaceContinueWithBreak', 'NumberReplacer',
    'ZeroIterationForLoop')]


@dataclasses.dataclass(frozen=True)
class Mutation:
    """One change: these lines of a file become others.

    Attributes
    ----------
    file : str
        Path from the root of the repository.
    line : int
        Number of the first line, from 1.
    before, after : str
        The lines without and with the change.
    operator : str
        Name that cosmic-ray gives to the kind of change.
    """

    file: str
    line: int
    before: str
    after: str
    operator: str

    @property
    def key(self) -> str:
        """What tells it from others even when lines move."""
        return self.key_of(self.file, self.before, self.after)

    @staticmethod
    def key_of(file: str, before: str, after: str) -> str:
        """File and texts."""
        return f'{file}: {before.strip()} -> {after.strip()}'

    def place(self, source: str) -> int | None:
        """Line of the source, from 1, where its lines stand nearest; None when they are gone."""
        lines, before = source.split('\n'), self.before.split('\n')
        places = [i + 1 for i in range(len(lines)) if lines[i:i + len(before)] == before]
        return min(places, key=lambda i: abs(i - self.line), default=None)

    def applied(self, source: str) -> str:
        """The source with the change."""
        lines, place = source.split('\n'), self.place(source) - 1
        lines[place:place + self.before.count('\n') + 1] = self.after.split('\n')
        return '\n'.join(lines)


def draw(root: pathlib.Path, folders: Sequence[str], count: int, seed: int) -> list[Mutation]:
    """Reproducible random sample; each line of code that can be changed is as likely as another.

    A line is changed once at most. Folders get their share by the number of such lines.
    """
    places = {folder: _places(root, folder) for folder in folders}
    generator = random.Random(seed)
    sample = []
    for folder, share in shares({f: len(of) for f, of in places.items()}, count).items():
        lines = list(places[folder])
        generator.shuffle(lines)
        made = (_made(root, file, _choice(generator, places[folder][file, line]))
                for file, line in lines)
        sample.extend(sorted(itertools.islice(filter(None, made), share),
                             key=lambda m: (m.file, m.line)))
    return sample


def _choice(generator: random.Random, places: Sequence[tuple[str, int]]) -> tuple[str, int]:
    """One of a line's changes: first of its kinds, else most would be those of numbers."""
    operator = generator.choice(sorted({operator for operator, _ in places}))
    return generator.choice([place for place in places if place[0] == operator])


def shares(sizes: Mapping[str, int], count: int) -> dict[str, int]:
    """`count` in proportion to the sizes, rounded so that the sum is kept."""
    exact = {name: count * size / sum(sizes.values()) for name, size in sizes.items()}
    whole = {name: int(value) for name, value in exact.items()}
    for name in sorted(exact, key=lambda n: whole[n] - exact[n])[:count - sum(whole.values())]:
        whole[name] += 1
    return whole


def _places(root: pathlib.Path, folder: str) -> dict[tuple[str, int], list[tuple[str, int]]]:
    """Operators and their occurrences, by file and line of a folder."""
    found = {}
    for path in sorted((root / folder).rglob('*.py')):
        file = path.relative_to(root).as_posix()
        for line, operator, occurrence in places(path.read_text()):
            found.setdefault((file, line), []).append((operator, occurrence))
    return found


class _Positions(Visitor):
    """Where an operator applies, in the order in which cosmic-ray counts."""

    def __init__(self, operator):
        self._operator = operator
        self.found = []

    def visit(self, node):
        self.found.extend(begin for begin, _ in self._operator.mutation_positions(node))
        return node


def places(source: str) -> Iterator[tuple[int, str, int]]:
    """Line, operator and occurrence of every change of a module, texts and types left out."""
    left_out = list(_left_out(ast.parse(source)))
    tree = get_ast(source)
    for name in OPERATORS:
        visitor = _Positions(get_operator(name)())
        visitor.walk(tree)
        for occurrence, begin in enumerate(visitor.found):
            if not any(first <= begin < last for first, last in left_out):
                yield begin[0], name, occurrence


def _made(root: pathlib.Path, file: str, place: tuple[str, int]) -> Mutation | None:
    """The change of a file; None where it changes no code."""
    operator, occurrence = place
    source = (root / file).read_text()
    changed = mutate_code(source, get_operator(operator)(), occurrence)
    try:
        tree = ast.parse(changed)
    except SyntaxError:
        return None
    # A star that begins keyword arguments is no product.
    if ast.dump(tree) == ast.dump(ast.parse(source)) or any(
            isinstance(node, ast.arguments) and node.posonlyargs for node in ast.walk(tree)):
        return None
    old, new = source.split('\n'), changed.split('\n')
    blocks = [b for b in difflib.SequenceMatcher(None, old, new, False).get_opcodes()
              if b[0] != 'equal']
    first, last = blocks[0][1], blocks[-1][2]
    return Mutation(file, first + 1, '\n'.join(old[first:last]),
                    '\n'.join(new[blocks[0][3]:blocks[-1][4]]), operator)


def _left_out(tree: ast.Module) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    """Type hints, decorators (settings of compilers and classes), f-strings, logged texts."""
    for node in ast.walk(tree):
        match node:
            case ast.arg(annotation=ast.expr() as part) | ast.AnnAssign(annotation=part):
                yield _span(part)
            case ast.FunctionDef() | ast.ClassDef():
                yield from map(_span, node.decorator_list)
                if returns := getattr(node, 'returns', None):
                    yield _span(returns)
            case ast.JoinedStr() | ast.Call(func=ast.Attribute(attr=('debug' | 'info' | 'warning'
                                                                     | 'error' | 'fatal'
                                                                     | 'exception'))):
                yield _span(node)
            case ast.If(test=ast.Compare(left=ast.Name(id='__name__'))):
                yield _span(node)


def _span(node: ast.AST) -> tuple[tuple[int, int], tuple[int, int]]:
    return (node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset)
