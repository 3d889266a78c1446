# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Workers that Dask forks from a process that has loaded what they import, for two seconds each.

Tests of the command start theirs as users do.
"""

import dask
from distributed.utils import get_mp_context


def forked_workers():
    """A context in which workers are started so."""
    settings = dask.config.set({'distributed.worker.multiprocessing-method': 'forkserver'})
    get_mp_context()  # Dask's own choice of modules, made once
    get_mp_context().set_forkserver_preload(
        ['distributed', 'distributed.nanny', 'zarr', 'sar_imaging.archive.runner'])
    return settings
