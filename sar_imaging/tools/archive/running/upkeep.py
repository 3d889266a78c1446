"""Replaces local workers that died while they started, which Dask's nannies do not."""

from __future__ import annotations

from collections import Counter

_LOOKS = 4  # without a process: a nanny that starts one needs less than a second


class Upkeep:
    """Keeps the number of this machine's workers as it was in the beginning.

    Parameters
    ----------
    client : distributed.Client
        Clusters that are not of this machine keep themselves.
    """

    def __init__(self, client):
        cluster = client.cluster
        local = cluster is not None and type(cluster).__name__ == 'LocalCluster'
        self._cluster = cluster if local else None
        self._n_workers = len(cluster.worker_spec) if local else 0
        self._dead: Counter = Counter()

    def look(self) -> None:
        """Replace workers that have had no process for some looks; call it every second."""
        if self._cluster is None:
            return
        nannies = list(self._cluster.workers.items())  # workers of this process have no pid
        dead = [name for name, nanny in nannies if getattr(nanny, 'pid', 0) is None]
        self._dead = Counter({name: self._dead[name] + 1 for name in dead})
        gone = [name for name, looks in self._dead.items() if looks >= _LOOKS]
        if gone:
            self._cluster.sync(self._cluster.scale_down, gone)
        if len(self._cluster.worker_spec) < self._n_workers:
            self._cluster.scale(self._n_workers)
