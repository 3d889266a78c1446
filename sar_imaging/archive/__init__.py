"""Archives of many recordings: images, strips, mosaics and coherence, divided among workers.

- `jobs`: what is to be made, and how the work is divided.
- `products`: what pieces compute on a worker, and what they write.
- `running`: pieces on Dask: order, records, retries, losses; on this machine or a cluster.
- `tasks`: what a worker runs for each kind of piece.
- `workflow`: all of it, from Python: `run_archive` and `plan_archive`.
"""

from .jobs import read_job
from .products import check_mosaic
from .workflow import run_archive

__all__ = ['check_mosaic', 'read_job', 'run_archive']
