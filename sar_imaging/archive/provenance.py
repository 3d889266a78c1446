# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Random pixels of a mosaic against correlation from the recordings.

Nothing of the stored images is used: every aperture whose footprint holds a pixel is correlated
there from its recording, and the mean power compared with the mosaic's.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection
from pathlib import Path

import numpy as np

from ..imaging.correlation import correlate_profiles
from .images import aperture_pulses
from .job import Job
from .scans import ApertureScan, all_scans, load_job
from .tiles import covered, stored_looks
from .windows import Window, lattice_grid, union

_BLOCK_BYTES = 2e8


@dataclasses.dataclass(frozen=True, eq=False)
class PixelCheck:
    """Some pixels of a mosaic and what correlation says of them.

    Attributes
    ----------
    row, column : (K,) int64
        Rows and columns of the map's lattice.
    power : (K,) float64
        Power of the mosaic.
    reference : (K,) float64
        Mean power of correlation over the apertures.
    looks, reference_looks : (K,) int64
        Numbers of apertures.
    """

    row: np.ndarray
    column: np.ndarray
    power: np.ndarray
    reference: np.ndarray
    looks: np.ndarray
    reference_looks: np.ndarray

    @property
    def error_db(self) -> float:
        """Error of the amplitudes, dB: ``sum (|f| - |r|)^2 / sum |r|^2`` over the pixels.

        Below that of complex values, since phases do not show.
        """
        missed = np.sqrt(self.power) - np.sqrt(self.reference)
        error, power = float(missed @ missed), float(self.reference.sum())
        return 10 * math.log10(error / power) if error > 0 and power > 0 else -math.inf


def check_mosaic(output: Path, n_pixels: int = 100, *, seed: int = 0,
                 lost: Collection[str] = ()) -> PixelCheck:
    """Compare random pixels of an archive's mosaic with exact correlation.

    Parameters
    ----------
    output : Path
        Folder of the job.
    n_pixels : int
        To compare, of those that have a look.
    seed : int
        Seed of their choice.
    lost : collection of str
        Names of apertures that the mosaic goes without.

    Returns
    -------
    PixelCheck

    Raises
    ------
    ValueError
        There is no aperture, or the mosaic has no pixel.

    Examples
    --------
    >>> from pathlib import Path
    >>> from sar_imaging.archive import check_mosaic, read_job, run_archive
    >>> with open('survey.yaml', 'w') as file:
    ...     _ = file.write('''
    ... recordings: bags/psf
    ... output: survey
    ... spacing_m: 0.5
    ... ''')
    >>> _ = run_archive(read_job('survey.yaml'), workers=1, tell=lambda text: None)
    >>> checked = check_mosaic(Path('survey'), n_pixels=10)
    >>> len(checked.power), bool(checked.error_db < -50.0)
    (10, True)
    """
    job, scans = load_job(output), [s for s in all_scans(output) if s.name not in lost]
    if not scans:
        raise ValueError(f'{output} has no aperture')
    area = union(s.window for s in all_scans(output))
    mosaic = area.on_tiles(job.tile)
    row, column, power, looks = _chosen(output, area, job, n_pixels, seed)
    total, counted = np.zeros(len(row)), np.zeros(len(row), np.int64)
    points = _points(row, column, mosaic, job)
    for scan in scans:
        counts = _covers(scan, row, column, job)
        if not counts.any():
            continue
        values = np.zeros(int(counts.sum()), np.complex128)
        pulses = aperture_pulses(scan, output)
        for block in pulses.profiles(_BLOCK_BYTES):
            values += correlate_profiles(block, points[counts],
                                         illumination=pulses.illumination)[0]
        values *= _factors(scan, output, row[counts], column[counts])
        total[counts] += np.abs(values) ** 2
        counted[counts] += values != 0  # what no pulse lights counts no look
    return PixelCheck(row, column, power, total / np.maximum(counted, 1), looks, counted)


def _factors(scan: ApertureScan, output: Path, rows: np.ndarray, columns: np.ndarray
             ) -> np.ndarray | float:
    """(K,) scale of some pixels to the brightness that the job wants."""
    scale = scan.brightness_scale(output)
    if scale is None:
        return 1.0
    pixels = (Window(row, row + 1, column, column + 1).within(scan.window)
              for row, column in zip(rows, columns, strict=True))
    return np.array([scale.factors(*pixel)[0, 0] for pixel in pixels])


def _points(row: np.ndarray, column: np.ndarray, mosaic: Window, job: Job) -> np.ndarray:
    grid = lattice_grid(mosaic, job)
    return np.ascontiguousarray(grid.positions(row - mosaic.row0, column - mosaic.column0))


def _covers(scan: ApertureScan, row: np.ndarray, column: np.ndarray, job: Job) -> np.ndarray:
    """(K,) bool which pixels an aperture counts for."""
    return scan.window.holds(row, column) & covered(scan.footprint_m, row, column, job.spacing_m)


def _chosen(output: Path, area: Window, job: Job, n_pixels: int, seed: int
            ) -> tuple[np.ndarray, ...]:
    """Numbers, power and looks of random pixels of a window that have a look."""
    power, looks = stored_looks(output, '', area.on_tiles(job.tile), job.tile)
    rng = np.random.default_rng(seed)
    tiles = [tile for tile in power.extent.tiles(job.tile) if power.has(tile)]
    if not tiles:
        raise ValueError(f'the mosaic of {output} has no pixel')
    found: list[tuple[int, int, float, int]] = []
    for _ in range(100 * n_pixels):
        if len(found) == n_pixels:
            break
        tile = tiles[rng.integers(len(tiles))]
        row, column = (int(rng.integers(max(first, least), min(last, most)))
                       for first, last, least, most in (
            (tile.row0, tile.row1, area.row0, area.row1),
            (tile.column0, tile.column1, area.column0, area.column1)))
        pixel = Window(row, row + 1, column, column + 1)
        n = int(looks.read(pixel)[0, 0])
        if n:
            found.append((row, column, float(power.read(pixel)[0, 0]), n))
    if not found:
        raise ValueError(f'the mosaic of {output} has hardly a pixel')
    return tuple(map(np.array, zip(*found, strict=True)))
