"""Autofocus of an aperture: estimate, image again exactly, and accept only what is better."""

from __future__ import annotations

import dataclasses
import logging
import math
from collections.abc import Callable

import numpy as np

from ..geometry.grids import MapGrid
from ..imaging.backprojection import Backprojector
from ..quality.measures import contrast, entropy
from ..signal.pulses import PulseBlock
from .models import Geometry, GeometryModel, apply_geometry, nominal, with_track_error
from .residual import absorb, along_sight, estimate_residual
from .search import search

_logger = logging.getLogger(__name__)
_FEWEST_TO_CLAIM = 4  # bright points without which success is not claimed
_FEWEST_TO_ABSORB = 12
_FEWEST_PULSES = 32  # below it there is no telling a phase error from the scene
_APART = 4.0  # bright points stand so many range resolutions apart
# Of points in phase: simulated ones that are focused have 0.89 to 0.97, those of the Gotcha data
# 0.82; ghosts had up to 0.57, and once 0.76.
_LEAST_TO_ACCEPT, _LEAST_TO_CLAIM = 0.7, 0.8
_VARYING_RAD = 0.03  # smooth phase over the scene from which the model is asked again
_MOST_PASSES = 2
_PHASES_TO_JUDGE = 128  # where none are to be corrected
_FAINTEST_DB = -30.0  # of a bright point, relative to the brightest


@dataclasses.dataclass(frozen=True)
class AutofocusReport:
    """What autofocus did to one image.

    Attributes
    ----------
    accepted : bool
        True when the corrected image replaced the original.
    success : bool
        True when the accepted image, or the original where nothing was to gain, is claimed to be
        focused to the limit asked for.
    reason : str
        Why, in a sentence.
    contrast_before, contrast_after : float
        Contrast of the original and of the image returned.
    entropy_before, entropy_after : float
        Their entropies, nats.
    estimated_error_db : float
        Estimated error against an image with the true geometry, but for what no image shows (a
        displacement), dB; NaN when nothing could be estimated.
    coherence : float
        Of the contributions to the best points, see `residual.Residual`.
    parameters : dict of str to float
        Estimated parameters of the geometry model.
    uncertainty : dict of str to float
        Part of each that the image does not determine, in its unit.
    correction_m : float
        Rms change of the half path to the scene's middle, without constant and line, metres.
    largest_move_m : float
        Largest displacement of a phase centre, metres.
    n_points : int
        Bright points used.
    """

    accepted: bool
    success: bool
    reason: str
    contrast_before: float
    contrast_after: float
    entropy_before: float
    entropy_after: float
    estimated_error_db: float = math.nan
    coherence: float = math.nan
    parameters: dict[str, float] = dataclasses.field(default_factory=dict)
    uncertainty: dict[str, float] = dataclasses.field(default_factory=dict)
    correction_m: float = 0.0
    largest_move_m: float = 0.0
    n_points: int = 0

    @property
    def verdict(self) -> str:
        """Whether the image was corrected and is claimed to be focused, in words."""
        return (f'autofocus {"accepted" if self.accepted else "not applied"}, '
                f'{"focused" if self.success else "no claim"}')

    @property
    def details(self) -> str:
        """Why, and the figures."""
        return (f'{self.reason}; contrast {self.contrast_before:.3g} -> '
                f'{self.contrast_after:.3g}, entropy {self.entropy_before:.3f} -> '
                f'{self.entropy_after:.3f}, estimated error {self.estimated_error_db:.1f} dB')

    def __str__(self) -> str:
        return f'{self.verdict}: {self.details}'


@dataclasses.dataclass(frozen=True)
class AutofocusResult:
    """Image, pulses and report of one aperture.

    Attributes
    ----------
    image : complex64 array
        Corrected where accepted, else the original.
    block : PulseBlock
        The pulses with the phase centres of that image.
    report : AutofocusReport
        What was done.
    """

    image: np.ndarray
    block: PulseBlock
    report: AutofocusReport


