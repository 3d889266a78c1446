# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Frequent mistakes of users, as changes of a block that undo them.

Where only range profiles are at hand, raw samples need not be: with the spectrum P0 of a
pulse centred on time zero, profiles of conjugated LFM pulses are those of the right ones,
conjugated and filtered with ``P0 / conj(P0)``, and those compressed with the wrong sign of the
slope are the right ones filtered with it. Profiles of phase histories are transforms: conjugated
samples give ``conj(p(-u))`` at the delay u beyond the reference, reversed frequencies ``p(-u)``,
each but for the residual video phase, ``exp(-j pi K u^2)`` of the ramp.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from scipy import fft

from ..geometry.grids import MapGrid
from ..signal import magnitudes
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters, Waveform
from ..signal.range_compression import GUARD_SAMPLES
from ..signal.waveforms import lfm_spectrum

_FEWEST_PULSES = 16  # for offsets of the clock
_LEAST_CELLS = 4.0  # that a wrong delay shifts profiles by
_LEAST_EXTENT = 1.0  # wavelengths, of an aperture
_FELT_RAD = 1.0  # rms phase that an offset may leave
_LARGEST_DRIFT = 0.26  # of the rate of a clock
_SLOPES = np.linspace(0.7, 1.45, 41)
_FEWEST_RATES, _MOST_RATES = 12, 60  # on each side
_MOST_NAMED = 3  # mistakes that would bring a grid into profiles
_MOST_ORDERED = 4  # transmitters, of which all orders are tried
_Undo: TypeAlias = Callable[[PulseBlock], list[PulseBlock]]


@dataclasses.dataclass(frozen=True)
class Hypothesis:
    """A mistake and how a block looks without it.

    Parameters
    ----------
    name : str
        Short name, the key in reports.
    advice : str
        What is probably wrong and what to change, a sentence without subject.
    undo : callable
        From a block to the blocks that it should have been, none where it does not apply.
    of_samples : bool
        True when it leaves positions and ranges of the pulses alone.
    isometry : bool
        True when it mirrors the track: the mirrored scene is as much in focus.
    sizes : tuple of float
        What was searched for, of mistakes that have a size.
    """

    name: str
    advice: str
    undo: _Undo
    of_samples: bool = False
    isometry: bool = False
    sizes: tuple[float, ...] = ()


def _moved(change: Callable[[np.ndarray], np.ndarray]) -> _Undo:
    def undo(block: PulseBlock) -> list[PulseBlock]:
        tx_m, rx_m = map(change, block.centres_m)
        return [dataclasses.replace(block, tx_m=tx_m, rx_m=rx_m)]
    return undo


def _delayed(factor: float) -> _Undo:
    def undo(block: PulseBlock) -> list[PulseBlock]:
        radar, out = block.radar, []
        for given_s in _given_delays_s(block):
            delay = radar.first_sample_delay_s + (factor - 1) * given_s
            if (abs((factor - 1) * given_s) * radar.bandwidth_hz >= _LEAST_CELLS
                    and abs(delay) <= magnitudes.DELAY.most):
                out.append(dataclasses.replace(block, radar=dataclasses.replace(
                    radar, first_sample_delay_s=delay)))
        return out
    return undo


