# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of docs/weekend.md, and a first drive as a radar's driver would record it.

Run from the repository root: ``python -m benchmarks.weekend pictures`` draws a good first image
and what each failure makes of it; ``python -m benchmarks.weekend drive FOLDER`` writes a bag with
the messages of xwr_ros and odometry, for the commands of the page.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import io
import pathlib
from collections.abc import Sequence

import numpy as np
import PIL.Image
from scipy.spatial.transform import Rotation

from sar_imaging.diagnosis.doctor import examine
from sar_imaging.diagnosis.hypotheses import with_slope
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.echoes import EchoSimulator
from sar_imaging.tools.plots import grey_limits_db

from .support import driver_messages as drivers, driver_recordings
from .support.doctor_cases import Case
from .support.doctor_faults import (
    clipped,
    clock_offset,
    conjugated,
    coupled,
    lost,
    receipt,
)

FOLDER = pathlib.Path(__file__).parents[1] / 'docs' / 'images' / 'weekend'
RAMP = drivers.Ramp(77e9, 60e12, 5e6, 6e-6, 70e-6, 20e-3)  # one ramp a frame, 50 frames a second
N_SAMPLES, N_PULSES, LENGTH_M = 256, 256, 0.32
ARM_M = np.array([0.0, 0.10, 0.05])  # the board on the carriage
RX_M = ARM_M + np.array([[0.0, 0, 0], [0.00195, 0, 0]])
START_NS = driver_recordings.START_NS
RADAR = fmcw_parameters(start_frequency_hz=RAMP.start_frequency_hz, sample_rate_hz=5e6,
                        slope_hz_per_s=RAMP.slope_hz_per_s, n_samples=N_SAMPLES,
                        adc_start_s=RAMP.adc_start_s)
GRID = MapGrid.from_size((0.0, 3.0, 0.0), 2.0, 2.0, 0.007)
REFLECTORS_M = np.array([[-0.7, 2.4, 0], [0.7, 2.4, 0], [-0.7, 3.6, 0], [0.7, 3.6, 0],
                         *([x, 3.0, 0] for x in np.linspace(-0.4, 0.4, 5)), [0.15, 3.35, 0]])


def carriage_m(time_s) -> np.ndarray:
    """(N, 3) places of the carriage, which is pushed by hand: its speed is not constant."""
    u = np.asarray(time_s, float) / (N_PULSES * RAMP.period_s) - 0.5
    x = LENGTH_M * (u + 0.05 * np.sin(3 * np.pi * u + 0.4))
    return np.stack([x, 0 * u, 0.75 + 0 * u], axis=-1)


def echoes(tx_m, rx_m, seed: int = 3) -> np.ndarray:
    """(P, C, N) complex64 raw samples of ten reflectors on a rough floor, with noise."""
    rng = np.random.default_rng(seed)
    floor = np.c_[rng.uniform(-1.1, 1.1, 60), rng.uniform(1.9, 4.1, 60), np.zeros(60)]
    amplitudes = np.r_[np.ones(len(REFLECTORS_M)), 0.1 * rng.rayleigh(1.0, 60)
                       * np.exp(2j * np.pi * rng.random(60))]
    samples = EchoSimulator(RADAR, N_SAMPLES, compressed=False, amplitudes=amplitudes,
                            points_m=np.r_[REFLECTORS_M, floor])(tx_m, rx_m)
    noise = rng.standard_normal((*samples.shape, 2)) @ [1, 1j]
    return (samples + noise).astype(np.complex64)


@functools.cache
def slider() -> Case:
    """The right drive: pulses with true phase centres, and its scene."""
    time_s = np.arange(N_PULSES) * RAMP.period_s
    track = carriage_m(time_s)[:, None]
    tx_m, rx_m = np.repeat(track + ARM_M, 2, axis=1), track + RX_M
    block = PulseBlock(RADAR, False, START_NS + np.rint(time_s * 1e9).astype(np.int64),
                       np.arange(N_PULSES), echoes(tx_m, rx_m), tx_m, rx_m)
    return Case('slider', block, GRID)


# ------------------------------------------------------------------------------ failures

def _block(case: Case, **changes) -> Case:
    return dataclasses.replace(case, block=dataclasses.replace(case.block, **changes))


def wrong_velocity(case: Case, rng) -> Case:
    """Positions from a speed that is a fifth too large."""
    return _block(case, **{name: getattr(case.block, name) * [1.2, 1.0, 1.0]
                           for name in ('tx_m', 'rx_m')})


def missing_lever_arm(case: Case, rng) -> Case:
    """The carriage wobbles by a degree, and the board 0.3 m off its axis is not known of."""
    yaw = np.radians(1.0) * np.sin(np.linspace(0, 9, N_PULSES))
    turn = Rotation.from_rotvec(yaw[:, None] * [0, 0, 1])
    moved = (turn.apply([0.3, 0.0, 0.0]) - [0.3, 0.0, 0.0])[:, None]
    return _block(case, samples=echoes(case.block.tx_m + moved, case.block.rx_m + moved))


