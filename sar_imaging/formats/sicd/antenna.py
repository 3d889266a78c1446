"""The antenna of a SICD file: both ways together, as a polynomial over its main lobe.

In the antenna's frame x is our right, y is down and z the boresight (NGA.STND.0024-1, section 3,
Antenna). SICD has no tables: where the polynomial misses the gain, the file and the log tell by
how much. Frames that turn too quickly for polynomials of time are left out.
"""

from __future__ import annotations

import dataclasses
import logging

import numpy as np

from ...geometry.earth import Datum
from ..acquisition import Acquisition
from ..cphd.antennas.polynomials import TOLD_DB
from ..cphd.antennas.writing import WrittenAntenna

_logger = logging.getLogger(__name__)

_ORDER = 5
_TURNED = 0.05  # of the antenna's width, by which axes may depart from their polynomials


@dataclasses.dataclass(frozen=True, eq=False)
class TwoWayAntenna:
    """Polynomials of an antenna.

    Attributes
    ----------
    x_axis, y_axis : (3, n) float64
        Axes of its frame, ECEF, by powers of seconds since the start.
    gain_db : (n, n) float64
        Of both ways relative to the boresight, by powers of the direction cosines DCX and DCY.
    error_db : float
        Largest departure of that where the gain of one way is above -10 dB.
    """

    x_axis: np.ndarray
    y_axis: np.ndarray
    gain_db: np.ndarray
    error_db: float


def two_way_antenna(acquisition: Acquisition, datum: Datum,
                    pulse_s: np.ndarray) -> TwoWayAntenna | None:
    """Antenna of an acquisition; None where it tells none that SICD can hold.

    Parameters
    ----------
    acquisition : Acquisition
        With its antenna and pointing, where they are known.
    datum : Datum
        Place of the imaging frame.
    pulse_s : (P,) float64
        Times of the pulses, seconds since the start of the collection.
    """
    if acquisition.antenna is None or acquisition.pointing is None:
        return None
    try:
        own = WrittenAntenna.of(acquisition.antenna, acquisition.pointing, datum)
    except ValueError:  # no gain on boresight
        return None
    order, width = min(_ORDER, len(pulse_s) - 1), acquisition.antenna.azimuth.width_rad
    axes = []
    for values in (own.x_axis, own.y_axis):
        fits = [np.polynomial.Polynomial.fit(pulse_s, part, order) for part in values.T]
        if max(np.abs(fit(pulse_s) - part).max()
               for fit, part in zip(fits, values.T, strict=True)) > _TURNED * width:
            return None
        powers = [fit.convert().coef for fit in fits]
        axes.append(np.stack([np.pad(part, (0, order + 1 - len(part))) for part in powers]))
    lobe = own.polynomial
    if 2 * lobe.error_db > TOLD_DB:
        _logger.warning(
            'the polynomial of the antenna departs by up to %.2g dB from its gain of both ways '
            'above -20 dB, and SICD has no tables: CPHD of the pulses has one', 2 * lobe.error_db)
    return TwoWayAntenna(*axes, 2 * lobe.coefficients, 2 * lobe.error_db)


def antenna_element(own: TwoWayAntenna, carrier_hz: float) -> dict:
    """Element of the antenna."""
    return {'TwoWay': {'XAxisPoly': own.x_axis.T, 'YAxisPoly': own.y_axis.T,
                       'FreqZero': carrier_hz,
                       'Array': {'GainPoly': own.gain_db, 'PhasePoly': [[0.0]]}}}
