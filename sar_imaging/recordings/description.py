# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The description of measured data: a YAML file read key by key, with errors that say what to do.

Every number may be given as the name of a variable of the data file instead.
"""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import importlib.resources
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..yaml_text import Value, read_yaml

# All sections and their keys; docs/loading.md explains each.
SECTIONS = ('name', 'description', 'notes', 'samples', 'radar', 'times', 'positions', 'poses',
            'alignment', 'array', 'calibration', 'antenna', 'frames', 'scene')
_REQUIRED = object()


class DescriptionError(ValueError):
    """A description or the data that it describes cannot be used; the text says why.

    Examples
    --------
    >>> from sar_imaging.recordings import DescriptionError, read_description
    >>> with open('wrong.yaml', 'w') as file:
    ...     _ = file.write('radio: {carrier_hz: 77e9}')
    >>> try:
    ...     read_description('wrong.yaml')
    ... except DescriptionError as error:
    ...     print(error)
    wrong.yaml, line 1: unknown key radio; did you mean radar?
    """


class Section:
    """Keys of a part of a description.

    Parameters
    ----------
    value : Value
        The part, as YAML has it.
    known : sequence of str
        Keys that it may have.
    variable : callable, optional
        Gives the array of a variable of the data by its name.

    Raises
    ------
    DescriptionError
        It is no mapping or has an unknown key.
    """

    def __init__(self, value: Value, known: Sequence[str],
                 variable: Callable[[str], np.ndarray] | None = None):
        self._value, self._variable = value, variable
        if not isinstance(value.content, Mapping):
            raise value.error(f'keys with values ({", ".join(known)})')
        value.check_keys(known)

    def __contains__(self, key: str) -> bool:
        return key in self._value.content

    def with_variables(self, variable: Callable[[str], np.ndarray]) -> Section:
        """The same keys, whose texts may name variables."""
        return Section(self._value, tuple(self._value.content), variable)

    def with_defaults(self, values: Mapping[str, object]) -> Section:
        """The same with values for keys that are not given."""
        merged = copy.copy(self._value.content)
        for key, value in values.items():
            merged.setdefault(key, value)
        return Section(dataclasses.replace(self._value, content=merged), tuple(merged),
                       self._variable)

    def raw(self, key: str, default: Any = _REQUIRED, meaning: str = '') -> Any:
        """Value as YAML has it."""
        if key in self:
            return self._value.content[key]
        if default is _REQUIRED:
            raise DescriptionError(
                f'{self._value.place}: {self._value.below(key).key} is missing; add it'
                + (f': {meaning}' if meaning else ''))
        return default

    def error(self, key: str, expected: str, advice: str = '') -> Exception:
        """What to raise for a value that is not as expected."""
        return self._value.below(key).error(expected, advice)

    def text(self, key: str, default: Any = _REQUIRED) -> str:
        """A text."""
        value = self.raw(key, default)
        if value is not default and not isinstance(value, str):
            raise self.error(key, 'a text', 'put it in quotes')
        return value

    def choice(self, key: str, options: Sequence[str], default: Any = _REQUIRED) -> str:
        """One of some words."""
        value = self.raw(key, default, f'one of {", ".join(options)}')
        return value if value is default else self._value.below(key).choice(options)

    def flag(self, key: str) -> bool:
        """True or false; false where it is not given."""
        return key in self and self._value.below(key).flag()

    def array(self, key: str, default: Any = _REQUIRED) -> np.ndarray:
        """Numbers, or a variable that holds them, as a float64 array of any shape."""
        value = self.raw(key, default)
        if value is default:
            return value
        if isinstance(value, str) and _number(value) is None:
            value = self._stored(key, value)
        try:
            if np.array(value).dtype.kind in 'bc':
                raise TypeError
            # People put numbers in quotes, too.
            out = np.array(value, np.float64)
        except (TypeError, ValueError, OverflowError):
            raise self.error(key, 'numbers, or the name of a variable that holds them') from None
        if not np.isfinite(out).all():
            raise self.error(key, 'finite numbers')
        return out

    def _stored(self, key: str, name: str) -> np.ndarray:
        """Variable that stands in place of numbers."""
        with_unit = name[:1] in '+-.0123456789'
        advice = 'write the number alone, in the unit that the key names' if with_unit else ''
        if self._variable is None or with_unit:
            raise self.error(key, 'numbers', advice)
        try:
            return self._variable(name)
        except DescriptionError as error:
            raise self.error(key, 'numbers, or the name of a variable that holds them',
                             str(error)) from error

    def number(self, key: str, default: Any = _REQUIRED) -> float:
        """One number."""
        value = self.array(key, default)
        if value is default:
            return value
        if value.size != 1:
            raise self.error(key, 'one number', f'it holds {value.size}')
        return float(value.reshape(-1)[0])

    def integer(self, key: str, default: Any = _REQUIRED, *, least: int = 1) -> int:
        """A whole number, at least `least`."""
        value = self.number(key, default)
        if value is default:
            return value
        if value != round(value) or value < least:
            raise self.error(key, f'a whole number of at least {least}')
        return int(value)

    def vectors(self, key: str, default: Any = _REQUIRED, *, size: int = 3) -> np.ndarray:
        """(N, size) float64 array; a single vector is one row."""
        value = self.array(key, default)
        if value is default:
            return value
        out = np.atleast_2d(value)
        if out.ndim != 2 or out.shape[1] != size or not len(out):
            raise self.error(key, '[x, y, z] or a list of these' if size == 3
                             else f'{size} numbers', f'its shape is {value.shape}')
        return out

    def vector(self, key: str, default: Any = _REQUIRED, *, size: int = 3) -> np.ndarray:
        """(size,) float64 array."""
        value = self.vectors(key, default, size=size)
        if value is default:
            return value
        if len(value) != 1:
            raise self.error(key, f'one vector of {size} numbers', f'it holds {len(value)}')
        return value[0]

    def section(self, key: str, known: Sequence[str]) -> Section:
        """Part below a key; without keys where it is absent."""
        value = self._value.below(key)
        return Section(value if key in self else dataclasses.replace(value, content={}), known,
                       self._variable)


@contextlib.contextmanager
def of_part(name: str) -> Iterator[None]:
    """Within, what is wrong with values is told as a `DescriptionError` of a part."""
    try:
        yield
    except DescriptionError:
        raise
    except (TypeError, ValueError) as error:
        raise DescriptionError(f'{name}: {error}') from error


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def read_description(path: Path | str, changes: Mapping[str, object] | None = None) -> Section:
    """Read a YAML description of measured data.

    Parameters
    ----------
    path : path
        YAML file.
    changes : mapping, optional
        Values to put in place of those of the file, by path such as
        ``'alignment.time_offset_s'``.

    Returns
    -------
    Section
        The whole description.

    Raises
    ------
    DescriptionError
        It cannot be read, is no YAML, or has unknown sections.

    Examples
    --------
    >>> from sar_imaging.recordings import find_description, read_description
    >>> rail = read_description(find_description('team6_rail'), {'alignment.time_offset_s': 9.3})
    >>> rail.text('name'), rail.section('alignment', ['time_offset_s', 'range_bias_m']).number(
    ...     'time_offset_s')
    ('team6_rail', 9.3)
    """
    try:
        tree = read_yaml(path)
    except ValueError as error:
        raise DescriptionError(f'description {error}') from error
    for key, value in (changes or {}).items():
        _change(tree, key, value)
    return Section(Value(Path(path).name, '', tree, DescriptionError), SECTIONS)


def _change(tree: Any, path: str, value: Any) -> None:
    *parents, last = path.split('.')
    for parent in parents:
        tree = tree.setdefault(parent, {}) if isinstance(tree, dict) else None
    if not isinstance(tree, dict):
        raise DescriptionError(f'{path}={value!r} cannot be set: {".".join(parents)} has no keys')
    tree[last] = value
    getattr(tree, 'lines', {}).pop(last, None)  # it does not stand in the file


def shipped_names() -> list[str]:
    """Names of the descriptions in `config/recordings`.

    Returns
    -------
    list of str
        In alphabetical order.

    Examples
    --------
    >>> from sar_imaging.recordings import shipped_names
    >>> [name for name in shipped_names() if 'arcsar' in name]
    ['arcsar', 'arcsar_7']
    """
    return sorted(path.stem for path in _folder().glob('*.yaml'))


def find_description(name: Path | str) -> Path:
    """Find the file of a description, one of the shipped ones by its name.

    Parameters
    ----------
    name : path
        A file, or the name of a shipped description.

    Returns
    -------
    pathlib.Path
        The YAML file.

    Raises
    ------
    DescriptionError
        Neither of both exists.

    Examples
    --------
    >>> from sar_imaging.recordings import find_description
    >>> find_description('gotcha').name
    'gotcha.yaml'
    """
    if Path(name).is_file():
        return Path(name)
    if Path(name).is_dir():
        raise DescriptionError(f'{name} is a folder; expected the YAML file of the description, '
                               'the folder with the data goes behind it')
    path = _folder() / f'{name}.yaml'
    if str(name) not in shipped_names():
        raise DescriptionError(f'{name} does not exist; expected a YAML file or one of '
                               f'{", ".join(shipped_names())}')
    return path


def _folder() -> Path:
    return Path(str(importlib.resources.files('sar_imaging') / 'config' / 'recordings'))
