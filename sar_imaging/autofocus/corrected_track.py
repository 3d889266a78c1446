# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Positions of pulses as the image tells them, with covariances: small only where it does.

At the sharpest parameters the mean sharpness S of K tiles around bright points has no gradient,
and the curvature ``-A``. Their gradients g_k scatter as each tile's own noise, neighbours and
height do, so that the covariance of the parameters is ``A^-1 (sum g_k g_k') A^-1 / K^2`` (White,
Econometrica 48, 1980). Combinations of the parameters that no tile sees, such as what only
displaces the image, keep their expected size.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from ..geometry.grids import MapGrid
from ..signal.pulses import PulseBlock
from .autofocus import AutofocusResult
from .models import Geometry, GeometryModel
from .search import differentiate, sharpness, visible
from .tiles import Tiles, bright_points

_SUBAPERTURES, _POINTS = 128, 48
_ROUNDS, _FARTHEST_RAD = 4, 1.0
_STEP_RAD = 0.1  # of the curvature's differences
_SPARE_POINTS = 3  # over the unknowns, for gradients to scatter at all
# Sidelobes of one scatterer disturb many tiles alike, which their scatter does not show: errors of
# 23 flights, seeds 90000 to 90052, had 2.7 times the variance, 1.5 times without the worst.
_ALIKE = 2.0


@dataclasses.dataclass(frozen=True, eq=False)
class CorrectedTrack:
    """Where the radar was at each pulse, and how well that is known.

    Attributes
    ----------
    stamp_ns : (P,) int64
        Times of the pulses, nanoseconds.
    position_m : (P, 3) float64
        Mean of the phase centres, imaging frame, metres.
    covariance_m2 : (P, 3, 3) float64
        Of each position, square metres. Errors of neighbouring pulses are alike: a filter takes
        one position of an aperture, not all.
    parameters : dict of str to float
        Of the model.
    std : dict of str to float
        Their standard deviations, in the unit of each.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.autofocus.corrected_track import CorrectedTrack
    >>> track = CorrectedTrack(np.array([0]), np.zeros((1, 3)), np.diag([1e-4, 0.01, 0.01])[None],
    ...                        {}, {})
    >>> np.sqrt(track.covariance_m2[0].diagonal()).round(3).tolist()
    [0.01, 0.1, 0.1]
    """

    stamp_ns: np.ndarray
    position_m: np.ndarray
    covariance_m2: np.ndarray
    parameters: dict[str, float]
    std: dict[str, float]


def corrected_track(result: AutofocusResult, model: GeometryModel, grid: MapGrid, *,
                    position_std_m: float = 0.0) -> CorrectedTrack:
    """The track of an aperture as its focused image tells it.

    Parameters
    ----------
    result : AutofocusResult
        Accepted, or focused already. Use what it claims (``report.success``) alone where a wrong
        track does harm.
    model : GeometryModel
        That it was found with.
    grid : MapGrid
        Grid of its image.
    position_std_m : float
        Standard deviation of what else is wrong with each position, along each axis, metres: the
        noise of the poses, and a displacement of track and scene together, which no image shows.

    Returns
    -------
    CorrectedTrack

    Raises
    ------
    ValueError
        Autofocus refused its answer, or the bright points do not tell the parameters.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.autofocus import Autofocus, nominal, with_track_error
    >>> from sar_imaging.autofocus.corrected_track import corrected_track
    >>> from sar_imaging.simulation import flawed_aperture
    >>> case = flawed_aperture('smooth', 0.5, seed=1, n_pulses=64, half_scene_m=6.0)
    >>> model = with_track_error(nominal(case.stated), scale_m=0.05)
    >>> autofocus = Autofocus(case.grid, model=lambda block: model, n_phases=0, n_points=12)
    >>> track = corrected_track(autofocus.process(case.stated), model, case.grid)
    >>> std = np.sqrt(np.linalg.eigvalsh(track.covariance_m2[32]))
    >>> bool(std[0] < 0.2 * std[2])  # along the line of sight, and where no image tells
    True
    """
    report = result.report
    if not (report.accepted or report.success):
        raise ValueError(f'autofocus refused its answer: {report.reason}')
    block = result.block
    points = bright_points(result.image, grid, block, _POINTS)
    start = np.array([report.parameters[name] for name in model.names])
    offsets = _beyond(block, model(start))
    tiles = Tiles(block, _geometry(block), points, min(block.n_pulses, _SUBAPERTURES))
    basis, hidden = visible(tiles, model, start)
    change, covariance = _sharpest(tiles, model, start, basis)
    noise_rad = position_std_m * tiles.wavenumber
    covariance += noise_rad**2 / block.n_pulses * np.eye(len(covariance))
    parameters = start + basis @ change
    of_all = basis @ covariance @ basis.T + hidden @ hidden.T
    return _track(block, model, parameters, of_all, offsets, position_std_m)


