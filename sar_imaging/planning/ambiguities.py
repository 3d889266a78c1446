# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Ghosts that pulses too far apart, or too soon after each other, leave in any image.

The ghosts of a scatterer along the track are where the paths of all echoes differ from its own by
whole half wavelengths. They are looked for as an image would show them: by the sum of the echoes
at places as far away, so that several channels, passes, uneven steps and near ranges count.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from ..geometry.half_paths import half_paths
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters

if TYPE_CHECKING:
    from ..geometry.illumination import AntennaPattern, Illumination

_LEAST_ECHOES, _ECHOES = 8, 128  # in the middle of the track, which are looked at
_SAME = 0.02  # wavelengths along the track, within which one echo stands for all
_RANGES, _LEAST_SHARE = 8, 0.1  # parts of a scene, and pixels with ghosts within it
_RANKS = np.arange(1, _RANGES)  # between the parts
_STEPS, _MOST_STEPS = 4, 4096  # places in a cell of their resolution, and in all
_GHOST = 10 ** (-10 / 20)  # amplitude, at one wavelength, above that of sidelobes
_LEAST_DB = -20.0  # of a ghost that is told, spread as it is
_LEAST_ACROSS = 0.1  # sine of the angle between track and look, below which nothing is told


def azimuth_warnings(points_m: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray,
                     radar: RadarParameters, illumination: Illumination | None = None
                     ) -> tuple[str, ...]:
    """Say where scatterers within a scene have ghosts within it, along the track.

    Parameters
    ----------
    points_m : (S, 3) float64
        Some places of the scene, its corners among them, metres.
    tx_m, rx_m : (..., 3) float64
        Phase centres of the echoes, metres.
    radar : RadarParameters
        Radar parameters of the echoes.
    illumination : Illumination, optional
        Illumination of all echoes; what an echo does not light has no ghost by it.
    """
    tx_m, rx_m = tx_m.reshape(-1, 3), rx_m.reshape(-1, 3)
    centre_m = 0.5 * (tx_m + rx_m)
    track, along, some = _middle_of_track(centre_m, radar)
    if len(some) < _LEAST_ECHOES:
        return ()
    origin = centre_m[some].mean(axis=0)
    away = points_m - points_m.mean(axis=0)
    look = points_m[np.einsum('sk,sk->s', away, away).argmin()] - origin
    range_m = np.linalg.norm(look)
    look = look / max(range_m, 1e-9)
    across = track - (track @ look) * look
    if np.linalg.norm(across) < _LEAST_ACROSS:
        return ()
    across /= np.linalg.norm(across)
    left = _rest_of_scene(points_m - origin, across)
    width = min(float(left.max()), 1.9)
    cell = radar.wavelength_m / 2 / np.ptp((centre_m[some] - origin) @ across)
    apart = np.arange(1, min(width * _STEPS / cell, _MOST_STEPS)) * (cell / _STEPS)
    if len(apart) < 3:
        return ()
    sine = 0.5 * apart[:, None]
    ends = np.stack([range_m * (np.sqrt(1 - sine ** 2) * look + side * sine * across)
                     for side in (-1, 1)])
    centres = [centre[some] - origin for centre in (tx_m, rx_m)]
    # Where neighbouring echoes differ by less than half a cycle, sums follow the integral over
    # the track, which has one lobe.
    step = np.abs(np.diff(_apart(ends[:, -1:], *centres), axis=0)).max()
    first = max(0, math.floor(len(apart) * radar.wavelength_m / 4 / max(step, 1e-12)) - 1)
    apart, ends = apart[first:], ends[:, first:]
    if len(apart) < 3:
        return ()
    weight = np.gradient(along[some])[:, None].astype(np.float32)
    own = weight.sum()
    if illumination is not None:
        seen, there = (illumination.select(some).amplitude(origin + end) for end in ends)
        own = np.sqrt((weight * seen ** 2).sum(axis=0) * (weight * there ** 2).sum(axis=0))
        weight = weight * seen * there
    level, n_cells = _ghosts(_apart(ends, *centres), weight, radar)
    place, level_db = _brightest(level / np.maximum(own, 1e-30), n_cells)
    share = 0.0 if place is None else np.mean(left > apart[place])
    if level_db < _LEAST_DB or share < _LEAST_SHARE:
        return ()
    return (f'scatterers are ambiguous: each has a ghost {apart[place] * range_m:.3g} m away '
            f'along the track, {max(0.0, -level_db):.0f} dB fainter, within the scene for '
            f'{share:.0%} of the pixels to either side; the antenna may not light both (tell its '
            f'pattern), else send pulses every {radar.shortest_wavelength_m / (2 * width):.2g} m '
            'or less, or image a narrower grid',)


