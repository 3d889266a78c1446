# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Image a recording of the radar on a rotating arm and estimate the arm's radius from it.

Run: python -m benchmarks.measured.image_arcsar FILE --output out/arcsar

An antenna that faces outward sees a place only from a part of its circle: each pulse goes into
the pixels within its beam, which the description of the recording tells. `evaluate` images the
same recording with the same beam through the nodes.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.support.reporting import run_and_report
from sar_imaging.autofocus.models import Geometry, GeometryModel
from sar_imaging.autofocus.search import search
from sar_imaging.autofocus.tiles import bright_points
from sar_imaging.geometry.antenna import Antenna
from sar_imaging.geometry.grids import Grid, MapGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality import measure_scatterer
from sar_imaging.recordings import (
    DescriptionError,
    Loaded,
    find_description,
    load,
    read_description,
)
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.tools.plots import save_image_png

RADIUS_M = 0.2105  # of the antenna's circle, found by focusing
HALF_BEAM_DEG = 35.0
START_RADIUS_M = 0.20
RADII_M = START_RADIUS_M + np.arange(-4, 21) * 1e-3
N_BRIGHT = 12
N_UNKNOWN = 3  # brightest places that stand for the points of a recording that has none known
FAR_POINT_M = (-0.52, 8.48)  # brightest spot of the extended reflector of recording 7


def read_recording(file: Path) -> Loaded:
    """Pulses of a recording; recording 7, whatever its file is called, with its points."""
    known = read_description(find_description('arcsar_7')).raw('samples')['sha256']
    try:
        same = hashlib.sha256(Path(file).read_bytes()).hexdigest() == known
    except OSError as error:
        raise DescriptionError(f'{file} cannot be read: {error}') from error
    return load('arcsar_7' if same else 'arcsar', file)


def arm_angles(n_pulses: int) -> np.ndarray:
    """(P,) float64 angle of the arm at each pulse, equally spaced over half a turn, radians."""
    return np.linspace(0.0, np.pi, n_pulses)


def arc(n_pulses: int, radius_m: float) -> np.ndarray:
    """(P, 1, 3) float64 phase centres on the half circle, metres."""
    angle = arm_angles(n_pulses)
    return radius_m * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)[:, None]


def image_within_beam(profiles: PulseBlock, grid: Grid | np.ndarray,
                      antenna: Antenna) -> np.ndarray:
    """Image of pulses, each in the pixels that the antenna lights.

    Parameters
    ----------
    profiles : PulseBlock
        Range profiles of the half circle, with their pointing.
    grid : Grid or (..., 3) float64
        Pixels in the frame of the arm, metres.
    antenna : Antenna
        Pattern of the antenna.

    Returns
    -------
    (...) complex64
    """
    return plan_image(grid, profiles.radar, profiles.n_samples, method='exact', target_db=-60.0,
                      illumination=antenna.amplitudes())(profiles).samples


def radius_sharpness(profiles: PulseBlock, point_m, antenna: Antenna,
                     radii_m=RADII_M) -> np.ndarray:
    """Sharpness of the image around a point for each radius of the arm.

    Parameters
    ----------
    profiles : PulseBlock
        Range profiles of the half circle; their positions are not used.
    point_m : (2,) floats
        Middle of the tile of 0.5 m, metres.
    antenna : Antenna
        Pattern of the antenna.
    radii_m : (R,) float64
        Radii to try, metres.

    Returns
    -------
    (R,) float64
        ``sum I^2 / (sum I)^2`` of the intensity I: 1 for a single bright pixel.
    """
    tile = MapGrid.from_size((*point_m, 0.0), 0.5, 0.5, 0.01).points()
    out = []
    for radius_m in radii_m:
        centre_m = arc(profiles.n_pulses, radius_m)
        image = image_within_beam(dataclasses.replace(profiles, tx_m=centre_m, rx_m=centre_m),
                                  tile, antenna)
        power = np.square(np.abs(image), dtype=float)
        out.append(np.sum(power**2) / np.sum(power) ** 2)
    return np.array(out)


