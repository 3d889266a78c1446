"""Choice of kernel, merge factor and sampling of fast factorised backprojection for a target.

The two-way path of every channel is exact in the first stage. The error against time-domain
correlation is that of the interpolations, one along range and one along direction per level. What
they lose adds up in amplitude: larger merge factors make fewer of them.
"""

from __future__ import annotations

import bisect
import dataclasses
import math
from collections.abc import Iterator

import numpy as np

from ..geometry.grids import MapGrid
from ..geometry.polar import PolarGrid
from ..planning.costs import costs
from ..planning.error_budget import total_db
from ..signal.radar import RadarParameters
from .ffbp_error import LocalTones, local_tones, read_errors
from .ffbp_geometry import FfbpGeometry, ffbp_geometry
from .ffbp_plan import ENDS, FfbpPlan, FfbpSampling, plan_from_geometry
from .ffbp_segments import Segment
from .neighbour_weights import TAPS

_MERGE_FACTORS = (4, 8)  # those of 2 and 3 take as long as that of 4, and err more
_OVERSAMPLINGS = 1.3 * 1.04 ** np.arange(40)  # to choose from, 1.3 to 6
_LEAST_DB, _MOST_DB = -90.0, -10.0  # targets
_FIRST_STAGE_DB, _FIRST_SHARE_DB = -75.0, 9.0  # less costs little, and may not take more
_HALF_DB, _SLACK_DB = 5.0, 0.3  # of the target for each axis, chance deducted; and to try again
_ROUNDS = 4


def plan_ffbp(grid: MapGrid | PolarGrid, radar: RadarParameters, n_samples: int, tx_m, rx_m, *,
              target_db: float = -60.0, pulses_per_subaperture: int = 16,
              merge_factor: int | None = None, kernel: str | None = None,
              range_oversampling: float | None = None, angle_oversampling: float | None = None
              ) -> FfbpPlan:
    """Plan the image of an aperture.

    Parameters
    ----------
    grid : MapGrid or PolarGrid
        Where the pixels are.
    radar : RadarParameters
        Of the compressed profiles; a profile must be sampled at 1.25 times its bandwidth or more.
    n_samples : int
        Samples of each profile.
    tx_m, rx_m : (P, C, 3) array_like
        Transmit and receive phase centres of the aperture, metres.
    target_db : float
        Wanted error against time-domain correlation, dB. What is left out of `merge_factor` and
        the options behind it is what meets the target in the least time; where all of them are
        given, the error is what they make it.
    pulses_per_subaperture : int
        Pulses that the first stage backprojects together.
    merge_factor : int, optional
        Images that are merged at a time, 2 or more. Their number need not be a power of it.
    kernel : str, optional
        Interpolation kernel: 'linear', 'cubic' (four neighbours each way) or 'knab8' (eight,
        a sinc in Knab's window).
    range_oversampling, angle_oversampling : float, optional
        Samples per reciprocal bandwidth of the local images, above 1.25 along range and above 1
        along direction.

    Returns
    -------
    FfbpPlan

    Raises
    ------
    ValueError
        An option is out of its range, positions are malformed, the profiles are sampled too
        coarsely, the scene is too near or not on one side of the track, or the target is out of
        reach. Profiles that are too short for the scene raise the predicted error alone.
    """
    _check_aperture(grid, radar, tx_m, rx_m)
    _check_options(kernel, pulses_per_subaperture, merge_factor)
    given = [None if v is None else _checked(name, v, least) for name, v, least in (
        ('range', range_oversampling, 1.25), ('angle', angle_oversampling, 1.0))]

    def plan(geometry, tones, sampling):
        return plan_from_geometry(grid, radar, n_samples, tx_m, rx_m, geometry, tones, sampling)

    def geometry_of(factor):
        geometry = ffbp_geometry(grid, radar, tx_m, rx_m, int(pulses_per_subaperture), factor)
        return geometry, local_tones(geometry, radar)

    if None not in (merge_factor, kernel, *given):
        return plan(*geometry_of(int(merge_factor)), FfbpSampling(kernel, tuple(given)))
    if not _LEAST_DB <= target_db <= _MOST_DB:
        raise ValueError(f'target_db={target_db}; expected {_LEAST_DB:g} to {_MOST_DB:g} dB')
    trees = [geometry_of(int(f)) for f in ((merge_factor,) if merge_factor else _MERGE_FACTORS)]
    kernels = (kernel,) if kernel else tuple(TAPS)
    return _quickest(plan, trees, kernels, given, grid, target_db)


