# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Maximise the sharpness of tiles over the parameters of a geometry model.

The search starts with short coherent segments, whose images are displaced rather than blurred by
a track error and overlap over many wavelengths of it, and doubles their length until the whole
aperture is coherent. At each level only what the level can see is estimated: combinations of
parameters that merely move a tile or turn its phase are left alone.
"""

from __future__ import annotations

import dataclasses
import logging

import numpy as np
from numpy.typing import ArrayLike

from ..signal.pulses import PulseBlock
from .models import GeometryModel
from .tiles import Tiles

_logger = logging.getLogger(__name__)
_SEEN_RAD = 0.1  # combinations with less phase than this at their expected size are left alone
_WITHIN_SEGMENT_RAD = 1.0  # phase that may remain within the segments of the first level
_SUBAPERTURES_PER_SEGMENT = 16
_FEWEST_SUBAPERTURES = 96
_FARTHEST = 3.0  # change of a combination at one level, in expected errors


def sharpness(tiles: Tiles, change_m: np.ndarray) -> tuple[float, np.ndarray]:
    """Mean sharpness of the tiles and its gradient.

    ``S_k = sum_x I^2 / (sum_x I)^2`` with the intensity ``I = sum_g |f_g|^2`` over the coherent
    segments: 1 for a single bright pixel, 1 / X for an even tile of X pixels.

    Parameters
    ----------
    tiles : Tiles
        Sub-aperture images.
    change_m : (K, U) float64
        Change of the half paths, metres.

    Returns
    -------
    float, (K, U) float64
        Mean of ``S_k``, and its derivative by the changes, 1/m.
    """
    images = tiles.focus(change_m)
    power = np.sum(np.square(np.abs(images), dtype=np.float64), axis=2)
    first, second = power.sum(axis=1) + 1e-300, np.square(power).sum(axis=1)
    weight = (2 * power / (first ** 2)[:, None] - (2 * second / first ** 3)[:, None])
    scaled = (weight[..., None] * images).astype(np.complex64)
    _, slope = tiles.correlate(change_m, scaled)
    n = len(first)
    return float(np.mean(second / first ** 2)), 2 * slope.real / n


def differentiate(tiles: Tiles, model: GeometryModel, parameters: np.ndarray) -> np.ndarray:
    """(K, U, Q) derivative of the half paths by the parameters, by central differences."""
    out = []
    for q in range(len(parameters)):
        step = np.zeros_like(parameters)
        step[q] = 1e-3 * model.scale[q]
        out.append((tiles.half_path_change(model(parameters + step))
                    - tiles.half_path_change(model(parameters - step))) / (2 * step[q]))
    return np.stack(out, axis=-1)


def detrend(change: np.ndarray, groups: np.ndarray | None = None) -> np.ndarray:
    """Take from (K, U, ...) changes what no tile can see.

    A line over the aperture only moves a tile and turns its phase; with `groups`, (U,) int
    segments, the phase of each segment is not seen either.
    """
    n = change.shape[1]
    columns = [np.ones(n), np.linspace(-1.0, 1.0, n)]
    if groups is not None:
        columns += [(groups == g).astype(float) for g in range(groups.max())]
    q, _ = np.linalg.qr(np.stack(columns, axis=1))
    return change - np.einsum('ug,kg...->ku...', q, np.einsum('ug,ku...->kg...', q, change))


@dataclasses.dataclass(frozen=True)
class Estimate:
    """Parameters found by `search`.

    Attributes
    ----------
    parameters : (Q,) float64
        Values.
    uncertainty : (Q,) float64
        Size of the part that the image does not determine, in the unit of each: the expected
        size for what no tile sees.
    points : (K, 3) float64
        Centres of the tiles, moved to the bright points they hold, metres.
    first_segments : int
        Coherent segments of the first level.
    evaluations : int
        Tile images that were formed.
    n_visible : int
        Combinations of the parameters that the tiles see, and that were estimated.
    """

    parameters: np.ndarray
    uncertainty: np.ndarray
    points: np.ndarray
    first_segments: int
    evaluations: int
    n_visible: int


def search(block: PulseBlock, model: GeometryModel, points: ArrayLike,
           parameters: ArrayLike | None = None, *, first_segments: int | None = None) -> Estimate:
    """Find the parameters that make the tiles around some points sharpest.

    Parameters
    ----------
    block : PulseBlock
        Range profiles.
    model : GeometryModel
        Unknowns.
    points : (K, 3) array_like
        Bright points of the image with the nominal geometry, metres.
    parameters : (Q,) array_like, optional
        Where to start; `model.start` if left out.
    first_segments : int, optional
        Coherent segments of the first level; from the expected errors if left out.

    Returns
    -------
    Estimate
    """
    parameters = np.array(model.start if parameters is None else parameters, float)
    points = np.asarray(points, float)
    if first_segments is None:
        first_segments = _segments_needed(block, model, parameters, points)
    evaluations, n_visible, g = 0, 0, first_segments
    uncertainty = model.scale.copy()
    while g >= 1:
        n_sub = min(block.n_pulses, max(_FEWEST_SUBAPERTURES, _SUBAPERTURES_PER_SEGMENT * g))
        tiles = Tiles(block, model(parameters), points, n_sub, g)
        basis, hidden = visible(tiles, model, parameters)
        n_visible = max(n_visible, basis.shape[1])
        if basis.shape[1]:
            parameters, n = _climb(tiles, model, parameters, basis)
            evaluations += n
            points = _recentred(tiles, tiles.half_path_change(model(parameters)))
            uncertainty = np.linalg.norm(hidden, axis=1)
            _logger.debug('autofocus: %d segments, %d unknowns, %s', g, basis.shape[1],
                          parameters)
        g //= 2
    return Estimate(parameters, uncertainty, points, first_segments, evaluations, n_visible)


def _segments_needed(block: PulseBlock, model: GeometryModel, parameters: np.ndarray,
                     points: np.ndarray) -> int:
    """Segments short enough that errors of the expected size leave each one focused."""
    n = min(block.n_pulses, 512)
    tiles = Tiles(block, model(parameters), points[:4], n, 1)
    phases = tiles.wavenumber * differentiate(tiles, model, parameters) * model.scale
    g = 1
    while g < n // 8:
        groups = np.arange(n) * g // n
        within = phases.copy()
        for part in range(g):
            within[:, groups == part] = detrend(within[:, groups == part])
        if np.sqrt(np.square(within).sum(axis=-1).mean()) <= _WITHIN_SEGMENT_RAD:
            break
        g *= 2
    return g


def visible(tiles: Tiles, model: GeometryModel, parameters: np.ndarray
            ) -> tuple[np.ndarray, np.ndarray]:
    """Combinations of parameters that tiles see, and those that remain hidden.

    Parameters
    ----------
    tiles : Tiles
        Sub-aperture images.
    model : GeometryModel
        Unknowns.
    parameters : (Q,) float64
        Their values.

    Returns
    -------
    (Q, V) float64, (Q, Q - V) float64
        Combinations that change the tiles by 1 rad rms each, and others of their expected size.
    """
    scaled = tiles.wavenumber * differentiate(tiles, model, parameters) * model.scale
    seen = detrend(scaled, tiles.segment if tiles.n_segments > 1 else None)
    normal = np.einsum('kup,kuq->pq', seen, seen) / (seen.shape[0] * seen.shape[1])
    values, vectors = np.linalg.eigh(normal)
    good = values > _SEEN_RAD ** 2
    basis = model.scale[:, None] * vectors[:, good] / np.sqrt(values[good])
    return basis, model.scale[:, None] * vectors[:, ~good]


def _climb(tiles: Tiles, model: GeometryModel, start: np.ndarray, basis: np.ndarray
           ) -> tuple[np.ndarray, int]:
    # scipy.optimize takes its time to import, which a node without autofocus need not wait for
    from scipy.optimize import minimize

    first, _ = sharpness(tiles, tiles.half_path_change(model(start)))
    jacobian = differentiate(tiles, model, start) @ basis
    coarse = tiles.n_segments > 1

    def cost(z: np.ndarray) -> tuple[float, np.ndarray]:
        parameters = start + basis @ z
        value, slope = sharpness(tiles, tiles.half_path_change(model(parameters)))
        return -value / first, -np.einsum('ku,kuz->z', slope, jacobian) / first

    # Trial steps of the line search stay where the model makes sense.
    reach = _FARTHEST / np.linalg.norm(basis / model.scale[:, None], axis=0)
    found = minimize(cost, np.zeros(basis.shape[1]), jac=True, method='L-BFGS-B',
                     bounds=np.stack([-reach, reach], axis=1),
                     options={'maxiter': 12 if coarse else 40, 'ftol': 1e-4 if coarse else 1e-9})
    return start + basis @ found.x, found.nfev


def _recentred(tiles: Tiles, change_m: np.ndarray) -> np.ndarray:
    """Centres moved to the brightest pixel of their tile, each point once."""
    power = np.square(np.abs(tiles.focus(change_m))).sum(axis=2)
    moved = [tiles.position(k, pixel) for k, pixel in enumerate(power.argmax(axis=1))]
    order = np.argsort(-power.max(axis=1))
    kept: list[int] = []
    spacing = np.linalg.norm(tiles.position(0, 0) - tiles.position(0, 1))
    for k in order:
        if all(np.linalg.norm(moved[k] - moved[other]) > 3 * spacing for other in kept):
            kept.append(k)
    return np.array([moved[k] for k in kept])
