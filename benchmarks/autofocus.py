# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Autofocus on 100 random apertures with wrong positions, and what it costs.

Run from the repository root::

    python -m benchmarks.autofocus

40 smooth track errors of 0.1 to 10 wavelengths, 30 vibrations of 0.02 to 0.3 wavelengths and 30
clock offsets of 5 to 100 ms, see `sar_imaging.simulation.flawed_aperture`. Autofocus is told
the kind of the error (a smooth track error with a residual phase per pulse; for the clock, a time
offset with the same), never its size. Every corrected image is compared with the image of the
true positions after the whole estimated track was moved rigidly, which no image shows, and after
multiplication by the complex number that suits best.

Phase gradient autofocus of fused AFBP images, as in node afbp_fusion, is measured on a few of
these errors and on noise alone (`--phase-gradient` for that part alone).

The cost is processor time over that of one exact image, of all threads, for images of two sizes.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import pathlib
import time

import numpy as np
from tqdm import tqdm

from benchmarks.support.track_errors import moved_rigidly, random_size
from sar_imaging.autofocus.autofocus import Autofocus
from sar_imaging.autofocus.models import Geometry, nominal, with_time_offset
from sar_imaging.autofocus.phase_gradient import PhaseGradient
from sar_imaging.autofocus.residual import along_sight
from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality import error_db, measure_scatterer
from sar_imaging.simulation import FlawedAperture, flawed_aperture
from sar_imaging.streaming.fusion import LiveFusion
from sar_imaging.streaming.subapertures import LiveSubapertures

from .support.machine import machine
from .support.references import exact_image

RESULTS = pathlib.Path(__file__).parent / 'results' / 'autofocus.json'
CASES = ('smooth',) * 40 + ('vibration',) * 30 + ('clock',) * 30
# Kind, size and seed; a size of 0 without an error.
PHASE_GRADIENT_CASES = (
    ('smooth', 0.0, 5), ('smooth', 0.1, 7), ('smooth', 0.3, 1), ('smooth', 2.0, 3),
    ('smooth', 8.0, 4), ('vibration', 0.05, 2), ('vibration', 0.2, 2), ('vibration', 0.2182, 41),
    ('vibration', 0.28, 56), ('clock', 0.02, 4), ('noise', 0.0, 5))
WANTED_DB, WANTED_IRW = -20.0, 0.05


def autofocus_for(case: FlawedAperture) -> Autofocus:
    """Autofocus that knows what kind of error to look for."""
    if case.kind != 'clock':
        return Autofocus(case.grid, scale_m=0.1)
    return Autofocus(case.grid, model=lambda block: with_time_offset(
        nominal(block), case.time_s, scale_s=0.05))


def widths(image, case: FlawedAperture, block) -> np.ndarray:
    """(S, 2) IRW in range and azimuth of the bright scatterers, NaN where not measurable."""
    found = [measure_scatterer(
        image, case.grid, point, aperture_centre_m=block.phase_centre_m.mean(axis=0),
        wavenumber_rad_per_m=block.radar.wavenumber_rad_per_m, cut_half_width_range_m=3.0,
        cut_half_width_azimuth_m=3.0,
        neighbours_m=np.delete(case.points_m[:case.n_bright], k, axis=0))
        for k, point in enumerate(case.points_m[:case.n_bright])]
    return np.array([(f.irw_range_m, f.irw_azimuth_m) for f in found])


def measure(case: FlawedAperture) -> dict:
    """One case: what autofocus says, and what is true."""
    wanted, original = (exact_image(case.grid, b) for b in (case.true, case.stated))
    result = autofocus_for(case).process(case.stated, original)
    report = result.report
    aligned = moved_rigidly(result.block, case.true, case.points_m)
    before = moved_rigidly(case.stated, case.true, case.points_m)
    image = exact_image(case.grid, aligned)
    reference, found = widths(wanted, case, case.true), widths(image, case, case.true)
    with np.errstate(all='ignore'):
        change = np.nanmedian(found / reference, axis=0) - 1
    error = fitted_error_db(image, wanted)
    true_success = error <= WANTED_DB and bool(np.all(np.abs(change) <= WANTED_IRW))
    return {
        'kind': case.kind, 'size': round(case.size, 4), 'accepted': report.accepted,
        'claims_success': report.success, 'true_success': true_success, 'reason': report.reason,
        'error_before_db': round(fitted_error_db(exact_image(case.grid, before), wanted), 1),
        'error_db': round(error, 1), 'estimated_error_db': round(report.estimated_error_db, 1),
        'coherence': round(report.coherence, 3),
        'irw_change': [round(float(c), 4) for c in change],
        'contrast': [round(report.contrast_before, 2), round(report.contrast_after, 2)]}


