"""Add range profiles to arbitrary points: a map, a terrain, or any positions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ....planning.exact.points import ImagePoints, PointPlan
from ..memory import WorkSpace
from ..profiles import Profiles
from . import kernels


def add_to_points(plan: PointPlan, layers: Sequence[ImagePoints], samples, tx_m, rx_m, image,
                  memory: WorkSpace | None = None) -> None:
    """Add rows to the points of an image.

    Parameters
    ----------
    plan : PointPlan
        For these rows.
    layers : sequence of ImagePoints
        Where the pixels are, one part of the image after the other.
    samples : (R, N) complex64
        Profiles of the rows.
    tx_m, rx_m : (R, 3) float64
        Phase centres of the rows, metres.
    image : (K,) float32
        Real and imaginary parts to add to, in turn; changed in place.
    memory : WorkSpace, optional
        For the profiles.
    """
    profiles = Profiles(plan.window, plan.lattice, plan.range_m, memory)
    work = kernels.work_space()
    for rows in profiles.chunks(len(samples)):
        planes = profiles.planes(samples[rows])
        coefficients = np.ascontiguousarray(planes[:, 0].transpose(0, 2, 1))
        for points, part in zip(layers, np.split(image, len(layers)), strict=True):
            kernels.project_points(
                coefficients.reshape(-1), coefficients.shape[:2], tx_m[rows], rx_m[rows],
                *points.coordinates, points.strides, points.size, plan.tile,
                profiles.range_at(0), plan.lattice.step_m, profiles.cycles_per_step,
                profiles.cycles_at(0), plan.reach_m, part, *work)
