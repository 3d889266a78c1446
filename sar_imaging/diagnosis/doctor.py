# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Tell what is wrong with a recording: faults of signals, and mistakes that spoil the image."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

from ..geometry.grids import MapGrid
from ..signal.background import subtract_background
from ..signal.pulses import PulseBlock
from ..signal.range_compression import RangeCompressor
from .channel_phases import phase_findings
from .coherence import Coherence, CoherenceProbe, gain_of, profiles_of, resolved
from .diagnose import BETTER, Diagnosis, diagnose, one_channel
from .hypotheses import TRANSMITTERS, distances, reach_advice, with_offset
from .lever_arm import LeverArm, course, find_lever_arm, with_arm
from .signals import (
    CERTAIN,
    LIKELY,
    ONE_OF_SEVERAL,
    Finding,
    channel_findings,
    coupling_findings,
    sample_findings,
    slope_findings,
    timing_findings,
)
from .track import jump_findings

_SEEN = 0.8  # of a scene, that profiles are to hold
_SIDE = 32  # pixels along each side, and pulses, that tell it
_CLOCK = 'clock offset'
_CERTAIN = 10.0  # times the agreement: what is undone then is no lever arm
_NOT_LOOKED_AT = 'without positions and a scene the image is not looked at'
# Faults with which nothing can focus, nor profiles be trusted.
_WITHOUT_IMAGE = {'I and Q alike', 'magnitudes only', 'order of I and Q', 'real samples'}


@dataclasses.dataclass(frozen=True)
class Examination:
    """What was found in the pulses of an aperture.

    Parameters
    ----------
    findings : tuple of Finding
        Faults, those of the samples first; empty where none was found.
    diagnosis : Diagnosis or None
        How the image focuses; None without positions or grid, or where no pulse reaches it.
    untold : tuple of str
        What this recording cannot tell, so that something may be wrong that nothing shows.

    Examples
    --------
    >>> from sar_imaging.diagnosis import Examination
    >>> from sar_imaging.diagnosis.signals import Finding
    >>> found = Finding('clipping', '3 % of the samples lie at the end of the scale',
    ...                 'lower the gain of the receiver')
    >>> examined = Examination(findings=(found,))
    >>> for finding in examined.findings:
    ...     print(finding)
    clipping: 3 % of the samples lie at the end of the scale. Lower the gain of the receiver.
    """

    findings: tuple[Finding, ...]
    diagnosis: Diagnosis | None = None
    untold: tuple[str, ...] = ()


def examine(block: PulseBlock, grid: MapGrid | None = None, *, window: str = 'none',
            attitude: Rotation | None = None) -> Examination:
    """Look for faults of samples, times and channels, and for what keeps the image from focusing.

    Parameters
    ----------
    block : PulseBlock
        Pulses of one aperture in the order sent, raw where they are to be had.
    grid : MapGrid, optional
        Where the scene is; without it, or without positions, the image is not looked at.
    window : str
        Window of the range compression of raw pulses.
    attitude : scipy.spatial.transform.Rotation, optional
        Attitude of the platform at each pulse, from its own frame into that of the phase centres.
        Without it lever arms are looked for where the track turns, as if the platform followed it.

    Returns
    -------
    Examination

    Examples
    --------
    >>> import dataclasses
    >>> from sar_imaging import concatenate
    >>> from sar_imaging.diagnosis import examine
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['psf_raw']().blocks()))
    >>> samples = block.samples.copy()
    >>> samples[:, 3] = 0.0  # a receiver that is not connected
    >>> for finding in examine(dataclasses.replace(block, samples=samples)).findings:
    ...     print(finding.fault)
    dead channel
    channel twice
    """
    found = [*sample_findings(block), *timing_findings(block), *channel_findings(block)]
    if any(finding.fault == 'no signal' for finding in found):
        return Examination(tuple(found))
    without_image = any(finding.fault in _WITHOUT_IMAGE for finding in found)
    if not without_image:
        found += slope_findings(block) + coupling_findings(block)
    if grid is None or not block.has_positions:
        return Examination(tuple(found), untold=(_NOT_LOOKED_AT,))
    seen, outside = _outside(block, grid)
    found += outside
    if without_image or not seen:
        return Examination(tuple(found))
    # what is heard all the time hides what is to be focused
    coupled = any(finding.fault == 'coupling' for finding in found)
    clean = subtract_background(block) if coupled else block
    off, diagnosis = _focused(clean, grid, window)
    jumped = jump_findings(clean)
    arm, better = (None, 0.0) if jumped else _lever_arm(clean, grid, window, attitude, diagnosis)
    found += off + jumped + ([] if jumped else _explanations(
        diagnosis, arm, better,
        'platform' if attitude is not None else 'track, x along it and z up'))
    return Examination(tuple(found), diagnosis, _untold(diagnosis, bool(off or jumped or arm)))