def _quickest(plan, trees, kernels, given, grid, target_db) -> FfbpPlan:
    """Plan of the least cost that meets a target; plans are made until one does."""
    slack, reached = 0.0, math.inf
    for _ in range(_ROUNDS):
        found = [c for tree in trees for kernel in kernels
                 for c in _candidates(*tree, kernel, given, grid, target_db - slack)]
        within = [c for c in found if c.meets]
        best = min(within or found, key=lambda c: c.cost if within else c.error)
        planned = plan(*best.tree, best.sampling)
        error = total_db(*(e for cause, e in planned.errors_db.items() if cause != ENDS))
        excess, reached = error - target_db, min(reached, error)
        if excess <= 0:
            return planned
        if not within:
            break
        slack += excess + _SLACK_DB
    raise ValueError(f'FFBP reaches {reached:.1f} dB here, target_db={target_db:g} is out of its '
                     'reach: use more pulses_per_subaperture, AFBP or exact backprojection')


@dataclasses.dataclass(frozen=True, eq=False)
class _Candidate:
    tree: tuple[FfbpGeometry, LocalTones]
    sampling: FfbpSampling
    meets: bool
    cost: float  # about, nanoseconds
    error: float


def _candidates(geometry, tones, kernel, given, grid, target_db) -> Iterator[_Candidate]:
    """The coarsest sampling along either axis with which a kernel errs by half of the target."""
    allowed, errors, chosen = 10 ** ((target_db - _HALF_DB) / 10), [], []
    for axis in (0, 1):
        def error(oversampling, axis=axis):
            spacings = ([geometry.range_spacing(oversampling)] * len(geometry.levels),
                        geometry.alpha_spacings(oversampling))
            return read_errors(tones, (axis,), kernel, (oversampling,) * 2, spacings,
                               [Segment()] * len(geometry.levels))[0]

        values = _OVERSAMPLINGS if given[axis] is None else (given[axis],)
        number = bisect.bisect_left(values, -allowed, key=lambda v, e=error: -e(v))
        chosen.append(float(values[min(number, len(values) - 1)]))
        errors.append(error(chosen[-1]))
    sampling = FfbpSampling(kernel, tuple(chosen),
                            min(_FIRST_STAGE_DB, target_db - _FIRST_SHARE_DB))
    yield _Candidate((geometry, tones), sampling, max(errors) <= allowed,
                     _cost(geometry, sampling, grid), sum(errors))


def _cost(geometry: FfbpGeometry, sampling: FfbpSampling, grid) -> float:
    """About how long an image takes, nanoseconds."""
    taps, cost = TAPS[sampling.kernel], costs()
    offset = geometry.edge - geometry.levels[0][0].centre
    r = np.linalg.norm(offset, axis=-1)
    n_range = np.ptp(r) / geometry.range_spacing(sampling.oversampling[0]) + taps
    lines = [np.ptp(offset[:, 0] / r) / spacing + taps if spacing else 0.0
             for spacing in geometry.alpha_spacings(sampling.oversampling[1])]
    merges = sum(len(node.children) * n_lines
                 for nodes, n_lines in zip(geometry.levels, lines, strict=True) for node in nodes)
    return (n_range * (geometry.tx[..., 0].size * lines[0] * cost.line_pixel
                       + merges * (cost.merged_pixel + taps * cost.merged_tap))
            + len(geometry.top) * math.prod(grid.shape)
            * (cost.gathered_pixel + taps * cost.gathered_tap))


def _check_options(kernel, pulses_per_subaperture, merge_factor) -> None:
    if kernel is not None and kernel not in TAPS:
        raise ValueError(f'kernel={kernel!r}; expected one of {", ".join(TAPS)}')
    for name, value, least in (('pulses_per_subaperture', pulses_per_subaperture, 1),
                               ('merge_factor', merge_factor or 2, 2)):
        if value != int(value) or value < least:
            raise ValueError(f'{name}={value}; expected an integer of {least} or more')


def _check_aperture(grid, radar, tx, rx) -> None:
    if not isinstance(grid, MapGrid | PolarGrid):
        raise ValueError(f'grid is a {type(grid).__name__}; FFBP images a MapGrid or a '
                         'PolarGrid: use exact backprojection')
    if radar.sample_rate_hz < 1.25 * radar.bandwidth_hz:
        raise ValueError(
            f'profiles sampled at {radar.sample_rate_hz:g} Hz for a bandwidth of '
            f'{radar.bandwidth_hz:g} Hz; sample them at 1.25 times the bandwidth or more '
            '(parameter oversampling of the range compression)')
    if tx.ndim != 3 or tx.shape[-1] != 3 or tx.shape != rx.shape or 0 in tx.shape:
        raise ValueError(f'tx_m.shape={tx.shape}, rx_m.shape={rx.shape}; expected the same '
                         '(pulses, channels, 3), at least one pulse')
    if not (np.isfinite(tx).all() and np.isfinite(rx).all()):
        raise ValueError('phase centres contain NaN or infinity; every pulse needs a finite '
                         'transmit and receive position')


def _checked(name, value, least) -> float:
    if not (value > least and math.isfinite(value)):
        raise ValueError(f'{name}_oversampling={value}; expected more than {least}')
    return float(value)
