# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Costs of the operations of imaging on this machine: of its processor, or of a CUDA device.

Small images show them by their times, in pairs that differ in one count. Their samples are noise,
since no time depends on them. Costs are fitted to the times, taken on one thread or a device.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import scipy.optimize
from tqdm import tqdm

from ..backends import CUDA, backend
from ..backends.edge_brightness import EdgeBrightness
from ..compilation import one_thread
from ..device_arrays import alike, zeros_beside
from ..geometry.grids import MapGrid
from ..geometry.illumination import AntennaPattern, Illumination, PatternCut, Pointing
from ..imaging.imager import plan_image
from ..memory import check_memory
from ..planning.afbp.beams import BeamSampling
from ..planning.afbp.illumination import SubapertureAmplitudes
from ..planning.afbp.plan import AfbpPlan, plan_afbp
from ..planning.costs import DEFAULT, CostModel, using
from ..planning.echo_pixels import LEAST_DB
from ..planning.exact.backprojection import BackprojectionPlan, plan_backprojection
from ..planning.exact.groups import plan_groups
from ..planning.exact.polar_image import plan_polar
from ..signal.pulses import PulseBlock
from ..signal.radar import SPEED_OF_LIGHT, RadarParameters

_CARRIER_HZ, _OVERSAMPLING, _BEYOND = 10e9, 1.4, 160


@dataclasses.dataclass(frozen=True)
class TimedMap:
    """Map beside a straight track, and pulses of noise.

    Attributes
    ----------
    range_m : float
        From the middle of the track to that of the map, metres.
    n_x, n_y : int
        Pixels of the map.
    n_pulses : int
        Pulses.
    spacing_m : float
        Spacing of the pixels; range resolution and aperture resolve 0.5 m.
    n_channels : int
        Channels, in one place.
    """

    range_m: float
    n_x: int
    n_y: int
    n_pulses: int
    spacing_m: float = 0.25
    n_channels: int = 1

    @property
    def grid(self) -> MapGrid:
        """The map."""
        return MapGrid((0.0, 0.0, 0.0), self.n_x, self.n_y, self.spacing_m)

    def block(self) -> PulseBlock:
        """The pulses, range profiles."""
        aperture = SPEED_OF_LIGHT / _CARRIER_HZ * self.range_m
        tx = np.zeros((self.n_pulses, self.n_channels, 3))
        tx[..., 0] = -self.range_m
        tx[..., 1] = np.linspace(-0.5, 0.5, self.n_pulses)[:, None] * aperture
        far = self.spacing_m * math.hypot(self.n_x, self.n_y) / 2
        rate = _OVERSAMPLING * SPEED_OF_LIGHT
        spacing = SPEED_OF_LIGHT / (2 * rate)
        n_samples = math.ceil(2 * far / spacing) + 2 * _BEYOND
        start = self.range_m - far - _BEYOND * spacing
        radar = RadarParameters(_CARRIER_HZ, SPEED_OF_LIGHT, rate, 2 * start / SPEED_OF_LIGHT)
        rng = np.random.default_rng(0)
        samples = rng.standard_normal((*tx.shape[:2], 2 * n_samples), np.float32)
        number = np.arange(self.n_pulses)
        return PulseBlock(radar, True, number, number, samples.view(np.complex64), tx, tx.copy())


@dataclasses.dataclass(frozen=True)
class TimedMaps:
    """Maps by what is timed with them.

    Attributes
    ----------
    lines, points, polar : tuple of TimedMap
        Lines, points and polar grid of exact images.
    groups : tuple of (TimedMap, ((int, int), ...))
        Images from groups of echoes, with numbers of these and of their parts; empty where that is
        not offered.
    afbp : tuple of (TimedMap, int)
        And the lengths of their sub-apertures.
    ffbp : tuple of TimedMap
        With each kernel; empty where that is not offered.
    transfers : tuple of int
        Bytes that are copied to a device and back.
    varied : bool
        Segments of lines and beams are also changed, number by number.
    """

    lines: tuple[TimedMap, ...]
    points: tuple[TimedMap, ...]
    polar: tuple[TimedMap, ...]
    afbp: tuple[tuple[TimedMap, int], ...]
    groups: tuple[tuple[TimedMap, tuple[tuple[int, int], ...]], ...] = ()
    ffbp: tuple[TimedMap, ...] = ()
    transfers: tuple[int, ...] = ()
    varied: bool = True


