# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Speckle: mean power over looks, and how many independent looks an image has."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def multilook(power: np.ndarray, looks: tuple[int, int]) -> np.ndarray:
    """Average the power of blocks of pixels, each of which becomes one pixel.

    Parameters
    ----------
    power : (n_y, n_x) float
        Power, such as `brightness` returns; NaN where unknown.
    looks : (int, int)
        Rows and columns of a block.

    Returns
    -------
    (n_y // rows, n_x // columns) float64
        What is left over at the end of rows and columns is dropped. NaN where all is unknown.

    Raises
    ------
    ValueError
        A block is not smaller than the image, or has no pixel.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.radiometry import multilook
    >>> power = np.arange(16.0).reshape(4, 4)
    >>> multilook(power, (2, 2)).tolist()
    [[2.5, 4.5], [10.5, 12.5]]
    """
    power = np.asarray(power, np.float64)
    rows, columns = looks
    if not (1 <= rows <= power.shape[0] and 1 <= columns <= power.shape[1]):
        raise ValueError(f'looks={looks}; expected rows and columns of 1 to {power.shape}')
    shape = power.shape[0] // rows, power.shape[1] // columns
    blocks = power[:shape[0] * rows, :shape[1] * columns].reshape(
        shape[0], rows, shape[1], columns)
    known = np.isfinite(blocks)
    count = known.sum(axis=(1, 3))
    total = np.where(known, blocks, 0.0).sum(axis=(1, 3))
    return np.divide(total, count, out=np.full(shape, np.nan), where=count > 0)


def equivalent_looks(power: ArrayLike) -> float:
    """Equivalent number of looks of an even area: its mean squared over its variance.

    One for the power of a single image of a rough surface, whose speckle is exponentially
    distributed (C. Oliver and S. Quegan, Understanding Synthetic Aperture Radar Images, 2004,
    section 4.3). What varies besides speckle lowers it.

    Parameters
    ----------
    power : array_like
        Power of the area, any shape; NaN is left out.

    Returns
    -------
    float
        Looks.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.radiometry import equivalent_looks, multilook
    >>> power = np.random.default_rng(1).exponential(size=(400, 400))  # of one image of grass
    >>> print(f'{equivalent_looks(power):.1f}, {equivalent_looks(multilook(power, (2, 2))):.1f}')
    1.0, 4.0
    """
    values = np.asarray(power, np.float64)
    known = values[np.isfinite(values)]
    return float(known.mean() ** 2 / known.var())
