# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""YAML that people write, for the whole package: bounded, each key once, and lines are known.

PyYAML keeps the last of keys given twice without a word, and YAML 1.2 forbids them (section
3.2.1.1). Numbers such as 9.6e9 are numbers, as in YAML 1.2 and ROS; PyYAML takes them for text.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterator, Mapping as AnyMapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import yaml

from .files import MOST_TEXT_BYTES, read_text, told
from .names import advice_on

_DEEPEST = 50
_MOST_VALUES = 1_000_000
_LONGEST_NUMBER = 100  # characters; PyYAML takes minutes for a long one of base 60
_NUMBERS = ('tag:yaml.org,2002:int', 'tag:yaml.org,2002:float')


class RepeatedKeyError(yaml.MarkedYAMLError):
    """A mapping has a key twice; its `problem` and `problem_mark` say which and where."""


class Mapping(dict[Any, Any]):
    """A mapping of a YAML text that knows where its keys stand.

    Attributes
    ----------
    lines : dict
        Number of the line, from 1, of each key, and of each item of a list by key and index.
    written : dict
        What stands there for each value that is neither a mapping nor a list, by the same keys.
    """

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)
        self.lines: dict[object, int] = {}
        self.written: dict[object, str] = {}


def line_of(mapping: object, key: object) -> int | None:
    """Number of the line, from 1, where a key stands; None where that is not known.

    Parameters
    ----------
    mapping : object
        What has the key; a `Mapping` knows.
    key : object
        The key, or a tuple of it and the index of an item of its list.
    """
    return getattr(mapping, 'lines', {}).get(key)


def place(origin: object, line: int | None) -> str:
    """Where something stands, for errors: ``'radar.yaml, line 7'``; `origin` without a line."""
    return f'{origin}' if line is None else f'{origin}, line {line}'


