# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Read ROS parameter files as settings of the nodes, and find names that no node reads.

A node ignores silently what a file says for a misspelt node or parameter; here it is an error.
"""

from __future__ import annotations

import dataclasses
import importlib.resources
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

from ..files import naming
from ..geometry.grids import MapGrid
from ..names import advice_on
from ..signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from ..yaml_text import line_of, read_yaml
from .antenna import antenna_of
from .constraints import Finding
from .settings import Acquisition, Imaging, Machine

CHECKER = 'check_config'  # the section that only the checker reads
COMMON = '**'
PIPELINE = 'sar_pipeline'  # has the parameters of all nodes
OF_EVERY_NODE = ('use_sim_time', 'start_type_description_service')  # rclpy's; `ros2 param dump`
# Nodes with few of the parameters that the others have in common.
_FEW_COMMON = {'radar_driver': ('queue_depth', 'autostart'),
               'localization': ('frame_id', 'stall_timeout_s', 'autostart')}
IN_WORDS = {float: 'a number', int: 'a whole number', str: 'a text', bool: 'true or false',
            list: 'a list of numbers'}  # values of parameters
# Those of the checker's section: default and, where there is none, its type.
CHECKER_PARAMETERS = {
    'radar.waveform': 'lfm', 'radar.compressed': False, 'radar.carrier_hz': float,
    'radar.bandwidth_hz': float, 'radar.sample_rate_hz': 0.0, 'radar.pulse_length_s': 0.0,
    'radar.propagation_speed_m_per_s': SPEED_OF_LIGHT, 'radar.range_start_m': float,
    'radar.samples_per_pulse': int, 'radar.channels': 1,
    'radar.channel_spacing_m': 0.0, 'radar.prf_hz': float, 'radar.beamwidth_deg': 0.0,
    'platform.centre_x': float, 'platform.centre_y': float, 'platform.centre_z': float,
    'platform.velocity_x': float, 'platform.velocity_y': float, 'platform.velocity_z': 0.0,
    'machine.pixel_pulses_per_s': 0.0, 'machine.memory_megabytes': 0.0,
}


_SECTIONS = {'autofocus_': 'autofocus.', 'subaperture_': 'subapertures.', 'volume_': 'volume.',
             'radiometry_': 'radiometry.'}
_FIELDS = {f.name: re.sub(f'^({"|".join(_SECTIONS)})', lambda m: _SECTIONS[m[0]], f.name)
           for f in dataclasses.fields(Imaging) if f.name != 'grid'}


# Name of a node, its line, and its parameters: value and line
_Section: TypeAlias = 'tuple[str, int | None, dict[str, tuple[object, int | None]]]'


class ConfigurationFileError(ValueError):
    """A parameter file cannot be read; the text says where and why."""


@dataclasses.dataclass(frozen=True)
class Configuration:
    """What a parameter file says.

    Parameters
    ----------
    nodes : dict
        Values of each node by name, defaults filled in.
    checker : dict
        Values of the checker's section; empty without one.
    findings : tuple of Finding
        Names and values that no node would take.
    """

    nodes: dict[str, dict[str, Any]]
    checker: dict[str, Any]
    findings: tuple[Finding, ...]

    @property
    def describes_radar(self) -> bool:
        """True when the file has the numbers of radar and platform."""
        return bool(self.checker)

    def imaging(self) -> Imaging:
        """Settings of the nodes.

        Raises
        ------
        ValueError
            A value makes no sense.
        """
        imager = self.nodes['backprojection']
        of_images = self.nodes['afbp_fusion'] if imager['mode'] == 'subapertures' else imager
        return imaging_from_parameters(
            {**self.nodes['pulse_buffer'], **self.nodes['range_compression'], **imager,
             'radiometry.quantity': of_images['radiometry.quantity']})

    def acquisition(self) -> Acquisition:
        """Radar and platform.

        Raises
        ------
        ValueError
            A number is missing or makes no sense.
        """
        missing = [name for name, value in self.checker.items() if isinstance(value, type)]
        if missing or not self.checker:
            raise ValueError(f'section {CHECKER} lacks '
                             f'{", ".join(missing) or "the numbers of radar and platform"}')
        antenna = antenna_of(self.nodes['backprojection'])
        known = self.checker['radar.beamwidth_deg']
        width = math.degrees(antenna.amplitudes().azimuth.width_rad) if antenna else 0.0
        return _acquisition({**self.checker, 'radar.beamwidth_deg': known or width})

    def machine(self) -> Machine:
        """Where the nodes run: as the file says, else this computer."""
        return Machine.this_one(self.checker.get('machine.pixel_pulses_per_s', 0.0),
                                round(1e6 * self.checker.get('machine.memory_megabytes', 0.0)))


def default_file() -> Path:
    """File with every parameter of every node and its default.

    Returns
    -------
    pathlib.Path
        ``config/sar_imaging.yaml`` of the package.

    Examples
    --------
    >>> from sar_imaging.configuration.parameters import default_file
    >>> default_file().name
    'sar_imaging.yaml'
    """
    return Path(str(importlib.resources.files('sar_imaging') / 'config' / 'sar_imaging.yaml'))


def foreign(names: Iterable[str]) -> list[str]:
    """Those of some names of parameters that no node of this package knows.

    Parameters
    ----------
    names : iterable of str
        Names that a node was given, such as all of a section ``/**``.

    Returns
    -------
    list of str
        Sorted; without those that rclpy reads itself.

    Examples
    --------
    >>> from sar_imaging.configuration.parameters import foreign
    >>> foreign(['spcing', 'grid.spacing', 'use_sim_time'])
    ['spcing']
    """
    names = [name for name in names
             if name not in OF_EVERY_NODE and not name.startswith('qos_overrides.')]
    if not names:
        return []
    known = {name for _, _, values in _sections(load_tree(default_file())) for name in values}
    return sorted(set(names) - known)


def read_configuration(path: Path | str, given: Mapping[str, object] = MappingProxyType({})
                       ) -> Configuration:
    """Read a ROS parameter file as the nodes would.

    Parameters
    ----------
    path : path
        YAML file.
    given : mapping
        Values by name that every node gets besides, as by ``-p``; they override the file.

    Returns
    -------
    Configuration

    Raises
    ------
    ConfigurationFileError
        The file cannot be read, or is no ROS parameter file.

    Examples
    --------
    >>> from sar_imaging.configuration.parameters import read_configuration
    >>> with open('drone.yaml', 'w') as file:
    ...     _ = file.write('''
    ... backprojection:
    ...   ros__parameters:
    ...     grid.size_x: 60.0
    ...     grid.size_z: 3.0
    ... ''')
    >>> configuration = read_configuration('drone.yaml')
    >>> configuration.nodes['backprojection']['grid.size_x']
    60.0
    >>> for finding in configuration.findings:
    ...     print(finding.severity + ':', finding.text)
    error: line 5: section 'backprojection' has grid.size_z, which no node reads; did you mean ...
    """
    tree = load_tree(path)
    with naming(path, 'is no parameter file', ConfigurationFileError):
        return interpret(tree, load_tree(default_file()), given)


def interpret(tree: object, defaults: object,
              given: Mapping[str, object] = MappingProxyType({})) -> Configuration:
    """What a parsed parameter file says.

    Parameters
    ----------
    tree, defaults : mapping
        The file, and the one with every parameter and its default.
    given : mapping
        As for `read_configuration`.

    Raises
    ------
    ConfigurationFileError
        The tree is no ROS parameter file.
    """
    known: dict[str, dict[str, Any]] = {}
    for node, _, values in _sections(defaults):
        known.setdefault(node, {}).update({name: value for name, (value, _) in values.items()})
    common = known.pop(COMMON, {}) | known.pop(PIPELINE, {})
    nodes = {node: {**_common_of(node, common), **values} for node, values in known.items()}
    nodes.setdefault(CHECKER, dict(CHECKER_PARAMETERS))
    findings: list[Finding] = []
    described = False
    for node, line, values in _sections(tree):
        described |= node == CHECKER
        for_all = node in (COMMON, PIPELINE)
        if not for_all and node not in nodes:
            findings.append(Finding('error', f'{_at(line)}section {node!r} names no node; '
                                    + advice_on(node, [*nodes, PIPELINE, '/**'])))
            continue
        targets = nodes if for_all else {node: nodes[node]}
        for name, (value, at) in values.items():
            findings += _set(targets, f'{_at(at)}section {node!r}', name, value)
    for name, value in given.items():
        findings += _set(nodes, 'argument -p', name, value)
    checker = nodes.pop(CHECKER)
    return Configuration(nodes, checker if described else {}, tuple(findings))


def _at(line: int | None) -> str:
    return '' if line is None else f'line {line}: '


def _common_of(node: str, common: Mapping[str, object]) -> dict[str, object]:
    """Those of the common parameters that a node has."""
    names = _FEW_COMMON.get(node, common)
    return {name: value for name, value in common.items() if name in names}


def imaging_from_parameters(values: Mapping[str, Any]) -> Imaging:
    """Settings from parameters of the nodes.

    Parameters
    ----------
    values : mapping
        Parameters by name, such as ``grid.size_x``; those of no interest are ignored.

    Raises
    ------
    ValueError
        A value makes no sense.
    """
    fields = {name: parameter for name, parameter in _FIELDS.items() if parameter in values}
    grid = MapGrid.from_size(tuple(values[f'grid.centre_{axis}'] for axis in 'xyz'),
                             values['grid.size_x'], values['grid.size_y'],
                             values['grid.spacing'])
    return Imaging(grid=grid, **{name: values[parameter] for name, parameter in fields.items()})


def _acquisition(v: Mapping[str, Any]) -> Acquisition:
    name = v['radar.waveform']
    if name.upper() not in Waveform.__members__:
        kinds = ', '.join(w.name.lower() for w in Waveform)
        raise ValueError(f'radar.waveform={name!r} is unknown; use one of {kinds}')
    bandwidth, length = v['radar.bandwidth_hz'], v['radar.pulse_length_s']
    rate = v['radar.sample_rate_hz'] or bandwidth
    waveform, speed = Waveform[name.upper()], v['radar.propagation_speed_m_per_s']
    if not speed > 0:
        raise ValueError(f'radar.propagation_speed_m_per_s={speed} must be positive')
    if waveform.is_ramp:  # the bandwidth is what samples sweep
        length = v['radar.samples_per_pulse'] / rate
    radar = RadarParameters(
        carrier_hz=v['radar.carrier_hz'], bandwidth_hz=bandwidth, sample_rate_hz=rate,
        first_sample_delay_s=2 * v['radar.range_start_m'] / speed,
        pulse_length_s=length, chirp_rate_hz_per_s=bandwidth / length if length > 0 else 0.0,
        waveform=waveform, propagation_speed_m_per_s=speed)
    return Acquisition(
        radar=radar, compressed=v['radar.compressed'], n_samples=v['radar.samples_per_pulse'],
        n_channels=v['radar.channels'], prf_hz=v['radar.prf_hz'],
        centre_m=tuple(v[f'platform.centre_{axis}'] for axis in 'xyz'),
        velocity_m_per_s=tuple(v[f'platform.velocity_{axis}'] for axis in 'xyz'),
        channel_spacing_m=v['radar.channel_spacing_m'],
        beamwidth_rad=math.radians(v['radar.beamwidth_deg']))


def load_tree(path: Path | str) -> object:
    """Content of a YAML file.

    Raises
    ------
    ConfigurationFileError
        It cannot be read.
    """
    try:
        return read_yaml(path)
    except ValueError as error:
        raise ConfigurationFileError(f'{error}') from error


def _sections(tree: object) -> Iterator[_Section]:
    """Name of the node, ``**`` for all, and its line; value and line of its parameters."""
    if not isinstance(tree, dict) or not tree:
        raise ConfigurationFileError('a parameter file has sections such as '
                                     '/**/backprojection: with ros__parameters: below')
    for key, value in tree.items():
        yield from _section(str(key), value, line_of(tree, key))


