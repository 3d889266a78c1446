# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Jobs that tasks take in turn: each is done, and done once."""

import numba
import numpy as np
import pytest

from sar_imaging.backends.cpu.instructions import job_counter, take_job


@numba.njit(parallel=True)
def _count(jobs, done, n_tasks):
    for task in numba.prange(n_tasks):
        job = take_job(jobs)
        while job < len(done):
            done[job] += 1 + 1000 * task
            job = take_job(jobs)


@pytest.mark.parametrize(('n_jobs', 'n_tasks'), [(0, 2), (1, 4), (100_000, 4)])
def test_every_job_is_taken_once(n_jobs, n_tasks):
    jobs, done = job_counter(), np.zeros(n_jobs, np.int64)
    _count(jobs.ctypes.data, done, n_tasks)
    np.testing.assert_array_equal(done % 1000, 1)
    assert jobs[0] == n_jobs + n_tasks  # each task asked until none was left
