"""Moving targets and obstacles to sensor_msgs/PointCloud2 and back.

Fields, all FLOAT32, of moving targets: ``x``, ``y``, ``z`` (metres, frame of the header),
``radial_velocity`` (m/s, positive away from the radar), ``snr`` (dB) and ``radial_velocity_std``
(m/s); of obstacles: ``x``, ``y``, ``z``, ``intensity`` (dB above the clutter around) and ``width``
(metres). Viewers expect
FLOAT32 places; farther than some 100 km from the origin of the frame these are coarser than 8 mm.
"""

from __future__ import annotations

import sys

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from .errors import WireFormatError

FIELDS = ('x', 'y', 'z', 'radial_velocity', 'snr', 'radial_velocity_std')
OBSTACLE_FIELDS = ('x', 'y', 'z', 'intensity', 'width')


def to_message(points: np.ndarray, header: Header, fields: tuple[str, ...] = FIELDS
               ) -> PointCloud2:
    """Point cloud of moving targets or obstacles.

    Parameters
    ----------
    points : (n, len(fields)) array_like
        One row per target in the order of the fields. Infinities and NaN are kept; a place that is
        none makes the cloud one that is not dense.
    header : std_msgs.msg.Header
        Time and frame of the places.
    fields : tuple of str
        `FIELDS` or `OBSTACLE_FIELDS`.

    Returns
    -------
    sensor_msgs.msg.PointCloud2
        One row of n points; n may be 0.

    Raises
    ------
    ValueError
        The array has another shape.
    """
    points = np.asarray(points, float)
    if points.ndim != 2 or points.shape[1] != len(fields):
        raise ValueError(f'points.shape={points.shape}; expected (n, {len(fields)}): '
                         f'{", ".join(fields)}')
    step = 4 * len(fields)
    message = PointCloud2(
        header=header, height=1, width=len(points), is_bigendian=sys.byteorder == 'big',
        point_step=step, row_step=step * len(points),
        is_dense=bool(np.isfinite(points[:, :3]).all()),
        fields=[PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
                for i, name in enumerate(fields)])
    with np.errstate(over='ignore'):  # what float32 cannot hold is infinite to it
        message.data.frombytes(points.astype(np.float32).tobytes())
    return message


def from_message(message: PointCloud2, fields: tuple[str, ...] = FIELDS) -> np.ndarray:
    """(n, len(fields)) float64 targets of a point cloud, columns in the order of the fields.

    The message may have further fields, others in between, and any order.

    Raises
    ------
    WireFormatError
        A field is missing or has another type, or sizes and data do not fit together.
    """
    known = {field.name: field for field in message.fields}
    missing = [name for name in fields if name not in known]
    if missing:
        raise WireFormatError(f'the point cloud has no fields {", ".join(missing)}; expected '
                              f'{", ".join(fields)}')
    for name in fields:
        field = known[name]
        if field.datatype != PointField.FLOAT32 or field.count != 1:
            raise WireFormatError(f'field {name} has datatype {field.datatype} and count '
                                  f'{field.count}; expected one FLOAT32 '
                                  f'({PointField.FLOAT32})')
        if field.offset + 4 > message.point_step:
            raise WireFormatError(f'field {name} at offset {field.offset} lies outside the point '
                                  f'of {message.point_step} bytes')
    if (message.row_step < message.width * message.point_step
            or len(message.data) != message.height * message.row_step):
        raise WireFormatError(f'len(data)={len(message.data)}, row_step={message.row_step}; '
                              f'expected {message.height} rows of {message.width} points of '
                              f'{message.point_step} bytes')
    order = '>' if message.is_bigendian else '<'
    table = np.dtype({'names': fields, 'formats': [f'{order}f4'] * len(fields),
                      'offsets': [known[name].offset for name in fields],
                      'itemsize': max(message.point_step, 1)})
    out = np.empty((message.height, message.width, len(fields)))
    for row in range(message.height):
        points = np.frombuffer(message.data, table, message.width, row * message.row_step)
        for column, name in enumerate(fields):
            out[row, :, column] = points[name]
    return out.reshape(-1, len(fields))
