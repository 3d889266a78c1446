# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Measure how far images are above their predicted errors, over random radars, tracks and maps.

Every case follows from its seed (`benchmarks.support.random_cases`): far, near and wide ones in
turn, a fifth of them along tracks of platforms that stop, hurry, retrace and jump. Its image by
each imager is compared with float64 correlation of the same pulses at the brightest and at random
pixels. Cases are written down one by one, so that a campaign that was stopped goes on where it
was.

Run from the repository root: ``make prediction-campaign``, or
``python -m benchmarks.prediction_campaign --cases 1500``.
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import json
import logging
import math
import pathlib
import time
import traceback

import numba
import numpy as np
from tqdm import tqdm

from benchmarks.support.random_cases import FAMILIES, RandomCase, random_case
from sar_imaging.geometry import MapGrid, PlaneGrid, VolumeGrid
from sar_imaging.imaging.correlation import correlate
from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality.verification import measure_error
from sar_imaging.signal.spectra import band_spectrum
from sar_imaging.streaming.fusion import LiveFusion
from sar_imaging.streaming.subapertures import LiveSubapertures

from .support.machine import machine
from .support.uneven_tracks import UNEVEN

RESULTS = pathlib.Path(__file__).parent / 'results' / 'predictions.json'
RECORDS = pathlib.Path('out/prediction_campaign.jsonl')
ALLOWED_DB = 3.0  # above the prediction
EXACT_TARGETS_DB = -80.0, -60.0, -45.0  # what lengths of interpolators are chosen by
_UNEVEN_EVERY = 5
_BLOCK_PULSES = 16
_AMBIGUOUS = 'ambiguous'  # of pulses too far apart: true of any image, and no error


def exact(case: RandomCase, rng):
    """Backprojection of the profiles or of the phase histories to one of three targets."""
    p, target_db = case.pulses, float(rng.choice(EXACT_TARGETS_DB))
    image = plan_image(case.grid, p.radar, p.n_samples, method='exact', target_db=target_db,
                       compressed=p.compressed)(p)
    report = image.report
    return image.samples, report.predicted_error_db, report.warnings, slice(None), {
        'target_db': target_db, 'method': report.plan.method}


def afbp(case: RandomCase, rng):
    """AFBP of the profiles or of the phase histories to a random target."""
    p, target_db = case.pulses, -rng.uniform(40, 75)
    image = plan_image(case.grid, p.radar, p.n_samples, p.tx_m, p.rx_m, method='afbp',
                       target_db=target_db, compressed=p.compressed)(p)
    report, cut = image.report, image.report.plan.subapertures
    return image.samples, report.predicted_error_db, report.warnings, slice(None), {
        'target_db': target_db, 'subapertures': cut.n_subapertures,
        'beams': cut.beams is not None}


def ffbp(case: RandomCase, rng):
    """FFBP of the profiles to a random target, in sub-apertures of a random length."""
    p, target_db = case.profiles, -rng.uniform(15, 80)
    image = plan_image(case.grid, p.radar, p.n_samples, p.tx_m, p.rx_m, method='ffbp',
                       target_db=target_db, pulses_per_subaperture=int(rng.integers(4, 25)))(p)
    report = image.report
    return image.samples, report.predicted_error_db, report.warnings, slice(None), {
        'target_db': target_db, 'kernel': report.plan.sampling.kernel}


