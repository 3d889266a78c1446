# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pin images, predicted errors, plans and times, and compare a tree with what was pinned.

Run from the repository root. What is committed in `benchmarks/goldens` was written by one
processor; others round differently in the last places. A change is compared on one machine with
what the tree before it wrote there::

    python -m benchmarks.goldens write --folder out/goldens      # in the tree before
    python -m benchmarks.goldens compare --folder PATH/TO/out/goldens

A new case is pinned beside the others, which stay as they are::

    python -m benchmarks.goldens write NAME
"""

from __future__ import annotations

import argparse
import json
import logging
import math
import pathlib
import sys
import time
import warnings

import numpy as np

from .support.golden_cases import CASES, GoldenCase, GoldenImage
from .support.machine import machine

FOLDER = pathlib.Path(__file__).parent / 'goldens'
MOST_DB, MOST_PREDICTION_DB = -120.0, 0.5  # that a change may do to an image; to its prediction
_ROUNDS = 5


def form(case: GoldenCase) -> GoldenImage:
    """Form the image of a case."""
    plan, image_of = case.imager(case, case.block())
    return image_of(plan())


def timed(case: GoldenCase) -> tuple[GoldenImage, float, float]:
    """Image, and the shortest of some times of planning and of imaging, seconds."""
    plan, image_of = case.imager(case, case.block())
    found, seconds = image_of(plan()), []  # the first compiles and fills caches
    for _ in range(_ROUNDS):
        begin = time.perf_counter()
        planned = plan()
        middle = time.perf_counter()
        image_of(planned)
        seconds.append((middle - begin, time.perf_counter() - middle))
    return found, *np.min(seconds, axis=0)


def difference_db(image, golden) -> float:
    """Mean squared difference over the mean square of the golden image, dB; -inf for none."""
    if image.shape != golden.shape:
        return math.inf
    difference = np.sum(np.abs(image.astype(complex) - golden) ** 2)
    return (10 * math.log10(difference / np.sum(np.abs(golden.astype(complex)) ** 2))
            if difference else -math.inf)


def load(folder: pathlib.Path, name: str) -> tuple[np.ndarray, dict]:
    """Image of a case and its facts as `write` left them.

    Raises
    ------
    FileNotFoundError
        Nothing was written there.
    """
    facts = json.loads((folder / 'goldens.json').read_text())['cases'][name]
    return np.load(folder / f'{name}.npy'), facts


def write(folder: pathlib.Path, names=tuple(CASES)) -> None:
    """Form images and keep them, beside those that were written before."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / 'goldens.json'
    here = machine()
    pinned = {'machine': here, 'cases': {}}
    if path.exists() and set(names) != set(CASES):
        pinned = json.loads(path.read_text())
    for name in names:
        found, plan_seconds, image_seconds = timed(CASES[name])
        np.save(folder / f'{name}.npy', found.image)
        facts = pinned['cases'][name] = {
            'predicted_error_db': found.predicted_error_db, 'plan': found.plan,
            'plan_ms': round(1e3 * plan_seconds, 2), 'image_ms': round(1e3 * image_seconds, 2)}
        if pinned['machine'] != here:
            facts['machine'] = here
        print(f'{name:24s} {found.plan[:60]:60s} {facts["image_ms"]:8.1f} ms', flush=True)
    path.write_text(json.dumps(pinned, indent=1) + '\n')


def compare(folder: pathlib.Path, names=tuple(CASES)) -> bool:
    """Print how this tree differs; True where nothing differs by more than is allowed."""
    fine = True
    print(f'{"case":24s} {"image":>9s} {"predicted":>10s} {"plan":>6s} {"planning":>9s} '
          f'{"imaging":>8s}')
    for name in names:
        golden, facts = load(folder, name)
        found, plan_seconds, image_seconds = timed(CASES[name])
        image_db = difference_db(found.image, golden)
        both = found.predicted_error_db, facts['predicted_error_db']
        predicted = 0.0 if None in both else both[0] - both[1]
        fine &= image_db <= MOST_DB and abs(predicted) <= MOST_PREDICTION_DB
        print(f'{name:24s} {"equal" if image_db == -math.inf else f"{image_db:.0f} dB":>9s} '
              f'{predicted:+7.2f} dB {"same" if found.plan == facts["plan"] else "other":>6s} '
              f'{1e3 * plan_seconds / max(facts["plan_ms"], 0.01):8.2f}x '
              f'{1e3 * image_seconds / facts["image_ms"]:7.2f}x', flush=True)
    return fine


def main() -> int:
    """Write or compare; 1 where something differs by more than is allowed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('what', choices=('write', 'compare'))
    parser.add_argument('names', nargs='*', metavar='NAME',
                        help='cases of benchmarks/support/golden_cases.py; all if left out')
    parser.add_argument('--folder', type=pathlib.Path, default=FOLDER,
                        help='where the pinned images lie (%(default)s)')
    arguments = parser.parse_args()
    if unknown := set(arguments.names) - set(CASES):
        parser.error(f'no case {", ".join(sorted(unknown))}; expected some of {", ".join(CASES)}')
    names = arguments.names or tuple(CASES)
    logging.disable(logging.WARNING)  # some cases are sampled sparsely on purpose
    warnings.simplefilter('ignore')
    if arguments.what == 'write':
        write(arguments.folder, names)
        return 0
    return 0 if compare(arguments.folder, names) else 1


if __name__ == '__main__':
    sys.exit(main())
