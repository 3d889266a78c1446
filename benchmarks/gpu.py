# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images on a CUDA device: rates, times and errors, on the device alone and end to end.

Run from the repository root on a machine with a device, in an environment with the extra `cuda`::

    python -m benchmarks.gpu                      # ends within ten minutes
    NUMBA_ENABLE_CUDASIM=1 python -m benchmarks.gpu --small   # proves that it runs; no speed

Two tiny images come first: where they are wrong, nothing else is worth a measurement.

*Resident* times begin with samples on the device and end with an image there. *End to end* they
begin and end in the host's memory, plan excluded. Rates count a pixel and pulse (each channel
counts as one) as if each were added by itself, whichever way the plan takes; `int16` is end to
end with samples as pairs of integers. *Raw* cases begin with chirps, and time range compression by
itself, too. *Live* is the time from the last pulses of an aperture to its image in the host's
memory, which grew by blocks or by sub-apertures. Errors are against float64 time-domain
correlation with the exact two-way path, at some pixels. Results are written after each case. Cases
that do not begin within the time limit are left out, and named. FastSAR's CUDA backend is measured
beside the table's case where it can be imported.

`--case NAME` runs one case once, for profilers; `make gpu` says how.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import pathlib
import sys
import time
from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.reproduction.letter_scene import spotlight_letter
from sar_imaging.backends import DeviceError, backend
from sar_imaging.geometry import MapGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality.verification import measure_error
from sar_imaging.signal import PulseBlock
from sar_imaging.signal.range_compression import RangeCompressor

from .support.gpu_streams import from_raw, live
from .support.machine import machine
from .support.scenes import N_SCATTERERS, Case, phase_history

RESULTS = pathlib.Path(__file__).parent / 'results' / 'gpu.json'
LIMIT_S, ROUNDS = 450.0, 3  # a case takes a minute and a half at most
COMPARED = 40  # pixels whose error is measured, and as many of the brightest
_PULSES_AT_ONCE = 256
EXACT_DB, AFBP_DB = -80.0, -50.0
CORRECT_DB = -40.0  # of tiny images, far worse than either

#: Exact images: as MatX states its figure, with five channels, and of the table of benchmarks.md.
EXACT = {'8192 as MatX': Case(1e4, 8192, 11566, 1, 0.25),
         '4096 by 5 channels': Case(1e4, 4096, 512, 5, 0.25),
         '4096': Case(1e4, 4096, 2560, 1, 0.25),
         **{f'1024 at {r:g} m': Case(r, 1024, 256, 1, 0.25) for r in (1e3, 1e4, 5e4)}}
AFBP = {f'AFBP {n}': Case(1e4, n, n, 1, 0.25) for n in (4096, 8192, 16384)}
LETTER, RAW_SMALL = 'letter at full size', 'raw, small'
LIVE, LIVE_AFBP, LIVE_SMALL = 'live, 1024', 'live AFBP, 1024', 'live, small'
SMALL = {'exact, small': Case(1e3, 12, 2, 1, 0.25), 'AFBP, small': Case(1e3, 16, 8, 1, 0.25)}
#: Pulses together, target, and pulses of a sub-aperture where both stages of AFBP are live.
GROWING = {LIVE: (Case(1e4, 1024, 512, 1, 0.25), 32, EXACT_DB, 0),
           LIVE_AFBP: (Case(1e4, 1024, 1024, 1, 0.25), 32, AFBP_DB, 128),
           LIVE_SMALL: (Case(1e3, 8, 2, 1, 0.25), 1, EXACT_DB, 0)}
#: Length of the chirp, and options of the image.
RAW = {'raw, 1024': (Case(1e4, 1024, 512, 1, 0.25), 4e-6, {'method': 'exact',
                                                          'target_db': EXACT_DB}),
       'raw, AFBP 4096': (Case(1e4, 4096, 4096, 1, 0.25), 10e-6, {'method': 'afbp',
                                                                 'target_db': AFBP_DB}),
       RAW_SMALL: (Case(1e3, 8, 2, 1, 0.25), 2e-7, {'method': 'exact', 'target_db': EXACT_DB})}
