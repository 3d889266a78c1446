"""Raw chirps that another slope compresses better than the one that is given."""

from __future__ import annotations

import dataclasses

import numpy as np

from ...signal.pulses import PulseBlock
from ...signal.radar import Waveform
from ...signal.range_compression import RangeCompressor
from ..hypotheses import with_slope, wrong_slope
from .finding import Finding

_MOST_PULSES = 64
_FACTORS = np.linspace(0.7, 1.45, 61)  # fine enough for time-bandwidth products of some hundreds
_FINER = (3, 9)
_BETTER = 1.25  # times the concentration with the slope as it is given


def concentration(block: PulseBlock) -> float:
    """How much of the energy of each profile lies in few range bins; 1 where in all alike."""
    profiles = RangeCompressor.for_block(block)(block).samples
    power = np.square(np.abs(profiles), dtype=float)
    return float(np.mean(np.square(power)) / max(np.mean(power)**2, 1e-300))


def slope_findings(block: PulseBlock) -> list[Finding]:
    """Find whether another slope of the chirp compresses the pulses better.

    A wrong slope leaves a quadratic phase over the band and smears each echo by the error of the
    pulse length. This tells chirps that are compressed by a filter (`Waveform.LFM`). Those that
    were dechirped in the radar keep their sharpness, and their ranges are wrong instead.

    Parameters
    ----------
    block : PulseBlock
        Raw; positions are not needed.

    Returns
    -------
    list of Finding
        At most one.

    Examples
    --------
    >>> import dataclasses
    >>> from sar_imaging import concatenate
    >>> from sar_imaging.diagnosis.signals import slope_findings
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['spotlight']().blocks()))
    >>> slope_findings(block)
    []
    >>> slope = block.radar.chirp_rate_hz_per_s
    >>> radar = dataclasses.replace(block.radar, chirp_rate_hz_per_s=-slope)
    >>> [finding.fault for finding in slope_findings(dataclasses.replace(block, radar=radar))]
    []
    """
    radar = block.radar
    if block.compressed or radar.waveform != Waveform.LFM or not radar.chirp_rate_hz_per_s:
        return []
    some = block.select(slice(None, None, -(-block.n_pulses // _MOST_PULSES)))
    some = dataclasses.replace(
        some, samples=some.samples[:, :1], tx_m=None, rx_m=None)

    def sharp(factor: float) -> float:
        try:
            return concentration(with_slope(some, factor))
        except ValueError:  # no such chirp
            return 0.0

    best, step = max(_FACTORS, key=sharp), float(_FACTORS[1] - _FACTORS[0])
    for finer in _FINER:
        best = max((best + step / finer * k for k in range(-2, 3)), key=sharp)
    gain = sharp(best) / max(sharp(1.0), 1e-300)
    if gain < _BETTER:
        return []
    mistake = wrong_slope(float(best), radar)
    return [Finding(mistake.name, f'with {best:.3g} times the slope the energy of each profile is '
                    f'{gain:.1f} times as concentrated', mistake.advice,
                    'the slope that is given, and others from 0.7 to 1.45 times it',
                    sizes=mistake.sizes)]
