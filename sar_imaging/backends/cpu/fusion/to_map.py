"""Last step of AFBP: the fused polar image on a map."""

from __future__ import annotations

import numpy as np

from ....compilation import njit, numba
from ....geometry.grids import MapGrid
from ....planning.afbp.polar_grids import UnifiedPolarGrids
from ....planning.interpolators import design_interpolator
from ....planning.polar_to_map import DEGREE, TAPS, range_axis
from ..line_kernels import _cos_cycles, _fraction, _sin_cycles
from ..polar_to_map import polar_to_map


def form_map(polar_image: np.ndarray, fusion: UnifiedPolarGrids, grid: MapGrid,
             centre_m: float = 0.0, *, overwrite: bool = False) -> np.ndarray:
    """Interpolate a fused image to a map, see `backends.protocol.Backend`.

    With `overwrite` the polar image becomes the memory of the map, where range follows x and the
    map is not much finer than the polar image; otherwise the map gets memory of its own.
    """
    fusion.check_for_map()
    along = design_interpolator(fusion.range_oversampling, taps=TAPS, degree=DEGREE)
    image = polar_to_map(polar_image, fusion.polar, grid, axis=range_axis(fusion.polar, grid),
                         wavelength_m=fusion.wavelength_m, between=fusion.between, along=along,
                         overwrite=overwrite)
    if centre_m:
        polar = fusion.polar
        _restore_carrier(grid.x_m - polar.origin_m[0], grid.y_m - polar.origin_m[1],
                         polar.height_m ** 2, *polar.track, polar.alpha_start,
                         2 * centre_m / fusion.wavelength_m, image)
    return image


@njit(parallel=True)
def _restore_carrier(x, y, height2, along_x, along_y, alpha_start, cycles_per_alpha, image):
    """Put the carrier along direction back."""
    for row in numba.prange(image.shape[0]):
        beside2, along = y[row] * y[row] + height2, y[row] * along_y
        for i in range(image.shape[1]):
            alpha = (x[i] * along_x + along) / np.sqrt(x[i] * x[i] + beside2)
            c = _fraction(cycles_per_alpha * (alpha - alpha_start))
            sine, cosine = _sin_cycles(c, c * c), _cos_cycles(c * c)
            z = image[row, i]
            image[row, i] = complex(z.real * cosine - z.imag * sine,
                                    z.real * sine + z.imag * cosine)
