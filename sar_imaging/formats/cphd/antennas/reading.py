# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The antenna of a file as our illumination: a pattern, and where it looked at each vector.

A file tells gains of one way over the direction cosines DCX and DCY of the antenna's frame, as
tables or as polynomials in dB (NGA.STND.0068-1, section 7). Ours is the product of a cut over
azimuth and one over elevation, which are those through the boresight.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy

from ....geometry.illumination import AntennaPattern, PatternCut
from ..container import Container, CphdError
from ..vectors import Vectors
from .writing import DARK_DB

_Gain = Callable[[np.ndarray, np.ndarray], np.ndarray]  # dB by DCX and DCY
_POINTS = 1025  # of a cut, of polynomials
_FLOOR_DB = -40.0  # one way: where the main lobe of a polynomial ends at the latest
_LOBE_DB = -10.0  # one way, within which a pattern should be the product of its cuts
_LARGEST_DEPARTURE_DB = 0.5
_SAME_AXES = 2e-3  # between transmit and receive antenna
_ALONG, _ACROSS = 0.9, 0.3  # cosines to the flight, of an axis y that is taken for azimuth
_STEERED = 0.2  # direction cosine of steering, beyond which a cut is stretched


@dataclasses.dataclass(frozen=True, eq=False)
class ReadAntenna:
    """Antenna of the vectors that were read.

    Attributes
    ----------
    pattern : AntennaPattern
        Two-way amplitude; the peak is 1.
    boresight, up : (P, 3) float64
        Directions at each vector, ECEF.
    warnings : list of str
        What a person should know.
    """

    pattern: AntennaPattern
    boresight: np.ndarray
    up: np.ndarray
    warnings: list[str]


@dataclasses.dataclass(frozen=True, eq=False)
class _Side:
    """Antenna of one way: frame at each vector (P, 3, 3), steering (P, 2), and its gain."""

    axes: np.ndarray
    steering: np.ndarray
    gain_db: Callable[[np.ndarray, np.ndarray], np.ndarray]
    cosines: tuple[np.ndarray, np.ndarray]


def read_antenna(container: Container, channels: tuple[str, ...],
                 vectors: Vectors) -> ReadAntenna | None:
    """Antenna of some channels; None where the file tells none.

    Raises
    ------
    CphdError
        What it tells cannot become an illumination; the text says why.
    """
    told = [_identifiers(container, name) for name in channels]
    if not any(told):
        return None
    if any(other != told[0] for other in told):
        raise CphdError('its channels have different antennas')
    pvps = container.read_pvps(channels[0])[vectors.index]
    sides = [_side(container, told[0], name, pvps) for name in ('Tx', 'Rcv')]
    warnings: list[str] = []
    axes = _common_axes(sides)
    steering = 0.5 * (sides[0].steering + sides[1].steering)
    if np.abs(steering).max() > _STEERED:
        warnings.append('the antenna is steered by a direction cosine of up to '
                        f'{np.abs(steering).max():.2f}; its pattern is turned, not stretched')
    ahead = np.sqrt(np.maximum(1 - (steering ** 2).sum(axis=1), 0.0))
    boresight = np.einsum('pa,pax->px', np.column_stack([steering, ahead]), axes)
    flight = vectors.tx_m[-1, 0] - vectors.tx_m[0, 0]
    flight = flight / max(np.linalg.norm(flight), 1e-9)
    along = np.abs(axes[:, :2] @ flight).mean(axis=0)
    exchanged = bool(along[1] > _ALONG and along[0] < _ACROSS)
    cuts = [_cut(sides, axis, reverse=axis == 1 and not exchanged) for axis in (0, 1)]
    departure = _departure_db(sides)
    if departure > _LARGEST_DEPARTURE_DB:
        warnings.append('the pattern of the antenna is no product of two cuts: images are '
                        f'weighed by one that departs by up to {departure:.1f} dB')
    up = axes[:, 0] if exchanged else -axes[:, 1]
    return ReadAntenna(AntennaPattern(*(cuts[::-1] if exchanged else cuts)), boresight, up,
                       warnings)


def _identifiers(container: Container, channel: str) -> dict[str, str]:
    for node in container.tree.findall('{*}Channel/{*}Parameters'):
        if node.findtext('{*}Identifier') == channel:
            return {child.tag.rpartition('}')[2]: child.text
                    for child in node.iterfind('{*}Antenna/*')}
    return {}


