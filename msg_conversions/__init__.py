# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Convert messages to arrays and back; no other code knows the wire format.

`msg_conversions.wire`, `msg_conversions.subaperture_wire`, `msg_conversions.layout` and
`msg_conversions.float_pairs` are plain NumPy and work without ROS; the other modules need the
message classes.
"""

from .errors import WireFormatError

__all__ = ['WireFormatError']
