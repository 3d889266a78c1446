# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pose graphs as g2o files, which GTSAM and Ceres read: loop closures of a robot's images.

Poses are x, y (metres) and heading (radians, counter-clockwise). A file has a line ``VERTEX_SE2``
for each pose and ``EDGE_SE2`` for each measurement between two (Kümmerle et al., "g2o: a general
framework for graph optimization", ICRA 2011), and no other: Ceres refuses what it does not know.
"""

from __future__ import annotations

import dataclasses
import math
import os

import numpy as np
from numpy.typing import ArrayLike

from ..exploitation.registration import Registration
from ..files import read_text, reading, replacing
from ..geometry.track import plane_rotation

_POSE, _EDGE, _FIXED = 'VERTEX_SE2', 'EDGE_SE2', 'FIX'  # g2o itself writes the last
_MOST_BYTES = 1_000_000_000
_UPPER = np.triu_indices(3)


@dataclasses.dataclass(frozen=True, eq=False)
class PoseEdge:
    """What was measured between two poses.

    Attributes
    ----------
    first, second : int
        Numbers of the poses.
    relative : (3,) float64
        x, y (metres) and heading (radians) of the second, seen from the first.
    information : (3, 3) float64
        Inverse of the covariance of its error, along the axes of the second pose, as g2o and
        GTSAM take it.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.formats.pose_graph import PoseEdge
    >>> step = PoseEdge(0, 1, np.array([2.0, 0.0, 0.01]), np.diag([400.0, 900.0, 1e6]))
    >>> step.relative.tolist()
    [2.0, 0.0, 0.01]
    """

    first: int
    second: int
    relative: np.ndarray
    information: np.ndarray

    @classmethod
    def of_registration(cls, found: Registration, poses: ArrayLike, first: int,
                        second: int) -> PoseEdge:
        """Edge from the pose of a reference to that of the image that was found in it.

        Parameters
        ----------
        found : Registration
            Accepted.
        poses : (N, 3) array_like
            Poses that both images were formed with.
        first, second : int
            That of the reference, and that of the image.

        Returns
        -------
        PoseEdge

        Raises
        ------
        ValueError
            The registration was refused.
        """
        if not found.accepted:
            raise ValueError(f'no edge between the poses {first} and {second}: {found.refusal}')
        reference, image = np.asarray(poses, np.float64)[[first, second]]
        place, heading = found.corrected(image[:2]), image[2] + found.rotation_rad
        x, y = place - found.pivot_m - found.translation_m
        error = np.array([[1.0, 0.0, -y], [0.0, 1.0, x], [0.0, 0.0, 1.0]])
        error[:2] = plane_rotation(heading).T @ error[:2]
        information = np.linalg.inv(error @ found.covariance @ error.T)
        return cls(first, second, np.array([
            *(plane_rotation(reference[2]).T @ (place - reference[:2])),
            math.remainder(heading - reference[2], math.tau)]), (information + information.T) / 2)


def write_g2o(path: os.PathLike[str] | str, poses: ArrayLike, edges: list[PoseEdge]) -> None:
    """Write a pose graph as a g2o file.

    Parameters
    ----------
    path : path
        File to write; complete or absent.
    poses : (N, 3) array_like
        x, y (metres) and heading (radians).
    edges : list of PoseEdge
        Between them. Numbers keep all their digits.

    Raises
    ------
    ValueError
        A shape is wrong, a number is not finite, an edge leads to no pose or to its own, or an
        information matrix is not symmetric or has a negative eigenvalue.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.formats.pose_graph import PoseEdge, read_g2o, write_g2o
    >>> edge = PoseEdge(0, 1, np.array([2.0, 0.0, 0.01]), np.diag([400.0, 900.0, 1e6]))
    >>> write_g2o('drive.g2o', [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]], [edge])
    >>> with open('drive.g2o') as file:
    ...     print(file.read().splitlines()[2])
    EDGE_SE2 0 1 2.0 0.0 0.01 400.0 0.0 0.0 900.0 0.0 1000000.0
    >>> poses, [back] = read_g2o('drive.g2o')
    >>> poses.shape, back.information.diagonal().tolist()
    ((2, 3), [400.0, 900.0, 1000000.0])
    """
    poses = np.asarray(poses, np.float64)
    _check(poses, edges)
    lines = [_line(_POSE, [k], pose) for k, pose in enumerate(poses)]
    lines += [_line(_EDGE, [e.first, e.second], [*e.relative, *e.information[_UPPER]])
              for e in edges]
    with replacing(path) as part:
        part.write_text(''.join(lines), encoding='ascii')


def read_g2o(path: os.PathLike[str] | str) -> tuple[np.ndarray, list[PoseEdge]]:
    """Read a pose graph of two dimensions.

    Parameters
    ----------
    path : path
        File that `write_g2o`, g2o or GTSAM wrote, its poses numbered from 0.

    Returns
    -------
    poses : (N, 3) float64
        x, y (metres) and heading (radians).
    edges : list of PoseEdge

    Raises
    ------
    FileNotFoundError
        There is none.
    ValueError
        It is no such file, is damaged, or has what `write_g2o` refuses.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.formats.pose_graph import PoseEdge, read_g2o, write_g2o
    >>> edge = PoseEdge(0, 1, np.array([2.0, 0.0, 0.01]), np.diag([400.0, 900.0, 1e6]))
    >>> write_g2o('drive.g2o', [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]], [edge])
    >>> read_g2o('drive.g2o')[0].tolist()
    [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
    """
    poses: list[list[float]] = []
    edges: list[PoseEdge] = []
    with reading(path, 'a pose graph in the format of g2o'):
        for number, line in enumerate(read_text(path, _MOST_BYTES).splitlines(), 1):
            tag, *words = line.split() or [_FIXED]
            if tag == _POSE and len(words) == 4 and words[0] == str(len(poses)):
                poses.append([float(word) for word in words[1:]])
            elif tag == _EDGE and len(words) == 11:
                values = np.array([float(word) for word in words[2:]])
                information = np.zeros((3, 3))
                information[_UPPER] = information.T[_UPPER] = values[3:]
                edges.append(PoseEdge(int(words[0]), int(words[1]), values[:3], information))
            elif tag != _FIXED:
                raise ValueError(
                    f'line {number} is {line[:60]!r}; expected {_POSE}, the number {len(poses)} '
                    f'and 3 values, or {_EDGE}, two numbers of poses and 9 values')
        found = np.array(poses, np.float64).reshape(-1, 3)
        _check(found, edges)
    return found, edges


def _check(poses: np.ndarray, edges: list[PoseEdge]) -> None:
    if poses.ndim != 2 or poses.shape[1] != 3 or not np.isfinite(poses).all():
        raise ValueError(f'poses of the shape {poses.shape}; expected (n, 3) finite numbers')
    for edge in edges:
        between = f'the edge between the poses {edge.first} and {edge.second}'
        if edge.first == edge.second or not all(
                0 <= k < len(poses) for k in (edge.first, edge.second)):
            raise ValueError(f'{between}; expected two of the {len(poses)} poses')
        values = np.concatenate([edge.relative, np.ravel(edge.information)])
        if values.shape != (12,) or not np.isfinite(values).all():
            raise ValueError(f'{between} has values that are not finite, or not 3 and 3 x 3')
        spectrum = np.linalg.eigvalsh(edge.information)
        if (edge.information != edge.information.T).any() or (
                spectrum[0] < -1e-9 * abs(spectrum[2])):
            raise ValueError(f'{between} has an information matrix that is the inverse of no '
                             f'covariance: {edge.information.tolist()}')


def _line(tag: str, numbers: list[int], values: ArrayLike) -> str:
    return ' '.join([tag, *map(str, numbers), *(repr(float(v)) for v in np.asarray(values))]) \
        + '\n'