def autofocus_radius(profiles: PulseBlock, point_m, start_m: float = START_RADIUS_M) -> float:
    """Radius of the arm that autofocus finds from a point, metres.

    Parameters
    ----------
    profiles : PulseBlock
        Range profiles of the half circle; their positions are not used.
    point_m : (2,) floats
        Where the point is in the image of the start, to half a metre, metres.
    start_m : float
        Radius to start from, metres; expected to be wrong by a centimetre.
    """
    angle = arm_angles(profiles.n_pulses)
    seen = np.abs(angle - np.arctan2(point_m[1], point_m[0])) <= np.radians(HALF_BEAM_DEG)
    unit = arc(profiles.n_pulses, 1.0)[seen]
    model = GeometryModel(('radius_m',), [start_m], [0.01],
                          lambda radius: Geometry(radius[0] * unit, radius[0] * unit))
    found = search(profiles.select(seen), model, [[*point_m, 0.0]])
    return float(found.parameters[0])


def radius_by_direction(profiles: PulseBlock, image: np.ndarray, grid: MapGrid,
                        n_places: int = N_BRIGHT) -> tuple[np.ndarray, np.ndarray]:
    """Radius that each of the brightest places asks for, whatever it is.

    Parameters
    ----------
    profiles : PulseBlock
        Range profiles of the half circle.
    image : (n_y, n_x) complex64
        Their image, with any radius near the true one.
    grid : MapGrid
        Its pixels.
    n_places : int
        How many places.

    Returns
    -------
    angle_rad, radius_m : (K,) float64
        Direction of the place from the axis, radians, and radius by autofocus, metres.
    """
    places = bright_points(image, grid, profiles, n_places)[:, :2]
    return (np.arctan2(places[:, 1], places[:, 0]),
            np.array([autofocus_radius(profiles, place) for place in places]))


def brightest(profiles: PulseBlock, image: np.ndarray, grid: MapGrid
              ) -> dict[str, tuple[float, float]]:
    """Names and places of the brightest pixels, metres."""
    places = bright_points(image, grid, profiles, N_UNKNOWN)[:, :2].tolist()
    return {f'bright_{i}': tuple(place) for i, place in enumerate(places, 1)}


def measure_points(image: np.ndarray, grid: MapGrid, profiles: PulseBlock,
                   points: dict[str, tuple[float, float]]) -> list[dict]:
    """Position, widths and sidelobes of points, as `evaluate` measures them.

    What cannot be measured is None: a bright place need not be a point.
    """
    # The middle of the pulses that see a point; cuts and baseband depend on it.
    angle = arm_angles(profiles.n_pulses)
    out = []
    for name, (x, y) in points.items():
        seen = np.abs(angle - np.arctan2(y, x)) <= np.radians(HALF_BEAM_DEG)
        quality = measure_scatterer(
            image, grid, (x, y, 0.0), aperture_centre_m=profiles.phase_centre_m[seen].mean(axis=0),
            wavenumber_rad_per_m=profiles.radar.wavenumber_rad_per_m,
            cut_half_width_range_m=0.3, cut_half_width_azimuth_m=0.3, name=name)
        out.append(quality.as_json())
    return out


