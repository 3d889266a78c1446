# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Phases of channels against each other, by what all of them see of the scene.

Each channel's pulses make an image of their own. With right positions the images of all channels
have the same phase at each scatterer, whatever the scene. What they differ by is the error of the
channel: of its cable, or of the receiver's delay. That holds for clutter too, in which nothing
stands out.

Across the track the phases of channels tell the direction of a scatterer as well as errors: a
phase that grows in proportion to the place in the array turns the image, whatever the scene. What
no such line explains is error. There the phases are those with which the image of all channels is
sharpest.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ..geometry.grids import MapGrid
from ..signal.pulses import PulseBlock
from .coherence import CoherenceProbe, profiles_of, resolved
from .diagnose import LEAST, one_of
from .signals import LIKELY, Finding

_MOST_CHANNELS = 16
_ALONG = 0.25  # wavelengths that channels may lie beside the line of the track
_ALIKE = 0.6  # correlation of the images of two channels from which they show the same
_OFF_RAD = math.radians(30.0)
_DEAD = 1e-3  # of the power of the strongest channel
_FEWEST = 4  # channels across the track: a line explains two, and a third beside it any of three
_STARTS, _STEPS = 7, 60
_LINES = 721
_MOST_PIXELS = 4000  # the brightest ones
_MOST_OFF = 0.34  # of the channels, beside a line
_SHARPER = 1.15  # with the errors undone


def channel_phases(block: PulseBlock, grid: MapGrid, *, window: str = 'none') -> np.ndarray:
    """Phases of the channels' images less their common one.

    Parameters
    ----------
    block : PulseBlock
        Pulses of one aperture with phase centres, raw or compressed.
    grid : MapGrid
        Where the scene is.
    window : str
        Window of the range compression of raw pulses.

    Returns
    -------
    (C,) float64
        Radians, 0 where the scene tells none: one channel, channels that see different things,
        or fewer than four that lie across the track, where phases tell the place of the scene
        as well.
    """
    n = block.n_channels
    none = np.zeros(n)
    along = _along_the_track(block)
    places = None if along or n < _FEWEST else _on_a_line(block)
    if not 2 <= n <= _MOST_CHANNELS or not along and places is None:
        return none
    profiles = profiles_of(block, window)
    probe = CoherenceProbe(resolved(grid, block)).fixed(profiles)
    images = np.stack([probe.sums(one_of(profiles, c)) for c in range(n)]).astype(complex)
    power = np.sum(np.square(np.abs(images)), axis=1)
    if places is not None:
        return array_phases(images, places) if power.min() > _DEAD * power.max() else none
    alive = power > _DEAD * power.max()
    # the brightest pixels decide, of noise all are alike
    weight = np.sum(np.square(np.abs(images)), axis=0)
    products = (images * weight) @ images.conj().T
    norms = np.sqrt(np.abs(np.diag(products)))
    alike = np.abs(products) / np.maximum(norms[:, None] * norms, 1e-300)
    if np.count_nonzero(alive) < 2 or alike[np.ix_(alive, alive)].min() < _ALIKE:
        return none
    # phases that explain all products at once, whichever channel is off
    _, vectors = np.linalg.eigh((products / np.maximum(norms[:, None] * norms, 1e-300))
                                [np.ix_(alive, alive)])
    turns = vectors[:, -1]
    common = turns[np.argmax([np.sum(np.abs(np.angle(turns * t.conj())) < _OFF_RAD)
                              for t in turns])]
    phases = none.copy()
    phases[alive] = np.angle(turns * common.conj())
    return phases


def phase_findings(block: PulseBlock, grid: MapGrid, *, window: str = 'none'
                   ) -> tuple[list[Finding], PulseBlock]:
    """Whether phases of channels are off, and the block with equal ones.

    Parameters
    ----------
    block, grid, window
        As `channel_phases` takes them.

    Returns
    -------
    list of Finding
        At most one.
    PulseBlock
        To be examined further.
    """
    phases = channel_phases(block, grid, window=window)
    off = np.abs(phases) > _OFF_RAD
    turns = np.exp(-1j * phases)[:, None].astype(np.complex64)
    equal = dataclasses.replace(block, samples=block.samples * turns)
    along = _along_the_track(block)
    if not off.any() or not along and not _focuses(equal, grid, window):
        return [], block
    listed = ', '.join(f'{c} by {math.degrees(phases[c]):+.0f} degrees'
                       for c in np.flatnonzero(off))
    finding = Finding(
        'phases of channels', f'the images of the channels differ in phase: channel {listed}',
        'measure the errors of the channels with `sar-imaging calibrate`, and give them to '
        'range_compression as calibration_file; or correct the phase centres of the channels',
        'phase centres that are wrong, with which images of the channels would differ' if along
        else 'a line over the places of the channels, which the direction of the scene explains',
        LIKELY)
    return [finding], equal


