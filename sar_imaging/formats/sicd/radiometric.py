"""SICD's scale factors: polynomials that turn the power of pixels into calibrated brightness.

The power of a pixel times the polynomial's value at its place is the quantity (NGA.STND.0024-1,
section 3, Radiometric). The polynomials are fitted to `sar_imaging.radiometry` at 33 x 33 pixels.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ...imaging.image import Image
from ...radiometry import (
    ImageResponse,
    KnotResponse,
    RadarConstant,
    brightness,
    noise_equivalent,
)
from ...radiometry.brightness import quantities_of
from .layout import Layout

_KNOTS = 33  # along a side of the image
_HIGHEST_ORDER = 6
_WANTED_DB, _LARGEST_DB = 0.002, 0.05  # residual at which to stop, and above which to refuse
_LIT = 0.1  # of the largest amplitude: what is darker is not fitted
_NAMES = {'rcs': 'RCSSFPoly', 'sigma0': 'SigmaZeroSFPoly', 'beta0': 'BetaZeroSFPoly',
          'gamma0': 'GammaZeroSFPoly'}


@dataclasses.dataclass(frozen=True, eq=False)
class Radiometric:
    """Polynomials by metres from the scene centre point along rows and columns.

    Attributes
    ----------
    factors : dict of str to (n, n) float64
        By quantity, for the power of SICD's pixels; those of the ground not in the slant plane.
    noise_db : (n, n) float64 or None
        Power of noise in a pixel, dB; None where it is not known.
    residual_db : float
        Largest departure from what was fitted, dB.
    """

    factors: dict[str, np.ndarray]
    noise_db: np.ndarray | None
    residual_db: float


def radiometric(image: Image, layout: Layout, response: ImageResponse | KnotResponse,
                constant: RadarConstant, scale: float | None) -> Radiometric:
    """Scale factors of an image, calibrated or not.

    Parameters
    ----------
    image : Image
        Its `radiometry` tells whether its samples are calibrated already.
    layout : Layout
        Of the image.
    response : ImageResponse or KnotResponse
        Of the same pixels, or of some of them.
    constant : RadarConstant
        Of the radar.
    scale : float or None
        What samples were multiplied by in the file.

    Raises
    ------
    ValueError
        The response is of another image, or varies too much for polynomials.
    """
    some, index = _knots(response)
    shape = tuple(int(part.max()) + 1 for part in index)
    if shape != image.shape:
        raise ValueError(f'the response is for an image of {shape}, this one has {image.shape}; '
                         'expected that of the image')
    unit = {name: brightness(np.ones(some.amplitude.shape), some, constant, name)
            for name in quantities_of(some)}
    told = image.radiometry
    noise = noise_equivalent(some, constant, 'rcs') / unit['rcs']  # of a sample as formed
    stored = 1.0 if scale is None else scale**2
    if told is not None:
        if abs(told.gain_m / constant.gain - 1) > 1e-6:
            raise ValueError(f'the image was calibrated with gain {told.gain_m:g}, the constant '
                             f'has {constant.gain:g}; expected the same constant')
        noise = noise * unit[told.quantity]
        unit = {name: value / unit[told.quantity] for name, value in unit.items()}
    fit = _Fit(layout, image.grid.positions(*index)
               - layout.scp_m, some.amplitude > _LIT * np.nanmax(some.amplitude))
    factors = {name: fit(value / stored) for name, value in unit.items()}
    known = np.isfinite(constant.noise_power) and constant.noise_power > 0
    noise_db = fit.decibels(10 * np.log10(noise * stored)) if known else None
    if fit.residual_db > _LARGEST_DB:
        raise ValueError(
            f'the scale factors vary so much over the image that polynomials miss them by '
            f'{fit.residual_db:.2g} dB: calibrate the image (sar_imaging.radiometry.calibrated) '
            'before it is written, then its factors are smooth; or write a smaller one')
    return Radiometric(factors, noise_db, fit.residual_db)


def _knots(response: ImageResponse | KnotResponse) -> tuple[ImageResponse, tuple]:
    """Response at some pixels, and their rows (K_y, 1) and columns (1, K_x)."""
    if isinstance(response, KnotResponse):
        return response.values, np.ix_(response.rows, response.columns)
    index = np.ix_(*(np.unique(np.linspace(0, n - 1, min(n, _KNOTS)).round().astype(int))
                     for n in response.amplitude.shape))
    return ImageResponse(**{field.name: getattr(response, field.name)[index]
                            for field in dataclasses.fields(response)}), index


class _Fit:
    """Fits polynomials of as low an order as leaves 0.002 dB; keeps the largest residual."""

    def __init__(self, layout: Layout, offset_m: np.ndarray, lit: np.ndarray):
        self._lit = lit
        places = offset_m[lit] @ layout.axes.T
        self._scales = np.maximum(np.abs(places).max(axis=0), 1e-3)
        self._places = places / self._scales
        self.residual_db = 0.0

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """(n, n) coefficients for positive values, whose relative error counts."""
        return self._fitted(values[self._lit], relative=True)

    def decibels(self, values: np.ndarray) -> np.ndarray:
        """(n, n) coefficients for values in dB."""
        return self._fitted(values[self._lit], relative=False)

    def _fitted(self, values: np.ndarray, *, relative: bool) -> np.ndarray:
        for order in range(_HIGHEST_ORDER + 1):
            n = order + 1
            matrix = np.polynomial.polynomial.polyvander2d(*self._places.T, [order] * 2)
            weight = 1 / values if relative else np.ones(len(values))
            found = np.linalg.lstsq(matrix * weight[:, None], values * weight, rcond=None)[0]
            ratio = np.maximum(matrix @ found * weight, 1e-9)
            missed_db = np.abs(10 * np.log10(ratio) if relative
                               else matrix @ found - values).max()
            if missed_db < _WANTED_DB:
                break
        self.residual_db = max(self.residual_db, float(missed_db))
        powers = np.arange(n)
        return found.reshape(n, n) / np.multiply.outer(self._scales[0] ** powers,
                                                       self._scales[1] ** powers)


def radiometric_element(own: Radiometric) -> dict:
    """Element of the scale factors."""
    noise = {} if own.noise_db is None else {'NoiseLevel': {
        'NoiseLevelType': 'ABSOLUTE', 'NoisePoly': own.noise_db}}
    return {**noise, **{_NAMES[name]: factor for name, factor in own.factors.items()}}
