# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the nodes as tables: declared, checked and coerced in one place.

`sar_pipeline` reads the parameter files of the separate nodes.
"""

from __future__ import annotations

import contextlib
import dataclasses
import difflib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from ...backends import AUTO, CUDA, DeviceError, backend
from ...compilation import MissingNumbaError
from ...configuration.parameters import IN_WORDS, as_kind
from ...yaml_text import load_yaml

# When a parameter may change.
START = 'start'  # never after the start of the process
CONFIGURE = 'configure'  # while the node is unconfigured; it counts when it is configured
ANY_TIME = 'any time'


class ConfigurationError(ValueError):
    """A node cannot work with its parameters; the text says which and what to set."""


@contextlib.contextmanager
def refused(what: str = '', errors: type[Exception] | tuple[type[Exception], ...] = ValueError
            ) -> Iterator[None]:
    """Such errors within are a `ConfigurationError`, whose text begins with `what`."""
    try:
        yield
    except errors as error:
        raise ConfigurationError(f'{what}{error}') from error


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One line of a node's parameter table.

    Parameters
    ----------
    name : str
        Name as in the configuration file.
    default : float, int, bool, str or list of floats
        Value without configuration; its type is the type of the parameter. Lists of numbers are
        not empty: ROS takes an empty default for one of bytes.
    description : str
        One sentence for people.
    unit : str
        Unit of the value, empty without.
    minimum, maximum : float or int or None
        Inclusive range of a number.
    check : callable or None
        Raises ValueError for a value that the range cannot tell.
    changes : str
        `START`, `CONFIGURE` or `ANY_TIME`: when the value may change.
    """

    name: str
    default: float | int | bool | str | list[float]
    description: str
    unit: str = ''
    minimum: float | None = None
    maximum: float | None = None
    check: Callable[[Any], object] | None = None
    changes: str = CONFIGURE

    def descriptor(self) -> ParameterDescriptor:
        """Descriptor for `ros2 param describe` and for parameter editors."""
        unit = f' Unit: {self.unit}.' if self.unit else ''
        descriptor = ParameterDescriptor(
            name=self.name, type=RosParameter.Type.from_parameter_value(self.default).value,
            description=f'{self.description}{unit}', read_only=self.changes == START)
        if self.changes == CONFIGURE:
            descriptor.additional_constraints = 'Changes only while the node is unconfigured.'
        if self.minimum is not None:
            kind = type(self.default)
            limits = {'from_value': kind(self.minimum), 'to_value': kind(self.maximum)}
            if kind is float:
                descriptor.floating_point_range = [FloatingPointRange(**limits)]
            else:
                descriptor.integer_range = [IntegerRange(**limits)]
        return descriptor

    def expected(self) -> str:
        """What a value must be, in words."""
        words = IN_WORDS[type(self.default)]
        if self.minimum is not None:
            words += f' from {self.minimum} to {self.maximum}'
        return f'{words} ({self.unit})' if self.unit else words

    def coerce(self, value: object) -> Any:
        """Value as the type of the parameter.

        Raises
        ------
        ConfigurationError
            The type is wrong, or the value is out of range.
        """
        kind = type(self.default)
        if kind is list and isinstance(value, Sequence) and not isinstance(value, str | bytes):
            value = [float(v) if type(v) is int else v for v in value]
        found = as_kind(value, kind)
        if found is None or found == [] or (
                self.minimum is not None and not self.minimum <= found <= self.maximum):
            raise ConfigurationError(f'parameter {self.name}={value!r}; expected '
                                     f'{self.expected()}')
        if self.check is not None:
            with refused(f'parameter {self.name}: '):
                self.check(found)
        return found


def check_vector(values: list[float]) -> None:
    """Check of a parameter that is one vector."""
    if len(values) != 3:
        raise ValueError(f'{len(values)} numbers; expected x, y, z')


def one_of(*choices: str) -> Callable[[object], None]:
    """Check of a parameter that is one of a few words, its attribute `choices`."""
    def check(value: object) -> None:
        if value not in choices:
            raise ValueError(f'{value!r} is unknown; use one of {", ".join(choices)}')

    check.choices = choices
    return check


def command_line_parameters(arguments: Sequence[str]) -> list[RosParameter]:
    """Values that ``-p name:=value`` gives, which then count whatever a parameter file says.

    By the rules of ROS the last matching section of a file wins, also against ``-p``, which is
    then ignored without a word. Values for a named node, ``-p node:name:=value``, are left to
    ROS: they count as a section at the end.

    Parameters
    ----------
    arguments : sequence of str
        Command line.

    Returns
    -------
    list of Parameter
        Those that are no ``name:=value`` are left out; ROS complains about them itself.
    """
    found, of_ros = {}, False
    for flag, word in zip(arguments, [*arguments[1:], ''], strict=True):
        if flag in ('--ros-args', '--'):
            of_ros = flag == '--ros-args'
        elif of_ros and flag in ('-p', '--param') and ':=' in word:
            name, _, text = word.partition(':=')
            with contextlib.suppress(yaml.YAMLError, TypeError, ValueError):
                if ':' not in name:
                    found[name] = RosParameter(name, value=load_yaml(text))
    return list(found.values())


