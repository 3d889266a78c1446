# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Sensitivity of the team 6 reflectors' focus to time offset, range bias and lever arm.

Run: python -m benchmarks.measured.team6_sensitivity FOLDER --output out/team6_sensitivity

Images both reflectors with many time offsets and range biases and the nominal lever arm, and
compares how sharp they are with how far from the survey. The survey says where to look and judges
the result; the estimate does not use it.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from benchmarks.support.reporting import run_and_report
from sar_imaging.autofocus.models import alignment_model
from sar_imaging.geometry.alignment import Alignment
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.poses import PoseTable, PoseTrack
from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality import measure_scatterer
from sar_imaging.recordings import Loaded, load
from sar_imaging.signal.positioning import locate
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT
from sar_imaging.signal.range_compression import RangeCompressor

TIME_OFFSETS_S = np.arange(9.26, 9.3001, 0.01)
RANGE_BIASES_M = np.arange(0.0, 1.0001, 0.1)
LEVER_NAMES = ('lever_x_m', 'lever_y_m', 'lever_z_m')
# Pulses over which clutter and noise of a reflector's echoes are alike: their correlation has
# fallen to zero after three
CORRELATED_PULSES = 3
SMOOTH_S = 0.25  # of the attitudes, whose noise is 0.7 degrees and white
_TILE_M = 0.7
_STEP = 1e-4  # of numerical derivatives, s or m
_LIMIT_M = 0.10


def reflectors(recording: Loaded) -> np.ndarray:
    """(K, 3) float64 surveyed positions of the corner reflectors, metres."""
    return np.array([s['position_m'] for s in recording.scene.scatterers])


def focus(profiles: PulseBlock, place_m) -> tuple[float, np.ndarray]:
    """Amplitude and place (2,) of the brightest point within 0.23 m of a place (3,), metres."""
    grid = MapGrid.from_size(place_m, 2 * _TILE_M, 2 * _TILE_M, 0.025)
    imager = plan_image(grid, profiles.radar, profiles.n_samples, method='exact', target_db=-80.0)
    found = measure_scatterer(
        imager(profiles).samples, grid, place_m,
        aperture_centre_m=profiles.phase_centre_m.mean(axis=0),
        wavenumber_rad_per_m=profiles.radar.wavenumber_rad_per_m,
        cut_half_width_range_m=_TILE_M, cut_half_width_azimuth_m=_TILE_M)
    return found.peak_amplitude, np.array([found.peak_x_m, found.peak_y_m])


def scan(block: PulseBlock, track: PoseTrack, start: Alignment, reflectors_m: np.ndarray,
         time_offsets_s=TIME_OFFSETS_S, range_biases_m=RANGE_BIASES_M,
         ) -> tuple[np.ndarray, np.ndarray]:
    """Focus both reflectors with every time offset and range bias.

    Parameters
    ----------
    block : PulseBlock
        Raw pulses without positions.
    track : PoseTrack
        Of the platform.
    start : Alignment
        Gives the lever arm, and the bias with which the reflectors appear near their places.
    reflectors_m : (K, 3) float64
        Where to look, metres.
    time_offsets_s, range_biases_m : (T,), (B,) float64
        What to try.

    Returns
    -------
    amplitude : (T, B, K) float64
        Of the brightest point there.
    place_m : (T, B, K, 2) float64
        Where it is, metres.
    """
    compressor = None
    shape = (len(time_offsets_s), len(range_biases_m), len(reflectors_m))
    amplitude, place_m = np.empty(shape), np.empty((*shape, 2))
    for t, b, k in np.ndindex(shape):
        located = locate(block, track, dataclasses.replace(
            start, time_offset_s=time_offsets_s[t], range_bias_m=range_biases_m[b]))
        if k == 0:
            compressor = RangeCompressor.for_block(located)
        sight = reflectors_m[k] - located.phase_centre_m.mean(axis=0)
        sight[2] = 0.0
        near = reflectors_m[k] - ((range_biases_m[b] - start.range_bias_m)
                                  / np.linalg.norm(sight) * sight)
        amplitude[t, b, k], place_m[t, b, k] = focus(compressor(located), near)
    return amplitude, place_m


