"""FastSAR in a plain `dask.bag` over the recordings of an archive: images alone.

A bag of two lines, as a user of FastSAR would write it: recordings mapped to images, on processes.
"""

from __future__ import annotations

import dataclasses
import pathlib
import time

import numpy as np

from sar_imaging.geometry import MapGrid
from sar_imaging.quality.verification import measure_error
from sar_imaging.signal.radar import Waveform
from sar_imaging.signal.spectra import band_spectrum
from sar_imaging.tools.products.sources import open_source


def image_in_bag(folder: pathlib.Path, n_recordings: int, spacing_m: float,
                 workers: int) -> dict:
    """Image some recordings; time, throughput, and the error of one image.

    Parameters
    ----------
    folder : Path
        Of the archive.
    n_recordings : int
        To image, the first ones.
    spacing_m : float
        Of the pixels, metres.
    workers : int
        Processes.
    """
    import dask.bag

    paths = sorted(str(p) for p in folder.iterdir() if p.is_dir())[:n_recordings]
    start = time.perf_counter()
    found = dask.bag.from_sequence(paths, npartitions=len(paths)).map(
        _image, spacing_m).compute(scheduler='processes', num_workers=workers)
    seconds = time.perf_counter() - start
    work = sum(one['pixel_pulses'] for one in found)
    return {'recordings': len(found), 'seconds': round(seconds, 1),
            'gigapixel_pulses_per_s': round(work / seconds / 1e9, 2),
            'measured_error_db': [round(one['measured_error_db'], 1) for one in found],
            'predicted_error_db': [round(one['predicted_error_db'], 1) for one in found]}


def _image(path: str, spacing_m: float) -> dict:
    """Form the image of a recording and say how good it is."""
    import numba

    from . import fastsar_imagers

    numba.set_num_threads(1)
    source = open_source(path)
    [block] = source.read(1e12)
    size = np.ptp(source.area_m, axis=0)
    grid = MapGrid.from_size((0.0, 0.0, 0.0), size[0], size[1], spacing_m)
    form, predicted = fastsar_imagers.factorised(_history(block), grid)
    image = form()
    measured = measure_error(np.ascontiguousarray(image), grid, block, n_pixels=30,
                             n_brightest=30, fit_scale=True).error_db
    return {'pixel_pulses': image.size * block.n_pulses, 'measured_error_db': measured,
            'predicted_error_db': predicted}


def _history(block):
    """The profiles' band as the phase history of a stepped-frequency radar."""
    frequencies, spectra = band_spectrum(block)
    radar, n = block.radar, len(frequencies)
    step = frequencies[1] - frequencies[0]
    middle_s = radar.first_sample_delay_s + 0.5 * block.n_samples / radar.sample_rate_hz
    samples = spectra * np.exp(2j * np.pi * frequencies * middle_s)
    own = dataclasses.replace(
        radar, carrier_hz=float(frequencies.mean()), bandwidth_hz=n * step,
        sample_rate_hz=n * step, first_sample_delay_s=middle_s,
        waveform=Waveform.STEPPED_FREQUENCY)
    return dataclasses.replace(block, radar=own, compressed=False, samples=samples)
