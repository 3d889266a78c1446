"""How an echo lights a tile of points: what kernels call.

`light` are the last arguments of `kernels.add_lit_points`; numbers of an item, which is an echo
and a tile, lie in `weights`, (WEIGHTS, items) float32 shared by the threads of a block.
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import function
from ..illumination import amplitude, in_axes

WEIGHTS, _AXES = 12, 9  # numbers of an item, and of the antenna's axes
DARK, BETWEEN, ALONE = (np.int32(v) for v in (0, 1, 2))  # how an echo lights a tile


@function
def _dark_sphere(axes, ends, echo, x, y, z, radius):
    """Whether an echo lights nothing within a radius of a position, metres.

    How far a point lies beyond an end of the pattern, ``d a - sine |d|`` in azimuth, changes by at
    most ``1 + sine`` times the radius.
    """
    right, ahead, up = in_axes(axes, echo, x, y, z)
    distance = math.sqrt(right * right + ahead * ahead + up * up)
    return (right - ends[0] * distance > (1.0 + abs(ends[0])) * radius
            or ends[1] * distance - right > (1.0 + abs(ends[1])) * radius
            or up * ends[2] - ahead * ends[3] > radius
            or ahead * ends[5] - up * ends[4] > radius or ahead < -radius)


@function
def _bend(low, between, high, before, after):
    """Second difference of three knots; `before` and `after` are 0 for a line."""
    return (high - between) * after - (between - low) * before


@function
def _steps(degree, n):
    """For knots n points apart: 1 / n, and those of `_bend`."""
    whole = np.float32(1.0) / np.float32(max(n, 1))
    bent = degree // 2 * (n // 2)
    if not bent:
        return whole, np.float32(0.0), np.float32(0.0)
    return whole, whole / np.float32(bent), whole / np.float32(n - bent)


@function
def _row_of_knots(knots, at, degree, echo, n, line, item):
    """Parabola along a row of knots of a tile: its coefficients go to the item's `line`."""
    low, middle, high = (knots[at, echo], knots[at + degree // 2, echo],
                         knots[at + degree, echo])
    whole, before, after = _steps(degree, n)
    bend = _bend(low, middle, high, before, after)
    line[0, item], line[1, item] = low, (high - low) * whole - bend * np.float32(n)
    line[2, item] = bend
    return low + middle + high


@function
def _set_weights(knots, how, number, across, tile, echo, weights, item):
    """Amplitude over a tile as a polynomial of rows and columns; the sum of its knots.

    Parabolas along rows of knots have coefficients that are parabolas along columns.
    """
    down, beside = number // across, number % across
    rows = min(tile[0], how[4] - 1 - down * tile[0])
    columns = min(tile[1], how[5] - 1 - beside * tile[1])
    corner = down * how[0] * how[2] + beside * how[1]
    total = _row_of_knots(knots, corner, how[1], echo, columns, weights[:3], item)
    total += _row_of_knots(knots, corner + how[0] // 2 * how[2], how[1], echo, columns,
                           weights[3:6], item)
    total += _row_of_knots(knots, corner + how[0] * how[2], how[1], echo, columns,
                           weights[6:9], item)
    whole, before, after = _steps(how[0], rows)
    for power in range(3):
        low, middle, high = (weights[power, item], weights[3 + power, item],
                             weights[6 + power, item])
        bend = _bend(low, middle, high, before, after)
        weights[3 + power, item] = (high - low) * whole - bend * np.float32(rows)
        weights[6 + power, item] = bend
    return total


@function
def light_tile(light, number, across, tile, place, echo, weights, item):
    """How an echo lights a tile, `DARK`, `BETWEEN` or `ALONE`, by what is left in `weights`.

    `place` is the middle of the tile and its radius, metres. In `weights` are the polynomial
    between knots, or the antenna's right, boresight and up for points of their own.
    """
    knots, how, axes, _, _, ends = light
    if not how[3]:
        total = _set_weights(knots, how, number, across, tile, echo, weights, item)
        if not math.isnan(total):
            return BETWEEN if total > np.float32(0.0) else DARK
    x, y, z, radius = place
    if _dark_sphere(axes, ends, echo, x, y, z, radius):
        return DARK
    for k in range(_AXES):
        weights[k, item] = np.float32(axes[echo, 3 + k])
    right, ahead, up = in_axes(axes, echo, x, y, z)
    weights[9, item], weights[10, item], weights[11, item] = (np.float32(right), np.float32(ahead),
                                                             np.float32(up))
    return ALONE


@function
def amplitude_alone(light, x, y, z, weights, item):
    """Two-way amplitude towards a point, metres from its tile's middle, by what `weights` hold."""
    return amplitude(
        light[3], light[4],
        weights[9, item] + x * weights[0, item] + y * weights[1, item] + z * weights[2, item],
        weights[10, item] + x * weights[3, item] + y * weights[4, item] + z * weights[5, item],
        weights[11, item] + x * weights[6, item] + y * weights[7, item] + z * weights[8, item])


@function
def amplitude_between(row, column, weights, item):
    """Amplitude at a row and column of a tile, by the polynomial in `weights`."""
    low, slope, bend = weights[0, item], weights[3, item], weights[6, item]
    low += column * (weights[1, item] + column * weights[2, item])
    slope += column * (weights[4, item] + column * weights[5, item])
    bend += column * (weights[7, item] + column * weights[8, item])
    return low + row * (slope + row * bend)
