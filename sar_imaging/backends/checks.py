# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a backend of one's own does what plans say: images of small scenes, and their errors.

The echoes follow from the places of scatterers, and the images that are expected from the same
numbers by time-domain correlation in float64, written out here. Nothing is taken from a backend.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import traceback
from collections.abc import Callable, Mapping
from typing import Any, cast

import numpy as np

from ..geometry.grids import MapGrid, PlaneGrid, PointGrid, VolumeGrid
from ..geometry.illumination import AntennaPattern, Illumination, PatternCut, Pointing
from ..planning.afbp.beams import plan_beams
from ..planning.afbp.polar_grids import cover_for_fusion
from ..planning.afbp.subapertures import SubaperturePlan, plan_subapertures
from ..planning.costs import costs, using
from ..planning.exact.backprojection import plan_backprojection
from ..planning.exact.groups import plan_groups
from ..planning.exact.points import ImagePoints
from ..planning.exact.polar_image import plan_polar
from ..planning.plan import total_db
from ..planning.profiles import PhaseHistory
from ..signal.pulses import PulseBlock
from ..signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from . import backend, protocol, reference

CARRIER_HZ, BANDWIDTH_HZ, RATE_HZ = 10e9, 300e6, 400e6
#: Predictions are for scenes that are evenly bright; some dozen scatterers differ by chance.
CHANCE_DB = 0.5
# Lights a part of the map from a part of the track, and more to the right than to the left.
_SINES = np.linspace(-0.012, 0.016, 43)
_CUT = PatternCut(_SINES[0], _SINES[1] - _SINES[0], np.hanning(len(_SINES)))
PATTERN = AntennaPattern(_CUT, PatternCut.everywhere())


