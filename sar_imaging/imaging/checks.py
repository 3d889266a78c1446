# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether an imaging method of one's own does what it says: small images, and their errors.

Expected images are time-domain correlation in float64, as `backends.checks` writes it out.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Mapping
from typing import Any, cast

import numpy as np

from ..backends import backend
from ..backends.checks import PATTERN, agrees, make_scene, run_checks
from ..signal.windows import window
from .image import Report
from .imager import Imager, plan_image
from .methods import Method, method_class

_PROMISE_DB = 3.0  # by which an image may miss its predicted error
_TARGETS_DB = -40.0, -60.0, -80.0
_N_PULSES = 64
_SHARED = {name for name, p in inspect.signature(plan_image).parameters.items()
           if p.kind is not p.VAR_KEYWORD}


def check_method(method: str | type[Method], **options: Any) -> list[str]:
    """Check that an imaging method images what it says it can, as well as it says.

    Parameters
    ----------
    method : str or subclass of Method
        As for `plan_image`.
    **options
        Its own options, where the defaults do not suit a map of 40 x 48 pixels at 1 km.

    Returns
    -------
    list of str
        What was found, a sentence for each check.

    Raises
    ------
    ValueError
        It is no method, or checks failed: a line for each, with what was expected, what came and
        what to do.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.imaging.checks import check_method
    >>> from sar_imaging.imaging.correlation import correlate_profiles
    >>> from sar_imaging.imaging.methods import Method
    >>> class Conjugate(Method):
    ...     NAME = 'conjugate'
    ...     def plan(self, tx_m, rx_m):
    ...         return self.describe(predicted_error_db=-80.0)
    ...     def form(self, block):
    ...         values, _ = correlate_profiles(block, self.grid.points().reshape(-1, 3))
    ...         return values.conj().astype(np.complex64).reshape(self.grid.shape)
    >>> check_method(Conjugate)
    Traceback (most recent call last):
        ...
    ValueError: method 'conjugate': 5 of 10 checks failed
    - targets: expected an error ... its conjugate fits: reverse the sign of the phases, ...
    """
    found = method_class(method)
    return run_checks(METHOD_CHECKS, f'method {found.NAME!r}', found, options)


class _Trial:
    """A method, its own options, and what it images: profiles, or phase histories if only these.

    There are two channels, and the map is not square: exchanged axes show.
    """

    def __init__(self, method: type[Method], own: Mapping[str, object], *, bent: bool = False,
                 history: bool = False):
        self.method, self._own = method, own
        self._use(history, bent)
        if method.PHASE_HISTORIES and not history:
            try:
                self.imager().plan(cast(Any, self.block.tx_m), cast(Any, self.block.rx_m))
            except ValueError:  # refuses profiles
                self._use(True, bent)

    def _use(self, history: bool, bent: bool) -> None:
        scene = make_scene(1000.0, pulses=_N_PULSES, aperture_m=16.0, channels=2, history=history,
                           bend_m=1.0 if bent else 0.0)
        self.grid, self.block = dataclasses.replace(scene.grid, n_y=40), scene.block
        self._scene, self._shared = scene, {'compressed': False} if history else {}
        self._scale = 1.0 / self.block.n_samples if history else 1.0

    def imager(self, **options: Any) -> Imager:
        """What `plan_image` makes of it."""
        return plan_image(self.grid, self.block.radar, self.block.n_samples, method=self.method,
                          **{'target_db': _TARGETS_DB[0], **self._own, **self._shared, **options})

    def wanted(self, factors: float | np.ndarray = 1.0, points_m: np.ndarray | None = None, *,
               lit: bool = False) -> np.ndarray:
        """Correlation at the pixels, or at other points, of spectra times factors."""
        points_m = self.grid.points() if points_m is None else points_m
        return self._scene.correlation(points_m, self._scale * factors, illuminated=lit)


