# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Groups of echoes near a map: their frames, and the local frequencies of their images.

A group has a frame of its own: the origin O in the middle of its phase centres, a horizontal
direction t beside which the map lies, n ahead, and the height h of O above the map. A place is its
distance r from O and alpha, the cosine of its direction to t. From a phase centre O + (X, Y, Z) it
is

    d^2 = r^2 - 2 X alpha r - 2 Y f + c,  c = X^2 + Y^2 + Z^2 + 2 Z h,  f = r sqrt(s),
    s = 1 - alpha^2 - (h / r)^2,

exactly, for f is how far ahead of O the place lies. Interpolators read beyond the map, where s may
be negative: below the least s of the map its root is continued by the Taylor cubic, which is
smooth by range and direction alike (`continued_root`). Everything here is for all groups at once:
(G, ...) arrays of G groups, rows of echoes (E, ...) group after group.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ...geometry.grids import MapGrid

_LEAST_AHEAD = 0.25  # sine of the direction to a corner; nearer to the track the look decides
_ALONG_LOOK = 0.85  # cosine between track and look, above which the look decides
SEEN = 0.02  # share of the range that a place must lie ahead
_EDGE = 16  # places along a side of the map where its extent is bounded
_TO_LAST = np.array([1.0, -1.0])  # y falls from row to row
_REACHED = 0.25  # square of the share of a pixel's distance ahead that its row must reach back to


class Frames(NamedTuple):
    """Frames of groups.

    Attributes
    ----------
    origin_m : (G, 3) float64
        Origins, metres.
    track, ahead : (G, 2) float64
        Horizontal unit vectors t and n.
    height_m : (G,) float64
        Height of the origins above the map, metres.
    axis : (G,) int64
        Map axis along which the second pass to the map goes: 0 for x.
    """

    origin_m: np.ndarray
    track: np.ndarray
    ahead: np.ndarray
    height_m: np.ndarray
    axis: np.ndarray


