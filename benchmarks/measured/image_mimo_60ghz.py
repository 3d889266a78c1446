# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Image the recording of the 60 GHz MIMO radar in three dimensions, calibrated from itself.

Run: python -m benchmarks.measured.image_mimo_60ghz FILE --output out/mimo_60ghz

The voxels lie on spheres around the aperture: azimuth from straight ahead, elevation, distance.
Pictures are maximum projections of the volume. One channel against eight shows what the array
adds; uncalibrated against calibrated, what the balancing does.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.support.reporting import decibels, run_and_report
from sar_imaging.exploitation.calibration import Balance, balance_channels
from sar_imaging.imaging.imager import plan_image
from sar_imaging.recordings import load
from sar_imaging.signal.calibration import ChannelCalibration
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.range_compression import RangeCompressor

AZIMUTH_DEG = np.arange(-60.0, 60.1, 1.0)
ELEVATION_DEG = np.arange(-24.0, 20.1, 1.0)
RANGE_M = np.arange(1.0, 3.6, 0.02)
BALANCED_RANGE_M = (1.2, 2.0)  # chair and cabinet
DYNAMIC_RANGE_DB = 25.0
# What stands where, from the description of the data: azimuth in degrees, distance in metres
OBJECTS = {'chair': ((-12.0, 8.0), (1.7, 1.9)), 'cabinet': ((-45.0, -30.0), (1.25, 1.45))}


def directions_to_points(azimuth_deg, elevation_deg, range_m) -> np.ndarray:
    """(A, E, R, 3) float64 positions, metres: azimuth from y towards x, elevation above it."""
    azimuth, elevation, range_m = np.meshgrid(np.radians(azimuth_deg), np.radians(elevation_deg),
                                              range_m, indexing='ij')
    level = range_m * np.cos(elevation)
    return np.stack([level * np.sin(azimuth), level * np.cos(azimuth),
                     range_m * np.sin(elevation)], axis=-1)


def range_profiles(block: PulseBlock) -> PulseBlock:
    """Profiles of the room, Hamming weighted: the near clutter of the board is left out."""
    return RangeCompressor.for_block(block, window='hamming', range_window_m=(0.8, 4.0))(block)


def balance(profiles: PulseBlock) -> Balance:
    """Balance the channels over chair and cabinet."""
    range_m = RANGE_M[(RANGE_M >= BALANCED_RANGE_M[0]) & (RANGE_M <= BALANCED_RANGE_M[1])]
    return balance_channels(profiles, directions_to_points(
        np.arange(-50.0, 50.1, 1.5), np.arange(-16.0, 8.1, 1.5), range_m))


def channel_volumes(profiles: PulseBlock) -> np.ndarray:
    """(C, A, E, R) complex64 volume of each channel."""
    points = directions_to_points(AZIMUTH_DEG, ELEVATION_DEG, RANGE_M)
    imager = plan_image(points, profiles.radar, profiles.n_samples, method='exact',
                        target_db=-50.0, per_channel=True)
    return imager(profiles).samples


def strongest(volume: np.ndarray, azimuth_deg, range_m) -> dict:
    """Direction and distance of the brightest voxel between limits."""
    a = np.flatnonzero((AZIMUTH_DEG >= azimuth_deg[0]) & (AZIMUTH_DEG <= azimuth_deg[1]))
    r = np.flatnonzero((RANGE_M >= range_m[0] - 1e-9) & (RANGE_M <= range_m[1] + 1e-9))
    part = np.abs(volume[a][:, :, r])
    i, j, k = np.unravel_index(part.argmax(), part.shape)
    return {'azimuth_deg': float(AZIMUTH_DEG[a[i]]), 'elevation_deg': float(ELEVATION_DEG[j]),
            'range_m': round(float(RANGE_M[r[k]]), 3), 'amplitude': float(part.max())}


def azimuth_extent(volume: np.ndarray, range_m) -> dict:
    """Where the energy between two distances lies: middle and standard deviation, degrees.

    Of the maximum projection over elevation and distance, in power, down to 12 dB.
    """
    r = (RANGE_M >= range_m[0] - 1e-9) & (RANGE_M <= range_m[1] + 1e-9)
    power = np.square(np.abs(volume[:, :, r])).max(axis=(1, 2)).astype(float)
    power[power < power.max() * 10 ** -1.2] = 0.0
    middle = np.sum(power * AZIMUTH_DEG) / power.sum()
    spread = np.sqrt(np.sum(power * (AZIMUTH_DEG - middle) ** 2) / power.sum())
    return {'middle_deg': round(float(middle), 2), 'spread_deg': round(float(spread), 2)}


def contrast_db(volume: np.ndarray, azimuth_deg, range_m) -> float:
    """Mean power between limits over the mean power elsewhere at the same distances, dB."""
    r = (RANGE_M >= range_m[0] - 1e-9) & (RANGE_M <= range_m[1] + 1e-9)
    inside = (AZIMUTH_DEG >= azimuth_deg[0]) & (AZIMUTH_DEG <= azimuth_deg[1])
    power = np.square(np.abs(volume[:, :, r]), dtype=float)
    return float(10 * np.log10(power[inside].mean() / power[~inside].mean()))


