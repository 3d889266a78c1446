"""Where an antenna looks: its boresight and up direction for every pulse."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import scipy

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
    up: np.ndarray = _UP

    def __post_init__(self):
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
    def fixed(cls, attitude, boresight_body, up_body=_UP) -> Pointing:
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
    def beside_track(cls, centre_m, side: int, depression_rad: float = 0.0,
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
    def steered(cls, centre_m, target_m, up=_UP) -> Pointing:
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
        return cls(np.asarray(target_m, np.float64) - _centres(centre_m), up)

    @classmethod
    def rotating(cls, time_s, rate_rad_per_s: float, start_rad: float = 0.0,
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

    def select(self, index) -> Pointing:
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
    def of_unit_vectors(cls, boresight, up) -> Pointing:
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
    def _of_unit_vectors(cls, boresight, up) -> Pointing:
        """Kept to the bit: plans are for directions that are compared."""
        found = object.__new__(cls)
        object.__setattr__(found, 'boresight', np.ascontiguousarray(boresight))
        object.__setattr__(found, 'up', np.ascontiguousarray(up))
        return found


def _centres(centre_m) -> np.ndarray:
    centre = np.asarray(centre_m, np.float64)
    if centre.ndim != 2 or centre.shape[1] != 3 or not np.isfinite(centre).all():
        raise ValueError(f'centre_m.shape={centre.shape}; expected (P, 3) finite positions, one '
                         'for each pulse, metres')
    return centre
