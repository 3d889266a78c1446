# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Measure how far images with illumination are above their predicted errors, over random cases.

Every case follows from its seed (`benchmarks.support.lit_cases`). Its images are compared with
weighted float64 correlation at the brightest and at random pixels; what seems to exceed the
prediction is compared whole. Cases are written down one by one, so that a campaign that was
stopped goes on where it was.

Run from the repository root: ``python -m benchmarks.illumination_campaign --seeds 71000 83000``.
"""

from __future__ import annotations

import argparse
import json
import logging
import pathlib
import time
import traceback
import warnings

import numba
import numpy as np
from tqdm import tqdm

from sar_imaging.geometry.grids import MapGrid, TerrainGrid
from sar_imaging.geometry.illumination import AntennaPattern
from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality.verification import measure_error

from .prediction_campaign import exceeds, form_live, summary
from .support.lit_cases import LitCase, lit_case
from .support.machine import machine

RESULTS = pathlib.Path(__file__).parent / 'results' / 'illumination_campaign.json'
RECORDS = pathlib.Path('out/illumination_campaign.jsonl')
_PIXELS, _BRIGHTEST = 120, 80


def exact(case: LitCase, rng):
    """Backprojection to a random target."""
    return _planned(case, case.grid, case.pattern, 'exact', case.target_db)


def spot(case: LitCase, rng):
    """Backprojection with a pattern that also ends in elevation, to deeper targets."""
    pattern = AntennaPattern(case.cut(rng.uniform(0.2, 3.0)), case.cut(rng.uniform(0.2, 3.0), 1))
    return _planned(case, case.grid, pattern, 'exact', -rng.uniform(45, 90))


def terrain(case: LitCase, rng):
    """Backprojection to points of a hilly ground."""
    grid = MapGrid(case.grid.centre_m, *(n // 2 for n in case.grid.shape[::-1]),
                   2 * case.grid.spacing_m)
    y, x = (np.linspace(0, 3, n) for n in grid.shape)
    height = case.grid.spacing_m * rng.uniform(0, 10) * np.sin(x) * np.cos(y)[:, None]
    pattern = AntennaPattern(case.cut(rng.uniform(0.2, 3.0)))
    return _planned(case, TerrainGrid(grid, case.grid.centre_m[2] + height), pattern, 'exact',
                    -rng.uniform(45, 90))


def afbp(case: LitCase, rng):
    """AFBP of an antenna wide enough for it, to a random target."""
    return _planned(case, case.grid, _wide(case, rng), 'afbp', -rng.uniform(40, 70))


def live(case: LitCase, rng):
    """AFBP while the pulses arrive, of one aperture."""
    return _live(case, rng, case.block.n_pulses, sliding=False)


def sliding(case: LitCase, rng):
    """The last image of an aperture of half the length that slides over the pulses."""
    return _live(case, rng, case.block.n_pulses // 2, sliding=True)


#: Imagers, and in one of how many cases each has its turn.
IMAGERS = {'exact': (exact, 1), 'spot': (spot, 1), 'terrain': (terrain, 2), 'afbp': (afbp, 1),
           'live': (live, 2), 'sliding': (sliding, 4)}


def _wide(case, rng) -> AntennaPattern:
    return AntennaPattern(case.cut(rng.uniform(0.5, 8.0)))


def _planned(case, grid, pattern, method, target_db):
    block = case.block
    image = plan_image(grid, block.radar, block.n_samples, method=method, target_db=target_db,
                       illumination=pattern)(block)
    report = image.report
    return (image.samples, grid, pattern, slice(None), report.predicted_error_db, report.warnings,
            {'target_db': target_db, 'way': getattr(report.plan, 'method', method)})


def _live(case, rng, length, *, sliding):
    pattern, target_db = _wide(case, rng), -rng.uniform(40, 70)
    image, predicted_db, told, pulses = form_live(
        case.grid, case.block, target_db, length, sliding=sliding, illumination=pattern)
    return image, case.grid, pattern, pulses, predicted_db, told, {'target_db': target_db}


def measure(case: LitCase, name: str) -> dict:
    """Form one image and compare it with correlation; an entry as of `prediction_campaign`."""
    rng = np.random.default_rng([case.traits['seed'], list(IMAGERS).index(name)])
    try:
        image, grid, pattern, pulses, predicted_db, told, more = IMAGERS[name][0](case, rng)
    except ValueError as reason:
        return {'refused': str(reason)}
    except Exception:
        return {'crash': traceback.format_exc()}
    entry = {'predicted_db': predicted_db, 'warnings': list(told), **more}
    if not image.any():
        return entry | {'not_judged': 'dark'}
    for n_pixels in (_PIXELS, image.size):
        try:
            entry['error_db'] = measure_error(
                image, grid, case.block.select(pulses), n_pixels=n_pixels,
                n_brightest=_BRIGHTEST, illumination=pattern).error_db
        except ValueError as reason:  # profiles cover no pixel: there is nothing to compare
            return entry | {'not_judged': str(reason)}
        if not exceeds(entry):
            break
    return entry


def run(seeds, records: pathlib.Path) -> list[dict]:
    """Measure the cases that `records` lacks and return all that were asked for."""
    records.parent.mkdir(parents=True, exist_ok=True)
    known = {}
    if records.exists():
        known = {r['seed']: r for r in map(json.loads, records.read_text().splitlines())}
    with records.open('a') as file:
        for seed in tqdm([s for s in seeds if s not in known], unit='case'):
            started, case = time.process_time(), lit_case(seed)
            known[seed] = {**case.traits, **{
                name: measure(case, name) for name, (_, every) in IMAGERS.items()
                if seed % every == 0}, 'seconds': time.process_time() - started}
            file.write(json.dumps(known[seed]) + '\n')
            file.flush()
    return [known[seed] for seed in seeds]


def main() -> None:
    """Run what is missing and write the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, nargs='+', required=True,
                        help='first one of each range')
    parser.add_argument('--cases', type=int, default=100, help='of each range')
    parser.add_argument('--records', type=pathlib.Path, default=RECORDS)
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)  # warnings go into the records
    warnings.simplefilter('ignore')
    ranges = {str(first): run(range(first, first + arguments.cases), arguments.records)
              for first in arguments.seeds}
    records = [record for found in ranges.values() for record in found]
    exceeding = {first: sum(exceeds(r[name]) for r in found for name in IMAGERS
                            if 'error_db' in r.get(name, {})) for first, found in ranges.items()}
    results = {'machine': {**machine(), 'threads': numba.get_num_threads()},
               'cases_per_range': arguments.cases, 'exceeding_by_first_seed': exceeding,
               'minutes': round(sum(r['seconds'] for r in records) / 60, 1),
               'imagers': summary(records, IMAGERS)}
    arguments.output.write_text(json.dumps(results, indent=1) + '\n')
    print(json.dumps(results, indent=1))


if __name__ == '__main__':
    main()
