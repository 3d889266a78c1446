# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""First stage of AFBP on the device, and both stages of a whole aperture.

Some sub-apertures are imaged in one launch of each kernel, from beams or directly.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from tqdm import tqdm

from ...geometry.illumination import Illumination
from ...planning.afbp.illumination import AmplitudeNodes
from ...planning.afbp.subapertures import SubaperturePlan
from ...signal.pulses import PulseBlock
from ..edge_brightness import EdgeBrightness
from .arrays import (
    check_memory,
    complex_samples,
    free_bytes,
    given,
    launch,
    on_device,
    reports_failures,
    require_device,
    xp,
)
from .beams import Beams
from .fusion import SpectrumFusion, edge_powers
from .known import refuse_unknown
from .lines import line_profiles, polar_lines
from .transfers import in_pieces, to_host


class SubapertureImager:
    """Images of the sub-apertures of a plan, see `backends.protocol.SubapertureImager`.

    Images are arrays of the device, unless memory of the host is given for one.

    Raises
    ------
    DeviceError
        There is no device, it fails, or it lacks memory.
    """

    @reports_failures
    def __init__(self, plan: SubaperturePlan):
        require_device()
        refuse_unknown(plan)
        self.plan = plan
        self._beams = plan.beams and Beams(plan)
        self._lines = None if plan.beams else polar_lines(
            plan.coarse, line_profiles(plan.source, plan.resampling, plan.range_m),
            nodes=plan.amplitudes and plan.amplitudes.lines)

    @property
    def image_bytes(self) -> int:
        """Memory of the device that a sub-aperture takes besides its echoes."""
        coarse, beams = self.plan.coarse, self.plan.beams
        if beams is None:
            return 8 * coarse.n_alpha * coarse.n_range
        return self._beams.image_bytes * max(1, beams.n_weighed)

    @reports_failures
    def image(self, number: int, block: PulseBlock, weights: np.ndarray | None = None,
              out: np.ndarray | None = None) -> np.ndarray:
        """Backproject one sub-aperture, see `backends.protocol.SubapertureImager`."""
        plan = self.plan
        plan.check_block(number, block)
        there = self.project(block.samples, block.tx_m, block.rx_m, weights,
                             plan.weighed_by(block))
        if out is None or on_device(out):
            return given(there)
        out[...] = to_host(there)
        return out

    @reports_failures
    def project(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray,
                weights: np.ndarray | None = None,
                illumination: Illumination | tuple[AmplitudeNodes, ...] | None = None
                ) -> np.ndarray:
        """The same of samples that may lie on the device, unchecked; see `project_all`."""
        return self.project_all(samples, tx_m, rx_m, [slice(0, len(samples))], weights,
                                [illumination])[0]

    @reports_failures
    def project_all(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray,
                    pulses: Sequence[slice], weights: np.ndarray | None = None,
                    illuminations: Sequence[Illumination | tuple[AmplitudeNodes, ...] | None] = ()
                    ) -> np.ndarray:
        """Images of some sub-apertures, in few launches where they come from beams.

        Parameters
        ----------
        samples : (P, C, N) complex64, or (P, C, N, 2) integer
            Samples of their pulses, of the host or the device.
        tx_m, rx_m : (P, C, 3) float64
            Phase centres, metres.
        pulses : sequence of slice
            Those of each sub-aperture.
        weights : (P,) float32, optional
            Window over the pulses.
        illuminations : sequence, optional
            `SubaperturePlan.weighed_by` of each sub-aperture.

        Returns
        -------
        (G, 2, n_alpha, n_range) float32 array of the device
        """
        plan, n = self.plan, self.plan.n_channels
        echoes = complex_samples(samples).reshape(-1, plan.n_samples)
        tx_m, rx_m = tx_m.reshape(-1, 3), rx_m.reshape(-1, 3)
        illuminations = illuminations or [None] * len(pulses)
        pieces = [slice(some.start * n, some.stop * n) for some in pulses]
        if self._beams:
            window = (xp.ones(len(echoes), np.float32) if weights is None else
                      xp.asarray(np.repeat(weights, n).astype(np.float32)))
            if not plan.beams.n_weighed:
                return self._beams.images(echoes, window, pieces, tx_m, rx_m, illuminations)
            return self._weighed(echoes, window, pieces, tx_m, rx_m, illuminations)
        if weights is not None:
            echoes = echoes * xp.asarray(np.repeat(weights, n))[:, None]
        images = xp.zeros((len(pieces), 2, *plan.coarse.shape), np.float32)
        for image, piece, illumination in zip(images, pieces, illuminations, strict=True):
            self._lines.add(echoes[piece], tx_m[piece], rx_m[piece], image.reshape(-1),
                            illumination)
        return images

    def _weighed(self, echoes: np.ndarray, window: np.ndarray, pieces: Sequence[slice],
                 tx_m: np.ndarray, rx_m: np.ndarray,
                 illuminations: Sequence[tuple[AmplitudeNodes, ...]]) -> np.ndarray:
        """Images from beams as sums of those that are weighed alike, such as each channel's."""
        n = self.plan.beams.n_weighed
        if n > 1:
            parts = [np.arange(piece.start + part, piece.stop, n) for piece in pieces
                     for part in range(n)]
            ends = np.cumsum([0, *map(len, parts)]).tolist()
            pieces = [slice(*some) for some in itertools.pairwise(ends)]
            order = np.concatenate(parts)
            there = xp.asarray(order)
            echoes, window, tx_m, rx_m = echoes[there], window[there], tx_m[order], rx_m[order]
        images = self._beams.images(echoes, window, pieces, tx_m, rx_m,
                                    list(itertools.chain.from_iterable(illuminations)))
        return images if n == 1 else images.reshape(-1, n, *images.shape[1:]).sum(axis=1)