def _middle_of_track(centre_m: np.ndarray, radar: RadarParameters
                     ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Direction of a track, (3,), places of all echoes along it, metres, and some in its middle.

    Of echoes at one place one stands for all.
    """
    away = centre_m - centre_m.mean(axis=0)
    track = np.linalg.eigh(away.T @ away)[1][:, -1]
    along = away @ track
    some = np.unique(np.rint(along / (_SAME * radar.wavelength_m)), return_index=True)[1]
    first = max(0, (len(some) - _ECHOES) // 2)
    return track, along, some[first:first + _ECHOES]


def _rest_of_scene(seen_m: np.ndarray, across: np.ndarray) -> np.ndarray:
    """(S,) how far a scene goes on along the track beyond each of its places, at its range.

    Sines of directions, seen from the track; `across`, (3,), is the track's part that is
    perpendicular to the look.
    """
    away = np.linalg.norm(seen_m, axis=-1)
    direction, near = seen_m @ across / away, np.sort(away)[len(away) * _RANKS // _RANGES]
    last = np.full(_RANGES, -np.inf)
    ranges = np.searchsorted(near, away)
    np.maximum.at(last, ranges, direction)
    return last[ranges] - direction


def _brightest(level: np.ndarray, n_cells: np.ndarray) -> tuple[int | None, float]:
    """Place of the brightest ghost and its level, dB, spread over cells; none of faint ones."""
    lobes = np.flatnonzero((level[1:-1] >= level[:-2]) & (level[1:-1] > level[2:])
                           & (level[1:-1] > _GHOST)) + 1
    if not len(lobes):
        return None, -math.inf
    place = lobes[level[lobes].argmax()]
    return place, 20 * math.log10(level[place]) - 10 * math.log10(n_cells[place])


def _apart(ends: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray) -> np.ndarray:
    """(R, N) float32 by how much half paths to the first of two places are longer, metres.

    Places, (2, N, 3), and phase centres are counted from nearby: the difference of two squares of
    distances over their sum keeps all digits that float32 has.
    """
    square, between = np.einsum('enk,enk->en', ends, ends), 2 * (ends[0] - ends[1]).T
    single = [v.astype(np.float32) for v in (*square, *-2 * ends.swapaxes(1, 2))]
    found: Any = 0.0
    centres = (tx_m,) if np.array_equal(tx_m, rx_m) else (tx_m, rx_m)
    for centre in centres:
        own = np.einsum('rk,rk->r', centre, centre)[:, None].astype(np.float32)
        near = ((square[0] - square[1]) - centre @ between).astype(np.float32)
        centre = centre.astype(np.float32)
        far = sum(np.sqrt(own + single[n] + centre @ single[2 + n]) for n in (0, 1))
        found = found + near / far
    return found / len(centres)


def _ghosts(apart: np.ndarray, weight: np.ndarray, radar: RadarParameters
            ) -> tuple[np.ndarray, np.ndarray]:
    """(N,) amplitudes at places of scatterers at others, and over how many ranges.

    Paths to both differ by `apart`, (R, N) metres; `weight`, broadcast to that, is that of the
    echoes. At one wavelength: ranges that walk from echo to echo spread a ghost over ranges, other
    wavelengths over directions.
    """
    cycles = apart * np.float32(radar.wavenumber_rad_per_m / (2 * np.pi))
    phase = np.float32(2 * np.pi) * (cycles - np.rint(cycles))
    response = np.hypot(*((weight * part(phase)).sum(axis=0) for part in (np.cos, np.sin)))
    return response, 1 + np.ptp(apart, axis=0) / radar.range_resolution_m


def flight_warnings(place_m: np.ndarray, block: PulseBlock, pattern: AntennaPattern | None
                    ) -> tuple[str, ...]:
    """Say whether echoes of other pulses fall onto a scene, (1, 3) a place of it, metres.

    Nothing where an antenna pattern is told, or the stamps are not those of pulses: they lie
    closer than a profile is long.
    """
    if pattern is not None or block.n_pulses < 3:
        return ()
    assert block.tx_m is not None and block.rx_m is not None
    radar, middle = block.radar, block.n_pulses // 2
    speed = radar.propagation_speed_m_per_s
    range_m = half_paths(block.tx_m[middle, :1], block.rx_m[middle, :1], place_m)[0].item()
    steps = np.diff(block.stamp_ns)
    if steps.min() >= 2e9 * range_m / speed:  # as of nearly all radars
        return ()
    stamps = np.unique(block.stamp_ns)
    interval_s = float(np.median(np.diff(stamps))) * 1e-9 if len(stamps) > 2 else math.inf
    if (not 2 * range_m / speed > interval_s
            or block.n_samples / radar.sample_rate_hz > interval_s):
        return ()
    n_later = math.floor(2 * range_m / speed / interval_s)
    return (f'{n_later} more pulses were sent before the echoes of the scene came, one every '
            f'{interval_s:.3g} s: echoes from {0.5 * speed * interval_s:.4g} m nearer and farther '
            'fall onto it, unless the antenna keeps them out; tell its pattern, or send pulses '
            f'at {speed / (2 * range_m):.3g} Hz or less',)
