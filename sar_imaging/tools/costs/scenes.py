"""Scenes of the experiments: maps and pulses of noise, small for a processor, larger for a device.

Their samples are noise, since no time depends on them.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters

_CARRIER_HZ, _OVERSAMPLING, _BEYOND = 10e9, 1.4, 160


@dataclasses.dataclass(frozen=True)
class Scene:
    """Map beside a straight track, and pulses of noise.

    Attributes
    ----------
    range_m : float
        From the middle of the track to that of the map, metres.
    n_x, n_y : int
        Pixels of the map.
    n_pulses : int
        Pulses.
    spacing_m : float
        Of the pixels; range resolution and aperture resolve 0.5 m.
    n_channels : int
        Channels, in one place.
    """

    range_m: float
    n_x: int
    n_y: int
    n_pulses: int
    spacing_m: float = 0.25
    n_channels: int = 1

    @property
    def grid(self) -> MapGrid:
        """The map."""
        return MapGrid((0.0, 0.0, 0.0), self.n_x, self.n_y, self.spacing_m)

    def block(self) -> PulseBlock:
        """The pulses, range profiles."""
        aperture = SPEED_OF_LIGHT / _CARRIER_HZ * self.range_m
        tx = np.zeros((self.n_pulses, self.n_channels, 3))
        tx[..., 0] = -self.range_m
        tx[..., 1] = np.linspace(-0.5, 0.5, self.n_pulses)[:, None] * aperture
        far = self.spacing_m * math.hypot(self.n_x, self.n_y) / 2
        rate = _OVERSAMPLING * SPEED_OF_LIGHT
        spacing = SPEED_OF_LIGHT / (2 * rate)
        n_samples = math.ceil(2 * far / spacing) + 2 * _BEYOND
        start = self.range_m - far - _BEYOND * spacing
        radar = RadarParameters(_CARRIER_HZ, SPEED_OF_LIGHT, rate, 2 * start / SPEED_OF_LIGHT)
        rng = np.random.default_rng(0)
        samples = rng.standard_normal((*tx.shape[:2], 2 * n_samples), np.float32)
        number = np.arange(self.n_pulses)
        return PulseBlock(radar, True, number, number, samples.view(np.complex64), tx, tx.copy())


@dataclasses.dataclass(frozen=True)
class Scenes:
    """Scenes by what is timed with them.

    Attributes
    ----------
    lines, points, polar : tuple of Scene
        Of exact images.
    afbp : tuple of (Scene, int)
        And the lengths of their sub-apertures.
    ffbp : tuple of Scene
        With each kernel; empty where that is not offered.
    transfers : tuple of int
        Bytes that are copied to a device and back.
    varied : bool
        Segments of lines and beams are also changed, number by number.
    """

    lines: tuple[Scene, ...]
    points: tuple[Scene, ...]
    polar: tuple[Scene, ...]
    afbp: tuple[tuple[Scene, int], ...]
    ffbp: tuple[Scene, ...] = ()
    transfers: tuple[int, ...] = ()
    varied: bool = True


#: Half a minute on one thread.
PROCESSOR = Scenes(
    lines=(Scene(1e4, 512, 512, 48), Scene(1e4, 2048, 8, 64), Scene(1e4, 2048, 8, 64, 0.06),
           Scene(1e4, 48, 48, 4)),
    points=(Scene(1e3, 256, 256, 48), Scene(1e3, 1024, 8, 64)),
    polar=(Scene(1e3, 384, 384, 192), Scene(1e3, 96, 96, 192)),
    afbp=((Scene(1e3, 64, 1024, 1024, n_channels=4), 96), (Scene(1e3, 1024, 1024, 1024), 24),
          (Scene(3e3, 2048, 2048, 2048), 128)),
    ffbp=(Scene(1e3, 256, 256, 512), Scene(1e3, 768, 768, 32)))
#: Enough work that a device is busy: images of 1 to 100 ms.
DEVICE = Scenes(
    lines=(Scene(1e4, 2048, 2048, 256), Scene(1e4, 8192, 32, 1024),
           Scene(1e4, 8192, 32, 1024, 0.06), Scene(1e4, 48, 48, 4)),
    points=(Scene(1e3, 1024, 1024, 256), Scene(1e3, 4096, 32, 512)),
    polar=(Scene(1e3, 1536, 1536, 768), Scene(1e3, 384, 384, 768)),
    afbp=((Scene(1e3, 64, 1024, 1024, n_channels=4), 96), (Scene(1e3, 1024, 1024, 1024), 24),
          (Scene(3e3, 4096, 4096, 4096), 128)),
    transfers=(1 << 16, 1 << 26))