def _side(container: Container, told: dict[str, str], side: str, pvps: np.ndarray) -> _Side:
    pattern = _named(container, 'AntPattern', told.get(f'{side}APATId'))
    centre = _named(container, 'AntPhaseCenter', told.get(f'{side}APCId'))
    frame = _named(container, 'AntCoordFrame', centre.findtext('{*}ACFId'))
    names = set(pvps.dtype.names or ())
    time_s = np.asarray(pvps[f'{side}Time'] if f'{side}Time' in names
                        else pvps['TxTime'], np.float64)
    by_vector = frame.findtext('{*}UseACFPVP') in ('true', '1')
    if by_vector and {f'{side}ACX', f'{side}ACY'} <= names:
        x, y = (np.asarray(pvps[f'{side}AC{axis}'], np.float64) for axis in 'XY')
    else:
        x, y = (np.stack([_evaluated(frame.find(f'{{*}}{name}AxisPoly/{{*}}{axis}'), time_s)
                          for axis in 'XYZ'], axis=-1) for name in 'XY')
    boresight = pattern.find('{*}EB')
    if boresight.findtext('{*}UseEBPVP') in ('true', '1') and f'{side}EB' in names:
        steering = np.asarray(pvps[f'{side}EB'], np.float64)
    else:
        steering = np.stack([_evaluated(boresight.find(f'{{*}}DC{axis}Poly'), time_s)
                             for axis in 'XY'], axis=-1)
    if not (np.isfinite(steering).all() and (np.abs(steering) <= 1).all()):
        raise CphdError('its steering is no direction cosine')
    return _Side(_orthonormal(x, y), steering, *_gain(container, pattern))


def _named(container: Container, kind: str, name: str | None) -> Any:
    for node in container.tree.findall(f'{{*}}Antenna/{{*}}{kind}'):
        if name is not None and node.findtext('{*}Identifier') == name:
            return node
    raise CphdError(f'its {kind} {name!r} is not there')


