# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The virtual array of a description: phase centres of all channels, and when each is sent."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from ..signal.calibration import ChannelCalibration
from ..signal.tdm import TdmSchedule
from .description import DescriptionError, Section, of_part

_WIDEST = 300  # wavelengths between the antennas of a radar, more than a metre at 77 GHz
KEYS = ('tx_m', 'rx_m', 'turn_interval_s', 'turn_order')


@dataclasses.dataclass(frozen=True)
class VirtualArray:
    """Channels of a radar with several antennas.

    Parameters
    ----------
    tx_m, rx_m : (C, 3) float64
        Phase centres of each channel on the radar, metres.
    offset_s : (C,) float64
        When each channel is sent after the stamp of its pulse, seconds.
    """

    tx_m: np.ndarray
    rx_m: np.ndarray
    offset_s: np.ndarray

    @property
    def schedule(self) -> TdmSchedule | None:
        """Turns of the channels; None where all are sent at once."""
        return TdmSchedule(self.offset_s) if self.offset_s.any() else None

    def doubts(self, wavelength_m: float) -> tuple[str, ...]:
        """Text on antennas so far apart that they are hardly on one radar."""
        extent_m = float(np.ptp(np.concatenate([self.tx_m, self.rx_m]), axis=0).max())
        if extent_m < _WIDEST * wavelength_m:
            return ()
        return (f'the antennas of array.tx_m and array.rx_m are {extent_m:.4g} m apart, '
                f'{extent_m / wavelength_m:.0f} wavelengths: expected metres, 2 mm are 0.002',)


def read_array(section: Section, n_channels: int, n_receivers: int | None = None) -> VirtualArray:
    """Virtual array of a description.

    Parameters
    ----------
    section : Section
        The part ``array``; without keys all channels are in the origin.
    n_channels : int
        Channels of the samples; channel ``n_receivers * transmitter + receiver``.
    n_receivers : int, optional
        Where the samples tell it.

    Raises
    ------
    DescriptionError
        Antennas and channels do not fit.
    """
    tx_m = section.vectors('tx_m', np.zeros((1, 3)))
    rx_m = section.vectors('rx_m', np.zeros((1, 3)))
    if 'tx_m' not in section and 'rx_m' not in section:
        rx_m = np.repeat(rx_m, n_channels, axis=0)
    if len(tx_m) * len(rx_m) != n_channels or n_receivers not in (None, n_channels, len(rx_m)):
        found = (f'{n_channels} channels' if n_receivers in (None, n_channels) else
                 f'{n_channels // n_receivers} transmitters and {n_receivers} receivers')
        raise section.error('rx_m' if 'rx_m' in section else 'tx_m',
                            f'antennas for {found}',
                            f'there are {len(tx_m)} in tx_m and {len(rx_m)} in rx_m')
    turn = section.array('turn_order', np.arange(len(tx_m), dtype=float)).reshape(-1)
    if sorted(turn.tolist()) != list(range(len(tx_m))):
        raise section.error('turn_order', 'the turn of each transmitter of tx_m, each of '
                            f'{list(range(len(tx_m)))} once')
    interval_s = section.number('turn_interval_s', 0.0)
    if interval_s < 0 or ('turn_order' in section and not interval_s):
        raise section.error('turn_interval_s', 'seconds from transmitter to transmitter')
    return VirtualArray(np.repeat(tx_m, len(rx_m), axis=0), np.tile(rx_m, (len(tx_m), 1)),
                        np.repeat(turn * interval_s, len(rx_m)))


def calibration_weights(path: Path | str, n_channels: int, *, real_samples: bool
                        ) -> np.ndarray:
    """(C, 1) complex64 factors that remove the errors of a calibration file from raw samples.

    Raises
    ------
    DescriptionError
        The file is for other channels or tells what raw samples cannot be rid of.
    """
    with of_part('calibration'):
        calibration = ChannelCalibration.load(path)
        calibration.check_channels(n_channels)
    if calibration.delay_s.any() or (real_samples and calibration.phase_rad.any()):
        raise DescriptionError(
            f'calibration: {path} has delays, or phases for real samples, which can only be '
            'removed from range profiles; give it to range_compression as calibration_file')
    return calibration.weights[:, None]
