"""Exact backprojection beside FastSAR 0.1.8: the same phase history, pixels and thread.

Run from the repository root: ``python -m benchmarks.backprojection`` in an environment that has
FastSAR, which is no requirement of this project::

    python3 -m venv build/fastsar
    build/fastsar/bin/pip install fastsar==0.1.8 numba scipy tqdm
    build/fastsar/bin/python -m benchmarks.backprojection

Both start from the phase history and deliver complex map images. The programs take turns and the
best of several runs counts, since other work on the machine can only slow a run down. Errors are
against float64 time-domain correlation over the brightest and as many random pixels. With several
channels FastSAR gets the midpoints of transmitter and receiver, which is what it supports; the
correlation has the exact two-way path.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import pathlib
import time

THREADS = 1
os.environ['OMP_NUM_THREADS'] = str(THREADS)  # read when FastSAR loads its library
os.environ.setdefault('JAX_PLATFORMS', 'cpu')

import numba  # noqa: E402
import numpy as np  # noqa: E402
from tqdm import tqdm  # noqa: E402

from sar_imaging.geometry import MapGrid  # noqa: E402
from sar_imaging.imaging.backprojection import Backprojector  # noqa: E402
from sar_imaging.imaging.correlation import correlate  # noqa: E402
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters, Waveform  # noqa: E402
from sar_imaging.signal.range_compression import RangeCompressor  # noqa: E402
from sar_imaging.signal.spectra import band_spectrum  # noqa: E402

from .machine import machine  # noqa: E402

CARRIER_HZ = 10e9
RESULTS = pathlib.Path(__file__).parent / 'results' / 'backprojection.json'
N_SCATTERERS = 30
ROUNDS = 3


@dataclasses.dataclass(frozen=True)
class Case:
    """One image to form.

    The radar flies along y at x = -range_m and looks along +x; resolution is twice the pixel
    spacing in both directions.
    """

    range_m: float
    n_side: int
    n_pulses: int
    n_channels: int
    spacing_m: float

    @property
    def pixel_pulses(self) -> float:
        """Work of a direct imager; each channel counts as a pulse."""
        return self.n_side**2 * self.n_pulses * self.n_channels


CASES = (
    *(Case(r, 1024, 256, 1, s) for r, s in ((100, 0.05), (1e3, 0.25), (1e4, 0.25), (5e4, 0.25))),
    *(Case(r, 1024, 52, 5, s) for r, s in ((1e3, 0.25), (1e4, 0.25))),
    Case(1e4, 512, 512, 1, 0.25), Case(1e4, 2048, 128, 1, 0.25), Case(1e4, 4096, 64, 1, 0.25),
    Case(1e4, 1024, 2048, 1, 0.25),
)


def phase_history(case: Case) -> tuple[PulseBlock, MapGrid]:
    """Phase history of random scatterers, as our own block, and the pixels."""
    rng = np.random.default_rng(1)
    wavelength = SPEED_OF_LIGHT / CARRIER_HZ
    resolution = 2 * case.spacing_m
    bandwidth = SPEED_OF_LIGHT / (2 * resolution)
    aperture = wavelength * case.range_m / (2 * resolution)
    extent = case.n_side * case.spacing_m
    k = int(2 ** np.ceil(np.log2(1.5 * extent / resolution)))
    tx = np.zeros((case.n_pulses, case.n_channels, 3))
    tx[..., 0] = -case.range_m
    tx[..., 1] = np.linspace(-0.5, 0.5, case.n_pulses)[:, None] * aperture
    rx = tx.copy()
    rx[..., 1] += (np.arange(case.n_channels) - case.n_channels // 2) * wavelength / 2
    grid = MapGrid((-case.spacing_m / 2, -case.spacing_m / 2, 0.0), case.n_side, case.n_side,
                   case.spacing_m)
    points = np.c_[(rng.random((N_SCATTERERS, 2)) - 0.5) * 0.8 * extent, np.zeros(N_SCATTERERS)]
    frequencies = CARRIER_HZ + (np.arange(k) - (k - 1) / 2) * bandwidth / k
    reference = 2 * case.range_m / SPEED_OF_LIGHT
    samples = np.zeros((case.n_pulses, case.n_channels, k), complex)
    for p in points:
        tau = (np.linalg.norm(tx - p, axis=-1) + np.linalg.norm(rx - p, axis=-1)
               ) / SPEED_OF_LIGHT - reference
        samples += np.exp(-2j * np.pi * np.mod(np.multiply.outer(tau, frequencies), 1.0))
    radar = RadarParameters(CARRIER_HZ, bandwidth, bandwidth, reference,
                            waveform=Waveform.STEPPED_FREQUENCY)
    return PulseBlock(radar, False, np.arange(case.n_pulses), np.arange(case.n_pulses), samples,
                      tx, rx), grid


def ours(block: PulseBlock, grid: MapGrid):
    """Call that forms our image, and its plan."""
    compressor = RangeCompressor.for_block(block)
    plan = Backprojector(grid, compressor.output_radar, compressor.n_output)
    return (lambda: plan(compressor(block))), plan


def fastsar(block: PulseBlock, grid: MapGrid, interpolation: str):
    """Call that forms FastSAR's image in our layout."""
    from fastsar.exact import ExactFormer

    k = block.n_samples
    step = block.radar.bandwidth_hz / k
    centres = np.ascontiguousarray((0.5 * (block.tx_m + block.rx_m)).reshape(-1, 3))
    former = ExactFormer(centres, CARRIER_HZ - (k - 1) / 2 * step, step, k, grid.n_x, grid.n_y,
                         grid.spacing_m, grid.spacing_m, (1, 0, 0), (0, 1, 0), backend='cpu',
                         window=False, interp=interpolation, upsample=8,
                         ref=np.full(len(centres), block.radar.range_start_m))
    history = np.ascontiguousarray(block.samples.reshape(-1, k))
    return lambda: np.asarray(former(history)).T[::-1]


