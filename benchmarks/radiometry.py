# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Calibrated brightness of simulated rough surfaces and reflectors beside the truth.

Run from the repository root: ``python -m benchmarks.radiometry``, some minutes; ``--seeds 1`` for
few. Writes benchmarks/results/radiometry.json and prints the table of docs/radiometry.md.
"""

from __future__ import annotations

import argparse
import json
import pathlib

import numpy as np
from tqdm import tqdm

from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality import measure_scatterer
from sar_imaging.radiometry import RadarConstant, brightness, equivalent_looks, image_response

from .support.machine import machine
from .support.radiometry_scenes import GAIN, Flight, rough_surface

RESULTS = pathlib.Path(__file__).parent / 'results' / 'radiometry.json'
SIGMA0 = 0.07
EDGE = 10  # pixels that sidelobes of what is outside reach
CASES = {
    '100 m': {'range_m': 100.0, 'grazing_deg': 45.0},
    '1 km': {'range_m': 1e3, 'grazing_deg': 30.0},
    '1 km, three channels': {'range_m': 1e3, 'grazing_deg': 30.0, 'channels': 3},
    '1 km, squint of 17 degrees': {'range_m': 1e3, 'grazing_deg': 30.0, 'squint_rad': 0.3},
    '1 km, Hamming window': {'range_m': 1e3, 'grazing_deg': 30.0, 'weighting': 'hamming'},
    '20 km': {'range_m': 2e4, 'grazing_deg': 20.0},
    '500 km': {'range_m': 5e5, 'grazing_deg': 50.0, 'pulses': 160}}


def surface(options: dict, seed: int) -> tuple[float, float, float]:
    """Mean of sigma nought over the truth, of its near half over its far one, and the looks."""
    flight = Flight(n=128, **options)
    rng = np.random.default_rng(seed)
    block = flight.block(*rough_surface(flight, SIGMA0, rng))
    image = plan_image(flight.grid, flight.radar, flight.n_samples)(block)
    response = image_response(flight.grid, flight.radar, flight.tx_m, flight.rx_m,
                              weighting=flight.weighting)
    level = brightness(image, response, RadarConstant(GAIN))[EDGE:-EDGE, EDGE:-EDGE] / SIGMA0
    near, far = np.array_split(level, 2, axis=1)
    return float(level.mean()), float(near.mean() - far.mean()), equivalent_looks(level)


def reflectors(options: dict, seed: int) -> float:
    """Largest error of the cross sections of single reflectors over the scene, dB."""
    flight = Flight(n=128, **options)
    rng = np.random.default_rng(seed)
    response = image_response(flight.grid, flight.radar, flight.tx_m, flight.rx_m,
                              weighting=flight.weighting)
    half = 0.4 * flight.grid.n_x * flight.grid.spacing_m
    errors = []
    for _ in range(5):
        place = np.array(flight.grid.centre_m) + np.array([*rng.uniform(-half, half, 2), 0.0])
        size = 10 ** rng.uniform(-1, 3)
        image = plan_image(flight.grid, flight.radar, flight.n_samples)(
            flight.block(place[None], np.sqrt([size])))
        peak = measure_scatterer(
            image.samples, flight.grid, place, aperture_centre_m=flight.tx_m.mean(axis=(0, 1)),
            wavenumber_rad_per_m=flight.radar.wavenumber_rad_per_m,
            cut_half_width_range_m=3.0, cut_half_width_azimuth_m=3.0).peak_amplitude
        gain = RadarConstant.from_reflector(peak, flight.grid.to_pixels(*place[:2]), response,
                                            size).gain
        errors.append(20 * np.log10(gain / GAIN))
    return float(max(errors, key=abs))


def measure(seeds: int) -> dict:
    """All cases."""
    results = {}
    with tqdm(total=len(CASES) * seeds, unit='image') as bar:
        for name, options in CASES.items():
            found = []
            for seed in range(seeds):
                found.append(surface(options, 100 + seed))
                bar.update()
            mean, slope, looks = np.transpose(found)
            results[name] = {
                'sigma0_error_db': round(10 * np.log10(mean.mean()), 4),
                'its_deviation_db': round(4.343 * mean.std() / np.sqrt(max(seeds - 1, 1)), 4),
                'near_over_far_db': round(4.343 * slope.mean(), 4),
                'equivalent_looks': round(looks.mean(), 3),
                'largest_reflector_error_db': round(reflectors(options, 7), 4)}
    return results


def main() -> None:
    """Measure, write and print."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--seeds', type=int, default=6, help='surfaces of each case')
    seeds = parser.parse_args().seeds
    results = measure(seeds)
    RESULTS.write_text(json.dumps({'machine': machine(), 'surfaces': seeds, 'cases': results},
                                  indent=2) + '\n')
    print('| scene | sigma nought, error | near over far half | looks '
          '| reflectors, largest error |')
    print('|---|---|---|---|---|')
    for name, r in results.items():
        print(f'| {name} | {r["sigma0_error_db"]:+.3f} ± {r["its_deviation_db"]:.3f} dB '
              f'| {r["near_over_far_db"]:+.3f} dB | {r["equivalent_looks"]:.2f} '
              f'| {r["largest_reflector_error_db"]:+.3f} dB |')


if __name__ == '__main__':
    main()
