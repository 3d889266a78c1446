"""Both stages of AFBP of a whole aperture on the device, some sub-apertures at a time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from tqdm import tqdm

from ....planning.afbp.edge_brightness import EdgeBrightness
from ....planning.afbp.subapertures import SubaperturePlan
from ....signal.pulses import PulseBlock
from ..arrays import check_memory, free_bytes, launch, reports_failures, xp
from ..transfers import in_pieces, to_host
from .bands import edge_powers
from .fusion import SpectrumFusion
from .subapertures import SubapertureImager

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
        numbers = range(plan.n_subapertures) if plan.lit is None else sorted(plan.lit.seen)
        # with what fusion and the samples in their turn take
        echoes = max(some.stop - some.start for some in plan.sampling.pulses) * plan.n_channels
        one = (self._imager.image_bytes + 3 * 8 * coarse.n_alpha * coarse.n_range
               + 4 * 8 * echoes * max(plan.n_samples, plan.lattice.n_padded))
        most = int(min(_MOST_BYTES, free_bytes() // _SHARE) // one)
        if not most:
            check_memory(one, 'a sub-aperture', "use backend='cpu'")
        most = min(max(most, 1), _TOGETHER)
        yield from (list(numbers[k:k + most]) for k in range(0, len(numbers), most))

    @reports_failures
    def polar_image(self, block: PulseBlock, weights: np.ndarray | None = None,
                    brightness: EdgeBrightness | None = None, *, progress: bool = False):
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
            some = block.select(span) if plan.lit is not None else None
            own = [slice(pulses[k].start - span.start, pulses[k].stop - span.start)
                   for k in numbers]
            images = self._imager.project_all(
                samples, block.tx_m[span], block.rx_m[span], own,
                None if weights is None else weights[span],
                some and [plan.weighed_by(some.select(piece)) for piece in own])
            if factors:
                launch(edge_powers, (images.shape[2], len(images)), _THREADS, images, *factors,
                       power)
            fusion.add_all(numbers, images, [plan.sampling.centre[k] for k in numbers])
        if factors:
            brightness.add_power(to_host(power))
        return fusion.take_polar_image()
