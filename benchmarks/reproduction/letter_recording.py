# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Recording of the spotlight letter: its phase history, and range profiles for imagers."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np

from benchmarks.reproduction.letter_scene import SpotlightExperiment
from sar_imaging.geometry import MapGrid
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.signal.windows import window as window_weights

OVERSAMPLING = 1.25  # of the profiles: the least that the imagers take
PATCH_MARGIN_M = 8.0  # of profiles kept beyond a patch, for interpolators and sidelobes
_PULSES_AT_ONCE = 64


@dataclasses.dataclass(frozen=True)
class Recording:
    """Phase history of an experiment, and the windows with which it is imaged.

    Parameters
    ----------
    experiment : SpotlightExperiment
        What was recorded.
    phase_history : (P, K) complex64
        Its samples; may be memory-mapped.
    window : str
        Over the band and over the pulses of the aperture, see `sar_imaging.signal.windows`.
    """

    experiment: SpotlightExperiment
    phase_history: np.ndarray
    window: str = 'hamming'

    @property
    def pulse_weights(self) -> np.ndarray:
        """(P,) float32 window over the aperture, of mean one."""
        weights = window_weights(self.window, self.experiment.n_pulses)
        return (weights / weights.mean()).astype(np.float32)

    def raw(self, pulses: slice) -> PulseBlock:
        """Some pulses as recorded."""
        experiment = self.experiment
        samples = self.phase_history[pulses][:, None]
        number = np.arange(experiment.n_pulses)[pulses]
        centres = experiment.phase_centres()[pulses]
        return PulseBlock(experiment.radar, False, number, number, samples, centres, centres)

    def profiles(self, range_m: tuple[float, float] | None = None) -> PulseBlock:
        """Windowed range profiles of the whole aperture.

        Parameters
        ----------
        range_m : (float, float), optional
            Half paths to keep, metres; by default everything.

        Returns
        -------
        PulseBlock
            A unit scatterer has the peak one on average over the pulses.
        """
        experiment = self.experiment
        compress = RangeCompressor(experiment.radar, experiment.n_samples, window=self.window,
                                   oversampling=OVERSAMPLING)
        radar, kept = compress.output_radar, slice(0, compress.n_output)
        if range_m is not None:
            first, last = ((r - radar.range_start_m) / radar.sample_spacing_m for r in range_m)
            kept = slice(max(0, int(first)), min(compress.n_output, int(last) + 2))
        radar = dataclasses.replace(
            radar, first_sample_delay_s=radar.first_sample_delay_s + kept.start
            / radar.sample_rate_hz)
        out = np.empty((experiment.n_pulses, 1, kept.stop - kept.start), np.complex64)
        weights = self.pulse_weights[:, None, None]

        def fill(start):
            part = slice(start, start + _PULSES_AT_ONCE)
            np.multiply(compress(self.raw(part)).samples[..., kept], weights[part],
                        out=out[part])

        with ThreadPoolExecutor(numba.get_num_threads()) as pool:
            list(pool.map(fill, range(0, experiment.n_pulses, _PULSES_AT_ONCE)))
        number = np.arange(experiment.n_pulses)
        centres = experiment.phase_centres()
        return PulseBlock(radar, True, number, number, out, centres, centres)

    def patch_profiles(self, grid: MapGrid) -> PulseBlock:
        """Profiles cut to the half paths of a patch."""
        corners = np.array([[x, y] for x in grid.x_m[[0, -1]] for y in grid.y_m[[0, -1]]])
        track = self.experiment.phase_centres()[:, 0, :2]
        paths = np.linalg.norm(corners[:, None] - track[[0, len(track) // 2, -1]], axis=-1)
        nearest = np.abs(grid.x_m).min()  # where a pulse passes abreast of the patch
        return self.profiles((min(paths.min(), nearest) - PATCH_MARGIN_M,
                              paths.max() + PATCH_MARGIN_M))

    def weighted_blocks(self) -> Iterator[PulseBlock]:
        """Phase history with both windows applied, whose correlation is the exact image."""
        weights = window_weights(self.window, self.experiment.n_samples)
        weights = (weights / weights.sum()).astype(np.float32)
        for start in range(0, self.experiment.n_pulses, _PULSES_AT_ONCE):
            part = slice(start, start + _PULSES_AT_ONCE)
            block = self.raw(part)
            yield dataclasses.replace(block, samples=block.samples * weights
                                      * self.pulse_weights[part, None, None])
