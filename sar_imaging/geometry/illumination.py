# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Which points a radar lights, and how brightly: antenna patterns and their pointing by pulse.

Images with illumination are ``f(x) = sum_m sum_n w_mn(x) s_mn(D_mn(x)) exp(+j k_c D_mn(x))``, with
the two-way amplitude w_mn(x) of pulse m and channel n towards the point x, seen from the middle
between the channel's phase centres. Points that a pulse does not light take no part.

- `AntennaPattern`: amplitude over azimuth and elevation off boresight;
- `Pointing`: boresight and up direction of each pulse;
- `Illumination`: both together, for the echoes of some pulses.

`geometry.antenna` has both in degrees, as data sheets, parameter files and recordings tell them.

The antenna's axes are boresight b, up u and right ``a = b x u``. Seen from the antenna, the unit
vector d to a point has

- azimuth ``asin(d a)``, the angle out of the plane of boresight and up, positive to the right;
- elevation ``atan2(d u, d b)``, the angle within that plane, positive upwards.

Broadside of a track so has azimuth 0 in all elevations, and azimuth alone sets the Doppler
frequency. A pattern is the product of a cut over azimuth and one over elevation; nothing behind
the antenna is illuminated. Widths are those of data sheets: the full angle between the half-power
points of one antenna, used to transmit and to receive. The two-way amplitude there is 1/2 of the
peak, -6 dB.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, final

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..names import moved
from .half_paths import Paths

__getattr__ = moved(__name__, 'sar_imaging.geometry.antenna', ('Antenna', 'Mount'))

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

    def __post_init__(self) -> None:
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
    def measured(cls, angle_rad: ArrayLike, amplitude: ArrayLike) -> PatternCut:
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
        sine = np.linspace(np.sin(angle[0]), np.sin(angle[-1]), _POINTS)
        between = scipy.interpolate.PchipInterpolator(angle, amplitude)
        values = between(np.clip(np.arcsin(sine), angle[0], angle[-1]))
        return cls(float(sine[0]), float(sine[1] - sine[0]), np.maximum(values, 0.0))

    @classmethod
    def _even(cls, pattern: Callable[[np.ndarray], np.ndarray], width_rad: float,
              cutoff_rad: float) -> PatternCut:
        _check_angles(width_rad, cutoff_rad)
        furthest = math.sin(cutoff_rad)
        sine = np.linspace(-furthest, furthest, _POINTS)
        amplitude = pattern(np.abs(np.arcsin(sine)))
        return cls(-furthest, float(sine[1] - sine[0]), np.maximum(amplitude, 0.0))

    @property
    def cutoff_rad(self) -> tuple[float, float]:
        """Least and largest angle that is illuminated, radians."""
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

    def at_sine(self, sine: float | np.ndarray) -> np.ndarray:
        """Two-way amplitude by the sine of the angle, any shape."""
        place = (np.clip(sine, -1.0, 1.0) - self.start) / self.step
        last = len(self.amplitude) - 1
        inside = (place >= 0) & (place <= last)
        value = np.interp(place, np.arange(last + 1), self.amplitude)
        return np.where(inside, value, 0.0)

    def at(self, angle_rad: ArrayLike) -> np.ndarray:
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

    def __post_init__(self) -> None:
        for name in ('azimuth', 'elevation'):
            if not isinstance(getattr(self, name), PatternCut):
                raise ValueError(f'{name} is a {type(getattr(self, name)).__name__}; expected a '
                                 'PatternCut, such as PatternCut.gaussian(width_rad)')

    def amplitude(self, offset_m: np.ndarray, axes: np.ndarray) -> np.ndarray:
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
        x, y, z = offset_m[..., 0], offset_m[..., 1], offset_m[..., 2]
        # a fifth of the time of einsum, which is slow at sums of three
        right, ahead, up = (axes[..., i, 0] * x + axes[..., i, 1] * y + axes[..., i, 2] * z
                            for i in range(3))
        distance = np.sqrt(right ** 2 + ahead ** 2 + up ** 2)
        within = np.sqrt(ahead ** 2 + up ** 2)
        in_front = (ahead > 0) & (distance > 0)
        azimuth = self.azimuth.at_sine(right / np.where(in_front, distance, 1.0))
        elevation = self.elevation.at_sine(up / np.where(in_front, within, 1.0))
        return np.where(in_front, azimuth * elevation, 0.0)


