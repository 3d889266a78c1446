"""An antenna as data sheets, parameter files and recordings describe it, in degrees."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ...files import naming
from ...yaml_text import read_yaml
from .pattern import AntennaPattern, PatternCut

UNIFORM, GAUSSIAN, COSINE, SINC, MEASURED = KINDS = ('uniform', 'gaussian', 'cosine', 'sinc',
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
        One of `KINDS`, see `PatternCut`; ``'measured'`` for tables.
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
    >>> from sar_imaging.geometry.illumination import Antenna
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

    def __post_init__(self):
        if self.pattern not in KINDS:
            raise ValueError(f'antenna pattern {self.pattern!r} is unknown; expected one of '
                             f'{", ".join(KINDS)}')
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
        return cls(MEASURED, **{name: tuple(v.tolist()) for name, v in tables.items()})

    def as_dict(self) -> dict:
        """Fields that are given, of JSON types; see `from_dict`."""
        return {name: list(value) if isinstance(value, tuple) else value
                for name, value in dataclasses.asdict(self).items() if value}

    @classmethod
    def from_dict(cls, values: Mapping) -> Antenna:
        """Antenna from the names of its fields, as files and recordings hold them.

        Raises
        ------
        ValueError
            A name is unknown, or a value is none.
        """
        known = {f.name: f.type for f in dataclasses.fields(cls)}
        if not isinstance(values, Mapping) or not set(values) <= set(known):
            raise ValueError(f'an antenna of {values!r}; expected {", ".join(known)}')
        fields = {}
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
        values = read_yaml(path)
        with naming(path, 'holds no antenna'):
            return cls.from_dict(values)