def error_db(image: np.ndarray, block: PulseBlock, grid: MapGrid) -> float:
    """Error against correlation, after the best common factor, dB."""
    flat = image.reshape(-1)
    chosen = np.r_[np.argsort(np.abs(flat))[-150:],
                   np.random.default_rng(0).integers(0, flat.size, 150)]
    row, column = np.divmod(chosen, grid.n_x)
    points = np.stack([grid.x_m[column], grid.y_m[row], np.full(len(chosen), grid.z_m)], axis=-1)
    reference = correlate(*band_spectrum(block), block.tx_m, block.rx_m, points)
    # Programs scale differently, and phase references may differ by a constant.
    factor = np.vdot(flat[chosen], reference) / np.vdot(flat[chosen], flat[chosen])
    difference = factor * flat[chosen] - reference
    return float(10 * np.log10(np.sum(np.abs(difference)**2) / np.sum(np.abs(reference)**2)))


def measure(case: Case) -> dict:
    """Rates in 1e9 pixel-pulses per second and errors of all programs."""
    block, grid = phase_history(case)
    form, plan = ours(block, grid)
    calls = {'ours': form, 'fastsar_cubic': fastsar(block, grid, 'cubic'),
             'fastsar_linear': fastsar(block, grid, 'linear')}
    row = dataclasses.asdict(case) | {
        f'{name}_error_db': round(error_db(call(), block, grid), 1)
        for name, call in calls.items()}
    seconds = dict.fromkeys(calls, np.inf)
    for _ in range(ROUNDS):
        for name, call in calls.items():
            started = time.perf_counter()
            call()
            seconds[name] = min(seconds[name], time.perf_counter() - started)
    row |= {f'{name}_rate': round(case.pixel_pulses / s / 1e9, 3) for name, s in seconds.items()}
    return row | {'ours_method': plan.method,
                  'ours_predicted_db': round(plan.predicted_error_db, 1),
                  'ratio_to_cubic': round(seconds['fastsar_cubic'] / seconds['ours'], 2)}


def main() -> None:
    """Measure, print a table and write the results."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n', 1)[0])
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    numba.set_num_threads(THREADS)
    rows = []
    for case in tqdm(CASES):
        rows.append(measure(case))
        tqdm.write(json.dumps(rows[-1]))
    arguments.output.parent.mkdir(exist_ok=True)
    arguments.output.write_text(json.dumps(
        {'machine': machine(), 'threads': THREADS, 'unit': '1e9 pixel-pulses per second',
         'cases': rows}, indent=1) + '\n')


if __name__ == '__main__':
    main()
