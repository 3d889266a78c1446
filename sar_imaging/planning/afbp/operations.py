"""How often AFBP does the operations of a backend: what its predicted time is made of."""

from __future__ import annotations

import math

from .beam_gain import bins_per_run
from .subapertures import SubaperturePlan


def image_operations(plan: SubaperturePlan, n_rows: int, n_images: int = 1) -> dict[str, float]:
    """How often forming sub-aperture images does the operations of `CostModel`.

    Parameters
    ----------
    plan : SubaperturePlan
        Of the images.
    n_rows : int
        Rows of all of them together: one of each pulse and channel.
    n_images : int
        How many images.

    Returns
    -------
    dict of str to float
    """
    coarse, lattice, beams = plan.coarse, plan.lattice, plan.beams
    n_pixels = coarse.n_alpha * coarse.n_range
    if beams is None:
        return lattice.operations(n_rows, n_pixels)
    n_beams = beams.n_beams(coarse.n_alpha * coarse.alpha_spacing)
    group, n_bins = beams.group_of(n_beams), lattice.n_padded
    n_groups = math.ceil(n_beams / group)
    relative_bandwidth = n_bins * plan.radar.wavelength_m / (2 * lattice.n_cells * lattice.cell_m)
    half = min(n_bins, lattice.n_cells) / 2
    n_runs = 2 * math.ceil(half / bins_per_run(n_bins, relative_bandwidth))
    return {'profile_bin': n_rows * n_bins * (not plan.source.periodic),
            'beam_path': n_rows * n_beams * (1.0 if beams.paired else 1.5),
            'beam_run': n_rows * n_groups * n_runs,
            'beam_bin': n_rows * n_bins * n_groups * group * (0.5 if beams.paired else 1.0),
            'beam_group': n_rows * n_bins * n_groups,
            'beam_cell': n_images * n_beams * lattice.n_cells,
            'beam_pixel': n_images * n_pixels,
            'beam_segment': n_images * n_pixels / beams.segment}


def fusion_operations(plan: SubaperturePlan) -> dict[str, float]:
    """How often fusing all sub-aperture images does the operations of `CostModel`."""
    grid, n = plan.fusion_grid, plan.n_subapertures
    return {'subaperture': n, 'coarse_pixel': n * grid.n_coarse * grid.n_coarse_range,
            'fine_pixel': grid.n_fine * grid.n_fine_range}
