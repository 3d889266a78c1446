# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
r"""Reproduce the experiment of Zhang et al. 2014, the letter that proposes AFBP.

Run: python -m benchmarks.reproduction.reproduce_spotlight_letter \
         --output out/spotlight_letter
"""

from __future__ import annotations

import argparse
import gc
import platform
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numba
import numpy as np
from tqdm import tqdm

from benchmarks.reproduction.letter_scene import (
    RESOLUTION_M,
    SIZES,
    SpotlightExperiment,
    spotlight_letter,
)
from benchmarks.support.reporting import run_and_report
from sar_imaging.quality import error_db
from sar_imaging.quality.verification import measure_error

from . import letter_figures as figures, letter_imagers as imagers, letter_measurements as measure
from .letter_recording import Recording
from .letter_spectra import measure_spectra

SCENE_SPACING_M = 0.12  # of the pixels of the whole scene
CHECKED_PIXELS, CHECKED_BRIGHTEST = 48, 16  # correlated to tell the error of a whole scene
WINDOWS = ('hamming', 'none')
PAPER = {
    'azimuth_sidelobes_16_pulses': {'FFBP': 'up to -15 dB', 'AFBP': 'below -25 dB'},
    'points_1_and_2': 'distinctively separated',
    'nominal_resolution_m': RESOLUTION_M,
    'afbp_over_ffbp': 'over two times faster',
    'flight_s': 7.8,
}

