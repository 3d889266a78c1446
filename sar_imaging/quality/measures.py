"""Measures of a whole image: error against a reference, entropy and contrast."""

from __future__ import annotations

import numpy as np


def _difference(image, reference) -> tuple[np.ndarray, np.ndarray]:
    """Difference image and reference in double precision."""
    image, reference = np.asarray(image), np.asarray(reference)
    if image.shape != reference.shape:
        raise ValueError(f'image.shape={image.shape} does not match '
                         f'reference.shape={reference.shape}; form both on one grid')
    wide = np.result_type(image, reference, np.float64)
    return image.astype(wide) - reference, reference.astype(wide)


def _energy(values) -> float:
    """Sum of squared magnitudes in double precision."""
    values = np.asarray(values)
    return float(np.sum(np.square(values.real, dtype=float))
                 + np.sum(np.square(values.imag, dtype=float)))


def error_db(image, reference) -> float:
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


def signal_to_distortion_db(image, reference) -> float:
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


def mean_square_error(image, reference) -> float:
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


def _intensity(image) -> np.ndarray:
    """Squared magnitude in double precision."""
    image = np.asarray(image)
    intensity = (np.square(image.real, dtype=float) + np.square(image.imag, dtype=float))
    if not intensity.any():
        raise ValueError('the image is zero everywhere; its measure is undefined')
    return intensity


def entropy(image) -> float:
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


def contrast(image) -> float:
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
