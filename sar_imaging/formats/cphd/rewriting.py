"""Changed samples back into a copy of the file they were read from, everything else unchanged."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ...signal.pulses import PulseBlock
from .errors import CphdError
from .reader import CphdReader


def rewrite_cphd(path: Path | str, reader: CphdReader, blocks: Iterable[PulseBlock], *,
                 overwrite: bool = False) -> None:
    """Write a copy of a CPHD file with other samples.

    For pulses that were filtered or corrected: metadata and parameters of the vectors, domain,
    SGN, AmpSF and type of the samples stay as they are. So do pulses of which no block comes.
    Samples that were not changed are equal to the bit if they are integers, or if their phase did
    not have to be turned (the reference point is equally far away from all phase centres);
    otherwise to the rounding of float32.

    Parameters
    ----------
    path : path
        File to make.
    reader : CphdReader
        Where the blocks come from.
    blocks : iterable of PulseBlock
        As ``reader.blocks()`` gives them, with other samples; found by their counters.
    overwrite : bool
        Replace an existing file.

    Raises
    ------
    CphdError
        The blocks are not of this file, they were resampled when they were read, or the target
        exists.

    Examples
    --------
    >>> import dataclasses
    >>> from sar_imaging import MapGrid
    >>> from sar_imaging.formats.cphd import CphdReader, rewrite_cphd, write_cphd
    >>> from sar_imaging.geometry import Datum
    >>> from sar_imaging.simulation import SCENARIOS
    >>> area = MapGrid((10_000.0, 0.0, 0.0), 40, 40, 0.5)
    >>> _ = write_cphd('scene.cphd', SCENARIOS['psf']().blocks(), Datum(47.0, 8.0), area,
    ...                overwrite=True)
    >>> with CphdReader('scene.cphd') as reader:
    ...     louder = [dataclasses.replace(b, samples=2 * b.samples) for b in reader.blocks()]
    ...     rewrite_cphd('louder.cphd', reader, louder)
    >>> with CphdReader('louder.cphd') as reader:
    ...     peak = max(abs(block.samples).max() for block in reader.blocks())
    >>> print(f'{peak:.2f}')
    2.00
    """
    path = Path(path).resolve()
    if path.is_dir() or (path.exists() and not overwrite):
        raise CphdError(f'{path} exists already; choose another file, or replace it on purpose')
    if path == reader.container.path.resolve():
        raise CphdError(f'{path} is the file that is read; choose another')
    with tempfile.TemporaryDirectory(prefix=f'.{path.name}.', dir=path.parent) as folder:
        partial = Path(folder) / path.name
        shutil.copyfile(reader.container.path, partial)
        with open(partial, 'r+b') as file:
            for block in blocks:
                for number, name in enumerate(reader.channels):
                    for vector, samples in reader.encoded(block, number):
                        file.seek(reader.container.signal_bytes(name, vector))
                        file.write(np.ascontiguousarray(samples).tobytes())
        partial.replace(path)