def bounds(block: PulseBlock, track: PoseTrack, alignment: Alignment, places_m: np.ndarray,
           names: Sequence[str]) -> dict[str, float]:
    """Smallest standard deviations (Cramer-Rao) that the echoes of point scatterers allow.

    Unknown besides the parameters are place and phase of each scatterer. Per pulse the phase of
    an echo is known as well as it was measured, and its range as well as a flat band of the
    radar's width allows at that ratio of signal to noise.

    Parameters
    ----------
    block : PulseBlock
        Raw pulses without positions.
    track : PoseTrack
        Of the platform.
    alignment : Alignment
        With which the scatterers were focused.
    places_m : (K, 3) float64
        Where they focus, metres.
    names : sequence of str
        Unknowns, some of `sar_imaging.autofocus.models.NAMES`.

    Returns
    -------
    dict of str to float
        By name; infinite where the echoes tell nothing.
    """
    located = locate(block, track, alignment)
    profiles = RangeCompressor.for_block(located)(located)
    model = alignment_model(located, track, alignment, **dict.fromkeys(names, 1.0))
    n, k = len(names), block.radar.wavenumber_rad_per_m
    rms_band = block.radar.bandwidth_hz / np.sqrt(12.0)
    information = np.zeros((n + 3 * len(places_m),) * 2)
    for i, place in enumerate(places_m):
        slope = np.zeros((block.n_pulses, len(information)))
        for j, step in enumerate(_STEP * np.eye(n)):
            slope[:, j] = (_path(model(model.start + step), place)
                           - _path(model(model.start - step), place)) / (2 * _STEP)
        own = n + 3 * i
        sight = profiles.phase_centre_m - place
        slope[:, own:own + 2] = -(sight / np.linalg.norm(sight, axis=1, keepdims=True))[:, :2]
        phase = k * slope
        phase[:, own + 2] = 1.0
        echo = _echoes(profiles, place)
        variance = np.mean(np.angle(echo * np.conj(echo.sum())) ** 2) * CORRELATED_PULSES
        ranging = 4 * np.pi * rms_band / SPEED_OF_LIGHT * slope
        weight = (np.abs(echo) ** 2 / np.mean(np.abs(echo) ** 2) / variance)[:, None]
        information += phase.T @ (weight * phase) + ranging.T @ (weight * ranging)
    return dict(zip(names, _deviations(information, n), strict=True))


def _path(geometry, place_m) -> np.ndarray:
    """(P,) measured half path of the first channel."""
    return geometry.range_bias_m + 0.5 * sum(
        np.linalg.norm(c[:, 0] - place_m, axis=1) for c in geometry[:2])


def _echoes(profiles: PulseBlock, place_m) -> np.ndarray:
    """(P,) what each pulse contributes to the image at a place."""
    # One pulse with a channel for each: images per channel are contributions per pulse
    pulses = profiles.select(slice(0, 1))
    pulses = dataclasses.replace(pulses, **{name: getattr(profiles, name).swapaxes(0, 1)
                                            for name in ('samples', 'tx_m', 'rx_m')})
    return plan_image(np.asarray(place_m)[None], profiles.radar, profiles.n_samples,
                      method='exact', target_db=-80.0, per_channel=True)(pulses).samples[:, 0]


def _deviations(information: np.ndarray, n: int) -> list[float]:
    """Standard deviation of the first n unknowns; infinite in what is singular to rounding."""
    size = np.sqrt(np.diag(information))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    seen = values > 1e-9
    out = []
    for j in range(n):
        hidden = np.abs(vectors[j, ~seen]).max(initial=0.0) > 1e-3
        variance = np.sum(vectors[j, seen] ** 2 / values[seen])
        out.append(float('inf') if hidden else float(np.sqrt(variance) / size[j]))
    return out


def with_attitudes(folder: Path, poses: PoseTable) -> PoseTable:
    """Poses with the recording's quaternions, smoothed, taken to refer to the axes x, y, z."""
    measured = load('team6_rail', folder, changes={'poses.quaternions': 'mocap_quat_xyzw_raw'})
    turn = Rotation.from_quat(measured.poses.quaternion).as_rotvec()
    rate = 1e9 * (len(poses.stamp_ns) - 1) / float(np.ptp(poses.stamp_ns))
    smooth = uniform_filter1d(turn, round(SMOOTH_S * rate), axis=0)
    return dataclasses.replace(poses, quaternion=Rotation.from_rotvec(smooth).as_quat())


