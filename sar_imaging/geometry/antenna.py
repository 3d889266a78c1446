# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""An antenna and its mount in degrees, as data sheets, parameter files and recordings tell them.

`Antenna` gives the `AntennaPattern` and `Mount` the `Pointing` that images are weighed by, see
`geometry.illumination`.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from .illumination import AntennaPattern, PatternCut, Pointing

PLATFORM, TRACK, POINT, ROTATION = MOUNTS = ('platform', 'track', 'point', 'rotation')
SIDES = {'left': 1, 'right': -1}


@dataclasses.dataclass(frozen=True)
class Mount:
    """Where an antenna looks, by the attitude, the track, a point or the time.

    Parameters
    ----------
    kind : str
        ``'platform'``: bolted to the platform, which tells its attitude; ``'track'``: beside the
        direction of flight; ``'point'``: steered to one point; ``'rotation'``: turning around the
        frame's z axis at an even rate.
    boresight, up : (3,) tuple of float
        For ``'platform'``: directions in the body frame of the poses.
    side : str
        For ``'track'``: ``'left'`` or ``'right'`` of the direction of flight.
    squint_deg : float
        For ``'track'``: degrees from broadside; 0 at a right angle to the direction of flight,
        positive ahead.
    depression_deg : float
        For ``'track'`` and ``'rotation'``: below the horizon, degrees.
    target_m : (3,) tuple of float
        For ``'point'``: the point, metres in the imaging frame.
    rate_deg_per_s, start_deg, start_s : float
        For ``'rotation'``: counterclockwise seen from above, degrees per second; direction at the
        start, counterclockwise from x, degrees; time of the start on the clock of the pulses,
        seconds.

    Raises
    ------
    ValueError
        The kind is unknown, or a number makes no sense for it.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.geometry.antenna import Mount
    >>> track = np.stack([np.arange(3.0), np.zeros(3), np.full(3, 100.0)], axis=-1)
    >>> mount = Mount('track', side='left', depression_deg=30.0)
    >>> pointing = mount.pointing(np.arange(3), track)
    >>> pointing.boresight[1].round(3).tolist()
    [0.0, 0.866, -0.5]
    >>> mount.needs_attitude
    False
    """

    kind: str
    boresight: tuple[float, ...] = (0.0, 1.0, 0.0)
    up: tuple[float, ...] = (0.0, 0.0, 1.0)
    side: str = 'left'
    squint_deg: float = 0.0
    depression_deg: float = 0.0
    target_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    rate_deg_per_s: float = 0.0
    start_deg: float = 0.0
    start_s: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in MOUNTS:
            raise ValueError(f'antenna pointing {self.kind!r} is unknown; expected one of '
                             f'{", ".join(MOUNTS)}')
        for name in ('boresight', 'up', 'target_m'):
            value = tuple(map(float, getattr(self, name)))
            if len(value) != 3 or not all(map(math.isfinite, value)):
                raise ValueError(f'antenna {name} {list(value)}; expected x, y and z')
            object.__setattr__(self, name, value)
        if self.side not in SIDES:
            raise ValueError(f'antenna side {self.side!r}; expected left or right of the track')
        if not (abs(self.depression_deg) <= 90 and abs(self.squint_deg) <= 90):
            raise ValueError(f'antenna squint {self.squint_deg:g} and depression '
                             f'{self.depression_deg:g} degrees; expected -90 to 90')
        if self.kind == PLATFORM:
            try:
                Pointing(np.array([self.boresight]), np.array(self.up))
            except ValueError as error:
                raise ValueError(f'antenna boresight {list(self.boresight)} and up '
                                 f'{list(self.up)}; expected two directions in the body frame '
                                 'that differ') from error

    @property
    def needs_attitude(self) -> bool:
        """Whether the platform must tell its attitude."""
        return self.kind == PLATFORM

    def pointing(self, stamp_ns: np.ndarray, centre_m: ArrayLike,
                 attitude: scipy.spatial.transform.Rotation | None = None) -> Pointing:
        """Where the antenna looks at some pulses.

        Parameters
        ----------
        stamp_ns : (P,) int64
            Times of the pulses, nanoseconds.
        centre_m : (P, 3) array_like
            Mean phase centres, in the order of the pulses, metres.
        attitude : scipy.spatial.transform.Rotation, optional
            P rotations from the body into the imaging frame.

        Raises
        ------
        ValueError
            The platform's attitude is needed and not known, or its track has no direction.
        """
        if self.kind == PLATFORM:
            if attitude is None:
                raise ValueError('an antenna that is fixed to the platform needs its attitude; '
                                 'expected poses, or the pointing with the pulses')
            return Pointing.fixed(attitude, self.boresight, self.up)
        if self.kind == TRACK:
            return Pointing.beside_track(centre_m, SIDES[self.side],
                                         math.radians(self.depression_deg),
                                         math.radians(self.squint_deg))
        if self.kind == POINT:
            return Pointing.steered(centre_m, self.target_m)
        # nanoseconds since 1970 do not fit a float64, those since the start do
        time_s = (np.asarray(stamp_ns, np.int64) - round(self.start_s * 1e9)) * 1e-9
        return Pointing.rotating(time_s, math.radians(self.rate_deg_per_s),
                                 math.radians(self.start_deg), math.radians(self.depression_deg))

    def as_dict(self) -> dict[str, Any]:
        """Fields that differ from the defaults, of JSON types; see `from_dict`."""
        values = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)
                  if getattr(self, f.name) != f.default}
        return {name: list(value) if isinstance(value, tuple) else value
                for name, value in values.items()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Mount:
        """Mount from the names of its fields, as recordings hold them.

        Raises
        ------
        ValueError
            A name is unknown, or a value is none.
        """
        known = [f.name for f in dataclasses.fields(cls)]
        if not isinstance(values, Mapping) or not set(values) <= set(known) or (
                'kind' not in values):
            raise ValueError(f'an antenna pointing of {values!r}; expected kind, and of '
                             f'{", ".join(known[1:])} what it needs')
        try:
            fields: dict[str, Any] = {
                name: value if name in ('kind', 'side') else
                tuple(map(float, value)) if name in ('boresight', 'up', 'target_m')
                else float(value) for name, value in values.items()}
            return cls(**fields)
        except TypeError as error:
            raise ValueError(f'an antenna pointing of {values!r}: {error}; expected numbers'
                             ) from error


UNIFORM, GAUSSIAN, COSINE, SINC, MEASURED = PATTERNS = ('uniform', 'gaussian', 'cosine', 'sinc',
                                                     'measured')
_CUTS = {UNIFORM: PatternCut.uniform, GAUSSIAN: PatternCut.gaussian, COSINE: PatternCut.cosine,
         SINC: PatternCut.sinc}
_TABLES = ('azimuth_deg', 'azimuth_gain_db', 'elevation_deg', 'elevation_gain_db')
_LEAST_AMPLITUDE = 1e-6  # two-way, of gains that are given as next to nothing
_DARK = 1e-12  # that is written for none
_MOST_POINTS = 257  # of a cut that is written as a table


@dataclasses.dataclass(frozen=True)
class Antenna:
    """An antenna by its widths, or by its measured gain.

    Parameters
    ----------
    pattern : str
        One of `PATTERNS`, see `PatternCut`; ``'measured'`` for tables.
    azimuth_width_deg, elevation_width_deg : float
        Full widths between the half-power points of one way, degrees; an elevation of 0 lights
        all elevations alike.
    cutoff_widths : float
        Where both cuts end, in widths off boresight; 0 where the kind itself ends. Pixels beyond
        take no part.
    azimuth_deg, elevation_deg : tuple of float
        Angles of a measured pattern off boresight, ascending, degrees; zero gain beyond.
    azimuth_gain_db, elevation_gain_db : tuple of float
        Power gain of one way there, dB above any level: where transmitter and receiver differ,
        the mean of both.

    Raises
    ------
    ValueError
        The kind is unknown, or its numbers are missing or make no sense.

    Examples
    --------
    >>> import math
    >>> from sar_imaging.geometry.antenna import Antenna
    >>> antenna = Antenna('gaussian', azimuth_width_deg=10.0, elevation_width_deg=30.0)
    >>> pattern = antenna.amplitudes()
    >>> print(f'{pattern.azimuth.at(math.radians(5.0)):.2f} of the amplitude, 5 degrees off')
    0.50 of the amplitude, 5 degrees off
    >>> Antenna('gaussian')
    Traceback (most recent call last):
        ...
    ValueError: antenna azimuth width 0 degrees; expected more than 0 and at most 180, ...
    """

    pattern: str
    azimuth_width_deg: float = 0.0
    elevation_width_deg: float = 0.0
    cutoff_widths: float = 0.0
    azimuth_deg: tuple[float, ...] = ()
    azimuth_gain_db: tuple[float, ...] = ()
    elevation_deg: tuple[float, ...] = ()
    elevation_gain_db: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.pattern not in PATTERNS:
            raise ValueError(f'antenna pattern {self.pattern!r} is unknown; expected one of '
                             f'{", ".join(PATTERNS)}')
        for name in _TABLES:
            object.__setattr__(self, name, tuple(map(float, getattr(self, name))))
        self.amplitudes()

    def amplitudes(self) -> AntennaPattern:
        """Two-way amplitude by direction; its peak is 1."""
        if self.pattern == MEASURED:
            cuts = [self._measured(axis) for axis in ('azimuth', 'elevation')]
        else:
            if any(getattr(self, name) for name in _TABLES):
                raise ValueError(f'a pattern {self.pattern!r} has no table; expected pattern '
                                 f'{MEASURED!r} with {", ".join(_TABLES)}')
            cuts = [self._by_width(axis) for axis in ('azimuth', 'elevation')]
        return AntennaPattern(*cuts)

    def _by_width(self, axis: str) -> PatternCut:
        width = getattr(self, f'{axis}_width_deg')
        if axis == 'elevation' and width == 0:
            return PatternCut.everywhere()
        if not 0 < width <= 180:
            raise ValueError(f'antenna {axis} width {width:g} degrees; expected more than 0 and '
                             'at most 180, the full width between the half-power points')
        return _CUTS[self.pattern](math.radians(width), *self._end(math.radians(width)))

    def _end(self, width: float) -> tuple[float, ...]:
        """What tells a constructor of a cut where it ends; nothing where the kind does."""
        if self.cutoff_widths == 0:
            return ()
        least = 0.5 if self.pattern == UNIFORM else 0.0
        most = 1.0 if self.pattern == UNIFORM else math.inf
        if self.pattern == COSINE or not least < self.cutoff_widths <= most:
            raise ValueError(f'antenna cutoff {self.cutoff_widths:g} widths off boresight; '
                             'expected 0 (where the pattern itself ends)' + (
                                 '' if self.pattern == COSINE else
                                 f', or more than {least:g}' + (
                                     f' and at most {most:g}' if most < math.inf else '')))
        if self.pattern == UNIFORM:
            return ((2 * self.cutoff_widths - 1) * width,)
        return (min(self.cutoff_widths * width, 0.5 * math.pi),)

    def _measured(self, axis: str) -> PatternCut:
        angle, gain = (np.asarray(getattr(self, f'{axis}_{what}'))
                       for what in ('deg', 'gain_db'))
        if axis == 'elevation' and not angle.size and not gain.size:
            return PatternCut.everywhere()
        if angle.size < 2 or angle.size != gain.size:
            raise ValueError(f'a measured antenna has {angle.size} angles {axis}_deg and '
                             f'{gain.size} gains {axis}_gain_db; expected as many of both, two '
                             'or more')
        amplitude = 10 ** ((gain - gain.max()) / 10)  # of both ways: the root of the gain squared
        try:
            return PatternCut.measured(np.radians(angle),
                                       np.where(amplitude < _LEAST_AMPLITUDE, 0.0, amplitude))
        except ValueError as error:
            raise ValueError(f'the angles {axis}_deg of a measured antenna: expected ascending '
                             'ones from -90 to 90 degrees, and finite gains') from error

    @classmethod
    def of(cls, pattern: AntennaPattern) -> Antenna:
        """Measured antenna of a pattern, as recordings hold it; 257 points of a cut at most."""
        tables = {}
        for axis in ('azimuth', 'elevation'):
            cut = getattr(pattern, axis)
            if axis == 'elevation' and np.ptp(cut.amplitude) == 0 and len(cut.amplitude) == 2:
                continue  # all alike
            last = len(cut.amplitude) - 1
            sine = cut.start + cut.step * np.linspace(0, last, min(last, _MOST_POINTS - 1) + 1)
            tables[f'{axis}_deg'] = np.degrees(np.arcsin(np.clip(sine, -1.0, 1.0)))
            amplitude = cut.at_sine(np.clip(sine, cut.start, cut.start + cut.step * last))
            tables[f'{axis}_gain_db'] = 10 * np.log10(np.maximum(amplitude, _DARK))
        fields: dict[str, Any] = {name: tuple(v.tolist()) for name, v in tables.items()}
        return cls(MEASURED, **fields)

    def as_dict(self) -> dict[str, Any]:
        """Fields that are given, of JSON types; see `from_dict`."""
        return {name: list(value) if isinstance(value, tuple) else value
                for name, value in dataclasses.asdict(self).items() if value}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Antenna:
        """Antenna from the names of its fields, as files and recordings hold them.

        Raises
        ------
        ValueError
            A name is unknown, or a value is none.
        """
        known = {f.name: f.type for f in dataclasses.fields(cls)}
        if not isinstance(values, Mapping) or not set(values) <= set(known):
            raise ValueError(f'an antenna of {values!r}; expected {", ".join(known)}')
        fields: dict[str, Any] = {}
        for name, value in values.items():
            try:
                fields[name] = (str(value) if name == 'pattern' else
                                tuple(map(float, value)) if name in _TABLES else float(value))
            except (TypeError, ValueError) as error:
                kind = 'a list of numbers' if name in _TABLES else 'a number'
                raise ValueError(f'antenna {name}={value!r}; expected {kind}') from error
        return cls(**{'pattern': MEASURED, **fields})

    @classmethod
    def load(cls, path: Path | str) -> Antenna:
        """Antenna of a YAML file with the names of the fields, such as a measured table.

        Raises
        ------
        ValueError
            The file cannot be read, or holds no antenna; the text names it.
        """
        from ..files import naming
        from ..yaml_text import read_yaml

        values = read_yaml(path)
        with naming(path, 'holds no antenna'):
            return cls.from_dict(values)
