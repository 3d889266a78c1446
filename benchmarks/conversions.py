# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Time of message conversions beside a plain copy of the same bytes (needs ROS messages).

Run from the repository root: ``python -m benchmarks.conversions``. Operations take turns in
short batches, so that a busy moment of the machine hits all of them alike.
"""

from __future__ import annotations

import argparse
import json
import pathlib
import time

import numpy as np
from std_msgs.msg import Header

from msg_conversions import images, pulse_block
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters

from .support.machine import machine

SIZES_MIB = (1 / 16, 1, 4, 16)
N_CHANNELS, N_SAMPLES = 4, 512
IMAGE_WIDTH = 512
BATCH = 8
RESULTS = pathlib.Path(__file__).parent / 'results' / 'conversions.json'


def pulses(n_bytes: int) -> PulseBlock:
    rng = np.random.default_rng(0)
    n_pulses = n_bytes // (8 * N_CHANNELS * N_SAMPLES)
    samples = rng.standard_normal((n_pulses, N_CHANNELS, 2 * N_SAMPLES), np.float32)
    centres = rng.uniform(-6.4e6, 6.4e6, (2, n_pulses, N_CHANNELS, 3))
    radar = RadarParameters(10e9, 300e6, 360e6, 66.7e-6, 10e-6, 3e13)
    return PulseBlock(radar, False, 1_700_000_000_000_000_000 + 1_000_000 * np.arange(n_pulses),
                      np.arange(n_pulses), samples.view(np.complex64), *centres)


def operations(n_bytes: int) -> dict[str, object]:
    """Named calls that each convert `n_bytes` of samples or pixels."""
    block = pulses(n_bytes)
    block_message = pulse_block.to_message(block)
    floats = block.samples.reshape(-1).view(np.float32)
    target = np.empty_like(floats)
    amplitude = np.abs(floats).reshape(-1, IMAGE_WIDTH)
    image = floats.view(np.complex64).reshape(-1, IMAGE_WIDTH)
    header = Header(frame_id='map')
    complex_message = images.complex_to_message(image, header)
    amplitude_message = images.amplitude_to_message(amplitude, header)
    return {
        'copy to memory in use': lambda: np.copyto(target, floats),
        'copy to new memory': floats.copy,
        'pulse block to message': lambda: pulse_block.to_message(block),
        'pulse block from message': lambda: pulse_block.from_message(block_message),
        '  of it finite samples': lambda: np.isfinite(np.einsum('i->', floats)),
        'complex image to message': lambda: images.complex_to_message(image, header),
        'complex image from message': lambda: images.complex_from_message(complex_message),
        'amplitude to message': lambda: images.amplitude_to_message(amplitude, header),
        'amplitude from message': lambda: images.amplitude_from_message(amplitude_message),
        'amplitude to quicklook message': lambda: images.quicklook_to_message(
            amplitude, header, dynamic_range_db=60.0)}


def measure(calls: dict[str, object], repetitions: int) -> dict[str, dict[str, float]]:
    times = {name: [] for name in calls}
    for _ in range(repetitions):
        for name, call in calls.items():
            for _ in range(BATCH):
                start = time.perf_counter()
                result = call()
                times[name].append(time.perf_counter() - start)
                del result  # freed outside the timed part, as a node does after publishing
    return {name: {'median_ms': round(1e3 * float(np.median(t)), 4),
                   'best_ms': round(1e3 * min(t), 4)} for name, t in times.items()}


def print_table(results: dict[str, dict[str, dict[str, float]]]) -> None:
    print('median milliseconds (multiple of a copy to memory in use)')
    print(f'{"":32}' + ''.join(f'{size:>18}' for size in results))
    for name in next(iter(results.values())):
        cells = (f'{times[name]["median_ms"]:.3f} '
                 f'({times[name]["median_ms"] / times["copy to memory in use"]["median_ms"]:.1f})'
                 for times in results.values())
        print(f'{name:32}' + ''.join(f'{cell:>18}' for cell in cells))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--repetitions', type=int, default=20)
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    results = {}
    for size in SIZES_MIB:
        label = f'{size:g} MiB' if size >= 1 else f'{size * 1024:g} KiB'
        results[label] = measure(operations(int(size * 2**20)), arguments.repetitions)
    print_table(results)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.write_text(json.dumps(
        {'machine': machine(), 'calls': BATCH * arguments.repetitions, 'results': results},
        indent=1) + '\n')
    print(f'written to {arguments.output}')


if __name__ == '__main__':
    main()
