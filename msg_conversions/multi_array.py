"""Build a std_msgs/Float32MultiArray from arrays, and read its layout."""

from __future__ import annotations

import numpy as np
from std_msgs.msg import Float32MultiArray, MultiArrayDimension

from .layout import Dims


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
