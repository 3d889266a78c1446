# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Phase centres of a radar as functions of time, before, during and after an aperture.

Where the clocks of pulses and positions differ, the positions of an aperture lie elsewhere on the
track: before its first pulse, or after its last one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.alignment import Alignment
from ..geometry.poses import PoseTable, PoseTrack
from ..signal.pulses import PulseBlock
from .models import Geometry, GeometryModel

_FEWEST_KNOTS = 4  # of an unbroken piece; shorter ones are of no use
BEYOND = 0.1  # of its length that a track of pulses is continued at each end


class PhaseCentreTrack:
    """Transmit and receive phase centres at any time that is covered.

    Parameters
    ----------
    stamp_ns : (N,) int64
        Ascending times, nanoseconds, on the clock of the pulses.
    tx_m, rx_m : (N, C, 3) float64
        Phase centres at these times, metres.
    piece : (N,) int array_like
        Number of the unbroken piece of track that each belongs to, ascending.
    beyond_s : float
        How far each piece is continued at its ends, seconds.
    channel_offset_s : (1 or C,) array_like
        When each channel is sent after the stamp of its pulse, seconds.

    Examples
    --------
    >>> from sar_imaging.autofocus.track import PhaseCentreTrack
    >>> from sar_imaging.simulation import SCENARIOS
    >>> blocks = list(SCENARIOS['psf']().blocks(50))  # flies at 200 m/s along y
    >>> track = PhaseCentreTrack.of_pulses(blocks)
    >>> stamp_ns = blocks[0].stamp_ns[20:21]
    >>> now, later = (track.at(stamp_ns, offset_s)[0][0, 0, 1] for offset_s in (0.0, 0.1))
    >>> print(f'{later - now:.2f} m further after 0.1 s')
    20.00 m further after 0.1 s
    >>> track.covers(stamp_ns, offset_s=10.0)
    False
    """

    def __init__(self, stamp_ns: ArrayLike, tx_m: np.ndarray, rx_m: np.ndarray,
                 piece: ArrayLike | None = None, *, beyond_s: float = 0.0,
                 channel_offset_s: ArrayLike = (0.0,)) -> None:
        # scipy.interpolate takes its time to import, a node without autofocus need not wait
        from scipy.interpolate import CubicSpline

        stamp_ns = np.asarray(stamp_ns, np.int64)
        self._epoch_ns = int(stamp_ns[0]) if len(stamp_ns) else 0
        time_s = (stamp_ns - self._epoch_ns) * 1e-9
        piece = np.zeros(len(time_s), int) if piece is None else np.asarray(piece)
        centres = np.stack([tx_m, rx_m], axis=1)
        self._beyond_s = beyond_s
        self._offset_s = np.asarray(channel_offset_s, float)
        self._pieces = []
        for number in np.unique(piece):
            some = piece == number
            if some.sum() >= _FEWEST_KNOTS:
                self._pieces.append(CubicSpline(time_s[some], centres[some]))

    @classmethod
    def of_poses(cls, poses: PoseTrack | PoseTable, alignment: Alignment, n_channels: int,
                 span_ns: tuple[int, int], channel_offset_s: ArrayLike = (0.0,)
                 ) -> PhaseCentreTrack:
        """Track of a platform.

        Parameters
        ----------
        poses : PoseTrack or PoseTable
            Poses of the platform, on its clock.
        alignment : Alignment
            Nominal lever arms and offset of the clocks.
        n_channels : int
            Number of channels C.
        span_ns : (2,) int
            First and last time of interest on the clock of the pulses, nanoseconds.
        channel_offset_s : (1 or C,) array_like
            When each channel is sent after the stamp of its pulse, seconds.
        """
        shift = alignment.time_offset_ns
        stamp_ns, position_m, attitude, piece = poses.between(span_ns[0] + shift,
                                                              span_ns[1] + shift)
        tx_m, rx_m = alignment.phase_centres(position_m, attitude, n_channels)
        return cls(stamp_ns - shift, tx_m, rx_m, piece, channel_offset_s=channel_offset_s)

    @classmethod
    def of_pulses(cls, blocks: Sequence[PulseBlock]) -> PhaseCentreTrack:
        """Track of the phase centres that came with pulses, in the order of their times.

        A tenth of its duration more is taken for known at each end. Other times are those of no
        pulse, and nothing is known about them.
        """
        stamp_ns = np.concatenate([b.stamp_ns for b in blocks])
        tx_m, rx_m = (np.concatenate(c) for c in zip(*(b.centres_m for b in blocks), strict=True))
        if np.any(np.diff(stamp_ns) <= 0):
            raise ValueError('the times of the pulses do not ascend; autofocus takes errors for '
                             'functions of time, give every pulse its own')
        beyond_s = BEYOND * (stamp_ns[-1] - stamp_ns[0]) * 1e-9
        return cls(stamp_ns, tx_m, rx_m, beyond_s=beyond_s)

    def covers(self, stamp_ns: ArrayLike, offset_s: float) -> bool:
        """Whether all times are known, read later by an offset."""
        return bool((self._piece_of(self._times(stamp_ns, offset_s)) >= 0).all())

    def at(self, stamp_ns: ArrayLike, offset_s: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Phase centres at times read later by an offset.

        Parameters
        ----------
        stamp_ns : (P,) int64
            Times of the pulses, nanoseconds.
        offset_s : float
            What is added to them, seconds.

        Returns
        -------
        tx_m, rx_m : (P, C, 3) float64
            Metres.

        Raises
        ------
        ValueError
            Some of the times are not covered.
        """
        times = self._times(stamp_ns, offset_s)
        piece = self._piece_of(times)
        if (piece < 0).any():
            raise ValueError(f'no position is known for {int((piece < 0).any(axis=0).sum())} of '
                             f'{piece.shape[1]} pulses at an offset of {offset_s:.3g} s')
        out = np.empty((piece.shape[1], *self._pieces[0].c.shape[2:]))  # as splines have them
        for turn, (time_s, owner) in enumerate(zip(times, piece, strict=True)):
            for number in np.unique(owner):
                there = np.flatnonzero(owner == number)
                centres = self._pieces[number](time_s[there])
                channel = slice(None) if len(times) == 1 else slice(turn, turn + 1)
                out[there, :, channel] = centres[:, :, channel]
        return out[:, 0], out[:, 1]

    def _times(self, stamp_ns: ArrayLike, offset_s: float) -> np.ndarray:
        """(T, P) seconds, of each of the channels' times."""
        time_s = (np.asarray(stamp_ns, np.int64) - self._epoch_ns) * 1e-9 + offset_s
        return time_s + self._offset_s[:, None]

    def _piece_of(self, time_s: np.ndarray) -> np.ndarray:
        """Piece that each time lies in; -1 for none."""
        out = np.full(time_s.shape, -1)
        for number, spline in enumerate(self._pieces):
            first, last = spline.x[[0, -1]] + (-self._beyond_s, self._beyond_s)
            out[(time_s >= first) & (time_s <= last)] = number
        return out


def on_track(block: PulseBlock, track: PhaseCentreTrack, *, scale_s: float) -> GeometryModel:
    """Model of an offset between the clocks of pulses and positions.

    Parameters
    ----------
    block : PulseBlock
        Pulses.
    track : PhaseCentreTrack
        Positions belong to the times of the pulses plus the offset.
    scale_s : float
        Expected size of the offset, seconds.

    Returns
    -------
    GeometryModel
        Of `time_offset_s`; it raises ValueError where the track is not known.

    Examples
    --------
    >>> from sar_imaging.autofocus.track import PhaseCentreTrack, on_track
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(iter(SCENARIOS['psf']().blocks(100)))
    >>> model = on_track(block, PhaseCentreTrack.of_pulses([block]), scale_s=0.1)
    >>> list(model.names), [float(v) for v in model.scale]
    (['time_offset_s'], [0.1])
    """
    def geometry(offset: np.ndarray) -> Geometry:
        return Geometry(*track.at(block.stamp_ns, float(offset[0])))

    return GeometryModel(['time_offset_s'], np.zeros(1), np.array([scale_s]), geometry)