NAMES = ('exact, small', 'AFBP, small', '8192 as MatX', '4096', '4096 by 5 channels',
         *(f'1024 at {r:g} m' for r in (1e3, 1e4, 5e4)), 'AFBP 4096', 'AFBP 8192', LIVE,
         LIVE_AFBP, 'raw, 1024', 'raw, AFBP 4096', 'AFBP 16384', LETTER)
FASTSAR = '1024 at 10000 m'  # the case that it is measured beside


def measure(name: str, *, rounds: int = ROUNDS) -> dict[str, object]:
    """Times, rates and errors of one case."""
    if name in GROWING:
        case, n_together, target_db, n_subaperture = GROWING[name]
        return live(case, n_together, target_db, rounds, COMPARED, n_subaperture=n_subaperture)
    if name in RAW:
        return from_raw(*RAW[name], _best, rounds, COMPARED)
    block, grid = _recording(name)
    afbp = name.startswith('AFBP') or name == LETTER
    options = {'method': 'afbp' if afbp else 'exact',
               'target_db': AFBP_DB if afbp else EXACT_DB}
    if not afbp:
        block = RangeCompressor.for_block(block)(block)
    begun = time.perf_counter()
    imager = plan_image(grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                        backend='cuda', compressed=not afbp, **options)
    planning_s = time.perf_counter() - begun
    whole, image = _best(lambda: imager(block), rounds)
    error = measure_error(image, grid, block, fit_scale=True, n_pixels=COMPARED,
                          n_brightest=COMPARED)
    del image
    once = (_resident_afbp if afbp else _resident_exact)(imager.report.plan, block)
    resident, _ = _best(once, rounds)
    work = float(np.prod(grid.shape)) * block.n_pulses * block.n_channels
    found = {'pixels': list(grid.shape), 'pulses': block.n_pulses, 'channels': block.n_channels,
             'samples': block.n_samples, **options, 'plan': str(imager.report.plan),
             'planning_s': planning_s, 'resident_s': resident, 'end_to_end_s': whole,
             'resident_rate_e9': work / resident / 1e9, 'end_to_end_rate_e9': work / whole / 1e9,
             'error_db': error.error_db, 'brightest_error_db': error.brightest_error_db,
             'predicted_db': imager.report.predicted_error_db,
             'predicted_device_s': backend('cuda').seconds(imager.report.plan)}
    if not afbp:
        found['int16_s'], _ = _best(_of_integers(imager.report.plan, block), rounds)
    if name == FASTSAR:
        found['fastsar'] = _fastsar(name, rounds)
    return found


def _of_integers(plan, block: PulseBlock) -> Callable[[], object]:
    """End to end with half the bytes of samples: pairs of int16."""
    scale = 3e4 / np.abs(block.samples.view(np.float32)).max()
    pairs = (block.samples.view(np.float32) * scale).astype(np.int16)
    pairs = pairs.reshape(-1, block.n_samples, 2)
    entry = backend('cuda').Backprojection(plan)
    return lambda: entry.add(pairs, plan.tx_m, plan.rx_m, np.zeros(plan.grid.shape, np.complex64))


def _fastsar(name: str, rounds: int) -> dict[str, object]:
    """FastSAR's fast factorised backprojection on the device, where it can be had."""
    try:
        from .support.fastsar_imagers import factorised

        block, grid = phase_history(EXACT[name]), EXACT[name].grid
        former, predicted_db = factorised(block, grid, 'cuda')
        seconds, image = _best(former, rounds)
    except Exception as error:  # of whatever version there is
        return {'left out': f'{type(error).__name__}: {error}'}
    compressed = RangeCompressor.for_block(block)(block)
    wanted = plan_image(grid, compressed.radar, compressed.n_samples, method='exact',
                        target_db=EXACT_DB, backend='cuda')(compressed).samples
    scale = np.vdot(image, wanted) / np.vdot(image, image)
    error_db = 20 * np.log10(np.linalg.norm(scale * image - wanted) / np.linalg.norm(wanted))
    return {'end_to_end_s': seconds, 'predicted_db': predicted_db, 'error_db': float(error_db)}


