"""Find implausible positions and times without an image: no platform has such a track."""

from __future__ import annotations

import numpy as np

from ..signal.pulses import PulseBlock

_FASTEST_M_PER_S = 15e3  # above what orbits the Earth
_FEWEST = 16  # pulses that tell a pattern
_REGULAR = 0.15  # deviation of steps from their neighbours


def track_doubts(block: PulseBlock) -> tuple[str, ...]:
    """Find what is odd about positions and times, each with what it probably means.

    Parameters
    ----------
    block : PulseBlock
        Pulses of one aperture with phase centres, in order.

    Returns
    -------
    tuple of str
        Empty for tracks that look right.

    Examples
    --------
    >>> import dataclasses
    >>> from sar_imaging import concatenate
    >>> from sar_imaging.diagnosis import track_doubts
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['psf']().blocks()))
    >>> track_doubts(block)
    ()
    >>> wrong = dataclasses.replace(block, tx_m=1000 * block.tx_m, rx_m=1000 * block.rx_m)
    >>> for doubt in track_doubts(wrong):
    ...     print(doubt)
    the phase centres move at 200 km/s, faster than a satellite; are they in millimetres, ...
    """
    if not block.has_positions or block.n_pulses < 2:
        return ()
    return tuple(filter(None, (_at_rest(block), _times(block), _speed(block), _degrees(block),
                               _left_out(block))))


def at_rest(block: PulseBlock) -> bool:
    """Whether all pulses and channels have the same phase centre; an array needs no motion."""
    return not (np.ptp(block.phase_centre_m, axis=0).any()
                or np.ptp(block.tx_m[0] + block.rx_m[0], axis=0).any())


def _at_rest(block: PulseBlock) -> str:
    if not at_rest(block):
        return ''
    return (f'the phase centres of all {block.n_pulses} pulses are the same: there is no '
            'synthetic aperture; interpolate the poses at the times of the pulses, or give the '
            'lever arm of an antenna that turns around the point that the poses are of')


def _times(block: PulseBlock) -> str:
    if np.ptp(block.stamp_ns) or not np.ptp(block.counter):
        return ''
    return (f'all {block.n_pulses} pulses have the time {block.stamp_ns[0]} ns; whole seconds '
            'are too coarse: give every pulse its own time in nanoseconds')


def _steps(block: PulseBlock) -> tuple[np.ndarray, np.ndarray]:
    """Distance and time from pulse to pulse, metres and seconds."""
    return (np.linalg.norm(np.diff(block.phase_centre_m, axis=0), axis=1),
            np.diff(block.stamp_ns) * 1e-9)


def _speed(block: PulseBlock) -> str:
    distance, seconds = _steps(block)
    if seconds.sum() <= 0:
        return ''
    speed = float(distance.sum() / seconds.sum())
    if speed <= _FASTEST_M_PER_S:
        return ''
    return (f'the phase centres move at {speed / 1e3:.4g} km/s, faster than a satellite; are '
            'they in millimetres, or the times not in nanoseconds?')


def _degrees(block: PulseBlock) -> str:
    centres = block.phase_centre_m
    extent = float(np.ptp(centres[:, :2], axis=0).max())
    largest = np.abs(centres[:, :2]).max(axis=0)
    small = 0 < extent < 0.25 * block.radar.wavelength_m
    if (block.n_pulses < _FEWEST or not small or largest.max() < 0.5 or largest.max() > 180
            or extent > 1e-3 * largest.max()):
        return ''
    return (f'the phase centres move by {extent:.2g} in x and y, less than a wavelength, around '
            f'({centres[0, 0]:.5g}, {centres[0, 1]:.5g}); are these degrees of longitude and '
            'latitude? Convert them to metres in a local frame (east, north, up)')


def _left_out(block: PulseBlock) -> str:
    """Positions that advance by two pulses, or stand still for one, at regular intervals."""
    distance, seconds = _steps(block)
    if block.n_pulses < _FEWEST or np.ptp(seconds) > 0.3 * np.median(seconds):
        return ''
    around = median_around(distance)
    ratio = distance / np.where(around > 0, around, 1.0)
    still = distance == 0
    still[0] = still[-1] = False
    double = np.abs(ratio - 2) < 2 * _REGULAR
    for odd, what in ((still, 'are those of the pulse before: positions were repeated'),
                      (double, 'advance by two pulses at once: positions were left out')):
        others = np.abs(ratio[~(odd | double)] - 1) < _REGULAR
        at = np.flatnonzero(odd)
        if len(at) < 3 or len(at) > 0.4 * len(odd) or others.mean() < 0.8:
            continue
        gaps = np.diff(at)
        if np.mean(np.abs(gaps - np.median(gaps)) <= 1) > 0.8:
            n = int(np.median(gaps))
            return (f'{len(at)} of {len(odd)} positions, '
                    f'{f"one in {n}" if n > 1 else "one after another"}, {what}; '
                    'pulses and positions drift apart: give every pulse its own position')
    return ''


def median_around(values: np.ndarray, half: int = 4) -> np.ndarray:
    """(N,) medians of values (N,) and of `half` neighbours on each side, ends repeated."""
    padded = np.pad(values, half, mode='edge')
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=-1)