def save_radius_png(path: Path, curves: dict[str, np.ndarray], angle_rad: np.ndarray,
                    radius_m: np.ndarray) -> None:
    """Draw sharpness over radius, each relative to its maximum, and radius over direction."""
    figure = Figure(figsize=(10.0, 4.0), layout='constrained')
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    for name, sharpness in curves.items():
        left.plot(RADII_M * 1e3, sharpness / sharpness.max(), label=name)
    left.axvline(RADIUS_M * 1e3, color='0.6', lw=0.8)
    left.annotate('with the data: 210.5', (RADIUS_M * 1e3, 0.03), xytext=(4, 0),
                  textcoords='offset points', fontsize=8, color='0.4')
    left.set(xlabel='radius of the arm (mm)', ylabel='sharpness, relative', ylim=(0, 1.05))
    left.legend(fontsize=8, loc='lower left')
    right.plot(np.degrees(angle_rad), radius_m * 1e3, 'o')
    right.axhline(RADIUS_M * 1e3, color='0.6', lw=0.8)
    right.set(xlabel='direction from the axis (degrees)', xlim=(0, 180),
              ylabel='radius asked for by a bright place (mm)',
              ylim=(RADII_M[0] * 1e3, RADII_M[-1] * 1e3 + 5))
    figure.savefig(path, dpi=110)


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = argparse.ArgumentParser(
        prog='image_arcsar', description='Image a recording of the 77 GHz radar on a rotating '
        'arm, measure its two points, or the brightest places where none are known, and the '
        'radius of the arm.')
    p.add_argument('file', type=Path, help='Prova_Esterna_7.bin or another')
    p.add_argument('--output', type=Path, default=Path('out/arcsar'), metavar='FOLDER',
                   help='folder for image.npy, image.png, radius.png and results.json '
                        '(default: %(default)s)')
    return p


def run(file: Path, output: Path) -> dict:
    """Image, measure, draw; returns the contents of results.json."""
    recording = read_recording(file)
    block = recording.block
    profiles = RangeCompressor.for_block(block, window=recording.scene.window)(block)
    grid = MapGrid.from_size((0.0, 5.0, 0.0), 12.0, 10.0, 0.02)
    output.mkdir(parents=True, exist_ok=True)
    image = image_within_beam(profiles, grid, recording.antenna)
    np.save(output / 'image.npy', image)
    known = {s['name']: tuple(s['position_m'][:2]) for s in recording.scene.scatterers}
    points = known or brightest(profiles, image, grid)
    save_image_png(
        output / 'image.png', image, grid,
        truth=[{'name': name, 'position_m': (x, y, 0.0)} for name, (x, y) in points.items()],
        title=f'arc SAR: {block.n_pulses} pulses on a half circle of {RADIUS_M * 100:.2f} cm, '
              f'{HALF_BEAM_DEG:g}\N{DEGREE SIGN} of beam')
    places = points | ({'far reflector': FAR_POINT_M} if known else {})
    curves = {name: radius_sharpness(profiles, place, recording.antenna)
              for name, place in places.items()}
    angle_rad, radius_m = radius_by_direction(profiles, image, grid)
    save_radius_png(output / 'radius.png', curves, angle_rad, radius_m)
    return {
        'bright_places': {'direction_deg': np.degrees(angle_rad).round(1).tolist(),
                          'radius_m': radius_m.round(5).tolist()},
        'points': measure_points(image, grid, profiles, points),
        'radius_m': {name: round(autofocus_radius(profiles, place), 5)
                     for name, place in places.items()}}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    arguments = parser().parse_args(argv)
    return run_and_report(arguments.output, lambda folder: run(arguments.file, folder), summary)


def summary(figures: dict) -> str:
    """One line for each point and for each radius."""
    points = [f'{point["name"]}: {_measured(point)}' for point in figures['points']]
    radii = [f'radius by autofocus of {name}: {radius_m * 1e3:.2f} mm, '
             f'started at {START_RADIUS_M * 1e3:.0f} mm'
             for name, radius_m in figures['radius_m'].items()]
    return '\n'.join([*points, *radii])


def _measured(point: dict) -> str:
    if point['peak_x_m'] is None:
        return point['reason']
    widths = [f'{width * 100:.1f} cm in {axis}' for axis in ('range', 'azimuth')
              if (width := point[f'irw_{axis}_m']) is not None]
    return (f'({point["peak_x_m"]:.3f}, {point["peak_y_m"]:.3f}) m, '
            + (f'width {", ".join(widths)}' if widths else 'its widths cannot be measured')
            + (f'; {point["reason"]}' if point['reason'] else ''))


if __name__ == '__main__':
    sys.exit(main())