class Loader(yaml.SafeLoader):
    """Safe loader of bounded texts, whose mappings have each key once.

    A few hundred bytes of aliases of aliases stand for millions of values, and of brackets for
    more levels than Python can follow.
    """

    _level = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Node of the next events; see `yaml.SafeLoader`."""
        self._level += 1
        if self._level > _DEEPEST:
            event = self.peek_event()  # type: ignore[no-untyped-call]  # of types-PyYAML
            raise _refusal(f'it is nested deeper than {_DEEPEST} levels', event)
        node = super().compose_node(parent, index)
        self._level -= 1
        return node

    def get_single_node(self) -> yaml.Node | None:
        """Node of the whole text; see `yaml.SafeLoader`."""
        node = super().get_single_node()
        _expanded(node, {})
        _refuse_repeated_keys(node)
        return node


def _mapping(loader: Loader, node: yaml.MappingNode) -> Iterator[Mapping]:
    content = Mapping()
    yield content  # an alias within it may name it already
    content.update(loader.construct_mapping(node))
    for key_node, value in node.value:
        key = loader.construct_object(key_node)
        _note(content, key, key_node, value)
        if isinstance(value, yaml.SequenceNode):
            for index, item in enumerate(value.value):
                _note(content, (key, index), item, item)


def _note(content: Mapping, at: object, first: yaml.Node, value: yaml.Node) -> None:
    content.lines[at] = first.start_mark.line + 1
    if isinstance(value, yaml.ScalarNode):
        content.written[at] = value.value


Loader.add_constructor('tag:yaml.org,2002:map', _mapping)
yaml.SafeDumper.add_representer(Mapping, yaml.SafeDumper.represent_dict)
for reader_or_writer in (Loader, yaml.SafeDumper):  # which puts such texts in quotes
    reader_or_writer.add_implicit_resolver(
        'tag:yaml.org,2002:float', re.compile(r'[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$'),
        list('-+.0123456789'))


def _expanded(node: yaml.Node | None, known: dict[int, int]) -> int:
    """Number of values that a node stands for, those of its aliases counted each time."""
    if not isinstance(node, yaml.CollectionNode):
        if node is not None and node.tag in _NUMBERS and len(node.value) > _LONGEST_NUMBER:
            raise _refusal(f'a number of {len(node.value)} characters', node)
        return 1
    if id(node) not in known:
        known[id(node)] = _MOST_VALUES + 1  # of an alias of itself
        parts = (part for item in node.value
                 for part in (item if isinstance(item, tuple) else (item,)))
        known[id(node)] = 1 + sum(_expanded(part, known) for part in parts)
    if known[id(node)] > _MOST_VALUES:
        raise _refusal(f'its aliases stand for more than {_MOST_VALUES} values', node)
    return known[id(node)]


def _refusal(problem: str, place: yaml.Node | yaml.Event) -> yaml.MarkedYAMLError:
    mark: Any = place.start_mark  # of Python or C
    return yaml.MarkedYAMLError(None, None, problem, mark)


def _refuse_repeated_keys(node: yaml.Node | None) -> None:
    waiting, seen = [node], set()
    while waiting:
        node = waiting.pop()
        if not isinstance(node, yaml.CollectionNode) or id(node) in seen:
            continue
        seen.add(id(node))  # aliases name a node again, even within itself
        if isinstance(node, yaml.SequenceNode):
            waiting += node.value
            continue
        first: dict[tuple[str, str], int] = {}
        for key, value in node.value:
            waiting += [key, value]
            if not isinstance(key, yaml.ScalarNode):
                continue
            line = key.start_mark.line + 1
            if (name := (key.tag, key.value)) in first:
                raise RepeatedKeyError(
                    None, None, f'the key {key.value} is given twice, first in line '
                    f'{first[name]}; keep one of them', key.start_mark)
            first[name] = line


def load_yaml(text: str) -> Any:
    """Content of a YAML text, one document; its mappings are `Mapping`.

    Raises
    ------
    yaml.YAMLError
        It is no YAML, is boundless, or a mapping has a key twice.
    """
    try:
        return yaml.load(text, Loader)
    except yaml.YAMLError:
        raise
    except Exception as error:  # of values that are none of their type
        raise yaml.MarkedYAMLError(problem=told(error)) from error


def read_yaml(path: Path | str, *, most_bytes: int = MOST_TEXT_BYTES) -> Any:
    """Content of a YAML file; its mappings are `Mapping`.

    Raises
    ------
    ValueError
        It cannot be read, is larger, no text or no YAML; the text names it, and quotes nothing
        of it but a key.
    """
    try:
        return load_yaml(read_text(path, most_bytes))
    except yaml.YAMLError as error:
        mark = getattr(error, 'problem_mark', None)
        what = '' if isinstance(error, RepeatedKeyError) else 'it is no YAML: '
        raise ValueError(f'{place(path, mark and mark.line + 1)}: {what}{_reason(error)}'
                         ) from error


def trouble(error: yaml.YAMLError) -> str:
    """Line and reason of an error, in one line, without what else the text holds."""
    mark = getattr(error, 'problem_mark', None)
    return ('' if mark is None else f'line {mark.line + 1}: ') + _reason(error)


def _reason(error: yaml.YAMLError) -> str:
    if isinstance(error, yaml.reader.ReaderError):
        return (f'character {error.position + 1} is {error.character:#04x}, which no text has; '
                'remove it')
    return ' '.join(str(getattr(error, 'problem', None) or 'it cannot be parsed').split())


_LONGEST_VALUE = 80  # characters that an error quotes


@dataclasses.dataclass(frozen=True)
class Value:
    """A value of a file, and where it stands: all errors about values have one form.

    Attributes
    ----------
    origin : path
        The file, for errors.
    key : str
        Its full name, such as ``'products.images'``; empty for the whole file.
    content : object
        What the file has; None where it has nothing.
    refusal : type
        The exception.
    parent : Mapping or None
        What it stands in; None for the whole file.
    at : object
        Its key there, with its index where it is an item of a list.
    line : int or None
        Of what it stands in, for values that stand nowhere.
    """

    origin: Path | str
    key: str
    content: Any
    refusal: type[Exception] = ValueError
    parent: Any = None
    at: object = None
    line: int | None = None

    @property
    def place(self) -> str:
        """File and line."""
        return place(self.origin, self._line)

    @property
    def _line(self) -> int | None:
        return line_of(self.parent, self.at) or self.line

    @property
    def said(self) -> str:
        """What came, for errors."""
        text = 'nothing' if self.content is None else repr(self.content)
        return text if len(text) < _LONGEST_VALUE else f'{text[:_LONGEST_VALUE - 3]}...'

    def error(self, expected: str, remedy: str = '') -> Exception:
        """The error that says what was expected instead, and what to do."""
        return self.refusal(f'{self.place}: {self.key or "the file"}: expected {expected}, got '
                            f'{self.said}' + (f'; {remedy}' if remedy else ''))

    def below(self, name: object) -> Value:
        """The value of a key of it."""
        return Value(self.origin, f'{self.key}.{name}' if self.key else str(name),
                     self.content.get(name), self.refusal, self.content, name, self._line)

    def check_keys(self, known: Sequence[str] | AnyMapping[str, object]) -> None:
        """Refuse a mapping with a key that is not known."""
        for name in self.content:
            if name not in known:
                value = self.below(name)
                raise self.refusal(f'{value.place}: unknown key {value.key}; '
                                   f'{advice_on(name, known)}')

    @property
    def _written(self) -> str:
        return self.parent.written[self.at]

    def text(self, expected: str, remedy: str) -> str:
        """It as text that is not empty."""
        if isinstance(self.content, dict | list | None) or not self._written.strip():
            raise self.error(expected, remedy)
        return self._written

    def number(self, low: float, high: float, unit: str, example: str, *,
               whole: bool = False) -> float:
        """It as a finite number within bounds."""
        kind = 'whole number' if whole else 'number'
        expected = f'a {kind} of {unit}, {low:g} to {high:g}'
        name = self.key.rpartition('.')[2]
        item = name.endswith(']')  # of a list
        remedy = f'write for instance {example if item else f"{name}: {example}"}'
        if isinstance(self.content, dict | list | None):
            raise self.error(expected, remedy)
        try:
            value = float(self._written)
        except ValueError:
            raise self.error(expected, remedy) from None
        if isinstance(self.content, str):
            raise self.error(expected, 'remove the quotes')
        if not (math.isfinite(value) and low <= value <= high) or (whole and value % 1):
            raise self.error(expected, remedy)
        return int(value) if whole else value

    def choice(self, choices: Sequence[str]) -> str:
        """It as one of some words."""
        if self.content not in choices:
            near = get_close_matches(str(self.content).lower(), choices, 1, 0.7)
            raise self.error(f'one of {", ".join(choices)}',
                             f'did you mean {near[0]}?' if near else '')
        return self.content

    def flag(self) -> bool:
        """It as true or false."""
        if not isinstance(self.content, bool):
            raise self.error('true or false', 'write true or false, without quotes')
        return self.content

    def items(self, expected: str, remedy: str) -> Iterator[Value]:
        """Its items, where it is a list."""
        if not isinstance(self.content, list):
            raise self.error(expected, remedy)
        for number, item in enumerate(self.content):
            yield Value(self.origin, f'{self.key}[{number}]', item, self.refusal, self.parent,
                        (self.at, number), self.line)

    def mapping(self, keys: AnyMapping[str, str], remedy: str, *,
                needed: Sequence[str] = (), what: str = 'a mapping') -> dict[str, Value]:
        """Its values by key, where it is a mapping of known ones.

        Parameters
        ----------
        keys : mapping of str to str
            Known keys, and an example of each.
        remedy : str
            Of a value that is none.
        needed : sequence of str
            Keys that it must have.
        what : str
            What it describes, for errors.
        """
        if not isinstance(self.content, dict):
            raise self.error(f'a mapping with {", ".join(keys)}', remedy)
        self.check_keys(keys)
        for name in needed:
            if name not in self.content:
                raise self.error(f'{what} with {name}', remedy)
        return {name: self.below(name) for name in self.content}
