# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Two-way amplitude of echoes towards points on the device, see `geometry.illumination`."""

from __future__ import annotations

import math

import numpy as np

from ...geometry.illumination import Illumination
from .arrays import cuda, function, kernel, launch, xp

_THREADS = 128
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)


class Antennas:
    """An `Illumination` as kernels take it.

    Attributes
    ----------
    axes : (R, 12) float64 array of the device
        Where each echo is seen from, metres; then the antenna's right, boresight and up.
    table : (K,) float64 array of the device
        Two-way amplitude by the sine of the azimuth, then by that of the elevation.
    place : (6,) float64 array of the device
        Sine at the first point, points per unit of it and number of the last, of azimuth and of
        elevation.
    ends : (6,) float64 array of the device
        Sines of azimuth, last and first; cosine and sine of the last elevation and of the first.
    """

    def __init__(self, illumination: Illumination):
        cuts = illumination.pattern.azimuth, illumination.pattern.elevation
        (left, right), (low, high) = (cut.cutoff_rad for cut in cuts)
        self.axes = xp.asarray(np.concatenate(
            [illumination.centre_m, illumination.axes.reshape(-1, 9)], axis=1))
        self.table = xp.asarray(np.concatenate([cut.amplitude for cut in cuts]))
        self.place = xp.asarray(np.array([
            (cut.start, 1 / cut.step, len(cut.amplitude) - 1) for cut in cuts]).reshape(-1))
        self.ends = xp.asarray(np.array([math.sin(right), math.sin(left), math.cos(high),
                                         math.sin(high), math.cos(low), math.sin(low)]))

    def at_nodes(self, positions: np.ndarray, echoes: slice) -> np.ndarray:
        """(K, R) float32 amplitudes of some echoes at nodes (3, K) float64, metres.

        All are arrays of the device; a NaN stands where a node has no position.
        """
        axes = self.axes[echoes]
        found = xp.empty((positions.shape[1], len(axes)), np.float32)
        launch(amplitudes_at_nodes, -(-found.size // _THREADS), _THREADS, axes, self.table,
               self.place, positions, found)
        return found


@function
def in_axes(axes, echo, x, y, z):
    """What of a point lies to the right, ahead and up of an echo's antenna, metres."""
    x, y, z = x - axes[echo, 0], y - axes[echo, 1], z - axes[echo, 2]
    return (x * axes[echo, 3] + y * axes[echo, 4] + z * axes[echo, 5],
            x * axes[echo, 6] + y * axes[echo, 7] + z * axes[echo, 8],
            x * axes[echo, 9] + y * axes[echo, 10] + z * axes[echo, 11])


@function
def at_sine(table, place, cut, sine):
    """Amplitude of a cut by the sine of its angle; `cut` is 0 for azimuth, 3 for elevation."""
    last = place[cut + 2]
    at = (max(min(sine, _ONE), -_ONE) - place[cut]) * place[cut + 1]
    if not (_ZERO <= at <= last):
        return _ZERO * at
    point = min(int(at), int(last) - 1)
    first = point + (int(place[2]) + 1 if cut else 0)
    low, high = table[first], table[first + 1]
    return low + (at - np.float32(point)) * (high - low)


@function
def amplitude(table, place, right, ahead, up):
    """Two-way amplitude of an echo towards what lies to the right, ahead and up; 0 behind."""
    if not ahead > _ZERO:
        return _ZERO * right
    within = ahead * ahead + up * up
    return (at_sine(table, place, 0, right / math.sqrt(right * right + within))
            * at_sine(table, place, 3, up / math.sqrt(within)))


@kernel()
def amplitudes_at_nodes(axes, table, place, positions, found):
    """Amplitudes of echoes at nodes; a thread for each of both.

    Parameters
    ----------
    axes, table, place :
        As of `Antennas`.
    positions : (3, K) float64
        Positions of the nodes, metres.
    found : (K, R) float32
        Amplitudes; NaN where a node has no position.
    """
    at, n_echoes = cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x, axes.shape[0]
    if at >= found.size:
        return
    node, echo = at // n_echoes, at % n_echoes
    x, y, z = positions[0, node], positions[1, node], positions[2, node]
    if math.isnan(x + y + z):
        found[node, echo] = math.nan
    else:
        right, ahead, up = in_axes(axes, echo, x, y, z)
        found[node, echo] = amplitude(table, place, right, ahead, up)
