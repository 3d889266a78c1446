# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What the samples of an image are multiplied by, told at some of its pixels and for any part.

A response changes little from pixel to pixel, and little from pulse to pulse. So some pulses stand
for all, and splines through 49 x 49 pixels for the rest: large images need no memory for it. While
images are formed one response does for many of one geometry.

A volume resolves three dimensions. The peak of a point's impulse response in it is
``K G sqrt(rcs)`` as in any image (see `response`), so that ``|f|^2 / (K G)^2`` is its radar cross
section. Beta, sigma and gamma nought divide by an area of ground or slant plane within the cell: a
cell of a volume has none, and how much of a surface passes through it depends on the tilt of that.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any, NamedTuple

import numpy as np
import scipy

from ..geometry.grids import Grid, TerrainGrid, VolumeGrid
from ..geometry.illumination import AntennaPattern, Illumination, Pointing
from ..imaging.image import Image
from ..imaging.radiometry import Radiometry
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters
from .brightness import QUANTITIES, brightness, radiometry_of
from .constant import RadarConstant
from .response import ImageResponse, echo_sums, image_response

_KNOTS = 49  # along a side of the image; splines between them
_ECHOES, _LEAST_PULSES = 256, 64  # that stand for all of an aperture
DIM = 1e-4  # of the largest amplitude: less counts as not lit


@dataclasses.dataclass(frozen=True, eq=False)
class KnotResponse:
    """Response of an image at some of its rows and columns.

    Attributes
    ----------
    values : ImageResponse
        There, (K_y, K_x).
    rows, columns : (K_y,), (K_x,) int64
        Ascending; the first and last ones of the image are among them.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid, RadarParameters
    >>> from sar_imaging.radiometry import KnotResponse
    >>> radar = RadarParameters(10e9, 300e6, 400e6, first_sample_delay_s=6e-7)
    >>> track = np.zeros((64, 1, 3))
    >>> track[:, 0, 1:] = np.stack([np.linspace(-5, 5, 64), np.full(64, 50.0)], axis=-1)
    >>> grid = MapGrid((80.0, 0.0, 0.0), 2000, 1000, 0.005)
    >>> response = KnotResponse.of(grid, radar, track, track)
    >>> response.shape, response.values.amplitude.shape
    ((1000, 2000), (49, 49))
    """

    values: ImageResponse
    rows: np.ndarray
    columns: np.ndarray

    @classmethod
    def of(cls, grid: Grid, radar: RadarParameters, tx_m: np.ndarray, rx_m: np.ndarray, *,
           pattern: AntennaPattern | None = None, pointing: Pointing | None = None,
           weighting: str = 'none') -> KnotResponse:
        """Response of an image by some of its pulses, each of which stands for its neighbours.

        Parameters
        ----------
        grid : Grid
            Grid of the image, with rows and columns; all pixels of terrain are taken.
        radar : RadarParameters
            Radar parameters of the profiles.
        tx_m, rx_m : (P, C, 3) float64
            Phase centres, metres.
        pattern, pointing : AntennaPattern and Pointing, optional
            By which the image is weighed.
        weighting : str
            Spectral window of the profiles.

        Raises
        ------
        ValueError
            As `image_response`, or a pattern comes without pointing.
        """
        some = some_pulses(*tx_m.shape[:2])
        tx_m, rx_m, each = tx_m[some], rx_m[some], tx_m.shape[0] / len(some)
        illumination = illumination_of_some(pattern, pointing, some, tx_m, rx_m)
        rows, columns = (np.arange(n) if isinstance(grid, TerrainGrid) else
                         np.unique(np.linspace(0, n - 1, min(n, _KNOTS)).round().astype(int))
                         for n in grid.shape)
        places: Any = grid if isinstance(grid, TerrainGrid) else _Knots(grid, rows, columns)
        found = image_response(places, radar, tx_m, rx_m, illumination=illumination,
                               weighted=illumination is not None, weighting=weighting,
                               pulse_weights=np.full(len(some), each))
        # The noise of one pulse in place of k has k times the power of that of k.
        return cls(dataclasses.replace(found, noise_gain=found.noise_gain / each), rows, columns)

    @property
    def shape(self) -> tuple[int, int]:
        """Of the image."""
        return int(self.rows[-1]) + 1, int(self.columns[-1]) + 1


