# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Convert pulse blocks to std_msgs/Float32MultiArray and back."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike
from std_msgs.msg import Float32MultiArray

from sar_imaging.geometry.illumination import Pointing
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters

from . import float_pairs, multi_array, wire
from .layout import DEFAULT_MAX_ELEMENTS


def to_message(block: PulseBlock) -> Float32MultiArray:
    """Write a pulse block into a message; its samples are copied once.

    Parameters
    ----------
    block : PulseBlock
        At least one pulse, channel and sample.

    Returns
    -------
    std_msgs.msg.Float32MultiArray
        As docs/wire_format.md describes it.

    Raises
    ------
    WireFormatError
        The block does not fit into the format; see `msg_conversions.wire.to_array`.

    Examples
    --------
    >>> from msg_conversions import pulse_block
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(10))
    >>> message = pulse_block.to_message(block)
    >>> [(dim.label, dim.size) for dim in message.layout.dim]
    [('pulse', 10), ('channel', 5), ('sample', 126), ('iq', 2)]
    """
    return multi_array.from_parts(wire.preamble(block), block.samples,
                                  wire.dimensions(block.samples.shape, block.frame))


def from_message(msg: Float32MultiArray, *, max_elements: int = DEFAULT_MAX_ELEMENTS,
                 finite: bool = True) -> PulseBlock:
    """Read a pulse block from a message.

    Parameters
    ----------
    msg : std_msgs.msg.Float32MultiArray
        With block header, as `to_message` writes it.
    max_elements : int
        Largest number of floats of samples to accept.
    finite : bool
        Refuse samples that are NaN or infinite; False for who drops their pulses alone.

    Returns
    -------
    PulseBlock
        Its samples are a read-only view of ``msg.data``: the message stays in memory as long as
        they do, and must not be resized.

    Raises
    ------
    WireFormatError
        The message does not follow the format, is a bare cube, or has times outside the range
        of ``builtin_interfaces/Time``.

    Examples
    --------
    >>> from msg_conversions import pulse_block
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(10))
    >>> back = pulse_block.from_message(pulse_block.to_message(block))
    >>> back.n_pulses, bool((back.samples == block.samples).all())
    (10, True)
    """
    block = wire.from_array(msg.data, multi_array.dims(msg), msg.layout.data_offset,
                            max_elements=max_elements, finite=finite)
    multi_array.check_times(int(block.stamp_ns.min()), int(block.stamp_ns.max()))
    return block


def as_received(block: PulseBlock) -> PulseBlock:
    """The block as the reader of its message gets it, without making a message.

    A message keeps 48 bits of the radar's parameters, the phase centres and the pointing.
    Whoever hands blocks over directly rounds them likewise, and gets the same image to the last
    bit.
    """
    def rounded(values: ArrayLike) -> np.ndarray:
        return float_pairs.join_double(float_pairs.split_double(values))

    numbers = {f.name: getattr(block.radar, f.name) for f in dataclasses.fields(block.radar)
               if f.name != 'waveform'}
    values = rounded(list(numbers.values())).tolist()
    looks = None if block.pointing is None else Pointing.of_unit_vectors(
        rounded(block.pointing.boresight), rounded(block.pointing.up))
    return dataclasses.replace(
        block, radar=dataclasses.replace(block.radar, **dict(zip(numbers, values, strict=True))),
        tx_m=None if block.tx_m is None else rounded(block.tx_m),
        rx_m=None if block.rx_m is None else rounded(block.rx_m), pointing=looks)


def from_bare_cube(msg: Float32MultiArray, *, radar: RadarParameters, compressed: bool,
                   stamp_ns: np.ndarray, counter: np.ndarray, tx_m: np.ndarray | None = None,
                   rx_m: np.ndarray | None = None,
                   max_elements: int = DEFAULT_MAX_ELEMENTS) -> PulseBlock:
    """Read pulses from a message that holds nothing but samples (``data_offset`` is 0).

    Everything that the message does not carry comes from the caller: a bare cube cannot say
    which pulses were lost or when each was sent.

    Parameters
    ----------
    msg : std_msgs.msg.Float32MultiArray
        Samples (P, C, N, 2), labelled as in a block.
    radar : RadarParameters
        Waveform and sampling.
    compressed : bool
        True when the samples are range profiles.
    stamp_ns : (P,) int64
        Time of each pulse, nanoseconds.
    counter : (P,) uint32
        Number of each pulse.
    tx_m, rx_m : (P, C, 3) float64 or None
        Phase centres in the imaging frame, metres.
    max_elements : int
        Largest number of floats of samples to accept.

    Returns
    -------
    PulseBlock
        Its samples are a read-only view of ``msg.data``.

    Raises
    ------
    WireFormatError
        The message is not a bare cube, or its layout does not fit its data.
    ValueError
        The caller's arrays do not fit the samples.

    Examples
    --------
    >>> import numpy as np
    >>> from std_msgs.msg import Float32MultiArray, MultiArrayDimension, MultiArrayLayout
    >>> from msg_conversions import pulse_block
    >>> from sar_imaging import RadarParameters
    >>> sizes = (('pulse', 3, 384), ('channel', 1, 128), ('sample', 64, 128), ('iq', 2, 2))
    >>> dims = [MultiArrayDimension(label=label, size=n, stride=stride)
    ...         for label, n, stride in sizes]
    >>> message = Float32MultiArray(layout=MultiArrayLayout(dim=dims), data=[0.5] * 384)
    >>> block = pulse_block.from_bare_cube(
    ...     message, radar=RadarParameters(10e9, 300e6, 400e6, first_sample_delay_s=6e-7),
    ...     compressed=True, stamp_ns=np.arange(3) * 10**7, counter=np.arange(3))
    >>> block.samples.shape, complex(block.samples[0, 0, 0])
    ((3, 1, 64), (0.5+0.5j))
    """
    samples = wire.samples_from_bare_cube(msg.data, multi_array.dims(msg), msg.layout.data_offset,
                                          max_elements=max_elements)
    return PulseBlock(radar=radar, compressed=compressed, stamp_ns=stamp_ns, counter=counter,
                      samples=samples, tx_m=tx_m, rx_m=rx_m)
