# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pose graphs come back to the bit; edges of registrations tell relative poses and errors."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import least_squares

from benchmarks.support.pose_graph_solver import chi_squared, solved
from sar_imaging.exploitation.registration import Registration
from sar_imaging.formats.pose_graph import PoseEdge, read_g2o, write_g2o

NUMBER = st.floats(allow_nan=False, allow_infinity=False, width=64)


@st.composite
def graphs(draw):
    n = draw(st.integers(0, 5))
    poses = np.array(draw(st.lists(st.tuples(NUMBER, NUMBER, NUMBER), min_size=n, max_size=n)))
    edges = []
    for _ in range(draw(st.integers(0, 4)) if n > 1 else 0):
        first, second = draw(st.lists(st.integers(0, n - 1), min_size=2, max_size=2, unique=True))
        half = np.array(draw(st.lists(st.floats(-1e6, 1e6), min_size=9, max_size=9)))
        information = half.reshape(3, 3) @ half.reshape(3, 3).T
        edges.append(PoseEdge(first, second, np.array(draw(st.tuples(NUMBER, NUMBER, NUMBER))),
                              np.tril(information) + np.tril(information, -1).T))
    return poses.reshape(-1, 3), edges


@settings(max_examples=50, deadline=None)
@given(graphs())
def test_a_graph_comes_back_to_the_bit(tmp_path_factory, graph):
    poses, edges = graph
    path = tmp_path_factory.mktemp('graph') / 'drive.g2o'
    write_g2o(path, poses, edges)
    back, others = read_g2o(path)
    np.testing.assert_array_equal(back, poses)
    assert len(others) == len(edges)
    for one, other in zip(edges, others, strict=True):
        assert (one.first, one.second) == (other.first, other.second)
        np.testing.assert_array_equal(one.relative, other.relative)
        np.testing.assert_array_equal(one.information, other.information)


def test_lines_are_those_that_g2o_documents(tmp_path):
    information = np.array([[1.0, 2.0, 3.0], [2.0, 14.0, 5.0], [3.0, 5.0, 36.0]])
    edge = PoseEdge(1, 0, np.array([0.25, -1.0, 0.5]), information)
    write_g2o(tmp_path / 'a', np.arange(6.0).reshape(2, 3), [edge])
    assert (tmp_path / 'a').read_text().splitlines() == [
        'VERTEX_SE2 0 0.0 1.0 2.0', 'VERTEX_SE2 1 3.0 4.0 5.0',
        'EDGE_SE2 1 0 0.25 -1.0 0.5 1.0 2.0 3.0 14.0 5.0 36.0']
    (tmp_path / 'a').write_text('VERTEX_SE2 0 0 1 2\n\nFIX 0\n')
    assert read_g2o(tmp_path / 'a')[0].tolist() == [[0.0, 1.0, 2.0]]


@pytest.mark.parametrize(('text', 'message'), [
    ('VERTEX_SE2 1 0 0 0', "line 1 is 'VERTEX_SE2 1 0 0 0'; expected VERTEX_SE2, the number 0"),
    ('VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1', 'line 1'),
    ('VERTEX_SE2 0 0 0 nan', 'finite numbers'),
    ('VERTEX_SE2 0 0 0 zero', 'zero'),
    ('VERTEX_SE2 0 0 0 0\nEDGE_SE2 0 1 0 0 0 1 0 0 1 0 1', 'expected two of the 1 poses'),
    ('VERTEX_SE2 0 0 0 0\nEDGE_SE2 0 0 0 0 0 1 0 0 1 0 1', 'expected two of the 1 poses'),
    ('VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 0 0 0\nEDGE_SE2 0 1 0 0 0 1 2 0 1 0 1', 'no covariance'),
    ('VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 0 0 0\nEDGE_SE2 0 1 0 0 inf 1 0 0 1 0 1', 'not finite'),
])
def test_damaged_files_are_refused_by_name(tmp_path, text, message):
    (tmp_path / 'drive.g2o').write_text(text)
    with pytest.raises(ValueError, match=message) as raised:
        read_g2o(tmp_path / 'drive.g2o')
    assert 'drive.g2o' in str(raised.value)