def _given_delays_s(block: PulseBlock) -> list[float]:
    """Delays that a user may have given: of the first sample, or of a phase history's middle."""
    radar = block.radar
    start = radar.first_sample_delay_s
    if not block.compressed or not radar.waveform.is_phase_history or start <= 0:
        return [start]
    return [start, start + (block.n_samples // 2) / radar.sample_rate_hz]


def _scaled(factor: float) -> _Undo:
    def undo(block: PulseBlock) -> list[PulseBlock]:
        tx_m, rx_m = (factor * centres for centres in block.centres_m)
        changed = dataclasses.replace(block, tx_m=tx_m, rx_m=rx_m)
        # From one place all pulses agree everywhere, which is not focus.
        centres = (tx_m + rx_m) / 2
        extent = np.ptp(centres, axis=(0, 1)).max()
        return [changed] if extent > _LEAST_EXTENT * block.radar.wavelength_m else []
    return undo


def _transmitters_ordered(block: PulseBlock) -> list[PulseBlock]:
    """Blocks whose transmitters are in any other order, each with all of its receivers."""
    _, which = np.unique(np.round(block.centres_m[0][0], 6), axis=0, return_inverse=True)
    which = which.ravel()
    n = int(which.max()) + 1
    channels = [np.flatnonzero(which == t) for t in dict.fromkeys(which)]
    if n < 2 or n == block.n_channels or len({len(c) for c in channels}) > 1:
        return []  # one, or transmitters that are receivers too
    orders = (itertools.permutations(range(n)) if n <= _MOST_ORDERED else
              (tuple(reversed(range(n))), *((k, *range(k), *range(k + 1, n))
                                            for k in range(1, n))))
    out = []
    for order in orders:
        if order != tuple(range(n)):
            samples = np.empty_like(block.samples)
            samples[:, np.concatenate(channels)] = block.samples[
                :, np.concatenate([channels[t] for t in order])]
            out.append(dataclasses.replace(block, samples=samples))
    return out


def conjugations(block: PulseBlock) -> list[PulseBlock]:
    """Blocks as they are if samples came conjugated, or as Q, I instead of I, Q."""
    radar = block.radar
    plain = dataclasses.replace(block, samples=block.samples.conj())
    if not block.compressed:
        return [] if radar.waveform.is_real else [plain]
    out = [plain]
    if radar.waveform == Waveform.LFM and radar.chirp_rate_hz_per_s:
        out.append(_dispersed(plain, -1))
    elif radar.waveform in (Waveform.FMCW, Waveform.STEPPED_FREQUENCY):
        out.append(_mirrored(block, -2 * radar.chirp_rate_hz_per_s))
    return out


def reversed_slopes(block: PulseBlock) -> list[PulseBlock]:
    """Blocks as they are if the ramp falls where it is said to rise, or the other way round."""
    radar = block.radar
    if not radar.chirp_rate_hz_per_s or not (
            radar.waveform == Waveform.LFM or radar.waveform.is_ramp):
        return []
    out = [_with_slope_reversed(block, radar.carrier_hz)]
    if radar.waveform.is_ramp:
        # The middle of the ramp lies on the other side of its start, as far as that is known.
        swept_hz = abs(radar.chirp_rate_hz_per_s) * radar.pulse_length_s
        carrier_hz = radar.carrier_hz - np.sign(radar.chirp_rate_hz_per_s) * swept_hz
        if carrier_hz > swept_hz:
            out.append(_with_slope_reversed(block, carrier_hz))
    return out


def _with_slope_reversed(block: PulseBlock, carrier_hz: float) -> PulseBlock:
    radar = dataclasses.replace(block.radar, carrier_hz=carrier_hz,
                                chirp_rate_hz_per_s=-block.radar.chirp_rate_hz_per_s)
    changed = dataclasses.replace(block, radar=radar)
    if not block.compressed:
        return changed
    if radar.waveform == Waveform.LFM:
        return _dispersed(changed, +1)
    return _mirrored(dataclasses.replace(changed, samples=changed.samples.conj()), 0.0)


def _dispersed(block: PulseBlock, sign: int) -> PulseBlock:
    """Profiles of raw pulses that were compressed for the opposite slope.

    Parameters
    ----------
    block : PulseBlock
        With the radar to compress for.
    sign : int
        +1 where `block.radar` already has the opposite slope, -1 where it keeps it.
    """
    radar = block.radar
    frequency = fft.fftfreq(_padded(block.n_samples), 1 / radar.sample_rate_hz)
    band = np.abs(frequency) <= radar.bandwidth_hz / 2
    old = dataclasses.replace(radar, chirp_rate_hz_per_s=-sign * radar.chirp_rate_hz_per_s)
    new = dataclasses.replace(radar, chirp_rate_hz_per_s=sign * radar.chirp_rate_hz_per_s)
    gain = np.zeros(len(frequency), np.complex64)
    gain[band] = lfm_spectrum(frequency[band], old) / lfm_spectrum(frequency[band], new)
    spectra = fft.fft(block.samples, len(frequency)) * gain
    return dataclasses.replace(block, samples=fft.ifft(spectra)[..., :block.n_samples])


def _padded(n: int) -> int:
    return fft.next_fast_len(2 * n)


def _mirrored(block: PulseBlock, slope: float) -> PulseBlock:
    """Profiles of one period whose delays count the other way, times ``exp(j pi slope u^2)``.

    Profiles that were cut to a range window lack the other side; nothing focuses then.
    """
    n, rate_hz = block.n_samples, block.radar.sample_rate_hz
    # Profiles of a near scene begin at delay 0, others half a period before the reference.
    near = round(block.radar.first_sample_delay_s * rate_hz) >= -GUARD_SAMPLES - 1 and \
        block.radar.first_sample_delay_s <= 0
    period = max(n - 2 * GUARD_SAMPLES - int(near), 1)
    reference = GUARD_SAMPLES + (0 if near else period // 2)
    index = np.arange(n)
    source = GUARD_SAMPLES + (2 * reference - index - GUARD_SAMPLES) % period
    cycles = 0.5 * slope * ((index - reference) / rate_hz) ** 2
    turn = np.exp(2j * np.pi * np.remainder(cycles, 1.0)).astype(np.complex64)
    return dataclasses.replace(
        block, samples=block.samples[..., np.minimum(source, n - 1)].conj() * turn)


GEOMETRY = (
    Hypothesis('positions in millimetres', 'the phase centres are probably in millimetres; '
               'divide tx_m and rx_m by 1000', _scaled(1e-3)),
    Hypothesis('positions in centimetres', 'the phase centres are probably in centimetres; '
               'divide tx_m and rx_m by 100', _scaled(1e-2)),
    Hypothesis('positions in kilometres', 'the phase centres are probably in kilometres; '
               'multiply tx_m and rx_m by 1000', _scaled(1e3)),
    Hypothesis('x and y exchanged', 'x and y of the phase centres are probably exchanged, as '
               'between north-east-down and east-north-up; swap them',
               _moved(lambda p: p[..., [1, 0, 2]]), isometry=True),
    Hypothesis('track mirrored in x', 'the sign of x of the phase centres is probably wrong; '
               'the track is mirrored', _moved(lambda p: p * [-1, 1, 1]), isometry=True),
    Hypothesis('track mirrored in y', 'the sign of y of the phase centres is probably wrong; '
               'the track is mirrored', _moved(lambda p: p * [1, -1, 1]), isometry=True),
    Hypothesis('track mirrored in z', 'the sign of z of the phase centres is probably wrong; '
               'z points up in the imaging frame', _moved(lambda p: p * [1, 1, -1]),
               isometry=True),
    Hypothesis('delay one way', 'first_sample_delay_s is probably counted one way; it is '
               'two-way, 2 R / c: double it', _delayed(2.0)),
    Hypothesis('delay twice', 'first_sample_delay_s is probably twice too long; it is 2 R / c: '
               'halve it', _delayed(0.5)),
    Hypothesis('delay in microseconds', 'first_sample_delay_s was probably meant in us; pass '
               'seconds', _delayed(1e-6)),
    Hypothesis('delay in nanoseconds', 'first_sample_delay_s was probably meant in ns; pass '
               'seconds', _delayed(1e-9)),
)
ORDER = Hypothesis('positions reversed', 'the positions probably run against the pulses; reverse '
                   'one of them', _moved(lambda p: p[::-1]))
TRANSMITTERS = Hypothesis(
    'order of transmitters', 'the transmitters were probably recorded in another order than the '
    'channels have phase centres; exchange the samples of their channels, or their phase centres',
    _transmitters_ordered, of_samples=True)
SAMPLES = (
    Hypothesis('samples conjugated', 'the samples are probably conjugated, or Q and I exchanged; '
               'pass samples.conj(), or set samples.conjugate in the description', conjugations,
               of_samples=True),
    Hypothesis('sign of the slope', 'the sign of chirp_rate_hz_per_s (the slope of the ramp) is '
               'probably wrong; reverse it', reversed_slopes, of_samples=True),
    TRANSMITTERS,
)
HYPOTHESES = (*SAMPLES, *GEOMETRY, ORDER)


def clock_offsets(block: PulseBlock, towards_m: np.ndarray, most_s: float, n_most: int, *,
                  felt_rad: float = _FELT_RAD) -> np.ndarray:
    """Offsets of the clock worth trying: as close as focus asks for, as far as pulses tell.

    Parameters
    ----------
    block : PulseBlock
        With positions.
    towards_m : (K, 3) float64
        Places that are to focus, metres.
    most_s : float
        Largest offset, seconds.
    n_most : int
        Most offsets on each side.
    felt_rad : float
        Rms phase from one offset to the next.

    Returns
    -------
    (K,) float64
        Seconds, ascending, 0 among them; empty where no offset changes the focus.
    """
    time_s = _times(block)
    if len(time_s) < _FEWEST_PULSES or np.any(np.diff(time_s) <= 0):
        return np.empty(0)
    reach = min(most_s, 0.5 * float(time_s[-1] - time_s[0]))

    def phase(offset_s: float) -> float:
        return max(_left_rad(block, with_offset(block, offset), towards_m)
                   for offset in (-offset_s, offset_s))

    if (phase(0.5 * reach) < 0.5 * _FELT_RAD
            or _besides_rigid_rad(block, with_offset(block, 0.5 * reach)) < 0.5 * _FELT_RAD):
        return np.empty(0)
    step = float(np.median(np.diff(time_s)))
    while step < reach / 2 and phase(step) < felt_rad:
        step *= 1.2
    step = max(step, reach / n_most)
    n = max(1, int(reach / step))
    return step * np.arange(-n, n + 1)


def clock_rates(block: PulseBlock, towards_m: np.ndarray, *,
                felt_rad: float = _FELT_RAD) -> np.ndarray:
    """Rates of the clock worth trying, as close as focus asks for.

    Parameters
    ----------
    block : PulseBlock
        With positions.
    towards_m : (K, 3) float64
        Places that are to focus, metres.
    felt_rad : float
        Rms phase from one rate to the next.

    Returns
    -------
    (K,) float64
        Around 1, ascending; empty where no rate changes the focus.
    """
    if block.n_pulses < _FEWEST_PULSES or np.any(np.diff(block.stamp_ns) <= 0):
        return np.empty(0)
    little = _LARGEST_DRIFT / 8
    left = _left_rad(block, with_offset(block, 0.0, 1 - little), towards_m)
    left *= _LARGEST_DRIFT / little
    if left < 0.5 * _FELT_RAD:
        return np.empty(0)
    n = int(np.clip(left / felt_rad, _FEWEST_RATES, _MOST_RATES))
    return 1 + _LARGEST_DRIFT / n * np.arange(-n, n + 1)


def slopes(block: PulseBlock, towards_m: np.ndarray) -> np.ndarray:
    """Factors of the slope of a ramp worth trying.

    Another slope scales ranges. Of a short aperture the scaled scene is as much in focus.

    Parameters
    ----------
    block : PulseBlock
        With positions.
    towards_m : (K, 3) float64
        Places that are to focus, metres.

    Returns
    -------
    (K,) float64
        Ascending; empty where no slope changes the focus.
    """
    centres = block.phase_centre_m
    middle = centres.mean(axis=0)
    left = max(_besides_line_rad(block, _half_paths(centres, middle + factor * (
        towards_m - middle)) - _half_paths(centres, towards_m)) for factor in _SLOPES[[0, -1]])
    return _SLOPES if left > 0.5 * _FELT_RAD else np.empty(0)


def _left_rad(block: PulseBlock, moved: PulseBlock, towards_m: np.ndarray) -> float:
    """Largest rms phase that other positions leave besides a line over the aperture, radians."""
    if moved.n_pulses < _FEWEST_PULSES // 2:
        return 0.0
    inside = np.isin(block.counter, moved.counter)
    return _besides_line_rad(block, _half_paths(moved.phase_centre_m, towards_m)
                             - _half_paths(block.phase_centre_m[inside], towards_m))


def _half_paths(centres_m: np.ndarray, towards_m: np.ndarray) -> np.ndarray:
    """(P, K) distances of places (K, 3) from phase centres (P, 3), metres."""
    return np.linalg.norm(centres_m[:, None] - towards_m, axis=-1)


def _besides_line_rad(block: PulseBlock, change_m: np.ndarray) -> float:
    """Largest rms phase that a change of half paths (P, K) leaves besides a line, radians."""
    u = np.linspace(-1.0, 1.0, len(change_m))
    line = np.polynomial.polynomial.polyfit(u, change_m, 1)
    rest = change_m - np.polynomial.polynomial.polyval(u, line).T
    return float(rest.std(axis=0).max()) * block.radar.wavenumber_rad_per_m


def _besides_rigid_rad(block: PulseBlock, moved: PulseBlock, *, mirrored: bool = False) -> float:
    """Rms phase of what a turn about the vertical and a shift leave of other positions, radians.

    A track that is turned as a whole, as an arc at constant speed is by another time, images the
    scene turned, in focus. Where `mirrored`, the track may be mirrored as well.
    """
    if moved.n_pulses < _FEWEST_PULSES // 2:
        return 0.0
    a, b = (p - p.mean(axis=0) for p in (
        block.phase_centre_m[np.isin(block.counter, moved.counter)], moved.phase_centre_m))
    flat_a, flat_b = (p[:, 0] + 1j * p[:, 1] for p in (a, b))
    left = []
    for flat in (flat_b, flat_b.conj()) if mirrored else (flat_b,):
        turn = np.vdot(flat, flat_a)
        turn /= max(abs(turn), 1e-300)
        for up in (1, -1) if mirrored else (1,):
            left.append(np.mean(np.square(np.abs(flat_a - turn * flat))
                                + np.square(a[:, 2] - up * b[:, 2])))
    return float(np.sqrt(min(left))) * block.radar.wavenumber_rad_per_m


def congruent(block: PulseBlock, other: PulseBlock) -> bool:
    """Whether one track is the other moved, turned or mirrored, so that either is in focus."""
    return _besides_rigid_rad(block, other, mirrored=True) < 0.5 * _FELT_RAD


def clock_offset(offset_s: float) -> Hypothesis:
    """The clocks of pulses and positions are apart."""
    sign = '+' if offset_s > 0 else '-'
    return Hypothesis(
        'clock offset', f'the clocks of pulses and positions are probably {abs(offset_s):.2g} s '
        'apart: a pulse stamped t was sent where the platform is said to be at t '
        f'{sign} {abs(offset_s):.2g} s; add {offset_s:+.2g} to pose.time_offset_s of the node, or '
        'to alignment.time_offset_s of `sar-imaging load`, or correct the stamps',
        lambda b: [with_offset(b, offset_s)], sizes=(offset_s,))


def clock_drift(rate: float) -> Hypothesis:
    """The clocks of pulses and positions run at different rates."""
    return Hypothesis(
        'clock drift', 'the clocks of pulses and positions probably run at different rates: '
        f'positions fit where the times of the pulses are stretched {rate:.3g} times; check '
        'the pulse repetition frequency with which pulses were stamped, or the speed with '
        'which positions were computed', lambda b: [with_offset(b, 0.0, rate)], sizes=(rate,))


def wrong_slope(factor: float, radar: RadarParameters) -> Hypothesis:
    """The slope of the ramp is another one than `radar` says."""
    right = factor * radar.chirp_rate_hz_per_s
    return Hypothesis(
        'wrong slope', f'the slope of the ramp is probably {right:.4g} Hz/s, {factor:.3g} times '
        'what is given; set slope_hz_per_s of the description of `sar-imaging load`, or '
        'chirp_rate_hz_per_s of the pulses', lambda b: [with_slope(b, factor)],
        of_samples=True, sizes=(factor,))


def with_offset(block: PulseBlock, offset_s: float, rate: float = 1.0,
                track: PulseBlock | None = None) -> PulseBlock:
    """Pulses at the positions that the track has at other times, those that have one.

    The times are `offset_s` later, and run `rate` times as fast from the middle on. The mean
    displacement is taken out: it moves the image and focuses nothing. The track is that of the
    block, or of a block of which it is a part.
    """
    track = block if track is None else track
    time_s = _times(track)
    middle_s = 0.5 * (time_s[0] + time_s[-1])
    wanted_s = middle_s + offset_s + rate * (
        1e-9 * (block.stamp_ns - track.stamp_ns[0]) - middle_s)
    inside = (wanted_s >= time_s[0]) & (wanted_s <= time_s[-1])
    some = block.select(inside)
    if not some.n_pulses:
        return some
    centres = [_at(time_s, a, wanted_s[inside]) for a in track.centres_m]
    back = np.mean(some.centres_m[0] - centres[0], axis=(0, 1))
    return dataclasses.replace(some, tx_m=centres[0] + back, rx_m=centres[1] + back)


def with_slope(block: PulseBlock, factor: float) -> PulseBlock:
    """Raw pulses whose ramp is said to be `factor` times as steep, from the same start."""
    radar = block.radar
    changes: dict[str, Any] = {
        'chirp_rate_hz_per_s': factor * radar.chirp_rate_hz_per_s,
        'bandwidth_hz': abs(factor) * radar.bandwidth_hz}
    if radar.waveform.is_ramp:
        half_swept_hz = radar.chirp_rate_hz_per_s * radar.pulse_length_s / 2
        changes['carrier_hz'] = radar.carrier_hz + (factor - 1) * half_swept_hz
    return dataclasses.replace(block, radar=dataclasses.replace(radar, **changes))


def _times(block: PulseBlock) -> np.ndarray:
    return (block.stamp_ns - block.stamp_ns[0]) * 1e-9


def _at(time_s: np.ndarray, values: np.ndarray, wanted_s: np.ndarray) -> np.ndarray:
    flat = values.reshape(len(values), -1)
    out = np.stack([np.interp(wanted_s, time_s, column) for column in flat.T], axis=-1)
    return out.reshape(len(wanted_s), *values.shape[1:])


def distances(block: PulseBlock, grid: MapGrid) -> tuple[float, float]:
    """Least and largest half path between the pulses and the corners and middle of the grid."""
    x, y = grid.x_m[[0, -1]], grid.y_m[[0, -1]]
    points = np.array([*((a, b, grid.z_m) for a in x for b in y), grid.centre_m])
    half_path = sum(np.linalg.norm(points[:, None, None] - c, axis=-1)
                    for c in (block.tx_m, block.rx_m)) / 2
    return float(half_path.min()), float(half_path.max())


def reach_advice(block: PulseBlock, grid: MapGrid) -> str:
    """What would bring the grid into the profiles of a block.

    Parameters
    ----------
    block : PulseBlock
        Range profiles with phase centres.
    grid : MapGrid
        Where they are to be imaged.

    Returns
    -------
    str
        The mistakes that would explain it, likeliest first; empty where none does, or where the
        profiles reach the grid.
    """
    def within(candidate: PulseBlock) -> bool:
        near, far = distances(candidate, grid)
        start, stop = _profile(candidate)
        # Positions that shrink to a point explain nothing.
        moves = np.ptp(candidate.phase_centre_m, axis=0).max()
        return (start <= near and far <= stop
                and (block.n_pulses < 2 or moves > 0.1 * candidate.radar.wavelength_m))

    near, far = distances(block, grid)
    start, stop = _profile(block)
    if near < stop and far > start:
        return ''
    found = [h.advice for h in GEOMETRY if any(map(within, h.undo(block)))]
    return '; or '.join(found[:_MOST_NAMED])


def _profile(block: PulseBlock) -> tuple[float, float]:
    start = block.radar.range_start_m
    return start, start + block.n_samples * block.radar.sample_spacing_m
