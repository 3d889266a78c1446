"""Loaded by Dask's local workers: Ctrl-C in the terminal is for the job's own process alone."""

import signal


def dask_setup(worker) -> None:
    """Dask calls this when a worker starts."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
