"""Compiled paths of a sub-aperture's echoes as its beams take them."""

from __future__ import annotations

import numpy as np

from ....compilation import DETERMINISTIC, njit
from ....planning.afbp.beam_geometry import BeamGeometry


class CompiledBeamGeometry(BeamGeometry):
    """`BeamGeometry` whose paths are found several times as fast: each sub-aperture needs them."""

    def extra_path(self, tx_m, rx_m, direction) -> np.ndarray:
        """(S, R) by how much half paths are longer than the distance from the centre, metres."""
        centres = np.concatenate([tx_m, rx_m]).reshape(2, -1, 3) - self.centre_m
        plane = np.array([*self.polar.track, *self.polar.across,
                          self.centre_m[2] - self.polar.z_m])
        return _extra_paths(centres, plane, self.range_m, np.array(direction, float))


@njit(fastmath=DETERMINISTIC, error_model='numpy')
def _extra_paths(centres_m, plane, range_m, direction):
    """`BeamGeometry.extra_path` for (2, R, 3) phase centres counted from their middle.

    `plane` holds the horizontal unit vectors along and across the track and the height of the
    middle above the plane.
    """
    n_echoes, n_directions = centres_m.shape[1], len(direction)
    height, square = plane[4], range_m * range_m
    x, y = np.empty(n_echoes), np.empty(n_echoes)
    own, share = np.empty(n_echoes), np.empty(n_echoes)
    path = np.zeros((n_directions, n_echoes))
    for end in range(2):
        apart = False  # transmitters and receivers
        for r in range(n_echoes):
            x[r], y[r], z = centres_m[end, r, 0], centres_m[end, r, 1], centres_m[end, r, 2]
            own[r] = x[r] * x[r] + y[r] * y[r] + z * z + 2 * z * height
            share[r] = 1.0 - end
            if (x[r] != centres_m[1 - end, r, 0] or y[r] != centres_m[1 - end, r, 1]
                    or z != centres_m[1 - end, r, 2]):
                share[r] = 0.5
                apart = True
        if end == 1 and not apart:
            break
        for s in range(n_directions):
            along = range_m * direction[s]
            across = np.sqrt(max(square - along * along - height * height, 0.0))
            px = along * plane[0] + across * plane[2]
            py = along * plane[1] + across * plane[3]
            beyond = px * px + py * py + height * height - square
            for r in range(n_echoes):
                longer = own[r] + beyond - 2 * (x[r] * px + y[r] * py)  # squared
                path[s, r] += share[r] * longer / (np.sqrt(square + longer) + range_m)
    return path
