"""Scale of an aperture's image to calibrated brightness, on the map's surface."""

from __future__ import annotations

import dataclasses

import numpy as np

from sar_imaging.radiometry import BrightnessScale, KnotResponse

from ..job import Job
from ..prediction import Pulses, surface_points
from ..windows import Window


@dataclasses.dataclass(frozen=True)
class _Surface:
    """Pixels of a window on the map's surface, computed when they are asked for."""

    window: Window
    job: Job

    @property
    def shape(self) -> tuple[int, int]:
        return self.window.shape

    def positions(self, row, column) -> np.ndarray:
        grid = self.window.grid(self.job.spacing_m, self.job.height_m)
        places = grid.positions(row, column)
        return surface_points(self.job, places.reshape(-1, 3)).reshape(places.shape)


def brightness_scale(job: Job, pulses: Pulses, window: Window) -> BrightnessScale | None:
    """Scale of the image of an aperture; None where the job wants none.

    Profiles that are compressed here have no window; those of the recording have that of the job.

    Raises
    ------
    ValueError
        The pulses resolve no area, or are too few.
    """
    wanted = job.radiometry
    if wanted is None:
        return None
    response = KnotResponse.of(
        _Surface(window, job), pulses.radar, pulses.tx_m, pulses.rx_m,
        pattern=pulses.illumination, pointing=pulses.pointing,
        weighting='none' if pulses.raw_samples else wanted.window)
    return BrightnessScale.of(response, wanted.constant, wanted.quantity)
