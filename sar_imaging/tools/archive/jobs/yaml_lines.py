"""YAML whose values know their lines, so that an error can name the one to change."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path

import yaml

from sar_imaging.files import check_file
from sar_imaging.names import advice_on
from sar_imaging.yaml_text import Loader, RepeatedKeyError, trouble

from .job import JobError

_MOST_BYTES = 10**6
_NULL = 'tag:yaml.org,2002:null'
_TEXT = 'tag:yaml.org,2002:str'
_TRUTHS = {'true': True, 'yes': True, 'on': True, 'false': False, 'no': False, 'off': False}


@dataclasses.dataclass(frozen=True)
class Value:
    """A value of a file, and where it stands.

    Attributes
    ----------
    path : Path
        File.
    key : str
        Its full name, such as ``'products.images'``.
    node : yaml.Node
        What the file has.
    """

    path: Path
    key: str
    node: yaml.Node

    @property
    def line(self) -> int:
        """Number of its line, from 1."""
        return self.node.start_mark.line + 1

    @property
    def said(self) -> str:
        """What came, for the message."""
        if isinstance(self.node, yaml.MappingNode):
            return 'a mapping'
        if isinstance(self.node, yaml.SequenceNode):
            return f'a list of {len(self.node.value)}'
        return 'nothing' if self.node.tag == _NULL else repr(self.node.value)

    def error(self, expected: str, remedy: str) -> JobError:
        """The error that says what was expected instead."""
        return JobError(f'{self.path}, line {self.line}: {self.key} is {self.said}; expected '
                        f'{expected}; {remedy}')

    def text(self, expected: str, remedy: str) -> str:
        """It as text that is not empty.

        Raises
        ------
        JobError
            It is something else.
        """
        if not (isinstance(self.node, yaml.ScalarNode) and self.node.tag != _NULL
                and self.node.value.strip()):
            raise self.error(expected, remedy)
        return self.node.value

    def number(self, low: float, high: float, unit: str, example: str, *,
               whole: bool = False) -> float:
        """It as a finite number within bounds; raises JobError."""
        kind = 'whole number' if whole else 'number'
        expected = f'a {kind} of {unit}, {low:g} to {high:g}'
        name = self.key.rpartition('.')[2]
        item = name.endswith(']')  # of a list
        remedy = f'write for instance {example if item else f"{name}: {example}"}'
        if not isinstance(self.node, yaml.ScalarNode) or self.node.style in ('"', "'"):
            quoted = isinstance(self.node, yaml.ScalarNode)
            raise self.error(expected, 'remove the quotes' if quoted else remedy)
        try:
            value = float(self.node.value)  # also 2e9, which YAML 1.1 takes for text
        except ValueError:
            raise self.error(expected, remedy) from None
        if not (math.isfinite(value) and low <= value <= high) or (whole and value % 1):
            raise self.error(expected, remedy)
        return int(value) if whole else value

    def choice(self, choices: tuple[str, ...]) -> str:
        """It as one of some words; raises JobError."""
        told = ', '.join(choices)
        word = self.text(f'one of {told}', f'choose one of {told}')
        if word not in choices:
            near = get_close_matches(word, choices, n=1)
            raise self.error(f'one of {told}', f'write {near[0]}' if near
                             else f'choose one of {told}')
        return word

    def truth(self) -> bool:
        """It as true or false; raises JobError."""
        word = self.node.value.lower() if isinstance(self.node, yaml.ScalarNode) else ''
        if word not in _TRUTHS or self.node.tag == _TEXT:
            raise self.error('true or false', 'write true or false, without quotes')
        return _TRUTHS[word]

    def items(self, expected: str, remedy: str) -> Iterator[Value]:
        """Its items, where it is a list; raises JobError."""
        if not isinstance(self.node, yaml.SequenceNode):
            raise self.error(expected, remedy)
        for number, node in enumerate(self.node.value):
            yield Value(self.path, f'{self.key}[{number}]', node)

    def mapping(self, keys: Mapping[str, str], remedy: str, *,
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
            What it describes, for messages.

        Raises
        ------
        JobError
            It is no mapping, or a key is unknown or lacks.
        """
        if not isinstance(self.node, yaml.MappingNode):
            raise self.error(f'a mapping with {", ".join(keys)}', remedy)
        found: dict[str, Value] = {}
        for key_node, node in self.node.value:
            name = key_node.value if isinstance(key_node, yaml.ScalarNode) else '?'
            where = f'{self.path}, line {key_node.start_mark.line + 1}'
            full = f'{self.key}.{name}' if self.key else name
            if name not in keys:
                raise JobError(f'{where}: there is no key {full}; {advice_on(name, keys)}')
            found[name] = Value(self.path, full, node)
        for name in needed:
            if name not in found:
                raise self.error(f'{what} with {name}', remedy)
        return found


def read_yaml(path: Path) -> Value:
    """The value of a whole file.

    Raises
    ------
    JobError
        The file cannot be read, or is no YAML.
    """
    try:
        check_file(path, _MOST_BYTES)
        node = yaml.compose(path.read_text(encoding='utf-8'), Loader)
    except UnicodeDecodeError as error:
        raise JobError(f'{path} is no text (byte {error.start} is no UTF-8); expected a job file '
                       'in YAML; name another file') from error
    except (OSError, ValueError) as error:
        raise JobError(f'{error}; expected a job file in YAML; name another file') from error
    except RepeatedKeyError as error:
        raise JobError(f'{path}, {trouble(error)}') from error
    except yaml.YAMLError as error:
        raise JobError(f'{path}{_trouble(error)}') from error
    if node is None:
        raise JobError(f'{path} is empty; expected recordings, output and spacing_m; add them')
    return Value(path, '', node)


def _trouble(error: yaml.YAMLError) -> str:
    """Where a text is no YAML, why, and what to do."""
    expected = 'expected YAML, lines of "key: value"'
    if isinstance(error, yaml.reader.ReaderError):
        return (f': character {error.position + 1} is {error.character:#04x}, which no text has; '
                f'{expected}; remove it, or name another file')
    mark = getattr(error, 'problem_mark', None)
    where = f', line {mark.line + 1}' if mark else ''
    problem = ' '.join(str(getattr(error, 'problem', None) or error).split())
    return f'{where}: {problem}; {expected}; correct this line or the one before it'
