"""What an image takes of the channels: their weights, each by itself, or displaced centres."""

from __future__ import annotations

import dataclasses

import numpy as np

from ..device_arrays import beside
from ..signal.pulses import PulseBlock


class Channels:
    """Choice of what of the channels goes into an image.

    Parameters
    ----------
    weights : (C,) complex array_like, optional
        Factor of each channel, such as its calibration or the steering of a beam.
    per_channel : bool
        One image per channel instead of their sum.
    midpoint : bool
        Replace both phase centres of a channel by their mean: displaced phase centres.

    Raises
    ------
    ValueError
        The weights are no finite numbers.
    """

    def __init__(self, weights=None, per_channel: bool = False, midpoint: bool = False):
        self._weights = None if weights is None else np.asarray(weights, np.complex64)
        if self._weights is not None and (self._weights.ndim != 1
                                          or not np.isfinite(self._weights).all()):
            raise ValueError(f'weights={weights}; expected one finite complex number per channel')
        self.per_channel, self.midpoint = per_channel, midpoint

    def shape(self, shape: tuple[int, ...], n_channels: int) -> tuple[int, ...]:
        """Of the image: that of one channel, or of all, one after the other."""
        return (n_channels, *shape) if self.per_channel else shape

    def centres(self, tx_m, rx_m) -> tuple[np.ndarray, np.ndarray]:
        """Phase centres as the image takes them, metres."""
        return (0.5 * (tx_m + rx_m),) * 2 if self.midpoint and tx_m is not None else (tx_m, rx_m)

    def cuts(self, n_channels: int) -> list[slice]:
        """Channels of each image."""
        return ([slice(n, n + 1) for n in range(n_channels)] if self.per_channel
                else [slice(None)])

    def blocks(self, block: PulseBlock) -> list[PulseBlock]:
        """Blocks of which each makes an image by itself.

        Raises
        ------
        ValueError
            There are more or fewer channels than weights.
        """
        if self._weights is not None and len(self._weights) != block.n_channels:
            raise ValueError(f'the block has {block.n_channels} channels, weights are for '
                             f'{len(self._weights)}; pass one weight per channel')
        samples, (tx, rx) = block.samples, self.centres(block.tx_m, block.rx_m)
        if self._weights is None and not (self.per_channel or self.midpoint):
            return [block]
        if self._weights is not None:
            samples = samples * beside(self._weights[:, None], samples)
        return [dataclasses.replace(block, samples=samples[:, cut], tx_m=tx[:, cut],
                                    rx_m=rx[:, cut]) for cut in self.cuts(block.n_channels)]
