"""Calibrated brightness while images are formed: one response for many images of one geometry."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from ..geometry.grids import Grid, TerrainGrid, VolumeGrid
from ..geometry.illumination import AntennaPattern, Illumination
from ..imaging.image import Image
from ..imaging.radiometry import Radiometry
from ..signal.pulses import PulseBlock
from .brightness import QUANTITIES
from .constant import RadarConstant
from .scale import BrightnessScale, KnotResponse
from .volumes import RCS, volume_scale

_SAME = 1e-3  # of the range, by which phase centres may have moved: 0.02 dB
_SAME_ANGLE = 1e-3  # of the antenna's width, by which it may have turned: 0.01 dB


class _Geometry(NamedTuple):
    """What a scale was computed for; places are relative to the middle of the grid, metres."""

    kind: tuple
    tx_m: np.ndarray
    rx_m: np.ndarray
    axes: np.ndarray
    range_m: float
    width_rad: float

    def same_as(self, other: _Geometry) -> bool:
        """Whether another one has the same scale to a few hundredths of a dB."""
        return (self.kind == other.kind and self.tx_m.shape == other.tx_m.shape
                and all(np.abs(own - its).max() <= _SAME * self.range_m for own, its in (
                    (self.tx_m, other.tx_m), (self.rx_m, other.rx_m)))
                and np.abs(self.axes - other.axes).max() <= _SAME_ANGLE * self.width_rad)


@dataclasses.dataclass(frozen=True)
class _Scale:
    """What the samples of an image are multiplied by, float32, and what that is."""

    values: np.ndarray
    radiometry: Radiometry


class LiveCalibration:
    """Calibrates images as they come; the response is kept while the geometry stays.

    It is computed anew where a phase centre has moved by a thousandth of the range, seen from the
    image, where the antenna has turned by a thousandth of its width, or where the number of
    pulses is another one. Some pulses stand for all, and splines through 49 x 49 pixels for the
    rest, which departs from `image_response` by some hundredths of a dB.

    Parameters
    ----------
    constant : RadarConstant
        Of the radar.
    quantity : str
        One of `QUANTITIES`.
    pattern : AntennaPattern, optional
        Of the antenna; the pulses then have their pointing, and the images were weighed by it.
    weighting : str
        Spectral window of the profiles, see `sar_imaging.signal.windows`.

    Raises
    ------
    ValueError
        There is no such quantity.

    Attributes
    ----------
    computed : int
        How often a response was computed.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid, concatenate, plan_image
    >>> from sar_imaging.radiometry import LiveCalibration, RadarConstant
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['psf']().blocks()))
    >>> imager = plan_image(MapGrid((10_000.0, 0.0, 0.0), 25, 25, 0.5), block.radar,
    ...                     block.n_samples)
    >>> calibration = LiveCalibration(RadarConstant(gain=3e7), 'rcs')
    >>> for _ in range(3):  # images of one geometry
    ...     image = calibration(imager(block), block)
    >>> print(f'{20 * np.log10(np.abs(image).max()):.1f} dB m^2, {calibration.computed} response')
    10.5 dB m^2, 1 response
    """

    def __init__(self, constant: RadarConstant, quantity: str = 'sigma0', *,
                 pattern: AntennaPattern | None = None, weighting: str = 'none'):
        if quantity not in QUANTITIES:
            raise ValueError(f'quantity={quantity!r}; expected one of {", ".join(QUANTITIES)}')
        self._constant, self._quantity = constant, quantity
        self._pattern, self._weighting = pattern, weighting
        self._geometry: _Geometry | None = None
        self._scale: _Scale | None = None
        self.computed = 0

    def __call__(self, image: Image, pulses: PulseBlock) -> Image:
        """The image as calibrated brightness; see `calibrated`.

        Parameters
        ----------
        image : Image
            On a map, on terrain or on a plane; on a volume, whose points have a cross section.
        pulses : PulseBlock
            That it was formed from, as range profiles; their samples are not looked at.

        Raises
        ------
        ValueError
            As `image_response`, or the antenna has a pattern and the pulses have no pointing.
        """
        scale = self._of(image.grid, pulses)
        return dataclasses.replace(image, samples=image.samples * scale.values,
                                   radiometry=scale.radiometry)

    def response(self, image: Image, pulses: PulseBlock) -> tuple[KnotResponse, RadarConstant]:
        """Response of an image at some of its pixels, and the constant, for files of it.

        Raises
        ------
        ValueError
            As a call.
        """
        return self._response(image.grid, pulses), self._constant

    def _of(self, grid: Grid, pulses: PulseBlock) -> _Scale:
        geometry = self._seen(grid, pulses)
        if self._geometry is None or not geometry.same_as(self._geometry):
            scale = (self._of_volume(grid, pulses) if isinstance(grid, VolumeGrid) else
                     BrightnessScale.of(self._response(grid, pulses), self._constant,
                                        self._quantity))
            self._scale = _Scale(scale.factors(), scale.radiometry)
            self._geometry = geometry  # once that has come to its end
            self.computed += 1
        return self._scale

    def _seen(self, grid: Grid, pulses: PulseBlock) -> _Geometry:
        """The geometry of an image, as seen from the middle of its grid."""
        flat = getattr(grid, 'map_grid', grid)
        middle = (flat.positions(*[0] * len(flat.shape))
                  + 0.5 * (np.array(flat.shape) - 1) @ flat.steps_m)
        tx_m, rx_m = pulses.tx_m - middle, pulses.rx_m - middle
        axes, width = np.zeros((pulses.n_pulses, 3, 3)), math.pi
        if self._pattern is not None:
            axes = Illumination.of_pulses(self._pattern, pulses.pointing, tx_m[:, :1],
                                          rx_m[:, :1]).axes
            width = min(cut.width_rad for cut in (self._pattern.azimuth, self._pattern.elevation))
        place = tuple(middle) if isinstance(grid, TerrainGrid) else ()  # hills stay where they are
        kind = (type(grid), grid.shape, flat.steps_m.tobytes(), place, pulses.radar)
        return _Geometry(kind, tx_m, rx_m, axes,
                         float(np.linalg.norm(tx_m, axis=-1).min()), width)

    def _of_volume(self, grid: VolumeGrid, pulses: PulseBlock) -> BrightnessScale:
        if self._quantity != RCS:
            raise ValueError(f'quantity={self._quantity!r} of a volume, whose cells have no area '
                             f'of ground; expected {RCS!r}, the cross section of a point')
        return volume_scale(grid, pulses.tx_m, pulses.rx_m, self._constant,
                            pattern=self._pattern, pointing=pulses.pointing)

    def _response(self, grid: Grid, pulses: PulseBlock) -> KnotResponse:
        return KnotResponse.of(grid, pulses.radar, pulses.tx_m, pulses.rx_m,
                               pattern=self._pattern, pointing=pulses.pointing,
                               weighting=self._weighting)