def _recording(name: str) -> tuple[PulseBlock, MapGrid]:
    """Phase histories and grid: noise for exact images, which lights all of them evenly."""
    if name == LETTER:
        letter = spotlight_letter('full')
        letter = dataclasses.replace(letter, scatterers=letter.scatterers[:N_SCATTERERS])
        samples = np.empty((letter.n_pulses, letter.n_samples), np.complex64)
        letter.record(samples)
        centres, number = letter.phase_centres(), np.arange(letter.n_pulses)
        return PulseBlock(letter.radar, False, number, number, samples[:, None], centres,
                          centres), letter.scene_grid(0.1)
    case = {**EXACT, **AFBP, **SMALL}[name]
    if name.startswith('AFBP'):
        return phase_history(case), case.grid
    one, (tx, rx) = phase_history(dataclasses.replace(case, n_pulses=1)), case.phase_centres()
    samples = np.empty((*tx.shape[:2], one.n_samples), np.complex64)
    random, number = np.random.default_rng(0), np.arange(len(tx))
    for start in range(0, len(tx), _PULSES_AT_ONCE):
        some = samples[start:start + _PULSES_AT_ONCE]
        some[:] = random.standard_normal((*some.shape[:2], 2 * one.n_samples), np.float32).view(
            np.complex64)
    return PulseBlock(one.radar, False, number, number, samples, tx, rx), case.grid


def _resident_exact(plan, block: PulseBlock) -> Callable[[], object]:
    """Adds echoes that lie on the device to an image there."""
    from sar_imaging.backends.cuda.arrays import synchronise, xp

    entry = backend('cuda').Backprojection(plan)
    echoes = (xp.asarray(block.samples.reshape(-1, block.n_samples)), plan.tx_m, plan.rx_m)
    image = xp.zeros(plan.grid.shape, np.complex64)

    def run():
        entry.add(*echoes, image)
        synchronise()

    return run


def _resident_afbp(plan, block: PulseBlock) -> Callable[[], object]:
    """Both stages and the map, from samples on the device."""
    from sar_imaging.backends.cuda.arrays import given, synchronise, xp

    made, stage = backend('cuda'), plan.subapertures
    whole = made.ApertureFusion(stage)
    block = dataclasses.replace(block, samples=given(xp.asarray(block.samples)))

    def run():
        made.form_map(whole.polar_image(block), stage.fusion_grid, plan.grid)
        synchronise()

    return run


def _best(call: Callable[[], object], rounds: int) -> tuple[float, object]:
    """Least time of some rounds after one that compiles, or of that one; the last result."""
    seconds = []
    for _ in range(rounds + 1):
        begun = time.perf_counter()
        found = call()
        seconds.append(time.perf_counter() - begun)
    return min(seconds[1:] or seconds), found


def main(argv: Sequence[str] | None = None) -> int:
    """Run the cases and write the results; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    parser.add_argument('--small', action='store_true', help='tiny images, for the simulator')
    parser.add_argument('--limit', type=float, default=LIMIT_S, metavar='SECONDS',
                        help='no case begins after so long (%(default)g)')
    parser.add_argument('--case', choices=NAMES, help='one case, and nothing is written')
    given = parser.parse_args(argv)
    try:
        backend('cuda')
    except DeviceError as error:
        print(f'error: {error}', file=sys.stderr)
        return 1
    if given.case:
        print(json.dumps(measure(given.case, rounds=1), indent=2))
        return 0
    begun, names = time.perf_counter(), (*SMALL, LIVE_SMALL, RAW_SMALL) if given.small else NAMES
    found = {'device': backend('cuda').device_name(), 'machine': machine(), 'cases': {},
             'left_out': list(names)}
    for name in names:
        if time.perf_counter() - begun > given.limit:
            break
        try:
            row = measure(name, rounds=0 if given.small else ROUNDS)
        except Exception as error:  # the other cases count all the same
            row = {'failed': f'{type(error).__name__}: {error}'}
        found['cases'][name] = row
        found['left_out'].remove(name)
        given.output.write_text(json.dumps(found, indent=1) + '\n')
        print(name, json.dumps(row), flush=True)
        if name in SMALL and not row.get('error_db', 0.0) < CORRECT_DB:
            print(f'error: {name} is wrong; nothing else is measured', file=sys.stderr)
            return 1
    return 0 if not any('failed' in row for row in found['cases'].values()) else 1


if __name__ == '__main__':
    sys.exit(main())