def few_cells(case: RandomCase, rng):
    """Exact image or FFBP of the profiles, of some pixels within the map, around it and above."""
    p, spacing, half_m = case.profiles, case.grid.spacing_m, np.zeros(3)
    half_m[:2] = 0.25 * spacing * np.array([case.grid.n_x, case.grid.n_y])
    middle = case.grid.centre_m + rng.uniform(-half_m, half_m)
    method = 'ffbp' if rng.random() < 0.3 else 'exact'
    n_axes = 2 if method == 'ffbp' else int(rng.integers(2, 4))
    n = rng.integers(2, 40 if n_axes == 2 else 14, n_axes)
    if method == 'ffbp':
        grid = MapGrid(tuple(middle), *map(int, n), spacing * rng.uniform(0.5, 1.5))
    else:
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0] if rng.random() < 0.5 else np.eye(3)
        steps = (axes * spacing * rng.uniform(0.5, 1.5, (3, 1)))[:n_axes]
        grid = (PlaneGrid if n_axes == 2 else VolumeGrid)(
            tuple(middle - (n - 1) / 2 @ steps), *map(tuple, steps), *map(int, n))
    target_db = -rng.uniform(45, 90)
    image = plan_image(grid, p.radar, p.n_samples, method=method, target_db=target_db)(p)
    report = image.report
    return image.samples, report.predicted_error_db, report.warnings, slice(None), {
        'target_db': target_db, 'method': method,
        'case': dataclasses.replace(case, grid=grid, pulses=p)}


def beyond(case: RandomCase, rng):
    """Exact image or AFBP of another scene of the same seed: all that is bright lies beyond."""
    case = campaign_case(case.traits['seed'], beyond=True)
    *image, more = (exact if rng.random() < 0.5 else afbp)(case, rng)
    return *image, {**more, 'case': case}