def _keeps_promise(image: np.ndarray, report: Report, wanted: np.ndarray) -> str:
    """Tell how an image agrees with the wanted one, and with the error that is predicted of it."""
    predicted = report.predicted_error_db
    if predicted is None:
        raise ValueError('expected a predicted error of an image that is not empty, got None; '
                         'return self.describe(predicted_error_db=...) from `plan`')
    if not np.isfinite(predicted):
        raise ValueError(f'expected a predicted error in dB, got {predicted}; predict -200 dB of '
                         'what is exact in float64')
    # nothing that is given in complex64 is better than -140 dB
    return agrees(image, wanted, max(predicted, -140.0) + _PROMISE_DB)


def _check_class(method: type[Method], own: Mapping[str, Any]) -> str:
    """Attributes of the class are what `Method` reads."""
    for name in ('TERRAIN', 'ILLUMINATION', 'PHASE_HISTORIES', 'BACKENDS'):
        if not isinstance(getattr(method, name), bool):
            raise ValueError(f'expected {name}=True or False, got {getattr(method, name)!r}; '
                             'say whether it can')
    if not isinstance(method.OWN, Mapping):
        raise ValueError(f'expected OWN to be a mapping, got {method.OWN!r}; map names of options '
                         'to what they are if left out')
    if shared := _SHARED & {*method.OWN}:
        raise ValueError(f'expected options of its own in OWN, got {", ".join(sorted(shared))}, '
                         'which plan_image takes itself; choose other names')
    if method.plan is Method.plan:
        raise ValueError('expected a function plan(tx_m, rx_m), got none; write it')
    if method.form is Method.form and method.image is Method.image:
        raise ValueError('expected a function form(block), got none; write it')
    can = [n for n in ('TERRAIN', 'ILLUMINATION', 'PHASE_HISTORIES', 'BACKENDS')
           if getattr(method, n)]
    return f'{", ".join(can) or "no attribute"} set, options {", ".join(method.OWN) or "none"}'


def _check_targets(method: type[Method], own: Mapping[str, Any]) -> str:
    """Images at several targets are as good as predicted; a target may be refused."""
    trial = _Trial(method, own)
    told: list[str] = []
    wanted, before = trial.wanted(), trial.block.samples.copy()
    for target_db in _TARGETS_DB:
        try:
            image = trial.imager(target_db=target_db)(trial.block)
        except ValueError as error:
            if not told:
                raise
            told.append(f'target_db={target_db:g}: refused, {error}')
            continue
        if not np.array_equal(trial.block.samples, before):
            trial.block.samples[:] = before
            raise ValueError('expected the samples of the block to stay as they were, got others; '
                             'work on a copy')
        if image.samples.dtype != np.complex64:
            raise ValueError(f'expected complex64, got {image.samples.dtype}; end `form` with '
                             '.astype(np.complex64)')
        told.append(f'target_db={target_db:g}: '
                    f'{_keeps_promise(image.samples, image.report, wanted)}')
    return '; '.join(told)


def _check_bent_track(method: type[Method], own: Mapping[str, Any]) -> str:
    """The path is that of each pulse and channel; bent tracks may be refused."""
    trial = _Trial(method, own, bent=True)
    try:
        image = trial.imager()(trial.block)
    except ValueError as error:
        return f'refused, {error}'
    return _keeps_promise(image.samples, image.report, trial.wanted())


def _check_new_places(method: type[Method], own: Mapping[str, Any]) -> str:
    """Pulses from other places than those before are planned anew."""
    trial = _Trial(method, own)
    imager, first = trial.imager(), _N_PULSES // 4
    imager(trial.block.select(slice(0, -first)))
    image = imager(trial.block.select(slice(first, None)))
    return _keeps_promise(image.samples, image.report, trial.wanted(
        (np.arange(_N_PULSES) >= first)[:, None, None]))


def _check_channels(method: type[Method], own: Mapping[str, Any]) -> str:
    """Images of single channels, each with a factor, under a window over the pulses."""
    trial, told = _Trial(method, own), ''
    weights, pulse_window = np.array([1.0, 0.5j]), np.hanning(_N_PULSES) + 0.1
    image = trial.imager(per_channel=True, weights=weights, pulse_weights=pulse_window)(
        trial.block)
    for number, samples in enumerate(image.samples):
        factors = np.zeros((_N_PULSES, 2, 1), complex)
        factors[:, number, 0] = weights[number] * pulse_window
        told = _keeps_promise(samples, image.report, trial.wanted(factors))
    return told


