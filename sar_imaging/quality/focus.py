"""Focus of an image in three figures, and whether anything in it stands out from noise.

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
        Of the intensities, nats, see `sar_imaging.quality.entropy`; 0 for an empty image.
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


def focus_figure(image) -> FocusFigure:
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