def sparse(case: Case, rng) -> Case:
    """Every sixth pulse: a slider six times as fast."""
    some = case.block.select(slice(0, None, 6))
    return _block(dataclasses.replace(case, block=some), counter=np.arange(some.n_pulses))


def no_motion(case: Case, rng) -> Case:
    """The poses never change: the topic of a platform that was not the one that moved."""
    still = {name: np.broadcast_to(getattr(case.block, name)[128:129], case.block.tx_m.shape)
             for name in ('tx_m', 'rx_m')}
    return _block(case, **still)


def exchanged(case: Case, rng) -> Case:
    """Positions in another frame: x forward and y left, where x is right and y forward."""
    turned = {name: getattr(case.block, name)[..., [1, 0, 2]] for name in ('tx_m', 'rx_m')}
    return _block(case, **turned)


def slope(case: Case, rng) -> Case:
    """The slope of another profile: 48 MHz/us instead of 60."""
    return dataclasses.replace(case, block=with_slope(case.block, 0.8))


def late_stamps(case: Case, rng) -> Case:
    """Stamps of receipt, and the positions that the carriage had then."""
    case = receipt(case, rng)
    late = carriage_m((case.block.stamp_ns - START_NS) * 1e-9)[:, None]
    return _block(case, tx_m=np.repeat(late + ARM_M, 2, axis=1), rx_m=late + RX_M)


FAILURES = {
    'good': lambda case, rng: case, 'iq_swapped': conjugated, 'clock_offset': clock_offset,
    'wrong_slope': slope, 'wrong_velocity': wrong_velocity,
    'missing_lever_arm': missing_lever_arm, 'sparse_pulses': sparse, 'clipped': clipped,
    'no_motion': no_motion, 'axes_exchanged': exchanged, 'lost_frames': lost,
    'receipt_stamps': late_stamps, 'coupling': coupled}


def failed(name: str) -> Case:
    """The drive with one failure."""
    return FAILURES[name](slider(), np.random.default_rng(5))


def image_of(case: Case) -> np.ndarray:
    """(n_y, n_x) magnitudes as `sar-imaging image` forms them, with fewer sidelobes."""
    profiles = RangeCompressor.for_block(case.block, window='taylor:4:35')(case.block)
    return np.abs(plan_image(case.grid, profiles.radar, profiles.n_samples, method='exact')(
        profiles).samples)


def draw(path: pathlib.Path, magnitude: np.ndarray) -> None:
    """A small picture, in decibels from the clutter to the reflectors."""
    from matplotlib.figure import Figure

    low, high = grey_limits_db(magnitude)
    level = 20 * np.log10(np.maximum(magnitude / magnitude.max(), 1e-9))
    x, y = GRID.x_m, GRID.y_m
    figure = Figure(figsize=(2.6, 2.6), layout='constrained')
    axes = figure.subplots()
    axes.imshow(level, extent=(x[0], x[-1], y[-1], y[0]), cmap='gray', vmin=max(low, high - 40),
                vmax=high)
    axes.tick_params(labelsize=6)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=90)
    PIL.Image.open(buffer).convert('L').quantize(32).save(path, optimize=True)


def named(case: Case) -> list[str]:
    """Faults that the doctor names."""
    return [finding.fault for finding in examine(case.block, case.grid).findings]


def pictures() -> None:
    """Draw all, and print what the doctor says of each."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in FAILURES:
        case = failed(name)
        draw(FOLDER / f'{name}.png', image_of(case))
        print(f'{name}: {", ".join(named(case)) or "nothing"}', flush=True)


# ---------------------------------------------------------------------- as a driver records

def drive(folder: pathlib.Path) -> None:
    """Write the drive as xwr_ros and a slider's odometry publish it."""
    block = slider().block
    cubes = np.clip(300 * block.samples.conj()[:, None, None], -32767 - 32767j, 32767 + 32767j)
    messages = [('xwr_msgs/msg/ChirpInfo', '/xwr/info', START_NS,
                 drivers.chirp_info(RAMP, N_SAMPLES, 1))]
    messages += [('xwr_msgs/msg/IQ', '/xwr/iq', int(ns) + 10**7, drivers.iq(cube, int(ns)))
                 for cube, ns in zip(cubes, block.stamp_ns, strict=True)]
    time_s = np.arange(-0.5, N_PULSES * RAMP.period_s + 0.5, 0.01)
    messages += [('nav_msgs/msg/Odometry', '/odometry', START_NS + round(1e9 * s),
                  drivers.odometry(place, START_NS + round(1e9 * s)))
                 for s, place in zip(time_s, carriage_m(time_s), strict=True)]
    drivers.record(folder, sorted(messages, key=lambda message: message[2]))


def main(argv: Sequence[str] | None = None) -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('what', choices=('pictures', 'drive'))
    parser.add_argument('folder', type=pathlib.Path, nargs='?', help='bag folder to make',
                        default=pathlib.Path('first_drive'))
    arguments = parser.parse_args(argv)
    if arguments.what == 'pictures':
        pictures()
    else:
        drive(arguments.folder)
        print(f'{arguments.folder}: {N_PULSES} frames')


if __name__ == '__main__':
    main()