def _orthonormal(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(P, 3, 3) axes x, y and z of frames."""
    lengths = np.linalg.norm([x, y], axis=-1)
    if not (np.isfinite([x, y]).all() and (lengths > 0.5).all()
            and (np.abs((x * y).sum(axis=-1)) < 0.1 * lengths.prod(axis=0)).all()):
        raise CphdError('the axes of its frame are no unit vectors at right angles')
    x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    y = y - (x * y).sum(axis=-1, keepdims=True) * x
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def _common_axes(sides: list[_Side]) -> np.ndarray:
    """Frames of both ways together, (P, 3, 3)."""
    apart = max(np.abs(sides[0].axes - sides[1].axes).max(),
                np.abs(sides[0].steering - sides[1].steering).max())
    if apart > _SAME_AXES:
        raise CphdError(f'transmit and receive antenna look {np.degrees(apart):.2g} degrees apart')
    return sides[0].axes


def _evaluated(node: Any, *at: np.ndarray) -> np.ndarray:
    """Values of a polynomial in one or two variables."""
    if node is None:
        raise CphdError('a polynomial of it is not there')
    orders = [int(node.get(f'order{axis + 1}')) for axis in range(len(at))]
    if not all(0 <= order <= 40 for order in orders):
        raise CphdError(f'a polynomial of it has the orders {orders}')
    coefficients = np.zeros([order + 1 for order in orders])
    for term in node.iterfind('{*}Coef'):
        coefficients[tuple(int(term.get(f'exponent{axis + 1}')) for axis in range(len(at)))] = (
            float(term.text))
    if not np.isfinite(coefficients).all():
        raise CphdError('a polynomial of it has coefficients that are no numbers')
    if len(at) == 1:
        return np.polynomial.polynomial.polyval(at[0], coefficients)
    return np.polynomial.polynomial.polyval2d(at[0], at[1], coefficients)


def _gain(container: Container, pattern: Any
          ) -> tuple[_Gain, tuple[np.ndarray, np.ndarray]]:
    """Gain of one way, dB, by DCX and DCY, and the direction cosines that its cuts have."""
    name = pattern.findtext('{*}Array/{*}AntGPId')
    element = pattern.findtext('{*}Element/{*}AntGPId')
    arrays = pattern.findall('{*}GainPhaseArray')
    if arrays:  # of several frequencies the one of the polynomials
        zero = float(pattern.findtext('{*}FreqZero'))
        nearest = min(arrays, key=lambda node: abs(float(node.findtext('{*}Freq')) - zero))
        name, element = (nearest.findtext(f'{{*}}{kind}Id') for kind in ('Array', 'Element'))
    if name is not None:
        table, cosines = _table(container, name)
        other = _table(container, element)[0] if element else None
        return (table if other is None else lambda x, y: table(x, y) + other(x, y)), cosines
    own, of_element = (pattern.find(f'{{*}}{kind}/{{*}}GainPoly') for kind in ('Array', 'Element'))

    def polynomial(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return _evaluated(own, x, y) + _evaluated(of_element, x, y)

    return polynomial, (_main_lobe(polynomial, 0), _main_lobe(polynomial, 1))


def _table(container: Container, name: str
           ) -> tuple[_Gain, tuple[np.ndarray, np.ndarray]]:
    """Interpolated gain of a support array, dark outside, and its direction cosines."""
    array = container.read_support_array(name)
    gain = np.asarray(array['Gain'], np.float64)
    [node] = [n for n in container.tree.findall('{*}SupportArray/{*}AntGainPhase')
              if n.findtext('{*}Identifier') == name]
    first, step = ([float(node.findtext(f'{{*}}{axis}{what}')) for axis in 'XY']
                   for what in ('0', 'SS'))
    x, y = (a + b * np.arange(n) for a, b, n in zip(first, step, gain.shape, strict=True))
    if min(gain.shape) < 2 or min(step) <= 0 or max(np.abs(x).max(), np.abs(y).max()) > 1 + 1e-9:
        raise CphdError(f'its table {name!r} has {gain.shape} gains from {first} by {step}')
    if not np.isfinite(gain).all():
        raise CphdError(f'its table {name!r} has gains that are no numbers')
    gain = np.where(gain <= DARK_DB + 1, -np.inf, gain)
    between = scipy.interpolate.RegularGridInterpolator(
        (x, y), 10 ** (gain / 10), bounds_error=False, fill_value=0.0)

    def at(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        with np.errstate(divide='ignore'):
            return 10 * np.log10(between(np.stack(np.broadcast_arrays(x, y), axis=-1)))

    return at, (x, y)


def _main_lobe(gain_db: Callable[[np.ndarray, np.ndarray], np.ndarray], axis: int) -> np.ndarray:
    """Direction cosines along an axis out to where polynomials end to fall."""
    cosine = np.linspace(-1.0, 1.0, 2 * _POINTS - 1)
    zero = np.zeros_like(cosine)
    gain = gain_db(cosine, zero) if axis == 0 else gain_db(zero, cosine)
    if np.ptp(gain) < 0.01:
        return np.array([-1.0, 1.0])
    middle = len(cosine) // 2
    ends = []
    for sense in (-1, 1):
        outward = gain[middle::sense]
        stop = np.flatnonzero((np.diff(outward) > 0) & (outward[:-1] < -3.0)
                              | (outward[:-1] < _FLOOR_DB))
        ends.append(middle + sense * int(stop[0] if stop.size else len(outward) - 1))
    return np.linspace(cosine[ends[0]], cosine[ends[1]], _POINTS)


def _cut(sides: list[_Side], axis: int, *, reverse: bool) -> PatternCut:
    """Two-way amplitude along an axis of the frame through the boresight, its peak 1."""
    ends = [(side.cosines[axis][0], side.cosines[axis][-1]) for side in sides]
    first, last = max(a for a, _ in ends), min(b for _, b in ends)
    n = max(len(side.cosines[axis]) for side in sides)
    if not (first < 0 < last):
        raise CphdError('its gain does not reach around the boresight')
    cosine = np.linspace(first, last, n)
    gain = np.sum([side.gain_db(*_on_axis(cosine, axis)) for side in sides], axis=0)
    amplitude = 10 ** (gain / 20)
    if not (np.isfinite(amplitude).all() and amplitude.max() > 0):
        raise CphdError('its gain is no number on the boresight, or none')
    amplitude = amplitude / amplitude.max()
    if 2 < n < _POINTS:  # as tables of measured patterns are
        cosine, coarse = np.linspace(first, last, _POINTS), cosine
        amplitude = scipy.interpolate.PchipInterpolator(coarse, amplitude)(cosine)
        amplitude = np.maximum(amplitude, 0.0)  # by rounding
    step = (last - first) / (len(cosine) - 1)
    return PatternCut(float(-last if reverse else first), float(step),
                      amplitude[::-1] if reverse else amplitude)


def _on_axis(cosine: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    zero = np.zeros_like(cosine)
    return (cosine, zero) if axis == 0 else (zero, cosine)


def _departure_db(sides: list[_Side]) -> float:
    """Largest departure of the main lobe of one way from the product of its cuts, dB."""
    worst = 0.0
    for side in sides:
        x, y = (np.linspace(c[0], c[-1], 65) for c in side.cosines)
        column, row = (side.gain_db(*_on_axis(part, axis)) for axis, part in enumerate((x, y)))
        middle = float(side.gain_db(np.zeros(1), np.zeros(1))[0])
        lobes = [part[values > middle + _LOBE_DB] for part, values in ((x, column), (y, row))]
        if min(map(len, lobes)) < 3:
            continue
        places = np.meshgrid(*lobes, indexing='ij')
        real = places[0] ** 2 + places[1] ** 2 < 0.9
        # elevation is counted within the plane of boresight and up
        elevation = places[1][real] / np.sqrt(1 - places[0][real] ** 2)
        product = (side.gain_db(*_on_axis(places[0][real], 0))
                   + side.gain_db(*_on_axis(elevation, 1)) - middle)
        found = side.gain_db(places[0][real], places[1][real])
        known = np.isfinite(product) & np.isfinite(found)
        if known.any():
            worst = max(worst, float(np.abs(product - found)[known].max()))
    return worst
