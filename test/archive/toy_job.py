# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A job of toys as a process of its own: prints every finished piece, then the summary as JSON.

Arguments: output folder, leaves, workers, rounds, and the address of a scheduler or nothing.
"""

import json
import sys
from pathlib import Path

import archive_toys
from forked_workers import forked_workers

from sar_imaging.archive.cluster import open_cluster
from sar_imaging.archive.runner import run_pieces


def main():
    output, leaves, workers, rounds = Path(sys.argv[1]), *map(int, sys.argv[2:5])
    scheduler = (sys.argv[5:] or [None])[0]
    with forked_workers(), open_cluster(output, workers=workers, scheduler=scheduler) as client:
        print('started', flush=True)
        summary = run_pieces(archive_toys.tree(leaves, rounds=rounds), archive_toys.compute,
                             client, output, on_result=lambda p, r: print(p.key, flush=True))
    print(json.dumps(summary.as_json()))
    return summary.exit_status


if __name__ == '__main__':
    sys.exit(main())
