"""What is to be made of an archive: `Job`."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from pathlib import Path

from sar_imaging.geometry.earth import Datum
from sar_imaging.radiometry import RadarConstant

IMAGE_FORMATS = ('geotiff', 'sicd')
SURFACES = ('plane', 'ellipsoid')
#: Fields that say how and where a job is done, and change no bit of what it makes.
_NOT_IN_BITS = ('output', 'recordings', 'retries', 'datum_from')


class JobError(ValueError):
    """A job file is wrong: the text names key and line, what was expected, what came, a remedy."""


@dataclasses.dataclass(frozen=True)
class Products:
    """What is made beside the images of the apertures.

    Attributes
    ----------
    images : tuple of str
        Files of every aperture image: ``'geotiff'``, ``'sicd'``.
    strips : bool
        Mean power of the apertures of each recording.
    mosaic : bool
        Mean power of all apertures, and their number at each pixel.
    coherence_window : int or None
        Sides of the window of coherence between passes over the same pixels, pixels; None for no
        coherence.
    """

    images: tuple[str, ...] = ()
    strips: bool = False
    mosaic: bool = True
    coherence_window: int | None = None


@dataclasses.dataclass(frozen=True)
class Brightness:
    """What the squared magnitude of images is, and the radar constant that makes it so.

    Attributes
    ----------
    quantity : str
        One of `sar_imaging.radiometry.QUANTITIES`.
    gain_m : float
        Of the radar constant, metres times the unit of the samples.
    noise_power : float or None
        Of a sample of a range profile; None if not known.
    window : str
        Spectral window of range profiles in recordings; raw pulses are compressed without one.
    """

    quantity: str
    gain_m: float
    noise_power: float | None = None
    window: str = 'none'

    @property
    def constant(self) -> RadarConstant:
        """The radar constant."""
        return RadarConstant(self.gain_m,
                             math.nan if self.noise_power is None else self.noise_power)


@dataclasses.dataclass(frozen=True)
class Job:
    """A job, complete: paths absolute, defaults filled in.

    Attributes
    ----------
    recordings : tuple of str
        Folders, files, globs or STAC catalogues of recordings.
    output : Path
        Folder of the results.
    spacing_m : float
        Of the map's pixels, metres.
    datum : Datum or None
        Of the map's frame; None until the first recording tells it, and where none does.
    area_m : (4,) floats or None
        Smallest x and y, largest x and y of the map, metres of its frame; None for all that the
        recordings tell.
    height_m : float
        Of the map's surface above the plane or ellipsoid through the frame's origin, metres.
    surface : str
        ``'plane'`` or ``'ellipsoid'``, which pixels lie on.
    crs : str or None
        Projection of GeoTIFF files, such as ``'EPSG:32632'``; None for what `write_geotiff`
        chooses.
    method : str
        Of `plan_image`.
    target_db : float
        Wanted error of aperture images against time-domain correlation, dB.
    products : Products
        What is made beside them.
    tile : int
        Sides of tiles of the map, pixels; chunks of all arrays are tiles.
    memory_bytes : float
        That one worker may take.
    longest_piece_s : float
        Predicted seconds that a piece may take on one core.
    checked_pixels : int
        Of each aperture image, compared with correlation; 0 for none.
    retries : int
        How often a piece is tried again after its worker died.
    datum_from : str
        Name of the recording that told the datum; empty where the job did, or none did.
    radiometry : Brightness or None
        Calibrated brightness of all images; None where they stay as they are formed.
    """

    recordings: tuple[str, ...]
    output: Path
    spacing_m: float
    datum: Datum | None = None
    area_m: tuple[float, float, float, float] | None = None
    height_m: float = 0.0
    surface: str = 'plane'
    crs: str | None = None
    method: str = 'auto'
    target_db: float = -60.0
    products: Products = Products()
    tile: int = 2048
    memory_bytes: float = 2e9
    longest_piece_s: float = 600.0
    checked_pixels: int = 20
    retries: int = 3
    datum_from: str = ''
    radiometry: Brightness | None = None

    def deciding(self) -> dict:
        """What decides the bits of the results, as JSON holds it."""
        fields = dataclasses.asdict(self)
        if self.radiometry is None:  # as of jobs that knew of none
            del fields['radiometry']
        return {name: value for name, value in fields.items() if name not in _NOT_IN_BITS}

    def digest(self) -> str:
        """SHA-256 of what decides the bits of the results."""
        text = json.dumps(self.deciding(), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()
