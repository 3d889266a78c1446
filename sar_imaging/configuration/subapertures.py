"""Sub-apertures that AFBP would plan for a configuration, on the straight track."""

from __future__ import annotations

import dataclasses

import numpy as np

from ..planning.afbp.plan import plan_afbp
from .derived import Derived
from .settings import Acquisition, Imaging


@dataclasses.dataclass(frozen=True)
class SubapertureForecast:
    """Plan of AFBP for a straight track.

    Parameters
    ----------
    count : int
        Number of sub-apertures; 0 where AFBP cannot image the scene.
    pulses : int
        Pulses of the longest of them.
    predicted_error_db : float or None
        Predicted error against exact correlation, dB.
    reason : str
        Why AFBP cannot image the scene; empty where it can.
    """

    count: int
    pulses: int
    predicted_error_db: float | None
    reason: str = ''


def forecast_subapertures(acquisition: Acquisition, imaging: Imaging,
                          derived: Derived) -> SubapertureForecast:
    """Plan AFBP for the configuration; takes some tenths of a second.

    Parameters
    ----------
    acquisition, imaging
        The configuration.
    derived : Derived
        What `derive` made of it.

    Returns
    -------
    SubapertureForecast
    """
    track = acquisition.track(imaging.pulses_per_aperture)[:, None]
    rx_m = track + acquisition.receiver_offsets()
    tx_m = np.broadcast_to(track, rx_m.shape)
    try:
        plan = plan_afbp(imaging.grid, derived.profile_radar, derived.n_profile, tx_m, rx_m,
                         target_db=imaging.subaperture_target_db,
                         pulses_per_subaperture=imaging.subaperture_pulses or None)
    except ValueError as error:
        return SubapertureForecast(0, 0, 0.0, str(error))
    pulses = plan.subapertures.sampling.pulses
    return SubapertureForecast(len(pulses), max(p.stop - p.start for p in pulses),
                               plan.predicted_error_db)
