"""Amplitudes of a sub-aperture's echoes as parabolas of their phase from beam to beam."""

from __future__ import annotations

import numpy as np

from ....compilation import DETERMINISTIC, njit
from ....geometry.polar import PolarGrid
from ....planning.afbp.beam_geometry import BeamGeometry
from ....planning.afbp.lit_subapertures import NODES_APART, AmplitudeNodes
from ..illumination import LitEchoes, two_way_amplitudes

_SAME = 1e-9  # radians by which phases differ that are taken for the same


class LitLines:
    """Knots of the amplitudes along the lines of a coarse grid.

    Parameters
    ----------
    polar : PolarGrid
        Of sub-aperture images.
    apart : int
        Pixels between knots.
    """

    def __init__(self, polar: PolarGrid, apart: int):
        places = np.arange(-(-polar.n_range // apart) + 1) * apart
        positions = polar.locate(places, np.arange(polar.n_alpha)[:, None])[0]
        self._shape = positions.shape[:2]
        self._positions = np.ascontiguousarray(positions.reshape(-1, 3).T)

    def parabolas(self, nodes: AmplitudeNodes, geometry: BeamGeometry,
                  rad_per_m: float) -> np.ndarray:
        """(3, n_alpha, K) float32 coefficients A, B and C of ``A + B p + C p^2``.

        p is the phase of an echo from beam to beam at the carrier, radians: `rad_per_m` times the
        derivative of its path by direction, metres.

        Parameters
        ----------
        nodes : AmplitudeNodes
            Through whose amplitudes the parabolas go.
        geometry : BeamGeometry
            Of the sub-aperture.
        rad_per_m : float
            Carrier phase per metre of half path, times the spacing of the beams.
        """
        polar = geometry.polar
        plane = (*polar.track, *polar.across, geometry.centre_m[2] - polar.z_m,
                 geometry.range_m, *geometry.known, rad_per_m)
        offsets = np.stack([nodes.tx_m, nodes.rx_m]) - geometry.centre_m
        # a plain tuple: Numba takes 20 us to tell the type of a named one
        found = _parabolas(tuple(LitEchoes.of(nodes.illumination)), self._positions,
                           geometry.centre_m, offsets, plane)
        return found.reshape(3, *self._shape)


@njit(fastmath=DETERMINISTIC, error_model='numpy')
def _parabolas(echoes, positions, centre, offsets, plane):
    """`LitLines.parabolas` at positions (3, N); `offsets` (2, 3, 3) of the nodes' phase centres.

    `plane` holds the horizontal unit vectors along and across the track, the height of the middle
    above the plane, the distance at which paths are compared, metres, the extremes of the
    directions in which they bend, and `rad_per_m`. Without branches, for the compiler's vectors.
    """
    n = positions.shape[1]
    out = np.empty((3, n), np.float32)
    x, y = np.empty((3, n)), np.empty((3, n))
    for node in range(3):
        _phases(positions, centre, offsets[:, node], plane, x[node])
        two_way_amplitudes(LitEchoes(*echoes), node, positions, y[node])
    for i in range(n):
        x0, x1, x2 = x[0, i], x[1, i], x[2, i]
        y0, y1, y2 = y[0, i], y[1, i], y[2, i]
        whole, first, last = x2 - x0, x1 - x0, x2 - x1
        least = NODES_APART * abs(whole)
        slope = (y1 - y0) / first
        c = ((y2 - y1) / last - slope) / whole
        bent = 1.0 if abs(first) > least else 0.0
        bent = bent if abs(last) > least else 0.0
        b = slope - c * (x0 + x1) if bent > 0.0 else (y2 - y0) / whole
        c = c if bent > 0.0 else 0.0
        a = y0 - x0 * (b + c * x0)
        moved = abs(whole) > _SAME
        out[0, i] = a if moved else y1
        out[1, i] = b if moved else 0.0
        out[2, i] = c if moved else 0.0
    return out


@njit(fastmath=DETERMINISTIC, error_model='numpy')
def _phases(positions, centre, ends, plane, out):
    """Phases of a node's echo from beam to beam, radians: `BeamGeometry.slope`, differentiated."""
    tx, ty, ax, ay, height, range_m, low, high, rad_per_m = plane
    square = range_m * range_m
    (x0, y0, z0), (x1, y1, z1) = ends[0], ends[1]
    own0, own1 = (x0 * x0 + y0 * y0 + z0 * z0 + 2.0 * z0 * height + square,
                  x1 * x1 + y1 * y1 + z1 * z1 + 2.0 * z1 * height + square)
    cx, cy, cz = centre
    factor = -0.5 * range_m * rad_per_m
    for i in range(len(out)):
        x, y, z = positions[0, i] - cx, positions[1, i] - cy, positions[2, i] - cz
        direction = (x * tx + y * ty) / np.sqrt(x * x + y * y + z * z)
        direction = direction if direction > low else low
        along = range_m * (direction if direction < high else high)
        across = np.sqrt(square - along * along - height * height)
        turn = along / across
        ux, uy = tx - turn * ax, ty - turn * ay
        px, py = along * tx + across * ax, along * ty + across * ay
        out[i] = factor * (
            (x0 * ux + y0 * uy) / np.sqrt(own0 - 2.0 * (x0 * px + y0 * py))
            + (x1 * ux + y1 * uy) / np.sqrt(own1 - 2.0 * (x1 * px + y1 * py)))