def some_pulses(n_pulses: int, channels: int) -> np.ndarray:
    """(Q,) int64 pulses, each of which stands for as many neighbours."""
    n = min(n_pulses, max(_LEAST_PULSES, _ECHOES // channels))
    return ((np.arange(n) + 0.5) * (n_pulses / n) - 0.5).round().astype(int)


def illumination_of_some(pattern: AntennaPattern | None, pointing: Pointing | None,
                         some: slice | np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray
                         ) -> Illumination | None:
    """Illumination by some of the pulses, whose phase centres (Q, C, 3) are given, metres."""
    return None if pattern is None else Illumination.of_pulses(
        pattern, pointing and pointing.select(some), tx_m, rx_m)


@dataclasses.dataclass(frozen=True, eq=False)
class _Knots:
    """Some rows and columns of a grid, as a grid."""

    grid: Grid
    rows: np.ndarray
    columns: np.ndarray

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.rows), len(self.columns)

    def positions(self, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        return self.grid.positions(self.rows[row], self.columns[column])


@dataclasses.dataclass(frozen=True, eq=False)
class BrightnessScale:
    """What samples are multiplied by to become calibrated brightness.

    Attributes
    ----------
    root : (K_y, K_x) or (K_z, K_y, K_x) float64
        Amplitude of a sample whose brightness is 1, at some pixels: finite where it is dark.
    knots : tuple of (K,) int64
        Their rows and columns, or layers, rows and columns, as of `KnotResponse`.
    radiometry : Radiometry
        What the squared magnitude of the samples then is.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid, RadarParameters
    >>> from sar_imaging.radiometry import BrightnessScale, KnotResponse, RadarConstant
    >>> radar = RadarParameters(10e9, 300e6, 400e6, first_sample_delay_s=6e-7)
    >>> track = np.zeros((64, 1, 3))
    >>> track[:, 0, 1:] = np.stack([np.linspace(-5, 5, 64), np.full(64, 50.0)], axis=-1)
    >>> response = KnotResponse.of(MapGrid((80.0, 0.0, 0.0), 2000, 1000, 0.005), radar, track,
    ...                            track)
    >>> scale = BrightnessScale.of(response, RadarConstant(18.2), 'rcs')
    >>> print(f'{scale.factors(slice(500, 501), slice(990, 1010)).mean():.2f} m for a sample of 1')
    7.65 m for a sample of 1
    """

    root: np.ndarray
    knots: tuple[np.ndarray, ...]
    radiometry: Radiometry

    @classmethod
    def of(cls, response: KnotResponse, constant: RadarConstant,
           quantity: str) -> BrightnessScale:
        """Scale of a response to one of `QUANTITIES`."""
        values = response.values
        per_unit = brightness(np.ones(values.amplitude.shape), values, constant, quantity)
        return cls(np.nan_to_num(1 / np.sqrt(per_unit)), (response.rows, response.columns),
                   radiometry_of(values, constant, quantity))

    def factors(self, *parts: slice) -> np.ndarray:
        """(n_y, n_x) or (n_z, n_y, n_x) float32 of a part of the image; 0 where nothing is lit.

        Slices of rows and columns, or of layers, rows and columns; the rest of the image along
        axes without one.
        """
        root = self._splines[-1]
        for axis, knots in enumerate(self.knots):
            wanted = np.arange(knots[-1] + 1)[parts[axis] if axis < len(parts) else slice(None)]
            spline = self._splines[axis]
            root = (root.take(wanted, axis) if spline is None else
                    scipy.interpolate.BSpline(spline.t, root, spline.k, axis=axis)(wanted))
        return np.divide(1.0, root, out=np.zeros(root.shape, np.float32),
                         where=root > DIM * self.root.max(), casting='unsafe')

    @functools.cached_property
    def _splines(self) -> tuple[Any, ...]:
        """Spline of each axis, None where all pixels are known, and coefficients of all axes.

        Coefficients are those of the whole image, so that its parts have the same bits.
        """
        splines, values = [], self.root
        for axis, knots in enumerate(self.knots):
            spline = None if len(knots) > knots[-1] else scipy.interpolate.make_interp_spline(
                knots, values, k=min(3, len(knots) - 1), axis=axis)
            if spline is not None:
                values = np.moveaxis(spline.c, 0, axis)
            splines.append(spline)
        return *splines, values


RCS = 'rcs'
_CELL_NODES = 25  # along a side of the volume


def volume_scale(grid: VolumeGrid, tx_m: np.ndarray, rx_m: np.ndarray, constant: RadarConstant, *,
                 pattern: AntennaPattern | None = None,
                 pointing: Pointing | None = None) -> BrightnessScale:
    """Scale of a volume's samples to the cross section of a point in each cell.

    Parameters
    ----------
    grid : VolumeGrid
        Grid of the volume.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres, metres.
    constant : RadarConstant
        Constant of the radar.
    pattern, pointing : AntennaPattern and Pointing, optional
        By which the volume is weighed.

    Returns
    -------
    BrightnessScale
        Of quantity ``'rcs'``; no surface, hence no incidence angle (NaN).

    Raises
    ------
    ValueError
        A pattern comes without pointing.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid
    >>> from sar_imaging.geometry import VolumeGrid
    >>> from sar_imaging.radiometry import RadarConstant, volume_scale
    >>> places = np.linspace(-0.2, 0.2, 16)
    >>> centres = np.stack(np.meshgrid(places, [0.0], places), axis=-1).reshape(-1, 1, 3)
    >>> grid = VolumeGrid.above(MapGrid((0.0, 4.0, 0.0), 41, 41, 0.03), 1.2)
    >>> scale = volume_scale(grid, centres, centres, RadarConstant(gain=16.0))
    >>> print(f'{scale.factors()[0, 20, 20]:.4f} m for a sample of 1, {scale.radiometry}')
    0.0039 m for a sample of 1, rcs, noise-equivalent not known
    """
    knots = tuple(np.unique(np.linspace(0, n - 1, min(n, _CELL_NODES)).round().astype(int))
                  for n in grid.shape)
    points = grid.positions(*np.ix_(*knots))
    some = some_pulses(*tx_m.shape[:2])
    tx_m, rx_m, each = tx_m[some], rx_m[some], tx_m.shape[0] / len(some)
    illumination = illumination_of_some(pattern, pointing, some, tx_m, rx_m)
    weights = np.full(len(some), each)
    sums = np.stack([echo_sums(line, tx_m, rx_m, weights, illumination,
                               illumination is not None)[:2]
                     for layer in points for line in layer], axis=1)
    amplitude, noise = sums.reshape(2, *points.shape[:-1])
    dark = amplitude <= DIM * amplitude.max()
    amplitude, nowhere = np.where(dark, np.nan, amplitude), np.full(amplitude.shape, np.nan)
    response = ImageResponse(amplitude, nowhere, nowhere, nowhere, noise / each)
    return BrightnessScale(np.nan_to_num(constant.gain * amplitude), knots,
                           radiometry_of(response, constant, RCS))


_SAME = 1e-3  # of the range, by which phase centres may have moved: 0.02 dB
_SAME_ANGLE = 1e-3  # of the antenna's width, by which it may have turned: 0.01 dB


class _Geometry(NamedTuple):
    """What a scale was computed for; places are relative to the middle of the grid, metres."""

    kind: tuple[Any, ...]
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
        Constant of the radar.
    quantity : str
        One of `QUANTITIES`.
    pattern : AntennaPattern, optional
        Pattern of the antenna; the pulses then have their pointing, and the images were weighed by
        it.
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
        if (self._scale is None or self._geometry is None
                or not geometry.same_as(self._geometry)):
            scale = (self._of_volume(grid, pulses) if isinstance(grid, VolumeGrid) else
                     BrightnessScale.of(self._response(grid, pulses), self._constant,
                                        self._quantity))
            self._scale = _Scale(scale.factors(), scale.radiometry)
            self._geometry = geometry  # once that has come to its end
            self.computed += 1
        return self._scale

    def _seen(self, grid: Grid, pulses: PulseBlock) -> _Geometry:
        """The geometry of an image, as seen from the middle of its grid."""
        flat: Any = getattr(grid, 'map_grid', grid)
        middle = (flat.positions(*[0] * len(flat.shape))
                  + 0.5 * (np.array(flat.shape) - 1) @ flat.steps_m)
        tx_m, rx_m = (centres - middle for centres in pulses.centres_m)
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
        return volume_scale(grid, *pulses.centres_m, self._constant,
                            pattern=self._pattern, pointing=pulses.pointing)

    def _response(self, grid: Grid, pulses: PulseBlock) -> KnotResponse:
        return KnotResponse.of(grid, pulses.radar, *pulses.centres_m,
                               pattern=self._pattern, pointing=pulses.pointing,
                               weighting=self._weighting)
