"""An echo that stays while the platform moves: antennas that couple, or the platform itself."""

from __future__ import annotations

import math

import numpy as np

from ...signal.pulses import PulseBlock
from ...signal.range_compression import RangeCompressor
from .finding import Finding

_FEWEST = 32
_STILL = 10.0  # power of what stays over that of what changes, in the same range bin
_STRONG = 1.0  # power of what stays over the strongest that changes
_AS_STRONG = 0.8  # of the largest power
_MOVED = 4.0  # wavelengths that the platform has to move
_MOST_PULSES = 512


def coupling_findings(block: PulseBlock) -> list[Finding]:
    """Find an echo that does not move with the platform and is stronger than the scene.

    Parameters
    ----------
    block : PulseBlock
        Raw or compressed, of a platform that moves; with positions, it is checked that it does.

    Returns
    -------
    list of Finding
        At most one.

    Examples
    --------
    >>> import dataclasses
    >>> from sar_imaging import concatenate
    >>> from sar_imaging.diagnosis.signals import coupling_findings
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['spotlight']().blocks()))
    >>> coupling_findings(block)
    []
    >>> samples = block.samples.copy()
    >>> samples[..., 20] += 500.0  # from antenna to antenna
    >>> coupled = dataclasses.replace(block, samples=samples)
    >>> [finding.fault for finding in coupling_findings(coupled)]
    ['coupling']
    """
    if block.n_pulses < _FEWEST:
        return []
    if block.has_positions:
        moved = np.ptp(block.phase_centre_m, axis=0).max()
        if moved < _MOVED * block.radar.wavelength_m:
            return []
    step = -(-block.n_pulses // _MOST_PULSES)
    some = block.select(slice(None, None, step))
    compressor = RangeCompressor.for_block(some)
    profiles = compressor(some).samples
    stays = np.square(np.abs(profiles.mean(axis=0)))
    changes = np.mean(np.square(np.abs(profiles), dtype=float), axis=0) - stays
    ratio = np.where(stays > _STILL * changes, stays, 0.0).max(axis=0)
    # profiles of ramps are periodic: the nearest of places that are as strong
    at = int(np.flatnonzero(ratio >= _AS_STRONG * ratio.max())[0])
    strongest = float(changes.max())
    if ratio[at] <= _STRONG * strongest:
        return []
    radar = compressor.output_radar
    return [Finding('coupling', (
        f'what stays at {radar.range_start_m + at * radar.sample_spacing_m:.2f} m while the '
        f'platform moves is {10 * math.log10(ratio[at] / max(strongest, 1e-30)):.0f} dB above '
        'the strongest echo that changes'),
        'shield the antennas from each other; meanwhile subtract what stays: parameter '
        'background_s of range_compression',
        'echoes of the scene, which change while the platform moves')]
