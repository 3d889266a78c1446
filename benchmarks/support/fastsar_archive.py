# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""FastSAR in a plain `dask.bag` over the recordings of an archive: images alone.

A bag of one line, as a user of FastSAR would write it: recordings mapped to images, on processes.
"""

from __future__ import annotations

import dataclasses
import os
import pathlib

import numpy as np

from sar_imaging.geometry import MapGrid
from sar_imaging.quality.verification import measure_error
from sar_imaging.recordings import open_pulses
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import Waveform
from sar_imaging.signal.spectra import band_spectrum

from . import fastsar_imagers

KINDS = ('exact', 'factorised')


def image_in_bag(paths: list[str], output: pathlib.Path, spacing_m: float, workers: int,
                 kind: str) -> None:
    """Image recordings, images kept in files.

    Parameters
    ----------
    paths : list of str
        Recordings.
    output : Path
        Folder of the images.
    spacing_m : float
        Of the pixels, metres.
    workers : int
        Processes, of one thread each.
    kind : str
        ``'exact'``, with cubic interpolation of profiles, or ``'factorised'``.
    """
    import dask.bag

    os.environ['OMP_NUM_THREADS'] = os.environ['NUMBA_NUM_THREADS'] = '1'  # of the processes
    dask.bag.from_sequence(paths, npartitions=len(paths)).map(
        _keep, output, spacing_m, kind).compute(scheduler='processes', num_workers=workers)


def error_db(path: str, spacing_m: float, kind: str) -> float:
    """Error of an image against correlation, dB, after the best common factor."""
    block, grid = _read(path, spacing_m)
    return measure_error(np.ascontiguousarray(_image(block, grid, kind)), grid, block,
                         n_pixels=30, n_brightest=30, fit_scale=True).error_db


def _keep(path: str, output: pathlib.Path, spacing_m: float, kind: str) -> None:
    np.save(output / f'{pathlib.Path(path).name}.npy', _image(*_read(path, spacing_m), kind))


def _read(path: str, spacing_m: float) -> tuple[PulseBlock, MapGrid]:
    """Pulses, and pixels that FastSAR can have: its origin lies half a pixel off their middle."""
    source = open_pulses(path)
    [block] = source.blocks(1e12)
    side = 2 * round(float(np.ptp(source.area_m, axis=0)[0]) / spacing_m / 2)
    return block, MapGrid((-spacing_m / 2, -spacing_m / 2, 0.0), side, side, spacing_m)


def _image(block: PulseBlock, grid: MapGrid, kind: str) -> np.ndarray:
    history = phase_history(block)
    if kind == 'exact':
        return fastsar_imagers.exact(history, grid, 'cubic')()
    form, _ = fastsar_imagers.factorised(history, grid)
    return form()


def phase_history(block: PulseBlock) -> PulseBlock:
    """The band of range profiles as the phase history of a stepped-frequency radar."""
    frequencies, spectra = band_spectrum(block)
    radar, n = block.radar, len(frequencies)
    step = frequencies[1] - frequencies[0]
    middle_s = radar.first_sample_delay_s + 0.5 * block.n_samples / radar.sample_rate_hz
    samples = (spectra * np.exp(2j * np.pi * frequencies * middle_s)).astype(np.complex64)
    own = dataclasses.replace(
        radar, carrier_hz=float(frequencies.mean()), bandwidth_hz=n * step,
        sample_rate_hz=n * step, first_sample_delay_s=middle_s,
        waveform=Waveform.STEPPED_FREQUENCY)
    return dataclasses.replace(block, radar=own, compressed=False, samples=samples)
