# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""SICD files to complex images.

Values of the XML are found by their place, each checked where it is read.
"""

from __future__ import annotations

import dataclasses
import datetime
import json
import math
import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...files import reading, told
from ...geometry.earth import Datum, ecef_to_geographic
from ...geometry.grids import PlaneGrid
from ...imaging.image import Image, Report
from ...imaging.radiometry import Radiometry
from ...signal.radar import SPEED_OF_LIGHT, RadarParameters
from ..acquisition import UNKNOWN, Acquisition, ImageProduct
from ..extras import require
from .container import AMPLITUDE_PHASE, DTYPES, INTEGER, SicdContainer, decoded
from .layout import turned
from .metadata import CALIBRATED, DATUM, SCALE
from .track import evaluate, stamp_of

_HIGHEST_POWER = 30  # of a polynomial; no standard product exceeds 15


class Fields:
    """Elements of a SICD of any version.

    Parameters
    ----------
    root : lxml element
        Root of the XML.
    """

    def __init__(self, root: Any) -> None:
        self._root = root

    def find(self, path: str) -> Any:
        """Element at a path such as ``'Grid/Row'``; None where there is none."""
        return self._root.find('/'.join(f'{{*}}{name}' for name in path.split('/')))

    def text(self, path: str, default: str | None = None) -> str:
        """Text at a path.

        Raises
        ------
        ValueError
            There is none, and no default.
        """
        element = self.find(path)
        text = (element.text or '').strip() if element is not None else ''
        if text:
            return text
        if default is None:
            raise ValueError(f'its XML has no {path}, which SICD prescribes')
        return default

    def number(self, path: str, default: float | None = None) -> float:
        """Finite number at a path.

        Raises
        ------
        ValueError
            There is none, and no default, or it is none.
        """
        if default is not None and self.find(path) is None:
            return default
        return _number(path, self.text(path))

    def integer(self, path: str, least: int, most: int = 2**31 - 1) -> int:
        """Whole number within bounds."""
        value = self.number(path)
        if value != round(value) or not least <= value <= most:
            raise ValueError(f'{path}={value:g}; expected a whole number of {least} to {most}')
        return int(value)

    def vector(self, path: str, axes: Sequence[str] = ('X', 'Y', 'Z')) -> np.ndarray:
        """(3,) float64 vector."""
        return np.array([self.number(f'{path}/{axis}') for axis in axes])

    def unit_vector(self, path: str) -> np.ndarray:
        """(3,) float64 vector of length one."""
        vector = self.vector(path)
        length = np.linalg.norm(vector)
        if abs(length - 1) > 1e-3:
            raise ValueError(f'{path} has the length {length:g}; expected a unit vector')
        return vector / length

    def path(self, path: str) -> np.ndarray:
        """(3, n) float64 coefficients of a polynomial for each coordinate."""
        parts = [self._polynomial(f'{path}/{axis}') for axis in 'XYZ']
        n = max(map(len, parts))
        return np.stack([np.pad(part, (0, n - len(part))) for part in parts])

    def _polynomial(self, path: str) -> np.ndarray:
        element = self.find(path)
        if element is None:
            raise ValueError(f'its XML has no {path}, which SICD prescribes')
        out = np.zeros(_HIGHEST_POWER + 1)
        for child in element:
            power = _number(f'exponent in {path}', child.get('exponent1', ''))
            if power not in range(_HIGHEST_POWER + 1):
                raise ValueError(f'{path} has a coefficient of power {power:g}; expected 0 to '
                                 f'{_HIGHEST_POWER}')
            out[int(power)] = _number(path, child.text or '')
        last = np.flatnonzero(out)
        return out[:last[-1] + 1] if len(last) else out[:1]

    def date(self, path: str) -> datetime.datetime:
        """Date and time, UTC; digits beyond the microsecond are left out."""
        text = self.text(path).removesuffix('Z')
        whole, _, fraction = text.partition('.')
        try:
            date = datetime.datetime.fromisoformat(f'{whole}.{fraction[:6]:0<6}')
        except ValueError:
            raise ValueError(f'{path}={text!r}; expected a date such as '
                             '2026-01-31T12:00:00.000000Z') from None
        return date.replace(tzinfo=datetime.timezone.utc)

    def parameter(self, name: str) -> str | None:
        """Text of a parameter of the collection; None where there is none of this name."""
        for element in self._root.findall('{*}CollectionInfo/{*}Parameter'):
            if element.get('name') == name:
                return element.text
        return None

    def table(self, path: str) -> np.ndarray | None:
        """(256,) float64 amplitudes by their index; None where there is no such table."""
        element = self.find(path)
        if element is None:
            return None
        out = np.full(256, np.nan)
        for child in element:
            index = _number(f'index in {path}', child.get('index', ''))
            if index in range(256):
                out[int(index)] = _number(path, child.text or '')
        if np.isnan(out).any():
            raise ValueError(f'{path} has {np.isnan(out).sum()} gaps; expected 256 amplitudes')
        return out


def _number(path: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError(f'{path}={text[:40]!r}; expected a number') from None
    if not math.isfinite(value):
        raise ValueError(f'{path}={text[:40]}; expected a finite number')
    return value


_EXACT = 1e-9  # of a quarter turn
_MOST_PULSES = 4096  # at which a polynomial of the track is evaluated
_ORTHOGONAL = 1e-3
_BLOCK_ROWS = 256


def read_sicd(path: os.PathLike[str] | str) -> ImageProduct:
    """Read the image of a SICD file of any version, 0.4 to 1.5.

    The carrier that SICD takes out is put back, so that the image is one like ours: exactly
    where it turns by whole quarters from pixel to pixel, as in files of `write_sicd`.

    Pixels are placed on the image plane of the file. In files of the grid type PLANE they are
    there; those of others (RGAZIM, RGZERO, ...) lie where the image projection of SICD puts them
    (``sarkit.sicd.image_to_ground_plane``), which is on that plane at the scene centre point only.

    Parameters
    ----------
    path : path
        NITF file.

    Returns
    -------
    ImageProduct
        Image on a `PlaneGrid`, its datum (that of the writer, or the scene centre point with the
        axes east, north and up), and the acquisition: pulses at even times on the polynomial of
        the track, as many as the file tells of, at most 4096.

    Raises
    ------
    FileNotFoundError
        There is no such file.
    ValueError
        The file is no SICD, is damaged or cut off, or stores its pixels compressed.
    MissingExtraError
        sarkit is not installed.

    Examples
    --------
    >>> from sar_imaging import plan_image
    >>> from sar_imaging.formats import Acquisition, read_sicd, sicd_grid, write_sicd
    >>> from sar_imaging.geometry import Datum
    >>> from sar_imaging.recordings import read_blocks
    >>> block = next(read_blocks('bags/spotlight'))
    >>> acquisition = Acquisition.of(block)
    >>> grid = sicd_grid(acquisition, (0.0, 0.0, 0.0), 8.0, 8.0)
    >>> image = plan_image(grid, block.radar, block.n_samples, compressed=False)(block)
    >>> write_sicd('image.nitf', image, Datum(47.0, 8.0, 450.0), acquisition)
    >>> back = read_sicd('image.nitf')
    >>> back.image.shape == image.shape, bool((back.image.samples == image.samples).all())
    (True, True)
    >>> back.datum
    Datum(latitude_deg=47.0, longitude_deg=8.0, height_m=450.0, heading_deg=0.0)
    """
    require('sarkit.sicd', 'reading SICD')
    with reading(path, 'SICD'), open(path, 'rb') as file:
        container = SicdContainer(file)
        return _product(container, Fields(container.root))


def _product(container: SicdContainer, fields: Fields) -> ImageProduct:
    shape = (fields.integer('ImageData/NumRows', 1), fields.integer('ImageData/NumCols', 1))
    pixel_type = fields.text('ImageData/PixelType')
    if pixel_type not in DTYPES:
        raise ValueError(f'ImageData/PixelType={pixel_type!r}; expected one of '
                         f'{", ".join(DTYPES)}')
    container.check(shape, pixel_type)  # before anything has this shape
    datum = _datum(fields)
    acquisition = _acquisition(fields, datum)
    grid, turns = _grid(fields, datum, shape)
    table = fields.table('ImageData/AmpTable') if pixel_type == AMPLITUDE_PHASE else None
    scale = _scale(fields) if pixel_type == INTEGER else 1.0
    samples = decoded(container.read(shape, pixel_type), table, scale)
    signs = [fields.integer(f'Grid/{axis}/Sgn', -1, 1) for axis in ('Row', 'Col')]
    if signs not in ([-1, -1], [1, 1]):
        raise ValueError(f'Grid/Row/Sgn={signs[0]}, Grid/Col/Sgn={signs[1]}; expected -1 of both, '
                         'or +1')
    if signs[0] > 0:
        samples = samples.conj()
    _put_back_carrier(samples, turns)
    report = Report('SICD', f'{fields.text("ImageFormation/ImageFormAlgo", "of a file")}, '
                    f'grid {fields.text("Grid/Type", "PLANE")}', math.nan)
    middle = int(acquisition.stamp_ns[acquisition.n_pulses // 2])
    image = Image(samples, grid, acquisition.radar.carrier_hz, report, middle,
                  radiometry=_radiometry(fields))
    return ImageProduct(image, datum, acquisition)


def _radiometry(fields: Fields) -> Radiometry | None:
    """What the squared magnitude is, where our writer told."""
    text = fields.parameter(CALIBRATED)
    try:
        return None if text is None else Radiometry(**json.loads(text))
    except TypeError as error:
        raise ValueError(f'parameter {CALIBRATED!r} is damaged: {told(error)}') from None


def _datum(fields: Fields) -> Datum:
    if (model := fields.text('GeoData/EarthModel', 'WGS_84')) != 'WGS_84':
        raise ValueError(f'GeoData/EarthModel={model}; expected WGS_84')
    place = fields.vector('GeoData/SCP/ECF')
    try:
        there = Datum(*(float(part) for part in ecef_to_geographic(place)))
    except ValueError as error:
        raise ValueError(f'GeoData/SCP is no place near the Earth: {error}') from None
    text = fields.parameter(DATUM)
    if text is not None:
        try:
            return Datum(**json.loads(text))
        except TypeError as error:
            raise ValueError(f'parameter {DATUM!r} is damaged: {told(error)}') from None
    return there


def _scale(fields: Fields) -> float:
    told = fields.parameter(SCALE)
    scale = 1.0 if told is None else float(told)
    if not (math.isfinite(scale) and scale > 0):
        raise ValueError(f'parameter {SCALE!r} is {told}; expected a positive number')
    return scale


def _grid(fields: Fields, datum: Datum, shape: tuple[int, ...]
          ) -> tuple[PlaneGrid, list[np.ndarray]]:
    """Grid, and the turns of the carrier at each row and each column."""
    steps, turns, scp_index = [], [], []
    for name, n in zip(('Row', 'Col'), shape, strict=True):
        spacing = fields.number(f'Grid/{name}/SS')
        if not 0 < spacing < 1e6:
            raise ValueError(f'Grid/{name}/SS={spacing:g}; expected metres between pixels')
        middle = (fields.integer(f'ImageData/SCPPixel/{name}', -2**31)
                  - fields.integer(f'ImageData/First{name}', -2**31))
        steps.append(spacing * datum.vectors_from_ecef(
            fields.unit_vector(f'Grid/{name}/UVectECF')))
        scp_index.append(middle)
        quarters = 4 * fields.number(f'Grid/{name}/KCtr') * spacing
        if abs(quarters - round(quarters)) < _EXACT:
            quarters = round(quarters)
        turns.append(quarters * (np.arange(n) - middle))
    cosine = steps[0] @ steps[1] / (np.linalg.norm(steps[0]) * np.linalg.norm(steps[1]))
    if abs(cosine) > _ORTHOGONAL:
        raise ValueError(f'its rows and columns have the cosine {cosine:g}; expected 0')
    scp = datum.from_ecef(fields.vector('GeoData/SCP/ECF'))
    origin = scp - scp_index[0] * steps[0] - scp_index[1] * steps[1]
    return PlaneGrid(tuple(origin), tuple(steps[1]), tuple(steps[0]), shape[1], shape[0]), turns


def _put_back_carrier(samples: np.ndarray, turns: list[np.ndarray]) -> None:
    """Multiply by ``exp(+j pi/2 turns)`` along both axes, in place; whole quarters lose no bit."""
    for axis, quarters in enumerate(turns):
        if quarters.dtype.kind == 'i':
            for turn in range(1, 4):
                index = (slice(None),) * axis + (quarters % 4 == turn,)
                samples[index] = turned(samples[index], -turn % 4)
            continue
        phasors = np.exp(0.5j * np.pi * np.remainder(quarters, 4.0))
        for first in range(0, len(samples), _BLOCK_ROWS):
            rows = slice(first, first + _BLOCK_ROWS)
            samples[rows] *= phasors if axis else phasors[rows, None]


def _acquisition(fields: Fields, datum: Datum) -> Acquisition:
    radar = _radar(fields)
    start = fields.date('Timeline/CollectStart')
    first, last = _pulse_times(fields)
    times = np.linspace(first, last, _n_pulses(fields))
    scene = fields.vector('GeoData/SCP/ECF')
    arp = fields.path('Position/ARPPoly')
    tx, rx = arp, arp
    if fields.text('CollectionInfo/CollectType', 'MONOSTATIC') == 'BISTATIC':
        tx, rx = fields.path('Position/TxAPCPoly'), fields.path('Position/RcvAPC/RcvAPCPoly')
        tx_m = evaluate(tx, times)
        scene_s = times + _delay(tx_m, scene)
        rx_m = evaluate(rx, scene_s + _delay(evaluate(rx, scene_s), scene))
    else:
        tx_m = rx_m = evaluate(arp, times + _delay(evaluate(arp, times), scene))
    polarisation = fields.text('ImageFormation/TxRcvPolarizationProc', UNKNOWN)
    found = Acquisition(radar, stamp_of(start, times), datum.from_ecef(tx_m),
                        datum.from_ecef(rx_m),
                        collector=fields.text('CollectionInfo/CollectorName', UNKNOWN),
                        illuminator=fields.text('CollectionInfo/IlluminatorName', ''),
                        name=fields.text('CollectionInfo/CoreName', ''))
    try:
        return dataclasses.replace(found, polarisation=polarisation)
    except ValueError:  # one that only its writer knows
        return found


def _delay(places: Any, scene: np.ndarray) -> np.ndarray:
    return np.linalg.norm(places - scene, axis=-1) / SPEED_OF_LIGHT


def _pulse_times(fields: Fields) -> tuple[float, float]:
    """Times of the first pulse and of the last, seconds since the start of the collection."""
    first = fields.number('ImageFormation/TStartProc')
    end = fields.number('ImageFormation/TEndProc')
    if not 0 < end - first < 86400:
        raise ValueError(f'the image was formed of {first:g} s to {end:g} s; expected an interval '
                         'of less than a day')
    n = _n_pulses(fields)
    return first, end - (end - first) / n


def _n_pulses(fields: Fields) -> int:
    path = 'Timeline/IPP/Set/IPP'
    if fields.find(f'{path}Start') is None or fields.find(f'{path}End') is None:
        return _MOST_PULSES // 8
    n = fields.number(f'{path}End') - fields.number(f'{path}Start') + 1
    return int(min(max(n, 2), _MOST_PULSES))


def _radar(fields: Fields) -> RadarParameters:
    low = fields.number('ImageFormation/TxFrequencyProc/MinProc')
    high = fields.number('ImageFormation/TxFrequencyProc/MaxProc')
    carrier, bandwidth = 0.5 * (low + high), high - low
    if fields.find('RadarCollection/RefFreqIndex') is not None:  # relative to what is not told
        carrier = fields.number('Grid/Row/KCtr') * SPEED_OF_LIGHT / 2
    return RadarParameters(carrier, bandwidth, bandwidth, 0.0)