def registered(translation_m, rotation_rad, pivot_m, covariance):
    return Registration(np.array(translation_m), rotation_rad, covariance, np.array(pivot_m), 0.0,
                        (), 1.0, 0.5)


def matrix(pose):
    """Homogeneous matrix of a pose, written out here."""
    return np.array([[math.cos(pose[2]), -math.sin(pose[2]), pose[0]],
                     [math.sin(pose[2]), math.cos(pose[2]), pose[1]], [0.0, 0.0, 1.0]])


def pose_of(matrix):
    return np.array([matrix[0, 2], matrix[1, 2], math.atan2(matrix[1, 0], matrix[0, 0])])


def test_an_edge_of_a_registration_is_the_relative_pose_of_the_truth_and_its_error():
    rng = np.random.default_rng(1)
    reference, true = np.array([3.0, -2.0, 0.6]), np.array([5.0, 7.0, -2.9])
    wrong = np.array([1.5, -0.8, 0.05])  # how the odometry of the image errs, about the origin
    believed = pose_of(np.linalg.inv(matrix(wrong)) @ matrix(true))
    pivot = np.array([20.0, -12.0])
    moved = (matrix(wrong) @ [*pivot, 1.0])[:2] - pivot
    half = rng.normal(size=(3, 3)) * [[0.02], [0.02], [0.002]]
    covariance = half @ half.T
    found = registered(moved, wrong[2], pivot, covariance)
    edge = PoseEdge.of_registration(found, [reference, believed], 0, 1)
    relative = np.linalg.inv(matrix(reference)) @ matrix(true)
    assert edge.relative == pytest.approx(pose_of(relative), abs=1e-12)
    errors = []
    for moved in rng.multivariate_normal([*found.translation_m, wrong[2]], covariance, 4000):
        other = PoseEdge.of_registration(registered(moved[:2], moved[2], pivot, covariance),
                                         [reference, believed], 0, 1)
        errors.append(pose_of(np.linalg.inv(relative) @ matrix(other.relative)))
        assert (other.information == other.information.T).all()  # or write_g2o refuses it
    # of squares of errors, three a draw, normalised by the covariance: 3, within 4 deviations of
    # sqrt(6 / 4000), and half a per cent for what the rotation is not linear
    squares = [e @ edge.information @ e for e in errors]
    assert np.mean(squares) == pytest.approx(3.0, abs=0.17)
    refused = dataclasses.replace(found, refusal='several places fit about as well')
    with pytest.raises(ValueError, match='poses 0 and 1: several places'):
        PoseEdge.of_registration(refused, [reference, believed], 0, 1)


def test_the_example_solves_a_loop_as_dense_least_squares_do(tmp_path):
    rng = np.random.default_rng(2)
    n, std = 12, np.array([0.05, 0.02, 0.01])
    true = np.array([[10 * math.cos(t), 10 * math.sin(t), t + math.pi / 2]
                     for t in np.linspace(0.0, 2 * math.pi, n, endpoint=False)])

    def edge(first, second):
        relative = pose_of(np.linalg.inv(matrix(true[first])) @ matrix(true[second]))
        return PoseEdge(first, second, relative + std * rng.normal(size=3), np.diag(std ** -2))

    edges = [edge(k, k + 1) for k in range(n - 1)]
    start = [matrix(true[0])]
    for step in edges:
        start.append(start[-1] @ matrix(step.relative))
    start, edges = np.array([pose_of(m) for m in start]), [*edges, edge(n - 1, 0), edge(2, 8)]
    write_g2o(tmp_path / 'loop.g2o', start, edges)
    found = solved(*read_g2o(tmp_path / 'loop.g2o'))

    def errors(free):
        poses = [start[0], *free.reshape(-1, 3)]
        return np.concatenate([pose_of(np.linalg.inv(matrix(e.relative)) @ np.linalg.inv(
            matrix(poses[e.first])) @ matrix(poses[e.second])) / std for e in edges])

    dense = least_squares(errors, start[1:].ravel(), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    # least_squares differentiates numerically, to about 1e-8
    assert found[1:].ravel() == pytest.approx(dense.x, abs=1e-6)
    assert chi_squared(found, edges) == pytest.approx(2 * dense.cost)
    assert chi_squared(found, edges) < 0.1 * chi_squared(start, edges)
