# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of docs/newcomer.md: run ``python -m benchmarks.newcomer``, or with names of some."""

from __future__ import annotations

import argparse
import functools
import io
import pathlib
from collections.abc import Sequence

import numpy as np
import PIL.Image
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from sar_imaging.autofocus import Autofocus
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.radiometry import multilook
from sar_imaging.recordings import open_pulses
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation import flawed_aperture
from sar_imaging.simulation.echoes import EchoSimulator, two_way_delays

from .exploitation_figures import decibels, moving_scene

ROOT = pathlib.Path(__file__).parents[1]
FOLDER = ROOT / 'docs' / 'images' / 'newcomer'

# An aircraft 500 m high flies along y and looks along x, at a scene 1 km away.
TRACK_M = np.array([-866.0, 0.0, 500.0])
N_PULSES, SPACING_M = 160, 0.25
NEAR = MapGrid.from_size((0.0, 0.0, 0.0), 13.0, 26.0, 0.1)
WIDE = MapGrid.from_size((0.0, 0.0, 0.0), 13.0, 46.0, 0.1)
# Rows of dots from top to bottom, five wide and seven high.
LETTERS = {'S': (14, 17, 16, 14, 1, 17, 14), 'A': (14, 17, 17, 31, 17, 17, 17),
           'R': (30, 17, 17, 30, 20, 18, 17)}
DOT_M = 1.2
BLUE, ORANGE, GREEN = '#0072b2', '#d55e00', '#009e73'  # told apart by all readers


def word_m() -> np.ndarray:
    """(S, 3) reflectors on the ground that write SAR, read with y to the right, metres."""
    dots = [(row - 3.0, column + 6 * place - 8.0)
            for place, letter in enumerate('SAR') for row, bits in enumerate(LETTERS[letter])
            for column in range(5) if bits >> (4 - column) & 1]
    rows, columns = DOT_M * np.array(dots).T
    return np.stack([rows, columns, 0 * rows], axis=1)  # far is below: x grows downwards


def radar(bandwidth_hz: float = 300e6) -> RadarParameters:
    """X band; range profiles around the scene."""
    return RadarParameters(carrier_hz=10e9, bandwidth_hz=bandwidth_hz, sample_rate_hz=400e6,
                           first_sample_delay_s=2 * 968.0 / SPEED_OF_LIGHT,
                           waveform=Waveform.LFM)


def profiles(points_m, n_pulses: int = N_PULSES, bandwidth_hz: float = 300e6,
             spacing_m: float = SPACING_M, amplitudes=None) -> PulseBlock:
    """Range profiles of scatterers, seen from a straight track, with a little noise.

    Windows over the band and over the track keep the sidelobes out of the pictures.
    """
    along = spacing_m * (np.arange(n_pulses) - (n_pulses - 1) / 2)
    centres = (TRACK_M + along[:, None] * [0.0, 1.0, 0.0])[:, None]
    amplitudes = np.ones(len(points_m)) if amplitudes is None else amplitudes
    samples = EchoSimulator(radar(bandwidth_hz), 192, compressed=True, points_m=points_m,
                            amplitudes=amplitudes)(centres, centres)
    rng = np.random.default_rng(7)
    samples = samples + 0.1 * rng.standard_normal((*samples.shape, 2)) @ [1, 1j]
    samples *= np.hamming(n_pulses)[:, None, None]
    block = PulseBlock(radar(bandwidth_hz), True, np.arange(n_pulses) * 2_000_000,
                       np.arange(n_pulses), samples.astype(np.complex64), centres, centres)
    return RangeCompressor.for_block(block, window='taylor:4:35')(block)


def imaged(block: PulseBlock, grid: MapGrid = NEAR) -> np.ndarray:
    """(n_y, n_x) magnitudes of the exact image."""
    return np.abs(plan_image(grid, block.radar, block.n_samples, method='exact')(block).samples)


# ------------------------------------------------------------------------------- drawing

def canvas(width: float, height: float, columns: int, rows: int = 1, **options):
    """Figure with panels, white also where the page is dark."""
    figure = Figure(figsize=(width, height), layout='constrained', facecolor='white')
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False, **options)


