# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Samples to the device and images back, through page-locked memory, while the device works.

Pageable memory is copied at a fraction of the bus's rate, and the device waits for it. Samples go
in pieces through two page-locked buffers in turn: while the device adds or compresses one piece,
the next is copied beside it. Images come back the same way.
"""

from __future__ import annotations

import concurrent.futures
import functools
import math
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ...device_arrays import are_finite
from ...signal.pulses import PulseBlock
from ...signal.pulses.block import check_samples
from ...signal.range_compression import RangeCompressor
from .arrays import (
    SIMULATED,
    check_memory,
    complex_samples,
    free_bytes,
    given,
    on_device,
    reports_failures,
    require_device,
    taken,
    xp,
)

if TYPE_CHECKING:
    from numpy.typing import DTypeLike

_PIECE_BYTES = 1 << 25  # of an image or of samples: what is copied at once
_THREADS, _LEAST_BYTES = 4, 1 << 20  # of the host; one alone has a part of the bus's rate


class Copies:
    """A queue of copies beside the device's work; in the simulator each is made at once."""

    def __init__(self) -> None:
        self._queue = None if SIMULATED else _queue(xp.cuda.Device().id)

    def mark(self) -> Any:
        """What tells the end of all work that the device was given so far."""
        return None if SIMULATED else xp.cuda.get_current_stream().record()

    def send(self, there: np.ndarray, here: np.ndarray, after: Any) -> Any:
        """Begin a copy of page-locked memory to the device, after a mark; returns its end."""
        if SIMULATED:
            there[...] = here
            return None
        self._queue.wait_event(after)
        there.set(here, stream=self._queue)
        return self._queue.record()

    def fetch(self, here: np.ndarray, there: np.ndarray, after: Any) -> Any:
        """Begin a copy from the device to page-locked memory, after a mark; returns its end."""
        if SIMULATED:
            here[...] = there
            return None
        self._queue.wait_event(after)
        there.get(stream=self._queue, out=here, blocking=False)
        return self._queue.record()

    def wait(self, end: Any) -> None:
        """Have the work that the device is given next wait for the end of a copy."""
        if end is not None:
            xp.cuda.get_current_stream().wait_event(end)

    def finish(self, end: Any) -> None:
        """Wait for the end of a copy."""
        if end is not None:
            end.synchronize()


@functools.cache
def _queue(device: int) -> Any:
    with xp.cuda.Device(device):
        return xp.cuda.Stream(non_blocking=True)


@functools.cache
def _threads() -> concurrent.futures.ThreadPoolExecutor:
    return concurrent.futures.ThreadPoolExecutor(_THREADS, 'copies')


def page_locked(shape: tuple[int, ...], dtype: DTypeLike) -> np.ndarray:
    """Array of any contents in memory that the device reads and writes by itself."""
    if SIMULATED:
        return np.empty(shape, dtype)
    dtype, size = np.dtype(dtype), math.prod(shape)
    memory = xp.cuda.alloc_pinned_memory(max(size, 1) * dtype.itemsize)
    return np.frombuffer(memory, dtype, size).reshape(shape)


