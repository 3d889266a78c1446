# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Geometry models: phase centres as a function of unknown parameters.

A `GeometryModel` is any function from a vector of parameters to the phase centres of all pulses,
with a start and an expected size for each parameter. The functions below add common errors to a
model: a smooth track error, an offset between two clocks, a bias of the measured range. Anything
else, such as the radius of a rotating arm, is a function that the user writes. `AlignmentModel`
aligns a radar with the poses of its platform.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.alignment import Alignment
from ..geometry.poses import PoseTable, PoseTrack
from ..signal.positioning import locate
from ..signal.pulses import PulseBlock

if TYPE_CHECKING:
    from .offset_curve import OffsetCurve

OFFSET = 'time_offset_s'  # parameter that is searched for over a wide range
_NARROWED_STEPS = 2.0  # what it may still be wrong by after that, in steps of the trials


class Geometry(NamedTuple):
    """Phase centres of an aperture.

    Attributes
    ----------
    tx_m, rx_m : (P, C, 3) float64
        Transmit and receive phase centres, imaging frame, metres.
    range_bias_m : float
        What the measured half path has more than the true one, metres.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.autofocus import Geometry
    >>> centres = np.zeros((4, 1, 3))
    >>> Geometry(centres, centres).range_bias_m
    0.0
    """

    tx_m: np.ndarray
    rx_m: np.ndarray
    range_bias_m: float = 0.0


@dataclasses.dataclass(frozen=True)
class GeometryModel:
    """Phase centres as a function of unknown parameters.

    Parameters
    ----------
    names : sequence of str
        Name and unit of each parameter, such as ``'radius_m'``.
    start : (Q,) array_like
        Nominal values.
    scale : (Q,) array_like
        Expected size (standard deviation) of the error of each, in its unit. It decides which
        combinations of parameters are worth estimating and how coarse the search begins.
    function : callable
        From (Q,) float64 parameters to a `Geometry`.

    Raises
    ------
    ValueError
        Lengths disagree, a value is not finite, or a scale is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.autofocus import Geometry, GeometryModel
    >>> angle = np.linspace(0.0, np.pi, 5)
    >>> def on_circle(parameters):
    ...     x, y = parameters[0] * np.cos(angle), parameters[0] * np.sin(angle)
    ...     centres = np.stack([x, y, 0 * angle], axis=-1)[:, None]
    ...     return Geometry(centres, centres)
    >>> model = GeometryModel(['radius_m'], [0.20], [0.01], on_circle)
    >>> model([0.25]).tx_m[2, 0].round(6).tolist()  # the middle of a larger circle
    [0.0, 0.25, 0.0]
    """

    names: Sequence[str]
    start: np.ndarray
    scale: np.ndarray
    function: Callable[[np.ndarray], Geometry]

    def __post_init__(self) -> None:
        object.__setattr__(self, 'names', tuple(self.names))
        for name in ('start', 'scale'):
            values = np.array(getattr(self, name), np.float64).reshape(-1)
            if len(values) != len(self.names) or not np.isfinite(values).all():
                raise ValueError(f'{name}={values}; expected one finite number for each of '
                                 f'{self.names}')
            object.__setattr__(self, name, values)
        if (self.scale <= 0).any():
            raise ValueError(f'scale={self.scale}; expected the size of an error, above 0')

    def __call__(self, parameters: ArrayLike) -> Geometry:
        """Phase centres for (Q,) parameters."""
        return self.function(np.asarray(parameters, np.float64))

    def extended(self, names: Sequence[str], start: ArrayLike, scale: ArrayLike,
                 change: Callable[[Geometry, np.ndarray], Geometry]) -> GeometryModel:
        """Model with more parameters.

        Parameters
        ----------
        names, start, scale
            Of the new parameters.
        change : callable
            From a `Geometry` and the new parameters to a `Geometry`.
        """
        n = len(self.names)
        return GeometryModel(
            (*self.names, *names), np.concatenate([self.start, start]),
            np.concatenate([self.scale, scale]),
            lambda parameters: change(self.function(parameters[:n]), parameters[n:]))


def nominal(block: PulseBlock) -> GeometryModel:
    """Model without unknowns: the phase centres that came with the pulses.

    Parameters
    ----------
    block : PulseBlock
        Pulses with phase centres.

    Returns
    -------
    GeometryModel
        Of no parameters.

    Raises
    ------
    ValueError
        The block has no phase centres.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.autofocus import nominal
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(10))
    >>> model = nominal(block)
    >>> model.names, bool(np.array_equal(model([]).tx_m, block.tx_m))
    ((), True)
    """
    if not block.has_positions:
        raise ValueError('the block has no phase centres; autofocus corrects positions, it does '
                         'not invent them')
    geometry = Geometry(*block.centres_m)
    return GeometryModel((), np.zeros(0), np.zeros(0), lambda _: geometry)


