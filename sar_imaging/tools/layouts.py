# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Write layouts of RViz and Foxglove that fit a radar: its frame, its scene, its namespace.

Run: python -m sar_imaging.tools.layouts automotive_77ghz --output out/layouts
"""

from __future__ import annotations

import argparse
import importlib.resources
import json
import math
import sys
from typing import Any

import yaml

from sar_imaging.configuration.parameters import read_configuration
from sar_imaging.files import filling, naming
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.yaml_text import load_yaml

from .arguments import add_output
from .launching import find_config
from .program import command_parser, main_of

_SHARED = ('/tf', '/diagnostics', '/rosout')  # of all radars
_EPILOG = """\
Writes NAME.rviz and NAME.foxglove.json. What is shipped as sar_imaging.rviz and
sar_imaging.foxglove.json fits the default configuration: frame map, 100 m by 100 m.

  layouts automotive_77ghz --output out/layouts
  rviz2 -d out/layouts/automotive_77ghz.rviz
"""


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = command_parser('layouts', 'Write layouts of RViz and Foxglove that show what a '
                       'configuration images, in its frame and at its size.', _EPILOG)
    p.add_argument('config', help='ROS parameter file, or name of a shipped one')
    add_output(p, 'the layouts')
    p.add_argument('--namespace', default='', metavar='NAME',
                   help='namespace of the nodes, such as radar1 (default: none)')
    return p


def run(arguments: argparse.Namespace) -> str:
    """Write both layouts; returns a line about them."""
    path = find_config(arguments.config)
    configuration = read_configuration(path)
    if configuration.findings:
        raise ValueError(f'{path}: {configuration.findings[0].text}')
    with naming(path, 'describes no map'):
        grid = configuration.imaging().grid
    frame = configuration.nodes['backprojection']['frame_id']
    names = [f'{path.stem}{suffix}' for suffix in ('.rviz', '.foxglove.json')]
    with filling(arguments.output) as folder:
        rviz = rviz_layout(grid, frame, arguments.namespace)
        (folder / names[0]).write_text(yaml.safe_dump(rviz, sort_keys=False))
        foxglove = foxglove_layout(grid, frame, arguments.namespace)
        (folder / names[1]).write_text(json.dumps(foxglove, indent=2) + '\n')
    return f'written: {", ".join(str(arguments.output / name) for name in names)}'


def _shipped(name: str) -> str:
    return (importlib.resources.files('sar_imaging') / 'resource' / name).read_text()


def _extent(grid: MapGrid) -> float:
    """Longer side of the image, metres."""
    return max(grid.n_x, grid.n_y) * grid.spacing_m


def _cell(extent_m: float) -> float:
    """About a tenth of the image, 1, 2 or 5 times a power of ten, metres."""
    exponent = math.floor(math.log10(extent_m / 10))
    return min((m * 10.0 ** e for m in (1, 2, 5) for e in (exponent, exponent + 1)),
               key=lambda cell: abs(math.log(cell * 10 / extent_m)))


def _in_namespace(topic: str, namespace: str) -> str:
    name = namespace.strip('/')
    return topic if not name or topic in _SHARED else f'/{name}{topic}'


def rviz_layout(grid: MapGrid, frame: str, namespace: str = '') -> dict[str, Any]:
    """The shipped configuration of RViz, moved to a grid.

    Parameters
    ----------
    grid : MapGrid
        Pixels of the images.
    frame : str
        Their frame.
    namespace : str
        Namespace of the nodes.

    Returns
    -------
    dict
        Content of a YAML file.
    """
    layout = load_yaml(_shipped('sar_imaging.rviz'))
    extent, cell = _extent(grid), _cell(_extent(grid))
    x, y, z = grid.centre_m
    manager = layout['Visualization Manager']
    manager['Global Options']['Fixed Frame'] = frame
    # Half of a window that is 1000 pixels high.
    manager['Views']['Current'] |= {'Scale': round(500 / extent, 4), 'X': x, 'Y': y}
    for display in manager['Displays']:
        for key in ('Topic', 'Update Topic'):
            if key in display:
                display[key]['Value'] = _in_namespace(display[key]['Value'], namespace)
        kind = display['Class'].rsplit('/', 1)[-1]
        if kind == 'Grid':
            display |= {'Cell Size': cell, 'Plane Cell Count': round(5 * extent / cell),
                        'Offset': {'X': x, 'Y': y, 'Z': z}}
        elif kind == 'TF':
            display['Marker Scale'] = round(extent / 20, 4)
        elif kind == 'PointCloud2':
            display['Size (m)'] = round(extent / 100, 4)
    return layout


def foxglove_layout(grid: MapGrid, frame: str, namespace: str = '') -> dict[str, Any]:
    """The shipped layout of Foxglove, moved to a grid; parameters as `rviz_layout`."""
    layout = json.loads(_shipped('sar_imaging.foxglove.json'))
    extent, cell = _extent(grid), _cell(_extent(grid))
    for panel in layout['configById'].values():
        if 'imageMode' in panel:
            panel['imageMode'] = {
                key: _in_namespace(value, namespace) if key.endswith('Topic') else value
                for key, value in panel['imageMode'].items()}
        if panel.get('topics'):
            panel['topics'] = {_in_namespace(topic, namespace): settings
                               for topic, settings in panel['topics'].items()}
        if 'followTf' in panel:
            panel['followTf'] = frame
            panel['cameraState'] |= {'distance': round(1.5 * extent, 4),
                                     'targetOffset': list(grid.centre_m)}
            panel['layers']['grid'] |= {
                'size': round(5 * extent, 4), 'divisions': round(5 * extent / cell),
                'frameId': frame, 'position': list(grid.centre_m)}
    return layout


main = main_of(parser, run)

if __name__ == '__main__':
    sys.exit(main())
