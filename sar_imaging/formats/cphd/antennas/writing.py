# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The antenna of written files: pattern as polynomials and as a table, frames of every vector.

In the antenna's frame x is our right, y is down and z the boresight, so that the direction cosine
DCX is the sine of azimuth (NGA.STND.0068-1, section 7). Gains are those of one way, dB, relative
to the boresight: the two-way amplitude is the power gain of one way.

The main lobe as a polynomial, as CPHD and SICD have it, is fitted by least squares over Chebyshev
polynomials of both cosines, at Chebyshev's nodes between the ends of the lobe (J. P. Boyd,
Chebyshev and Fourier Spectral Methods, 2nd ed., section 4.5), then powers of the cosines. The
order rises until the polynomial follows the gain above -10 dB. What is darker counts the less,
the darker it is.
"""

from __future__ import annotations

import dataclasses
import functools
import logging
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial, chebyshev, polynomial

from ....geometry.earth import Datum
from ....geometry.illumination import AntennaPattern, Pointing
from ..container import CphdError

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
        Coefficients of dB relative to the boresight, by powers of DCX and DCY; none of DCX = DCY =
        0.
    error_db : float
        Largest departure where the gain is above -10 dB.
    """

    coefficients: np.ndarray
    error_db: float

    @classmethod
    def of(cls, gain_db: Callable[[np.ndarray, np.ndarray], np.ndarray],
           cosines: Sequence[np.ndarray]) -> LobePolynomial:
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
            missed = polynomial.polygrid2d(places[0], places[1], coefficients) - wanted
            found.append(cls(coefficients, float(np.abs(missed[bright]).max())))
            if found[-1].error_db < _WANTED_DB:
                break
        return min(found, key=lambda one: one.error_db)


def _fitted(gain_db: Callable[[np.ndarray, np.ndarray], np.ndarray],
            lobes: Sequence[tuple[float, float]],
            order: int) -> np.ndarray:
    """(order + 1, order + 1) coefficients by powers of the direction cosines."""
    node = -np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)
    places = [0.5 * (last + first) + 0.5 * (last - first) * node for first, last in lobes]
    gain = gain_db(*places)
    used = gain > 2 * _MAIN_LOBE_DB
    weight = 10 ** (np.minimum(gain[used] - _LEVEL_DB + _MARGIN_DB, 0.0) / 10)
    across, down = (part[used] for part in np.meshgrid(node, node, indexing='ij'))
    matrix = chebyshev.chebvander2d(across, down, [order] * 2)
    across, down = (np.array([-(first + last) / (last - first)]) for first, last in lobes)
    boresight = chebyshev.chebvander2d(across, down, [order] * 2)
    found = np.linalg.lstsq(
        np.vstack([matrix * weight[:, None], _BORESIGHT * boresight]),
        np.append(gain[used] * weight, 0.0), rcond=None)[0].reshape(order + 1, order + 1)
    columns, rows = (_powers(lobe, order) for lobe in lobes)
    out = columns @ found @ rows.T
    out[0, 0] = 0.0
    return out


def _powers(lobe: np.ndarray | tuple[float, float], order: int) -> np.ndarray:
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


_logger = logging.getLogger(__name__)

FRAME, PHASE_CENTRE, PATTERN, TABLE = 'frame', 'phase centre', 'pattern', 'gain'
#: Parameters of the vectors, by the element that holds them.
PARAMETERS = {side: {f'{short}ACX': 'X=F8;Y=F8;Z=F8;', f'{short}ACY': 'X=F8;Y=F8;Z=F8;',
                     f'{short}EB': 'DCX=F8;DCY=F8;'}
              for side, short in (('TxAntenna', 'Tx'), ('RcvAntenna', 'Rcv'))}
TABLE_TYPE = np.dtype([('Gain', 'f4'), ('Phase', 'f4')])
DARK_DB = -120.0  # what stands for no gain at all
_POINTS = 257  # of a cut in the table
_FRAME_ORDER = 5


