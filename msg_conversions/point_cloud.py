# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Convert moving targets, obstacles and volumes to sensor_msgs/PointCloud2 and back.

Fields, all FLOAT32, of moving targets: ``x``, ``y``, ``z`` (metres, frame of the header),
``radial_velocity`` (m/s, positive away from the radar), ``snr`` (dB) and ``radial_velocity_std``
(m/s); of obstacles: ``x``, ``y``, ``z``, ``intensity`` (dB above the clutter around) and ``width``
(metres); of bright cells of a volume: ``x``, ``y``, ``z`` and ``intensity`` (dB above the volume's
median). Viewers expect FLOAT32 places; farther than some 100 km from the origin of the frame these
are coarser than 8 mm.
Where the frame has a datum, FLOAT64 fields ``latitude``, ``longitude`` (degrees) and ``altitude``
(metres above the WGS 84 ellipsoid, as in sensor_msgs/NavSatFix) follow; NaN while it is unknown.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import ArrayLike
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from .errors import WireFormatError

FIELDS = ('x', 'y', 'z', 'radial_velocity', 'snr', 'radial_velocity_std')
OBSTACLE_FIELDS = ('x', 'y', 'z', 'intensity', 'width')
CELL_FIELDS = ('x', 'y', 'z', 'intensity')
GEOGRAPHIC_FIELDS = ('latitude', 'longitude', 'altitude')


def to_message(points: ArrayLike, header: Header, fields: tuple[str, ...] = FIELDS,
               geographic: ArrayLike | None = None) -> PointCloud2:
    """Write moving targets, obstacles or bright cells as a point cloud.

    Parameters
    ----------
    points : (n, len(fields)) array_like
        One row per target in the order of the fields. Infinities and NaN are kept; a place that is
        none makes the cloud one that is not dense.
    header : std_msgs.msg.Header
        Time and frame of the places.
    fields : tuple of str
        `FIELDS`, `OBSTACLE_FIELDS` or `CELL_FIELDS`.
    geographic : (n, 3) array_like, optional
        Latitudes, longitudes and ellipsoidal heights of the same places, for frames with a datum.

    Returns
    -------
    sensor_msgs.msg.PointCloud2
        One row of n points; n may be 0.

    Raises
    ------
    ValueError
        The array has another shape.

    Examples
    --------
    >>> import numpy as np
    >>> from std_msgs.msg import Header
    >>> from msg_conversions import point_cloud
    >>> targets = np.zeros((2, len(point_cloud.FIELDS)))
    >>> message = point_cloud.to_message(targets, Header(frame_id='map'))
    >>> message.width, [field.name for field in message.fields][:3]
    (2, ['x', 'y', 'z'])
    """
    points = np.asarray(points, float)
    if points.ndim != 2 or points.shape[1] != len(fields):
        raise ValueError(f'points.shape={points.shape}; expected (n, {len(fields)}): '
                         f'{", ".join(fields)}')
    further = GEOGRAPHIC_FIELDS if geographic is not None else ()
    table = np.zeros(len(points), np.dtype(
        [(name, 'f4') for name in fields] + [(name, 'f8') for name in further], align=True))
    with np.errstate(over='ignore'):  # what float32 cannot hold is infinite to it
        for name, column in zip(fields, points.T, strict=True):
            table[name] = column
    for number, name in enumerate(further):
        table[name] = np.asarray(geographic, float).reshape(len(points), 3)[:, number]
    assert table.dtype.fields is not None  # it has names
    message = PointCloud2(
        header=header, height=1, width=len(points), is_bigendian=sys.byteorder == 'big',
        point_step=table.itemsize, row_step=table.nbytes,
        is_dense=bool(np.isfinite(points[:, :3]).all()),
        fields=[PointField(name=name, offset=table.dtype.fields[name][1], count=1, datatype=(
            PointField.FLOAT64 if name in further else PointField.FLOAT32))
                for name in (*fields, *further)])
    message.data.frombytes(table.tobytes())
    return message


def from_message(message: PointCloud2, fields: tuple[str, ...] = FIELDS) -> np.ndarray:
    """Read the points of a cloud, columns in the order of the fields.

    `GEOGRAPHIC_FIELDS` may be among the fields. The message may have further fields, others in
    between, and any order.

    Parameters
    ----------
    message : sensor_msgs.msg.PointCloud2
        As `to_message` writes it.
    fields : tuple of str
        Wanted ones, see `to_message`.

    Returns
    -------
    (n, len(fields)) float64
        In the units of the fields.

    Raises
    ------
    WireFormatError
        A field is missing or has another type, or sizes and data do not fit together.

    Examples
    --------
    >>> import numpy as np
    >>> from std_msgs.msg import Header
    >>> from msg_conversions import point_cloud
    >>> targets = np.zeros((2, len(point_cloud.FIELDS)))
    >>> targets[1, 0] = 12.5
    >>> message = point_cloud.to_message(targets, Header(frame_id='map'))
    >>> point_cloud.from_message(message)[:, 0].tolist()
    [0.0, 12.5]
    """
    known = {field.name: field for field in message.fields}
    missing = [name for name in fields if name not in known]
    if missing:
        raise WireFormatError(f'the point cloud has no fields {", ".join(missing)}; expected '
                              f'{", ".join(fields)}')
    for name in fields:
        field = known[name]
        size, kind, number = ((8, 'FLOAT64', PointField.FLOAT64) if name in GEOGRAPHIC_FIELDS
                              else (4, 'FLOAT32', PointField.FLOAT32))
        if field.datatype != number or field.count != 1:
            raise WireFormatError(f'field {name} has datatype {field.datatype} and count '
                                  f'{field.count}; expected one {kind} ({number})')
        if field.offset + size > message.point_step:
            raise WireFormatError(f'field {name} at offset {field.offset} lies outside the point '
                                  f'of {message.point_step} bytes')
    if (message.row_step < message.width * message.point_step
            or len(message.data) != message.height * message.row_step):
        raise WireFormatError(f'len(data)={len(message.data)}, row_step={message.row_step}; '
                              f'expected {message.height} rows of {message.width} points of '
                              f'{message.point_step} bytes')
    order = '>' if message.is_bigendian else '<'
    table = np.dtype({'names': fields, 'formats': [
        f'{order}f{8 if name in GEOGRAPHIC_FIELDS else 4}' for name in fields],
                      'offsets': [known[name].offset for name in fields],
                      'itemsize': max(message.point_step, 1)})
    out = np.empty((message.height, message.width, len(fields)))
    for row in range(message.height):
        points = np.frombuffer(message.data, table, message.width, row * message.row_step)
        for column, name in enumerate(fields):
            out[row, :, column] = points[name]
    return out.reshape(-1, len(fields))