def draw(path: Path, level_db: np.ndarray, error_m: np.ndarray, marks: dict[str, float]) -> None:
    """Draw level and distance from the survey over the range bias.

    Parameters
    ----------
    path : Path
        File to write.
    level_db, error_m : (B, 2) float64
        Of both reflectors.
    marks : dict of str to float
        Range biases to mark, metres.
    """
    figure = Figure(figsize=(10.0, 4.6), layout='constrained')
    for axes, values, label in zip(
            figure.subplots(1, 2), (level_db, error_m),
            ('focused level relative to the best (dB)', 'distance from the survey (m)'),
            strict=True):
        axes.plot(RANGE_BIASES_M, values, '.-', label=['reflector 1', 'reflector 2'])
        for (name, bias), style in zip(marks.items(), ('--', ':'), strict=False):
            axes.axvline(bias, color='0.35', lw=1.2, ls=style, label=f'{name}: {bias:g} m')
        axes.set(xlabel='range bias (m)', ylabel=label, xlim=(RANGE_BIASES_M[0],
                                                              RANGE_BIASES_M[-1]))
        axes.grid(alpha=0.3)
    axes.axhline(_LIMIT_M, color='tab:red', lw=1.0, label=f'limit: {_LIMIT_M:g} m')
    axes.set_ylim(bottom=0.0)
    figure.legend(*axes.get_legend_handles_labels(), fontsize=9, loc='outside lower center',
                  ncols=5)
    figure.savefig(path, dpi=110)


def run(folder: Path, output: Path) -> dict:
    """Scan, judge, draw; returns the contents of results.json."""
    recording = load('team6_rail', folder)
    block, poses, start = recording.block, recording.poses, recording.alignment
    track, survey_m = poses.track(), reflectors(recording)
    amplitude, place_m = scan(block, track, start, survey_m)
    error_m = np.linalg.norm(place_m - survey_m[:, :2], axis=-1)
    t, b = np.unravel_index(np.sum(amplitude**2, axis=-1).argmax(), amplitude.shape[:2])
    level_db = 20 * np.log10(amplitude[t] / amplitude[t].max(axis=0))
    best = dataclasses.replace(start, time_offset_s=float(TIME_OFFSETS_S[t]),
                               range_bias_m=float(RANGE_BIASES_M[b]))
    places_m = np.column_stack([place_m[t, b], survey_m[:, 2]])
    turning = with_attitudes(folder, poses).track()
    names = ('time_offset_s', 'range_bias_m')
    result = {
        'sharpest': {'time_offset_s': best.time_offset_s, 'range_bias_m': best.range_bias_m,
                     'error_m': error_m[t, b].tolist()},
        'least_largest_error_m': float(error_m.max(axis=-1).min()),
        'level_db': {f'{bias:.1f}': row.tolist()
                     for bias, row in zip(RANGE_BIASES_M, level_db, strict=True)},
        'bounds_level': _finite(bounds(block, track, best, places_m, (*names, *LEVER_NAMES))),
        'bounds_turning': _finite(bounds(block, turning, best, places_m,
                                         (*names, *LEVER_NAMES))),
        'bounds_without_lever': _finite(bounds(block, track, best, places_m, names))}
    output.mkdir(parents=True, exist_ok=True)
    draw(output / 'team6_sensitivity.png', level_db, error_m[t],
         {'nominal': start.range_bias_m,
          'fitted to the survey': load('team6_rail_fitted', folder).alignment.range_bias_m})
    return result


def _finite(values: dict[str, float]) -> dict[str, float | None]:
    """JSON knows no infinity: None stands for it."""
    return {name: value if math.isfinite(value) else None for name, value in values.items()}


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = argparse.ArgumentParser(
        prog='team6_sensitivity', description='Focus the reflectors of the team 6 recording over '
        'time offset and range bias: how sharp, how far from the survey, and how well their '
        'echoes can tell the alignment.')
    p.add_argument('folder', type=Path, help='folder with the recording')
    p.add_argument('--output', type=Path, default=Path('out/team6_sensitivity'), metavar='FOLDER',
                   help='folder for team6_sensitivity.png and results.json '
                        '(default: %(default)s)')
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    arguments = parser().parse_args(argv)
    return run_and_report(arguments.output, lambda folder: run(arguments.folder, folder),
                          lambda results: json.dumps(results, indent=2))


if __name__ == '__main__':
    sys.exit(main())
