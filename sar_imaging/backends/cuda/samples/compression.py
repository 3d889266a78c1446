"""Samples to the device, and their range compression there while others are on the way."""

from __future__ import annotations

import numpy as np

from ....device_arrays import are_finite
from ....signal.pulses import PulseBlock
from ....signal.pulses.block import check_samples
from ....signal.range_compression import RangeCompressor
from ..arrays import (
    check_memory,
    complex_samples,
    free_bytes,
    given,
    reports_failures,
    require_device,
    taken,
    xp,
)
from ..transfers import in_pieces

_PIECE_BYTES, _SHARE = 1 << 25, 8  # of samples at once, and of the free memory one part in so many
_SAMPLE_BYTES = 8
_COPIES = 6  # of a piece: samples as they came, transforms and their work space


@reports_failures
def to_device(samples):
    """Samples on the device, see `backends.samples.to_device`."""
    require_device()
    integers = samples.dtype.kind == 'i'
    shape = samples.shape[:-1] if integers else samples.shape
    out = _room(shape)
    for piece, some in in_pieces(samples, _pieces(shape, shape[-1])):
        out[piece] = complex_samples(some)
    return given(out)


@reports_failures
def compress(compressor: RangeCompressor, block: PulseBlock) -> PulseBlock:
    """Range profiles on the device, see `backends.samples.compress`."""
    require_device()
    compressor.check(block)
    shape = *block.samples.shape[:2], compressor.n_output
    out = _room(shape)
    for piece, some in in_pieces(block.samples, _pieces(
            shape, max(block.n_samples, compressor.n_output))):
        out[piece] = taken(compressor.profiles(given(some)))
    # what is not finite spreads over its profile: one look at these, while nothing waits
    if not are_finite(given(out)):
        check_samples(block.samples, block.counter)
    return compressor.compressed_block(block, given(out))


def _room(shape: tuple[int, ...]):
    """Memory for complex64 samples of this shape.

    Raises
    ------
    DeviceError
        There is too little.
    """
    n_bytes = int(np.prod(shape, dtype=np.float64)) * _SAMPLE_BYTES
    check_memory(n_bytes, f'{" x ".join(map(str, shape))} samples',
                 "take fewer pulses at once, or use backend='cpu'")
    return xp.empty(shape, np.complex64)


def _pieces(shape: tuple[int, ...], n_samples: int) -> list[slice]:
    """Pulses that are worked on together."""
    pulse_bytes = max(1, shape[1] * n_samples * _SAMPLE_BYTES)
    most = min(_PIECE_BYTES, free_bytes() // (_SHARE * _COPIES))
    step = max(1, most // pulse_bytes)
    return [slice(lo, min(lo + step, shape[0])) for lo in range(0, shape[0], step)]
