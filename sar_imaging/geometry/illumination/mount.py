"""How an antenna is mounted: what tells where it looks at each pulse, in degrees."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
import scipy

from .pointing import Pointing

PLATFORM, TRACK, POINT, ROTATION = KINDS = ('platform', 'track', 'point', 'rotation')
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
    >>> from sar_imaging.geometry.illumination import Mount
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

    def __post_init__(self):
        if self.kind not in KINDS:
            raise ValueError(f'antenna pointing {self.kind!r} is unknown; expected one of '
                             f'{", ".join(KINDS)}')
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
                Pointing([self.boresight], self.up)
            except ValueError as error:
                raise ValueError(f'antenna boresight {list(self.boresight)} and up '
                                 f'{list(self.up)}; expected two directions in the body frame '
                                 'that differ') from error

    @property
    def needs_attitude(self) -> bool:
        """Whether the platform must tell its attitude."""
        return self.kind == PLATFORM

    def pointing(self, stamp_ns, centre_m,
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

    def as_dict(self) -> dict:
        """Fields that differ from the defaults, of JSON types; see `from_dict`."""
        values = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)
                  if getattr(self, f.name) != f.default}
        return {name: list(value) if isinstance(value, tuple) else value
                for name, value in values.items()}

    @classmethod
    def from_dict(cls, values: Mapping) -> Mount:
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
            return cls(**{name: value if name in ('kind', 'side') else
                          tuple(map(float, value)) if name in ('boresight', 'up', 'target_m')
                          else float(value) for name, value in values.items()})
        except TypeError as error:
            raise ValueError(f'an antenna pointing of {values!r}: {error}; expected numbers'
                             ) from error