def _check_angles(width_rad: float, cutoff_rad: float) -> None:
    if not (0 < width_rad < math.pi and 0 < cutoff_rad <= math.pi / 2):
        raise ValueError(f'a width of {width_rad:g} rad that ends {cutoff_rad:g} rad off '
                         'boresight; expected a width between 0 and pi, and an end within pi/2 '
                         'radians: give a smaller width or cutoff_rad')


def _fall(angle: np.ndarray, start_rad: float, stop_rad: float) -> np.ndarray:
    """1 up to an angle, falling to 0 at another as a squared cosine."""
    share = np.clip((angle - start_rad) / max(stop_rad - start_rad, 1e-15), 0.0, 1.0)
    return np.cos(0.5 * np.pi * share) ** 2


_UP = (0.0, 0.0, 1.0)
_LEAST_SINE = 1e-6  # between boresight and up
_UNIT_TOLERANCE = 1e-6  # of vectors that went through messages
_NEIGHBOURS = 8  # pulses on either side that tell the direction of the track


@dataclasses.dataclass(frozen=True, eq=False)
class Pointing:
    """Directions of an antenna for each pulse, in the imaging frame.

    Parameters
    ----------
    boresight : (P, 3) array_like
        Where the antenna looks; of any length but zero, kept as unit vectors, float64.
    up : (P, 3) or (3,) array_like
        Its upward direction, to which elevation is counted; what of it is along the boresight is
        taken off. The frame's z axis if left out.

    Raises
    ------
    ValueError
        Shapes disagree, a number is not finite, or a boresight has no length or runs along up.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.geometry.illumination import Pointing
    >>> track = np.array([[0.0, -5.0, 40.0], [0.0, 0.0, 40.0], [0.0, 5.0, 40.0]])
    >>> spotlight = Pointing.steered(track, target_m=(30.0, 0.0, 0.0))
    >>> spotlight.boresight[1].round(3).tolist()
    [0.6, 0.0, -0.8]
    >>> stripmap = Pointing.beside_track(track, side=-1, depression_rad=np.radians(45.0))
    >>> stripmap.boresight[1].round(3).tolist()
    [0.707, 0.0, -0.707]
    """

    boresight: np.ndarray
    up: np.ndarray = _UP  # type: ignore[assignment]  # broadcast at once

    def __post_init__(self) -> None:
        boresight = np.asarray(self.boresight, np.float64)
        if boresight.ndim != 2 or boresight.shape[1] != 3:
            raise ValueError(f'boresight.shape={boresight.shape}; expected (P, 3), one direction '
                             'for each pulse')
        up = np.asarray(self.up, np.float64)
        if up.shape not in ((3,), boresight.shape):
            raise ValueError(f'up.shape={up.shape}; expected (3,) or {boresight.shape}, as the '
                             'boresight has')
        up = np.broadcast_to(up, boresight.shape)
        if not (np.isfinite(boresight).all() and np.isfinite(up).all()):
            raise ValueError('boresight or up contain NaN or infinity')
        length = np.linalg.norm(boresight, axis=1, keepdims=True)
        if len(length) and length.min() == 0:
            raise ValueError(f'boresight of pulse {int(length.argmin())} has no length')
        boresight = boresight / length
        up = up - np.einsum('pk,pk->p', up, boresight)[:, None] * boresight
        length = np.linalg.norm(up, axis=1, keepdims=True)
        if len(length) and length.min() < _LEAST_SINE:
            raise ValueError(f'pulse {int(length.argmin())} looks along its up direction; pass '
                             'another up, such as the direction of flight')
        object.__setattr__(self, 'boresight', np.ascontiguousarray(boresight))
        object.__setattr__(self, 'up', np.ascontiguousarray(up / length))

    @classmethod
    def fixed(cls, attitude: scipy.spatial.transform.Rotation | ArrayLike,
              boresight_body: ArrayLike, up_body: ArrayLike = _UP) -> Pointing:
        """An antenna bolted to the platform.

        Parameters
        ----------
        attitude : scipy.spatial.transform.Rotation or (P, 4) array_like
            Turns body vectors into the imaging frame at each pulse; quaternions are x, y, z, w.
        boresight_body, up_body : (3,) array_like
            Directions of the antenna in the body's frame.
        """
        rotation = scipy.spatial.transform.Rotation  # loaded when the first one is needed
        if not isinstance(attitude, rotation):
            quaternions = np.asarray(attitude, np.float64)
            if (quaternions.ndim != 2 or quaternions.shape[1] != 4
                    or not np.isfinite(quaternions).all()
                    or not np.allclose(np.linalg.norm(quaternions, axis=1), 1, atol=0.01)):
                raise ValueError(f'attitude.shape={quaternions.shape}; expected (P, 4) unit '
                                 'quaternions x, y, z, w')
            attitude = rotation.from_quat(quaternions)
        return cls(np.atleast_2d(attitude.apply(np.asarray(boresight_body, np.float64))),
                   np.atleast_2d(attitude.apply(np.asarray(up_body, np.float64))))

    @classmethod
    def beside_track(cls, centre_m: ArrayLike, side: int, depression_rad: float = 0.0,
                     squint_rad: float = 0.0) -> Pointing:
        """Beside the direction of flight, as stripmap radars look.

        Parameters
        ----------
        centre_m : (P, 3) array_like
            Phase centres in the order of the pulses, metres. The direction of flight is that
            between the eighth neighbours, horizontally.
        side : int
            +1 to the left of the track, -1 to the right.
        depression_rad : float
            Below the horizon, radians.
        squint_rad : float
            From broadside, a right angle to the flight, radians; positive ahead.

        Raises
        ------
        ValueError
            The side is another number, or the platform does not move.
        """
        if side not in (-1, 1):
            raise ValueError(f'side={side}; expected +1 (left of the track) or -1 (right)')
        centre = _centres(centre_m)
        number = np.arange(len(centre))
        after = np.minimum(number + _NEIGHBOURS, len(centre) - 1)
        moved = (centre[after] - centre[np.maximum(number - _NEIGHBOURS, 0)])[:, :2]
        length = np.linalg.norm(moved, axis=1)
        if not len(centre) or length.min() == 0:
            raise ValueError('the platform does not move all the time, so that its track has no '
                             'direction; use Pointing.fixed with its attitude')
        along = moved / length[:, None]
        across = side * np.stack([-along[:, 1], along[:, 0]], axis=1)
        level = math.cos(squint_rad) * across + math.sin(squint_rad) * along
        down = np.full((len(centre), 1), -math.sin(depression_rad))
        return cls(np.concatenate([math.cos(depression_rad) * level, down], axis=1))

    @classmethod
    def steered(cls, centre_m: ArrayLike, target_m: ArrayLike, up: ArrayLike = _UP) -> Pointing:
        """To one point all the time, as spotlight radars look.

        Parameters
        ----------
        centre_m : (P, 3) array_like
            Phase centres, metres.
        target_m : (3,) array_like
            The point, metres.
        up : (3,) or (P, 3) array_like
            As of `Pointing`.
        """
        return cls(np.asarray(target_m, np.float64) - _centres(centre_m), np.asarray(up))

    @classmethod
    def rotating(cls, time_s: ArrayLike, rate_rad_per_s: float, start_rad: float = 0.0,
                 depression_rad: float = 0.0) -> Pointing:
        """Around the frame's z axis at an even rate, as scanning radars and arcs look.

        Parameters
        ----------
        time_s : (P,) array_like
            Times of the pulses, seconds.
        rate_rad_per_s : float
            Counterclockwise seen from above, radians per second.
        start_rad : float
            Direction at time 0, counterclockwise from x, radians.
        depression_rad : float
            Below the horizon, radians.
        """
        angle = start_rad + rate_rad_per_s * np.asarray(time_s, np.float64)
        level = math.cos(depression_rad)
        return cls(np.stack([level * np.cos(angle), level * np.sin(angle),
                             np.full_like(angle, -math.sin(depression_rad))], axis=-1))

    def __len__(self) -> int:
        return len(self.boresight)

    @property
    def axes(self) -> np.ndarray:
        """(P, 3, 3) float64 right, boresight and up of the antenna, as rows."""
        (x, y, z), (a, b, c) = self.boresight.T, self.up.T
        axes = np.empty((len(self), 3, 3))
        # their vector product; that of NumPy takes longer than all else about a sub-aperture
        axes[:, 0, 0], axes[:, 0, 1], axes[:, 0, 2] = y * c - z * b, z * a - x * c, x * b - y * a
        axes[:, 1], axes[:, 2] = self.boresight, self.up
        return axes

    def select(self, index: Any) -> Pointing:
        """Pulses at `index` (slice, mask or integers)."""
        return self._of_unit_vectors(self.boresight[index], self.up[index])

    def same_as(self, other: Pointing | None) -> bool:
        """Whether all directions are those of another one."""
        return (other is not None and np.array_equal(self.boresight, other.boresight)
                and np.array_equal(self.up, other.up))

    @classmethod
    def join(cls, parts: Sequence[Pointing]) -> Pointing:
        """Those of several runs of pulses, one after the other."""
        return cls._of_unit_vectors(np.concatenate([p.boresight for p in parts]),
                                    np.concatenate([p.up for p in parts]))

    @classmethod
    def of_unit_vectors(cls, boresight: ArrayLike, up: ArrayLike) -> Pointing:
        """From (P, 3) perpendicular unit vectors, kept to the bit, as messages carry them.

        Raises
        ------
        ValueError
            A length differs from 1, or an angle from 90 degrees, by more than 1e-6.
        """
        boresight, up = (np.asarray(a, np.float64) for a in (boresight, up))
        for departure in ((boresight ** 2).sum(axis=1) - 1, (up ** 2).sum(axis=1) - 1,
                          (boresight * up).sum(axis=1)):
            if not (abs(departure) < _UNIT_TOLERANCE).all():
                raise ValueError('boresight and up are no perpendicular unit vectors, by '
                                 f'{abs(departure).max():.3g}; expected the axes of an antenna')
        return cls._of_unit_vectors(boresight, up)

    @classmethod
    def _of_unit_vectors(cls, boresight: ArrayLike, up: ArrayLike) -> Pointing:
        """Kept to the bit: plans are for directions that are compared."""
        found = object.__new__(cls)
        object.__setattr__(found, 'boresight', np.ascontiguousarray(boresight))
        object.__setattr__(found, 'up', np.ascontiguousarray(up))
        return found


