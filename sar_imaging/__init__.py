# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Multichannel synthetic aperture radar imaging for ROS 2.

Pulses with phase centres go in, focused complex images come out::

    profiles = RangeCompressor.for_block(raw)(raw)
    imager = plan_image(MapGrid((x, y, 0.0), n_x, n_y, 0.25), profiles.radar, profiles.n_samples)
    image = imager(profiles)

What is listed here is enough for that; each package lists the rest.
"""

import importlib
from typing import Any

from .companion import check_companion

__version__ = '0.2.0'

# Imported when they are used first: nodes that form no images need no imager.
_HOMES = {'Image': 'imaging.image', 'Imager': 'imaging.imager', 'MapGrid': 'geometry',
          'PulseBlock': 'signal', 'RadarParameters': 'signal',
          'RangeCompressor': 'signal.range_compression', 'Waveform': 'signal',
          'concatenate': 'signal', 'plan_image': 'imaging.imager'}
__all__ = list(_HOMES)

check_companion()


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(importlib.import_module(f'.{_HOMES[name]}', __name__), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
