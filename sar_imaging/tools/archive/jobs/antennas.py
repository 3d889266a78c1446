"""Antennas of apertures: kept beside their phase centres, in the frame of the map."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sar_imaging.geometry.earth import Datum
from sar_imaging.geometry.illumination import AntennaPattern, PatternCut, Pointing

_CUTS = ('azimuth', 'elevation')


def turned(looks: Pointing | None, own: Datum | None, wanted: Datum | None) -> Pointing | None:
    """Pointing in another frame; the same where either frame stands nowhere."""
    if looks is None or own is None or wanted is None or own == wanted:
        return looks
    return Pointing(*(wanted.vectors_from_ecef(own.vectors_to_ecef(axes))
                      for axes in (looks.boresight, looks.up)))


def antenna_arrays(pattern: AntennaPattern | None, looks: Pointing | None
                   ) -> dict[str, np.ndarray]:
    """An antenna as arrays of a file, to the bit; none where there is no antenna."""
    if pattern is None:
        return {}
    arrays = {'boresight': looks.boresight, 'up': looks.up}
    for name in _CUTS:
        cut = getattr(pattern, name)
        arrays[name] = np.array([cut.start, cut.step, *cut.amplitude])
    return arrays


def antenna_of_arrays(arrays: Mapping[str, np.ndarray]
                      ) -> tuple[AntennaPattern | None, Pointing | None]:
    """What `antenna_arrays` wrote: the pattern, and where it looked at each pulse."""
    if _CUTS[0] not in arrays:
        return None, None
    cuts = (PatternCut(float(v[0]), float(v[1]), v[2:]) for v in map(arrays.__getitem__, _CUTS))
    return (AntennaPattern(*cuts),
            Pointing.of_unit_vectors(arrays['boresight'], arrays['up']))
