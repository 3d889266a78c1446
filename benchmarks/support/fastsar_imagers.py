# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""FastSAR's imagers behind one call each: a phase history in, a map image in our layout out.

FastSAR is no requirement of this project; install it beside it::

    python3 -m venv build/fastsar
    build/fastsar/bin/pip install fastsar==0.1.8 numba scipy tqdm

It takes one position per pulse. Several channels therefore come as pulses at the midpoints of
transmitter and receiver.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sar_imaging.geometry import MapGrid
from sar_imaging.signal import PulseBlock
from sar_imaging.signal.spectra import phase_history_frequencies


class _Collection:
    """A block and a map centred on the origin, in FastSAR's terms."""

    def __init__(self, block: PulseBlock, grid: MapGrid, backend: str = 'cpu'):
        radar, n = block.radar, block.n_samples
        frequencies = phase_history_frequencies(radar.carrier_hz, radar.bandwidth_hz, n)
        centres = np.ascontiguousarray((0.5 * (block.tx_m + block.rx_m)).reshape(-1, 3))
        # Its first axis is azimuth and its second range, as its documentation puts them.
        self.arguments = (centres, frequencies[0], radar.bandwidth_hz / n, n, grid.n_y, grid.n_x,
                          grid.spacing_m, grid.spacing_m, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
        self.options = {'backend': backend, 'window': False,
                        'ref': np.full(len(centres), radar.range_start_m)}
        self.history = np.ascontiguousarray(block.samples.reshape(-1, n))

    def call(self, former) -> Callable[[], np.ndarray]:
        """Call that forms the image, row 0 at the largest y."""
        return lambda: np.asarray(former(self.history))[::-1]


def exact(block: PulseBlock, grid: MapGrid, interpolation: str) -> Callable[[], np.ndarray]:
    """Exact backprojection with profiles oversampled eight times."""
    from fastsar.exact import ExactFormer

    collection = _Collection(block, grid)
    return collection.call(ExactFormer(*collection.arguments, **collection.options,
                                       interp=interpolation, upsample=8))


def factorised(block: PulseBlock, grid: MapGrid, backend: str = 'cpu'
               ) -> tuple[Callable[[], np.ndarray], float]:
    """Fast factorised backprojection, and its predicted error in dB."""
    import fastsar

    collection = _Collection(block, grid, backend)
    former = fastsar.ImageFormer(*collection.arguments, **collection.options)
    return collection.call(former), float(former.predicted_error_db)
