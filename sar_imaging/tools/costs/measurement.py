"""Time the experiments on one thread or a device, and fit costs of operations to the times."""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import scipy.optimize
from tqdm import tqdm

from sar_imaging.backends import CUDA
from sar_imaging.compilation import numba
from sar_imaging.planning.costs import DEFAULT, CostModel
from sar_imaging.tools.costs.experiments import (
    FUSION_OVERHEAD,
    IMAGE_OVERHEAD,
    Experiment,
    experiments,
)
from sar_imaging.tools.costs.scenes import Scenes

_ROUNDS, _LEAST_S = 7, 0.2  # of each experiment
_FURTHEST = 50.0  # from the default, a factor
# Weight of an equation that a cost has the common ratio to its default, which holds where times
# tell nothing of it
_COMMON = 0.1


@dataclasses.dataclass(frozen=True)
class Timing:
    """How long an experiment took.

    Attributes
    ----------
    name : str
        What it was.
    operations : mapping of str to float
        How often it did each operation.
    seconds : float
        Median of the rounds.
    """

    name: str
    operations: Mapping[str, float]
    seconds: float


def measure(name: str = 'cpu', *, rounds: int = _ROUNDS, least_s: float = _LEAST_S,
            progress: bool = False, scenes: Scenes | None = None) -> list[Timing]:
    """Time all experiments, on one thread or on a device.

    Times of a processor are its own: what else it does in the meantime is not counted, though it
    takes from the cache. Those of a device end when it is done with all it was given.

    Parameters
    ----------
    name : str
        Backend, ``'cpu'`` or ``'cuda'``.
    rounds : int
        Of each experiment, at least, after one that compiles and fetches memory.
    least_s : float
        Rounds take as long together, at least, seconds.
    progress : bool
        Show a progress bar on standard error.
    scenes : Scenes, optional
        As for `experiments`.

    Raises
    ------
    DeviceError
        There is no device that works, or it fails.
    """
    clock = time.perf_counter if name == CUDA else time.process_time
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        return [_timed(experiment, rounds, least_s, clock) for experiment in
                tqdm(experiments(name, scenes), desc='experiments', unit='', disable=not progress)]
    finally:
        numba.set_num_threads(threads)


def _timed(experiment: Experiment, rounds: int, least_s: float,
           clock: Callable[[], float]) -> Timing:
    experiment.run()
    seconds: list[float] = []
    while len(seconds) < rounds or sum(seconds) < least_s:
        begin = clock()
        experiment.run()
        seconds.append(clock() - begin)
    return Timing(experiment.name, experiment.operations, statistics.median(seconds))


def solve(timings: Sequence[Timing], usual: CostModel = DEFAULT
          ) -> tuple[CostModel, np.ndarray]:
    """Costs with which predicted times are nearest to measured ones.

    Least squares of the relative errors, ``sum_i (sum_f n_if c_f / t_i - 1)^2``: the costs c_f are
    positive, and within a factor of 50 of the default.

    Parameters
    ----------
    timings : sequence of Timing
        Of all experiments.
    usual : CostModel
        The default: of the processor, or of a device.

    Returns
    -------
    model : CostModel
    predicted : (len(timings),) float64
        Predicted times over measured ones.
    """
    kind, usual = type(usual), dataclasses.asdict(usual)
    overhead = usual.pop('subaperture')
    usual |= dict.fromkeys((IMAGE_OVERHEAD, FUSION_OVERHEAD), overhead / 2)
    counts = np.array([[t.operations.get(name, 0.0) for name in usual] for t in timings])
    shares = 1e-9 * counts * list(usual.values()) / np.array([[t.seconds] for t in timings])
    n = len(usual)
    # Unknown are the ratios to the defaults, and last the one that they have in common.
    equations = np.vstack([np.c_[shares, np.zeros(len(timings))],
                           _COMMON * np.c_[np.eye(n), -np.ones(n)]])
    right = np.r_[np.ones(len(timings)), np.zeros(n)]
    ratios = scipy.optimize.lsq_linear(equations, right, (1 / _FURTHEST, _FURTHEST)).x[:n]
    found = {name: float(ratio * value)
             for ratio, (name, value) in zip(ratios, usual.items(), strict=True)}
    found['subaperture'] = found.pop(IMAGE_OVERHEAD) + found.pop(FUSION_OVERHEAD)
    return kind(**found), shares @ ratios