@dataclasses.dataclass(frozen=True, eq=False)
class CheckScene:
    """A map, and the pulses that see the scatterers on it, from antennas that look along x.

    Attributes
    ----------
    grid : MapGrid
        The map.
    block : PulseBlock
        Range profiles, or phase histories.
    frequencies_hz, spectra : (K,) float64, (P, C, K) complex128
        The same echoes by absolute frequency, referred to zero delay.
    """

    grid: MapGrid
    block: PulseBlock
    frequencies_hz: np.ndarray
    spectra: np.ndarray

    @property
    def echoes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Samples, transmitters and receivers with one echo per pulse and channel."""
        tx_m, rx_m = self.block.centres_m
        return (self.block.samples.reshape(-1, self.block.n_samples), tx_m.reshape(-1, 3),
                rx_m.reshape(-1, 3))

    def correlation(self, points_m: np.ndarray, factors: float | np.ndarray = 1.0, *,
                    illuminated: bool = False) -> np.ndarray:
        """``sum_r w_r(x) sum_k S_rk exp(+j 2 pi f_k tau_r(x))`` at points (..., 3), complex128.

        Spectra are multiplied by `factors`, (P, C, K) or what is broadcast to it. w is 1, or with
        `illuminated` the amplitude of `PATTERN`.
        """
        rows = (self.spectra * factors).reshape(-1, len(self.frequencies_hz))
        step_hz = self.frequencies_hz[1] - self.frequencies_hz[0]
        image = np.zeros(points_m.shape[:-1], complex)
        for row, tx, rx in zip(rows, *self.echoes[1:], strict=True):
            tau = sum(np.linalg.norm(points_m - a, axis=-1) for a in (tx, rx)) / SPEED_OF_LIGHT
            series = np.polyval(row[::-1], np.exp(2j * np.pi * step_hz * tau))
            series *= np.exp(2j * np.pi * np.mod(self.frequencies_hz[0] * tau, 1.0))
            if illuminated:
                offset = points_m - 0.5 * (tx + rx)
                sine = -offset[..., 1] / np.linalg.norm(offset, axis=-1)
                series *= np.interp(sine, _SINES, _CUT.amplitude, 0.0, 0.0)
            image += series
        return image


@functools.lru_cache(maxsize=16)
def make_scene(range_m: float, *, n: int = 48, pulses: int = 64, aperture_m: float | None = None,
               height_m: float = 0.0, bend_m: float = 0.0, apart_m: float = 0.0,
               channels: int = 1, history: bool = False, n_points: int = 60) -> CheckScene:
    """Profiles, or phase histories, of random scatterers all over a map at some range along x.

    The track runs along y, `bend_m` further out in its middle; receivers stand `apart_m` behind
    the transmitter, and half a wavelength from channel to channel.
    """
    rng = np.random.default_rng(3)
    spacing_m = 0.25
    u = np.linspace(-0.5, 0.5, pulses)
    tx = np.zeros((pulses, channels, 3))
    tx[..., 0] = (bend_m * (1 - 4 * u ** 2))[:, None]
    tx[..., 1] = ((0.03 * range_m if aperture_m is None else aperture_m) * u)[:, None]
    tx[..., 2] = height_m
    rx = tx + apart_m * np.array([-1.0, 0.5, 0.2])
    rx[..., 1] += np.arange(channels) * SPEED_OF_LIGHT / CARRIER_HZ / 2
    grid = MapGrid((np.sqrt(range_m ** 2 - height_m ** 2), 0.0, 0.0), n, n, spacing_m)
    points = np.array(grid.centre_m) + np.c_[
        (rng.random((n_points, 2)) - 0.5) * n * spacing_m, np.zeros(n_points)]
    tau = sum(np.linalg.norm(a[:, :, None] - points, axis=-1) for a in (tx, rx)) / SPEED_OF_LIGHT
    n_samples = 2 * int(n * spacing_m * RATE_HZ / SPEED_OF_LIGHT) + 64  # or frequencies
    centre_s = float(tau.mean())
    if history:
        baseband = (np.arange(n_samples) - (n_samples - 1) / 2) * (BANDWIDTH_HZ / n_samples)
        start, rate, waveform = centre_s, BANDWIDTH_HZ, Waveform.STEPPED_FREQUENCY
    else:
        baseband = (np.arange(n_samples) - n_samples // 2) * (RATE_HZ / n_samples)
        start, rate, waveform = centre_s - n_samples / 2 / RATE_HZ, RATE_HZ, Waveform.LFM
    inside = np.abs(baseband) <= BANDWIDTH_HZ / 2
    frequencies = CARRIER_HZ + baseband[inside]
    spectra = np.stack([np.exp(-2j * np.pi * np.mod(f * tau, 1.0)).sum(axis=-1)
                        for f in frequencies], axis=-1)
    # from zero delay to that of the first sample, at which frequencies begin in phase
    since = frequencies if history else baseband[inside]
    samples = np.zeros((pulses, channels, n_samples), complex)
    samples[..., inside] = spectra * np.exp(2j * np.pi * np.mod(since * start, 1.0))
    if not history:
        samples = np.fft.ifft(np.fft.ifftshift(samples, axes=-1), norm='forward')
    radar = RadarParameters(CARRIER_HZ, BANDWIDTH_HZ, rate, start, waveform=waveform)
    pointing = Pointing.of_unit_vectors(*(np.tile(a, (pulses, 1)) for a in np.eye(3)[[0, 2]]))
    block = PulseBlock(radar, not history, np.arange(pulses), np.arange(pulses), samples, tx, rx,
                       pointing=pointing)
    return CheckScene(grid, block, frequencies, spectra)


def error_db(image: np.ndarray, wanted: np.ndarray) -> float:
    """Mean squared difference of an image over the mean square of the wanted one, dB."""
    return float(20 * np.log10(np.linalg.norm(image - wanted) / np.linalg.norm(wanted) + 1e-20))


def agrees(image: np.ndarray, wanted: np.ndarray, allowed_db: float) -> str:
    """Tell how an image agrees with the wanted one.

    Raises
    ------
    ValueError
        Its error is larger than is allowed; the message names the likely mistake.
    """
    image = np.asarray(image)
    if image.shape != wanted.shape or image.dtype.kind != 'c':
        raise ValueError(f'expected a complex image of shape {wanted.shape}, got {image.dtype} '
                         f'{image.shape}; return complex64 in the shape of the grid')
    if bad := np.count_nonzero(~np.isfinite(image)):
        raise ValueError(f'{bad} of {image.size} pixels are NaN or infinite; expected finite '
                         'numbers, and 0 where nothing is known')
    found = error_db(image, wanted)
    if found > allowed_db:
        raise ValueError(f'expected an error of at most {allowed_db:.1f} dB against time-domain '
                         f'correlation in float64, got {found:.1f} dB; '
                         f'{_likely_mistake(image.astype(complex), wanted)}')
    return f'error {found:.1f} dB, allowed {allowed_db:.1f} dB'


def _likely_mistake(image: np.ndarray, wanted: np.ndarray) -> str:
    """What makes an image wrong, and what to do."""
    if not image.any():
        return 'it is 0 everywhere: add echoes to the image in place, or return it'

    def fits(other: np.ndarray, wanted: np.ndarray = wanted) -> bool:  # but for a factor
        return other.shape == wanted.shape and error_db(
            other * (np.vdot(other, wanted) / np.vdot(other, other)), wanted) < -15.0

    if fits(image):
        factor = np.vdot(image, wanted) / np.vdot(image, image)
        if abs(factor - 1) > 0.01:
            return (f'multiplied by {factor:.4g} it errs by '
                    f'{error_db(factor * image, wanted):.1f} dB: mend its scale')
        return 'predict this error, or compute more exactly'
    if fits(image.conj()):
        return 'its conjugate fits: reverse the sign of the phases, exp(+j k_c D)'
    magnitudes, expected = np.abs(image), np.abs(wanted)
    if fits(magnitudes, expected):
        return ('its magnitudes fit, its phases do not: multiply by the carrier phase '
                'exp(+j k_c D) of the exact two-way path, in float64')
    for axis, cure in enumerate(('rows are in reverse order: row 0 has the largest y',
                                 'columns are in reverse order: column 0 has the least x')):
        if image.ndim == 2 and fits(np.flip(magnitudes, axis), expected):
            return f'its {cure}'
    if fits(np.swapaxes(magnitudes, 0, -1), expected):
        return 'its axes are exchanged: expected (n_y, n_x)'
    return ('compare it echo by echo and pixel by pixel with a reference, such as '
            '`sar_imaging.backends.reference`')


def run_checks(checks: Mapping[str, Callable[..., str]], of: str, *arguments: Any) -> list[str]:
    """Run checks, each of which returns what it found or raises, and tell what they found.

    Raises
    ------
    ValueError
        Some failed: a line for each.
    """
    found, faults = [], []
    for title, check in checks.items():
        try:
            found.append(f'{title}: {check(*arguments)}')
        except Exception as error:  # whatever the checked code raises is a finding
            what = ''
            if not isinstance(error, ValueError):
                place = traceback.extract_tb(error.__traceback__)[-1]
                what = f'{type(error).__name__} in {place.name}, line {place.lineno}: '
            faults.append(f'{title}: {what}{error}')
    if faults:
        raise ValueError(f'{of}: {len(faults)} of {len(checks)} checks failed\n- '
                         + '\n- '.join(faults))
    return found


def check_backend(name: str | protocol.Backend) -> list[str]:
    """Check that a backend computes plans: all entries, all routes of exact images and of AFBP.

    Parameters
    ----------
    name : str or Backend
        As for `backend`: a name, or an object with the four entries.

    Returns
    -------
    list of str
        What was found, a sentence for each check.

    Raises
    ------
    ValueError
        Entries are missing, or checks failed: a line for each, with what was expected, what came
        and what to do.

    Examples
    --------
    >>> import types
    >>> from sar_imaging.backends import reference
    >>> from sar_imaging.backends.checks import check_backend
    >>> check_backend(types.SimpleNamespace(Backprojection=reference.Backprojection))
    Traceback (most recent call last):
        ...
    ValueError: backend=namespace(...); expected ... that has SubapertureImager, ...
    """
    return run_checks(BACKEND_CHECKS, f'backend={name!r}', backend(name))


def _arguments(function: Callable[..., Any]) -> list[tuple[str, Any, Any]]:
    given = inspect.signature(function).parameters.values()
    return [(p.name, p.kind, p.default) for p in given if p.name != 'self']


def _check_arguments(made: protocol.Backend) -> str:
    def same(name: str, found: Any, wanted: Any) -> None:
        if isinstance(wanted, property):
            if not isinstance(found, property):
                raise ValueError(f'expected a property {name}, got {found!r}; write @property')
        elif not callable(found) or _arguments(found) != _arguments(wanted):
            given = inspect.signature(found) if callable(found) else found
            raise ValueError(f'expected {name}{inspect.signature(wanted)}, got {given}; take the '
                             'arguments of backends/protocol.py with their defaults')

    for entry in ('Backprojection', 'SubapertureImager', 'SpectrumFusion'):
        same(entry, getattr(made, entry), getattr(protocol.Backend, entry))
        promised = vars(getattr(protocol, entry))
        for name in (m for m in promised if not m.startswith('_')):
            same(f'{entry}.{name}', getattr(getattr(made, entry), name, None), promised[name])
    same('form_map', made.form_map, protocol.Backend.form_map)
    return 'those of the protocol'


def _check_exact(made: protocol.Backend, route: str, **options: Any) -> str:
    """Images of one route against correlation, at two targets."""
    if route == 'illuminated' and not getattr(made, 'ILLUMINATION', False):
        return 'not offered: ILLUMINATION is not true'
    if route == 'groups' and not getattr(made, 'GROUPS', False):
        return 'not offered: GROUPS is not true'
    scene = make_scene(**options)
    grid: MapGrid | PlaneGrid | VolumeGrid = scene.grid
    block, echoes = scene.block, scene.echoes
    x, y, z = scene.grid.centre_m
    if route == 'wall':
        grid = PlaneGrid((x, y - 5.0, z), (0.02, 0.25, 0.0), (0.1, 0.0, 0.3), 40, 20)
    elif route == 'volume':
        grid = VolumeGrid((x - 4.0, y - 4.0, z), (0.25, 0.0, 0.0), (0.0, 0.25, 0.01),
                          (0.0, 0.0, 0.5), 30, 25, 3)
    points, illumination = grid.points(), None
    pixels: MapGrid | PlaneGrid | VolumeGrid | ImagePoints = grid
    if route == 'hills':
        points[..., 2] += 3.0 * np.exp(-(points[..., 1] / 4.0) ** 2)
        points[5, 7, 2] = np.nan
        pixels = ImagePoints.of_grid(PointGrid(points))
    elif route == 'illuminated':
        illumination = Illumination.of_pulses(PATTERN, block.pointing, *block.centres_m)
    known, scale = np.isfinite(points).all(axis=-1), 1.0 if block.compressed else block.n_samples
    wanted = np.where(known, scene.correlation(
        np.nan_to_num(points), illuminated=illumination is not None), 0) / scale
    band = None if block.compressed else PhaseHistory(block.radar, block.n_samples)
    radar, told = (band or block).radar, ''
    for target_db in (-60.0, -80.0):
        plan = plan_backprojection(pixels, radar, block.n_samples, *echoes[1:], target_db,
                                   illumination, band=band)
        if route in ('polar', 'parts'):  # a route for larger images than these
            polar = plan_polar(scene.grid, *echoes[1:], radar, block.n_samples, target_db,
                               band=band)
            assert polar is not None
            plan = dataclasses.replace(plan, route=polar)
        elif route == 'groups':
            with using(dataclasses.replace(costs(), point_pixel=1e6)):
                groups = plan_groups(scene.grid, radar, block.n_samples, *echoes[1:],
                                     plan.range_m, target_db, band=band)
            assert groups is not None
            plan = dataclasses.replace(plan, route=groups)
        image = np.zeros(grid.shape, np.complex64)
        made.Backprojection(plan).add(*echoes, image)
        if not (image[~known] == 0).all():
            raise ValueError(f'expected 0 at pixels whose position is NaN, got {image[~known]}; '
                             'leave them as they are')
        told = agrees(image, wanted, total_db(*plan.errors_db.values()) + CHANCE_DB)
    return told


def _afbp_plan(scene: CheckScene, target_db: float, route: str, illumination: Illumination | None
               ) -> tuple[SubaperturePlan, float]:
    """Plan of the sub-apertures, and the predicted error of the map."""
    grid, block = scene.grid, scene.block
    band = None if block.compressed else PhaseHistory(block.radar, block.n_samples)
    centres = block.centres_m
    cover, polar_db = cover_for_fusion(grid, *centres, block.radar, block.n_samples, target_db,
                                       band)
    plan = plan_subapertures(cover.polar, block.radar, block.n_samples, *centres,
                             target_db=polar_db, cover=cover, band=band, illumination=illumination,
                             pulses_per_subaperture=16 if route == 'beams' else 48)
    beams = None
    if route == 'beams':  # a route for larger images than these
        some = [(centres[0][p].reshape(-1, 3), centres[1][p].reshape(-1, 3))
                for p in plan.sampling.pulses]
        beams = plan_beams(plan.coarse, plan.radar, plan.resampling, some, target_db - 6.0,
                           plan.range_m[1] - plan.range_m[0])
    plan = dataclasses.replace(plan, beams=beams)
    own_db = total_db(*plan.errors_db.values())
    return plan, total_db(own_db, cover.polar_to_map_db, cover.profile_db)


def _check_afbp(made: protocol.Backend, route: str, **options: Any) -> str:
    """Both stages and the map against correlation, at two targets."""
    if route == 'illuminated' and not getattr(made, 'ILLUMINATION', False):
        return 'not offered: ILLUMINATION is not true'
    scene = make_scene(pulses=144, **options)
    block, grid, illumination = scene.block, scene.grid, None
    if route == 'illuminated':
        illumination = Illumination.of_pulses(PATTERN, block.pointing, *block.centres_m)
    weights = (0.5 + 0.5 * np.sin(0.02 * np.arange(block.n_pulses))).astype(np.float32)
    factors = weights[:, None, None] / (1 if block.compressed else block.n_samples)
    wanted, told = scene.correlation(grid.points(), factors,
                                     illuminated=illumination is not None), ''
    for target_db in (-50.0, -60.0):
        plan, predicted_db = _afbp_plan(scene, target_db, route, illumination)
        stage, fusion = made.SubapertureImager(plan), made.SpectrumFusion(plan.fusion_grid)
        for number, pulses in enumerate(plan.sampling.pulses):
            image = stage.image(number, block.select(pulses), weights[pulses])
            fusion.add(number, image, plan.sampling.centre[number])
        image = made.form_map(fusion.take_polar_image(), plan.fusion_grid, grid, overwrite=True)
        told = agrees(image, wanted, predicted_db + CHANCE_DB)
    return told


def _check_contributions(made: protocol.Backend) -> str:
    """Contributions are added, replaced, removed, and given at baseband along direction."""
    plan, _ = _afbp_plan(make_scene(1000.0, pulses=144), -50.0, 'directly', None)
    rng, grid = np.random.default_rng(5), plan.fusion_grid
    shape = 4, 2, grid.n_coarse, grid.n_coarse_range
    images = rng.standard_normal(shape).astype(np.float32)
    both = [b.SpectrumFusion(grid, keep=True) for b in (made, reference)]
    for fusion in both:
        for number in range(3):
            fusion.add(number, images[number], 10.0 * number)
        fusion.add(1, images[3][0] + 1j * images[3][1], -7.0)
        fusion.remove(0)
        if fusion.included != {1, 2}:
            raise ValueError(f'expected included={{1, 2}} after 0, 1 and 2 were added and 0 was '
                             f'removed, got {fusion.included}; keep the numbers')
    found, wanted = (np.array([1, 1j]) @ fusion.polar_image(15.0).reshape(2, -1)
                     for fusion in both)
    told = agrees(found, wanted, -125.0)  # float32 in transforms and tapers
    fusion = both[0]
    whole = fusion.polar_image()
    if not np.array_equal(fusion.take_polar_image(), whole):
        raise ValueError('expected the same of take_polar_image as of polar_image, got another '
                         'image; let it return the same sums')
    if fusion.included or fusion.polar_image().any():
        raise ValueError('expected nothing after take_polar_image, got '
                         f'included={fusion.included}; begin anew, as `clear` does')
    return told


def _check_refusals(made: protocol.Backend) -> str:
    """What breaks the rules of fusion is refused with a sentence."""
    plan, _ = _afbp_plan(make_scene(1000.0, pulses=144), -50.0, 'directly', None)
    grid = plan.fusion_grid
    image = np.zeros((2, grid.n_coarse, grid.n_coarse_range), np.float32)
    fusion = made.SpectrumFusion(grid)
    fusion.add(0, image, 0.0)
    whole = dataclasses.replace(grid, alpha_oversampling=1.0)
    for what, words, action in (
            ('a sub-aperture that is in already', 'already; fuse with keep=True',
             lambda: fusion.add(0, image, 0.0)),
            ('removing what was not kept', 'contributions are not kept', lambda: fusion.remove(0)),
            ('an image of another shape', 'image.shape=(3,)',
             lambda: fusion.add(1, np.zeros(3), 0.0)),
            ('a centre that is not finite', 'centre_m=nan', lambda: fusion.add(1, image, np.nan)),
            ('a grid that is not for a map', 'not sampled finely enough',
             lambda: made.form_map(image, whole, cast(Any, None)))):
        try:
            action()
        except ValueError as error:
            if words in str(error):
                continue
            raise ValueError(f'{what}: expected an error that says {words!r}, got {error}; say '
                             'so') from error
        raise ValueError(f'{what}: expected a ValueError that says {words!r}, got none; refuse it')
    return 'as the protocol says'


def _check_correlation(made: protocol.Backend) -> str:
    scene, told = make_scene(1000.0, apart_m=40.0, channels=2), ''
    points, block = scene.grid.points().reshape(-1, 3)[::7], scene.block
    wanted = scene.correlation(points)
    if correlate := getattr(made, 'correlate_spectra', None):
        step = scene.frequencies_hz[1] - scene.frequencies_hz[0]
        image = correlate((scene.frequencies_hz[0] / SPEED_OF_LIGHT, step / SPEED_OF_LIGHT),
                          scene.spectra, block.tx_m, block.rx_m, points)
        told += f'spectra: {agrees(image, wanted, -180.0)}; '  # 1e4 wavelengths in float64
    if correlate := getattr(made, 'correlate_profiles', None):
        sharpness, half = np.arcsinh(10 ** (130 / 20)), 20  # a = pi h (1 - B / f_s), -130 dB
        image, _ = correlate(block.radar, block.samples, block.tx_m, block.rx_m, points, half,
                             sharpness)
        told += f'profiles: {agrees(image, wanted, -125.0)}'
    return told or 'not offered'


def _check_trial_images(made: protocol.Backend) -> str:
    trials = getattr(made, 'TrialImages', None)
    if trials is None:
        return 'not offered'
    scene = make_scene(1000.0, apart_m=40.0)
    samples, tx_m, rx_m = scene.echoes
    trial, step_m = trials(scene.block.radar, samples), np.array([0.25, 0.0, 0.0])
    starts = np.array(scene.grid.centre_m) + np.c_[np.linspace(-5, 1, 40), np.linspace(-5, 5, 40),
                                                   np.zeros(40)]
    points = starts[:, None] + np.arange(trial.length)[:, None] * step_m
    real, imaginary = trial.image(tx_m, rx_m, starts, step_m)
    # profiles sampled at 4/3 of their band and linear between samples: -13 dB
    return agrees(real + 1j * imaginary, scene.correlation(points), -10.0)


_exact, _afbp = (functools.partial(functools.partial, check)
                 for check in (_check_exact, _check_afbp))
#: What is checked of a backend; each check takes it.
BACKEND_CHECKS: Mapping[str, Callable[[protocol.Backend], str]] = {
    'arguments of the entries': _check_arguments,
    'exact map along lines': _exact(route='lines', range_m=1000.0, height_m=300.0),
    'exact map of receivers far apart': _exact(
        route='lines', range_m=1000.0, apart_m=40.0, channels=2),
    'exact map nearby': _exact(route='points', range_m=30.0, aperture_m=3.0),
    'exact points, one without position': _exact(route='hills', range_m=500.0, height_m=100.0),
    'exact plane': _exact(route='wall', range_m=300.0, height_m=20.0),
    'exact volume': _exact(route='volume', range_m=1000.0, height_m=300.0),
    'exact map from a polar image': _exact(route='polar', range_m=1000.0, bend_m=3.0),
    'exact map from polar images of parts': _exact(
        route='parts', range_m=400.0, pulses=200, aperture_m=60.0),
    'exact map from groups of echoes': _exact(
        route='groups', range_m=30.0, pulses=100, aperture_m=3.0, bend_m=0.3, n=40, apart_m=2.0),
    'exact map under a pattern': _exact(route='illuminated', range_m=1000.0),
    'exact points of phase histories': _exact(
        route='hills', range_m=500.0, height_m=100.0, history=True),
    'exact map of phase histories from a polar image': _exact(
        route='polar', range_m=1000.0, bend_m=3.0, history=True),
    'exact map of phase histories from groups of echoes': _exact(
        route='groups', range_m=30.0, pulses=100, aperture_m=3.0, n=40, history=True),
    'exact map of phase histories under a pattern': _exact(
        route='illuminated', range_m=1000.0, history=True),
    'AFBP': _afbp(route='directly', range_m=1000.0, height_m=300.0),
    'AFBP of phase histories': _afbp(route='directly', range_m=3000.0, history=True),
    'AFBP by beams': _afbp(route='beams', range_m=3000.0, channels=2, bend_m=2.0),
    'AFBP of phase histories by beams': _afbp(route='beams', range_m=1000.0, history=True),
    'AFBP under a pattern': _afbp(route='illuminated', range_m=1000.0),
    'contributions of sub-apertures': _check_contributions,
    'what fusion refuses': _check_refusals,
    'correlation': _check_correlation,
    'trial images': _check_trial_images,
}