def _centres(centre_m: ArrayLike) -> np.ndarray:
    centre = np.asarray(centre_m, np.float64)
    if centre.ndim != 2 or centre.shape[1] != 3 or not np.isfinite(centre).all():
        raise ValueError(f'centre_m.shape={centre.shape}; expected (P, 3) finite positions, one '
                         'for each pulse, metres')
    return centre


_TAIL = np.geomspace(2.0, 100.0, 25)  # times the rms frequency
_STEP = 0.002  # of the illuminated angle, for a derivative


@dataclasses.dataclass(frozen=True)
class AmplitudeSpread:
    """How quickly the amplitude of echoes changes along a direction.

    Attributes
    ----------
    rms : float
        Root mean square frequency, radians per unit of the direction.
    frequency, share : (J,) floats
        The faint rest, what lies around some far higher frequencies of either sign: these, and the
        share of the power.
    by_echo : (R,) float64 or None
        What each echo has of that rest, over the mean: echoes of which the pattern ends among the
        points have most, and often the highest local frequencies as well. None where all are
        alike.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.geometry.illumination import (
    ...     NO_SPREAD, AmplitudeSpread, AntennaPattern, Illumination, PatternCut, Pointing)
    >>> centre = np.zeros((4, 1, 3))
    >>> pointing = Pointing.steered(centre[:, 0], (0.0, 50.0, 0.0))
    >>> seen = Illumination.of_pulses(AntennaPattern(PatternCut.gaussian(0.2)), pointing,
    ...                               centre, centre)
    >>> spread = seen.spread(np.array([[3.0, 50.0, 0.0]]), np.array([[1.0, 0.0, 0.0]]))
    >>> print(f'{spread.rms:.2f} rad/m across the beam, 50 m away')
    0.17 rad/m across the beam, 50 m away
    >>> AmplitudeSpread(0.0) == NO_SPREAD  # an amplitude that is the same everywhere
    True
    """

    rms: float
    frequency: tuple[float, ...] = ()
    share: tuple[float, ...] = ()
    by_echo: np.ndarray | None = dataclasses.field(default=None, compare=False)


