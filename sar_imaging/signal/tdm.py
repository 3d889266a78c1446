# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Time-division MIMO: phase centres of transmitters that take turns while the platform moves.

A MIMO radar with N_t transmitters and N_r receivers makes N_t N_r channels from N_t pulses, one
after the other. All of them travel as one pulse of a block, with one time; but each transmitter's
channels belong to a place of their own, ``v dt`` further on. Imaging follows the exact path of
every channel, so that phase centres at the channels' own times are all it needs: the phase that
the motion adds between the turns, ``4 pi v_r dt / lambda``, is then right for every pixel, and no
Doppler has to be estimated or compensated. Phase centres of one time for all displace each
transmitter's image against the others'.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.alignment import Alignment
from ..geometry.poses import PoseTable, PoseTrack
from .positioning import join_turns, locate
from .pulses import PulseBlock


@dataclasses.dataclass(frozen=True)
class TdmSchedule:
    """When the channels of a pulse are sent.

    Parameters
    ----------
    offset_s : (C,) float64
        Time of each channel after the stamp of its pulse, seconds. For FMCW the time that counts
        is that of the carrier frequency: the middle of the samples of the channel's ramp.

    Raises
    ------
    ValueError
        There is no channel, or a number is not finite.
    """

    offset_s: np.ndarray

    def __post_init__(self) -> None:
        offset_s = np.atleast_1d(np.asarray(self.offset_s, float))
        if offset_s.ndim != 1 or not offset_s.size or not np.isfinite(offset_s).all():
            raise ValueError(f'offset_s={self.offset_s}; expected one finite time per channel, '
                             'seconds')
        object.__setattr__(self, 'offset_s', offset_s)

    @classmethod
    def in_turns(cls, n_transmitters: int, n_receivers: int, interval_s: float, *,
                 first_s: float = 0.0) -> TdmSchedule:
        """Transmitters one after the other, channel ``n_receivers * transmitter + receiver``.

        Parameters
        ----------
        n_transmitters, n_receivers : int
            Number of transmitters and number of receivers of the radar.
        interval_s : float
            From one transmitter's turn to the next one's, seconds.
        first_s : float
            Time of the first turn after the pulse's stamp, seconds.
        """
        turn = np.repeat(np.arange(n_transmitters), n_receivers)
        return cls(first_s + interval_s * turn)

    def check_channels(self, n_channels: int) -> None:
        """Raise ValueError when a block has another number of channels."""
        if n_channels != self.offset_s.size:
            raise ValueError(f'the block has {n_channels} channels, the schedule has '
                             f'{self.offset_s.size}; give the time of every channel')


def locate_channels(block: PulseBlock, track: PoseTrack | PoseTable, alignment: Alignment,
                    schedule: TdmSchedule) -> PulseBlock:
    """Phase centres of every channel where the platform is at the channel's own time.

    Parameters
    ----------
    block : PulseBlock
        Pulses of P cycles, with or without positions.
    track : PoseTrack or PoseTable
        Track of the platform, from before the first to after the last turn.
    alignment : Alignment
        Lever arms, time offset and range bias.
    schedule : TdmSchedule
        Turns of the channels.

    Returns
    -------
    PulseBlock
        As `sar_imaging.signal.positioning.locate` makes it for channels of one time; stamps stay.

    Raises
    ------
    ValueError
        The schedule or the lever arms do not fit the channels, or a turn has no pose.
    """
    schedule.check_channels(block.n_channels)
    offsets_ns, turn = np.unique(np.rint(schedule.offset_s * 1e9).astype(np.int64),
                                 return_inverse=True)
    located = [locate(dataclasses.replace(block, stamp_ns=block.stamp_ns + offset_ns), track,
                      alignment) for offset_ns in offsets_ns]
    return dataclasses.replace(join_turns(located, turn), stamp_ns=block.stamp_ns)


def move_channels(block: PulseBlock, velocity_m_per_s: ArrayLike, schedule: TdmSchedule
                  ) -> PulseBlock:
    """Phase centres moved on from the stamps of the pulses to the channels' own times.

    For positions that were given at the stamps. Exact for a platform that neither accelerates
    nor turns within a cycle: 1 m/s^2 over 1 ms is half a micrometre.

    Parameters
    ----------
    block : PulseBlock
        With phase centres at its stamps.
    velocity_m_per_s : (3,) or (P, 3) array_like
        Velocity of the platform at each pulse, imaging frame, metres per second.
    schedule : TdmSchedule
        Turns of the channels.

    Returns
    -------
    PulseBlock

    Raises
    ------
    ValueError
        The block has no phase centres, or shapes do not fit.
    """
    if not block.has_positions:
        raise ValueError('the block has no phase centres to move; use locate_channels')
    schedule.check_channels(block.n_channels)
    velocity = np.asarray(velocity_m_per_s, float)
    if velocity.shape not in ((3,), (block.n_pulses, 3)):
        raise ValueError(f'velocity_m_per_s.shape={velocity.shape}; expected (3,) or '
                         f'({block.n_pulses}, 3)')
    moved = np.broadcast_to(velocity, (block.n_pulses, 3))[:, None] * schedule.offset_s[:, None]
    return dataclasses.replace(block, tx_m=block.tx_m + moved, rx_m=block.rx_m + moved)
