"""Antenna patterns: two-way amplitude over azimuth and elevation off boresight.

The antenna's axes are boresight b, up u and right ``a = b x u``. Seen from the antenna, the unit
vector d to a point has

- azimuth ``asin(d a)``, the angle out of the plane of boresight and up, positive to the right;
- elevation ``atan2(d u, d b)``, the angle within that plane, positive upwards.

Broadside of a track so has azimuth 0 in all elevations, and azimuth alone sets the Doppler
frequency. A pattern is the product of a cut over azimuth and one over elevation; nothing behind
the antenna is lit. Widths are those of data sheets: the full angle between the half-power points
of one antenna, used to transmit and to receive. The two-way amplitude there is 1/2 of the peak,
-6 dB.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import scipy

_PADDING = 8  # times the table, for its transform
_POINTS = 1025  # of a table: a straight line between them departs by 4e-6 of the peak
_HALF_POWER = 0.44294647  # sinc^2 of this is 1/2
_EDGE = 0.2  # of a cut-off angle, over which a pattern that is not zero there falls to zero
_UNIFORM_EDGE = 0.25  # of the width, over which a uniform pattern falls
_TWO_WAY_HALF_POWER = math.sqrt(0.5)  # amplitude


@dataclasses.dataclass(frozen=True, eq=False)
class PatternCut:
    """Two-way amplitude over one angle, linear in its sine between the points of a table.

    It is zero beyond the table: pixels there take no part in an image. Images whose pattern ends
    abruptly take more time at the same error, so all constructors but `measured` end smoothly.

    Parameters
    ----------
    start, step : float
        Sine of the angle at the first point, and between points.
    amplitude : (K,) array_like
        Two-way amplitude at the points, 0 or more; its scale is kept.

    Raises
    ------
    ValueError
        There are fewer than two points, an amplitude is negative or not finite, all are zero, or
        the sines leave -1 to 1.

    Examples
    --------
    >>> import math
    >>> from sar_imaging.geometry.illumination import PatternCut
    >>> cut = PatternCut.cosine(math.radians(20.0))
    >>> print(f'{math.degrees(cut.width_rad):.1f} degrees one way')
    20.0 degrees one way
    >>> print(f'{math.degrees(cut.two_way_width_rad):.1f} degrees both ways')
    14.6 degrees both ways
    >>> cut.at([0.0, math.radians(25.0)]).round(3).tolist()
    [1.0, 0.0]
    """

    start: float
    step: float
    amplitude: np.ndarray

    def __post_init__(self):
        amplitude = np.require(self.amplitude, np.float64, ['C', 'W'])
        if (amplitude.ndim != 1 or len(amplitude) < 2 or not np.isfinite(amplitude).all()
                or amplitude.min() < 0 or amplitude.max() == 0):
            raise ValueError(f'amplitude.shape={amplitude.shape}; expected two or more finite '
                             'numbers, none negative and not all zero')
        stop = self.start + self.step * (len(amplitude) - 1)
        if not (self.step > 0 and self.start >= -1 - 1e-9 and stop <= 1 + 1e-9):
            raise ValueError(f'the table reaches from a sine of {self.start:g} to {stop:g}; '
                             'expected ascending sines between -1 and 1')
        object.__setattr__(self, 'amplitude', amplitude)

    @classmethod
    def everywhere(cls) -> PatternCut:
        """Amplitude 1 at all angles in front of the antenna."""
        return cls(-1.0, 2.0, np.ones(2))

    @classmethod
    def uniform(cls, width_rad: float, edge_rad: float | None = None) -> PatternCut:
        """Amplitude 1 within a width, 1/2 at its ends, falling as a squared cosine around them.

        Parameters
        ----------
        width_rad : float
            Full width, radians.
        edge_rad : float, optional
            Angle over which it falls from 1 to 0, radians; a quarter of the width if left out.
        """
        edge = _UNIFORM_EDGE * width_rad if edge_rad is None else edge_rad
        if not 0 < edge <= width_rad:
            raise ValueError(f'edge_rad={edge}; expected more than 0 and at most '
                             f'width_rad={width_rad}')
        return cls._even(lambda angle: _fall(angle, 0.5 * (width_rad - edge),
                                             0.5 * (width_rad + edge)),
                         width_rad, 0.5 * (width_rad + edge))

    @classmethod
    def gaussian(cls, width_rad: float, cutoff_rad: float | None = None) -> PatternCut:
        """``2 ** -(2 angle / width) ** 2`` up to a cut-off angle, 1.5 widths if left out."""
        cutoff = 1.5 * width_rad if cutoff_rad is None else cutoff_rad
        return cls._even(lambda angle: 2.0 ** -(2 * angle / width_rad) ** 2
                         * _fall(angle, (1 - _EDGE) * cutoff, cutoff), width_rad, cutoff)

    @classmethod
    def cosine(cls, width_rad: float) -> PatternCut:
        """``cos(pi angle / (2 width)) ** 2`` up to its zeros, one width off boresight."""
        return cls._even(lambda angle: np.cos(0.5 * np.pi * angle / width_rad) ** 2,
                         width_rad, width_rad)

    @classmethod
    def sinc(cls, width_rad: float, cutoff_rad: float | None = None) -> PatternCut:
        """``sinc(L sin(angle) / wavelength) ** 2`` of a uniform aperture of length L.

        Parameters
        ----------
        width_rad : float
            Full half-power width of one way, radians: 0.886 wavelengths over L.
        cutoff_rad : float, optional
            Where the pattern ends, radians; the first null if left out.
        """
        _check_angles(width_rad, width_rad)
        scale = _HALF_POWER / math.sin(0.5 * width_rad)
        null = math.asin(min(1 / scale, 1.0))
        cutoff = null if cutoff_rad is None else cutoff_rad
        smooth = null if cutoff_rad is None else (1 - _EDGE) * cutoff
        return cls._even(lambda angle: np.sinc(scale * np.sin(angle)) ** 2
                         * _fall(angle, smooth, cutoff), width_rad, cutoff)

    @classmethod
    def measured(cls, angle_rad, amplitude) -> PatternCut:
        """Table of a measured pattern, interpolated by a monotonic cubic; zero beyond its ends.

        Parameters
        ----------
        angle_rad : (N,) array_like
            Angles off boresight, ascending, within -pi/2 to pi/2, radians.
        amplitude : (N,) array_like
            Two-way amplitude there: the product of the antennas' field patterns, or the root of
            the product of their power gains.
        """
        angle, amplitude = np.asarray(angle_rad, np.float64), np.asarray(amplitude, np.float64)
        if (angle.ndim != 1 or len(angle) < 2 or angle.shape != amplitude.shape
                or not np.isfinite([angle, amplitude]).all() or (np.diff(angle) <= 0).any()
                or abs(angle).max() > math.pi / 2 or amplitude.min() < 0):
            raise ValueError(f'angle_rad.shape={angle.shape}, amplitude.shape={amplitude.shape}; '
                             'expected as many ascending angles within -pi/2 to pi/2 radians as '
                             'amplitudes, two or more, none negative')
        sine = np.linspace(*np.sin(angle[[0, -1]]), _POINTS)
        between = scipy.interpolate.PchipInterpolator(angle, amplitude)
        values = between(np.clip(np.arcsin(sine), angle[0], angle[-1]))
        return cls(float(sine[0]), float(sine[1] - sine[0]), np.maximum(values, 0.0))

    @classmethod
    def _even(cls, pattern, width_rad: float, cutoff_rad: float) -> PatternCut:
        _check_angles(width_rad, cutoff_rad)
        furthest = math.sin(cutoff_rad)
        sine = np.linspace(-furthest, furthest, _POINTS)
        amplitude = pattern(np.abs(np.arcsin(sine)))
        return cls(-furthest, float(sine[1] - sine[0]), np.maximum(amplitude, 0.0))

    @property
    def cutoff_rad(self) -> tuple[float, float]:
        """Least and largest angle that is lit, radians."""
        stop = self.start + self.step * (len(self.amplitude) - 1)
        return math.asin(max(self.start, -1.0)), math.asin(min(stop, 1.0))

    @property
    def width_rad(self) -> float:
        """Full width between the half-power points of one way, radians."""
        return self._width(0.5)

    @property
    def two_way_width_rad(self) -> float:
        """Full width between the half-power points of both ways together, radians."""
        return self._width(_TWO_WAY_HALF_POWER)

    def _width(self, share: float) -> float:
        sine = self.start + self.step * np.arange(len(self.amplitude))
        level = share * self.amplitude.max()
        above = np.flatnonzero(self.amplitude >= level)
        ends = []
        for inside, outside in ((above[0], above[0] - 1), (above[-1], above[-1] + 1)):
            place = sine[inside]
            if 0 <= outside < len(sine):
                high, low = self.amplitude[inside], self.amplitude[outside]
                place += (sine[outside] - place) * (high - level) / (high - low)
            ends.append(math.asin(min(max(place, -1.0), 1.0)))
        return ends[1] - ends[0]

    def spectrum(self) -> tuple[np.ndarray, np.ndarray]:
        """How the power of the cut's transform by the sine is distributed.

        Returns
        -------
        frequency : (K,) float64
            Ascending from 0, radians per unit of the sine.
        beyond : (K,) float64
            Share of the power beyond each frequency, either sign.
        """
        n = _PADDING * len(self.amplitude)
        power = np.abs(np.fft.rfft(self.amplitude, n)) ** 2
        power[1:] *= 2
        beyond = power[::-1].cumsum()[::-1]
        return 2 * np.pi * np.fft.rfftfreq(n, self.step), beyond / beyond[0]

    def at_sine(self, sine) -> np.ndarray:
        """Two-way amplitude by the sine of the angle, any shape."""
        place = (np.clip(sine, -1.0, 1.0) - self.start) / self.step
        last = len(self.amplitude) - 1
        inside = (place >= 0) & (place <= last)
        value = np.interp(place, np.arange(last + 1), self.amplitude)
        return np.where(inside, value, 0.0)

    def at(self, angle_rad) -> np.ndarray:
        """Two-way amplitude by the angle, radians, any shape; 0 behind the antenna."""
        angle = np.asarray(angle_rad, np.float64)
        return np.where(np.cos(angle) >= 0, self.at_sine(np.sin(angle)), 0.0)


@dataclasses.dataclass(frozen=True, eq=False)
class AntennaPattern:
    """Two-way amplitude of an antenna, or of a transmitting and a receiving one together.

    Parameters
    ----------
    azimuth : PatternCut
        Cut over azimuth.
    elevation : PatternCut
        Cut over elevation; all that is in front of the antenna if left out.

    Examples
    --------
    >>> from sar_imaging.geometry.illumination import AntennaPattern, PatternCut
    >>> pattern = AntennaPattern(PatternCut.sinc(0.02), PatternCut.cosine(0.3))
    >>> round(float(pattern.azimuth.at(0.01)), 3)
    0.5
    """

    azimuth: PatternCut
    elevation: PatternCut = dataclasses.field(default_factory=PatternCut.everywhere)

    def __post_init__(self):
        for name in ('azimuth', 'elevation'):
            if not isinstance(getattr(self, name), PatternCut):
                raise ValueError(f'{name} is a {type(getattr(self, name)).__name__}; expected a '
                                 'PatternCut, such as PatternCut.gaussian(width_rad)')

    def amplitude(self, offset_m, axes) -> np.ndarray:
        """Two-way amplitude towards points.

        Parameters
        ----------
        offset_m : (..., 3) float64
            From the antenna to the points, metres.
        axes : (..., 3, 3) float64
            The antenna's right, boresight and up, as rows; broadcast with the offsets.

        Returns
        -------
        (...) float64
            0 where the point is the antenna itself, or behind it.
        """
        right, ahead, up = np.moveaxis(np.einsum('...ij,...j->...i', axes, offset_m), -1, 0)
        distance = np.sqrt(right ** 2 + ahead ** 2 + up ** 2)
        within = np.sqrt(ahead ** 2 + up ** 2)
        lit = (ahead > 0) & (distance > 0)
        azimuth = self.azimuth.at_sine(right / np.where(lit, distance, 1.0))
        return np.where(lit, azimuth * self.elevation.at_sine(up / np.where(lit, within, 1.0)),
                        0.0)


def _check_angles(width_rad: float, cutoff_rad: float) -> None:
    if not (0 < width_rad < math.pi and 0 < cutoff_rad <= math.pi / 2):
        raise ValueError(f'a width of {width_rad:g} rad that ends {cutoff_rad:g} rad off '
                         'boresight; expected a width between 0 and pi, and an end within pi/2 '
                         'radians: give a smaller width or cutoff_rad')


def _fall(angle, start_rad: float, stop_rad: float):
    """1 up to an angle, falling to 0 at another as a squared cosine."""
    share = np.clip((angle - start_rad) / max(stop_rad - start_rad, 1e-15), 0.0, 1.0)
    return np.cos(0.5 * np.pi * share) ** 2
