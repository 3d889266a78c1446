# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Convert sub-aperture images to std_msgs/Float32MultiArray and back."""

from __future__ import annotations

from std_msgs.msg import Float32MultiArray

from sar_imaging.device_arrays import to_host
from sar_imaging.streaming.subaperture_image import SubapertureImage

from . import multi_array, subaperture_wire
from .layout import DEFAULT_MAX_ELEMENTS


def to_message(subaperture: SubapertureImage) -> Float32MultiArray:
    """Write a sub-aperture image into a message; its pixels are copied once.

    Parameters
    ----------
    subaperture : SubapertureImage
        Of one sub-aperture.

    Returns
    -------
    std_msgs.msg.Float32MultiArray
        As docs/wire_format.md describes it.

    Raises
    ------
    WireFormatError
        The image does not fit into the format; see `msg_conversions.subaperture_wire.to_array`.

    Examples
    --------
    >>> from msg_conversions import subaperture_image
    >>> from sar_imaging.simulation import SCENARIOS
    >>> from sar_imaging.streaming.subapertures import LiveSubapertures
    >>> scenario = SCENARIOS['psf']()
    >>> live = LiveSubapertures(scenario.grid, pulses_per_aperture=200)
    >>> part = next(part for block in scenario.blocks() for part in live.add(block))
    >>> message = subaperture_image.to_message(part)
    >>> [dim.label for dim in message.layout.dim]
    ['angle', 'range', 'iq']
    """
    return multi_array.from_parts(
        subaperture_wire.preamble(subaperture), to_host(subaperture.image),
        subaperture_wire.LAYOUT.dimensions(subaperture.image.shape))


def from_message(msg: Float32MultiArray, *,
                 max_elements: int = DEFAULT_MAX_ELEMENTS) -> SubapertureImage:
    """Read a sub-aperture image from a message.

    Parameters
    ----------
    msg : std_msgs.msg.Float32MultiArray
        As `to_message` writes it.
    max_elements : int
        Largest number of floats of pixels to accept.

    Returns
    -------
    SubapertureImage
        Its image is a read-only view of ``msg.data``: the message stays in memory as long as it
        does, and must not be resized.

    Raises
    ------
    WireFormatError
        The message does not follow the format, or its time is outside the range of
        ``builtin_interfaces/Time``.

    Examples
    --------
    >>> from msg_conversions import subaperture_image
    >>> from sar_imaging.simulation import SCENARIOS
    >>> from sar_imaging.streaming.subapertures import LiveSubapertures
    >>> scenario = SCENARIOS['psf']()
    >>> live = LiveSubapertures(scenario.grid, pulses_per_aperture=200)
    >>> part = next(part for block in scenario.blocks() for part in live.add(block))
    >>> back = subaperture_image.from_message(subaperture_image.to_message(part))
    >>> bool((back.image == part.image).all())
    True
    """
    subaperture = subaperture_wire.from_array(
        msg.data, multi_array.dims(msg), msg.layout.data_offset, max_elements=max_elements)
    multi_array.check_times(subaperture.stamp_ns, subaperture.stamp_ns)
    return subaperture