def measure(volume: np.ndarray) -> dict:
    """Figures of a volume for every object."""
    out = {}
    for name, (azimuth_deg, range_m) in OBJECTS.items():
        # Looked for at all azimuths, so that the place is found and not assumed.
        out[name] = {'strongest': strongest(volume, (-60.0, 60.0), range_m),
                     'azimuth': azimuth_extent(volume, range_m),
                     'contrast_db': round(contrast_db(volume, azimuth_deg, range_m), 2)}
    return out


def save_volumes_png(path: Path, volumes: dict[str, np.ndarray]) -> None:
    """Draw maximum projections: from above, and from the radar at the distance of the objects."""
    figure = Figure(figsize=(11.0, 3.3 * len(volumes)), layout='constrained')
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(volumes), 3, squeeze=False)
    scale = {'vmin': -DYNAMIC_RANGE_DB, 'vmax': 0.0, 'cmap': 'magma', 'origin': 'lower',
             'aspect': 'auto'}
    sides = (AZIMUTH_DEG[0], AZIMUTH_DEG[-1])
    for row, (name, volume) in zip(axes, volumes.items(), strict=True):
        magnitude = np.abs(volume)
        level = decibels(magnitude.max(axis=1))
        drawn = row[0].imshow(level.T, extent=(*sides, RANGE_M[0], RANGE_M[-1]), **scale)
        row[0].set(title=f'{name}: from above', xlabel='azimuth (\N{DEGREE SIGN})',
                   ylabel='distance (m)')
        for place, (object_name, (azimuth_deg, range_m)) in zip(row[1:], OBJECTS.items(),
                                                                strict=True):
            r = (RANGE_M >= range_m[0] - 1e-9) & (RANGE_M <= range_m[1] + 1e-9)
            level = decibels(magnitude[:, :, r].max(axis=2))
            place.imshow(level.T, extent=(*sides, ELEVATION_DEG[0], ELEVATION_DEG[-1]), **scale)
            place.set(title=f'{object_name}, {range_m[0]:g} to {range_m[1]:g} m',
                      xlabel='azimuth (\N{DEGREE SIGN})', ylabel='elevation (\N{DEGREE SIGN})')
            for edge in azimuth_deg:
                place.axvline(edge, color='w', lw=0.6, ls=':')
            low, high = azimuth_deg
            row[0].plot([low, high, high, low, low],
                        [range_m[0], range_m[0], range_m[1], range_m[1], range_m[0]], color='w',
                        lw=0.6, ls=':')
        figure.colorbar(drawn, ax=row[-1], label='dB')
    figure.savefig(path, dpi=110)


def run(file: Path, output: Path) -> dict:
    """Calibrate, image, measure, draw into a folder; returns the contents of results.json."""
    profiles = range_profiles(load('mimo_60ghz', file).block)
    balanced = balance(profiles)
    found = balanced.calibration
    # Delays come out smaller than they scatter from object to object: only the rest is used.
    applied = ChannelCalibration(found.amplitude, found.phase_rad, 0 * found.delay_s)
    output.mkdir(parents=True, exist_ok=True)
    applied.save(output / 'calibration.yaml')
    channels = channel_volumes(profiles)
    volumes = {'one channel': channels[0], 'eight channels': channels.sum(axis=0),
               'eight, calibrated': np.tensordot(applied.weights, channels, axes=1)}
    save_volumes_png(output / 'volume.png', volumes)
    np.save(output / 'volume.npy', volumes['eight, calibrated'])
    figures = {
        'images': {name: measure(volume) for name, volume in volumes.items()},
        'calibration': {
            'method': balanced.method, 'coherence': round(balanced.coherence, 3),
            'peak_gain_db': round(balanced.peak_gain_db, 2),
            'amplitude': found.amplitude.round(3).tolist(),
            'phase_deg': np.degrees(found.phase_rad).round(1).tolist(),
            'delay_cells': (found.delay_s * profiles.radar.bandwidth_hz).round(3).tolist()}}
    return figures


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = argparse.ArgumentParser(
        prog='image_mimo_60ghz', description='Image the recording of the 60 GHz MIMO radar '
        '(mimo_chair.npz) in three dimensions with one channel, eight, and eight calibrated.')
    p.add_argument('file', type=Path, help='mimo_chair.npz')
    p.add_argument('--output', type=Path, default=Path('out/mimo_60ghz'), metavar='FOLDER',
                   help='folder for volume.png, volume.npy, calibration.yaml and results.json '
                        '(default: %(default)s)')
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    arguments = parser().parse_args(argv)
    return run_and_report(arguments.output, lambda folder: run(arguments.file, folder), summary)


def summary(figures: dict) -> str:
    """One line for each object in each image."""
    lines = []
    for name, objects in figures['images'].items():
        for object_name, found in objects.items():
            peak, azimuth = found['strongest'], found['azimuth']
            lines.append(
                f'{name:18} {object_name:8} strongest at {peak["azimuth_deg"]:+.0f}, '
                f'{peak["elevation_deg"]:+.0f} degrees, {peak["range_m"]:.2f} m; azimuth '
                f'{azimuth["middle_deg"]:+.1f} +- {azimuth["spread_deg"]:.1f} degrees; '
                f'{found["contrast_db"]:+.1f} dB above the rest of its distance')
    return '\n'.join(lines)


if __name__ == '__main__':
    sys.exit(main())
