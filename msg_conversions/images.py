"""Convert images and grids to sensor_msgs/Image, MapMetaData and OccupancyGrid and back.

Image arrays have shape (n_y, n_x): row 0 is the largest y, column 0 the smallest x.
"""

from __future__ import annotations

import math
import sys

import numpy as np
from builtin_interfaces.msg import Time
from nav_msgs.msg import MapMetaData, OccupancyGrid
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from sar_imaging.geometry.grids import MapGrid

from .errors import WireFormatError

MAX_DYNAMIC_RANGE_DB = 200.0
UNKNOWN = -1  # occupancy of pixels that nothing is known about
ANCHORS = CLUTTER, PEAK = ('clutter', 'peak')  # what the brightness of a quicklook refers to
FLOOR_DB = 10.0  # below the median, where a quicklook is black: 7 % of speckle lie lower
_MOST_FOR_MEDIAN = 2**18  # pixels; of larger images every k-th, good to 0.01 dB


def complex_to_message(image: np.ndarray, header: Header) -> Image:
    """Complex image (n_y, n_x) as 32FC2: real and imaginary part."""
    return _to_message(image, np.complex64, '32FC2', header)


def amplitude_to_message(image_abs: np.ndarray, header: Header) -> Image:
    """Linear amplitude (n_y, n_x), real, as 32FC1."""
    if np.iscomplexobj(image_abs):
        raise ValueError(f'image_abs.dtype={image_abs.dtype}; expected real amplitudes; pass '
                         'np.abs(image)')
    return _to_message(image_abs, np.float32, '32FC1', header)


def quicklook_to_message(amplitude: np.ndarray, header: Header, *,
                         dynamic_range_db: float, anchor: str = PEAK) -> Image:
    """Amplitude as mono8 for people to look at; see `quicklook`."""
    return _to_message(quicklook(amplitude, dynamic_range_db, anchor), np.uint8, 'mono8', header)


def quicklook(amplitude: np.ndarray, dynamic_range_db: float, anchor: str = PEAK) -> np.ndarray:
    """Amplitude in dB, mapped linearly to 0..255.

    Anchored at the peak, the brightest pixel decides about all others, and beside a corner
    reflector clutter is black. Anchored at the clutter, whose level is the median, clutter is dark
    grey beside whatever else there is.

    Parameters
    ----------
    amplitude : (n_y, n_x) float
        Linear amplitude, finite, not negative.
    dynamic_range_db : float
        From what becomes 0 to what becomes 255 and more; dB, above 0, at most 200.
    anchor : str
        ``'peak'``: the maximum becomes 255. ``'clutter'``: what is `FLOOR_DB` below the median of
        the pixels that are not zero becomes 0, and the maximum 255 where it is nearer than
        `dynamic_range_db`.

    Returns
    -------
    (n_y, n_x) uint8
        All zeros where the image is all zeros.

    Raises
    ------
    ValueError
        The image is empty, its maximum is not finite, the dynamic range is out of bounds, or the
        anchor is unknown.
    """
    if anchor not in ANCHORS:
        raise ValueError(f'anchor={anchor!r} is unknown; use one of {", ".join(ANCHORS)}')
    amplitude = np.asarray(amplitude, np.float32)
    if not 0 < dynamic_range_db <= MAX_DYNAMIC_RANGE_DB:
        raise ValueError(f'dynamic_range_db={dynamic_range_db}; expected above 0 and at most '
                         f'{MAX_DYNAMIC_RANGE_DB:g}; 40 to 80 suits most scenes')
    if amplitude.size == 0:
        raise ValueError(f'amplitude.shape={amplitude.shape} is empty; expected at least one '
                         'pixel')
    peak = amplitude.max()
    if not np.isfinite(peak):
        raise ValueError(f'largest amplitude is {peak}; expected finite amplitudes; check the '
                         'samples that the image was formed from')
    if peak <= 0:
        return np.zeros(amplitude.shape, np.uint8)
    white_db = 0.0  # over the peak
    if anchor == CLUTTER:
        floor_db = _median_db(amplitude, peak) - FLOOR_DB
        white_db = min(0.0, floor_db + dynamic_range_db)
        dynamic_range_db = white_db - floor_db
    levels = np.maximum(amplitude / peak, np.float32(10 ** ((white_db - dynamic_range_db) / 20)))
    np.log10(levels, out=levels)
    levels *= 255 * 20 / dynamic_range_db
    levels += 255 * (1 - white_db / dynamic_range_db)
    np.minimum(levels, 255, out=levels)
    return np.rint(levels, out=levels).astype(np.uint8)