#: Half a minute on one thread.
PROCESSOR = TimedMaps(
    lines=(TimedMap(1e4, 512, 512, 48), TimedMap(1e4, 2048, 8, 64),
           TimedMap(1e4, 2048, 8, 64, 0.06), TimedMap(1e4, 48, 48, 4)),
    points=(TimedMap(1e3, 256, 256, 48), TimedMap(1e3, 1024, 8, 64)),
    polar=(TimedMap(1e3, 384, 384, 192), TimedMap(1e3, 96, 96, 192)),
    afbp=((TimedMap(1e3, 64, 1024, 1024, n_channels=4), 96), (TimedMap(1e3, 1024, 1024, 1024), 24),
          (TimedMap(3e3, 2048, 2048, 2048), 128)),
    groups=((TimedMap(400, 256, 256, 192), ((4, 1), (4, 12), (8, 4))),
            (TimedMap(400, 40, 512, 24), ((1, 1), (2, 1))),
            (TimedMap(400, 512, 40, 24), ((1, 1), (2, 1))),
            (TimedMap(400, 32, 32, 48), ((4, 2), (16, 1)))),
    ffbp=(TimedMap(1e3, 256, 256, 512), TimedMap(1e3, 768, 768, 32)))
#: Enough work that a device is busy: images of 1 to 100 ms.
DEVICE = TimedMaps(
    lines=(TimedMap(1e4, 2048, 2048, 256), TimedMap(1e4, 8192, 32, 1024),
           TimedMap(1e4, 8192, 32, 1024, 0.06), TimedMap(1e4, 48, 48, 4)),
    points=(TimedMap(1e3, 1024, 1024, 256), TimedMap(1e3, 4096, 32, 512)),
    polar=(TimedMap(1e3, 1536, 1536, 768), TimedMap(1e3, 384, 384, 768)),
    afbp=((TimedMap(1e3, 64, 1024, 1024, n_channels=4), 96), (TimedMap(1e3, 1024, 1024, 1024), 24),
          (TimedMap(3e3, 4096, 4096, 4096), 128)),
    transfers=(1 << 16, 1 << 26))


# Overheads of a sub-aperture are told apart; the model has their sum.
IMAGE_OVERHEAD, FUSION_OVERHEAD = 'subaperture, its image', 'subaperture, its fusion'

_NEVER, _ALWAYS = 1e9, 1e-6  # costs that choose ways
_SAMPLE_BYTES = 8
_WIDE_RAD = 1.0  # of an antenna


@dataclasses.dataclass(frozen=True)
class Experiment:
    """Something to be timed.

    Attributes
    ----------
    name : str
        What it is, for people.
    operations : mapping of str to float
        How often it does each operation of `CostModel`.
    run : callable
        Does it once.
    """

    name: str
    operations: Mapping[str, float]
    run: Callable[[], object]


