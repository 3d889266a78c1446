# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Start the nodes for `evaluate`, with parameters from recording, files and command line."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from sar_imaging.configuration.parameters import (
    default_file,
    interpret,
    load_tree,
    read_configuration,
)
from sar_imaging.configuration.positions import check_positions
from sar_imaging.yaml_text import load_yaml

from ..launching import configured_mode, find_config
from ..node_processes import (
    MODES,
    node_names,
    parameters_from_truth,
    pipeline_parameters,
)

# A replay may be faster than a busy machine takes poses and pulses; the one image counts.
_PATIENCE = {'max_age_s': 3600.0, 'pose.wait_s': 60.0}


class LaunchError(RuntimeError):
    """The nodes cannot be started with what was asked for."""


@dataclasses.dataclass(frozen=True)
class Launch:
    """What the nodes are started with.

    Parameters
    ----------
    nodes : tuple of str
        Names.
    parameters : dict
        By node; files count over them.
    files : tuple of Path
        Parameter files, the last one counts.
    arguments : list of str
        ROS arguments, which count over all files.
    own : bool
        The grid may differ from the recording's.
    """

    nodes: tuple[str, ...]
    parameters: dict[str, Any]
    files: tuple[Path, ...]
    arguments: list[str]
    own: bool


def add_arguments(p: argparse.ArgumentParser) -> None:
    """Options that tell parameters of the nodes."""
    p.add_argument('--config', metavar='FILE',
                   help="with --launch-nodes: the radar's own parameter file, or the name of a "
                        "shipped one, instead of the recording's grid and aperture")
    p.add_argument('--params', type=Path, action='append', default=[], metavar='FILE',
                   help='with --launch-nodes: parameter file whose values count over the others; '
                        'may be given several times')
    p.add_argument('-p', dest='values', type=_value, action='append', default=[],
                   metavar='NAME:=VALUE', help='with --launch-nodes: value of a parameter, which '
                   'counts over all files; may be given several times')


def _value(text: str) -> tuple[str, str]:
    name, assigned, value = text.partition(':=')
    if not (name and assigned):
        raise argparse.ArgumentTypeError(f'{text} is not NAME:=VALUE such as grid.spacing:=0.1')
    return name, value


def plan_launch(arguments: argparse.Namespace, truth: Mapping[str, Any] | None) -> Launch:
    """Nodes and parameters that the command line asks for.

    Parameters
    ----------
    arguments : argparse.Namespace
        With `bag`, `mode`, `pipeline`, `output` and what `add_arguments` adds.
    truth : mapping or None
        Truth of the recording, see `recordings.make_truth`; it proposes grid and aperture without
        a configuration.

    Returns
    -------
    Launch

    Raises
    ------
    LaunchError
        A file or a value is one that no node would take, or nothing tells the grid.
    """
    try:
        config = [find_config(arguments.config)] if arguments.config else []
        files = (*config, *arguments.params)
        for path in files:
            _check_file(path)
    except (ValueError, FileNotFoundError) as error:
        raise LaunchError(str(error)) from error
    _check_values(arguments.values)
    if truth is None and not config:
        raise LaunchError(f'{arguments.bag} has no truth, so no grid to start the nodes with; '
                          "give the radar's parameter file by --config, or start them yourself, "
                          'without --launch-nodes')
    mode = _mode(arguments, files)
    if mode not in MODES:
        raise LaunchError(f'mode: {mode} publishes points of a volume, and evaluate measures '
                          f'images; give --mode {MODES[0]} to measure the lowest layer, or form '
                          'the volume by sar-imaging image --height')
    parameters = {} if config or truth is None else _parameters(truth, mode, arguments.output)
    if arguments.pipeline and parameters:
        parameters = pipeline_parameters(parameters)
    values = [*_patience(files).items(), *arguments.values, ('mode', mode)]
    return Launch(node_names(mode, pipeline=arguments.pipeline), parameters, files,
                  [word for name, value in values for word in ('-p', f'{name}:={value}')],
                  own=bool(files or arguments.values))


def _patience(files: Sequence[Path]) -> dict[str, float]:
    """Values that let a busy machine take its time; a file that asks for its own keeps it.

    A copy of the file of all parameters has the defaults in it, and asks for nothing by them.
    """
    usual, patience = read_configuration(default_file()).nodes, dict(_PATIENCE)
    for path in files:
        for node, values in read_configuration(path).nodes.items():
            for name in _PATIENCE.keys() & values.keys():
                if values[name] != usual[node][name]:
                    patience.pop(name, None)
    return patience


def _parameters(truth: Mapping[str, Any], mode: str, folder: Path) -> dict[str, dict[str, Any]]:
    """Those of the recording; the table of a measured antenna is written to a folder."""
    file = folder / 'antenna.yaml'
    if 'antenna' in truth:
        file.write_text(yaml.safe_dump(truth['antenna']))
    try:
        return parameters_from_truth(truth, mode, pattern_file=str(file.resolve()))
    except ValueError as error:
        raise LaunchError(f'the antenna of the recording cannot be used: {error}') from error


def _mode(arguments: argparse.Namespace, files: Sequence[Path]) -> str:
    """Mode asked for: by the option, else by a value, else by the last file that has one."""
    given = [value for name, value in arguments.values if name == 'mode']
    return arguments.mode or (given or [''])[-1] or next(
        (mode for path in reversed(files) if (mode := configured_mode(path))), MODES[0])


def _check_file(path: Path) -> None:
    """Refuse names and values that the nodes would ignore or choke on."""
    configuration = read_configuration(path)
    acquisition = configuration.acquisition() if configuration.describes_radar else None
    findings = [*configuration.findings, *check_positions(configuration.nodes, acquisition)]
    errors = [f.text for f in findings if f.severity == 'error']
    if errors:
        raise LaunchError(f'{path}: ' + '; '.join(errors))


def _check_values(values: Sequence[tuple[str, str]]) -> None:
    for name, text in values:
        try:
            value = load_yaml(text)
        except yaml.YAMLError as error:
            raise LaunchError(f'-p {name}:={text} is no YAML value') from error
        tree = {'/**': {'ros__parameters': {name: value}}}
        for finding in interpret(tree, load_tree(default_file())).findings:
            raise LaunchError(f'-p {name}:={text}: {finding.text}')