_EPILOG = """\
Simulates the recording (2.1 GB of phase history at full size, in a temporary file in the output
folder), images it and writes figures 3 to 8 as PNG and every number as results.json;
docs/reproduce/spotlight_letter.md discusses the results. Full size needs some 13 GB of memory.
NUMBA_NUM_THREADS limits the cores used.
"""


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = argparse.ArgumentParser(
        prog='reproduce_spotlight_letter', description='Reproduce the experiment of L. Zhang et '
        'al., A Fast BP Algorithm With Wavenumber Spectrum Fusion for High-Resolution Spotlight '
        'SAR Imaging.', epilog=_EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument('--output', type=Path, default=Path('out/spotlight_letter'), metavar='FOLDER',
                   help='folder for the figures and results.json (default: %(default)s)')
    p.add_argument('--size', choices=tuple(SIZES), default='full',
                   help='full: as in the letter. small: the same radar, range and aperture with '
                        'an eighth of the pulses, of the samples and of each side of the scene, '
                        'in about a minute (default: %(default)s)')
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    arguments = parser().parse_args(argv)
    return run_and_report(
        arguments.output,
        lambda folder: reproduce(folder, spotlight_letter(arguments.size)), summary)


def reproduce(folder: Path, experiment: SpotlightExperiment) -> dict:
    """Run the experiment, write the figures; returns what goes into results.json.

    Parameters
    ----------
    folder : path
        Folder for the PNG files and, meanwhile, the phase history.
    experiment : SpotlightExperiment
        What to simulate.

    Returns
    -------
    dict
        JSON-compatible.
    """
    with tempfile.TemporaryFile(dir=folder) as file:
        shape = (experiment.n_pulses, experiment.n_samples)
        phase_history = np.memmap(file, np.complex64, 'w+', shape=shape)
        with tqdm(total=shape[0], desc='echoes', unit='pulse', disable=None) as bar:
            experiment.record(phase_history, bar.update)
        recordings = {w: Recording(experiment, phase_history, w) for w in WINDOWS}
        spectra = measure_spectra(recordings['none'])
        figures.draw_line_spectra(folder / 'figure_03.png', spectra)
        figures.draw_plane_spectra(folder / 'figure_04.png', spectra)
        points = _measure_points(folder, recordings)
        scene = _measure_scene(folder, recordings['hamming'])
    return {'paper': PAPER, 'size': experiment.name, 'geometry': _geometry(experiment),
            **points, 'scene': scene,
            'machine': f'{platform.machine()}, {numba.get_num_threads()} threads'}


def _geometry(experiment: SpotlightExperiment) -> dict:
    return {'pulses': experiment.n_pulses, 'samples': experiment.n_samples,
            'aperture_m': round(experiment.aperture_m, 3),
            'pulse_spacing_m': round(experiment.pulse_spacing_m, 6),
            'carrier_hz': experiment.radar.carrier_hz,
            'bandwidth_hz': experiment.radar.bandwidth_hz,
            'scene_m': experiment.scene_m, 'scatterers': len(experiment.scatterers),
            'noise_db': experiment.noise_db}


def _measure_points(folder: Path, recordings: dict[str, Recording]) -> dict:
    """Figures 6 to 8: the subscene by every imager, and exactly without window."""
    experiment = recordings['hamming'].experiment
    grid = measure.subscene_grid(experiment)
    images = {}
    profiles = recordings['hamming'].patch_profiles(grid)
    for name, form in tqdm(imagers.IMAGERS.items(), desc='subscene', unit='image', disable=None):
        image = form(grid, profiles).image
        images[name] = measure.measure_subscene(image, grid, experiment)
    exact = images[imagers.EXACT]
    errors = {name: round(error_db(m.image, exact.image), 2) for name, m in images.items()
              if name != imagers.EXACT}
    figures.draw_subscene(folder / 'figure_06.png', images, grid, experiment)
    figures.draw_pair(folder / 'figure_07.png', images, grid, experiment)
    figures.draw_single(folder / 'figure_08.png', images, grid, experiment)
    plain = imagers.IMAGERS[imagers.EXACT](grid, recordings['none'].patch_profiles(grid)).image
    unweighted = measure.measure_subscene(plain, grid, experiment)
    return {'points': {name: _point_results(m) for name, m in images.items()},
            'error_to_exact_db': errors, 'without_window': _point_results(unweighted),
            'dip_by_phase_of_the_pair': {
                'hamming': _dips(exact), 'none': _dips(unweighted)}}


def _point_results(m: measure.SubsceneImage) -> dict:
    q, pair = m.quality, m.pair
    return _rounded({
        'point_3': {k: v for k, v in q.as_json().items() if k.startswith(
            ('irw', 'pslr', 'islr', 'position')) or (k == 'reason' and v)},
        'points_1_and_2': {'separation_m': pair.separation_m, 'dip_db': pair.dip_db,
                           'imbalance_db': pair.imbalance_db, 'sidelobe_db': pair.sidelobe_db}})


def _dips(m: measure.SubsceneImage) -> dict:
    pairs = measure.separability(m.single, m.offset_m)
    return {str(phase): _rounded({'dip_db': p.dip_db, 'separation_m': p.separation_m})
            for phase, p in pairs.items()}


def _rounded(values):
    """The same structure with its floats rounded to four digits after the point."""
    if isinstance(values, dict):
        return {k: _rounded(v) for k, v in values.items()}
    return round(float(values), 4) if isinstance(values, float) else values


def _measure_scene(folder: Path, recording: Recording) -> dict:
    """Figure 5: the whole scene by the fast imagers, with seconds, memory and errors."""
    experiment = recording.experiment
    grid = experiment.scene_grid(SCENE_SPACING_M)
    results, small = {}, {}
    for name, form in imagers.WHOLE_SCENE.items():
        gc.collect()
        with imagers.watch_memory() as peak:
            formed = form(grid, recording)
        checked = measure_error(formed.image, grid, recording.weighted_blocks(),
                                n_pixels=CHECKED_PIXELS, n_brightest=CHECKED_BRIGHTEST,
                                progress=sys.stderr.isatty())
        small[name] = figures.shrink(formed.image)
        results[name] = _rounded({
            'seconds': {**formed.seconds, 'together': sum(formed.seconds.values())},
            'pulses_per_subaperture': formed.pulses_per_subaperture,
            'peak_memory_gb': peak.n_bytes / 1e9,
            'predicted_error_db': formed.predicted_error_db, 'error_db': checked.error_db,
            'error_of_brightest_db': checked.brightest_error_db})
        del formed
    figures.draw_scene(folder / 'figure_05.png', small, experiment)
    return {'pixels': grid.n_x * grid.n_y, 'spacing_m': grid.spacing_m, 'imagers': results}


def summary(results: dict) -> str:
    """The main numbers, for people."""
    lines = [f'{"azimuth response of points 1 to 3":34s}{"IRW (m)":>9s}{"PSLR (dB)":>11s}'
             f'{"dip (dB)":>10s}{"error (dB)":>12s}']

    def number(value, width, digits):
        return f'{value:{width}.{digits}f}' if value is not None else ' ' * (width - 1) + '-'

    for name, found in results['points'].items():
        lines.append(f'{name:34s}' + number(found['point_3']['irw_azimuth_m'], 9, 3)
                     + number(found['point_3']['pslr_azimuth_db'], 11, 1)
                     + number(found['points_1_and_2']['dip_db'], 10, 1)
                     + number(results['error_to_exact_db'].get(name), 12, 1))
    scene = results['scene']
    lines.append(f'{"whole scene":34s}{"seconds":>9s}{"stage 1":>11s}{"GB":>10s}'
                 f'{"error (dB)":>12s}')
    for name, found in scene['imagers'].items():
        lines.append(f'{name:34s}' + number(found['seconds']['together'], 9, 2)
                     + number(found['seconds']['stage 1'], 11, 2)
                     + number(found['peak_memory_gb'], 10, 2)
                     + number(found['error_db'], 12, 1))
    return '\n'.join(lines)


if __name__ == '__main__':
    sys.exit(main())