_THREADS = 128
_TOGETHER = 16  # sub-apertures in one launch of each kernel, at most
_MOST_BYTES, _SHARE = 1 << 31, 4  # of theirs, and of the free memory one part in so


class ApertureFusion:
    """Fused polar images of apertures by one plan, see `backends.protocol.ApertureFusion`.

    Raises
    ------
    DeviceError
        There is no device, it fails, or it lacks memory.
    """

    @reports_failures
    def __init__(self, plan: SubaperturePlan):
        self.plan = plan
        self._imager, self._fusion = SubapertureImager(plan), SpectrumFusion(plan.fusion_grid)

    def groups(self) -> Iterator[list[int]]:
        """Numbers of the sub-apertures that are computed together; those that see nothing not."""
        plan, coarse = self.plan, self.plan.coarse
        numbers = (range(plan.n_subapertures) if plan.amplitudes is None
                   else sorted(plan.amplitudes.seen))
        # with what fusion and the samples in their turn take
        echoes = max(some.stop - some.start for some in plan.sampling.pulses) * plan.n_channels
        one = (self._imager.image_bytes + 3 * 8 * coarse.n_alpha * coarse.n_range
               + 4 * 8 * echoes * max(plan.n_samples, plan.resampling.n_padded))
        most = int(min(_MOST_BYTES, free_bytes() // _SHARE) // one)
        if not most:
            check_memory(one, 'a sub-aperture', "use backend='cpu'")
        most = min(max(most, 1), _TOGETHER)
        yield from (list(numbers[k:k + most]) for k in range(0, len(numbers), most))

    @reports_failures
    def polar_image(self, block: PulseBlock, weights: np.ndarray | None = None,
                    brightness: EdgeBrightness | None = None, *, progress: bool = False
                    ) -> np.ndarray:
        """Image of an aperture, see `backends.protocol.ApertureFusion`."""
        plan, fusion, groups = self.plan, self._fusion, list(self.groups())
        fusion.clear()
        plan.check_block(0, block)
        pulses = plan.sampling.pulses
        spans = [slice(pulses[some[0]].start, pulses[some[-1]].stop) for some in groups]
        power = xp.zeros(5, np.float64)
        factors = brightness and [xp.asarray(v) for v in brightness.factors]
        pieces = in_pieces(block.samples, spans)
        shown = tqdm(groups, desc='sub-apertures', unit='group', disable=not progress)
        for numbers, (span, samples) in zip(shown, pieces, strict=True):
            some = block.select(span) if plan.amplitudes is not None else None
            relative = [slice(pulses[k].start - span.start, pulses[k].stop - span.start)
                   for k in numbers]
            images = self._imager.project_all(
                samples, block.tx_m[span], block.rx_m[span], relative,
                None if weights is None else weights[span],
                some and [plan.weighed_by(some.select(piece)) for piece in relative])
            if factors:
                launch(edge_powers, (images.shape[2], len(images)), _THREADS, images, *factors,
                       power)
            fusion.add_all(numbers, images, [plan.sampling.centre[k] for k in numbers])
        if factors:
            brightness.add_power(to_host(power))
        return fusion.take_polar_image()
