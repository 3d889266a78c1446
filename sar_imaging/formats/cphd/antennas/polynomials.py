"""The main lobe of an antenna as a polynomial of direction cosines, as CPHD and SICD have it.

Least squares over Chebyshev polynomials of both cosines, at Chebyshev's nodes between the ends of
the lobe (J. P. Boyd, Chebyshev and Fourier Spectral Methods, 2nd ed., section 4.5), then powers of
the cosines. The order rises until the polynomial follows the gain above -10 dB. What is darker
counts the less, the darker it is.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial, chebyshev, polynomial

_ORDERS = range(6, 17, 2)
_WANTED_DB = 0.04  # one way; both ways then stay below 0.1 dB
_LEVEL_DB, _MAIN_LOBE_DB = -10.0, -15.0  # one way: what shall fit, and where the lobe ends
_MARGIN_DB = 0.5  # below that level, within which all counts alike
_NODES, _CHECKED, _ALONG = 41, 101, 401  # along either direction
_BORESIGHT = 1e4  # weight of the gain there, which is 0 dB to the bit
TOLD_DB = 0.1  # departure from which on it is told


@dataclasses.dataclass(frozen=True, eq=False)
class LobePolynomial:
    """Gain of one way over the main lobe.

    Attributes
    ----------
    coefficients : (n, n) float64
        Of dB relative to the boresight, by powers of DCX and DCY; none of DCX = DCY = 0.
    error_db : float
        Largest departure where the gain is above -10 dB.
    """

    coefficients: np.ndarray
    error_db: float

    @classmethod
    def of(cls, gain_db: Callable[[np.ndarray, np.ndarray], np.ndarray], cosines
           ) -> LobePolynomial:
        """Polynomial of the lowest order that follows a gain, or of the highest one.

        Parameters
        ----------
        gain_db : callable
            Gain (N, M) at direction cosines DCX (N,) and DCY (M,), dB relative to the boresight.
        cosines : two of (N,) float64
            DCX and DCY that the pattern reaches over, ascending.
        """
        nothing = np.zeros(1)
        across, down = (np.linspace(part[0], part[-1], _ALONG) for part in cosines)
        lobes = (_main_lobe(across, gain_db(across, nothing)[:, 0]),
                 _main_lobe(down, gain_db(nothing, down)[0]))
        places = [np.linspace(*lobe, _CHECKED) for lobe in lobes]
        wanted = gain_db(*places)
        bright = wanted > _LEVEL_DB
        found = []
        for order in _ORDERS:
            coefficients = _fitted(gain_db, lobes, order)
            missed = polynomial.polygrid2d(*places, coefficients) - wanted
            found.append(cls(coefficients, float(np.abs(missed[bright]).max())))
            if found[-1].error_db < _WANTED_DB:
                break
        return min(found, key=lambda one: one.error_db)


def _fitted(gain_db, lobes, order: int) -> np.ndarray:
    """(order + 1, order + 1) coefficients by powers of the direction cosines."""
    node = -np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)
    places = [0.5 * (last + first) + 0.5 * (last - first) * node for first, last in lobes]
    gain = gain_db(*places)
    used = gain > 2 * _MAIN_LOBE_DB
    weight = 10 ** (np.minimum(gain[used] - _LEVEL_DB + _MARGIN_DB, 0.0) / 10)
    matrix = chebyshev.chebvander2d(*(part[used] for part in np.meshgrid(
        node, node, indexing='ij')), [order] * 2)
    boresight = chebyshev.chebvander2d(*(
        np.array([-(first + last) / (last - first)]) for first, last in lobes), [order] * 2)
    found = np.linalg.lstsq(
        np.vstack([matrix * weight[:, None], _BORESIGHT * boresight]),
        np.append(gain[used] * weight, 0.0), rcond=None)[0].reshape(order + 1, order + 1)
    columns, rows = (_powers(lobe, order) for lobe in lobes)
    out = columns @ found @ rows.T
    out[0, 0] = 0.0
    return out


def _powers(lobe, order: int) -> np.ndarray:
    """(order + 1, order + 1) powers of a cosine, by row, of a lobe's Chebyshev polynomials."""
    out = np.zeros((order + 1, order + 1))
    for number in range(order + 1):
        powers = Chebyshev.basis(number, domain=lobe).convert(kind=Polynomial).coef
        out[:len(powers), number] = powers
    return out


def _main_lobe(cosine: np.ndarray, gain_db: np.ndarray) -> tuple[float, float]:
    """Ends of what lies around the boresight above -15 dB."""
    middle = int(np.abs(cosine).argmin())
    dark = np.flatnonzero(gain_db < _MAIN_LOBE_DB)
    before, after = dark[dark < middle], dark[dark > middle]
    return (float(cosine[before[-1] if before.size else 0]),
            float(cosine[after[0] if after.size else -1]))
