"""Job files: `read_job` checks every key, and says what to change in one line."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

from sar_imaging.backends import AUTO
from sar_imaging.formats import MissingExtraError, require
from sar_imaging.geometry.earth import Datum
from sar_imaging.imaging.methods import METHODS
from sar_imaging.radiometry import QUANTITIES, RadarConstant
from sar_imaging.signal.windows import parse_window

from .job import IMAGE_FORMATS, SURFACES, Brightness, Job, JobError, Products
from .yaml_lines import Value, read_yaml

#: Keys of a job file, and an example of each.
KEYS = {
    'recordings': 'flights/*', 'output': 'survey', 'spacing_m': '0.25',
    'datum': '{latitude_deg: 47.3, longitude_deg: 8.5, height_m: 430.0}',
    'area_m': '[-500.0, -200.0, 500.0, 3000.0]', 'height_m': '0.0', 'surface': 'plane',
    'crs': 'EPSG:32632', 'method': 'auto', 'target_db': '-60.0',
    'radiometry': '{quantity: sigma0, constant_file: radar.yaml}',
    'products': '{mosaic: true, strips: true}', 'tile': '2048', 'memory_gb': '2.0',
    'longest_piece_s': '600', 'checked_pixels': '20', 'retries': '3'}
NEEDED = ('recordings', 'output', 'spacing_m')
PRODUCTS = {'images': '[geotiff]', 'strips': 'true', 'mosaic': 'true', 'coherence_window': '7'}
RADIOMETRY = {'quantity': 'sigma0', 'constant_file': 'radar.yaml', 'window': 'none'}
_DATUM = {'latitude_deg': '47.3', 'longitude_deg': '8.5', 'height_m': '430.0',
          'heading_deg': '0.0'}
LEAST_GB = 0.6  # a worker takes half of it before it begins
_MOST_PIXELS = 1e12


def read_job(path: Path | str) -> Job:
    """Read the job file of an archive.

    Relative paths in it start at its folder.

    Parameters
    ----------
    path : path
        YAML, as docs/archives.md describes it.

    Returns
    -------
    Job

    Raises
    ------
    JobError
        It is no job; one line says where, what was expected, what came and what to do.

    Examples
    --------
    >>> from sar_imaging.tools.archive.jobs import read_job
    >>> with open('survey.yaml', 'w') as file:
    ...     _ = file.write('''
    ... recordings: bags/psf
    ... output: survey
    ... spacing_m: 0.5
    ... ''')
    >>> job = read_job('survey.yaml')
    >>> job.spacing_m, job.method, job.products.mosaic
    (0.5, 'auto', True)
    """
    path = Path(path)
    whole = read_yaml(path)
    given = whole.mapping(KEYS, 'write lines of "key: value"') if whole.said == 'a mapping' else {}
    if not given:
        raise JobError(f'{path} is {whole.said}; expected lines of "key: value"; write at least '
                       f'the lines {", ".join(f"{name}: {KEYS[name]}" for name in NEEDED)}')
    for name in NEEDED:
        if name not in given:
            raise JobError(f'{path} has no {name}, which every job needs; add the line '
                           f'{name}: {KEYS[name]}')
    fields = {name: _READERS[name](value) for name, value in given.items()}
    if 'memory_gb' in fields:
        fields['memory_bytes'] = 1e9 * fields.pop('memory_gb')
    base = path.absolute().parent
    try:
        fields['recordings'] = tuple(str(base / Path(text).expanduser())
                                     for text in fields['recordings'])
        fields['output'] = base / Path(fields['output']).expanduser()
    except RuntimeError as error:  # ~ of a user that there is not
        raise JobError(f'{path} has a path that begins with ~: {error}; write the path without '
                       '~') from error
    job = Job(**fields)
    _check_together(job, given)
    return job


def changed(job: Job, **options) -> Job:
    """The job with options of the command line in place of its own; None changes nothing.

    Raises
    ------
    JobError
        A value is out of range.
    """
    given = {name: value for name, value in options.items() if value is not None}
    if given.get('memory_bytes', 1e9 * LEAST_GB) < 1e9 * LEAST_GB:
        raise JobError(f'--memory {given["memory_bytes"] / 1e9:g} GB; a worker needs at least '
                       f'{LEAST_GB:g} GB; allow more')
    return dataclasses.replace(job, **given)


def _check_together(job: Job, given: dict[str, Value]) -> None:
    """What is right alone and wrong with something else."""
    if job.area_m is not None:
        x0, y0, x1, y1 = job.area_m
        pixels = (x1 - x0) * (y1 - y0) / job.spacing_m**2
        if pixels > _MOST_PIXELS:
            raise given['area_m'].error(
                f'at most {_MOST_PIXELS:g} pixels, and this has {pixels:.2g}',
                'choose a smaller area_m or a larger spacing_m; both are metres')
    if job.surface == 'ellipsoid' and 'sicd' in job.products.images:
        raise given['surface'].error(
            'plane, for products.images asks for sicd and SICD images lie on planes',
            'write surface: plane, or remove sicd')


def _recordings(value: Value) -> tuple[str, ...]:
    expected = 'a folder, a glob, a STAC catalogue or a list of those'
    remedy = 'write for instance recordings: flights/*'
    if value.said.startswith('a list'):
        texts = tuple(item.text(expected, remedy) for item in value.items(expected, remedy))
        if not texts:
            raise value.error(expected, remedy)
        return texts
    return (value.text(expected, remedy),)


def _output(value: Value) -> str:
    return value.text('a folder for the results', 'write for instance output: survey')


def _datum(value: Value) -> Datum:
    remedy = f'write datum: {KEYS["datum"]}'
    given = value.mapping(_DATUM, remedy, needed=('latitude_deg', 'longitude_deg'),
                          what='a place')
    ranges = {'latitude_deg': (-90, 90, 'degrees'), 'longitude_deg': (-180, 360, 'degrees'),
              'height_m': (-12_000, 1e7, 'metres above the ellipsoid'),
              'heading_deg': (-360, 360, 'degrees')}
    return Datum(**{name: part.number(*ranges[name], _DATUM[name])
                    for name, part in given.items()})


def _area(value: Value) -> tuple[float, ...]:
    expected = 'four numbers, the smallest x and y and the largest x and y, metres'
    remedy = f'write for instance area_m: {KEYS["area_m"]}'
    corners = tuple(item.number(-1e8, 1e8, 'metres', '100.0')
                    for item in value.items(expected, remedy))
    if len(corners) != 4:
        raise value.error(expected, remedy)
    if corners[0] >= corners[2] or corners[1] >= corners[3]:
        raise JobError(f'{value.path}, line {value.line}: area_m begins at ({corners[0]:g}, '
                       f'{corners[1]:g}) m and ends at ({corners[2]:g}, {corners[3]:g}) m; '
                       'expected the smallest x and y first; exchange the numbers')
    return corners


def _radiometry(value: Value) -> Brightness:
    remedy = f'write radiometry: {KEYS["radiometry"]}'
    given = value.mapping(RADIOMETRY, remedy, needed=('quantity', 'constant_file'))
    quantity = given['quantity'].choice(tuple(QUANTITIES))
    file = given['constant_file']
    written = file.text('the file of a radar constant', 'write constant_file: radar.yaml')
    try:
        constant = RadarConstant.load(value.path.absolute().parent / Path(written).expanduser())
    except (ValueError, RuntimeError) as error:
        raise JobError(f'{value.path}, line {file.line}: {file.key}: '
                       f'{" ".join(str(error).split())}') from error
    noise = constant.noise_power
    return Brightness(quantity, constant.gain, noise if math.isfinite(noise) else None,
                      _window(given['window']) if 'window' in given else 'none')


def _window(value: Value) -> str:
    remedy = 'write for instance window: none'
    text = value.text('the window of the range profiles', remedy)
    try:
        parse_window(text)
    except ValueError as error:
        raise JobError(f'{value.path}, line {value.line}: {value.key}: {error}') from error
    return text


def _crs(value: Value) -> str:
    expected, remedy = 'a map projection that PROJ knows', f'write for instance crs: {KEYS["crs"]}'
    text = value.text(expected, remedy)
    if text == 'local':
        return text
    text = f'EPSG:{text}' if text.isdecimal() else text
    try:
        pyproj = require('pyproj', 'a map projection', 'archive')
        crs = pyproj.CRS.from_user_input(text)
    except MissingExtraError as error:
        raise JobError(str(error)) from error
    except Exception as error:  # pyproj has several, and DLLs of their own
        raise value.error(expected, remedy) from error
    if not crs.is_projected:
        raise value.error('a projection, with metres',
                          f'that is geographic, with degrees; {remedy}')
    return text


def _products(value: Value) -> Products:
    given = value.mapping(PRODUCTS, f'write products: {KEYS["products"]}')
    fields = {name: part.truth() for name, part in given.items() if name in ('strips', 'mosaic')}
    if 'images' in given:
        remedy = 'write for instance images: [geotiff]'
        parts = given['images'].items(f'a list of {" and ".join(IMAGE_FORMATS)}', remedy)
        fields['images'] = tuple(dict.fromkeys(part.choice(IMAGE_FORMATS) for part in parts))
    if 'coherence_window' in given:
        window = given['coherence_window']
        sides = window.number(3, 101, 'pixels, odd', '7', whole=True)
        if sides % 2 == 0:
            raise window.error('an odd number of pixels', f'write {sides + 1}')
        fields['coherence_window'] = sides
    return Products(**fields)


def _tile(value: Value) -> int:
    tile = value.number(16, 16384, 'pixels, a multiple of 16', '2048', whole=True)
    if tile % 16:
        raise value.error('a multiple of 16, as GeoTIFF has them', f'write {-(-tile // 16) * 16}')
    return tile


_READERS = {
    'recordings': _recordings, 'output': _output, 'datum': _datum, 'area_m': _area, 'crs': _crs,
    'products': _products, 'radiometry': _radiometry, 'tile': _tile,
    'spacing_m': lambda v: v.number(1e-4, 1e4, 'metres', '0.25'),
    'height_m': lambda v: v.number(-12_000, 10_000, 'metres', '0.0'),
    'surface': lambda v: v.choice(SURFACES),
    'method': lambda v: v.choice((AUTO, *METHODS)),
    'target_db': lambda v: v.number(-120, -10, 'dB', '-60.0'),
    'memory_gb': lambda v: v.number(LEAST_GB, 1e5, 'gigabytes for one worker', '2.0'),
    'longest_piece_s': lambda v: v.number(1, 1e6, 'seconds', '600'),
    'checked_pixels': lambda v: v.number(0, 100_000, 'pixels', '20', whole=True),
    'retries': lambda v: v.number(0, 100, 'tries', '3', whole=True)}
