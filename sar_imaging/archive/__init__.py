# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Archives of many recordings: images, strips, mosaics and coherence, divided among workers.

- `job`: what is to be made, from a file in YAML;
- `recordings`, `scans`: which recordings there are, and what each tells;
- `division`, `pieces`: the work in pieces that fit a worker, and what they take together;
- `windows`, `storage`: pixels of the map, and arrays of them on disk;
- `images`, `tiles`: images of apertures; strips, mosaics and coherence;
- `files`, `catalogue`: for other programs and for people;
- `provenance`: pixels of the mosaic against correlation from the recordings;
- `cluster`, `runner`, `records`: pieces on Dask, and what is finished;
- `workflow`: all of it, from the job to its products.
"""

from .job import read_job
from .provenance import check_mosaic
from .workflow import run_archive

__all__ = ['check_mosaic', 'read_job', 'run_archive']