def measure_phase_gradient(kind: str, size: float, seed: int) -> dict:
    """Phase gradient autofocus of the fused image of one aperture, and what is true."""
    case = flawed_aperture('smooth' if kind == 'noise' else kind, size or 1e-6, seed)
    block, found = case.stated, []
    if kind == 'noise':
        noise = np.random.default_rng(seed).standard_normal((2, *block.samples.shape))
        block = dataclasses.replace(block, samples=noise[0] + 1j * noise[1])

    def focus(polar_image, grid, ends_m):
        result = PhaseGradient(grid.polar, grid, ends_m).at_baseband(polar_image, grid.between)
        found.append((result, grid.polar.origin_m[0]))
        return result.image, None

    first, second = LiveSubapertures(case.grid, pulses_per_aperture=block.n_pulses), LiveFusion()
    second.focus = focus
    for subaperture in first.add(block):
        second.add(subaperture)
    [(result, middle_m)] = found
    half_path = np.interp(block.tx_m[:, 0, 0] - middle_m, result.position_m, result.half_path_m)
    moved = along_sight(Geometry(block.tx_m, block.rx_m), half_path, case.grid.centre_m)
    corrected = dataclasses.replace(block, tx_m=moved.tx_m, rx_m=moved.rx_m)
    wanted = exact_image(case.grid, case.true)
    before, after = (round(fitted_error_db(exact_image(case.grid, moved_rigidly(
        some, case.true, case.points_m)), wanted), 1) for some in (case.stated, corrected))
    row = {'kind': kind, 'size': size, 'seed': seed, 'accepted': result.accepted,
           'contrast': [round(result.contrast_before, 2), round(result.contrast_after, 2)],
           'error_before_db': before, 'error_corrected_db': after,
           'estimated_error_db': round(result.error_db, 1)}
    tqdm.write(json.dumps(row))
    return row


def fitted_error_db(image, wanted) -> float:
    """Error after the best complex factor, dB."""
    return error_db(np.vdot(image, wanted) / np.vdot(image, image) * image, wanted)


def measure_cost(half_scene_m: float, n_pulses: int) -> dict:
    """Processor time of autofocus over that of one exact image."""
    case = flawed_aperture('smooth', 1.0, 1, n_pulses=n_pulses, half_scene_m=half_scene_m)
    imager = plan_image(case.grid, case.stated.radar, case.stated.n_samples, method='exact',
                        target_db=-80.0)
    autofocus = autofocus_for(case)
    image = imager(case.stated).samples
    seconds = {'image': [], 'autofocus': []}
    for _ in range(3):
        for name, call in (('image', lambda: imager(case.stated)),
                           ('autofocus', lambda: autofocus.process(case.stated, image))):
            started = time.process_time()
            call()
            seconds[name].append(time.process_time() - started)
    one, all_of_it = min(seconds['image']), min(seconds['autofocus'])
    return {'pixels': [case.grid.n_x, case.grid.n_y], 'pulses': n_pulses,
            'image_cpu_s': round(one, 3), 'autofocus_cpu_s': round(all_of_it, 3),
            'images': round(all_of_it / one, 2)}


def summary(rows) -> dict:
    """Rates over all cases and by kind."""
    out = {}
    for kind in ('all', *dict.fromkeys(row['kind'] for row in rows)):
        some = [row for row in rows if kind in ('all', row['kind'])]
        claims = [row for row in some if row['claims_success']]
        out[kind] = {
            'cases': len(some), 'claimed': len(claims),
            'true_success': sum(row['true_success'] for row in some),
            'false_claims': sum(not row['true_success'] for row in claims),
            'accepted': sum(row['accepted'] for row in some),
            'accepted_but_worse': sum(row['accepted'] and row['error_db'] > row['error_before_db']
                                      for row in some),
            'worst_claimed_error_db': max((row['error_db'] for row in claims), default=None),
            'median_error_before_db': round(float(np.median(
                [row['error_before_db'] for row in some])), 1),
            'median_error_db': round(float(np.median([row['error_db'] for row in some])), 1)}
    return out


def measure_case(seed: int) -> dict:
    """Row of one of `CASES`."""
    size = random_size(CASES[seed], np.random.default_rng([seed, 7]))
    row = {'seed': seed} | measure(flawed_aperture(CASES[seed], size, seed))
    tqdm.write(json.dumps(row))
    return row


def main() -> None:
    """Measure and write the results, which grow case by case."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n', 1)[0])
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    parser.add_argument('--every', type=int, default=1, metavar='N', help='only every N-th case')
    parser.add_argument('--again', type=int, nargs='+', metavar='SEED',
                        help='measure these cases again and leave the other results as they are')
    parser.add_argument('--phase-gradient', action='store_true',
                        help='measure phase gradient autofocus alone, and leave the other results')
    arguments = parser.parse_args()

    def write():
        results['summary'] = summary(results['cases'])
        arguments.output.write_text(json.dumps(results, indent=1) + '\n')

    if arguments.phase_gradient:
        results = json.loads(arguments.output.read_text())
        results['phase_gradient'] = [measure_phase_gradient(*c) for c in PHASE_GRADIENT_CASES]
        write()
        return
    if arguments.again:
        results = json.loads(arguments.output.read_text())
        rows = {row['seed']: row for row in results['cases']}
        rows |= {seed: measure_case(seed) for seed in arguments.again}
        results['cases'] = [rows[seed] for seed in sorted(rows)]
        write()
        return
    results = {'machine': machine(), 'summary': {}, 'cost': [], 'cases': []}
    for seed in tqdm(range(0, len(CASES), arguments.every)):
        results['cases'].append(measure_case(seed))
        write()
    for size in ((28.0, 512), (126.0, 2048)):
        results['cost'].append(measure_cost(*size))
        write()
    results['phase_gradient'] = [measure_phase_gradient(*c) for c in PHASE_GRADIENT_CASES]
    write()


if __name__ == '__main__':
    main()