def in_pieces(samples: np.ndarray, pieces: Iterable[slice], copies: Copies | None = None
              ) -> Iterator[tuple[slice, np.ndarray]]:
    """Samples piece by piece on the device, each copied while the one before is added.

    Parameters
    ----------
    samples : (R, N) complex64 or (R, N, 2) integer
        Samples of the host, or of the device, where they are cut alone.
    pieces : iterable of slice
        Pieces of the echoes.
    copies : Copies, optional
        What copies them.

    Yields
    ------
    piece : slice
    some : (n, N) complex64 or (n, N, 2) integer array of the device
        Valid until the next is asked for.
    """
    pieces = list(pieces)
    if on_device(samples) or not pieces:
        yield from ((piece, taken(samples)[piece]) for piece in pieces)
        return
    copies = copies or Copies()
    kind = samples.dtype if samples.dtype.kind == 'i' else np.complex64
    most = max(len(range(*piece.indices(len(samples)))) for piece in pieces)
    shape, n_buffers = (most, *samples.shape[1:]), min(2, len(pieces))
    here = [page_locked(shape, kind) for _ in range(n_buffers)]
    there = [xp.empty(shape, kind) for _ in range(n_buffers)]
    # of the device's and the host's buffers
    read, ends = [copies.mark()] * n_buffers, [None] * n_buffers

    def begin(number: int) -> None:
        k, some = number % n_buffers, samples[pieces[number]]
        copies.finish(ends[k])
        _by_threads(np.copyto, here[k][:len(some)], some)
        ends[k] = copies.send(there[k][:len(some)], here[k][:len(some)], read[k])

    try:
        begin(0)
        for number, piece in enumerate(pieces):
            k = number % n_buffers
            copies.wait(ends[k])
            yield piece, there[k][:len(samples[piece])]
            read[k] = copies.mark()
            if number + 1 < len(pieces):
                begin(number + 1)
    finally:  # before others have the buffers
        for end in ends:
            copies.finish(end)


def add_to_host(there: np.ndarray, image: np.ndarray, copies: Copies | None = None,
                n_bytes: int = _PIECE_BYTES) -> None:
    """Add an array of the device to one of the host.

    Parameters
    ----------
    there : (n, m) complex64 array of the device
        Contiguous; or of the host, where it was fetched before.
    image : (n, m) complex64
        Added to.
    copies : Copies, optional
        What copies it.
    n_bytes : int
        Bytes of a piece.
    """
    if not (SIMULATED or on_device(there)):
        _by_threads(_add, image, there)
        return
    copies = copies or Copies()
    n = max(1, min(len(there), n_bytes // max(1, there.nbytes // max(1, len(there)))))
    firsts = range(0, len(there), n)
    here = [page_locked((n, *there.shape[1:]), there.dtype) for _ in firsts[:2]]
    made, ends = copies.mark(), [None] * len(here)

    def begin(number: int) -> None:
        some = there[firsts[number]:firsts[number] + n]
        ends[number % 2] = copies.fetch(here[number % 2][:len(some)], some, made)

    try:
        if firsts:
            begin(0)
        for number, first in enumerate(firsts):
            if number + 1 < len(firsts):
                begin(number + 1)
            copies.finish(ends[number % 2])
            onto = image[first:first + n]
            _by_threads(_add, onto, here[number % 2][:len(onto)])
    finally:
        for end in ends:
            copies.finish(end)


@reports_failures
def to_host(array: np.ndarray) -> np.ndarray:
    """Copy of an array of the device in page-locked memory; one of the host as it is."""
    if SIMULATED or not on_device(array):
        return taken(array)
    copies, there = Copies(), xp.ascontiguousarray(array)
    here = page_locked(there.shape, there.dtype)
    copies.finish(copies.fetch(here, there, copies.mark()))
    return here


def _add(target: np.ndarray, source: np.ndarray) -> None:
    np.add(target, source, out=target)


def _by_threads(work: Callable[[np.ndarray, np.ndarray], None], target: np.ndarray,
                source: np.ndarray) -> None:
    """Do `work` on equal parts of the first axis of two arrays, in some threads of the host."""
    n = min(_THREADS, len(target), target.nbytes // _LEAST_BYTES)
    if n < 2:
        work(target, source)
        return
    cuts = np.linspace(0, len(target), n + 1).astype(int)
    for done in [_threads().submit(work, target[lo:hi], source[lo:hi])
                 for lo, hi in zip(cuts[:-1], cuts[1:], strict=True)]:
        done.result()


_SHARE = 8  # of the free memory: one part in so many for samples
_SAMPLE_BYTES = 8
_COPIES = 6  # of a piece: samples as they came, transforms and their work space


@reports_failures
def to_device(samples: np.ndarray) -> Any:
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


def _room(shape: tuple[int, ...]) -> np.ndarray:
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
