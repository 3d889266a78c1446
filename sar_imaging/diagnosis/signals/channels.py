"""Faults of channels against each other: dead, equal, of unequal gain."""

from __future__ import annotations

import numpy as np

from ...signal.pulses import PulseBlock
from .finding import LIKELY, Finding

_DEAD_DB = -25.0
_UNEQUAL_DB = 2.0
_EQUAL = 0.9999  # correlation of the samples of two channels


def channel_findings(block: PulseBlock) -> list[Finding]:
    """Find dead, equal and unbalanced channels.

    Parameters
    ----------
    block : PulseBlock
        Raw or compressed.

    Returns
    -------
    list of Finding

    Examples
    --------
    >>> import dataclasses
    >>> from sar_imaging import concatenate
    >>> from sar_imaging.diagnosis.signals import channel_findings
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['psf_raw']().blocks()))
    >>> samples = block.samples.copy()
    >>> samples[:, 2] = 0.0
    >>> for finding in channel_findings(dataclasses.replace(block, samples=samples)):
    ...     print(finding.evidence)
    channel 2 is 299 dB or more below the others
    channels 0 and 1, 1 and 3, 3 and 4 hold the same samples
    """
    if block.n_channels < 2 or not block.n_pulses:
        return []
    step = max(1, block.n_pulses // 256)
    samples = block.samples[::step] - block.samples.mean(axis=0, keepdims=True)
    power = np.mean(np.square(np.abs(samples), dtype=float), axis=(0, 2))
    dead = power <= 10 ** (_DEAD_DB / 10) * power.max()
    level_db = 10 * np.log10(np.maximum(power, 1e-30) / max(np.median(power[~dead]), 1e-30))
    found = []
    if dead.any():
        found.append(Finding('dead channel', (
            f'channel {_listed(dead)} is {-level_db[dead].max():.0f} dB or more below the others'),
            'check its antenna and receiver, or leave it out',
            'channels that see less of the scene'))
    unequal = ~dead & (np.abs(level_db) > _UNEQUAL_DB)
    if unequal.any():
        worst = float(level_db[unequal][np.abs(level_db[unequal]).argmax()])
        found.append(Finding('unbalanced channels', (
            f'channel {_listed(unequal)} differs from the median of the channels by '
            f'{worst:+.1f} dB and less'),
            'measure the errors of the channels with `sar-imaging calibrate`, and give them to '
            'range_compression as calibration_file',
            'antennas that see different parts of the scene', LIKELY))
    equal = _equal_pairs(samples, ~dead)
    if equal:
        found.append(Finding('channel twice', (
            'channels ' + ', '.join(f'{a} and {b}' for a, b in equal) + ' hold the same samples'),
            'check the order of axes with which the samples were loaded',
            'channels side by side, whose noise differs'))
    return found


def _equal_pairs(samples: np.ndarray, alive: np.ndarray) -> list[tuple[int, int]]:
    numbers = np.flatnonzero(alive)
    rows = samples[:, numbers].swapaxes(0, 1).reshape(len(numbers), -1)
    products = np.abs(rows.conj() @ rows.T)
    norms = np.sqrt(np.maximum(np.diag(products), 1e-30))
    alike = products > _EQUAL * norms[:, None] * norms
    return [(int(numbers[a]), int(numbers[b])) for a, b in zip(*np.nonzero(alike), strict=True)
            if a < b]


def _listed(chosen: np.ndarray) -> str:
    return ', '.join(map(str, np.flatnonzero(chosen)))
