"""How brightly each echo lights a point: an antenna pattern, and where it looked."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ..half_paths import Paths
from .pattern import AntennaPattern
from .pointing import Pointing

_TAIL = np.geomspace(2.0, 100.0, 25)  # times the rms frequency
_STEP = 0.002  # of the angle that is lit, for a derivative


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


@dataclasses.dataclass(frozen=True, eq=False)
class Illumination:
    """Two-way amplitude of echoes, one of each pulse and channel, towards any point.

    Parameters
    ----------
    pattern : AntennaPattern
        Of all echoes.
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
    def of_pulses(cls, pattern: AntennaPattern, pointing: Pointing | None, tx_m, rx_m, *,
                  foreseen: bool = False) -> Illumination:
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

    def select(self, rows) -> Illumination:
        """Some of the echoes, by slice, mask or integers."""
        return Illumination(self.pattern, self.centre_m[rows], self.axes[rows], self.foreseen)

    def lights(self, points_m) -> np.ndarray | None:
        """(R, S) bool which points (S, 3), metres, each echo lights; None where all may be."""
        lit = None if self.foreseen else self.amplitude(points_m) > 0
        return lit if lit is not None and lit.any() else None

    def may_light(self, points_m, shape: tuple[int, ...]) -> np.ndarray | None:
        """(R, S) bool which points of a mesh bound a cell of it that an echo may light.

        Points (S, 3), metres, are a mesh of `shape`. The directions beyond one end of a pattern,
        and those behind the antenna, form convex cones: where all corners of a flat cell lie in
        one of them, it is dark. None where all may be lit, or none is.
        """
        if self.foreseen:
            return None
        cells = self.dark_cones(points_m).reshape(-1, *shape)
        axes = range(1, cells.ndim)
        for axis in axes:
            before, after = (np.take(cells, np.arange(cells.shape[axis] - 1) + i, axis)
                             for i in (0, 1))
            cells = before & after
        lit = cells == 0
        for axis in axes:
            beyond = [(0, 0)] * lit.ndim
            beyond[axis] = (1, 1)
            wider = np.pad(lit, beyond)
            lit = np.logical_or(*(np.take(wider, np.arange(wider.shape[axis] - 1) + i, axis)
                                  for i in (0, 1)))
        return lit.reshape(len(lit), -1) if lit.any() else None

    def dark_cones(self, points_m) -> np.ndarray:
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

    def of_paths(self, paths: Paths, points_m) -> Paths:
        """Paths of the echoes to points (S, 3), metres, that know which of these they light."""
        return dataclasses.replace(paths, lit=self.lights(points_m))

    def spread(self, points_m, direction_m) -> AmplitudeSpread:
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

    def amplitude(self, points_m) -> np.ndarray:
        """(R, ...) float64 two-way amplitude of each echo at points (..., 3), metres."""
        points = np.asarray(points_m, np.float64)
        between = (slice(None), *[None] * (points.ndim - 1))
        return self.pattern.amplitude(points - self.centre_m[between], self.axes[between])