def _geometry(block: PulseBlock) -> Geometry:
    return Geometry(*block.centres_m)


def _middle(geometry: Geometry) -> np.ndarray:
    """(P, 3) mean of the phase centres."""
    return 0.5 * (geometry.tx_m.mean(axis=1) + geometry.rx_m.mean(axis=1))


def _beyond(block: PulseBlock, geometry: Geometry) -> np.ndarray:
    """(P, 3) what residual phases added to the positions of the parameters."""
    return _middle(_geometry(block)) - _middle(geometry)


def _sharpest(tiles: Tiles, model: GeometryModel, start: np.ndarray, basis: np.ndarray
              ) -> tuple[np.ndarray, np.ndarray]:
    """Change (Q,) of the visible combinations to the sharpest, and its covariance (Q, Q)."""
    jacobian = differentiate(tiles, model, start) @ basis
    n_points, _, n = jacobian.shape
    if n_points < n + _SPARE_POINTS:
        raise ValueError(f'{n_points} bright points do not tell {n} unknowns; expected '
                         f'{n + _SPARE_POINTS}')

    def gradients(at: np.ndarray) -> np.ndarray:
        _, slope = sharpness(tiles, jacobian @ at)
        return n_points * np.einsum('ku,kuz->kz', slope, jacobian)

    change = np.zeros(n)
    for _ in range(_ROUNDS):
        curvature = _curvature(gradients, change)
        move = np.linalg.solve(curvature, gradients(change).mean(axis=0))
        change += move * min(1.0, _FARTHEST_RAD / max(np.abs(move).max(initial=0.0), 1e-12))
        if np.abs(move).max(initial=0.0) < 1e-3:
            break
    inverse = np.linalg.inv(_curvature(gradients, change))
    pull = gradients(change)
    pull -= pull.mean(axis=0)
    share = _ALIKE / (n_points * (n_points - n))
    return change, share * inverse @ (pull.T @ pull) @ inverse


def _curvature(gradients: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """(Q, Q) how much the mean gradient falls."""
    steps = _STEP_RAD * np.eye(len(at))
    out = np.array([(gradients(at - s) - gradients(at + s)).mean(axis=0) for s in steps])
    out = out.reshape(len(at), len(at)) / (2 * _STEP_RAD)
    out = 0.5 * (out + out.T)
    if len(at) and np.linalg.eigvalsh(out)[0] <= 0:
        raise ValueError('the image is at no maximum of its sharpness; its bright points do not '
                         'tell the track')
    return out


def _track(block: PulseBlock, model: GeometryModel, parameters: np.ndarray, covariance: np.ndarray,
           offsets: np.ndarray, position_std_m: float) -> CorrectedTrack:
    steps = 1e-3 * np.diag(model.scale)
    slope = np.stack([(_middle(model(parameters + s)) - _middle(model(parameters - s)))
                      / (2 * np.abs(s).sum()) for s in steps], axis=-1)
    spread = slope @ covariance @ slope.transpose(0, 2, 1) + position_std_m**2 * np.eye(3)
    std = np.sqrt(np.diag(covariance))
    return CorrectedTrack(block.stamp_ns, _middle(model(parameters)) + offsets, spread,
                          dict(zip(model.names, parameters.tolist(), strict=True)),
                          dict(zip(model.names, std.tolist(), strict=True)))
