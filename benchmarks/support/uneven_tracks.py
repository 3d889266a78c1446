# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Tracks along a line whose speed nobody plans for: halts, haste, returns and jumps.

Each takes what the tracks of `benchmarks.support.random_cases` take.
"""

from __future__ import annotations

import numpy as np


def hurrying(rng, u, length, centre):
    """Stands and goes in turn, as fast as a power of a sine."""
    speed = np.abs(np.sin(rng.uniform(2, 9) * u + rng.uniform(0, 3))) ** rng.choice([2, 6, 10])
    return _along(_path(speed[1:]), length, centre)


def accelerating(rng, u, length, centre):
    """Up to 400 times as fast at one end as at the other."""
    speed = np.exp(rng.uniform(1, 6) * u[1:] * rng.choice([-1, 1]))
    return _along(_path(speed), length, centre)


def halting(rng, u, length, centre):
    """Two to five halts of up to a fifth of the pulses."""
    speed = np.ones(len(u) - 1)
    for _ in range(int(rng.integers(2, 6))):
        begin = rng.integers(0, len(speed))
        speed[begin:begin + int(rng.integers(2, max(3, len(u) // 5)))] = 0
    return _along(_path(speed if speed.any() else speed + 1), length, centre)


def retracing(rng, u, length, centre):
    """Forward, and back over a part of it, up to five times."""
    place = u + rng.uniform(0.05, 0.4) * np.sin(
        2 * np.pi * rng.uniform(1, 5) * u + rng.uniform(0, 6))
    return _along(place, length, centre)


def jumping(rng, u, length, centre):
    """Steps whose lengths differ by orders of magnitude."""
    return _along(_path(rng.exponential(1, len(u) - 1) ** rng.uniform(1, 4)), length, centre)


UNEVEN = hurrying, accelerating, halting, retracing, jumping


def _path(speed):
    return np.append(0.0, np.cumsum(speed))


def _along(place, length, centre):
    place = (place - place.min()) / np.ptp(place) - 0.5
    return centre + np.outer(place * length, [0.0, 1.0, 0.0])
