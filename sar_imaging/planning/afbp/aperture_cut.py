"""Cut of an aperture into sub-apertures."""

from __future__ import annotations

import math

import numpy as np

_GAP = 4.0  # times the usual distance between pulses


def pieces_between_gaps(middles) -> list[tuple[int, int]]:
    """First pulse, and the one after the last, of what lies between gaps of a track.

    Parameters
    ----------
    middles : (P, 3) float64
        Mean phase centre of each pulse, metres.
    """
    steps = np.linalg.norm(np.diff(middles, axis=0), axis=1)
    usual = np.median(steps) if len(steps) else 0.0
    gaps = (np.flatnonzero(steps > _GAP * usual) + 1).tolist() if usual > 0 else []
    return list(zip([0, *gaps], [*gaps, len(middles)], strict=True))


def cut_pulses(pieces, length: int) -> list[slice]:
    """Sub-apertures of about equal length that do not reach across gaps of the track.

    Parameters
    ----------
    pieces : list of (int, int)
        From `pieces_between_gaps`.
    length : int
        Most pulses of a sub-aperture.
    """
    cuts = []
    for start, stop in pieces:
        edges = np.linspace(start, stop, math.ceil((stop - start) / length) + 1)
        edges = edges.round().astype(int).tolist()
        cuts += map(slice, edges[:-1], edges[1:])
    return cuts
