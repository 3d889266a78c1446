# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimate the phase of each sub-aperture that makes tiles sharpest, and the error of it.

What a smooth geometry model leaves, such as vibration, is estimated pulse by pulse as one
displacement along the line of sight for the whole scene. The fourth power of the image that
sharpness sums is a convex function of the contributions, so turning every contribution to the
phase of ``sum_x conj(|f|^2 f) contribution`` can only raise it: a power iteration without step
size. Two halves of the tiles are compared to tell the estimate from noise.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import dct, idct

from ..signal.pulses import PulseBlock
from .models import Geometry, GeometryModel
from .search import detrend
from .tiles import Tiles

_PIXELS = 5, 9  # small tiles: what is left displaces nothing
_POWERS = (4,) * 6 + (1,) * 10  # of the weights in turn: peaks alone first, then all there is
_BAND = 12  # cosine terms over which signal and noise are told apart
_PEAK = 8  # power that leaves the peak of a tile alone
_PARTS = 8  # intervals of range that the tiles are dealt out by
_NOISE_RAD = 0.02  # of the smooth phases
_LOW_ORDERS = 5  # polynomial degree of what may differ from tile to tile


@dataclasses.dataclass(frozen=True)
class Residual:
    """What `estimate_residual` found.

    Attributes
    ----------
    half_path_m : (P,) float64
        Change of the half path of each pulse that focuses the tiles, metres.
    common_rad : float
        Rms error of the phase that this leaves in all tiles alike, estimated from two halves of
        the tiles.
    varying_rad : float
        Rms smooth phase that grows over the scene, as from an error whose effect differs from
        place to place.
    coherence : float
        ``|sum c| / sum |c|`` over the contributions c to the peak of a tile: 1 where a point is
        alone and in phase all along the aperture. Upper decile of the tiles. A wrong phase that
        all tiles agree on shows here alone.
    planes_rad : (K, 4) float64
        Coefficients of that smooth phase for each point, Legendre degrees 2 to 5.
    """

    half_path_m: np.ndarray
    common_rad: float
    varying_rad: float
    coherence: float
    planes_rad: np.ndarray

    @property
    def error_db(self) -> float:
        """Estimated error of the image, ``10 log10`` of the mean squared phase error."""
        return float(20 * np.log10(np.hypot(self.common_rad, self.varying_rad) + 1e-12))


def estimate_residual(block: PulseBlock, geometry: Geometry, points: ArrayLike, *,
                      n_phases: int = 512) -> Residual:
    """Estimate the phase that is left in the pulses, and how well it is known.

    Parameters
    ----------
    block : PulseBlock
        Range profiles.
    geometry : Geometry
        Phase centres, nearly focused.
    points : (K, 3) array_like
        Bright points of the image, metres, at least two.
    n_phases : int
        Most phases to estimate; neighbouring pulses share one where there are more pulses.

    Returns
    -------
    Residual
    """
    n = min(n_phases, block.n_pulses)
    tiles = Tiles(block, geometry, points, n, pixels=_PIXELS)
    change = np.zeros((len(tiles.points), n))
    for power in _POWERS:
        step = -np.angle(_contributions(tiles, change, power).sum(axis=0))
        change += detrend(step[None])[0] / tiles.wavenumber
    found = np.unwrap(change[0] * tiles.wavenumber)
    along = _contributions(tiles, change)
    half = deal(tiles.points, geometry)
    halves = [found - np.angle(along[half == k].sum(axis=0)) for k in (0, 1)]
    phase, common = _told_from_noise(*(detrend(h[None])[0] for h in halves))
    centres = (np.arange(n) + 0.5) * block.n_pulses / n - 0.5
    half_path = np.interp(np.arange(block.n_pulses), centres, phase / tiles.wavenumber)
    left = along * np.exp(1j * (phase - found))
    planes = _planes(left, tiles.points)
    peaks = _contributions(tiles, change, _PEAK)
    coherence = np.abs(peaks.sum(axis=1)) / (np.abs(peaks).sum(axis=1) + 1e-30)
    return Residual(half_path, common, float(np.sqrt(np.mean(np.sum(planes ** 2, axis=1)))),
                    float(np.quantile(coherence, 0.9)), planes)


