# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""How large errors of a track are drawn, and what of them no image shows."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from sar_imaging.signal.pulses import PulseBlock


def random_size(kind: str, rng: np.random.Generator) -> float:
    """Random size of an error, logarithmically even: 0.1 to 10 wavelengths of smooth error, 0.02
    to 0.3 wavelengths of vibration, or 5 to 100 ms of clock offset.
    """
    low, high = {'smooth': (0.1, 10.0), 'vibration': (0.02, 0.3), 'clock': (5e-3, 0.1)}[kind]
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def moved_rigidly(block: PulseBlock, true: PulseBlock, points_m) -> PulseBlock:
    """Block whose whole track is displaced and turned to fit the true one as seen from points.

    No image shows a displacement or a rotation of track and scene together. The six numbers are
    those that make the half paths to the points most like the true ones.

    Parameters
    ----------
    block, true : PulseBlock
        Monostatic pulses with estimated and with true positions.
    points_m : (S, 3) float64
        Points of the scene, metres.
    """
    middle = points_m.mean(axis=0)
    wavenumber = block.radar.wavenumber_rad_per_m

    def paths(track):
        return wavenumber * np.linalg.norm(track[:, None] - points_m, axis=-1)

    def moved(q, pulses=slice(None)):
        turn = Rotation.from_rotvec(1e-3 * q[3:])
        return turn.apply(block.tx_m[pulses, 0] - middle) + middle + q[:3]

    some = slice(None, None, max(1, block.n_pulses // 64))
    wanted = paths(true.tx_m[some, 0])
    weak = 1e-3  # holds what hardly changes the paths, such as rolling about the track
    found = least_squares(lambda q: np.concatenate([
        (paths(moved(q, some)) - wanted).ravel() / math.sqrt(wanted.size), weak * q]), np.zeros(6))
    track = moved(found.x)[:, None]
    return dataclasses.replace(block, tx_m=track, rx_m=track)
