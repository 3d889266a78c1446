# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The last image of a node as a file that knows where on the Earth it is, when asked for."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sar_imaging.formats import Acquisition, write_geotiff, write_quicklook, write_sicd
from sar_imaging.formats.geotiff import COMPLEX, DECIBELS
from sar_imaging.geometry.earth import Datum
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.imaging.image import Image

from ..poses.frame_datum import FrameDatum
from ..runtime.parameters import ANY_TIME, Parameter, one_of
from ..runtime.saving import SAVE_FOLDER, file_stem

GEOTIFF, GEOTIFF_COMPLEX, SICD, PNG = FORMATS = ('geotiff', 'geotiff_complex', 'sicd', 'png')
_CONTENT = {GEOTIFF: DECIBELS, GEOTIFF_COMPLEX: COMPLEX}
PARAMETERS = (
    SAVE_FOLDER,
    Parameter('save.format', GEOTIFF, 'What ~/save_image writes: geotiff (amplitude in dB), '
              'geotiff_complex, sicd, or png (with world file and KML).',
              check=one_of(*FORMATS), changes=ANY_TIME),
)


class ImageFiles:
    """Keeps the last image, while `save.folder` is set, and writes it.

    Parameters
    ----------
    parameters : mapping
        Current values of `PARAMETERS`.
    datum : FrameDatum
        Datum of the images' frame.
    """

    def __init__(self, parameters: Mapping[str, Any], datum: FrameDatum):
        self._parameters, self._datum = parameters, datum
        self._latest: tuple[Image, Callable[[], Acquisition],
                            Callable[[], dict[str, Any]]] | None = None

    @property
    def wanted(self) -> bool:
        """Whether images are kept."""
        return bool(self._parameters[SAVE_FOLDER.name])

    def keep(self, image: Image, acquisition: Callable[[], Acquisition],
             factors: Callable[[], dict[str, object]] = dict) -> None:
        """Keep an image in the place of the last one.

        Parameters
        ----------
        image : Image
            Its samples are kept as they are until another one comes.
        acquisition : callable
            Returns that of the image, or raises ValueError where it is not known.
        factors : callable
            Returns what SICD takes for scale factors; nothing where they are not known.
        """
        self._latest = (image, acquisition, factors) if self.wanted else None

    def saving(self, strip: Callable[[], tuple[np.ndarray, MapGrid]] | None = None
               ) -> Callable[[], str]:
        """Function that writes the last image and says what it wrote; for any thread.

        Parameters
        ----------
        strip : callable, optional
            Returns samples and grid of a strip to be written as well.

        Raises
        ------
        ValueError
            There is nothing to write, nowhere to write it, or nobody knows where it is.
        """
        if not self.wanted:
            raise ValueError(f'parameter {SAVE_FOLDER.name} is empty: set the folder for images; '
                             'those formed from then on can be saved')
        if self._latest is None:
            raise ValueError(f'no image was formed since {SAVE_FOLDER.name} was set')
        if self._datum.value is None:
            raise ValueError(self._datum.reason)
        image, acquisition, factors = self._latest
        kind = self._parameters['save.format']
        # Copied: the next image may be formed in the same memory.
        image = dataclasses.replace(image, samples=image.samples.copy())
        write = functools.partial(_write, kind=kind, datum=self._datum.value,
                                  folder=Path(self._parameters[SAVE_FOLDER.name]),
                                  acquisition=acquisition() if kind == SICD else None,
                                  factors=factors() if kind == SICD else {})
        try:
            samples, grid = strip() if strip is not None else (None, None)
        except ValueError:
            samples = None  # no image of a whole aperture yet
        if samples is None:
            return functools.partial(write, image, 'image')
        joined = dataclasses.replace(image, samples=samples, grid=grid)
        return lambda: f'{write(image, "image")}; {write(joined, "strip")}'


def _write(image: Image, name: str, *, kind: str, datum: Datum, folder: Path,
           acquisition: Acquisition | None, factors: Mapping[str, Any]) -> str:
    """Write a file, complete or not at all; returns what was written."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = folder / f'{name}_{file_stem(image.stamp_ns)}'
    if kind == PNG:
        return f'wrote {write_quicklook(stem.with_name(f"{stem.name}.png"), image, datum)[0]}'
    if acquisition is None:
        path = stem.with_name(f'{stem.name}.tif')
        place = write_geotiff(path, image, datum, content=_CONTENT[kind])
        return f'wrote {path}, {place.crs.name}'
    path = stem.with_name(f'{stem.name}.nitf')
    write_sicd(path, image, datum, acquisition, **factors)
    return f'wrote {path}'