def show(axes, grid: MapGrid, magnitude, title: str) -> None:
    """An image in 25 decibels; y, along the track, to the right and x, across it, downwards."""
    level = 20 * np.log10(np.maximum(magnitude / magnitude.max(), 1e-9))
    x, y = grid.x_m, grid.y_m
    axes.imshow(level.T[:, ::-1], extent=(y[-1], y[0], x[-1], x[0]), cmap='gray',
                vmin=-27, vmax=-2, interpolation='bilinear')
    axes.set_title(title, fontsize=9)
    axes.tick_params(labelsize=7)


def save(figure: Figure, name: str) -> None:
    """A small file of few colours."""
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=100)
    picture = PIL.Image.open(buffer).convert('RGB')
    if len({band.tobytes() for band in picture.split()}) == 1:
        picture = picture.convert('L').quantize(32)
    else:
        picture = picture.quantize(56, method=PIL.Image.Quantize.MAXCOVERAGE)
    picture.save(FOLDER / f'{name}.png', optimize=True)


def row_of_images(name: str, cases, height: float = 2.1, columns: int | None = None,
                  grid: MapGrid = NEAR) -> None:
    """Panels of (title, block)."""
    columns = columns or len(cases)
    figure, axes = canvas(9.0 if columns > 1 else 5.6, height, columns, len(cases) // columns,
                          sharex=True, sharey=True)
    for axis, (title, block) in zip(axes.flat, cases, strict=True):
        show(axis, grid, imaged(block, grid), title)
    for axis in axes[-1]:
        axis.set_xlabel('along the track (m)', fontsize=8)
    for axis in axes[:, 0]:
        axis.set_ylabel('across (m)', fontsize=8)
    save(figure, name)


# ------------------------------------------------------------------------------- pictures

THREE_M = np.array([[-8.0, -12.0, 0], [0.0, 0.0, 0], [8.0, 14.0, 0]])


def aperture() -> None:
    """Track and reflectors from above; their distances from each place of the track."""
    along = SPACING_M * (np.arange(N_PULSES) - (N_PULSES - 1) / 2)
    centres = (TRACK_M + along[:, None] * [0.0, 1.0, 0.0])[:, None]
    range_m = two_way_delays(centres, centres, THREE_M)[:, 0] * SPEED_OF_LIGHT / 2
    figure, [[plan, curve]] = canvas(9.0, 3.2, 2)
    plan.plot(along, 0 * along + TRACK_M[0], color='black', lw=3)
    plan.annotate('track, 40 m', (25, TRACK_M[0]), fontsize=8, va='center')
    for point, color in zip(THREE_M, (BLUE, ORANGE, GREEN), strict=True):
        plan.plot([along[0], point[1], along[-1]], [TRACK_M[0], point[0], TRACK_M[0]], color=color,
                  lw=0.8)
        plan.plot(point[1], point[0], 'o', color=color, ms=4)
    plan.set(xlim=(-110, 110), ylim=(-930, 90), xlabel='along the track (m)', ylabel='across (m)')
    plan.set_title('from above: three reflectors, 866 m beside the track', fontsize=9)
    for column, color in zip(range_m.T, (BLUE, ORANGE, GREEN), strict=True):
        curve.plot(along, 100 * (column - column.min()), color=color)
    curve.axhline(100 * SPEED_OF_LIGHT / 10e9, color='grey', lw=0.8, ls='--')
    curve.annotate('wavelength, 3 cm', (-4, 4), fontsize=8, color='grey')
    curve.set(xlabel='place of the antenna along the track (m)',
              ylabel='range, less its smallest (cm)')
    curve.set_title('range of each reflector, pulse by pulse', fontsize=9)
    save(figure, 'aperture')


