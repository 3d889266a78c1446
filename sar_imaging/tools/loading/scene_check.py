"""What a person should know of pulses and scene before an image is made of them."""

from __future__ import annotations

import dataclasses

import numpy as np

from sar_imaging.diagnosis.hypotheses import distances, reach_advice
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.illumination import AntennaPattern, Illumination
from sar_imaging.loading import Loaded
from sar_imaging.signal.positioning import locate
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.range_compression import RangeCompressor

_LOOKED_AT = 64  # pulses, spread over all
_SIDE = 9  # places along each side of the map
_DEGREES_M = 0.05  # places of degrees differ by less over a track of some kilometres


def told_of_scene(loaded: Loaded) -> tuple[str, ...]:
    """Warnings: positions that hardly differ, a scene out of reach or never lit.

    Parameters
    ----------
    loaded : Loaded
        Pulses with positions or poses.
    """
    some = loaded.block.select(slice(None, None, -(-loaded.block.n_pulses // _LOOKED_AT)))
    told = ()
    if loaded.poses is not None:
        some, told = _located(some, loaded)
    told += _still(some) + _out_of_reach(some, loaded.scene.grid)
    if told or loaded.antenna is None:
        return told
    return _dark(some, loaded.scene.grid, loaded.antenna.amplitudes())


def _located(block: PulseBlock, loaded: Loaded) -> tuple[PulseBlock, tuple[str, ...]]:
    """The pulses where poses say that they are, and what keeps poses from being used."""
    poses, alignment = loaded.poses, loaded.alignment
    try:
        return locate(block, poses, alignment, loaded.mount), ()
    except ValueError as error:
        told = () if loaded.warnings else (
            f'images need other poses: {error}; check their unit (unit_m), rate and outliers',)
    time_ns = poses.stamp_ns - poses.stamp_ns[0]  # which float64 holds
    at = block.stamp_ns + alignment.time_offset_ns - poses.stamp_ns[0]
    place = np.stack([np.interp(at, time_ns, axis) for axis in poses.position_m.T], axis=-1)
    place = np.repeat(place[:, None], block.n_channels, axis=1)
    return dataclasses.replace(block, tx_m=place, rx_m=place), told


def _still(block: PulseBlock) -> tuple[str, ...]:
    centre = (0.5 * (block.tx_m + block.rx_m)).reshape(-1, 3)
    extent_m, mean = float(np.linalg.norm(np.ptp(centre, axis=0))), centre.mean(axis=0)
    wavelength_m = block.radar.wavelength_m
    if block.n_pulses < 2 or extent_m > wavelength_m / 2:
        return ()
    degrees = 0 < extent_m < _DEGREES_M and (np.abs(mean[:2]) > 1).all() and abs(mean[0]) <= 180
    return (f'all positions lie within {extent_m:.3g} m, less than half of the wavelength of '
            f'{wavelength_m:.3g} m: nothing is resolved across the line of sight; '
            + (f'{mean[0]:.4f} and {mean[1]:.4f} may be degrees of latitude and longitude, which '
               'have to be converted to metres east and north' if degrees else
               'expected positions in metres of an antenna that moves'),)


def _out_of_reach(block: PulseBlock, grid: MapGrid) -> tuple[str, ...]:
    radar, n = block.radar, block.n_samples
    if not block.compressed:
        compressor = RangeCompressor.for_block(block.select(slice(0, 1)))
        radar, n = compressor.output_radar, compressor.n_output
    start_m = radar.range_start_m
    stop_m = start_m + n * radar.sample_spacing_m
    near_m, far_m = distances(block, grid)
    if near_m < stop_m and far_m > start_m:
        return ()
    profiles = dataclasses.replace(
        block, radar=radar, compressed=True,
        samples=np.zeros((*block.samples.shape[:2], n), np.complex64))
    advice = reach_advice(profiles, grid)
    return (f'the scene lies {near_m:.4g} to {far_m:.4g} m from the radar, whose samples hold '
            f'ranges from {start_m:.4g} to {stop_m:.4g} m: its image would be empty. '
            + (f'{advice[0].upper()}{advice[1:]}. ' if advice else '')
            + 'Check scene.centre_m, and the positions: their unit (unit_m), frame and height',)


def _dark(block: PulseBlock, grid: MapGrid, pattern: AntennaPattern) -> tuple[str, ...]:
    rows, columns = (np.unique(np.linspace(0, n - 1, _SIDE).astype(int)) for n in grid.shape)
    places = grid.positions(rows[:, None], columns).reshape(-1, 3)
    lit = Illumination.of_pulses(pattern, block.pointing, block.tx_m, block.rx_m)
    if lit.amplitude(places).any():
        return ()
    looks = block.pointing.boresight[0].round(2) + 0.0  # no -0.00
    return ('the antenna never looks at the scene, whose image would be empty: at the first pulse '
            f'it looks towards ({looks[0]:.2f}, {looks[1]:.2f}, {looks[2]:.2f}); check '
            'antenna.pointing (side, boresight, target) and scene.centre_m',)