class _Experiments:
    """What is timed of one backend.

    Samples and images lie on a device beforehand, and the way there is timed by itself.
    """

    def __init__(self, name: str) -> None:
        there = name == CUDA
        self._backend, self._scenes = backend(name), DEVICE if there else PROCESSOR
        self._like = self._backend.to_device(np.zeros((1, 1), np.complex64)) if there else None
        self._finish = self._backend.synchronise if there else lambda: None

    def all(self) -> Iterator[Experiment]:
        yield from self._along_lines()
        yield from self._onto_points()
        yield from self._by_polar_images()
        yield from self._by_groups()
        yield from self._by_afbp()
        yield from self._by_ffbp()
        yield from self._transfers()

    def _experiment(self, name: str, operations: Mapping[str, float],
                    work: Callable[[], object]) -> Experiment:
        def run() -> None:
            work()
            self._finish()

        return Experiment(name, operations, run)

    def _placed(self, array: np.ndarray) -> np.ndarray:
        """An array where the backend works."""
        return alike(array, self._like)

    def _exact(self, name: str, plan: BackprojectionPlan, block: PulseBlock) -> Experiment:
        """An image of its own, as imagers make it."""
        entry, shape = self._backend.Backprojection(plan), plan.grid.shape
        rows = self._placed(block.samples[:, 0]), plan.tx_m, plan.rx_m

        def work() -> None:
            check_memory(_SAMPLE_BYTES * math.prod(shape), 'an image', 'choose a smaller one')
            entry.add(*rows, zeros_beside(shape, self._like))

        return self._experiment(name, plan.operations, work)

    def _along_lines(self) -> Iterator[Experiment]:
        """Sizes tell pixels from profiles, fine pixels cells from bins, segments their cost."""
        for scene in self._scenes.lines:
            plan, block = _planned(scene, point_pixel=_NEVER, map_pixel=_NEVER)
            longest = plan.route.resampling.segment
            first = self._scenes.varied and scene is self._scenes.lines[0]
            shorter = (longest // 4, longest // 16) if first else ()
            for segment in (longest, *shorter):
                resampling = dataclasses.replace(plan.route.resampling, segment=segment)
                route = dataclasses.replace(plan.route, resampling=resampling)
                yield self._exact(f'lines of {segment} pixels',
                                  dataclasses.replace(plan, route=route), block)

    def _onto_points(self) -> Iterator[Experiment]:
        for scene in self._scenes.points:
            yield self._exact('points', *_planned(scene, point_pixel=_ALWAYS))

    def _by_polar_images(self) -> Iterator[Experiment]:
        """In many parts, in fewer, and as a whole."""
        for scene in self._scenes.polar:
            plan, block = _planned(scene)
            for pixel in (0.01, 2.0, _NEVER):
                with using(dataclasses.replace(DEFAULT, upsampled_pixel=pixel,
                                               upsampled_part=1.0)):
                    route = plan_polar(scene.grid, plan.tx_m, plan.rx_m, block.radar,
                                     block.n_samples, -80.0)
                n_parts = 1 if route.parts is None else len(route.parts.echoes)
                yield self._exact(f'polar image in {n_parts}',
                                  dataclasses.replace(plan, route=route), block)

    def _by_groups(self) -> Iterator[Experiment]:
        """With few parts and many, of few groups and many, and segments of lines shortened."""
        for scene, numbers in self._scenes.groups:
            plan, block = _planned(scene)
            where = scene.grid, block.radar, block.n_samples, plan.tx_m, plan.rx_m, plan.range_m
            for some in numbers:
                for target_db in (-80.0, -45.0):
                    route = plan_groups(*where, target_db, some)
                    found = dataclasses.replace(plan, route=route)
                    yield self._exact(f'{some[0]} groups of {some[1]} parts', found, block)
            assert route is not None  # of such scenes
            resampling = dataclasses.replace(route.resampling, segment=16)
            short = dataclasses.replace(route.maps[0], resampling=resampling)
            yield self._exact('groups of short segments', dataclasses.replace(
                plan, route=dataclasses.replace(route, maps=(short,))), block)

    def _by_afbp(self) -> Iterator[Experiment]:
        """Sub-apertures from beams, of few rows and many, long profiles and short; the map."""
        plan = None
        for scene, length in self._scenes.afbp:
            block = scene.block()
            with using(dataclasses.replace(DEFAULT, line_pixel=_NEVER)):
                plan = plan_afbp(scene.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                                 target_db=-50.0, pulses_per_subaperture=length)
            if hasattr(self._backend, 'ApertureFusion'):
                yield from self._apertures(plan, block)
            else:
                yield from self._images(plan, block)
                yield self._fusion(plan)
        if plan is not None:
            yield self._map(plan)

    def _apertures(self, plan: AfbpPlan, block: PulseBlock) -> Iterator[Experiment]:
        """Both stages of whole apertures, by a backend that computes them at once."""
        block = dataclasses.replace(block, samples=self._placed(block.samples))
        planned = plan.subapertures
        changes = ({}, {'uneven_m': 0.0}, {'spacing': 0.4 * planned.beams.spacing}) if (
            planned.beams and self._scenes.varied) else ({},)
        for changed in changes:
            beams = planned.beams and dataclasses.replace(planned.beams, **changed)
            stage = dataclasses.replace(planned, beams=beams)
            counts = {**stage.image_operations(block.n_pulses * block.n_channels,
                                               stage.n_subapertures), **stage.fusion_operations}
            n = counts.pop('subaperture')
            yield self._experiment(
                'AFBP', counts | {IMAGE_OVERHEAD: n, FUSION_OVERHEAD: n},
                functools.partial(self._backend.ApertureFusion(stage).polar_image, block,
                                  None, EdgeBrightness(stage.fusion_grid)))

    def _images(self, plan: AfbpPlan, block: PulseBlock) -> Iterator[Experiment]:
        """Sub-aperture images with beams as planned, and with each number changed by itself."""
        block = dataclasses.replace(block, samples=self._placed(block.samples))
        whole = block.select(plan.subapertures.sampling.pulses[0])
        planned = plan.subapertures.beams
        if planned is None or not self._scenes.varied:
            yield self._image(planned, plan, whole)
            return
        finer = {'spacing': 0.4 * planned.spacing}
        for changed in ({}, {'group': 2}, {'uneven_m': 0.0}, finer):
            yield self._image(dataclasses.replace(planned, **changed), plan, whole)
        for changed in ({}, {'segment': 16}, finer):  # of a few rows: what pixels and cells take
            yield self._image(dataclasses.replace(planned, **changed), plan,
                              whole.select(slice(0, 4)))
        for changed in ({}, {'segment': 16}):
            yield self._weighed_image(dataclasses.replace(planned, n_weighed=1, **changed), plan,
                                      whole.select(slice(0, 4)))

    def _image(self, beams: BeamSampling | None, plan: AfbpPlan, some: PulseBlock) -> Experiment:
        stage = dataclasses.replace(plan.subapertures, beams=beams)
        image = self._backend.SubapertureImager(stage)
        out = image.image(0, some)
        counts = {**stage.image_operations(some.n_pulses * some.n_channels), 'image': 1,
                  IMAGE_OVERHEAD: 1}
        return self._experiment('beams', counts, lambda: image.image(0, some, None, out))

    def _weighed_image(self, beams: BeamSampling, plan: AfbpPlan, some: PulseBlock) -> Experiment:
        """With an antenna that lights everything."""
        some = dataclasses.replace(some, pointing=Pointing.steered(some.phase_centre_m,
                                                                   plan.grid.centre_m))
        light = Illumination.of_pulses(AntennaPattern(PatternCut.gaussian(_WIDE_RAD)),
                                       some.pointing, some.tx_m, some.rx_m)
        amplitudes = SubapertureAmplitudes(light, frozenset((0,)), None, 1.0, LEAST_DB)
        stage = dataclasses.replace(plan.subapertures, amplitudes=amplitudes)
        return self._image(beams, dataclasses.replace(plan, subapertures=stage), some)

    def _fusion(self, plan: AfbpPlan) -> Experiment:
        stage = plan.subapertures
        grid, sampling = stage.fusion_grid, stage.sampling
        fusion = self._backend.SpectrumFusion(grid)
        image = self._placed(_noise(grid.n_coarse, grid.n_coarse_range))
        counts = stage.fusion_operations
        counts[FUSION_OVERHEAD] = counts.pop('subaperture')

        def work() -> None:
            brightness = EdgeBrightness(grid, sampling.coverage)
            fusion.clear()
            for number, centre in enumerate(sampling.centre):
                brightness.add(image)
                fusion.add(number, image, centre)
            fusion.take_polar_image()

        return self._experiment('fusion', counts, work)

    def _map(self, plan: AfbpPlan) -> Experiment:
        grid, fused = plan.grid, plan.subapertures.fusion_grid
        polar_image = self._placed(_noise(fused.polar.n_alpha, fused.polar.n_range))
        return self._experiment('polar image to map', {'map_pixel': grid.n_x * grid.n_y},
                                lambda: self._backend.form_map(polar_image, fused, grid))

    def _by_ffbp(self) -> Iterator[Experiment]:
        """With few neighbours and many; many pulses are merged, many pixels looked up."""
        for scene in self._scenes.ffbp:
            block = scene.block()
            for kernel, oversampling in (('linear', 4.0), ('knab8', 1.8)):
                imager = plan_image(scene.grid, block.radar, block.n_samples, block.tx_m,
                                    block.rx_m, method='ffbp', kernel=kernel, merge_factor=4,
                                    range_oversampling=oversampling,
                                    angle_oversampling=oversampling)
                yield self._experiment(f'FFBP, {kernel}', imager.report.plan.operations,
                                       functools.partial(imager, block))

    def _transfers(self) -> Iterator[Experiment]:
        """Samples to a device and back."""
        for n_bytes in self._scenes.transfers:
            samples = np.ones((64, n_bytes // 64 // _SAMPLE_BYTES), np.complex64)
            yield self._experiment(
                f'{n_bytes} bytes there and back', {'transferred_byte': 2 * samples.nbytes},
                lambda samples=samples: self._backend.to_host(self._backend.to_device(samples)))


def _planned(scene: TimedMap, **costs: float) -> tuple[BackprojectionPlan, PulseBlock]:
    """Plan of an exact image with other costs, and the pulses."""
    block = scene.block()
    with using(dataclasses.replace(DEFAULT, **costs)):
        return plan_backprojection(scene.grid, block.radar, block.n_samples, block.tx_m[:, 0],
                                   block.rx_m[:, 0], -80.0), block


def _noise(n_lines: int, n_pixels: int) -> np.ndarray:
    """(2, n_lines, n_pixels) float32."""
    return np.random.default_rng(0).standard_normal((2, n_lines, n_pixels), np.float32)


_ROUNDS, _LEAST_S = 7, 0.2  # of each experiment
_FURTHEST = 50.0  # from the default, a factor
# Weight of an equation that a cost has the common ratio to its default, which holds where times
# tell nothing of it
_COMMON = 0.1


@dataclasses.dataclass(frozen=True)
class Timing:
    """How long an experiment took.

    Attributes
    ----------
    name : str
        What it was.
    operations : mapping of str to float
        How often it did each operation.
    seconds : float
        Median of the rounds.
    """

    name: str
    operations: Mapping[str, float]
    seconds: float


def measure(name: str = 'cpu', *, rounds: int = _ROUNDS, least_s: float = _LEAST_S,
            progress: bool = False) -> list[Timing]:
    """Time all experiments, on one thread or on a device.

    Times of a processor are its own: what else it does in the meantime is not counted, though it
    takes from the cache. Those of a device end when it is done with all it was given.

    Parameters
    ----------
    name : str
        Backend, ``'cpu'`` or ``'cuda'``.
    rounds : int
        Rounds of each experiment, at least, after one that compiles and fetches memory.
    least_s : float
        Rounds take as long together, at least, seconds.
    progress : bool
        Show a progress bar on standard error.

    Raises
    ------
    DeviceError
        There is no device that works, or it fails.
    """
    clock = time.perf_counter if name == CUDA else time.process_time
    with one_thread():
        return [_timed(experiment, rounds, least_s, clock) for experiment in
                tqdm(_Experiments(name).all(), desc='experiments', unit='', disable=not progress)]


def _timed(experiment: Experiment, rounds: int, least_s: float,
           clock: Callable[[], float]) -> Timing:
    experiment.run()
    seconds: list[float] = []
    while len(seconds) < rounds or sum(seconds) < least_s:
        begin = clock()
        experiment.run()
        seconds.append(clock() - begin)
    return Timing(experiment.name, experiment.operations, statistics.median(seconds))


def solve(timings: Sequence[Timing], usual: CostModel = DEFAULT
          ) -> tuple[CostModel, np.ndarray]:
    """Costs with which predicted times are nearest to measured ones.

    Least squares of the relative errors, ``sum_i (sum_f n_if c_f / t_i - 1)^2``: the costs c_f are
    positive, and within a factor of 50 of the default.

    Parameters
    ----------
    timings : sequence of Timing
        Timings of all experiments.
    usual : CostModel
        The default: of the processor, or of a device.

    Returns
    -------
    model : CostModel
    predicted : (len(timings),) float64
        Predicted times over measured ones.
    """
    kind, usual = type(usual), dataclasses.asdict(usual)
    overhead = usual.pop('subaperture')
    usual |= dict.fromkeys((IMAGE_OVERHEAD, FUSION_OVERHEAD), overhead / 2)
    counts = np.array([[t.operations.get(name, 0.0) for name in usual] for t in timings])
    shares = 1e-9 * counts * list(usual.values()) / np.array([[t.seconds] for t in timings])
    n = len(usual)
    # Unknown are the ratios to the defaults, and last the one that they have in common.
    equations = np.vstack([np.c_[shares, np.zeros(len(timings))],
                           _COMMON * np.c_[np.eye(n), -np.ones(n)]])
    right = np.r_[np.ones(len(timings)), np.zeros(n)]
    ratios = scipy.optimize.lsq_linear(equations, right, (1 / _FURTHEST, _FURTHEST)).x[:n]
    found = {name: float(ratio * value)
             for ratio, (name, value) in zip(ratios, usual.items(), strict=True)}
    found['subaperture'] = found.pop(IMAGE_OVERHEAD) + found.pop(FUSION_OVERHEAD)
    return kind(**found), shares @ ratios