def range_compression() -> None:
    """One raw pulse of three reflectors, and its range profile."""
    length_s = 0.5e-6
    raw_radar = RadarParameters(carrier_hz=10e9, bandwidth_hz=300e6, sample_rate_hz=400e6,
                                first_sample_delay_s=2 * 960.0 / SPEED_OF_LIGHT,
                                pulse_length_s=length_s, chirp_rate_hz_per_s=300e6 / length_s,
                                waveform=Waveform.LFM)
    centre = np.broadcast_to(TRACK_M, (1, 1, 3))
    samples = EchoSimulator(raw_radar, 450, compressed=False, points_m=THREE_M,
                            amplitudes=np.array([1.0, 0.7, 1.0]))(centre, centre)
    block = PulseBlock(raw_radar, False, np.zeros(1, np.int64), np.zeros(1, np.int64),
                       samples.astype(np.complex64), centre, centre)
    compressor = RangeCompressor.for_block(block, window='taylor:4:35')
    compressed = compressor(block)
    figure, axes = canvas(9.0, 3.0, 1, 2, sharex=True)
    figure.set_constrained_layout_pads(hspace=0.08)
    axes = axes[:, 0]
    for axis, part in zip(axes, (block, compressed), strict=True):
        delay = (part.radar.first_sample_delay_s
                 + np.arange(part.n_samples) / part.radar.sample_rate_hz)
        values = part.samples[0, 0]
        axis.plot(delay * SPEED_OF_LIGHT / 2,
                  values.real if part is block else np.abs(values) / np.abs(values).max(),
                  color=BLUE, lw=0.9)
        axis.tick_params(labelsize=7)
    axes[0].set_title('raw samples (real part): three chirps of 75 m, one over the other',
                      fontsize=9)
    axes[1].set_title('range profile: three peaks, half a metre wide', fontsize=9)
    axes[1].set(xlabel='range (m)', xlim=(985, 1086))
    save(figure, 'range_compression')


