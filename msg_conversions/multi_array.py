# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Build a std_msgs/Float32MultiArray from arrays, and read its layout."""

from __future__ import annotations

import numpy as np
from std_msgs.msg import Float32MultiArray, MultiArrayDimension

from .errors import WireFormatError
from .layout import Dims

MAX_TIME_NS = 2**31 * 10**9 - 1  # builtin_interfaces/Time has 32 bits of seconds


def from_parts(head: np.ndarray, content: np.ndarray, dims: Dims) -> Float32MultiArray:
    """Message of a header and complex numbers; both are copied once.

    Parameters
    ----------
    head : (H,) float32
        Everything that precedes the content.
    content : (...) complex64
        Numbers that `dims` describe.
    dims : sequence of (label, size, stride)
        For ``layout.dim``.
    """
    message = Float32MultiArray()
    message.layout.dim = [MultiArrayDimension(label=label, size=size, stride=stride)
                          for label, size, stride in dims]
    message.layout.data_offset = head.size
    # frombytes appends at memory speed; assigning an array takes a hundred times as long.
    message.data.frombytes(head.view(np.uint8))
    message.data.frombytes(np.ascontiguousarray(content).reshape(-1).view(np.uint8))
    return message


def dims(message: Float32MultiArray) -> list[tuple[str, int, int]]:
    """``(label, size, stride)`` of each dimension of a message."""
    return [(dim.label, dim.size, dim.stride) for dim in message.layout.dim]


def check_times(earliest_ns: int, latest_ns: int) -> None:
    """Check that headers can carry the times of a message.

    Parameters
    ----------
    earliest_ns, latest_ns : int
        Times, nanoseconds.

    Raises
    ------
    WireFormatError
        ``builtin_interfaces/Time`` cannot hold one of them.
    """
    if earliest_ns < -MAX_TIME_NS or latest_ns > MAX_TIME_NS:
        raise WireFormatError(f'times from {earliest_ns / 1e9:.6g} s to {latest_ns / 1e9:.6g} s; '
                              'expected seconds that ROS can hold, below 2^31; correct the clock '
                              'of the sender')
