"""Fast factorised backprojection: images of sub-apertures from images of their parts.

Ulander, Hellsten & Stenström 2003.
"""

from __future__ import annotations

import numpy as np

from ...geometry.polar import PolarGrid
from ...planning.baselines.ffbp import FfbpPlan
from ...planning.baselines.ffbp_tree import Node
from ...planning.baselines.neighbour_weights import kernel_weights
from ...planning.profiles.range_gate import RangeGate
from ...signal.pulses import PulseBlock
from .project_lines import project_lines


class FactorisedImager:
    """Fast factorised backprojection, as `backends.baselines.FactorisedImager` describes it.

    The image of a sub-aperture is that of its pulses, or the sum of the images of its parts, read
    at its own pixels: ``b(x) = exp(-j k (r(x) - r_0)) sum_p b_p(x) exp(+j k (r_p(x) - r_p0))``,
    ``k = 4 pi / lambda``, with the distances r from its origin and r_p from those of its parts.

    Parameters
    ----------
    plan : FfbpPlan
        Tree of sub-apertures and their grids.

    Examples
    --------
    >>> from sar_imaging import MapGrid, concatenate
    >>> from sar_imaging.backends.reference import FactorisedImager
    >>> from sar_imaging.planning.baselines.ffbp_choice import plan_ffbp
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['psf']().blocks())).select(slice(0, 32))
    >>> grid = MapGrid((10_000.0, 0.0, 0.0), 9, 9, 0.5)
    >>> plan = plan_ffbp(grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
    ...                  target_db=-20.0)
    >>> image = FactorisedImager(plan).image(block)
    >>> print(f'{abs(image).max():.0f} of 32 pulses and 5 channels')
    150 of 32 pulses and 5 channels
    """

    def __init__(self, plan: FfbpPlan):
        self.plan = plan
        self._weights = [kernel_weights(plan.sampling.kernel, v)
                         for v in plan.sampling.oversampling]

    def image(self, block: PulseBlock, *, progress: bool = False) -> np.ndarray:
        """Image of the range profiles of the planned aperture."""
        points = self.plan.grid.points()
        return sum(self._at(node, block, points) for node in self.plan.top).astype(np.complex64)

    def _at(self, node: Node, block, points_m) -> np.ndarray:
        """Image of a sub-aperture at points, with the carrier."""
        polar = self.plan.polar_grid(node)
        range_m, alpha = polar.from_map(points_m[..., 0], points_m[..., 1])
        return (read_neighbours(self._local(node, block), polar, range_m, alpha, *self._weights)
                * carrier(range_m - polar.range_start_m, self.plan.radar.wavelength_m))

    def _local(self, node: Node, block) -> np.ndarray:
        """(n_alpha, n_range) complex128 image on a sub-aperture's own grid, at range baseband."""
        plan, polar = self.plan, self.plan.polar_grid(node)
        if not node.children:
            echoes = (a[node.pulses].reshape(-1, a.shape[-1])
                    for a in (block.samples, block.tx_m, block.rx_m))
            return project_lines(RangeGate.whole(plan.radar, plan.n_samples), next(echoes),
                                 plan.lattice.n_padded, *echoes, polar)
        points = polar.lines(polar.range_m, polar.alpha[:, None])[0]
        image = sum(self._at(child, block, points) for child in node.children)
        return image * carrier(polar.range_start_m - polar.range_m, plan.radar.wavelength_m)


def read_neighbours(image, polar: PolarGrid, range_m, alpha, along_range, along_alpha
                    ) -> np.ndarray:
    """``sum_kl w_k(u) w_l(v) b[line + k, node + l]``, u and v from the middle between neighbours.

    Parameters
    ----------
    image : (n_alpha, n_range) complex
        Local image.
    polar : PolarGrid
        Its pixels.
    range_m, alpha : (...) float64
        Where to read it, metres and direction cosines.
    along_range, along_alpha : (taps, 8) float32
        From `kernel_weights`.

    Returns
    -------
    (...) complex128
    """
    taps, places = len(along_range), []
    for value, start, step, n, weights in (
            (alpha, polar.alpha_start, polar.alpha_spacing, polar.n_alpha, along_alpha),
            (range_m, polar.range_start_m, polar.range_spacing_m, polar.n_range, along_range)):
        place = (np.asarray(value) - start) / step
        first = np.clip(np.floor(place).astype(int) + 1 - taps // 2, 0, n - taps)
        x = place - (first + taps // 2 - 1) - 0.5
        places.append((first, x[..., None] ** np.arange(weights.shape[1])
                       @ weights.T.astype(np.float64)))
    (line, across), (node, along) = places
    return sum(across[..., k] * along[..., n] * image[line + k, node + n]
               for k in range(taps) for n in range(taps))


def carrier(distance_m, wavelength_m: float) -> np.ndarray:
    """``exp(+j 4 pi d / lambda)``."""
    return np.exp(2j * np.pi * np.fmod(2 * distance_m / wavelength_m, 1.0))