def absorb(residual: Residual, model: GeometryModel, parameters: np.ndarray, points: np.ndarray,
           wavenumber: float) -> np.ndarray:
    """Parameters of the model that also explain the phase that grows over the scene.

    Parameters
    ----------
    residual : Residual
        From `estimate_residual` at the same points and parameters.
    model : GeometryModel
        Unknowns.
    parameters : (Q,) float64
        Their values so far.
    points : (K, 3) float64
        Bright points, metres.
    wavenumber : float
        ``4 pi / lambda``, rad/m.

    Returns
    -------
    (Q,) float64
    """
    def phases(values: np.ndarray) -> np.ndarray:
        geometry = model(values)
        path = 0.5 * sum(np.linalg.norm(points[:, None] - c.mean(axis=1), axis=-1)
                         for c in geometry[:2])
        coefficients = wavenumber * path @ _smooth_basis(path.shape[1])
        return (coefficients - coefficients.mean(axis=0)).ravel()

    steps = 1e-2 * np.diag(model.scale)
    jacobian = np.stack([(phases(parameters + s) - phases(parameters - s)) / 2e-2
                         for s in steps], axis=1)
    # Least squares, where parameters of the expected size weigh as much as phases of _NOISE_RAD.
    normal = jacobian.T @ jacobian / len(points) + _NOISE_RAD ** 2 * np.eye(len(steps))
    right = -jacobian.T @ residual.planes_rad.ravel() / len(points)
    return parameters + model.scale * np.linalg.solve(normal, right)


def along_sight(geometry: Geometry, half_path_m: ArrayLike, centre_m: ArrayLike) -> Geometry:
    """Geometry whose half paths to a point are longer, each pulse by its own amount.

    Parameters
    ----------
    geometry : Geometry
        To change.
    half_path_m : (P,) array_like
        Change of the half path of each pulse, metres.
    centre_m : (3,) array_like
        Middle of the scene, metres.
    """
    def moved(centres: np.ndarray) -> np.ndarray:
        look = centres - np.asarray(centre_m)
        look /= np.linalg.norm(look, axis=-1, keepdims=True)
        return centres + np.asarray(half_path_m)[:, None, None] * look

    return geometry._replace(tx_m=moved(geometry.tx_m), rx_m=moved(geometry.rx_m))


def _contributions(tiles: Tiles, change_m: np.ndarray, power: int = 1) -> np.ndarray:
    """(K, U) contributions to the tiles, weighted by a power of each tile's own intensity.

    The sum over the tiles is the correlation of each profile with the profile of the sharpened
    image: echoes that overlap are part of it, not noise.
    """
    images = tiles.focus(change_m)
    intensity = np.square(np.abs(images))
    intensity /= intensity.max(axis=(1, 2), keepdims=True) + 1e-30
    weight = intensity ** power * images
    return tiles.correlate(change_m, weight.astype(np.complex64))[0]


def deal(points: np.ndarray, geometry: Geometry) -> np.ndarray:
    """(K,) 0 or 1: halves of the tiles of different range.

    Echoes of points at one range overlap; only together do such tiles explain the profiles.
    """
    middle = len(geometry.tx_m) // 2
    path = sum(np.linalg.norm(points - c[middle].mean(axis=0), axis=-1) for c in geometry[:2])
    rank = np.argsort(np.argsort(path))
    return rank * _PARTS // len(points) % 2


def _told_from_noise(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, float]:
    """Wiener filter from two estimates with independent noise; returns it and its rms error."""
    a, b = (dct(x, norm='ortho') for x in (first, second))
    box = np.ones(min(_BAND, a.size))
    box /= box.size
    signal = np.convolve(a * b, box, mode='same')
    total = np.convolve((0.5 * (a + b)) ** 2, box, mode='same') + 1e-30
    gain = np.clip(signal / total, 0.0, 1.0)
    left = np.sum(gain * (1 - gain) * total) / a.size
    return idct(gain * 0.5 * (a + b), norm='ortho'), float(np.sqrt(left))


def _planes(along: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(K, 4) smooth phases that grow linearly over the scene, fitted to all tiles."""
    # The phase of a mean over a tenth of the aperture cannot wrap where a tile is focused.
    box = np.ones(max(1, along.shape[1] // 10))
    phases = np.angle([np.convolve(row, box, mode='same') for row in along])
    smooth = phases @ _smooth_basis(along.shape[1])
    place = points[:, :2] - points[:, :2].mean(axis=0)
    weight = np.sqrt(np.abs(along.sum(axis=1)))[:, None]  # amplitude: the bright stand out more
    design = np.column_stack([np.ones(len(place)), place / np.abs(place).max()])
    slopes = np.linalg.lstsq(weight * design, weight * smooth, rcond=None)[0][1:]
    return design[:, 1:] @ slopes


def _smooth_basis(n: int) -> np.ndarray:
    """(n, 4) Legendre polynomials of degrees 2 to 5, each of mean square 1 / n^2."""
    u = np.linspace(-1, 1, n)
    basis, _ = np.linalg.qr(np.polynomial.legendre.legvander(u, _LOW_ORDERS))
    return basis[:, 2:] / np.sqrt(n)