def _focuses(block: PulseBlock, grid: MapGrid, window: str) -> bool:
    """Whether phases mean anything: without focus they do not."""
    probe = CoherenceProbe(resolved(grid, block))
    return probe(profiles_of(block, window)).contrast > LEAST


def _along_the_track(block: PulseBlock) -> bool:
    """Whether the track resolves what phases of channels along it would mean."""
    centres = block.phase_centre_m
    track = centres - centres.mean(axis=0)
    direction = np.linalg.svd(track, full_matrices=False)[2][0]
    places = np.add(*block.centres_m)[0] / 2
    places = places - places.mean(axis=0)
    beside = places - np.outer(places @ direction, direction)
    along = np.ptp(track @ direction)
    return bool(np.linalg.norm(beside, axis=1).max() < _ALONG * block.radar.wavelength_m
                and np.ptp(places @ direction) < along)


def _on_a_line(block: PulseBlock) -> np.ndarray | None:
    """(C,) places of the channels along their line, metres; None where they lie on none."""
    places = np.add(*block.centres_m)[0] / 2
    places = places - places.mean(axis=0)
    direction = np.linalg.svd(places, full_matrices=False)[2][0]
    beside = places - np.outer(places @ direction, direction)
    if np.linalg.norm(beside, axis=1).max() > _ALONG * block.radar.wavelength_m:
        return None
    along = places @ direction
    return along if np.ptp(along) > 0 else None


def array_phases(images: np.ndarray, places_m: np.ndarray) -> np.ndarray:
    """Phases of channels besides a line over their places.

    Parameters
    ----------
    images : (C, K) complex128
        Images of each channel alone, at the same pixels.
    places_m : (C,) float64
        Along the array, metres.

    Returns
    -------
    (C,) float64
        Radians; 0 where undoing them makes the image no sharper.
    """
    power = np.square(np.abs(images)).sum(axis=0)
    images = images[:, np.argsort(-power)[:_MOST_PIXELS]]
    best = max(_ascended(images, _starts(len(images))),
               key=lambda turns: _sharpness(images, turns))
    phases = _besides_line(np.angle(best), places_m)
    if np.mean(np.abs(phases) > _OFF_RAD) > _MOST_OFF:
        return np.zeros(len(images))  # there is no line
    gain = _sharpness(images, best) / _sharpness(images, best * np.exp(-1j * phases))
    return phases if gain > _SHARPER else np.zeros(len(images))


def _starts(n: int) -> np.ndarray:
    """(S, C) turns from which the sharpest image is looked for: as they are, and at random."""
    rng = np.random.default_rng(0)
    return np.exp(2j * np.pi * np.vstack([np.zeros(n), rng.random((_STARTS - 1, n))]))


def _ascended(images: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """(S, C) turns after steps that each make the image of (C, K) sharper.

    The sharpness grows with the sum over the pixels of ``|S|^2 Re(t_c* f_c S*)``, S being the
    image; the turn t_c that makes it largest is that of ``f_c |S|^2 S*``.
    """
    for _ in range(_STEPS):
        image = _turned(images, turns)
        turns = np.einsum('ck,sk->sc', images, np.square(np.abs(image)) * image.conj())
        turns = turns / np.maximum(np.abs(turns), 1e-300)
    return turns


def _turned(images: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """(..., K) images of all channels, turned (..., C).

    By einsum, which has no threads: those of BLAS would wait for each other, in a loop, at each
    of hundreds of small products, and two cores took seconds for what one does in 0.1 s.
    """
    return np.einsum('...c,ck->...k', turns.conj(), images)


def _sharpness(images: np.ndarray, turns: np.ndarray) -> float:
    """Mean square of the intensity over its squared mean without coherence."""
    image = _turned(images, turns)
    return float(np.mean(np.abs(image) ** 4)
                 / max(np.mean(np.square(np.abs(images)).sum(axis=0)) ** 2, 1e-300))


def _besides_line(phases: np.ndarray, places_m: np.ndarray) -> np.ndarray:
    """Phases (C,) less the line on which most of them lie, radians from -pi to pi."""
    order = np.sort(places_m)
    pitch = np.min(np.diff(order)[np.diff(order) > 1e-3 * np.ptp(order)])
    slopes = np.linspace(-np.pi, np.pi, _LINES) / pitch
    turned = np.exp(1j * (phases - slopes[:, None] * (places_m - places_m.mean())))
    common = turned.sum(axis=1, keepdims=True)
    for _ in range(3):  # the mean of those that are on the line
        rest = np.angle(turned * common.conj())
        on = np.abs(rest) < _OFF_RAD
        common = np.where(on.any(axis=1, keepdims=True),
                          np.sum(turned * on, axis=1, keepdims=True), common)
    rest = np.angle(turned * common.conj())
    score = np.where(on, np.cos(rest), 0.0).sum(axis=1)
    return rest[np.argmax(score)]