def _explanations(diagnosis: Diagnosis, arm: LeverArm | None, better: float, frame: str
                  ) -> list[Finding]:
    """A mistake, a lever arm that does so many times as well, or both where they are alike.

    On gentle curves an arm along the track moves the antenna as a clock that is off does, and on
    an arc an arm through its middle makes up for conjugated samples.
    """
    if arm is None or not diagnosis.mistake:
        return ([arm.finding(frame=frame)] if arm is not None else
                [_mistake(diagnosis)] if diagnosis.mistake else [])
    clock = diagnosis.mistake == _CLOCK
    if better > BETTER and (clock or arm.corrected.contrast > diagnosis.corrected):
        return [arm.finding(frame=frame)]
    # what was searched for among many values explains more by chance, but a ruler tells an arm
    both = [_mistake(diagnosis, ('lever arm',)), arm.finding(alone=False, frame=frame)]
    return both[::-1] if clock else both


def _mistake(diagnosis: Diagnosis, others: tuple[str, ...] = ()) -> Finding:
    """What a diagnosis says, as a finding; `others` explain it as well."""
    alike = (*diagnosis.alternatives, *others)
    advice = diagnosis.advice + (
        f'; or correct {" or ".join(alike)}, which explains it as well, not both' if alike else '')
    sure = (ONE_OF_SEVERAL if alike else
            CERTAIN if diagnosis.gain > _CERTAIN and diagnosis.corrected > diagnosis.coherence
            else LIKELY)
    return Finding(diagnosis.mistake, diagnosis.evidence, advice,
                   f'the data as they are and {diagnosis.n_tried} mistakes that were tried', sure,
                   diagnosis.sizes)


def _untold(diagnosis: Diagnosis, found: bool) -> tuple[str, ...]:
    """What the image of a recording does not tell."""
    if found or diagnosis.tells:
        return ()
    if diagnosis.doubtful:
        return (f'the image is sharper with {" or ".join(diagnosis.doubtful)}, but in focus as it '
                'is, too: compare it with a map or with a scatterer of known place',)
    return (diagnosis.advice or 'nothing stands out from noise',)


def _focused(block: PulseBlock, grid: MapGrid, window: str) -> tuple[list[Finding], Diagnosis]:
    """What is said of phases of channels, and of the image with equal ones.

    Phases also follow from what is wrong with the places of channels. Where none are left without
    another mistake, that is the one cause; where two are needed, what is sharper without both.
    """
    def coherence(cured: PulseBlock) -> Coherence:
        return CoherenceProbe(resolved(grid, cured))(profiles_of(cured, window))

    off, equal = phase_findings(block, grid, window=window)
    diagnosis = diagnose(equal, grid, window=window, thorough=True)
    as_they_are = diagnose(block, grid, window=window, thorough=True) if off else diagnosis
    if off and as_they_are.undo:
        right = max(as_they_are.undo(block), key=lambda cured: coherence(cured).contrast)
        left, cured = phase_findings(right, grid, window=window)
        more = 1.0 if diagnosis.mistake else BETTER  # a second cause has to gain as the first
        if (not left or diagnosis.mistake == as_they_are.mistake
                or coherence(cured).contrast > more * diagnosis.corrected):
            return left, as_they_are
    ordered = TRANSMITTERS.undo(block) if off else []
    if ordered:
        right = max(ordered, key=lambda cured: coherence(cured).spread)
        gain = gain_of(coherence(right), coherence(block))
        if gain > BETTER and not phase_findings(right, grid, window=window)[0]:
            off = [_order_of_transmitters(gain), *off]
    return off, diagnosis


