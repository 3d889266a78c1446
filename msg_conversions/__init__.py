"""Messages to arrays and back: the only code that knows a wire format.

`msg_conversions.wire` and `msg_conversions.float_pairs` are plain NumPy and work without ROS;
`msg_conversions.pulse_block` and `msg_conversions.images` need the message classes.
"""

from .errors import WireFormatError

__all__ = ['WireFormatError']
