"""Compiles the kernels of an entry, or loads them from the cache, before the first pulse arrives.

Small silent images are formed. It takes some seconds the first time on a machine and well under
one after that.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from ...geometry.grids import MapGrid
from ...geometry.polar import PolarGrid
from ...planning.exact.azimuth_upsampling import DEGREE, TAPS, AzimuthParts
from ...planning.exact.backprojection import plan_backprojection
from ...planning.exact.polar_image import plan_polar
from ...planning.interpolators import design_interpolator
from ...planning.profiles.range_gate import RangeGate
from ...planning.profiles.range_resampling import plan_resampling, sample_paths
from ...signal.radar import SPEED_OF_LIGHT, RadarParameters

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
    {'Backprojection': _backprojection, 'SubapertureImager': _subapertures,
     'SpectrumFusion': _fusion}[entry]()


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
            plans += [dataclasses.replace(plan, way=dataclasses.replace(polar, parts=p))
                      for p in (None, parts)]
        for way in plans:
            Backprojection(way).add(samples, centres, centres, image)


def _subapertures() -> None:
    """From beams, and directly."""
    from ...planning.afbp.beams import plan_beams
    from .beams.subaperture import BeamformedSubaperture
    from .fft.rows import transform_rows
    from .lines import PolarLines
    from .profiles import Profiles

    transform_rows(np.zeros((1, _LENGTH), np.complex64))
    polar = PolarGrid((-_RANGE_M, 0.0, 0.0), (0.0, 1.0), -1, 0.0, _RANGE_M, 0.25, 32, 0.0, 1e-3, 4)
    radar, centres = _aperture(_CUT)
    rows = centres.reshape(-1, 3), centres.reshape(-1, 3)
    paths = sample_paths(*rows, polar.lines(polar.range_m[[0, -1]], 0.0))
    lattice = plan_resampling(paths, 0.25, 32, radar, _N_SAMPLES, _TARGET_DB)
    beams = plan_beams(polar, radar, lattice, [rows], _TARGET_DB, 8.0)
    window, range_m = RangeGate.whole(radar, _N_SAMPLES), (_RANGE_M, _RANGE_M + 8.0)
    for lines in (BeamformedSubaperture(polar, window, lattice, beams, range_m),
                  PolarLines(polar, Profiles(window, lattice, range_m))):
        lines.fill(np.zeros((_CUT, _N_SAMPLES), np.complex64), *rows,
                   np.zeros((2, 4, 32), np.float32))


def _fusion() -> None:
    """Of a whole aperture, and of one that slides on: to a map."""
    from ...planning.afbp.plan import plan_afbp
    from .fft.columns import LANES, transform_columns
    from .fft.rows import transform_rows
    from .fusion.spectra import SpectrumFusion
    from .fusion.to_map import form_map

    transform_rows(np.zeros((1, _LENGTH), np.complex64))
    transform_columns(np.zeros((_LENGTH, LANES), np.complex64), LANES)
    radar, centres = _aperture(_N_PULSES)
    plan = plan_afbp(MapGrid((0.0, 0.0, 0.0), 32, 32, 0.25), radar, _N_SAMPLES, centres, centres,
                     target_db=_TARGET_DB, pulses_per_subaperture=_CUT)
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


def _aperture(n_pulses: int) -> tuple[RadarParameters, np.ndarray]:
    """Radar, and phase centres (P, 1, 3) of a monostatic track beside the origin, metres."""
    radar = RadarParameters(10e9, 300e6, 600e6, 2 * (_RANGE_M - 16.0) / SPEED_OF_LIGHT)
    centres = np.zeros((n_pulses, 1, 3))
    centres[:, 0, 0], centres[:, 0, 1] = -_RANGE_M, np.arange(n_pulses) - n_pulses / 2
    return radar, centres
