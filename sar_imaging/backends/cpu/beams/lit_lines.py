"""Amplitudes of a sub-aperture's echoes as parabolas of their phase from beam to beam."""

from __future__ import annotations

import math

import numpy as np

from ....compilation import njit
from ....geometry.illumination import Illumination
from ....geometry.polar import PolarGrid
from ....planning.afbp.lit_subapertures import NODES_APART, node_pulses
from ..illumination import LitEchoes, two_way_amplitude


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
        self._positions = np.ascontiguousarray(positions)
        self._track = np.array(polar.track)

    def parabolas(self, illumination: Illumination, geometry, echoes, directions,
                  cycles_per_m: float) -> np.ndarray:
        """(n_alpha, K, 3) float32 coefficients A, B and C of ``A + B p + C p^2``.

        p is the phase of an echo from beam to beam at the carrier, radians.

        Parameters
        ----------
        illumination : Illumination
            Of the echoes.
        geometry : BeamGeometry
            Of the sub-aperture.
        echoes : (tx_m, rx_m)
            Phase centres of the echoes, (R, 3) float64 each, metres.
        directions : (M,) float64
            Of the beams.
        cycles_per_m : float
            Carrier phase per metre of half path, cycles.
        """
        nodes = node_pulses(len(echoes[0]))
        slope = geometry.slope(*(c[nodes] for c in echoes), directions)
        spacing = directions[1] - directions[0]
        return _parabolas(LitEchoes.of(illumination.select(nodes)), self._positions,
                          geometry.centre_m, self._track, directions[0], spacing,
                          2 * math.pi * cycles_per_m * spacing * slope)


@njit(error_model='numpy')
def _parabolas(echoes, positions, centre, track, first, spacing, phase):
    n_lines, n_knots = positions.shape[:2]
    out = np.empty((n_lines, n_knots, 3), np.float32)
    last = len(phase) - 2
    for line in range(n_lines):
        for knot in range(n_knots):
            px, py, pz = positions[line, knot]
            x, y, z = px - centre[0], py - centre[1], pz - centre[2]
            direction = (x * track[0] + y * track[1]) / np.sqrt(x * x + y * y + z * z)
            beam = (direction - first) / spacing
            n = min(max(int(beam), 0), last)
            t = beam - n
            x0 = phase[n, 0] + t * (phase[n + 1, 0] - phase[n, 0])
            x1 = phase[n, 1] + t * (phase[n + 1, 1] - phase[n, 1])
            x2 = phase[n, 2] + t * (phase[n + 1, 2] - phase[n, 2])
            y0 = two_way_amplitude(echoes, 0, px, py, pz)
            y1 = two_way_amplitude(echoes, 1, px, py, pz)
            y2 = two_way_amplitude(echoes, 2, px, py, pz)
            a, b, c = y1, 0.0, 0.0
            if abs(x2 - x0) > 1e-9:
                least = NODES_APART * abs(x2 - x0)
                b = (y2 - y0) / (x2 - x0)
                if abs(x1 - x0) > least and abs(x2 - x1) > least:
                    slope = (y1 - y0) / (x1 - x0)
                    c = ((y2 - y1) / (x2 - x1) - slope) / (x2 - x0)
                    b = slope - c * (x0 + x1)
                a = y0 - x0 * (b + c * x0)
            out[line, knot, 0], out[line, knot, 1], out[line, knot, 2] = a, b, c
    return out
