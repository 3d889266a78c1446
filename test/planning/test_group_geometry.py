# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Half paths of groups and their derivatives, against paths between places in space.

The reference takes distances between points of the map and phase centres, and derivatives from
polynomials through them: it knows neither the frames' invariants nor the recursions.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Chebyshev

from sar_imaging.geometry import MapGrid
from sar_imaging.planning.exact.group_geometry import (
    direction_bends,
    direction_slopes,
    frames_of,
    in_frames,
    places_of,
    range_derivatives,
    slopes_beyond,
)

GRID = MapGrid((12.0, 3.0, 0.5), 12, 8, 0.5)
N = 24


def _bent_track(rng):
    along = np.linspace(-1.5, 1.5, N)
    return np.stack([0.3 * along ** 2, along, 2 + 0.2 * along], axis=1) \
        + 0.05 * rng.standard_normal((N, 3))


@pytest.fixture(params=[1, 2], ids=['monostatic', 'bistatic'])
def survey(request):
    """Frames of three groups, phase centres in space and by rows in the frames, their groups."""
    rng = np.random.default_rng(7)
    ends = [_bent_track(rng)]
    if request.param == 2:
        ends.append(ends[0] + [0.0, 0.4, 0.1])
    starts = np.array([0, 7, 15])
    counts = np.diff(starts, append=N)
    frames = frames_of(GRID, np.mean(ends, axis=0), starts, counts)
    rows = starts[:, None] + np.minimum(np.arange(counts.max()), counts[:, None] - 1)
    return frames, ends, [in_frames(frames, e, counts)[rows] for e in ends], starts


def _place(frames, g, r, alpha):
    """(..., 3) point at polar coordinates of group g."""
    forward = np.sqrt(r * r * (1 - alpha * alpha) - frames.height_m[g] ** 2)
    flat = (frames.origin_m[g, :2] + np.multiply.outer(r * alpha, frames.track[g])
            + np.multiply.outer(forward, frames.ahead[g]))
    return np.concatenate([flat, np.full((*flat.shape[:-1], 1), GRID.z_m)], axis=-1)


def _half_path(point, ends, echo):
    return np.mean([np.linalg.norm(point - e[echo], axis=-1) for e in ends], axis=0)


def _taylor(function, at, half_width, order):
    """Value and derivatives by a polynomial through 15 places."""
    fit = Chebyshev.interpolate(function, 14, [at - half_width, at + half_width])
    return [fit.deriv(n)(at) if n else fit(at) for n in range(order + 1)]


def _echoes_of(starts):
    ends = np.append(starts[1:], N)
    return [(g, e, e - a) for g, (a, b) in enumerate(zip(starts, ends, strict=True))
            for e in range(a, b)]


def test_places_are_those_of_the_map(survey):
    frames = survey[0]
    places = places_of(GRID, frames)
    assert places.seen.all()
    for g in range(len(frames.height_m)):
        found = _place(frames, g, places.range_m[g], places.alpha[g])
        assert found[:, 0].min() == pytest.approx(GRID.x_m[0], abs=1e-9)
        assert found[:, 1].max() == pytest.approx(GRID.y_m[0], abs=1e-9)
        step = np.zeros(3)
        step[frames.axis[g]] = 1e-5
        (r0, a0), (r1, a1) = (_polar(frames, g, found + s * step) for s in (-1, 1))
        # central differences of 10 um at 10 m: rounding errs by 1e-10, curvature by less
        np.testing.assert_allclose(places.by_range[g], (a1 - a0) / (r1 - r0), rtol=0, atol=1e-7)


def _polar(frames, g, points):
    away = points - frames.origin_m[g]
    r = np.linalg.norm(away, axis=-1)
    return r, away[:, :2] @ frames.track[g] / r


def test_derivatives_by_range_are_those_of_paths_in_space(survey):
    frames, ends, centres, starts = survey
    places = places_of(GRID, frames, 3)
    echoes = np.stack([starts, starts + 5], axis=1)
    some = [c[:, [0, 5]] for c in centres]
    found = range_derivatives(places, some, 4)
    assert len(range_derivatives(places, some, 1)) == 2
    for g in range(len(starts)):
        for q, echo in enumerate(echoes[g]):
            for s, (r, alpha) in enumerate(zip(places.range_m[g], places.alpha[g], strict=True)):
                wanted = _taylor(lambda x, g=g, alpha=alpha, echo=echo: _half_path(
                    _place(frames, g, x, alpha), ends, echo), r, 0.15 * r, 4)
                # they are 16 m to 5e-5; a derivative of a polynomial loses a digit each time
                for n, tolerance in enumerate([1e-12, 1e-12, 1e-11, 1e-10, 1e-9]):
                    assert found[n][g, q, s] == pytest.approx(wanted[n], rel=0, abs=tolerance)


def test_slopes_and_bends_by_direction_are_those_of_paths_in_space(survey):
    frames, ends, centres, starts = survey
    places = places_of(GRID, frames, 3)
    found, bends = direction_slopes(places, centres), direction_bends(places, centres)
    for g, echo, n in _echoes_of(starts):
        for s, (r, alpha) in enumerate(zip(places.range_m[g], places.alpha[g], strict=True)):
            wanted = _taylor(lambda x, g=g, r=r, echo=echo: _half_path(
                _place(frames, g, r, x), ends, echo), alpha, 0.02, 2)
            assert found[g, n, s] == pytest.approx(wanted[1], abs=1e-9)
            assert bends[g, n, s] == pytest.approx(wanted[2], abs=1e-7)


def test_slopes_beside_the_map_are_those_of_the_continued_geometry(survey):
    """There the square root of f is its cubic about the place where the continuation begins."""
    frames, _, centres, starts = survey
    least = np.array([0.5, 0.45, 0.4])
    r = np.full((len(starts), 3), 11.0)
    begins = np.sqrt(1 - least ** 2 - (frames.height_m / 11.0) ** 2)
    alpha = begins[:, None] * np.array([0.97, 1.03, 1.08])
    found = slopes_beyond(r, alpha, centres, frames, least)
    for g, _, n in _echoes_of(starts):
        def path(x, g=g, n=n):
            s = 1 - x * x - (frames.height_m[g] / 11.0) ** 2
            d = np.minimum(s / least[g] ** 2 - 1, 0)
            root = np.where(d < 0, least[g] * (1 + d / 2 - d ** 2 / 8 + d ** 3 / 16),
                            np.sqrt(np.maximum(s, 0)))
            return np.mean([np.sqrt(121.0 + c[g, n, 2] - 2 * 11.0 * (
                x * c[g, n, 0] + root * c[g, n, 1])) for c in centres], axis=0)
        for s, a in enumerate(alpha[g]):
            wanted = _taylor(path, a, 0.005, 1)[1]
            assert found[g, n, s] == pytest.approx(wanted, abs=1e-8)


def test_places_that_are_not_ahead_are_told():
    centres = np.stack([np.full(N, 12.0), np.linspace(2, 4, N), np.full(N, 2.0)], axis=1)
    assert not places_of(GRID, frames_of(
        GRID, centres, np.array([0]), np.array([N]))).seen.any()