NO_SPREAD = AmplitudeSpread(0.0)


@final  # it is never false
@dataclasses.dataclass(frozen=True, eq=False)
class Illumination:
    """Two-way amplitude of echoes, one of each pulse and channel, towards any point.

    Parameters
    ----------
    pattern : AntennaPattern
        Pattern of all echoes.
    centre_m : (R, 3) float64
        Where each is seen from: the middle between its phase centres, metres.
    axes : (R, 3, 3) float64
        The antenna's right, boresight and up at each, as rows.
    foreseen : bool
        The pulses are still to come: any of them may light any point.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.geometry.illumination import (
    ...     AntennaPattern, Illumination, PatternCut, Pointing)
    >>> centre = np.zeros((2, 1, 3))
    >>> centre[1, 0, 0] = 30.0  # two pulses, 30 m apart along x
    >>> pointing = Pointing.beside_track(centre[:, 0], side=1)
    >>> seen = Illumination.of_pulses(AntennaPattern(PatternCut.uniform(0.2)), pointing,
    ...                               centre, centre)
    >>> seen.amplitude([[0.0, 100.0, 0.0], [30.0, 100.0, 0.0]]).round(2).tolist()
    [[1.0, 0.0], [0.0, 1.0]]
    """

    pattern: AntennaPattern
    centre_m: np.ndarray
    axes: np.ndarray
    foreseen: bool = False

    @classmethod
    def of_pulses(cls, pattern: AntennaPattern, pointing: Pointing | None, tx_m: ArrayLike,
                  rx_m: np.ndarray, *, foreseen: bool = False) -> Illumination:
        """Illumination by pulses with phase centres (P, C, 3), metres, pulse by pulse.

        Raises
        ------
        ValueError
            There is no pointing, or it is for another number of pulses.
        """
        if pointing is None:
            raise ValueError('illumination needs to know where the antenna looked at each pulse; '
                             'set pointing of the PulseBlock, for instance to '
                             'Pointing.beside_track(block.phase_centre_m, side)')
        centre = 0.5 * (np.asarray(tx_m, np.float64) + rx_m)
        if len(pointing) != len(centre):
            raise ValueError(f'the pointing is for {len(pointing)} pulses, there are '
                             f'{len(centre)}; give every pulse its boresight')
        return cls(pattern, np.ascontiguousarray(centre.reshape(-1, 3)),
                   np.repeat(pointing.axes, centre.shape[1], axis=0), foreseen)

    @property
    def n_bytes(self) -> int:
        """Memory of the positions and axes, bytes."""
        return self.centre_m.nbytes + self.axes.nbytes

    def select(self, rows: Any) -> Illumination:
        """Some of the echoes, by slice, mask or integers."""
        return Illumination(self.pattern, self.centre_m[rows], self.axes[rows], self.foreseen)

    def lights(self, points_m: np.ndarray) -> np.ndarray | None:
        """(R, S) bool which points (S, 3), metres, each echo lights; None where all may be."""
        illuminated = None if self.foreseen else self.amplitude(points_m) > 0
        return illuminated if illuminated is not None and illuminated.any() else None

    def may_light(self, points_m: np.ndarray, shape: tuple[int, ...]) -> np.ndarray | None:
        """(R, S) bool which points of a mesh bound a cell of it that an echo may light.

        Points (S, 3), metres, are a mesh of `shape`. The directions beyond one end of a pattern,
        and those behind the antenna, form convex cones: where all corners of a flat cell lie in
        one of them, it is dark. None where all may be illuminated, or none is.
        """
        if self.foreseen:
            return None
        cells = self.dark_cones(points_m).reshape(-1, *shape)
        axes = range(1, cells.ndim)
        for axis in axes:
            before, after = (np.take(cells, np.arange(cells.shape[axis] - 1) + i, axis)
                             for i in (0, 1))
            cells = before & after
        illuminated = cells == 0
        for axis in axes:
            beyond = [(0, 0)] * illuminated.ndim
            beyond[axis] = (1, 1)
            wider = np.pad(illuminated, beyond)
            illuminated = np.logical_or(*(
                np.take(wider, np.arange(wider.shape[axis] - 1) + i, axis) for i in (0, 1)))
        return illuminated.reshape(len(illuminated), -1) if illuminated.any() else None

    def dark_cones(self, points_m: np.ndarray) -> np.ndarray:
        """(R, S) uint8 in which of the cones beyond ends of the pattern points lie, bit by bit."""
        right, ahead, up = np.einsum('rij,rsj->irs', self.axes,
                                     points_m - self.centre_m[:, None])
        distance = np.sqrt(right ** 2 + ahead ** 2 + up ** 2)
        (first, last), (low, high) = (np.sin(cut.cutoff_rad) for cut in (
            self.pattern.azimuth, self.pattern.elevation))
        # a cone wider than half of all directions is not convex
        cones = (ahead <= 0, right > max(last, 0.0) * distance, right < min(first, 0.0) * distance,
                 up * math.sqrt(1 - high ** 2) > ahead * high,
                 up * math.sqrt(1 - low ** 2) < ahead * low)
        return sum(cone.astype(np.uint8) << bit for bit, cone in enumerate(cones))

    def of_paths(self, paths: Paths, points_m: np.ndarray) -> Paths:
        """Paths of the echoes to points (S, 3), metres, that know which of these they light."""
        return dataclasses.replace(paths, illuminated=self.lights(points_m))

    def spread(self, points_m: np.ndarray, direction_m: np.ndarray) -> AmplitudeSpread:
        """Frequencies of the amplitudes along a direction, radians per unit of it.

        Parameters
        ----------
        points_m, direction_m : (S, 3) float64
            Points, metres, and by how much they move per unit of the direction, metres.
        """
        reach = np.diff(self.pattern.azimuth.cutoff_rad)[0]
        distance = np.linalg.norm(points_m - self.centre_m.mean(axis=0), axis=1, keepdims=True)
        step = _STEP * reach * distance / np.linalg.norm(direction_m, axis=1, keepdims=True)
        ahead, behind = (self.amplitude(points_m + sign * step * direction_m) for sign in (1, -1))
        power = np.mean((ahead + behind) ** 2)
        slope = (ahead - behind) / step[:, 0]
        rms = float(np.sqrt(np.mean(slope ** 2) / power)) if power > 0 else 0.0
        if rms == 0:
            return NO_SPREAD
        # Along direction cosines of the track the sine of azimuth grows about as they do.
        frequency, beyond = self.pattern.azimuth.spectrum()
        edges = rms * _TAIL
        # Ends of the pattern have most of these, and weigh more where nothing brighter is seen.
        seen, whole = 0.25 * power * ahead.size / np.count_nonzero(ahead + behind), (
            np.mean(self.pattern.azimuth.amplitude ** 2))
        beyond = np.minimum(beyond * max(1.0, whole / seen), 1.0)
        share = -np.diff(np.interp(edges, frequency, beyond, right=0.0), append=0.0)
        middle = edges * math.sqrt(_TAIL[1] / _TAIL[0])
        bend = np.mean(slope ** 2, axis=1)
        return AmplitudeSpread(rms, tuple(middle.tolist()), tuple(share.tolist()),
                               bend / bend.mean())

    def amplitude(self, points_m: ArrayLike) -> np.ndarray:
        """(R, ...) float64 two-way amplitude of each echo at points (..., 3), metres."""
        points = np.asarray(points_m, np.float64)
        between = (slice(None), *[None] * (points.ndim - 1))
        return self.pattern.amplitude(points - self.centre_m[between], self.axes[between])

    def of_pairs(self, echoes: np.ndarray, points_m: np.ndarray) -> np.ndarray:
        """(n, ...) float64 two-way amplitudes of echoes (n,), each at its points (n, ..., 3)."""
        between = (slice(None), *[None] * (points_m.ndim - 2))
        return self.pattern.amplitude(points_m - self.centre_m[echoes][between],
                                      self.axes[echoes][between])
