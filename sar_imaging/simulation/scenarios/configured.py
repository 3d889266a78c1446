"""Scenario of a configuration: a few scatterers as the configured radar receives them."""

from __future__ import annotations

from ...configuration.derived import derive
from ...configuration.settings import Acquisition, Imaging, Machine
from ..scene import Scatterer
from ..trajectory import Trajectory
from .scenario import Scenario

# Share of half the grid along x and y, amplitude in dB: none in the row or column of another.
_PLACES = (('middle', 0.0, 0.0, 0.0), ('north_east', 0.55, 0.62, -3.0),
           ('north_west', -0.61, 0.47, -6.0), ('south_east', 0.43, -0.57, -6.0),
           ('south_west', -0.52, -0.66, -3.0))
_CUT_NULLS = 8  # half width of the cuts that measure sidelobes


def configured_scenario(name: str, acquisition: Acquisition, imaging: Imaging, *,
                        apertures: int = 1) -> Scenario:
    """Simulated recording of a configured radar over its configured scene.

    Parameters
    ----------
    name : str
        Name of the recording.
    acquisition : Acquisition
        Radar and track.
    imaging : Imaging
        Grid and length of the aperture.
    apertures : int
        Length of the recording in apertures; the configured position is its middle.

    Returns
    -------
    Scenario
        Five scatterers on the plane of the grid.

    Raises
    ------
    ValueError
        The configuration is impossible.
    """
    derived = derive(acquisition, imaging, Machine.this_one())
    grid = imaging.grid
    half_x, half_y = 0.5 * (grid.x_m[-1] - grid.x_m[0]), 0.5 * (grid.y_m[0] - grid.y_m[-1])
    x, y, z = grid.centre_m
    scatterers = tuple(Scatterer(place, (x + u * half_x, y + v * half_y, z), 10 ** (db / 20))
                       for place, u, v, db in _PLACES)
    receivers = tuple(tuple(float(v) for v in row) for row in acquisition.receiver_offsets())
    return Scenario(
        name=name, description=f'Configured radar {name}, five scatterers',
        radar=acquisition.radar, compressed=acquisition.compressed,
        n_samples=acquisition.n_samples, prf_hz=acquisition.prf_hz,
        n_pulses=apertures * imaging.pulses_per_aperture,
        pulses_per_aperture=imaging.pulses_per_aperture,
        trajectory=Trajectory(centre_m=acquisition.centre_m,
                              velocity_m_per_s=acquisition.velocity_m_per_s),
        tx_offsets_m=((0.0, 0.0, 0.0),) * acquisition.n_channels, rx_offsets_m=receivers,
        scatterers=scatterers, grid=grid,
        cut_half_width_m=(_CUT_NULLS * derived.range_null_m, _CUT_NULLS * derived.azimuth_null_m),
        notes='Radar, platform and grid of a configuration file')