def _median_db(amplitude: np.ndarray, peak) -> float:
    """Median of the amplitudes that are not zero over the largest one, dB, no less than -250."""
    some = amplitude.ravel()[::-(-amplitude.size // _MOST_FOR_MEDIAN)]
    if not (some > 0).any():
        some = amplitude
    median = np.median(some[some > 0].astype(np.float64))  # a mean of two: no overflow
    return max(20 * math.log10(median / float(peak)), -250.0)


def occupancy_to_message(cells: np.ndarray, grid: MapGrid, header: Header) -> OccupancyGrid:
    """Cells of a map for planners, with their place; the bottom row comes first.

    Parameters
    ----------
    cells : (n_y, n_x) int8
        0 to 100, or `UNKNOWN`; row 0 is the largest y.
    grid : MapGrid
        Where the cells are.
    header : std_msgs.msg.Header
        Time and frame.

    Raises
    ------
    ValueError
        The cells have another shape or type, or one is out of range.
    """
    grid.check_image(cells)
    if cells.dtype != np.int8 or cells.min() < UNKNOWN or cells.max() > 100:
        raise ValueError(f'cells are {cells.dtype} from {cells.min()} to {cells.max()}; expected '
                         f'int8 from {UNKNOWN} to 100')
    msg = OccupancyGrid(header=header, info=map_metadata_to_message(grid, header.stamp))
    msg.data.frombytes(np.ascontiguousarray(cells[::-1]).reshape(-1).view(np.uint8))
    return msg


def occupancy_from_message(msg: OccupancyGrid) -> tuple[np.ndarray, MapGrid]:
    """Cells (n_y, n_x) int8, row 0 the largest y, and their grid.

    Raises
    ------
    WireFormatError
        The metadata describe no grid, or the number of cells is another one.
    """
    grid = map_metadata_from_message(msg.info)
    if len(msg.data) != grid.n_x * grid.n_y:
        raise WireFormatError(f'len(data)={len(msg.data)}; expected {grid.n_x * grid.n_y}: '
                              f'{grid.n_y} rows of {grid.n_x} cells')
    return np.frombuffer(msg.data, np.int8).reshape(grid.shape)[::-1], grid


def complex_from_message(msg: Image) -> np.ndarray:
    """(n_y, n_x) complex64 of a 32FC2 image; see `amplitude_from_message`."""
    return _from_message(msg, np.complex64, '32FC2')


def amplitude_from_message(msg: Image) -> np.ndarray:
    """(n_y, n_x) float32 of a 32FC1 image.

    A read-only view of ``msg.data`` when it is in the byte order of this machine, a copy
    otherwise.

    Raises
    ------
    WireFormatError
        The encoding is another one, or sizes, step and data do not fit together.
    """
    return _from_message(msg, np.float32, '32FC1')


def quicklook_from_message(msg: Image) -> np.ndarray:
    """(n_y, n_x) uint8 of a mono8 image; see `amplitude_from_message`."""
    return _from_message(msg, np.uint8, 'mono8')


def map_metadata_to_message(grid: MapGrid, stamp: Time) -> MapMetaData:
    """Pixel spacing, size and place of an image.

    Parameters
    ----------
    grid : MapGrid
        Grid of the image.
    stamp : builtin_interfaces.msg.Time
        Time of the image.

    Returns
    -------
    nav_msgs.msg.MapMetaData
        The origin is the outer lower-left corner of the lower-left pixel, in the imaging frame,
        metres. The resolution is one float32: spacings of up to seven decimal digits survive
        exactly, others with a relative error of 2**-24.
    """
    msg = MapMetaData(map_load_time=stamp, width=int(grid.n_x), height=int(grid.n_y),
                      resolution=float(grid.spacing_m))
    x, y, z = grid.centre_m
    msg.origin.position.x = x - grid.n_x / 2 * grid.spacing_m
    msg.origin.position.y = y - grid.n_y / 2 * grid.spacing_m
    msg.origin.position.z = z
    msg.origin.orientation.w = 1.0
    return msg


def map_metadata_from_message(msg: MapMetaData) -> MapGrid:
    """Grid of an image from its metadata.

    Raises
    ------
    WireFormatError
        A size or number is impossible, or the map is rotated.
    """
    q = msg.origin.orientation
    if max(abs(q.x), abs(q.y), abs(q.z)) > 1e-9 or not math.isclose(abs(q.w), 1.0, abs_tol=1e-9):
        raise WireFormatError(f'origin.orientation=({q.x}, {q.y}, {q.z}, {q.w}); expected '
                              '(0, 0, 0, 1): a north-up map')
    # The shortest decimal that names the float32 is the spacing somebody typed: 0.1, not
    # 0.10000000149, which over a wide image would shift the far edge.
    spacing = float(str(np.float32(msg.resolution)))
    corner = msg.origin.position
    try:
        return MapGrid((corner.x + msg.width / 2 * spacing, corner.y + msg.height / 2 * spacing,
                        corner.z), msg.width, msg.height, spacing)
    except ValueError as error:
        raise WireFormatError(f'map metadata describes no grid: {error}; correct the sender'
                              ) from error


def _to_message(image: np.ndarray, dtype, encoding: str, header: Header) -> Image:
    image = np.ascontiguousarray(image, dtype)
    if image.ndim != 2 or image.size == 0:
        raise ValueError(f'image.shape={image.shape}; expected (n_y, n_x) with at least one pixel')
    msg = Image(header=header, height=image.shape[0], width=image.shape[1], encoding=encoding,
                is_bigendian=int(sys.byteorder == 'big'), step=image.shape[1] * image.itemsize)
    # frombytes copies at memory speed; assigning an array takes a thousand times as long.
    msg.data.frombytes(image.reshape(-1).view(np.uint8))
    return msg


def _from_message(msg: Image, dtype, encoding: str) -> np.ndarray:
    dtype = np.dtype(dtype)
    if msg.encoding != encoding:
        raise WireFormatError(f'encoding={msg.encoding[:32]!r}; expected {encoding!r}; subscribe '
                              'to the topic of that image product')
    if msg.height < 1 or msg.width < 1:
        raise WireFormatError(f'height={msg.height}, width={msg.width}; expected at least one '
                              'pixel each')
    if msg.step != msg.width * dtype.itemsize:
        raise WireFormatError(f'step={msg.step}; expected {msg.width * dtype.itemsize}: '
                              f'{msg.width} pixels of {dtype.itemsize} bytes without padding')
    if len(msg.data) != msg.height * msg.step:
        raise WireFormatError(f'len(data)={len(msg.data)}; expected {msg.height * msg.step}: '
                              f'{msg.height} rows of {msg.step} bytes')
    order = '>' if msg.is_bigendian else '<'
    image = np.frombuffer(msg.data, dtype.newbyteorder(order)).reshape(msg.height, msg.width)
    image = image.astype(dtype, copy=False)
    image.flags.writeable = False
    return image
