# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Recorded pulses: bags, CPHD files, and arrays of any layout by a description in YAML.

`open_pulses` is the door: it opens all of these, and gives a `PulseSource` with radar, poses,
frame, datum and blocks of pulses. Behind it, `load` reads arrays, and messages of a radar's
driver, by their description, whose keys docs/loading.md lists; `read_recording`, `read_blocks`,
`read_poses`, `read_truth` and `write_bag` read and write bags of pulses (rosbag2).
"""

import importlib
from typing import Any

# Imported when they are used first: the node of a radar's driver needs no reader of files.
_HOMES = {'BagError': 'bag_io', 'DescriptionError': 'description', 'Loaded': 'arrays',
          'PoseTable': 'poses', 'PulseSource': 'pulse_source', 'Recording': 'recording',
          'SourceError': 'pulse_source', 'find_description': 'description', 'load': 'arrays',
          'make_truth': 'truth', 'open_apertures': 'pulse_source', 'open_pulses': 'pulse_source',
          'read_blocks': 'bag_io', 'read_description': 'description', 'read_poses': 'bag_io',
          'read_recording': 'recording', 'read_truth': 'bag_io', 'shipped_names': 'description',
          'write_bag': 'bag_io'}
__all__ = list(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(importlib.import_module(f'.{_HOMES[name]}', __name__), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
