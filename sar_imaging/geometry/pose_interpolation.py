"""Positions and attitudes between poses: a local cubic whose result no later pose changes."""

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
    first = np.searchsorted(segment, segment[base], 'left')
    stop = np.searchsorted(segment, segment[base], 'right')
    step_s = (stamp_ns[base + 1] - stamp_ns[base]) * 1e-9
    end = _relative(position_m, quaternion, base, (base + 1)[:, None])[:, 0]
    slopes = [_slopes(stamp_ns, position_m, quaternion, base, base + i, first, stop)
              for i in (0, 1)]
    slopes = [_calm(slope, end, step_s) for slope in slopes]
    h = step_s[which][:, None]
    u = ((query_ns - stamp_ns[left]) * 1e-9)[:, None] / h
    change = (u * (1 - u) ** 2 * h * slopes[0][which] - u ** 2 * (1 - u) * h * slopes[1][which]
              + u ** 2 * (3 - 2 * u) * end[which])
    attitude = Rotation.from_quat(quaternion[left]) * Rotation.from_rotvec(change[:, 3:])
    return position_m[left] + change[:, :3], attitude


def _relative(position_m, quaternion, base, others) -> np.ndarray:
    """(U, M, 6) displacement and rotation vector from each base to its other poses."""
    shape = others.shape
    move = position_m[others] - position_m[base][:, None]
    inverse = Rotation.from_quat(np.repeat(quaternion[base], shape[1], axis=0)).inv()
    turn = (inverse * Rotation.from_quat(quaternion[others.ravel()])).as_rotvec()
    return np.concatenate([move, turn.reshape(*shape, 3)], axis=-1)


def _slopes(stamp_ns, position_m, quaternion, base, node, first, stop) -> np.ndarray:
    """(U, 6) derivatives by time at `node`; NaN rotations where they turn too far."""
    out = np.empty((len(base), 6))
    count = np.minimum(_STENCIL, stop - first)
    start = np.clip(node - _STENCIL // 2, first, stop - count)
    for size in np.unique(count):
        some = count == size
        others = start[some, None] + np.arange(size)
        values = _relative(position_m, quaternion, base[some], others)
        if np.any(turning := np.linalg.norm(values[..., 3:], axis=-1).max(axis=1)
                  > _LARGEST_TURN_RAD):
            values[turning, :, 3:] = np.nan
        time_s = (stamp_ns[others] - stamp_ns[node[some]][:, None]) * 1e-9
        out[some] = np.einsum('um,umk->uk', _derivative_weights(time_s), values)
    return out


def _derivative_weights(time_s: np.ndarray) -> np.ndarray:
    """(U, M) weights of the derivative at time zero, which is one of the M times of each row."""
    at = np.argmin(np.abs(time_s), axis=1)
    between = time_s[:, :, None] - time_s[:, None, :]
    np.einsum('umm->um', between)[:] = 1.0
    product = between.prod(axis=2)  # of the distances of each node to all others
    rows = np.arange(len(time_s))
    with np.errstate(divide='ignore', invalid='ignore'):
        weights = product[rows, at][:, None] / product / -time_s
    weights[rows, at] = 0.0
    weights[rows, at] = -weights.sum(axis=1)
    return weights


def _calm(slope: np.ndarray, end: np.ndarray, step_s: np.ndarray) -> np.ndarray:
    """Slopes with the mean turning rate, plain slerp, where a stencil turns too far."""
    return np.where(np.isnan(slope), end / step_s[:, None], slope)
