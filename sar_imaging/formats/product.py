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
    """

    image: Image
    datum: Datum
    acquisition: Acquisition | None = None
