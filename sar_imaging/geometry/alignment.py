# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Lever arms, clock offset and range bias between a radar and the poses of its platform."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation


@dataclasses.dataclass(frozen=True)
class Alignment:
    """Lever arms, clock offset and range bias between the poses of a platform and its radar.

    Parameters
    ----------
    tx_m, rx_m : (1 or C, 3) float64
        Lever arms: transmit and receive phase centres in the body frame of the poses, metres;
        one stands for all channels.
    time_offset_s : float
        Clock of the poses minus clock of the pulses, seconds: a pulse stamped t was sent where
        the platform is at ``t + time_offset_s``.
    range_bias_m : float
        Measured half path minus geometric one, metres, such as half the delay of the cables.

    Raises
    ------
    ValueError
        A shape is wrong or a number is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.spatial.transform import Rotation
    >>> from sar_imaging.geometry.alignment import Alignment
    >>> alignment = Alignment(tx_m=np.array([[0.2, 0.0, -0.4]]), rx_m=np.array([[0.2, 0.1, -0.4]]),
    ...                       time_offset_s=0.015)
    >>> tx_m, rx_m = alignment.phase_centres(np.array([[0.0, 0.0, 10.0]]), Rotation.identity(1), 1)
    >>> rx_m[0, 0].round(3).tolist()
    [0.2, 0.1, 9.6]
    """

    tx_m: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((1, 3)))
    rx_m: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((1, 3)))
    time_offset_s: float = 0.0
    range_bias_m: float = 0.0

    def __post_init__(self) -> None:
        for name in ('tx_m', 'rx_m'):
            centres = np.array(getattr(self, name), np.float64)
            if centres.ndim != 2 or centres.shape[1] != 3 or not len(centres):
                raise ValueError(f'{name}.shape={centres.shape}; expected (channels, 3), metres')
            if not np.isfinite(centres).all():
                raise ValueError(f'{name} holds NaN or infinity; expected metres')
            object.__setattr__(self, name, centres)
        for name in ('time_offset_s', 'range_bias_m'):
            if not math.isfinite(getattr(self, name)):
                raise ValueError(f'{name}={getattr(self, name)} is not finite')

    def as_dict(self) -> dict[str, Any]:
        """Fields by name, of JSON types; `Alignment(**fields)` makes it again."""
        return {'tx_m': self.tx_m.tolist(), 'rx_m': self.rx_m.tolist(),
                'time_offset_s': self.time_offset_s, 'range_bias_m': self.range_bias_m}

    @property
    def time_offset_ns(self) -> int:
        """Time offset to the nanosecond."""
        return round(self.time_offset_s * 1e9)

    @property
    def one_place(self) -> bool:
        """True when the lever arms of all channels are the same."""
        return all((arms == arms[0]).all() for arms in (self.tx_m, self.rx_m))

    def check_channels(self, n_channels: int) -> None:
        """Raise ValueError unless there is one lever arm, or one for each channel."""
        for name in ('tx_m', 'rx_m'):
            if len(getattr(self, name)) not in (1, n_channels):
                raise ValueError(f'{len(getattr(self, name))} lever arms {name} for {n_channels} '
                                 'channels; give one for all or one for each')

    def phase_centres(self, position_m: np.ndarray, attitude: Rotation,
                      n_channels: int) -> tuple[np.ndarray, np.ndarray]:
        """Transmit and receive phase centres of pulses.

        Parameters
        ----------
        position_m : (P, 3) float64
            Platform at the times of the pulses, imaging frame, metres.
        attitude : scipy.spatial.transform.Rotation
            P rotations from the body into the imaging frame.
        n_channels : int
            Number of channels C.

        Returns
        -------
        tx_m, rx_m : (P, C, 3) float64
            Imaging frame, metres.

        Raises
        ------
        ValueError
            There are other numbers of lever arms than one or C.
        """
        self.check_channels(n_channels)
        rotation = attitude.as_matrix()

        def centres(arms: np.ndarray) -> np.ndarray:
            rotated = np.einsum('pij,cj->pci', rotation, arms)
            return np.repeat(position_m[:, None] + rotated, n_channels // rotated.shape[1], axis=1)

        return centres(self.tx_m), centres(self.rx_m)