def back_projection() -> None:
    """One pulse, eight, all."""
    block = profiles(word_m())
    middle = N_PULSES // 2
    few = block.select(slice(0, None, N_PULSES // 8))
    row_of_images('back_projection', [
        ('one pulse: arcs of equal range', block.select(slice(middle, middle + 1))),
        ('eight pulses, 5 m apart', few),
        (f'all {N_PULSES} pulses, 0.25 m apart', block)])


def resolution() -> None:
    """Bandwidth across, aperture along."""
    cases = [(f'{bandwidth / 1e6:.0f} MHz, track of {n * SPACING_M:.0f} m',
              profiles(word_m(), n, bandwidth))
             for bandwidth in (60e6, 300e6) for n in (N_PULSES // 5, N_PULSES)]
    row_of_images('resolution', cases, 5.1, 2)


def ambiguities() -> None:
    """Pulses too far apart."""
    block = profiles(word_m())
    row_of_images('ambiguities', [
        (f'a pulse every {step * SPACING_M:g} m', block.select(slice(0, None, step)))
        for step in (1, 3, 5)], 4.4, 1, WIDE)


def defocus() -> None:
    """Positions that are wrong in a simple way, and samples of the wrong sign."""
    block = profiles(word_m())
    turned = PulseBlock(block.radar, True, block.stamp_ns, block.counter, block.samples.conj(),
                        block.tx_m, block.rx_m)
    fast = block.tx_m * [1.0, 1.05, 1.0]
    row_of_images('defocus', [
        ('right', block),
        ('speed 5 % too high', PulseBlock(block.radar, True, block.stamp_ns, block.counter,
                                          block.samples, fast, fast)),
        ('phase with the wrong sign', turned)])


def motion() -> None:
    """A track that is wrong by two wavelengths, and what autofocus makes of it."""
    case = flawed_aperture('smooth', 2.0, seed=1, n_pulses=256)
    result = Autofocus(case.grid, scale_m=0.1).process(case.stated)
    wrong_m = np.linalg.norm(case.stated.tx_m - case.true.tx_m, axis=-1)[:, 0]
    figure, [axes] = canvas(9.0, 3.2, 3)
    axes[0].plot(100 * wrong_m, color=ORANGE)
    axes[0].axhline(100 * SPEED_OF_LIGHT / 10e9, color='grey', lw=0.8, ls='--')
    axes[0].annotate('wavelength, 3 cm', (135, 3.1), fontsize=8, color='grey')
    axes[0].set(xlabel='pulse', ylabel='error of the position (cm)')
    axes[0].set_title('what is wrong', fontsize=9)
    for axis, image, title in ((axes[1], imaged(case.stated, case.grid), 'image with it'),
                               (axes[2], np.abs(result.image), 'after autofocus')):
        level = 20 * np.log10(np.maximum(image / image.max(), 1e-9))
        x, y = case.grid.x_m, case.grid.y_m
        axis.imshow(level, extent=(x[0], x[-1], y[-1], y[0]), cmap='gray',
                    vmin=-30, vmax=-2, interpolation='bilinear')
        axis.set_title(title, fontsize=9)
        axis.set_xlabel('along the track (m)', fontsize=8)
    for axis in axes:
        axis.tick_params(labelsize=7)
    save(figure, 'motion')


def channels() -> None:
    """One channel of several, and what their differences leave."""
    from sar_imaging.exploitation.movers.cancelling import cancel_stationary

    scenario, images, _, _ = moving_scene()
    grid, reference = scenario.grid, np.abs(images[2]).max()
    left = np.sqrt(np.mean(np.abs(cancel_stationary(images)) ** 2, axis=0) * 5 / 4)
    x, y = grid.x_m, grid.y_m
    figure, [axes] = canvas(7.0, 3.5, 2, sharey=True)
    for axis, values, title in ((axes[0], images[2], 'one channel: rough ground'),
                                (axes[1], left, 'five channels: three cars')):
        axis.imshow(decibels(values, reference), extent=(x[0], x[-1], y[-1], y[0]), cmap='gray',
                    vmin=-35, vmax=-2, interpolation='bilinear')
        axis.set_title(title, fontsize=9)
        axis.set_xlabel('across the track (m)', fontsize=8)
        axis.tick_params(labelsize=7)
    axes[0].set_ylabel('along the track (m)', fontsize=8)
    save(figure, 'channels')


@functools.cache
def farm(centre_m: tuple[float, float], width_m: float, height_m: float
         ) -> tuple[MapGrid, np.ndarray]:
    """A part of the recording `bags/countryside`: its grid and power."""
    [block] = open_pulses(ROOT / 'bags' / 'countryside').profiles(1e9)
    grid = MapGrid.from_size((*centre_m, 0.0), width_m, height_m, 0.2)
    image = plan_image(grid, block.radar, block.n_samples)(block)
    return grid, np.abs(image.samples) ** 2


def grey(axes, grid: MapGrid, power, title: str, limits_db: tuple[float, float]) -> None:
    """Power in decibels, x to the right."""
    x, y = grid.x_m, grid.y_m
    axes.imshow(10 * np.log10(power), extent=(x[0], x[-1], y[-1], y[0]), cmap='gray',
                vmin=limits_db[0], vmax=limits_db[1], interpolation='bilinear')
    axes.set_title(title, fontsize=9)
    axes.set_xlabel('across the track (m); the radar is far to the left', fontsize=8)
    axes.tick_params(labelsize=7)


def layover() -> None:
    """The hall of the farm: where it stands, what is displaced, what is hidden."""
    from matplotlib.patches import Rectangle

    grid, power = farm((38.0, 31.0), 50.0, 36.0)
    power = multilook(power, (3, 3))
    middle = 10 * np.log10(np.median(power))
    figure, [[axis]] = canvas(6.4, 4.4, 1)
    grey(axis, grid, power, 'a hall 8 m high', (middle - 18, middle + 20))
    axis.add_patch(Rectangle((30, 19), 14, 24, fill=False, ec='#ffb454', lw=1.6))
    for text, place in (('walls', (37, 40.5)), ('shadow', (50, 31))):
        axis.annotate(text, place, color='#ffb454', fontsize=10, ha='center', weight='bold')
    axis.annotate('layover', (27.5, 22), xytext=(20, 15), color='#ffb454', fontsize=10,
                  weight='bold', ha='center', arrowprops={'color': '#ffb454', 'arrowstyle': '->'})
    save(figure, 'layover')


def speckle() -> None:
    """The same ground by one look, by 9 and by 25."""
    grid, power = farm((-36.0, 20.0), 44.0, 36.0)
    middle = 10 * np.log10(np.median(power))
    figure, [axes] = canvas(9.0, 2.9, 3, sharey=True)
    for axis, n in zip(axes, (1, 5, 11), strict=True):
        averaged = multilook(power, (n, n)) if n > 1 else power
        title = 'one look: speckle' if n == 1 else f'mean power of {n} by {n} pixels'
        grey(axis, grid, averaged, title, (middle - 16, middle + 14))
        axis.set_xlabel('across the track (m)', fontsize=8)
    save(figure, 'speckle')


PICTURES = {function.__name__: function for function in (
    aperture, range_compression, back_projection, resolution, ambiguities, defocus, motion,
    channels, layover, speckle)}


def main(argv: Sequence[str] | None = None) -> None:
    """Draw the pictures that are asked for, all by default."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('names', nargs='*', help=f'of {", ".join(PICTURES)}')
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in parser.parse_args(argv).names or PICTURES:
        PICTURES[name]()
        print(f'{name}: {(FOLDER / name).with_suffix(".png").stat().st_size / 1000:.0f} kB')


if __name__ == '__main__':
    main()