def frames_of(grid: MapGrid, centres_m: np.ndarray, starts: np.ndarray, counts: np.ndarray
              ) -> Frames:
    """Frames of groups of `counts` phase centres, (E, 3), metres, from `starts` on."""
    origin = np.add.reduceat(centres_m, starts) / counts[:, None]
    flat = centres_m[:, :2] - np.repeat(origin[:, :2], counts, axis=0)
    xx, xy, yy = np.add.reduceat(flat[:, [0, 0, 1]] * flat[:, [0, 1, 1]], starts).T
    look = np.array(grid.centre_m[:2]) - origin[:, :2]
    distance = np.hypot(*look.T)
    look /= np.maximum(distance, 1e-12)[:, None]
    across = np.stack([-look[:, 1], look[:, 0]], axis=1)
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    track = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    along_look = np.abs((track * look).sum(axis=1)) > _ALONG_LOOK
    track = np.where((along_look | (xx + yy < 1e-18))[:, None], across, track)
    ahead = np.stack([-track[:, 1], track[:, 0]], axis=1)
    ahead *= np.where((ahead * look).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    away = _across(grid, _CORNERS) - origin[:, None, :2]
    sine = (away @ ahead[:, :, None])[..., 0] / (np.hypot(away[..., 0], away[..., 1]) + 1e-12)
    beside = (sine.min(axis=1) < _LEAST_AHEAD)[:, None]
    track, ahead = np.where(beside, across, track), np.where(beside, look, ahead)
    along = (flat * np.repeat(track, counts, axis=0)).sum(axis=1)
    ends = np.minimum.reduceat(along, starts) + np.maximum.reduceat(along, starts)
    origin[:, :2] += 0.5 * ends[:, None] * track
    axis = (np.abs(look[:, 1]) > np.abs(look[:, 0])).astype(np.int64)
    return Frames(origin, track, ahead, origin[:, 2] - grid.z_m, axis)


def in_frames(frames: Frames, centres_m: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """(E, 3) float64 X, Y and c of phase centres (E, 3) of groups, metres and square metres."""
    origin, track, ahead, height = (np.repeat(a, counts, axis=0) for a in frames[:4])
    away = centres_m - origin
    return np.stack([(away[:, :2] * track).sum(axis=1), (away[:, :2] * ahead).sum(axis=1),
                     (away * away).sum(axis=1) + 2 * away[:, 2] * height], axis=1)


class Places(NamedTuple):
    """Places of the map in frames of groups; (G, S) float64 each but the last.

    Attributes
    ----------
    range_m, alpha, forward_m :
        r, alpha and f.
    by_range :
        Derivative of alpha by r along rows of the map.
    ahead_m, beside_m :
        From the origin along the axis of the second pass, and along the other one.
    seen : (G,) bool
        All of them lie ahead.
    """

    range_m: np.ndarray
    alpha: np.ndarray
    forward_m: np.ndarray
    by_range: np.ndarray
    ahead_m: np.ndarray
    beside_m: np.ndarray
    seen: np.ndarray


#: Nodes from 0 to 1, ends among them, and weights of Gauss and Lobatto, by their number. Errors
#: grow steeply towards the ends of bands: the trapezoidal rule made 3 dB more of them.
LOBATTO = {3: (np.array([0.0, 0.5, 1.0]), np.array([1.0, 4.0, 1.0]) / 6),
           5: (0.5 + 0.5 * np.array([-1.0, -math.sqrt(3 / 7), 0.0, math.sqrt(3 / 7), 1.0]),
               np.array([9.0, 49.0, 64.0, 49.0, 9.0]) / 180)}


_SQUARES = {n: np.stack(np.meshgrid(nodes, nodes), axis=-1).reshape(-1, 2)
            for n, (nodes, _) in LOBATTO.items()}
_CORNERS, _ALONG = np.array([(0, 0), (1, 0), (0, 1), (1, 1)]), np.linspace(0, 1, _EDGE + 1)
_EDGES = np.array([*((u, v) for v in (0, 1) for u in _ALONG), *(
    (u, v) for u in (0, 1) for v in _ALONG)])


def _across(grid: MapGrid, square: np.ndarray) -> np.ndarray:
    """(N, 2) x and y of places of a unit square, (N, 2), on a map, from its first pixel on."""
    half = 0.5 * (np.array([grid.n_x, grid.n_y]) - 1) * grid.spacing_m * _TO_LAST
    middle = np.array(grid.centre_m[:2])
    first = middle - half
    return first + square * (middle + half - first)


def places_of(grid: MapGrid, frames: Frames, n: int = 5) -> Places:
    """Places all over a map, the nodes of `LOBATTO` along both axes."""
    r, alpha, forward, ahead, beside = _polar(frames, _across(grid, _SQUARES[n]))
    seen = ((forward > SEEN * r) & (np.abs(ahead) > SEEN * r)).all(axis=1)
    seen &= (ahead > 0).all(axis=1) | (ahead < 0).all(axis=1)
    along = _along(frames)[0][:, None]
    with np.errstate(divide='ignore', invalid='ignore'):
        by_range = (along * r / ahead - alpha) / r
    return Places(r, alpha, forward, by_range, ahead, beside, seen)


def _along(frames: Frames) -> tuple[np.ndarray, np.ndarray]:
    """(G,) components of t along the axis of the second pass, and along the other one."""
    number = np.arange(len(frames.axis))
    return frames.track[number, frames.axis], frames.track[number, 1 - frames.axis]


def _polar(frames: Frames, xy: np.ndarray
           ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """r, alpha, f, ahead and beside, (G, N), of points (N, 2)."""
    away = xy - frames.origin_m[:, None, :2]
    x, y = away[..., 0], away[..., 1]
    r = np.sqrt(x * x + y * y + frames.height_m[:, None] ** 2)
    alpha = (away @ frames.track[:, :, None])[..., 0] / r
    forward = (away @ frames.ahead[:, :, None])[..., 0]
    first = (frames.axis == 0)[:, None]
    return r, alpha, forward, np.where(first, x, y), np.where(first, y, x)


def direction_slopes(places: Places, centres: list[np.ndarray]) -> np.ndarray:
    """(G, M, S) derivatives of half paths by direction, metres, of echoes (G, M, 3).

    `centres` are of `in_frames`, of transmitters and receivers, or once where these are in the
    same places.
    """
    r, alpha, f = places[:3]
    square = np.stack([r * r, -2 * alpha * r, -2 * f, np.ones_like(r)], axis=1)
    by_alpha = np.stack([-r, r * r * alpha / f], axis=1)
    slopes: Any = 0.0
    for c in centres:
        rows = np.concatenate([np.ones((*c.shape[:2], 1)), c], axis=2)
        slopes = slopes + c[..., :2] @ by_alpha / np.sqrt(np.maximum(rows @ square, 1e-12))
    return slopes / len(centres)


def direction_bends(places: Places, centres: list[np.ndarray]) -> np.ndarray:
    """(G, Q, S) second derivatives of half paths by direction, metres, of echoes (G, Q, 3)."""
    r, alpha, f = (v[:, None] for v in places[:3])
    f1 = -r * r * alpha / f
    f2 = -(r * r + f1 * f1) / f
    found: Any = 0.0
    for c in centres:
        x, y, constant = (c[..., n, None] for n in range(3))
        d = np.sqrt(np.maximum(r * r + constant - x * (2 * alpha * r) - y * (2 * f), 1e-12))
        slope = (x * r + y * f1) / d
        found = found - (y * f2 + slope * slope) / d
    return found / len(centres)


def range_derivatives(places: Places, centres: list[np.ndarray], order: int
                      ) -> list[np.ndarray]:
    """(G, Q, S) half paths of echoes (G, Q, 3), and their derivatives by range up to an order."""
    r, alpha, f = (v[:, None] for v in places[:3])
    square = 1 - alpha * alpha
    f1 = r * square / f
    f2 = (square - f1 * f1) / f
    f3 = -3 * f1 * f2 / f
    f4 = -(4 * f1 * f3 + 3 * f2 * f2) / f
    found = []
    for c in centres:
        x, y, constant = (c[..., n, None] for n in range(3))
        d = np.sqrt(np.maximum(r * r + constant - x * (2 * alpha * r) - y * (2 * f), 1e-12))
        d1 = (r - x * alpha - y * f1) / d
        found.append([d, d1])
        if order > 1:
            d2 = (1 - y * f2 - d1 * d1) / d
            d3 = (-y * f3 - 3 * d1 * d2) / d
            found[-1] += [d2, d3]
        if order > 3:
            found[-1].append((-y * f4 - 4 * d1 * d3 - 3 * d2 * d2) / d)
    if len(found) == 1:
        return found[0]
    return [sum(of_path) / len(centres) for of_path in zip(*found, strict=True)]


def slopes_beyond(range_m: np.ndarray, alpha: np.ndarray, centres: list[np.ndarray],
                  frames: Frames, least: np.ndarray) -> np.ndarray:
    """(G, M, N) derivatives by direction at places (G, N) beside the map, of echoes (G, M, 3).

    There f is continued; `least`, (G,), is the root where the continuation begins.
    """
    root, slope = continued_root(1 - alpha * alpha - (frames.height_m[:, None] / range_m) ** 2,
                                 least[:, None])
    r, alpha, root, slope = (v[:, None] for v in (range_m, alpha, root, slope))
    square, along, ahead, bend = r * r, 2 * alpha * r, 2 * r * root, 2 * alpha * r * slope
    found: Any = 0.0
    for c in centres:
        x, y, constant = (c[..., n, None] for n in range(3))
        d2 = np.maximum(square - x * along - y * ahead + constant, 0.01 * square)
        found = found + (y * bend - x * r) / np.sqrt(d2)
    return found / len(centres)


def continued_root(s: np.ndarray, least: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Root of s, below ``least ** 2`` its Taylor cubic from there, and the derivative by s."""
    q = least * least
    d = np.minimum((s - q) / q, 0.0)
    root = least * (1 + d * (0.5 + d * (-0.125 + d * 0.0625)))
    slope = (0.5 + d * (-0.25 + d * 0.1875)) / least
    above = np.sqrt(np.maximum(s, q))
    return np.where(s > q, above, root), np.where(s > q, 0.5 / above, slope)


class Extents(NamedTuple):
    """What of the polar coordinates a map takes.

    Attributes
    ----------
    range_m, alpha : (G, 2) float64
        Least and largest.
    corner_m : (G, 2) float64
        Ranges at which the least and the largest alpha lie.
    least : (G,) float64
        Least f / r of any pixel.
    reached : (G,) bool
        Rows reach as near as they are read.
    """

    range_m: np.ndarray
    alpha: np.ndarray
    corner_m: np.ndarray
    least: np.ndarray
    reached: np.ndarray


def extents_of(grid: MapGrid, frames: Frames, reach_m: np.ndarray) -> Extents:
    """Extents of a map whose rows are read `reach_m`, (G,), nearer and further than its pixels."""
    edges = _across(grid, _EDGES)
    r, _, forward, ahead, beside = _polar(frames, edges)
    along, across = (v[:, None, None] for v in _along(frames))
    read = np.maximum(r[..., None] + reach_m[:, None, None] * np.array([-1.0, 0.0, 1.0]), 1e-9)
    ahead, beside = ahead[..., None], beside[..., None]
    square = read ** 2 - beside ** 2 - frames.height_m[:, None, None] ** 2
    reached = ((square >= _REACHED * ahead ** 2) | (np.abs(along) < 1e-4)).all(axis=(1, 2))
    alpha = (np.copysign(np.sqrt(np.maximum(square, 0.0)), ahead) * along + beside * across) / read
    alpha, read = (v.reshape(len(r), -1) for v in (alpha, read))
    ends = np.arange(len(r))[:, None], np.stack([alpha.argmin(axis=1), alpha.argmax(axis=1)], 1)
    corner, alpha = read[ends], alpha[ends]
    # between two places of the edge
    slack = 0.125 * np.ptp(edges, axis=0).max() / _EDGE
    nearest, sides = r.min(axis=1), np.array([-1.0, 1.0])
    return Extents(np.stack([nearest, r.max(axis=1)], axis=1) + slack * sides,
                   alpha + (slack / nearest)[:, None] * sides, corner,
                   (forward / r).min(axis=1), reached)


def bent_rows(frames: Frames, places: Places, nearer_m: np.ndarray
              ) -> tuple[np.ndarray, np.ndarray]:
    """Derivative of alpha by range where rows are read nearer, less that at the pixels, (G, S).

    And (G,) whether rows reach there; `nearer_m` is (G,).
    """
    along, across = (v[:, None] for v in _along(frames))
    r, ahead, beside = places.range_m, places.ahead_m, places.beside_m
    read = r - nearer_m[:, None]
    square = read * read - beside * beside - frames.height_m[:, None] ** 2
    alike = (np.abs(along) < 1e-4) | (read <= 0)  # directions do not change there
    reached = (alike | (square >= 0.04 * ahead * ahead)).all(axis=1)
    there = np.copysign(np.sqrt(np.maximum(square, 1e-12)), ahead)
    read = np.where(read > 0, read, 1.0)
    bent = (along * read / there - (along * there + across * beside) / read) / read
    return np.where(alike, 0.0, bent - places.by_range), reached
