# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The error that a malformed message raises."""

from __future__ import annotations


class WireFormatError(ValueError):
    """A message does not follow the wire format, or an array does not fit into it.

    The text names what was expected, what was received and what to do about it.

    Examples
    --------
    >>> from std_msgs.msg import Float32MultiArray
    >>> from msg_conversions import WireFormatError, pulse_block
    >>> try:
    ...     pulse_block.from_message(Float32MultiArray(data=[1.0, 2.0]))
    ... except WireFormatError as error:
    ...     print(error)
    layout.dim labels are (); expected ('pulse', 'channel', 'sample', 'iq'); see ...
    """
