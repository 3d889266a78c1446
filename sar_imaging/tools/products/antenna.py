"""Where the antenna looked at each pulse of a source, as reading it tells."""

from __future__ import annotations

import dataclasses

import numpy as np

from sar_imaging.formats import Acquisition
from sar_imaging.geometry.illumination import Pointing

from .sources import Source, SourceError

_BLOCK_BYTES = 1e8  # of samples that are read for their pointing


def lit_acquisition(source: Source, looks: Pointing | None = None) -> Acquisition:
    """Acquisition of a source, with its antenna where the file tells one.

    `looks` is what `pointing_of` said, where that was asked before.
    """
    return dataclasses.replace(source.acquisition(), antenna=source.illumination,
                               pointing=_by_time(source, looks or pointing_of(source)))


def _by_time(source: Source, looks: Pointing | None) -> Pointing | None:
    """Pointing in the order of an acquisition."""
    return None if looks is None else looks.select(np.argsort(source.stamp_ns, kind='stable'))


def pointing_of(source: Source) -> Pointing | None:
    """Pointing of the pulses of a source, in the order of their counters.

    None where the file tells no antenna. Its samples are read through once.

    Raises
    ------
    SourceError
        It tells an antenna, and some pulses do not tell where that looked.
    """
    if source.illumination is None:
        return None
    counters, parts = [], []
    for block in source.read(_BLOCK_BYTES):
        if block.pointing is None:
            raise SourceError(f'{source.path} tells its antenna, and pulses do not tell where '
                              'it looked; add their pointing, or the mount of the antenna, or '
                              'leave the antenna out')
        counters.append(block.counter)
        parts.append(block.pointing)
    return Pointing.join(parts).select(np.argsort(np.concatenate(counters), kind='stable'))
