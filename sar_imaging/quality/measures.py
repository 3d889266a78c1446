# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Measures of a whole image: error against a reference, and focus, or whether all of it is noise.

Noise, and any scene that is not focused, images as speckle: a complex Gaussian number per pixel,
whose intensity I is distributed as ``exp(-I / mean)``. Then

- the median is ``ln 2`` of the mean,
- of n pixels the brightest exceeds t means with the probability ``1 - (1 - exp(-t))^n``, about
  ``n exp(-t)``; only one image of noise in 1000 has a pixel above ``ln(1000 n)`` means,
- the contrast is 1 and the entropy ``ln n - 0.42`` (one less Euler's constant).

Neighbouring pixels are alike where an image is sampled finely: it then has fewer independent cells
than pixels, and the bound is a little higher than it need be, 0.6 dB for four pixels to a cell.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike


def _difference(image: ArrayLike, reference: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Difference image and reference in double precision."""
    image, reference = np.asarray(image), np.asarray(reference)
    if image.shape != reference.shape:
        raise ValueError(f'image.shape={image.shape} does not match '
                         f'reference.shape={reference.shape}; form both on one grid')
    wide = np.result_type(image, reference, np.float64)
    return image.astype(wide) - reference, reference.astype(wide)


def _energy(values: ArrayLike) -> float:
    """Sum of squared magnitudes in double precision."""
    values = np.asarray(values)
    return float(np.sum(np.square(values.real, dtype=float))
                 + np.sum(np.square(values.imag, dtype=float)))


def error_db(image: ArrayLike, reference: ArrayLike) -> float:
    """Error of an image: energy of its difference to a reference over that of the reference, dB.

    ``10 log10(sum |image - reference|^2 / sum |reference|^2)``; minus infinity when they agree.

    Parameters
    ----------
    image, reference : arrays of one shape, complex or float
        Image under test and reference.

    Returns
    -------
    float
        dB.

    Raises
    ------
    ValueError
        Shapes differ, or the reference is zero everywhere.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.quality import error_db
    >>> reference = np.ones((8, 8), complex)
    >>> print(f'{error_db(1.001 * reference, reference):.1f} dB')
    -60.0 dB
    """
    difference, reference = _difference(image, reference)
    signal = _energy(reference)
    if signal == 0:
        raise ValueError('the reference is zero everywhere; the error ratio is undefined')
    with np.errstate(divide='ignore'):
        return float(10 * np.log10(_energy(difference) / signal))


def signal_to_distortion_db(image: ArrayLike, reference: ArrayLike) -> float:
    """Signal to distortion ratio, decibels (Rosenberg & Gray, equation 20): ``-error_db``.

    Parameters
    ----------
    image, reference : arrays of one shape, complex or float
        Image Y under test and reference D, in the paper time-domain correlation.

    Returns
    -------
    float
        dB.

    Raises
    ------
    ValueError
        Shapes differ, or the reference is zero everywhere.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.quality import signal_to_distortion_db
    >>> reference = np.ones((8, 8), complex)
    >>> print(f'{signal_to_distortion_db(1.001 * reference, reference):.1f} dB')
    60.0 dB
    """
    return -error_db(image, reference)


def mean_square_error(image: ArrayLike, reference: ArrayLike) -> float:
    """Mean squared magnitude of the difference (Rosenberg & Gray, equation 21).

    Parameters
    ----------
    image, reference : arrays of one shape, complex or float
        Image Y under test and reference D, in the paper time-domain correlation.

    Returns
    -------
    float
        In the squared unit of the images.

    Raises
    ------
    ValueError
        Shapes differ.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.quality import mean_square_error
    >>> reference = np.ones((8, 8), complex)
    >>> print(f'{mean_square_error(1.5 * reference, reference):.2f}')
    0.25
    """
    difference, _ = _difference(image, reference)
    return _energy(difference) / difference.size


def _intensity(image: ArrayLike) -> np.ndarray:
    """Squared magnitude in double precision."""
    image = np.asarray(image)
    intensity = (np.square(image.real, dtype=float) + np.square(image.imag, dtype=float))
    if not intensity.any():
        raise ValueError('the image is zero everywhere; its measure is undefined')
    return intensity


def entropy(image: ArrayLike) -> float:
    """Shannon entropy of the intensity distribution, nats; lower means sharper.

    ``-sum p ln p`` with ``p = |f|^2 / sum |f|^2``: 0 for one bright pixel, ``ln(n_pixels)`` for
    a constant image.

    Parameters
    ----------
    image : array, complex or float
        Image.

    Returns
    -------
    float
        Nats.

    Raises
    ------
    ValueError
        The image is zero everywhere.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.quality import entropy
    >>> blurred = np.ones((4, 4), complex)
    >>> sharp = np.zeros((4, 4), complex)
    >>> sharp[1, 2] = 1.0
    >>> print(f'{entropy(blurred):.3f} nats, {entropy(sharp) + 0.0:.3f} nats')
    2.773 nats, 0.000 nats
    """
    p = _intensity(image)
    p /= p.sum()
    p = p[p > 0]
    return float(-np.sum(p * np.log(p)))


def contrast(image: ArrayLike) -> float:
    """Standard deviation of the intensity over its mean; higher means sharper.

    1 for fully developed speckle, 0 for a constant image.

    Parameters
    ----------
    image : array, complex or float
        Image.

    Returns
    -------
    float
        Without unit.

    Raises
    ------
    ValueError
        The image is zero everywhere.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.quality import contrast
    >>> rng = np.random.default_rng(1)
    >>> speckle = rng.standard_normal((100, 100)) + 1j * rng.standard_normal((100, 100))
    >>> print(f'{contrast(speckle):.2f}')
    1.00
    """
    intensity = _intensity(image)
    return float(intensity.std() / intensity.mean())


FALSE_ALARM = 1e-3  # of images of noise
_TINY = 1e-37  # keeps the logarithm of a share finite
_MOST_FOR_MEDIAN = 2**18  # pixels; of larger images every k-th, good to 0.01 dB


@dataclasses.dataclass(frozen=True)
class FocusFigure:
    """How much an image stands out from speckle.

    Parameters
    ----------
    n_pixels : int
        Pixels that hold anything: not zero.
    peak_over_median_db : float
        Brightest pixel over the median intensity, dB; 0 for an empty image.
    entropy : float
        Entropy of the intensities, nats, see `sar_imaging.quality.entropy`; 0 for an empty image.
    contrast : float
        Standard deviation of the intensity over its mean; 0 for an empty image.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.quality import focus_figure
    >>> rng = np.random.default_rng(1)
    >>> noise = rng.standard_normal((64, 64)) + 1j * rng.standard_normal((64, 64))
    >>> figure = focus_figure(noise)
    >>> print(f'peak {figure.peak_over_median_db:.1f} dB, noise reaches {figure.noise_db:.1f} dB')
    peak 10.7 dB, noise reaches 13.4 dB
    >>> figure.at_noise_level
    True
    """

    n_pixels: int
    peak_over_median_db: float
    entropy: float
    contrast: float

    @property
    def noise_db(self) -> float:
        """Peak over median that one in 1000 images of noise with these pixels exceeds, dB."""
        likely = math.log(max(self.n_pixels, 1) / FALSE_ALARM)
        return 10 * math.log10(likely / math.log(2))

    @property
    def at_noise_level(self) -> bool:
        """True when nothing stands out: the brightest pixel could be one of noise."""
        return self.peak_over_median_db <= self.noise_db

    def __str__(self) -> str:
        if not self.n_pixels:
            return 'the image is zero everywhere'
        return (f'peak {self.peak_over_median_db:.1f} dB over the median (noise: up to '
                f'{self.noise_db:.1f}), contrast {self.contrast:.3g}, entropy '
                f'{self.entropy:.2f} (noise: {math.log(self.n_pixels) - 0.42:.2f})')


def focus_figure(image: ArrayLike) -> FocusFigure:
    """Measure how well an image is focused.

    Parameters
    ----------
    image : array, complex or float
        Image; zeros are pixels that no profile reached and do not count.

    Returns
    -------
    FocusFigure

    Raises
    ------
    ValueError
        A pixel is NaN or infinite.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.quality import focus_figure
    >>> rng = np.random.default_rng(1)
    >>> image = rng.standard_normal((64, 64)) + 1j * rng.standard_normal((64, 64))
    >>> image[20, 30] += 100.0  # a scatterer
    >>> figure = focus_figure(image)
    >>> print(f'{figure.peak_over_median_db:.1f} dB above the median')
    38.7 dB above the median
    """
    image = np.asarray(image).ravel()
    with np.errstate(over='ignore', invalid='ignore'):
        intensity = np.square(image.real)
        if np.iscomplexobj(image):
            intensity += np.square(image.imag)
        total = float(intensity.sum(dtype=np.float64))
    if not math.isfinite(total):
        if bad := np.count_nonzero(~np.isfinite(image)):
            raise ValueError(f'{bad} of {image.size} pixels are NaN or infinite; look for such '
                             'numbers in samples and positions of the pulses')
        return focus_figure(image / np.abs(image).max())  # squares beyond float32
    n = int(np.count_nonzero(intensity))
    if not n:
        return FocusFigure(0, 0.0, 0.0, 0.0)
    if n < intensity.size:
        intensity = intensity[intensity > 0]
    peak = float(intensity.max())
    some = intensity[::-(-n // _MOST_FOR_MEDIAN)]
    p = intensity * (1 / total)
    square = float(np.dot(p, p))  # of the shares: (1 + contrast^2) / n
    entropy = float(-np.dot(p, np.log(p + p.dtype.type(_TINY))))
    return FocusFigure(n, 10 * math.log10(peak / float(np.median(some))), entropy,
                       math.sqrt(max(n * square - 1, 0.0)))