def _section(name: str, value: object, line: int | None) -> Iterator[_Section]:
    if not isinstance(value, dict) or not value:
        raise ConfigurationFileError(f'section {name!r} has no ros__parameters: below it')
    for key, content in value.items():
        if key == 'ros__parameters':
            if not isinstance(content, dict):
                raise ConfigurationFileError(f'ros__parameters of {name!r} has no parameters')
            yield name.strip('/').split('/')[-1], line, dict(_flatten(content))
        else:
            yield from _section(f'{name}/{str(key).strip("/")}', content, line_of(value, key))


def _flatten(tree: Mapping[str, object], prefix: str = ''
             ) -> Iterator[tuple[str, tuple[object, int | None]]]:
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from _flatten(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', (value, line_of(tree, key))


def as_kind(value: Any, kind: type) -> Any:
    """Value of a parameter of a type, for which whole numbers are numbers; None if it is none."""
    if kind is float and type(value) is int:
        value = float(value)
    numbers = value if isinstance(value, list) else [value] if kind is float else []
    fits = type(value) is kind and all(
        type(v) in (int, float) and math.isfinite(v) for v in numbers)
    return value if fits else None


def _set(targets: Mapping[str, dict[str, Any]], place: str, name: str, value: object
         ) -> Iterator[Finding]:
    """Set a parameter of the nodes that have it; says why it cannot be set."""
    if name in OF_EVERY_NODE or name.startswith('qos_overrides.'):
        return
    having = [values for values in targets.values() if name in values]
    if not having:
        names = sorted({n for values in targets.values() for n in values})
        yield Finding('error', f'{place} has {name}, which no node reads; '
                      + advice_on(name, names))
    for values in having:
        default = values[name]
        kind = default if isinstance(default, type) else type(default)
        found = as_kind(value, kind)
        if found is None:
            hint = ' such as 1.0e+9' if kind is float else ''
            yield Finding('error', f'{place}: {name}: expected {IN_WORDS[kind]}{hint}, got '
                          f'{value!r}')
            return
        if kind is list and len({type(v) for v in found}) > 1:
            yield Finding('error', f'{place}: {name}={value!r} mixes whole numbers '
                          'and others, which ROS refuses; write all of them with a point')
            return
        values[name] = found
