"""Which spatial frequencies the pulses of an acquisition put into a place of an image.

A pulse at the frequency f contributes the plane wave ``exp(+j 2 pi K . x)`` about a place x, with
``K = (f / c) (u_t + u_r)``, where u_t and u_r point from transmitter and receiver to x: the
gradient of the phase of equation 17. SICD describes an image by what of K lies in its plane
(NGA.STND.0024-1, section 2.2).
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ..acquisition import Acquisition

N_WEIGHTS = 64
_N_DIRECTIONS = 2048  # between the pulses, at which the density of a support is taken
_LEAST_BAND = 1e-3
_MAX_PULSES = 512  # more would not change a width by a thousandth


@dataclasses.dataclass(frozen=True, eq=False)
class SpatialSupport:
    """Spatial frequencies of a place along one direction of the image, cycles per metre.

    Attributes
    ----------
    low, high : float
        Its ends.
    weights : (64,) float64
        How much of the pulses and frequencies lies at even steps from one end to the other, the
        largest 1.
    width_m : float
        Width of the impulse response at -3 dB, metres.
    """

    low: float
    high: float
    weights: np.ndarray
    width_m: float

    @property
    def centre(self) -> float:
        """Middle of the support."""
        return 0.5 * (self.low + self.high)

    @property
    def bandwidth(self) -> float:
        """Extent of the support."""
        return self.high - self.low


def directions(acquisition: Acquisition, points_m) -> np.ndarray:
    """(P, S, 3) float64 half sums of the unit vectors from transmitter and receiver to points."""
    points = np.asarray(points_m, np.float64).reshape(-1, 3)
    total = np.zeros((acquisition.n_pulses, len(points), 3))
    for centres in (acquisition.tx_m, acquisition.rx_m):
        look = points - centres[:, None]
        total += 0.5 * look / np.linalg.norm(look, axis=-1, keepdims=True)
    return total


def thinned(acquisition: Acquisition) -> Acquisition:
    """The same acquisition with as many pulses as a support needs, the outermost among them."""
    chosen = np.unique(np.linspace(0, acquisition.n_pulses - 1, _MAX_PULSES).round().astype(int))
    return dataclasses.replace(
        acquisition, pointing=None, **{name: getattr(acquisition, name)[chosen]
                                       for name in ('stamp_ns', 'tx_m', 'rx_m')})


def support(acquisition: Acquisition, point_m, axis) -> SpatialSupport:
    """Spatial frequencies that the image has at a place along one direction.

    Parameters
    ----------
    acquisition : Acquisition
        Pulses, each of the same weight; the band counts as flat.
    point_m : (3,) array_like
        Place in the imaging frame, metres.
    axis : (3,) array_like
        Unit vector in the imaging frame.

    Returns
    -------
    SpatialSupport
    """
    along = directions(thinned(acquisition), point_m)[:, 0] @ np.asarray(axis, np.float64)
    between = np.interp(np.linspace(0, len(along) - 1, _N_DIRECTIONS), np.arange(len(along)),
                        along)
    ends = np.sort(np.multiply.outer(between, acquisition.wavenumbers_per_m), axis=1)
    low, high = float(ends.min()), float(ends.max())
    edges = np.linspace(low, high, 8 * N_WEIGHTS + 1)
    least = _LEAST_BAND * (high - low)  # of a direction across the axis
    share = (edges - ends[:, :1]) / np.maximum(ends[:, 1:] - ends[:, :1], least)
    density = np.diff(np.clip(share, 0.0, 1.0).mean(axis=0))
    weights = density.reshape(N_WEIGHTS, 8).sum(axis=1)
    return SpatialSupport(low, high, weights / weights.max(), _response_width(
        0.5 * (edges[1:] + edges[:-1] - low - high), density / density.sum()))


def _response_width(frequencies: np.ndarray, density: np.ndarray) -> float:
    """Width at -3 dB of ``sum density exp(j 2 pi k x)``, metres."""
    extent = np.ptp(frequencies)

    def level(x):
        return np.abs(density @ np.exp(2j * np.pi * frequencies * x))

    near, far = 0.0, 0.25 / extent
    while level(far) ** 2 > 0.5:
        near, far = far, 1.25 * far
    for _ in range(40):  # bisection to the last digit
        middle = 0.5 * (near + far)
        near, far = (middle, far) if level(middle) ** 2 > 0.5 else (near, middle)
    return near + far


def centres(acquisition: Acquisition, points_m, axis) -> np.ndarray:
    """(S,) float64 middles of the supports of places along a direction, cycles per metre."""
    along = directions(thinned(acquisition), points_m) @ np.asarray(axis, np.float64)
    ends = np.multiply.outer(np.array(acquisition.wavenumbers_per_m), along)
    return 0.5 * (ends.min(axis=(0, 1)) + ends.max(axis=(0, 1)))
