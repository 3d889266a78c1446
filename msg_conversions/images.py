# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Convert images and grids to sensor_msgs/Image, MapMetaData and OccupancyGrid and back.

Image arrays have shape (n_y, n_x): row 0 is the largest y, column 0 the smallest x.
"""

from __future__ import annotations

import math
import sys
from typing import Literal

import numpy as np
from builtin_interfaces.msg import Time
from nav_msgs.msg import MapMetaData, OccupancyGrid
from numpy.typing import DTypeLike
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from sar_imaging.geometry.grids import MapGrid

from .errors import WireFormatError
from .quicklook import PEAK, quicklook

UNKNOWN = -1  # occupancy of pixels that nothing is known about


def complex_to_message(image: np.ndarray, header: Header) -> Image:
    """Write a complex image as 32FC2: real and imaginary part.

    Parameters
    ----------
    image : (n_y, n_x) complex64
        Row 0 at the largest y.
    header : std_msgs.msg.Header
        Time and frame.

    Returns
    -------
    sensor_msgs.msg.Image
        Its rows in the same order.

    Examples
    --------
    >>> import numpy as np
    >>> from std_msgs.msg import Header
    >>> from msg_conversions import images
    >>> message = images.complex_to_message(np.ones((3, 4), np.complex64), Header(frame_id='map'))
    >>> message.encoding, message.height, message.width
    ('32FC2', 3, 4)
    """
    return _to_message(image, np.complex64, '32FC2', header)


def amplitude_to_message(image_abs: np.ndarray, header: Header) -> Image:
    """Write a linear amplitude as 32FC1.

    Parameters
    ----------
    image_abs : (n_y, n_x) float
        Linear amplitude.
    header : std_msgs.msg.Header
        Time and frame.

    Returns
    -------
    sensor_msgs.msg.Image
        float32.

    Examples
    --------
    >>> import numpy as np
    >>> from std_msgs.msg import Header
    >>> from msg_conversions import images
    >>> images.amplitude_to_message(np.ones((3, 4)), Header(frame_id='map')).encoding
    '32FC1'
    """
    if np.iscomplexobj(image_abs):
        raise ValueError(f'image_abs.dtype={image_abs.dtype}; expected real amplitudes; pass '
                         'np.abs(image)')
    return _to_message(image_abs, np.float32, '32FC1', header)


def quicklook_to_message(amplitude: np.ndarray, header: Header, *,
                         dynamic_range_db: float, anchor: str = PEAK) -> Image:
    """Write an amplitude as mono8 for people to look at; see `quicklook`.

    Parameters
    ----------
    amplitude : (n_y, n_x) float
        Linear amplitude.
    header : std_msgs.msg.Header
        Time and frame.
    dynamic_range_db : float
        As for `quicklook`, dB.
    anchor : str
        As for `quicklook`.

    Returns
    -------
    sensor_msgs.msg.Image
        Eight bits of the amplitude in dB.

    Examples
    --------
    >>> import numpy as np
    >>> from std_msgs.msg import Header
    >>> from msg_conversions import images
    >>> message = images.quicklook_to_message(np.array([[1.0, 0.1, 0.01]]), Header(),
    ...                                       dynamic_range_db=40.0)
    >>> message.encoding, list(message.data)
    ('mono8', [255, 128, 0])
    """
    return _to_message(quicklook(amplitude, dynamic_range_db, anchor), np.uint8, 'mono8', header)


def occupancy_to_message(cells: np.ndarray, grid: MapGrid, header: Header) -> OccupancyGrid:
    """Write the cells of a map for planners, with their place; the bottom row comes first.

    Parameters
    ----------
    cells : (n_y, n_x) int8
        0 to 100, or `UNKNOWN`; row 0 is the largest y.
    grid : MapGrid
        Where the cells are.
    header : std_msgs.msg.Header
        Time and frame.

    Returns
    -------
    nav_msgs.msg.OccupancyGrid
        As planners take it.

    Raises
    ------
    ValueError
        The cells have another shape or type, or one is out of range.

    Examples
    --------
    >>> import numpy as np
    >>> from std_msgs.msg import Header
    >>> from msg_conversions import images
    >>> from sar_imaging import MapGrid
    >>> cells = np.array([[0, 100], [0, -1]], np.int8)  # row 0 in the north
    >>> message = images.occupancy_to_message(cells, MapGrid((5.0, 0.0, 0.0), 2, 2, 0.5), Header())
    >>> list(message.data), message.info.resolution
    ([0, -1, 0, 100], 0.5)
    """
    grid.check_image(cells)
    if cells.dtype != np.int8 or cells.min() < UNKNOWN or cells.max() > 100:
        raise ValueError(f'cells are {cells.dtype} from {cells.min()} to {cells.max()}; expected '
                         f'int8 from {UNKNOWN} to 100')
    msg = OccupancyGrid(header=header, info=map_metadata_to_message(grid, header.stamp))
    msg.data.frombytes(np.ascontiguousarray(cells[::-1]).reshape(-1).view(np.uint8))
    return msg


def occupancy_from_message(msg: OccupancyGrid) -> tuple[np.ndarray, MapGrid]:
    """Read the cells of a map, and their grid.

    Parameters
    ----------
    msg : nav_msgs.msg.OccupancyGrid
        As `occupancy_to_message` writes it.

    Returns
    -------
    cells : (n_y, n_x) int8
        Row 0 at the largest y.
    grid : MapGrid
        Where the cells are.

    Raises
    ------
    WireFormatError
        The metadata describe no grid, or the number of cells is another one.

    Examples
    --------
    >>> import numpy as np
    >>> from std_msgs.msg import Header
    >>> from msg_conversions import images
    >>> from sar_imaging import MapGrid
    >>> cells = np.array([[0, 100], [0, -1]], np.int8)
    >>> message = images.occupancy_to_message(cells, MapGrid((5.0, 0.0, 0.0), 2, 2, 0.5), Header())
    >>> back, grid = images.occupancy_from_message(message)
    >>> back.tolist(), grid
    ([[0, 100], [0, -1]], MapGrid(centre_m=(5.0, 0.0, 0.0), n_x=2, n_y=2, spacing_m=0.5))
    """
    grid = map_metadata_from_message(msg.info)
    if len(msg.data) != grid.n_x * grid.n_y:
        raise WireFormatError(f'len(data)={len(msg.data)}; expected {grid.n_x * grid.n_y}: '
                              f'{grid.n_y} rows of {grid.n_x} cells')
    return np.frombuffer(msg.data, np.int8).reshape(grid.shape)[::-1], grid


def complex_from_message(msg: Image) -> np.ndarray:
    """Read a complex image from 32FC2; see `amplitude_from_message`.

    Parameters
    ----------
    msg : sensor_msgs.msg.Image
        As `complex_to_message` writes it.

    Returns
    -------
    (n_y, n_x) complex64
        A view of the data where it can be.

    Raises
    ------
    WireFormatError
        The encoding is another one, or sizes, step and data do not fit together.

    Examples
    --------
    >>> import numpy as np
    >>> from std_msgs.msg import Header
    >>> from msg_conversions import images
    >>> message = images.complex_to_message(np.full((3, 4), 1 + 2j, np.complex64), Header())
    >>> complex(images.complex_from_message(message)[0, 0])
    (1+2j)
    """
    return _from_message(msg, np.complex64, '32FC2')


def amplitude_from_message(msg: Image) -> np.ndarray:
    """Read a linear amplitude from 32FC1.

    A read-only view of ``msg.data`` when it is in the byte order of this machine, a copy
    otherwise.

    Parameters
    ----------
    msg : sensor_msgs.msg.Image
        As `amplitude_to_message` writes it.

    Returns
    -------
    (n_y, n_x) float32
        Linear amplitude.

    Raises
    ------
    WireFormatError
        The encoding is another one, or sizes, step and data do not fit together.

    Examples
    --------
    >>> import numpy as np
    >>> from std_msgs.msg import Header
    >>> from msg_conversions import images
    >>> message = images.amplitude_to_message(np.full((3, 4), 0.5), Header())
    >>> images.amplitude_from_message(message)[0].tolist()
    [0.5, 0.5, 0.5, 0.5]
    """
    return _from_message(msg, np.float32, '32FC1')


def quicklook_from_message(msg: Image) -> np.ndarray:
    """(n_y, n_x) uint8 of a mono8 image; see `amplitude_from_message`."""
    return _from_message(msg, np.uint8, 'mono8')


def map_metadata_to_message(grid: MapGrid, stamp: Time) -> MapMetaData:
    """Write pixel spacing, size and place of an image.

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

    Examples
    --------
    >>> from builtin_interfaces.msg import Time
    >>> from msg_conversions import images
    >>> from sar_imaging import MapGrid
    >>> message = images.map_metadata_to_message(MapGrid((5.0, 0.0, 0.0), 4, 2, 0.5), Time(sec=7))
    >>> message.width, message.height, message.origin.position.x
    (4, 2, 4.0)
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
    """Read the grid of an image from its metadata.

    Parameters
    ----------
    msg : nav_msgs.msg.MapMetaData
        As `map_metadata_to_message` writes it.

    Returns
    -------
    MapGrid
        Metres.

    Raises
    ------
    WireFormatError
        A size or number is impossible, or the map is rotated.

    Examples
    --------
    >>> from builtin_interfaces.msg import Time
    >>> from msg_conversions import images
    >>> from sar_imaging import MapGrid
    >>> message = images.map_metadata_to_message(MapGrid((5.0, 0.0, 0.0), 4, 2, 0.5), Time())
    >>> images.map_metadata_from_message(message)
    MapGrid(centre_m=(5.0, 0.0, 0.0), n_x=4, n_y=2, spacing_m=0.5)
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


def _to_message(image: np.ndarray, dtype: DTypeLike, encoding: str, header: Header) -> Image:
    image = np.ascontiguousarray(image, dtype)
    if image.ndim != 2 or image.size == 0:
        raise ValueError(f'image.shape={image.shape}; expected (n_y, n_x) with at least one pixel')
    msg = Image(header=header, height=image.shape[0], width=image.shape[1], encoding=encoding,
                is_bigendian=int(sys.byteorder == 'big'), step=image.shape[1] * image.itemsize)
    # frombytes copies at memory speed; assigning an array takes a thousand times as long.
    msg.data.frombytes(image.reshape(-1).view(np.uint8))
    return msg


def _from_message(msg: Image, dtype: DTypeLike, encoding: str) -> np.ndarray:
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
    order: Literal['>', '<'] = '>' if msg.is_bigendian else '<'
    image = np.frombuffer(msg.data, dtype.newbyteorder(order)).reshape(msg.height, msg.width)
    image = image.astype(dtype, copy=False)
    image.flags.writeable = False
    return image