class ParameterValues(dict[str, Any]):
    """Declared parameters of a node and their current values, by name.

    Values given at the start are declared as they are, so that a node without an impossible
    value can still be configured after somebody corrected it; `load` checks them all.

    Parameters
    ----------
    node : rclpy.node.Node
        Node to declare them on.
    table : iterable of Parameter
        What to declare.
    """

    def __init__(self, node: Node, table: Iterable[Parameter]):
        self._node = node
        self._table = {p.name: p for p in table}
        super().__init__({name: p.default for name, p in self._table.items()})
        self._unsettled = set(self._table)  # declared for any type, without their ranges
        self._configured = False
        for p in self._table.values():
            # With any type first: `spacing: 1` for a double would kill the node, and what is
            # wrong with a value is said in one line when the node is configured.
            node.declare_parameter(p.name, p.default, ParameterDescriptor(dynamic_typing=True))
            with contextlib.suppress(ConfigurationError):
                self._settle(p)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def unknown(self, names: Iterable[str]) -> str:
        """That these names are not known, and what may be meant."""
        told = []
        for name in names:
            # a misspelt end of a name is as likely as the whole one
            ends = {known.rpartition('.')[2]: known for known in self._table}
            near = (difflib.get_close_matches(name, self._table, 1)
                    or [ends[end] for end in difflib.get_close_matches(name, ends, 1)])
            told.append(name + (f' (did you mean {near[0]}?)' if near else ''))
        return f'unknown parameters, without effect: {", ".join(told)}'

    def load(self) -> None:
        """Check all values; those that count at configuration are refused from now on.

        Raises
        ------
        ConfigurationError
            A value has the wrong type or is out of range.
        """
        for name in sorted(self._unsettled):
            self._settle(self._table[name])
        self._configured = True

    def release(self) -> None:
        """Allow changes of the parameters that count at configuration."""
        self._configured = False

    def _settle(self, parameter: Parameter) -> None:
        """Give a parameter its type and range, once its value has them."""
        value = parameter.coerce(self._node.get_parameter(parameter.name).value)
        self._node.set_parameters([RosParameter(parameter.name, value=value)])
        self._node.set_descriptor(parameter.name, parameter.descriptor())
        self[parameter.name] = value
        self._unsettled.remove(parameter.name)

    def _check(self, parameters: list[RosParameter]) -> SetParametersResult:
        try:
            for p in parameters:
                if p.name in self._table:
                    self._check_one(self._table[p.name], p.value)
        except ConfigurationError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _check_one(self, parameter: Parameter, value: object) -> None:
        value = parameter.coerce(value)
        if (self._configured and parameter.changes == CONFIGURE
                and value != self[parameter.name]):
            raise ConfigurationError(
                f'parameter {parameter.name} is read when the node is configured; deactivate it '
                'and clean it up, set the parameter, then configure and activate it again')

    def _apply(self, parameters: list[RosParameter]) -> None:
        for p in parameters:
            if p.name in self._table:
                self[p.name] = self._table[p.name].coerce(p.value)


BACKEND = Parameter(
    'backend', AUTO, f'What computes: the processor, or a device by {CUDA}, which must be there; '
    f'{AUTO}: whichever is quicker.', check=one_of(AUTO, 'cpu', CUDA))


def backend_of(parameters: Mapping[str, Any]) -> str:
    """Backend that the parameters name.

    Raises
    ------
    ConfigurationError
        A device was asked for, and there is none that works, or the processor, without Numba.
    """
    name = parameters[BACKEND.name]
    with refused(f'parameter {BACKEND.name}: ', (DeviceError, MissingNumbaError)):
        backend(name)
    return name


_FLAG = '--params-file'


def merged_arguments(arguments: Sequence[str], name: str, stages: Iterable[str],
                     folder: Path) -> list[str]:
    """Command line whose parameter files speak of one node instead of several.

    Parameters
    ----------
    arguments : sequence of str
        Command line.
    name : str
        Node that takes the sections of the others, beside its own.
    stages : iterable of str
        Nodes whose sections it takes, in any namespace.
    folder : Path
        Where the rewritten files go.

    Returns
    -------
    list of str

    Raises
    ------
    ConfigurationError
        A file cannot be read.
    """
    out = list(arguments)
    # As text: sections of the same node may come several times, and numbers stay as written.
    section = re.compile(rf'^(\s*["\']?(?:\S*/)?)(?:{"|".join(stages)})(["\']?\s*:\s*(?:#.*)?)$',
                         re.MULTILINE)
    for index in range(1, len(out)):
        if out[index - 1] == _FLAG:
            merged = folder / f'{index}.yaml'
            with refused(f'{_FLAG} {out[index]}: ', (OSError, UnicodeDecodeError)):
                merged.write_text(section.sub(rf'\1{name}\2', Path(out[index]).read_text()))
            out[index] = str(merged)
    return out
