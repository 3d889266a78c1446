# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Copies beside the device's work: right in any order that a device may do them in.

The simulator does everything at once. Here copies are made as late as their ends are waited for,
or as early as their marks allow while the device's work waits as long as it may.
"""

import numpy as np
import pytest

from sar_imaging.backends.cuda.transfers import Copies, add_to_host, in_pieces, to_host

PIECES = [slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 10)]


class LateCopies(Copies):
    """Copies are made when somebody waits for their end, and not before."""

    def __init__(self):
        super().__init__()
        self._begun = {}

    def send(self, there, here, after):
        number = len(self._begun)
        self._begun[number] = there, here
        return number

    def fetch(self, here, there, after):
        return self.send(here, there, after)

    def wait(self, end):
        if end is not None and self._begun[end] is not None:
            there, here = self._begun[end]
            _copy(there, here)
            self._begun[end] = None

    finish = wait


def _copy(there, here):
    if isinstance(there, np.ndarray):
        there[...] = here
    else:  # of a device
        there.set(here)


class LateWork(Copies):
    """Copies are made at once; the device works when a copy, or nothing else, waits for it."""

    def __init__(self):
        super().__init__()
        self.work = []

    def mark(self):
        return len(self.work)

    def send(self, there, here, after):
        self.do(after)
        _copy(there, here)

    def do(self, count):
        for number in range(count):
            if self.work[number] is not None:
                self.work[number]()
                self.work[number] = None


@pytest.fixture
def samples():
    rng = np.random.default_rng(2)
    return (rng.standard_normal((10, 4)) + 1j * rng.standard_normal((10, 4))).astype(np.complex64)


@pytest.mark.parametrize('integers', [False, True])
def test_samples_are_there_when_they_are_read(samples, integers):
    if integers:
        samples = (1000 * samples.view(np.float32)).astype(np.int16).reshape(10, 4, 2)
    found = [(piece, to_host(some).copy())
             for piece, some in in_pieces(samples, PIECES, LateCopies())]
    assert [piece for piece, _ in found] == PIECES
    assert found[0][1].dtype == samples.dtype
    np.testing.assert_array_equal(np.concatenate([some for _, some in found]), samples)


def test_samples_stay_until_the_device_has_read_them(samples):
    copies, found = LateWork(), []
    for _, some in in_pieces(samples, PIECES, copies):
        copies.work.append(lambda some=some: found.append(to_host(some).copy()))
    copies.do(len(PIECES))
    np.testing.assert_array_equal(np.concatenate(found), samples)


def test_buffers_are_given_back_after_the_last_copy(samples):
    """Also where the work fails."""
    copies = LateCopies()
    pieces = in_pieces(samples, PIECES, copies)
    next(pieces)
    next(pieces)
    pieces.close()
    assert set(copies._begun.values()) == {None}


@pytest.mark.parametrize('n_bytes', [1, 100, 10_000])
@pytest.mark.parametrize('transposed', [False, True])
def test_images_are_added_to_the_hosts(samples, n_bytes, transposed):
    image = np.full((4, 10) if transposed else (10, 4), 1j, np.complex64)
    add_to_host(samples, image.T if transposed else image, LateCopies(), n_bytes)
    np.testing.assert_array_equal(image.T if transposed else image, samples + np.complex64(1j))


def test_large_images_are_added_by_several_threads():
    rng = np.random.default_rng(2)
    there = rng.standard_normal((1501, 512), np.float32).view(np.complex64)
    image = there.copy()
    add_to_host(there, image)
    np.testing.assert_array_equal(image, there + there)