def _check_growth(method: type[Method], own: Mapping[str, Any]) -> str:
    """Two halves of the pulses add up to the image of all."""
    trial = _Trial(method, own)
    imager = trial.imager()
    image = imager.new_image(2)
    for half in (slice(0, _N_PULSES // 2), slice(_N_PULSES // 2, None)):
        imager.accumulate(trial.block.select(half), image)
    return _keeps_promise(image.samples, image.report, trial.wanted())


def _check_phase_histories(method: type[Method], own: Mapping[str, Any]) -> str:
    """Phase histories under a window over the band, with the scale of range compression."""
    if not method.PHASE_HISTORIES:
        return 'not offered: PHASE_HISTORIES is not set'
    trial = _Trial(method, own, history=True)
    weights = window('hamming', trial.block.n_samples)
    image = trial.imager(weighting='hamming')(trial.block)
    try:
        return _keeps_promise(image.samples, image.report, trial.wanted(
            weights / weights.mean()))
    except ValueError as error:
        raise ValueError(f'{error}; phase histories owe the window over the band and the scale of '
                         'range compression, w_k / sum(w)') from error


def _check_terrain(method: type[Method], own: Mapping[str, Any]) -> str:
    """Heights of pixels, of which some are not known."""
    if not method.TERRAIN:
        return 'not offered: TERRAIN is not set'
    trial = _Trial(method, own)
    points = trial.grid.points()
    points[..., 2] = 2.0 * np.sin(np.linspace(0.0, 3.0, trial.grid.n_x))
    points[:2, :, 2] = np.nan
    image = trial.imager(height_m=points[..., 2])(trial.block)
    if (image.samples[:2] != 0).any():  # NaN, too
        raise ValueError(f'expected 0 where no height is known, got {image.samples[0, 0]}; leave '
                         'pixels without position at 0')
    return _keeps_promise(image.samples[2:], image.report, trial.wanted(points_m=points[2:]))


def _check_illumination(method: type[Method], own: Mapping[str, Any]) -> str:
    """Echoes are weighed by the amplitude with which their antenna sees a pixel."""
    if not method.ILLUMINATION:
        return 'not offered: ILLUMINATION is not set'
    trial = _Trial(method, own)
    image = trial.imager(illumination=PATTERN)(trial.block)
    try:
        return _keeps_promise(image.samples, image.report, trial.wanted(lit=True))
    except ValueError as error:
        raise ValueError(f'{error}; multiply what echo r adds to points x by '
                         'self.illumination.amplitude(x)[r]') from error


class _Counted:
    """The reference backend, which takes note of the entries that are called."""

    def __init__(self) -> None:
        self.called: set[str] = set()

    def __getattr__(self, entry: str) -> Any:
        found = getattr(backend('reference'), entry)

        def noted(*arguments: Any, **options: Any) -> Any:
            self.called.add(entry)
            return found(*arguments, **options)

        return noted if callable(found) else found


def _check_backends(method: type[Method], own: Mapping[str, Any]) -> str:
    """The backend that is asked for computes."""
    if not method.BACKENDS:
        return 'not offered: BACKENDS is not set'
    trial, made = _Trial(method, own), _Counted()
    image = trial.imager(backend=made)(trial.block)
    if not made.called:
        raise ValueError('expected the backend that is asked for to compute, got an image without '
                         'any of its entries; use self.options.backend')
    return _keeps_promise(image.samples, image.report, trial.wanted())


#: What is checked of a method; each check takes its class and its own options.
METHOD_CHECKS: Mapping[str, Callable[[type[Method], Mapping[str, Any]], str]] = {
    'class': _check_class,
    'targets': _check_targets,
    'a bent track': _check_bent_track,
    'pulses from other places': _check_new_places,
    'channels and windows': _check_channels,
    'images that grow': _check_growth,
    'phase histories': _check_phase_histories,
    'terrain': _check_terrain,
    'illumination': _check_illumination,
    'backends': _check_backends,
}
