"""What readers of image files return: the image, its place on the Earth, its acquisition."""

from __future__ import annotations

import dataclasses

from ..geometry.earth import Datum
from ..imaging.image import Image
from .acquisition import Acquisition


@dataclasses.dataclass(frozen=True, eq=False)
class ImageProduct:
    """An image that knows where on the Earth it is.

    Parameters
    ----------
    image : Image
        Samples and grid.
    datum : Datum
        Place of the grid's frame on the Earth.
    acquisition : Acquisition or None
        Where the radar was; None where the file does not tell.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import Image, MapGrid
    >>> from sar_imaging.formats import ImageProduct
    >>> from sar_imaging.geometry import Datum
    >>> from sar_imaging.imaging.image import Report
    >>> grid = MapGrid((100.0, 0.0, 0.0), 8, 6, 0.5)
    >>> image = Image(np.ones(grid.shape, np.complex64), grid, 10e9, Report('exact', '', -60.0))
    >>> product = ImageProduct(image, Datum(47.0, 8.0, 450.0))
    >>> latitude, longitude, _ = product.datum.to_geographic(product.image.grid.centre_m)
    >>> print(f'{latitude:.5f}, {longitude:.5f}')
    47.00000, 8.00131
    """

    image: Image
    datum: Datum
    acquisition: Acquisition | None = None
