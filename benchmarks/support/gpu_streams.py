# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What a device does with raw pulses and with pulses that arrive: cases of `benchmarks.gpu`."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable

import numpy as np

from sar_imaging.backends import backend
from sar_imaging.backends.samples import compress, to_device
from sar_imaging.device_arrays import to_host
from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality.verification import measure_error
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.streaming.aperture import ApertureImager
from sar_imaging.streaming.fusion import LiveFusion
from sar_imaging.streaming.subapertures import LiveSubapertures

from .scenes import CARRIER_HZ, Case, phase_history

_RATE, _BEYOND_M, _CHECKED = 1.25, 30.0, 64  # pulses whose profiles are compared


def raw_pulses(case: Case, pulse_length_s: float) -> tuple[PulseBlock, np.ndarray]:
    """Chirps as a converter gives them, noise, as complex numbers and as (P, C, N, 2) int16."""
    bandwidth = SPEED_OF_LIGHT / (4 * case.spacing_m)
    reach_m = 0.75 * case.n_side * case.spacing_m + _BEYOND_M
    delay_s = 2 * (case.range_m - reach_m) / SPEED_OF_LIGHT
    n_samples = math.ceil((4 * reach_m / SPEED_OF_LIGHT + pulse_length_s) * _RATE * bandwidth)
    radar = RadarParameters(CARRIER_HZ, bandwidth, _RATE * bandwidth, delay_s,
                            pulse_length_s=pulse_length_s,
                            chirp_rate_hz_per_s=bandwidth / pulse_length_s)
    tx, rx = case.phase_centres()
    pairs = np.random.default_rng(4).integers(
        -2 ** 12, 2 ** 12, (*tx.shape[:2], n_samples, 2), dtype=np.int16)
    samples = pairs.astype(np.float32).view(np.complex64)[..., 0]
    number = np.arange(len(tx))
    return PulseBlock(radar, False, number, number, samples, tx, rx), pairs


def from_raw(case: Case, pulse_length_s: float, options: dict, best: Callable, rounds: int,
             compared: int) -> dict[str, object]:
    """Range compression by itself, and images from raw pulses end to end.

    Parameters
    ----------
    case, pulse_length_s :
        Geometry and chirp.
    options : dict
        Of `plan_image`.
    best : callable
        Least time of some rounds and the last result, ``best(call, rounds)``.
    rounds, compared : int
        Rounds, and pixels whose error is measured.
    """
    block, pairs = raw_pulses(case, pulse_length_s)
    finish, compressor = backend('cuda').synchronise, RangeCompressor.for_block(block)

    def done(work: Callable[[], object]) -> Callable[[], object]:
        def run():
            found = work()
            finish()
            return found

        return run

    def of_integers() -> PulseBlock:
        return dataclasses.replace(block, samples=to_device(pairs))

    there, found = of_integers(), {}
    for name, start in (('resident_s', lambda: there), ('end_to_end_s', lambda: block),
                        ('int16_s', of_integers)):
        found[f'compression_{name}'], profiles = best(
            done(lambda start=start: compress(compressor, start(), 'cuda')), rounds)
    some = slice(0, _CHECKED)
    here = compressor(block.select(some)).samples
    difference = np.linalg.norm(to_host(profiles.samples[some]) - here) / np.linalg.norm(here)
    found['compression_error_db'] = float(20 * np.log10(difference + 1e-12))
    del profiles
    imager = plan_image(case.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                        compressed=False, backend='cuda', **options)
    found['resident_s'], _ = best(done(lambda: imager(there)), rounds)
    found['int16_s'], _ = best(lambda: to_host(imager(of_integers()).samples), rounds)
    found['end_to_end_s'], image = best(lambda: imager(block), rounds)
    error = measure_error(image, case.grid, compressor(block), fit_scale=True, n_pixels=compared,
                          n_brightest=compared)
    return {'pixels': list(case.grid.shape), 'pulses': block.n_pulses,
            'samples': block.n_samples, 'profile': compressor.n_output, **options, **found,
            'error_db': error.error_db, 'predicted_db': image.report.predicted_error_db}


def live(case: Case, n_together: int, target_db: float, rounds: int, compared: int, *,
         n_subaperture: int = 0) -> dict[str, object]:
    """From the last pulses of an aperture to its image in the host's memory.

    The image grew there by blocks, or by sub-apertures of so many pulses, whose images and
    spectra lie on the device; what can be planned ahead is.
    """
    block = phase_history(case)
    block = RangeCompressor.for_block(block)(block)
    common = {'pulses_per_aperture': block.n_pulses, 'target_db': target_db, 'backend': 'cuda'}
    fusion = LiveFusion(backend='cuda')
    stage = (LiveSubapertures(case.grid, pulses_per_subaperture=n_subaperture, **common)
             if n_subaperture else ApertureImager(case.grid, **common))
    seconds, images = [], []
    for number in range(rounds + 1):
        aperture = dataclasses.replace(block, counter=block.counter + number * block.n_pulses)
        for start in range(0, block.n_pulses, n_together):
            some = aperture.select(slice(start, start + n_together))
            begun = time.perf_counter()
            formed = stage.add(some)
            if n_subaperture:
                formed = [image for part in formed for image in fusion.add(part)]
            seconds.append(time.perf_counter() - begun)
            images += formed
            if n_subaperture:
                stage.catch_up()
                stage.plan_ahead()
    every = -(-block.n_pulses // n_together)
    last = seconds[every - 1::every]
    error = measure_error(images[-1].image, case.grid, block, fit_scale=True, n_pixels=compared,
                          n_brightest=compared)
    return {'pixels': list(case.grid.shape), 'pulses': block.n_pulses, 'images': len(images),
            'pulses_together': n_together, 'last_block_s': min(last[1:] or last),
            'error_db': error.error_db}
