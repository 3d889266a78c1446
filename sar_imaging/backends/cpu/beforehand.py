# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Compiles the kernels of an entry, or loads them from the cache, before the first pulse arrives.

Small silent images are formed. It takes some seconds the first time on a machine and well under
one after that.
"""

from __future__ import annotations

import dataclasses
import itertools
from typing import TYPE_CHECKING

import numpy as np

from ...compilation_helper import helped
from ...geometry.grids import MapGrid
from ...planning.exact.backprojection import plan_backprojection
from ...planning.exact.groups import plan_groups
from ...planning.exact.polar_image import DEGREE, TAPS, AzimuthParts, plan_polar
from ...planning.interpolators import design_interpolator
from ...signal.pulses import PulseBlock
from ...signal.radar import SPEED_OF_LIGHT, RadarParameters

if TYPE_CHECKING:
    from ...planning.afbp.plan import AfbpPlan

_N_PULSES, _CUT, _N_SAMPLES, _RANGE_M = 64, 8, 128, 1000.0
_LENGTH = 256  # of a transform; shorter ones are SciPy's
_TARGET_DB = -50.0


def compile_kernels(entry: str) -> None:
    """Compile what an entry of the backend needs.

    Parameters
    ----------
    entry : str
        ``'Backprojection'``, ``'SubapertureImager'``, or ``'SpectrumFusion'``, which stands for
        ``'form_map'``, too.
    """
    compile_them = {'Backprojection': _backprojection, 'SubapertureImager': _subapertures,
                    'SpectrumFusion': _fusion}[entry]
    with helped(compile_them):
        compile_them()


def form_silently(plan: AfbpPlan, n_samples: int) -> None:
    """Form an image of silence from one sub-aperture of a plan, of echoes of so many samples."""
    from .beams import SubapertureImager
    from .fusion import SpectrumFusion, form_map

    stage, grid = plan.subapertures, plan.subapertures.fusion_grid
    some = stage.sampling.pulses[0]
    tx_m, number = plan.tx_m[some], np.arange(some.stop - some.start)
    block = PulseBlock(stage.given, not stage.source.periodic, number, number,
                       np.zeros((*tx_m.shape[:2], n_samples), np.complex64), tx_m,
                       plan.rx_m[some])
    fusion = SpectrumFusion(grid)
    fusion.add(0, SubapertureImager(stage).image(0, block), float(stage.sampling.centre[0]))
    form_map(fusion.take_polar_image(), grid, plan.grid, overwrite=True)


def _backprojection() -> None:
    from .backprojection import Backprojection

    radar, target_db = RadarParameters(10e9, 300e6, 600e6, 0.0), -80.0
    samples, centres = np.zeros((1, 512), np.complex64), np.zeros((1, 3))
    for x in (100.0, 1.0):  # by lines, and around the antenna by points
        grid = MapGrid((x, 0.0, 0.0), 16, 16, 0.25)
        image = np.zeros(grid.shape, np.complex64)
        plan = plan_backprojection(grid, radar, 512, centres, centres, target_db)
        plans, polar = [plan], plan_polar(grid, centres, centres, radar, 512, target_db)
        if polar is not None:
            between = design_interpolator(2.0, taps=TAPS, degree=DEGREE)
            parts = AzimuthParts((slice(None),), np.zeros(1), polar.polar, polar.polar, between,
                                 0.0, 0.0)
            plans += [dataclasses.replace(plan, route=dataclasses.replace(polar, parts=p))
                      for p in (None, parts)]
        for route in plans:
            Backprojection(route).add(samples, centres, centres, image)
    _groups(radar)


def _groups(radar: RadarParameters) -> None:
    """With interpolators of all lengths, between lines near each other and far apart."""
    from .backprojection import Backprojection

    grid = MapGrid((100.0, 0.0, 0.0), 32, 32, 0.25)
    centres, samples = np.zeros((16, 3)), np.zeros((16, 512), np.complex64)
    centres[:, 1] = np.linspace(-2.0, 2.0, 16)
    for n_parts, target_db in itertools.product((1, 5), (-80.0, -60.0, -45.0)):
        plan = plan_backprojection(grid, radar, 512, centres, centres, target_db)
        route = plan_groups(grid, radar, 512, centres, centres, plan.range_m, target_db,
                            (1, n_parts))
        if route is not None:
            Backprojection(dataclasses.replace(plan, route=route)).add(
                samples, centres, centres, np.zeros(grid.shape, np.complex64))


def _subapertures() -> None:
    """Directly, and from beams."""
    from ...planning.afbp.beams import plan_beams
    from .beams import SubapertureImager
    from .fft import transform_rows

    transform_rows(np.zeros((1, _LENGTH), np.complex64))
    plan, block = _aperture()
    plan = plan.subapertures
    first = block.select(plan.sampling.pulses[0])
    beams = plan_beams(plan.coarse, plan.radar, plan.resampling,
                       [(first.tx_m[:, 0], first.rx_m[:, 0])], _TARGET_DB, 8.0)
    for route in (None, beams):
        SubapertureImager(dataclasses.replace(plan, beams=route)).image(0, first)


def _fusion() -> None:
    """Of a whole aperture, and of one that slides on: to a map."""
    from .fft import LANES, transform_columns, transform_rows
    from .fusion import SpectrumFusion, form_map

    transform_rows(np.zeros((1, _LENGTH), np.complex64))
    transform_columns(np.zeros((_LENGTH, LANES), np.complex64), LANES)
    plan, _ = _aperture()
    grid, centre = plan.subapertures.fusion_grid, plan.subapertures.sampling.centre
    for keep in (False, True):
        fusion = SpectrumFusion(grid, keep=keep)
        for number, centre_m in enumerate(centre):
            image = np.zeros((grid.n_coarse, grid.coarse.n_range), np.complex64)
            image.flags.writeable = bool(number % 2)  # images of messages are not
            fusion.add(number, image, float(centre_m))
        if keep:
            fusion.remove(0)
        form_map(fusion.polar_image(1.0), grid, plan.grid, 1.0)
        form_map(fusion.polar_image() if keep else fusion.take_polar_image(), grid, plan.grid)


def _aperture() -> tuple[AfbpPlan, PulseBlock]:
    """Silent pulses of a monostatic track beside the origin, and the plan of their image."""
    from ...planning.afbp.plan import plan_afbp

    radar = RadarParameters(10e9, 300e6, 600e6, 2 * (_RANGE_M - 16.0) / SPEED_OF_LIGHT)
    number, centres = np.arange(_N_PULSES), np.zeros((_N_PULSES, 1, 3))
    centres[:, 0, 0], centres[:, 0, 1] = -_RANGE_M, number - _N_PULSES / 2
    samples = np.zeros((_N_PULSES, 1, _N_SAMPLES), np.complex64)
    return (plan_afbp(MapGrid((0.0, 0.0, 0.0), 32, 32, 0.25), radar, _N_SAMPLES, centres, centres,
                      target_db=_TARGET_DB, pulses_per_subaperture=_CUT),
            PulseBlock(radar, True, number, number, samples, centres, centres))