def _order_of_transmitters(gain: float) -> Finding:
    """What is said where phases of channels vanish in another order, which no height explains."""
    return Finding(TRANSMITTERS.name, (
        'in another order the images of the channels do not differ in phase, and pulses agree '
        f'{gain:.3g} times as well'), TRANSMITTERS.advice + '; or correct the phases of channels, '
        'which explain it as well, not both',
        'phases of channels, and a line over the places of the channels', ONE_OF_SEVERAL)


def _lever_arm(block: PulseBlock, grid: MapGrid, window: str, attitude: Rotation | None,
               diagnosis: Diagnosis) -> tuple[LeverArm | None, float]:
    """A lever arm, and how many times as well pulses agree with it as without what else was found.

    None unless they agree about as well.
    """
    clock = diagnosis.mistake == _CLOCK
    if attitude is None:
        attitude = course(block)
    # what was searched for, as a rate of the clock, may be what an arm looks like
    if attitude is None or diagnosis.gain > _CERTAIN and not diagnosis.sizes:
        return None, 0.0
    arm = find_lever_arm(block, attitude, grid, window=window)
    if arm is None or not arm.found:
        return None, 0.0
    better = (_over_offset(block, grid, window, with_arm(block, attitude, arm.arm_m),
                           diagnosis.sizes[0]) if clock else arm.gain / diagnosis.gain)
    return (arm, better) if BETTER * better > 1 else (None, 0.0)


def _over_offset(block: PulseBlock, grid: MapGrid, window: str, armed: PulseBlock,
                 offset_s: float) -> float:
    """How much more stands out with an arm than with an offset of the clock, of the same pulses.

    Those that an offset leaves agree over wider parts of the scene than all.
    """
    later = with_offset(block, offset_s)
    kept = np.isin(block.counter, later.counter)
    probe = CoherenceProbe(resolved(grid, block))
    arm, offset = (probe(profiles_of(one_channel(b), window)).spread
                   for b in (armed.select(kept), later))
    return arm / max(offset, 1.0)


def _seen(block: PulseBlock, grid: MapGrid, start_m: float, stop_m: float) -> float:
    """Share of the pixels, over the pulses, whose half path lies within profiles."""
    places = grid.points()[::-(-grid.n_y // _SIDE), ::-(-grid.n_x // _SIDE)].reshape(-1, 3)
    some = block.select(slice(None, None, -(-block.n_pulses // _SIDE)))
    half_path = sum(np.linalg.norm(places[:, None, None] - c, axis=-1)
                    for c in (some.tx_m, some.rx_m)) / 2
    return float(np.mean((half_path >= start_m) & (half_path <= stop_m)))


def _outside(block: PulseBlock, grid: MapGrid) -> tuple[float, list[Finding]]:
    """Share of the scene that profiles hold, and what is to be said of it."""
    first = block.select(slice(0, 1))
    compressor = RangeCompressor.for_block(first)
    radar = compressor.output_radar
    start = radar.range_start_m
    stop = start + compressor.n_output * radar.sample_spacing_m
    near, far = distances(block, grid)
    seen = _seen(block, grid, start, stop)
    if seen >= _SEEN:
        return seen, []
    profiles = dataclasses.replace(
        block, radar=radar, compressed=True,
        samples=np.zeros((*block.samples.shape[:2], compressor.n_output), np.complex64))
    return seen, [Finding('scene outside the window', (
        f'profiles hold {start:.4g} to {stop:.4g} m, the scene lies {near:.4g} to {far:.4g} m '
        f'from the radar: {seen:.0%} of its pixels are inside'),
        reach_advice(profiles, grid) or 'check the places of scene and radar, the delay of the '
        'first sample, and the frame of the positions; or record a longer window')]