def dark_part(case: RandomCase, rng):
    """Exact image of the darkest part of the map, a sixteenth to a quarter of it."""
    whole, *_ = exact(case, rng)
    size = np.maximum(np.array(whole.shape) * rng.uniform(0.25, 0.5), 8).astype(int)
    power = np.pad(np.abs(whole) ** 2, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    n, m = size
    part = power[n:, m:] - power[:-n, m:] - power[n:, :-m] + power[:-n, :-m]
    row, column = np.unravel_index(part.argmin(), part.shape)
    middle = [case.grid.x_m[column:column + m].mean(), case.grid.y_m[row:row + n].mean()]
    grid = dataclasses.replace(case.grid, centre_m=(*map(float, middle), case.grid.z_m),
                               n_x=int(m), n_y=int(n))
    case = dataclasses.replace(case, grid=grid)
    *image, more = exact(case, rng)
    return *image, {**more, 'case': case}


def zero_padding(case: RandomCase, rng):
    """Zero-padded backprojection of the profiles."""
    return _published('zero-padding', case, rng)


def wavenumber(case: RandomCase, rng):
    """Wavenumber imaging of another case of the same seed, along an even straight track."""
    seed = case.traits['seed']
    return _published('wavenumber', random_case(seed, _even, tuple(FAMILIES)[seed % 3]), rng)


def _even(rng, share, length_m, middle_m):
    return middle_m + np.outer(share * length_m, [0.0, 1.0, 0.0])


def _published(method, case, rng):
    p, target_db = case.profiles, -rng.uniform(20, 80)
    image = plan_image(case.grid, p.radar, p.n_samples, method=method, target_db=target_db)(p)
    report = image.report
    return image.samples, report.predicted_error_db, report.warnings, slice(None), {
        'target_db': target_db, 'planned_db': report.plan.predicted_error_db,
        'case': dataclasses.replace(case, pulses=p)}


def live(case: RandomCase, rng):
    """AFBP while the pulses arrive, of one aperture."""
    return _live(case, -rng.uniform(40, 75), case.profiles.n_pulses, sliding=False)


def sliding(case: RandomCase, rng):
    """The last image of an aperture of half the length that slides over the pulses."""
    return _live(case, -rng.uniform(40, 75), case.profiles.n_pulses // 2, sliding=True)


def _live(case, target_db, length, *, sliding):
    image, predicted_db, told, pulses = form_live(case.grid, case.profiles, target_db, length,
                                                  sliding=sliding)
    return image, predicted_db, told, pulses, {'target_db': target_db}


def form_live(grid, block, target_db: float, length: int, *, sliding: bool, illumination=None):
    """Last image of all pulses of an aperture, formed while they arrive.

    Returns
    -------
    image, predicted_db, warnings :
        As reported; `warnings` are events that tell of more than a new plan.
    pulses : slice
        Of the image.
    """
    n = block.n_pulses // length * length
    p = block.select(slice(0, n))
    stage = LiveSubapertures(grid, pulses_per_aperture=length, target_db=target_db,
                             sliding=sliding, illumination=illumination)
    parts = [s for first in range(0, n, _BLOCK_PULSES)
             for s in stage.add(p.select(slice(first, first + _BLOCK_PULSES)))] + stage.flush()
    fusion = LiveFusion()
    images = [image for part in parts for image in fusion.add(part)] + fusion.flush()
    told = [event.text for event in stage.take_events()]
    images = [image for image in images if not image.n_missing]
    if not images:
        raise ValueError('; '.join(told) or 'no image of all pulses')
    result = images[-1]
    pulses = slice(n - result.n_pulses, n)
    first_ns, last_ns = (int(p.stamp_ns[pulses][end]) for end in (0, -1))
    if abs(result.stamp_ns - (first_ns + last_ns) / 2) > last_ns - p.stamp_ns[-2]:
        raise ValueError('; '.join(told) or 'the last aperture has no image')
    told = [text for text in told if 'planned anew' not in text and 'awaited' not in text]
    return result.image, result.predicted_error_db, told, pulses


#: Imagers, and in one of how many cases each has its turn.
IMAGERS = {'exact': (exact, 1), 'afbp': (afbp, 1), 'ffbp': (ffbp, 8), 'live': (live, 8),
           'sliding': (sliding, 16), 'few cells': (few_cells, 4),
           'zero-padding': (zero_padding, 8), 'wavenumber': (wavenumber, 4),
           'dark part': (dark_part, 1), 'beyond': (beyond, 1)}


def measure(case: RandomCase, name: str) -> dict:
    """Form one image of a case and compare it with correlation.

    Returns
    -------
    dict
        `predicted_db`, `error_db` and `warnings`; `refused` with the reason, or `crash` with the
        trace, where there is no image, `not_judged` where no pixel can be compared.
    """
    rng = np.random.default_rng([case.traits['seed'], list(IMAGERS).index(name)])
    try:
        image, predicted_db, warnings, pulses, more = IMAGERS[name][0](case, rng)
    except ValueError as reason:
        return {'refused': str(reason)}
    except Exception:
        return {'crash': traceback.format_exc()}
    case = more.pop('case', case)
    pulses, scale = case.pulses.select(pulses), np.float32(case.scale)
    entry = {'predicted_db': predicted_db, 'warnings': list(warnings), **more}
    # Few pixels tell an error in few places badly: what seems to exceed is compared whole.
    for n_pixels in (120, image.size):
        try:
            found = measure_error(image * scale, case.grid, pulses, n_pixels=n_pixels,
                                  n_brightest=80)
            entry['error_db'] = found.error_db
        except ValueError as reason:  # profiles cover no pixel
            if _warned(entry):  # they end within the map: there is nothing to compare
                return {'not_judged': str(reason), 'warnings': list(warnings)}
            entry['error_db'] = _periodic_error_db(image * scale, case.grid, pulses)
        if not exceeds(entry):
            break
    return entry


def _periodic_error_db(image, grid, block) -> float:
    """Error of an image whose profiles are a period of what they are taken to go on as."""
    reference = correlate(*band_spectrum(block), block.tx_m, block.rx_m, grid.points())
    return 20 * math.log10(np.linalg.norm(image - reference) / np.linalg.norm(reference))


def exceeds(entry: dict) -> bool:
    """True for an image without a prediction, or so far above it, and without a word."""
    if 'error_db' not in entry:
        return False
    known = entry['predicted_db'] is not None
    return (not (known and entry['error_db'] <= entry['predicted_db'] + ALLOWED_DB)
            and all(_AMBIGUOUS in warning for warning in entry['warnings']))


def campaign_case(seed: int, *, beyond: bool = False) -> RandomCase:
    """Case of a seed: families in turn, some of them along uneven tracks."""
    number, rest = divmod(seed, _UNEVEN_EVERY)
    track = None if rest else UNEVEN[number % len(UNEVEN)]
    return random_case(seed, track, tuple(FAMILIES)[seed % len(FAMILIES)], beyond=beyond)


def run(seeds, records: pathlib.Path) -> list[dict]:
    """Measure the cases that `records` lacks and return all that were asked for."""
    records.parent.mkdir(parents=True, exist_ok=True)
    known = {}
    if records.exists():
        lines = records.read_text().splitlines()
        known = {record['seed']: record for record in map(json.loads, lines)}
    with records.open('a') as file:
        for seed in tqdm([s for s in seeds if s not in known], unit='case'):
            started = time.process_time()
            case = campaign_case(seed)
            known[seed] = {**case.traits, **{
                name: measure(case, name) for name, (_, every) in IMAGERS.items()
                if seed % every == 0}, 'seconds': time.process_time() - started}
            file.write(json.dumps(known[seed]) + '\n')
            file.flush()
    return [known[seed] for seed in seeds]


def summary(records: list[dict], imagers=IMAGERS) -> dict:
    """Shares and distributions of each imager, and every image above its prediction."""
    return {name: _summary([(r, r[name]) for r in records if name in r]) for name in imagers}


def _summary(entries) -> dict:
    formed = [(record, e) for record, e in entries if 'error_db' in e]
    refused = collections.Counter(_reason(e['refused']) for _, e in entries if 'refused' in e)
    by = {name: collections.defaultdict(list) for name in ('track', 'family')}
    above = []
    for record, e in formed:
        if e['predicted_db'] is not None and not _warned(e):
            above.append(e['error_db'] - e['predicted_db'])
            for name in by.keys() & record.keys():
                by[name][record[name]].append(above[-1])
    result = {'cases': len(entries), 'imaged': len(formed), 'refused': dict(refused),
              'crashed': sum('crash' in e for _, e in entries),
              'warned': sum(_warned(e) for _, e in formed),
              'not_judged': sum('not_judged' in e for _, e in entries),
              'not_judged_silently': sum('not_judged' in e and not _warned(e)
                                         for _, e in entries),
              'error_db': _distribution([e['error_db'] for _, e in formed])}
    if above:
        result |= {'above_prediction_db': _distribution(above), **{
            f'by_{name}': {key: _distribution(v) for key, v in sorted(values.items())}
            for name, values in by.items() if values}}
    result['exceeding'] = [{'seed': r['seed'], 'family': r.get('family'), 'track': r['track'],
                            'predicted_db': round(e['predicted_db'], 1),
                            'error_db': round(e['error_db'], 1)}
                           for r, e in formed if exceeds(e)]
    return result


def _warned(entry) -> bool:
    return any(_AMBIGUOUS not in warning for warning in entry['warnings'])


def _reason(text: str) -> str:
    """The words of a reason, without its numbers."""
    return ' '.join(w for w in text.split(':')[0].split(';')[0].split()
                    if not any(c.isdigit() for c in w))[:90]


def _distribution(values) -> dict:
    values = np.array([v for v in values if math.isfinite(v)])
    if not len(values):
        return {'n': 0}
    low, median, high = np.percentile(values, [5, 50, 95]).round(1).tolist()
    return {'n': len(values), 'least': round(float(values.min()), 1), 'p5': low,
            'median': median, 'p95': high, 'most': round(float(values.max()), 1)}


def main() -> None:
    """Run what is missing and write the results."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--cases', type=int, default=1500)
    parser.add_argument('--first-seed', type=int, default=0)
    parser.add_argument('--records', type=pathlib.Path, default=RECORDS)
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)  # warnings go into the records
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.cases)
    records = run(seeds, arguments.records)
    results = {'machine': {**machine(), 'threads': numba.get_num_threads()},
               'first_seed': seeds.start, 'cases': len(records),
               'minutes': round(sum(r['seconds'] for r in records) / 60, 1),
               **{f'by_{name}': dict(collections.Counter(r[name] for r in records))
                  for name in ('family', 'track')},
               'imagers': summary(records)}
    arguments.output.write_text(json.dumps(results, indent=1) + '\n')
    print(json.dumps(results['imagers'], indent=1))


if __name__ == '__main__':
    main()
