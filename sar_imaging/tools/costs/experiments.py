"""Small images whose times show the costs of operations: pairs that differ in one count.

Their samples are noise, since no time depends on them.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from sar_imaging.backends import backend
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.memory import check_memory
from sar_imaging.planning.afbp.beams import BeamSampling
from sar_imaging.planning.afbp.edge_brightness import EdgeBrightness
from sar_imaging.planning.afbp.plan import AfbpPlan, plan_afbp
from sar_imaging.planning.baselines.ffbp_choice import plan_ffbp
from sar_imaging.planning.costs import DEFAULT, using
from sar_imaging.planning.exact.backprojection import BackprojectionPlan, plan_backprojection
from sar_imaging.planning.exact.polar_image import plan_polar
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters

# Overheads of a sub-aperture are told apart; the model has their sum.
IMAGE_OVERHEAD, FUSION_OVERHEAD = 'subaperture, its image', 'subaperture, its fusion'

_CARRIER_HZ, _OVERSAMPLING, _BEYOND = 10e9, 1.4, 160
_NEVER, _ALWAYS = 1e9, 1e-6  # costs that choose ways
_SAMPLE_BYTES = 8
_CPU = backend('cpu')  # whose costs they are


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


@dataclasses.dataclass(frozen=True)
class _Scene:
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
        Of the pixels; range resolution and aperture resolve 0.5 m.
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
        return MapGrid((0.0, 0.0, 0.0), self.n_x, self.n_y, self.spacing_m)

    def block(self) -> PulseBlock:
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


def experiments() -> Iterator[Experiment]:
    """What is timed, one after the other."""
    yield from _along_lines()
    yield from _onto_points()
    yield from _by_polar_images()
    yield from _by_afbp()
    yield from _by_ffbp()


def _exact(name: str, plan: BackprojectionPlan, block: PulseBlock) -> Experiment:
    """An image of its own, as imagers make it."""
    entry, shape = _CPU.Backprojection(plan), plan.grid.shape
    rows = block.samples[:, 0], plan.tx_m, plan.rx_m

    def run():
        check_memory(_SAMPLE_BYTES * math.prod(shape), 'an image', 'choose a smaller one')
        entry.add(*rows, np.zeros(shape, np.complex64))

    return Experiment(name, plan.operations, run)


def _planned(scene: _Scene, **costs) -> tuple[BackprojectionPlan, PulseBlock]:
    block = scene.block()
    with using(dataclasses.replace(DEFAULT, **costs)):
        return plan_backprojection(scene.grid, block.radar, block.n_samples, block.tx_m[:, 0],
                                   block.rx_m[:, 0], -80.0), block


def _along_lines() -> Iterator[Experiment]:
    """Sizes tell pixels from profiles, fine pixels cells from bins, segments their cost."""
    scenes = (_Scene(1e4, 512, 512, 48), _Scene(1e4, 2048, 8, 64), _Scene(1e4, 2048, 8, 64, 0.06),
              _Scene(1e4, 48, 48, 4))
    for scene in scenes:
        plan, block = _planned(scene, point_pixel=_NEVER, map_pixel=_NEVER)
        longest = plan.way.lattice.segment
        shorter = (longest // 4, longest // 16) if scene is scenes[0] else ()
        for segment in (longest, *shorter):
            lattice = dataclasses.replace(plan.way.lattice, segment=segment)
            way = dataclasses.replace(plan.way, lattice=lattice)
            yield _exact(f'lines of {segment} pixels', dataclasses.replace(plan, way=way), block)


def _onto_points() -> Iterator[Experiment]:
    for scene in (_Scene(1e3, 256, 256, 48), _Scene(1e3, 1024, 8, 64)):
        yield _exact('points', *_planned(scene, point_pixel=_ALWAYS))


def _by_polar_images() -> Iterator[Experiment]:
    """In many parts, in fewer, and as a whole."""
    for scene in (_Scene(1e3, 384, 384, 192), _Scene(1e3, 96, 96, 192)):
        plan, block = _planned(scene)
        for pixel in (0.01, 2.0, _NEVER):
            with using(dataclasses.replace(DEFAULT, upsampled_pixel=pixel, upsampled_part=1.0)):
                way = plan_polar(scene.grid, plan.tx_m, plan.rx_m, block.radar, block.n_samples,
                                 -80.0)
            n_parts = 1 if way.parts is None else len(way.parts.echoes)
            yield _exact(f'polar image in {n_parts}', dataclasses.replace(plan, way=way), block)


def _by_afbp() -> Iterator[Experiment]:
    """Sub-apertures from beams, of few rows and many, long profiles and short ones; the map."""
    for scene, length in ((_Scene(1e3, 64, 1024, 1024, n_channels=4), 96),
                          (_Scene(1e3, 1024, 1024, 1024), 24),
                          (_Scene(3e3, 2048, 2048, 2048), 128)):
        block = scene.block()
        with using(dataclasses.replace(DEFAULT, line_pixel=_NEVER)):
            plan = plan_afbp(scene.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                             target_db=-50.0, pulses_per_subaperture=length)
        yield from _images(plan, block)
        yield _fusion(plan)
    yield _map(plan)


def _images(plan: AfbpPlan, block: PulseBlock) -> Iterator[Experiment]:
    """Sub-aperture images with beams as planned, and with each number changed by itself."""
    whole = block.select(plan.subapertures.sampling.pulses[0])
    planned = plan.subapertures.beams
    finer = {'spacing': 0.4 * planned.spacing}
    for changed in ({}, {'group': 2}, {'uneven_m': 0.0}, finer):
        yield _image(dataclasses.replace(planned, **changed), plan, whole)
    for changed in ({}, {'segment': 16}, finer):  # of a few rows: what pixels and cells take
        yield _image(dataclasses.replace(planned, **changed), plan, whole.select(slice(0, 4)))


def _image(beams: BeamSampling, plan: AfbpPlan, some: PulseBlock) -> Experiment:
    stage = dataclasses.replace(plan.subapertures, beams=beams)
    image = _CPU.SubapertureImager(stage)
    out = image.image(0, some)
    counts = {**stage.image_operations(some.n_pulses * some.n_channels), IMAGE_OVERHEAD: 1}
    return Experiment('beams', counts, lambda: image.image(0, some, None, out))


def _fusion(plan: AfbpPlan) -> Experiment:
    stage = plan.subapertures
    grid, sampling = stage.fusion_grid, stage.sampling
    fusion, image = _CPU.SpectrumFusion(grid), _noise(grid.n_coarse, grid.n_coarse_range)
    counts = stage.fusion_operations
    counts[FUSION_OVERHEAD] = counts.pop('subaperture')

    def run():
        brightness = EdgeBrightness(grid, sampling.coverage)
        fusion.clear()
        for number, centre in enumerate(sampling.centre):
            brightness.add(image)
            fusion.add(number, image, centre)
        fusion.take_polar_image()

    return Experiment('fusion', counts, run)


def _map(plan: AfbpPlan) -> Experiment:
    grid, fused = plan.grid, plan.subapertures.fusion_grid
    polar_image = _noise(fused.polar.n_alpha, fused.polar.n_range)
    return Experiment('polar image to map', {'map_pixel': grid.n_x * grid.n_y},
                      lambda: _CPU.form_map(polar_image, fused, grid))


def _by_ffbp() -> Iterator[Experiment]:
    """With few neighbours and many; many pulses are merged, many pixels looked up."""
    for scene in (_Scene(1e3, 256, 256, 512), _Scene(1e3, 768, 768, 32)):
        block = scene.block()
        for kernel, oversampling in (('linear', 4.0), ('knab8', 1.8)):
            plan = plan_ffbp(scene.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                             kernel=kernel, merge_factor=4, range_oversampling=oversampling,
                             angle_oversampling=oversampling)
            yield Experiment(f'FFBP, {kernel}', plan.operations,
                             functools.partial(_CPU.FactorisedImager(plan).image, block))


def _noise(n_lines: int, n_pixels: int) -> np.ndarray:
    """(2, n_lines, n_pixels) float32."""
    return np.random.default_rng(0).standard_normal((2, n_lines, n_pixels), np.float32)