@dataclasses.dataclass(frozen=True, eq=False)
class WrittenAntenna:
    """An antenna in the standard's terms.

    Attributes
    ----------
    first, step : (2,) float64
        Direction cosines DCX and DCY of the table's first value, and between values.
    gain_db : (N, M) float32
        One way, relative to the boresight, by DCX and DCY.
    polynomial : LobePolynomial
        The same over the main lobe.
    x_axis, y_axis : (P, 3) float64
        Axes of the frame at each vector, ECEF.
    """

    first: np.ndarray
    step: np.ndarray
    gain_db: np.ndarray
    polynomial: LobePolynomial
    x_axis: np.ndarray
    y_axis: np.ndarray

    @classmethod
    def of(cls, pattern: AntennaPattern, pointing: Pointing, datum: Datum) -> WrittenAntenna:
        """Antenna of a pattern and its pointing.

        Raises
        ------
        CphdError
            The pattern has no gain on boresight, to which the standard refers.
        """
        if not (pattern.azimuth.at_sine(0.0) > 0 and pattern.elevation.at_sine(0.0) > 0):
            raise CphdError('the antenna has no gain on its boresight, to which CPHD refers all '
                            'gains; turn the pointing towards its main lobe')
        cuts = pattern.azimuth, pattern.elevation
        sizes = [min(len(cut.amplitude), _POINTS) for cut in cuts]
        ends = np.array([[cut.start, cut.start + cut.step * (len(cut.amplitude) - 1)]
                         for cut in cuts])
        ends[1] = -ends[1, ::-1]  # y is down
        ends = np.clip(ends, -1.0, 1.0)
        step = np.diff(ends)[:, 0] / (np.array(sizes) - 1)
        cosines = [first + gap * np.arange(n) for first, gap, n in zip(ends[:, 0], step, sizes,
                                                                      strict=True)]
        axes = pointing.axes
        gain = functools.partial(_gain_db, pattern)
        return cls(ends[:, 0], step, gain(*cosines).astype(np.float32),
                   LobePolynomial.of(gain, cosines), datum.vectors_to_ecef(axes[:, 0]),
                   datum.vectors_to_ecef(-axes[:, 2]))

    @property
    def table(self) -> np.ndarray:
        """(N, M) gain and phase, as the support array holds them."""
        out = np.zeros(self.gain_db.shape, TABLE_TYPE)
        out['Gain'] = self.gain_db
        return out

    def metadata(self, time_s: np.ndarray, carrier_hz: float) -> dict[str, Any]:
        """Element Antenna, by times of the vectors, seconds; tells what its polynomial misses."""
        if self.polynomial.error_db > TOLD_DB:
            _logger.warning(
                'the polynomial of the antenna departs by up to %.2g dB from its gain of one way '
                'above -10 dB: a reader should take the table, which follows it',
                self.polynomial.error_db)
        order = min(_FRAME_ORDER, len(time_s) - 1)
        axes = {name: np.stack([np.polynomial.Polynomial.fit(
            time_s, values[:, i], order).convert().coef for i in range(3)], axis=1)
            for name, values in (('XAxisPoly', self.x_axis), ('YAxisPoly', self.y_axis))}
        nothing = [[0.0]]
        return {
            'NumACFs': 1, 'NumAPCs': 1, 'NumAntPats': 1,
            'AntCoordFrame': [{'Identifier': FRAME, **axes, 'UseACFPVP': True}],
            'AntPhaseCenter': [{'Identifier': PHASE_CENTRE, 'ACFId': FRAME,
                                'APCXYZ': np.zeros(3)}],
            'AntPattern': [{
                'Identifier': PATTERN, 'FreqZero': float(carrier_hz),
                'EB': {'DCXPoly': [0.0], 'DCYPoly': [0.0]},
                'Array': {'GainPoly': self.polynomial.coefficients, 'PhasePoly': nothing},
                'Element': {'GainPoly': nothing, 'PhasePoly': nothing},
                'GainPhaseArray': [{'Freq': float(carrier_hz), 'ArrayId': TABLE}]}]}

    def support_array(self) -> dict[str, Any]:
        """Element SupportArray."""
        return {'AntGainPhase': [{
            'Identifier': TABLE, 'ElementFormat': 'Gain=F4;Phase=F4;', 'X0': self.first[0],
            'Y0': self.first[1], 'XSS': self.step[0], 'YSS': self.step[1]}]}

    def data(self) -> dict[str, Any]:
        """Where the table stands, for the element Data."""
        rows, columns = self.gain_db.shape
        return {'Identifier': TABLE, 'NumRows': rows, 'NumCols': columns,
                'BytesPerElement': TABLE_TYPE.itemsize, 'ArrayByteOffset': 0}


#: Identifiers of the antenna of every channel.
OF_CHANNEL = {'TxAPCId': PHASE_CENTRE, 'TxAPATId': PATTERN, 'RcvAPCId': PHASE_CENTRE,
              'RcvAPATId': PATTERN}


def _gain_db(pattern: AntennaPattern, dcx: np.ndarray, dcy: np.ndarray) -> np.ndarray:
    """(N, M) gain of one way at direction cosines, dB relative to the boresight."""
    across = np.sqrt(np.maximum(1 - dcx[:, None] ** 2, 1e-12))
    elevation = np.clip(-dcy / across, -1.0, 1.0)
    amplitude = (pattern.azimuth.at_sine(dcx)[:, None] * pattern.elevation.at_sine(elevation)
                 / (pattern.azimuth.at_sine(0.0) * pattern.elevation.at_sine(0.0)))
    with np.errstate(divide='ignore'):
        return np.maximum(10 * np.log10(amplitude), DARK_DB)
