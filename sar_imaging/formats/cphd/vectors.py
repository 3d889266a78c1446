# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of vectors that were received at the same time: what becomes pulses of a block."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from ...signal.radar import SPEED_OF_LIGHT
from .container import Container, CphdError

SAME_TIME_S = 5e-10  # half of the nanosecond that stamps resolve
_EARTH_M = (6.3e6, 6.5e6)  # distances of reference points from the Earth's centre
_ORBIT_M = 5e7  # farthest antenna from the Earth's centre; geostationary orbits are at 4.2e7
_FASTEST = 2e4  # metres per second, of antennas; satellites fly at 8 km/s
_NEAR_M = 1e3  # within which antennas may take turns
NORMAL = 1  # value of the parameter SIGNAL


@dataclasses.dataclass(frozen=True)
class Vectors:
    """Parameters of the vectors of channels that coincide, those without signal left out.

    Parameters
    ----------
    index : (P,) int64
        Number of each vector in the file.
    tx_s : (P,) float64
        Transmission, seconds since the collection's start.
    tx_m, rx_m, reference_m : (P, C, 3) float64
        Transmit and receive phase centre and reference point, ECEF, metres.
    fx_hz : (P, C, 2) float64
        Lowest and highest frequency saved.
    toa_s : (P, C, 2) float64
        Earliest and latest delay saved, from that of the reference point.
    first, step : (P, C) float64
        First coordinate of the samples and their spacing, hertz or seconds.
    amplitude : (P, C) float64
        Factor of the samples.
    normal : (P, C) bool
        False where a channel has no signal.
    tropospheric_s : float
        Largest delay of the troposphere that the file allows for at the reference point.
    """

    index: np.ndarray
    tx_s: np.ndarray
    tx_m: np.ndarray
    rx_m: np.ndarray
    reference_m: np.ndarray
    fx_hz: np.ndarray
    toa_s: np.ndarray
    first: np.ndarray
    step: np.ndarray
    amplitude: np.ndarray
    normal: np.ndarray
    tropospheric_s: float

    @property
    def reference_delay_s(self) -> np.ndarray:
        """(P, C) float64 two-way delay of the reference point through vacuum, seconds."""
        return (np.linalg.norm(self.tx_m - self.reference_m, axis=-1)
                + np.linalg.norm(self.rx_m - self.reference_m, axis=-1)) / SPEED_OF_LIGHT

    def farthest(self, values: np.ndarray) -> int:
        """Number of the vector with the one of (P, C) values that departs most from the others."""
        return int(self.index[np.abs(values - np.median(values)).max(axis=1).argmax()])

    def select(self, index: Any) -> Vectors:
        """Vectors at `index` along the axis of pulses."""
        return dataclasses.replace(self, **{
            field.name: getattr(self, field.name)[index] for field in dataclasses.fields(self)
            if field.name != 'tropospheric_s'})


def coinciding(container: Container) -> list[tuple[str, ...]]:
    """Channels whose vectors are as many, as long, and were transmitted at the same times."""
    groups: list[tuple[tuple[Any, ...], np.ndarray, list[str]]] = []
    for name, layout in container.channels.items():
        times = np.asarray(container.read_pvps(name)['TxTime'], np.float64)
        shape = (layout.n_vectors, layout.n_samples)
        for other_shape, other, names in groups:
            if shape == other_shape and np.allclose(times, other, 0.0, SAME_TIME_S,
                                                    equal_nan=True):
                names.append(name)
                break
        else:
            groups.append((shape, times, [name]))
    return [tuple(names) for _, _, names in groups]


