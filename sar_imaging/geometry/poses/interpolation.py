"""Interpolate poses by a local cubic, so that later poses do not change the result."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

REACH = 3  # poses on each side of a time that its interpolation looks at
_STENCIL = 5  # poses that make the velocity at a pose
_LARGEST_TURN_RAD = 2.5  # within a stencil; rotation vectors are unique below pi


def interpolate_poses(stamp_ns: np.ndarray, position_m: np.ndarray, quaternion: np.ndarray,
                      segment: np.ndarray, left: np.ndarray, query_ns: np.ndarray,
                      ) -> tuple[np.ndarray, Rotation]:
    """Interpolate between given pairs of poses.

    Cubic Hermite interpolation; the velocities at the poses come from the polynomial through five
    poses around each (fewer at the ends of a segment). Attitudes are interpolated in the same way
    as rotation vectors relative to the pose before, which for two poses is spherical linear
    interpolation. With poses h apart the error inside a segment is at most
    ``h^4 |x''''| / 384 + h^5 |x'''''| / 310`` and terms in h^6; the error of attitudes follows
    from their rotation vectors in the same way.

    Parameters
    ----------
    stamp_ns : (N,) int64
        Times of the poses, strictly ascending, nanoseconds.
    position_m : (N, 3) float64
        Positions, metres.
    quaternion : (N, 4) float64
        Unit quaternions x, y, z, w that turn body vectors into the frame of the positions.
    segment : (N,) int64
        Number of the unbroken piece of track each pose belongs to, ascending.
    left : (P,) int64
        Pose before each query; the next one must be in the same segment.
    query_ns : (P,) int64
        Times from that of ``left`` to that of ``left + 1``, nanoseconds.

    Returns
    -------
    position_m : (P, 3) float64
        Metres.
    attitude : scipy.spatial.transform.Rotation
        P rotations from the body into the frame of the positions.
    """
    base, which = np.unique(left, return_inverse=True)
    window = _Window(stamp_ns, position_m, quaternion, segment, base)
    h = ((stamp_ns[base + 1] - stamp_ns[base]) * 1e-9)[which][:, None]
    u = ((query_ns - stamp_ns[left]) * 1e-9)[:, None] / h
    slope, next_slope, step = (v[which] for v in (
        window.slopes(base), window.slopes(base + 1), window.step))
    change = (u * (1 - u) ** 2 * h * slope - u ** 2 * (1 - u) * h * next_slope
              + u ** 2 * (3 - 2 * u) * step)
    attitude = Rotation.from_quat(quaternion[left]) * Rotation.from_rotvec(change[:, 3:])
    return position_m[left] + change[:, :3], attitude


class _Window:
    """Displacements and rotation vectors of the poses around each of U bases, relative to it."""

    def __init__(self, stamp_ns, position_m, quaternion, segment, base):
        self._first = np.searchsorted(segment, segment[base], 'left')
        self._stop = np.searchsorted(segment, segment[base], 'right')
        self._count = np.minimum(_STENCIL, self._stop - self._first)
        self._start = self._stencil_start(base)
        nodes = self._start[:, None] + np.arange(_STENCIL + 1)
        nodes = np.minimum(nodes, self._stop[:, None] - 1)  # repeated where a segment is short
        self._stamp = stamp_ns[nodes]
        move = position_m[nodes] - position_m[base][:, None]
        inverse = Rotation.from_quat(np.repeat(quaternion[base], nodes.shape[1], axis=0)).inv()
        turn = (inverse * Rotation.from_quat(quaternion[nodes.ravel()])).as_rotvec()
        self._values = np.concatenate([move, turn.reshape(*nodes.shape, 3)], axis=-1)
        rows = np.arange(len(base))
        self.step = self._values[rows, base + 1 - self._start]
        turned = np.linalg.norm(self._values[..., 3:], axis=-1).max(axis=1)
        self._spins = turned > _LARGEST_TURN_RAD
        self._mean_turn = self.step[:, 3:] * (
            1e9 / (stamp_ns[base + 1] - stamp_ns[base]))[:, None]

    def _stencil_start(self, node) -> np.ndarray:
        return np.clip(node - _STENCIL // 2, self._first, self._stop - self._count)

    def slopes(self, node) -> np.ndarray:
        """(U, 6) derivatives by time at one pose near each base; mean turning rate in a spin."""
        out = np.empty((len(node), 6))
        start = self._stencil_start(node) - self._start
        for size in np.unique(self._count):
            some = np.flatnonzero(self._count == size)
            stencil = start[some, None] + np.arange(size)
            at = node[some] - self._start[some] - start[some]
            stamp = self._stamp[some[:, None], stencil]
            time_s = (stamp - stamp[np.arange(some.size), at][:, None]) * 1e-9
            out[some] = np.einsum('um,umk->uk', _derivative_weights(time_s, at),
                                  self._values[some[:, None], stencil])
        out[self._spins, 3:] = self._mean_turn[self._spins]
        return out


def _derivative_weights(time_s: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(U, M) weights of the derivative at node `at` of each row, whose time is zero."""
    rows = np.arange(len(time_s))
    between = time_s[:, :, None] - time_s[:, None, :]
    np.einsum('umm->um', between)[:] = 1.0
    product = between.prod(axis=2)  # of the distances of each node to all others
    distance = time_s.copy()
    distance[rows, at] = 1.0
    weights = product[rows, at][:, None] / product / -distance
    weights[rows, at] = 0.0
    weights[rows, at] = -weights.sum(axis=1)
    return weights
