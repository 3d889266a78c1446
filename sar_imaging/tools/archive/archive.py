# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Image an archive of recordings: a map of all of them, on this machine or on a cluster.

Run: sar-imaging archive JOB.yaml
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ...archive.job import changed, read_job
from ...archive.workflow import plan_archive, run_archive
from ..arguments import positive
from ..program import command_parser, main_of

_EPILOG = """\
Exit status: 0 all is done, 3 done but for losses that the summary names, 1 refused or stopped,
130 interrupted. The same command goes on where a job stopped, whatever stopped it.

  sar-imaging archive survey.yaml --plan
  sar-imaging archive survey.yaml
  sar-imaging archive survey.yaml --scheduler tcp://10.0.0.1:8786
"""


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = command_parser('sar-imaging archive', 'Image an archive of recordings and CPHD files.',
                       _EPILOG)
    p.add_argument('job', type=Path, help='job file (YAML), see docs/archives.md')
    p.add_argument('--plan', action='store_true',
                   help='tell time, memory and traffic, and stop before the work')
    p.add_argument('--workers', type=positive(int), metavar='N',
                   help='processes of this machine (default: one for each core)')
    p.add_argument('--memory', type=float, metavar='GB',
                   help='that a worker may take (default: memory_gb of the job)')
    p.add_argument('--scheduler', metavar='ADDRESS',
                   help='of a running Dask cluster, such as tcp://10.0.0.1:8786')
    p.add_argument('--output', type=Path, metavar='FOLDER',
                   help='of the results (default: output of the job)')
    return p


def run(arguments: argparse.Namespace) -> int:
    """Plan or do the job; returns the exit status."""
    memory = None if arguments.memory is None else 1e9 * arguments.memory
    output = None if arguments.output is None else arguments.output.absolute()
    job = changed(read_job(arguments.job), memory_bytes=memory, output=output)
    options = {'workers': arguments.workers, 'scheduler': arguments.scheduler,
               'tell': lambda text: print(text, flush=True)}
    if arguments.plan:
        _, summary = plan_archive(job, **options)
        for line in summary.troubles():
            print(line)
        return summary.exit_status
    summary = run_archive(job, **options)
    print(summary.told(job.output))
    return summary.exit_status


main = main_of(parser, run,
               interrupted='interrupted; the same command goes on where it stopped')

if __name__ == '__main__':
    sys.exit(main())