def with_track_error(model: GeometryModel, *, degree: int = 5, scale_m: float = 0.05,
                     axes: Sequence[Sequence[float]] | np.ndarray = (
                         (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
                     time_s: ArrayLike | None = None
                     ) -> GeometryModel:
    """Add an unknown smooth displacement: Legendre polynomials of the pulses' times.

    Parameters
    ----------
    model : GeometryModel
        To extend.
    degree : int
        Degree of the polynomials, 1 or more; a constant only moves the image and is left out.
    scale_m : float
        Expected size of each coefficient, metres.
    axes : sequence of (3,) floats
        Directions of the displacement; x, y and z unless told otherwise.
    time_s : (P,) array_like, optional
        Ascending times of the pulses, seconds; at equal intervals if left out.

    Returns
    -------
    GeometryModel
        With the parameters ``track_A_K_m``: metres along axis A of polynomial K.

    Examples
    --------
    >>> from sar_imaging.autofocus import nominal, with_track_error
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(10))
    >>> model = with_track_error(nominal(block), degree=2, scale_m=0.1, axes=[[1.0, 0.0, 0.0]])
    >>> list(model.names)
    ['track_0_1_m', 'track_0_2_m']
    >>> moved = model([0.0, 0.05]).tx_m - block.tx_m
    >>> print(f'{moved[0, 0, 0]:.3f} m at the first pulse')
    0.050 m at the first pulse
    """
    if degree < 1:
        raise ValueError(f'degree={degree}; expected 1 or more')
    axes = np.asarray(axes, float).reshape(-1, 3)
    names = [f'track_{axis}_{power}_m' for axis in range(len(axes))
             for power in range(1, degree + 1)]
    n_pulses = len(model(model.start).tx_m)
    time_s = np.arange(n_pulses) if time_s is None else np.asarray(time_s, float)
    u = np.interp(time_s, time_s[[0, -1]], [-1.0, 1.0])
    basis = np.polynomial.legendre.legvander(u, degree)[:, 1:]

    def change(geometry: Geometry, coefficients: np.ndarray) -> Geometry:
        moved = (basis @ coefficients.reshape(len(axes), degree).T @ axes)[:, None]
        return geometry._replace(tx_m=geometry.tx_m + moved, rx_m=geometry.rx_m + moved)

    n = len(names)
    return model.extended(names, np.zeros(n), np.full(n, float(scale_m)), change)


def with_time_offset(model: GeometryModel, time_s: ArrayLike, *, scale_s: float) -> GeometryModel:
    """Add an unknown offset between the clocks of pulses and positions.

    Positions belong to the times of the pulses plus the offset. Phase centres between pulses
    follow a cubic spline; beyond the ends it is continued.

    Parameters
    ----------
    model : GeometryModel
        To extend.
    time_s : (P,) array_like
        Ascending times of the pulses, seconds.
    scale_s : float
        Expected size of the offset, seconds.

    Returns
    -------
    GeometryModel
        With the parameter ``time_offset_s``, seconds.

    Examples
    --------
    >>> from sar_imaging.autofocus import nominal, with_time_offset
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(10))  # flies at 200 m/s along y
    >>> time_s = (block.stamp_ns - block.stamp_ns[0]) * 1e-9
    >>> model = with_time_offset(nominal(block), time_s, scale_s=0.01)
    >>> moved = model([0.002]).tx_m - block.tx_m
    >>> print(list(model.names), f'{moved[5, 0, 1]:.3f} m')
    ['time_offset_s'] 0.400 m
    """
    # scipy.interpolate takes its time to import, which a node without autofocus need not wait for
    from scipy.interpolate import CubicSpline

    time_s = np.asarray(time_s, float)
    time_s = time_s - time_s[0]

    def change(geometry: Geometry, offset: np.ndarray) -> Geometry:
        tx, rx = (CubicSpline(time_s, a)(time_s + offset[0]) for a in geometry[:2])
        return geometry._replace(tx_m=tx, rx_m=rx)

    return model.extended(['time_offset_s'], [0.0], [scale_s], change)


def with_range_bias(model: GeometryModel, *, scale_m: float) -> GeometryModel:
    """Add an unknown bias of the measured half path, the same for all pulses.

    Parameters
    ----------
    model : GeometryModel
        To extend.
    scale_m : float
        Expected size of the bias, metres.

    Returns
    -------
    GeometryModel
        With the parameter ``range_bias_m``, metres.

    Examples
    --------
    >>> from sar_imaging.autofocus import nominal, with_range_bias
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(10))
    >>> model = with_range_bias(nominal(block), scale_m=0.5)
    >>> list(model.names), float(model([0.3]).range_bias_m)
    (['range_bias_m'], 0.3)
    """
    return model.extended(
        ['range_bias_m'], [0.0], [scale_m],
        lambda geometry, bias: geometry._replace(range_bias_m=geometry.range_bias_m + bias[0]))


def apply_geometry(block: PulseBlock, geometry: Geometry) -> PulseBlock:
    """Pulses with the phase centres and the range bias of a geometry.

    Parameters
    ----------
    block : PulseBlock
        Pulses.
    geometry : Geometry
        Phase centres for each, and the range bias of their delays.

    Returns
    -------
    PulseBlock
        With the same samples, whose first one is nearer by the bias.

    Examples
    --------
    >>> from sar_imaging.autofocus import Geometry, apply_geometry
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(10))
    >>> corrected = apply_geometry(block, Geometry(block.tx_m, block.rx_m, range_bias_m=1.5))
    >>> print(f'{corrected.radar.range_start_m - block.radar.range_start_m:.3f} m')
    -1.500 m
    """
    radar = block.radar
    delay = (radar.first_sample_delay_s
             - 2 * geometry.range_bias_m / radar.propagation_speed_m_per_s)
    if geometry.range_bias_m:
        radar = dataclasses.replace(radar, first_sample_delay_s=delay)
    return dataclasses.replace(block, radar=radar, tx_m=geometry.tx_m, rx_m=geometry.rx_m)


def by_offset(model: GeometryModel) -> Callable[[float], Geometry]:
    """Geometry as a function of the offset of the clocks alone."""
    which = model.names.index(OFFSET)

    def geometry(offset_s: float) -> Geometry:
        parameters = model.start.copy()
        parameters[which] += offset_s
        return model(parameters)

    return geometry


def within(model: GeometryModel, lowest_s: float, highest_s: float) -> GeometryModel:
    """The model with errors of the offset held where the track is known, for searches' steps."""
    which = model.names.index(OFFSET)
    middle = model.start[which]

    def geometry(parameters: np.ndarray) -> Geometry:
        held = np.array(parameters, np.float64)
        held[which] = np.clip(held[which], middle + lowest_s, middle + highest_s)
        return model(held)

    return dataclasses.replace(model, function=geometry)


def narrowed(model: GeometryModel, curve: OffsetCurve) -> GeometryModel:
    """The model begun at the offset that the curve tells, which is hardly wrong any more."""
    which = model.names.index(OFFSET)
    start, scale = model.start.copy(), model.scale.copy()
    start[which] += curve.best_s
    scale[which] = min(scale[which], _NARROWED_STEPS * curve.step_s)
    return dataclasses.replace(model, start=start, scale=scale)


NAMES = ('time_offset_s', 'range_bias_m', 'lever_x_m', 'lever_y_m', 'lever_z_m')


def alignment_model(block: PulseBlock, track: PoseTrack | PoseTable, start: Alignment,
                    **scale: float) -> GeometryModel:
    """Phase centres as a function of time offset, range bias and lever arm.

    A constant lever arm of a platform that does not turn displaces the image and sharpens
    nothing: leave it out there.

    Parameters
    ----------
    block : PulseBlock
        Pulses located with `start`.
    track : PoseTrack or PoseTable
        Poses of the platform, reaching beyond the pulses by more than the time offset may be
        wrong.
    start : Alignment
        Nominal alignment.
    scale : float
        Expected error of each parameter to estimate, by its name in `NAMES`. The others keep
        their nominal values. A lever arm moves all phase centres alike, in the body frame.

    Returns
    -------
    GeometryModel
        Its parameters are the values themselves, but for the lever arm, which is added to the
        nominal ones, metres.

    Raises
    ------
    ValueError
        A name is unknown. The model raises it where a pulse has no pose.
    """
    if unknown := set(scale) - set(NAMES):
        raise ValueError(f'unknown parameters {", ".join(sorted(unknown))}; use some of '
                         f'{", ".join(NAMES)}')
    names = [name for name in NAMES if name in scale]
    nominal = dict.fromkeys(NAMES, 0.0) | {'time_offset_s': start.time_offset_s,
                                           'range_bias_m': start.range_bias_m}

    def geometry(parameters: np.ndarray) -> Geometry:
        changed = aligned(start, dict(zip(names, parameters, strict=True)))
        located = locate(block, track, changed)
        return Geometry(*located.centres_m, changed.range_bias_m - start.range_bias_m)

    return GeometryModel(names, np.array([nominal[name] for name in names]),
                         np.array([scale[name] for name in names]), geometry)


def aligned(start: Alignment, parameters: dict[str, float]) -> Alignment:
    """Alignment with parameters of `alignment_model`, by name; the others stay."""
    values = {name: float(parameters[name]) for name in NAMES[:2] if name in parameters}
    arm = np.array([parameters.get(name, 0.0) for name in NAMES[2:]])
    return dataclasses.replace(start, tx_m=start.tx_m + arm, rx_m=start.rx_m + arm, **values)