def read_vectors(container: Container, channels: tuple[str, ...]) -> Vectors:
    """Parameters of the vectors of channels that coincide.

    Raises
    ------
    CphdError
        No vector has signal, or parameters are no numbers that they can be.
    """
    pvps = [container.read_pvps(name) for name in channels]
    names = container.pvp_type.names or ()

    def take(name: str, default: Any = None) -> np.ndarray:
        if name not in names:
            return np.full((len(pvps[0]), len(pvps)), default)
        return np.stack([p[name].astype(np.float64) for p in pvps], axis=1)

    def pair(first: str, second: str) -> np.ndarray:
        return np.stack([take(first), take(second)], axis=-1)

    vectors = Vectors(
        np.arange(len(pvps[0])), take('TxTime')[:, 0], take('TxPos'), take('RcvPos'),
        take('SRPPos'), pair('FX1', 'FX2'), pair('TOA1', 'TOA2'), take('SC0'), take('SCSS'),
        take('AmpSF', 1.0), take('SIGNAL', float(NORMAL)) == NORMAL, 0.0)
    delay = take('TDTropoSRP', 0.0)
    kept = vectors.select(vectors.normal.any(axis=1) & np.isfinite(vectors.tx_s)
                          & np.isfinite(vectors.tx_m).all(axis=(1, 2)))
    if not len(kept.index):
        raise CphdError(f'{container.path}: none of {len(pvps[0])} vectors has signal (SIGNAL = 1 '
                        'and a transmission)')
    _check(container, kept)
    _refuse(container, kept, 'TDTropoSRP is not finite', ~np.isfinite(delay[kept.index]))
    largest = np.abs(delay[kept.index]).max()
    return dataclasses.replace(kept, tropospheric_s=float(largest))


def _refuse(container: Container, vectors: Vectors, what: str, wrong: np.ndarray) -> None:
    """Raise `CphdError` with the number of the first vector that is wrong."""
    if wrong.any():
        rows = wrong.reshape(len(wrong), -1).any(axis=1)
        raise CphdError(f'{container.path}: {what} in {np.count_nonzero(rows)} of '
                        f'{len(wrong)} vectors, first in number '
                        f'{vectors.index[rows.argmax()]}; the file is damaged')


def _check(container: Container, vectors: Vectors) -> None:
    """Raise `CphdError` where parameters are no numbers that they can be."""
    def refuse(what: str, wrong: np.ndarray) -> None:
        _refuse(container, vectors, what, wrong)

    for field in dataclasses.fields(vectors):
        value = np.asarray(getattr(vectors, field.name))
        if value.dtype == np.float64 and value.ndim:
            refuse(f'{field.name} is not finite', ~np.isfinite(value))
    distance = np.linalg.norm(vectors.reference_m, axis=-1)
    refuse("SRPPos is no place near the Earth's surface (metres, ECEF)",
           (distance < _EARTH_M[0]) | (distance > _EARTH_M[1]))
    for name, own_m in (('TxPos', vectors.tx_m), ('RcvPos', vectors.rx_m)):
        distance = np.linalg.norm(own_m, axis=-1)
        refuse(f'{name} is no place around the Earth (metres, ECEF)',
               (distance < _EARTH_M[0]) | (distance > _ORBIT_M))
    refuse('TxTime does not increase', np.diff(vectors.tx_s, prepend=-np.inf) <= 0)
    for name, own_m in (('TxPos', vectors.tx_m), ('RcvPos', vectors.rx_m)):
        refuse(f'{name} lies farther from its neighbours than anything flies',
               _jumps(own_m, vectors.tx_s))
    refuse('TxTime is negative or longer than a day', np.abs(vectors.tx_s - 43200) > 43200)
    refuse('SCSS is not positive', vectors.step <= 0)
    refuse('FX1 and FX2 are no band',
           (vectors.fx_hz[..., 0] <= 0) | (vectors.fx_hz[..., 1] <= vectors.fx_hz[..., 0]))
    refuse('TOA1 is not before TOA2', vectors.toa_s[..., 1] <= vectors.toa_s[..., 0])
    refuse('AmpSF is not positive', vectors.amplitude <= 0)


def _jumps(position_m: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """(P, C) bool: positions that no antenna reached from those before and after."""
    step_m = np.linalg.norm(np.diff(position_m, axis=0), axis=-1)
    jump = step_m > np.maximum(_NEAR_M, _FASTEST * np.diff(time_s)[:, None])
    after, before = ((1, 0), (0, 0)), ((0, 1), (0, 0))
    alone = (np.pad(jump, after, constant_values=True)
             & np.pad(jump, before, constant_values=True))
    return alone if jump.any() and alone.any() else np.pad(jump, after)
