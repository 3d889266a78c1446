"""Small images whose times show the costs of operations: pairs that differ in one count."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from sar_imaging.backends import CUDA, backend
from sar_imaging.device_arrays import alike, zeros_beside
from sar_imaging.geometry.illumination import AntennaPattern, Illumination, PatternCut, Pointing
from sar_imaging.imaging.imager import plan_image
from sar_imaging.memory import check_memory
from sar_imaging.planning.afbp.beams import BeamSampling
from sar_imaging.planning.afbp.edge_brightness import EdgeBrightness
from sar_imaging.planning.afbp.lit_subapertures import LitSubapertures
from sar_imaging.planning.afbp.plan import AfbpPlan, plan_afbp
from sar_imaging.planning.costs import DEFAULT, using
from sar_imaging.planning.exact.backprojection import BackprojectionPlan, plan_backprojection
from sar_imaging.planning.exact.polar_image import plan_polar
from sar_imaging.planning.lit_pairs import LEAST_DB
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.tools.costs.scenes import DEVICE, PROCESSOR, Scene, Scenes

# Overheads of a sub-aperture are told apart; the model has their sum.
IMAGE_OVERHEAD, FUSION_OVERHEAD = 'subaperture, its image', 'subaperture, its fusion'

_NEVER, _ALWAYS = 1e9, 1e-6  # costs that choose ways
_SAMPLE_BYTES = 8
_APART, _WIDE_RAD = (16, 1), 1.0  # segments between knots of amplitudes; of an antenna


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


def experiments(name: str = 'cpu', scenes: Scenes | None = None) -> Iterator[Experiment]:
    """What is timed, one after the other.

    Parameters
    ----------
    name : str
        Backend whose costs are wanted: ``'cpu'`` or ``'cuda'``. Samples and images lie on a
        device beforehand, and the way there is timed by itself.
    scenes : Scenes, optional
        `scenes.PROCESSOR` or `scenes.DEVICE` if left out.

    Raises
    ------
    DeviceError
        There is no device that works.
    """
    scenes = scenes or (DEVICE if name == CUDA else PROCESSOR)
    yield from _Experiments(name, scenes).all()


class _Experiments:
    """Those of one backend."""

    def __init__(self, name: str, scenes: Scenes):
        self._backend, self._scenes = backend(name), scenes
        there = name == CUDA
        self._like = self._backend.to_device(np.zeros((1, 1), np.complex64)) if there else None
        self._finish = self._backend.synchronise if there else lambda: None

    def all(self) -> Iterator[Experiment]:
        yield from self._along_lines()
        yield from self._onto_points()
        yield from self._by_polar_images()
        yield from self._by_afbp()
        yield from self._by_ffbp()
        yield from self._transfers()

    def _experiment(self, name: str, operations: Mapping[str, float],
                    work: Callable[[], object]) -> Experiment:
        def run():
            work()
            self._finish()

        return Experiment(name, operations, run)

    def _placed(self, array):
        """An array where the backend works."""
        return alike(array, self._like)

    def _exact(self, name: str, plan: BackprojectionPlan, block: PulseBlock) -> Experiment:
        """An image of its own, as imagers make it."""
        entry, shape = self._backend.Backprojection(plan), plan.grid.shape
        rows = self._placed(block.samples[:, 0]), plan.tx_m, plan.rx_m

        def work():
            check_memory(_SAMPLE_BYTES * math.prod(shape), 'an image', 'choose a smaller one')
            entry.add(*rows, zeros_beside(shape, self._like))

        return self._experiment(name, plan.operations, work)

    def _along_lines(self) -> Iterator[Experiment]:
        """Sizes tell pixels from profiles, fine pixels cells from bins, segments their cost."""
        for scene in self._scenes.lines:
            plan, block = _planned(scene, point_pixel=_NEVER, map_pixel=_NEVER)
            longest = plan.route.lattice.segment
            first = self._scenes.varied and scene is self._scenes.lines[0]
            shorter = (longest // 4, longest // 16) if first else ()
            for segment in (longest, *shorter):
                lattice = dataclasses.replace(plan.route.lattice, segment=segment)
                route = dataclasses.replace(plan.route, lattice=lattice)
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
        for apart in _APART:
            yield self._lit_image(planned, plan, whole.select(slice(0, 4)), apart)

    def _image(self, beams: BeamSampling | None, plan: AfbpPlan, some: PulseBlock) -> Experiment:
        stage = dataclasses.replace(plan.subapertures, beams=beams)
        image = self._backend.SubapertureImager(stage)
        out = image.image(0, some)
        counts = {**stage.image_operations(some.n_pulses * some.n_channels), IMAGE_OVERHEAD: 1}
        return self._experiment('beams', counts, lambda: image.image(0, some, None, out))

    def _lit_image(self, beams: BeamSampling, plan: AfbpPlan, some: PulseBlock, apart: int
                   ) -> Experiment:
        """With an antenna that lights everything, its amplitudes at knots so far apart."""
        some = dataclasses.replace(some, pointing=Pointing.steered(some.phase_centre_m,
                                                                   plan.grid.centre_m))
        light = Illumination.of_pulses(AntennaPattern(PatternCut.gaussian(_WIDE_RAD)),
                                       some.pointing, some.tx_m, some.rx_m)
        lit = LitSubapertures(light, frozenset((0,)), apart, None, 1.0, LEAST_DB)
        stage = dataclasses.replace(plan.subapertures, lit=lit)
        return self._image(dataclasses.replace(beams, n_weighed=1),
                           dataclasses.replace(plan, subapertures=stage), some)

    def _fusion(self, plan: AfbpPlan) -> Experiment:
        stage = plan.subapertures
        grid, sampling = stage.fusion_grid, stage.sampling
        fusion = self._backend.SpectrumFusion(grid)
        image = self._placed(_noise(grid.n_coarse, grid.n_coarse_range))
        counts = stage.fusion_operations
        counts[FUSION_OVERHEAD] = counts.pop('subaperture')

        def work():
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


def _planned(scene: Scene, **costs) -> tuple[BackprojectionPlan, PulseBlock]:
    """Plan of an exact image with other costs, and the pulses."""
    block = scene.block()
    with using(dataclasses.replace(DEFAULT, **costs)):
        return plan_backprojection(scene.grid, block.radar, block.n_samples, block.tx_m[:, 0],
                                   block.rx_m[:, 0], -80.0), block


def _noise(n_lines: int, n_pixels: int) -> np.ndarray:
    """(2, n_lines, n_pixels) float32."""
    return np.random.default_rng(0).standard_normal((2, n_lines, n_pixels), np.float32)
