"""What the samples of an image are multiplied by, told at some of its pixels and for any part.

A response changes little from pixel to pixel, and little from pulse to pulse. So some pulses stand
for all, and splines through 49 x 49 pixels for the rest: large images need no memory for it.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import scipy

from ..geometry.grids import Grid, TerrainGrid
from ..geometry.illumination import AntennaPattern, Illumination, Pointing
from ..imaging.radiometry import Radiometry
from ..signal.radar import RadarParameters
from .brightness import brightness, radiometry_of
from .constant import RadarConstant
from .response import ImageResponse, image_response

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
            Of the image, with rows and columns; all pixels of terrain are taken.
        radar : RadarParameters
            Of the profiles.
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
        lit = illumination_of_some(pattern, pointing, some, tx_m, rx_m)
        rows, columns = (np.arange(n) if isinstance(grid, TerrainGrid) else
                         np.unique(np.linspace(0, n - 1, min(n, _KNOTS)).round().astype(int))
                         for n in grid.shape)
        places = grid if isinstance(grid, TerrainGrid) else _Knots(grid, rows, columns)
        found = image_response(places, radar, tx_m, rx_m, illumination=lit,
                               weighted=lit is not None, weighting=weighting,
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


def illumination_of_some(pattern: AntennaPattern | None, pointing: Pointing | None, some,
                         tx_m: np.ndarray, rx_m: np.ndarray) -> Illumination | None:
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

    def positions(self, row, column) -> np.ndarray:
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
    def _splines(self) -> tuple:
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