class Autofocus:
    """Correct phase centres of whole apertures from their image alone.

    Parameters
    ----------
    grid : MapGrid
        Of the image.
    model : callable, optional
        From a PulseBlock to a `GeometryModel`; a smooth three-dimensional track error of
        `scale_m` if left out.
    imager : callable, optional
        From a PulseBlock to its image on the grid; exact backprojection if left out.
    scale_m : float
        Expected size of the track error, metres, for the default model.
    n_phases : int
        Most phases of the residual correction, each shared by neighbouring pulses. 0 leaves it
        out: then the unknowns of the model are too few to invent points, and the decision is left
        to contrast and entropy.
    n_points : int
        Bright points used.
    margin : float
        Relative gain of contrast from which the corrected image is accepted.
    claim_db : float
        Estimated error up to which success is claimed, dB.

    Raises
    ------
    ValueError
        A parameter is out of range.

    Examples
    --------
    >>> result = Autofocus(grid, scale_m=0.1).process(profiles)     # doctest: +SKIP
    >>> print(result.report)                                        # doctest: +SKIP
    """

    def __init__(self, grid: MapGrid, *,
                 model: Callable[[PulseBlock], GeometryModel] | None = None,
                 imager: Callable[[PulseBlock], np.ndarray] | None = None,
                 scale_m: float = 0.05, n_phases: int = 512, n_points: int = 48,
                 margin: float = 0.005, claim_db: float = -22.0):
        if n_points < _FEWEST_TO_CLAIM:
            raise ValueError(f'n_points={n_points}; expected {_FEWEST_TO_CLAIM} or more')
        if n_phases < 0:
            raise ValueError(f'n_phases={n_phases}; expected 1 or more, or 0 for no residual '
                             'correction')
        if not margin > 0:
            raise ValueError(f'margin={margin}; a gain of contrast above 0 must be asked for')
        self.grid, self.scale_m = grid, scale_m
        self._model = model or self._default_model
        self._imager = imager or self._backproject
        self._n_phases, self._n_points = n_phases, n_points
        self._margin, self._claim_db = margin, claim_db

    def process(self, block: PulseBlock, image=None) -> AutofocusResult:
        """Estimate, correct, image again, and decide.

        Parameters
        ----------
        block : PulseBlock
            Range profiles of the aperture with nominal phase centres.
        image : (n_y, n_x) complex64, optional
            Their image, where it exists already.

        Returns
        -------
        AutofocusResult
            The corrected image only where its contrast is higher by the margin, its entropy
            lower, and its points are in phase.

        Raises
        ------
        ValueError
            The block is raw or has no phase centres.
        """
        image = self._imager(block) if image is None else image
        if not np.any(image):
            return AutofocusResult(image, block, AutofocusReport(
                False, False, 'the image is zero everywhere', 0.0, 0.0, 0.0, 0.0))
        if block.n_pulses < _FEWEST_PULSES:
            return self._unchanged(block, image, f'{block.n_pulses} pulses are too few, at least '
                                   f'{_FEWEST_PULSES} are needed')
        points = bright_points(image, self.grid, block, max(self._n_points // 3, 1))
        model = self._model(block)
        found = search(block, model, points)
        geometry = model(found.parameters)
        second = self._imager(apply_geometry(block, geometry))
        points = bright_points(second, self.grid, block, self._n_points)
        found = search(block, model, points[:max(self._n_points // 2, 1)], found.parameters,
                       first_segments=min(2, found.first_segments))
        parameters, geometry, residual = self._finish(block, model, found.parameters, points)
        corrected = apply_geometry(block, geometry)
        details = {
            'estimated_error_db': residual.error_db, 'coherence': residual.coherence,
            'n_points': len(points),
            'parameters': dict(zip(model.names, parameters.tolist(), strict=True)),
            'uncertainty': dict(zip(model.names, found.uncertainty.tolist(), strict=True)),
            'correction_m': self._correction(block, geometry),
            'largest_move_m': _largest_move(block, corrected)}
        return self._decide(block, image, corrected, details)

    def _finish(self, block, model, parameters, points):
        """Parameters, geometry with the residual phase, and what is left."""
        def estimate():
            return estimate_residual(block, model(parameters), points,
                                     n_phases=self._n_phases or _PHASES_TO_JUDGE)

        residual = estimate()
        for _ in range(_MOST_PASSES):
            if (residual.varying_rad < _VARYING_RAD or not len(parameters)
                    or len(points) < _FEWEST_TO_ABSORB):
                break
            before = parameters, residual
            parameters = absorb(residual, model, parameters, points,
                                block.radar.wavenumber_rad_per_m)
            residual = estimate()
            if residual.error_db >= before[1].error_db:
                parameters, residual = before
                break
        geometry = model(parameters)
        if self._n_phases:
            geometry = along_sight(geometry, residual.half_path_m, self.grid.centre_m)
        else:
            left = np.std(residual.half_path_m) * block.radar.wavenumber_rad_per_m
            residual = dataclasses.replace(residual,
                                           common_rad=math.hypot(residual.common_rad, left))
        return parameters, geometry, residual

    def _decide(self, block, image, corrected: PulseBlock, details) -> AutofocusResult:
        again = self._imager(corrected)
        before, after = contrast(image), contrast(again)
        sharper = after > (1 + self._margin) * before and entropy(again) < entropy(image)
        known = (details['estimated_error_db'] <= self._claim_db
                 and details['coherence'] >= _LEAST_TO_CLAIM
                 and details['n_points'] >= _FEWEST_TO_CLAIM)
        if not sharper:
            small = details['correction_m'] * block.radar.wavenumber_rad_per_m
            focused = known and 20 * math.log10(small + 1e-12) <= self._claim_db
            reason = (f'the image was focused already, to {small:.2f} rad' if focused else
                      f'contrast would change from {before:.4g} to {after:.4g} only')
            return self._unchanged(block, image, reason, success=focused, **details)
        doubt = (f'by {details["n_points"]} points the error may be '
                 f'{details["estimated_error_db"]:.1f} dB and their coherence is '
                 f'{details["coherence"]:.2f}')
        if self._n_phases and details['coherence'] < _LEAST_TO_ACCEPT:
            return self._unchanged(block, image, f'contrast would change from {before:.4g} to '
                                   f'{after:.4g}, but {doubt}: perhaps ghosts', **details)
        reason = 'sharper, points in phase' if known else f'sharper, but {doubt}'
        report = AutofocusReport(True, known, reason, before, after, entropy(image),
                                 entropy(again), **details)
        _logger.info('%s', report)
        return AutofocusResult(again, corrected, report)

    def _unchanged(self, block, image, reason, success=False, **details) -> AutofocusResult:
        c, e = contrast(image), entropy(image)
        report = AutofocusReport(False, success, reason, c, c, e, e, **details)
        _logger.info('%s', report)
        return AutofocusResult(image, block, report)

    def _correction(self, block, geometry: Geometry) -> float:
        def path(tx, rx):
            return 0.5 * sum(np.linalg.norm(c.mean(axis=1) - self.grid.centre_m, axis=-1)
                             for c in (tx, rx))

        change = path(*geometry[:2]) - path(block.tx_m, block.rx_m)
        u = np.linspace(-1.0, 1.0, len(change))
        return float(np.std(change - np.polyval(np.polyfit(u, change, 1), u)))

    def _default_model(self, block: PulseBlock) -> GeometryModel:
        return with_track_error(nominal(block), scale_m=self.scale_m)

    def _backproject(self, block: PulseBlock) -> np.ndarray:
        return Backprojector(self.grid, block.radar, block.n_samples)(block)


def _largest_move(block: PulseBlock, corrected: PulseBlock) -> float:
    return float(max(np.linalg.norm(after - before, axis=-1).max() for before, after in (
        (block.tx_m, corrected.tx_m), (block.rx_m, corrected.rx_m))))


def bright_points(image, grid: MapGrid, block: PulseBlock, n: int) -> np.ndarray:
    """Positions of the brightest pixels of an image, apart from each other.

    Parameters
    ----------
    image : (n_y, n_x) array
        Image.
    grid : MapGrid
        Its pixels.
    block : PulseBlock
        Its pulses; their bandwidth says how far points stand apart.
    n : int
        How many at most.

    Returns
    -------
    (K, 3) float64
        Brightest first, metres; none fainter than -30 dB of the brightest.
    """
    power = np.square(np.abs(image), dtype=np.float64)
    faintest = power.max() * 10 ** (_FAINTEST_DB / 10)
    half = max(2, round(_APART * block.radar.range_resolution_m / grid.spacing_m))
    points = []
    while len(points) < n:
        row, column = np.unravel_index(power.argmax(), power.shape)
        if power[row, column] <= faintest:
            break
        points.append((grid.x_m[column], grid.y_m[row], grid.z_m))
        power[max(0, row - half):row + half + 1, max(0, column - half):column + half + 1] = 0.0
    return np.array(points).reshape(-1, 3)
