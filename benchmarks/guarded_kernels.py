# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Look for compiled loops that write beside their arrays, over the cases of a campaign.

Run from the repository root: ``python -m benchmarks.guarded_kernels --cases 300``.
"""

from __future__ import annotations

import argparse
import collections
import logging

import numpy as np
from tqdm import tqdm

from benchmarks.prediction_campaign import IMAGERS, campaign_case
from benchmarks.support.guarded_memory import guarded


def overwritten(seed: int, names=('exact', 'afbp', 'live')) -> tuple[list[str], list[str]]:
    """Where images of a case write beside arrays, and by which methods they are formed."""
    case, found, methods = campaign_case(seed), [], []
    for name in names:
        rng = np.random.default_rng([seed, list(IMAGERS).index(name)])
        with guarded() as guards:
            try:
                *_, more = IMAGERS[name][0](case, rng)
            except ValueError:  # refused
                continue
            found += [f'{seed} {name}: {where}' for where in guards.broken()]
        methods.append(more.get('method', name))
    return found, methods


def main() -> None:
    """Print what was written beside, and how many images were formed by which methods."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--cases', type=int, default=300)
    parser.add_argument('--first-seed', type=int, default=0)
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    count: collections.Counter[str] = collections.Counter()
    for seed in tqdm(range(arguments.first_seed, arguments.first_seed + arguments.cases)):
        found, methods = overwritten(seed)
        count.update(methods)
        for line in found:
            print(line)
    print(dict(count))


if __name__ == '__main__':
    main()
