"""Cross section of points in volumes: the one calibrated brightness that a cell of a volume has.

A volume resolves three dimensions. The peak of a point's impulse response in it is
``K G sqrt(rcs)`` as in any image (see `response`), so that ``|f|^2 / (K G)^2`` is its radar cross
section. Beta, sigma and gamma nought divide by an area of ground or slant plane within the cell: a
cell of a volume has none, and how much of a surface passes through it depends on the tilt of that.
"""

from __future__ import annotations

import numpy as np

from ..geometry.grids import VolumeGrid
from ..geometry.illumination import AntennaPattern, Pointing
from .brightness import radiometry_of
from .constant import RadarConstant
from .response import ImageResponse, echo_sums
from .scale import DIM, BrightnessScale, illumination_of_some, some_pulses

RCS = 'rcs'
_KNOTS = 25  # along a side of the volume


def volume_scale(grid: VolumeGrid, tx_m: np.ndarray, rx_m: np.ndarray, constant: RadarConstant, *,
                 pattern: AntennaPattern | None = None,
                 pointing: Pointing | None = None) -> BrightnessScale:
    """Scale of a volume's samples to the cross section of a point in each cell.

    Parameters
    ----------
    grid : VolumeGrid
        Of the volume.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres, metres.
    constant : RadarConstant
        Of the radar.
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
    knots = tuple(np.unique(np.linspace(0, n - 1, min(n, _KNOTS)).round().astype(int))
                  for n in grid.shape)
    points = grid.positions(*np.ix_(*knots))
    some = some_pulses(*tx_m.shape[:2])
    tx_m, rx_m, each = tx_m[some], rx_m[some], tx_m.shape[0] / len(some)
    lit = illumination_of_some(pattern, pointing, some, tx_m, rx_m)
    weights = np.full(len(some), each)
    sums = np.stack([echo_sums(line, tx_m, rx_m, weights, lit, lit is not None)[:2]
                     for layer in points for line in layer], axis=1)
    amplitude, noise = sums.reshape(2, *points.shape[:-1])
    dark = amplitude <= DIM * amplitude.max()
    amplitude, nowhere = np.where(dark, np.nan, amplitude), np.full(amplitude.shape, np.nan)
    response = ImageResponse(amplitude, nowhere, nowhere, nowhere, noise / each)
    return BrightnessScale(np.nan_to_num(constant.gain * amplitude), knots,
                           radiometry_of(response, constant, RCS))
