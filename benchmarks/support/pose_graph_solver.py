# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The poses that fit a pose graph best: an example with SciPy; GTSAM and Ceres read the same file.

Gauss-Newton steps of ``sum e' I e`` over the edges (Grisetti et al., "A Tutorial on Graph-Based
SLAM", 2010), with e the measured pose's difference to the graph's, seen from the measured one.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve

from sar_imaging.formats.pose_graph import PoseEdge


def solved(poses, edges: list[PoseEdge], rounds: int = 50) -> np.ndarray:
    """(N, 3) poses that fit best; the first stays where it is.

    Parameters
    ----------
    poses : (N, 3) array_like
        x, y (metres) and heading (radians) to begin with.
    edges : list of PoseEdge
        Between them.
    rounds : int
        Most steps.
    """
    poses = np.array(poses, np.float64)
    information = sparse.block_diag([edge.information for edge in edges], format='csr')
    for _ in range(rounds):
        error, slope = _errors(poses, edges)
        slope = slope[:, 3:]
        normal = (slope.T @ information @ slope).tocsc()
        move = spsolve(normal, -(slope.T @ (information @ error))).reshape(-1, 3)
        poses[1:] += move
        if np.abs(move).max() < 1e-9:
            break
    return poses


def chi_squared(poses, edges: list[PoseEdge]) -> float:
    """What `solved` makes small."""
    error = _errors(np.asarray(poses), edges)[0].reshape(-1, 3)
    return float(sum(e @ edge.information @ e for e, edge in zip(error, edges, strict=True)))


def _errors(poses, edges) -> tuple[np.ndarray, sparse.csr_array]:
    """(3 E,) errors of all edges, and their derivatives (3 E, 3 N) by the poses."""
    first, second = (np.array([getattr(e, name) for e in edges]) for name in ('first', 'second'))
    measured = np.array([e.relative for e in edges])
    own, turn = _rotations(poses[first, 2]), _rotations(measured[:, 2])
    apart = poses[second] - poses[first]
    error = np.empty((len(edges), 3))
    seen = np.einsum('eji,ej->ei', own, apart[:, :2])
    error[:, :2] = np.einsum('eji,ej->ei', turn, seen - measured[:, :2])
    error[:, 2] = np.remainder(apart[:, 2] - measured[:, 2] + np.pi, 2 * np.pi) - np.pi
    by_second = np.zeros((len(edges), 3, 3))
    by_second[:, :2, :2] = np.einsum('eki,ejk->eij', turn, own)
    by_second[:, 2, 2] = 1.0
    by_first = -by_second
    by_first[:, :2, 2] = np.einsum('eji,ej->ei', turn, np.stack([seen[:, 1], -seen[:, 0]], 1))
    row, column = np.meshgrid(np.arange(3), np.arange(3), indexing='ij')
    rows = 3 * np.arange(len(edges))[:, None, None] + row
    columns = [3 * k[:, None, None] + column for k in (first, second)]
    slope = sparse.csr_array((np.concatenate([by_first, by_second]).ravel(),
                              (np.concatenate([rows, rows]).ravel(),
                               np.concatenate(columns).ravel())),
                             shape=(3 * len(edges), 3 * len(poses)))
    return error.ravel(), slope


def _rotations(angle) -> np.ndarray:
    """(E, 2, 2) rotations."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], -2)
