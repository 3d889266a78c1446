"""Phases of channels against each other, by what all of them see of the scene.

Each channel's pulses make an image of their own. With right positions the images of all channels
have the same phase at each scatterer, whatever the scene. What they differ by is the error of the
channel: of its cable, or of the receiver's delay.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ..geometry.grids import MapGrid
from ..signal.pulses import PulseBlock
from ..signal.range_compression import RangeCompressor
from .array_phases import FEWEST, array_phases
from .coherence import BUDGET, OVERSAMPLING, CoherenceProbe, resolved
from .signals import Finding

_TILE = 4
_MOST_CHANNELS = 16
_ALONG = 0.25  # wavelengths that channels may lie beside the line of the track
_ALIKE = 0.6  # correlation of the images of two channels from which they show the same
_OFF_RAD = math.radians(30.0)
_FOCUSED = 1.45  # contrast of an image whose phases mean anything
_DEAD = 1e-3  # of the power of the strongest channel


def channel_phases(block: PulseBlock, grid: MapGrid, *, window: str = 'none') -> np.ndarray:
    """Phases of the channels' images less their common one.

    Parameters
    ----------
    block : PulseBlock
        Pulses of one aperture with phase centres, raw or compressed.
    grid : MapGrid
        Where the scene is.
    window : str
        Of the range compression of raw pulses.

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
    places = None if along or n < FEWEST else _on_a_line(block)
    if not 2 <= n <= _MOST_CHANNELS or not along and places is None:
        return none
    window = 'none' if block.compressed else window
    profiles = RangeCompressor.for_block(block, window=window, oversampling=OVERSAMPLING)(block)
    probe = CoherenceProbe(resolved(grid, block), BUDGET, _TILE).fixed(profiles)
    images = np.stack([probe.sums(_channel(profiles, c)) for c in range(n)]).astype(complex)
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
    if not off.any() or not _focuses(equal, grid, window):
        return [], block
    listed = ', '.join(f'{c} by {math.degrees(phases[c]):+.0f} degrees'
                       for c in np.flatnonzero(off))
    finding = Finding(
        'phases of channels', f'the images of the channels differ in phase: channel {listed}',
        'measure the errors of the channels with `sar-imaging calibrate`, and give them to '
        'range_compression as calibration_file; or correct the phase centres of the channels')
    return [finding], equal


def _focuses(block: PulseBlock, grid: MapGrid, window: str) -> bool:
    """Whether phases mean anything: without focus they do not."""
    window = 'none' if block.compressed else window
    profiles = RangeCompressor.for_block(block, window=window, oversampling=OVERSAMPLING)(block)
    return CoherenceProbe(resolved(grid, block), BUDGET, _TILE)(profiles).contrast > _FOCUSED


def _along_the_track(block: PulseBlock) -> bool:
    """Whether the track resolves what phases of channels along it would mean."""
    centres = block.phase_centre_m
    track = centres - centres.mean(axis=0)
    direction = np.linalg.svd(track, full_matrices=False)[2][0]
    places = (block.tx_m + block.rx_m)[0] / 2
    places = places - places.mean(axis=0)
    beside = places - np.outer(places @ direction, direction)
    along = np.ptp(track @ direction)
    return bool(np.linalg.norm(beside, axis=1).max() < _ALONG * block.radar.wavelength_m
                and np.ptp(places @ direction) < along)


def _on_a_line(block: PulseBlock) -> np.ndarray | None:
    """(C,) places of the channels along their line, metres; None where they lie on none."""
    places = (block.tx_m + block.rx_m)[0] / 2
    places = places - places.mean(axis=0)
    direction = np.linalg.svd(places, full_matrices=False)[2][0]
    beside = places - np.outer(places @ direction, direction)
    if np.linalg.norm(beside, axis=1).max() > _ALONG * block.radar.wavelength_m:
        return None
    along = places @ direction
    return along if np.ptp(along) > 0 else None


def _channel(block: PulseBlock, number: int) -> PulseBlock:
    at = slice(number, number + 1)
    return dataclasses.replace(block, samples=block.samples[:, at], tx_m=block.tx_m[:, at],
                               rx_m=block.rx_m[:, at])
