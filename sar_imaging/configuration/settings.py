# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of radar, platform and imaging, one immutable dataclass each."""

from __future__ import annotations

import dataclasses
import math
import os

import numpy as np

from ..geometry.grids import MapGrid, VolumeGrid
from ..memory import available_bytes
from ..signal.radar import RadarParameters

MODES = ('image', 'subapertures', 'volume')
# Pixel-pulses per second and core, below what docs/benchmarks.md shows for any geometry.
ASSUMED_RATE_PER_CORE = 0.5e9


@dataclasses.dataclass(frozen=True)
class Acquisition:
    """What the radar delivers, and the straight track that it delivers it from.

    Parameters
    ----------
    radar : RadarParameters
        Radar parameters of the samples as they come.
    compressed : bool
        True when they are range profiles.
    n_samples, n_channels : int
        Samples of a pulse and channel; channels.
    prf_hz : float
        Pulses per second of each channel.
    centre_m : (3,) floats
        Mean phase centre in the middle of the aperture, imaging frame, metres.
    velocity_m_per_s : (3,) floats
        Velocity of the platform, imaging frame.
    channel_spacing_m : float
        Distance along the track between the receivers of neighbouring channels, metres.
    beamwidth_rad : float
        Illuminated angle along the track, radians; 0 where it is not known.

    Raises
    ------
    ValueError
        A number is not finite or not positive where it must be.

    Examples
    --------
    >>> from sar_imaging import RadarParameters
    >>> from sar_imaging.configuration import Acquisition
    >>> radar = RadarParameters(10e9, 300e6, 400e6, first_sample_delay_s=6e-7)
    >>> drone = Acquisition(radar, compressed=True, n_samples=256, n_channels=1, prf_hz=200.0,
    ...                     centre_m=(0.0, 0.0, 50.0), velocity_m_per_s=(0.0, 8.0, 0.0))
    >>> drone.track(3).round(3).tolist()
    [[0.0, -0.04, 50.0], [0.0, 0.0, 50.0], [0.0, 0.04, 50.0]]
    """

    radar: RadarParameters
    compressed: bool
    n_samples: int
    n_channels: int
    prf_hz: float
    centre_m: tuple[float, float, float]
    velocity_m_per_s: tuple[float, float, float]
    channel_spacing_m: float = 0.0
    beamwidth_rad: float = 0.0

    def __post_init__(self) -> None:
        for name in ('n_samples', 'n_channels'):
            if getattr(self, name) < 1:
                raise ValueError(f'{name}={getattr(self, name)}; expected at least 1')
        if not (math.isfinite(self.prf_hz) and self.prf_hz > 0):
            raise ValueError(f'prf_hz={self.prf_hz} must be positive and finite')
        for name in ('centre_m', 'velocity_m_per_s'):
            value = tuple(float(v) for v in getattr(self, name))
            object.__setattr__(self, name, value)
            if len(value) != 3 or not all(map(math.isfinite, value)):
                raise ValueError(f'{name}={value}; expected three finite numbers')
        if not 0.0 <= self.channel_spacing_m < math.inf:
            raise ValueError(f'channel_spacing_m={self.channel_spacing_m} must not be negative')
        if not 0.0 <= self.beamwidth_rad <= math.pi:
            raise ValueError(f'beamwidth_rad={self.beamwidth_rad}; expected 0 to pi (0 to 180 '
                             'degrees)')

    @property
    def speed_m_per_s(self) -> float:
        """Speed of the platform, metres per second."""
        return math.hypot(*self.velocity_m_per_s)

    def track(self, n_pulses: int) -> np.ndarray:
        """(n_pulses, 3) float64 mean phase centres of an aperture, metres."""
        time_s = (np.arange(n_pulses) - (n_pulses - 1) / 2) / self.prf_hz
        return np.asarray(self.centre_m) + time_s[:, None] * np.asarray(self.velocity_m_per_s)

    def receiver_offsets(self) -> np.ndarray:
        """(C, 3) float64 receivers relative to the transmitter in their middle, metres."""
        speed = self.speed_m_per_s
        along = np.asarray(self.velocity_m_per_s) / speed if speed else np.array([1.0, 0.0, 0.0])
        number = np.arange(self.n_channels) - (self.n_channels - 1) / 2
        return (self.channel_spacing_m * number)[:, None] * along


@dataclasses.dataclass(frozen=True)
class Imaging:
    """Settings of the nodes that decide about resolution, memory and time.

    Parameters
    ----------
    grid : MapGrid
        Pixels of the image; the lowest layer of a volume.
    pulses_per_aperture, pulses_per_block, reorder_window_pulses : int
        As the parameters of these names.
    window, range_filter : str
        Window and range filter of the range compression.
    oversampling, near_range, far_range, target_db : float
        Oversampling, near range, far range and target error of the range compression and the
        imager, metres and dB.
    queue_depth, worker_queue_size, max_message_elements, max_image_pixels : int
        Limits.
    worker_queue_megabytes : float
        Limit, too.
    mode : str
        ``'image'``, ``'subapertures'`` or ``'volume'``.
    method : str
        Imager of modes ``'image'`` and ``'volume'``: ``'exact'``, ``'afbp'`` or ``'auto'``.
    subaperture_target_db, subaperture_pulses, subaperture_sliding, subaperture_follow
        Of mode ``'subapertures'``; a length of 0 is the quickest.
    autofocus_track_error, autofocus_time_offset : float
        What autofocus of mode ``'image'`` looks for, metres and seconds; 0 for none.
    volume_height, volume_spacing : float
        Volume height and volume spacing of mode ``'volume'``: extent above the grid and distance
        of its layers, metres; a distance of 0 is that of the pixels.
    radiometry_quantity : str
        What images are calibrated to; ``'none'`` for images as they are.

    Raises
    ------
    ValueError
        The mode is unknown or a length is not positive.

    Examples
    --------
    >>> from sar_imaging import MapGrid
    >>> from sar_imaging.configuration import Imaging
    >>> imaging = Imaging(MapGrid((120.0, 0.0, 0.0), 200, 200, 0.25), pulses_per_aperture=256,
    ...                   mode='volume', volume_height=3.0, volume_spacing=1.0)
    >>> imaging.volume.shape, imaging.n_pixels, imaging.top_m
    ((4, 200, 200), 160000, 3.0)
    """

    grid: MapGrid
    pulses_per_aperture: int
    window: str = 'none'
    range_filter: str = 'equalised'
    oversampling: float = 2.0
    near_range: float = 0.0
    far_range: float = 0.0
    target_db: float = -60.0
    pulses_per_block: int = 32
    reorder_window_pulses: int = 128
    queue_depth: int = 50
    worker_queue_size: int = 512
    worker_queue_megabytes: float = 512.0
    max_message_elements: int = 2**26
    max_image_pixels: int = 2**25
    mode: str = 'image'
    method: str = 'exact'
    subaperture_target_db: float = -60.0
    subaperture_pulses: int = 0
    subaperture_sliding: bool = False
    subaperture_follow: bool = False
    autofocus_track_error: float = 0.0
    autofocus_time_offset: float = 0.0
    volume_height: float = 0.0
    volume_spacing: float = 0.0
    radiometry_quantity: str = 'none'

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise ValueError(f'mode={self.mode!r} is unknown; use one of {", ".join(MODES)}')
        if self.far_range and self.far_range <= self.near_range:
            raise ValueError(f'far_range={self.far_range:g} lies before near_range='
                             f'{self.near_range:g}')
        for name in ('pulses_per_aperture', 'pulses_per_block', 'queue_depth',
                     'worker_queue_size'):
            if getattr(self, name) < 1:
                raise ValueError(f'{name}={getattr(self, name)}; expected at least 1')
        if self.mode == 'volume' and not 0 < self.volume_height < math.inf:
            raise ValueError(f'volume.height={self.volume_height:g} in mode volume; expected the '
                             'positive height of the volume above grid.centre_z, metres')
        if not 0 <= self.volume_spacing < math.inf:
            raise ValueError(f'volume.spacing={self.volume_spacing:g}; expected a positive '
                             'distance of the layers in metres, or 0.0 for that of the pixels')

    @property
    def volume(self) -> VolumeGrid | None:
        """Cells of mode ``'volume'``; None in the others."""
        if self.mode != 'volume':
            return None
        return VolumeGrid.above(self.grid, self.volume_height, self.volume_spacing or None)

    @property
    def n_pixels(self) -> int:
        """Of an image, or cells of a volume."""
        return math.prod((self.volume or self.grid).shape)

    @property
    def top_m(self) -> float:
        """Height of the highest layer, metres."""
        volume = self.volume
        if volume is None:
            return self.grid.z_m
        return float(volume.positions(volume.n_z - 1, 0, 0)[2])

    @property
    def middle_grid(self) -> MapGrid:
        """Map halfway up the volume; the grid itself where there is none."""
        x, y, z = self.grid.centre_m
        return dataclasses.replace(self.grid, centre_m=(x, y, (z + self.top_m) / 2))

    @property
    def keeps_pulses(self) -> bool:
        """True when those of an aperture are kept until its end."""
        return self.autofocus or self.method != 'exact'

    @property
    def autofocus(self) -> bool:
        """True when whole apertures are to be focused."""
        return bool(self.autofocus_track_error or self.autofocus_time_offset)

    @property
    def range_window_m(self) -> tuple[float, float] | None:
        """Part of the profiles that range compression keeps, metres; None for all."""
        if not self.near_range and not self.far_range:
            return None
        return self.near_range, self.far_range or math.inf


@dataclasses.dataclass(frozen=True)
class Machine:
    """Speed and memory of the computer that images.

    Parameters
    ----------
    rate_per_s : float
        Pixels times pulses times channels that backprojection adds per second.
    rate_source : str
        Where that number comes from, for the report.
    memory_bytes : int
        Memory for the nodes.

    Examples
    --------
    >>> from sar_imaging.configuration import Machine
    >>> small = Machine(rate_per_s=50e6, rate_source='measured', memory_bytes=2 * 2**30)
    >>> print(f'{128 * 128 * 256 / small.rate_per_s:.2f} s for 128 x 128 pixels of 256 pulses')
    0.08 s for 128 x 128 pixels of 256 pulses
    >>> Machine.this_one().memory_bytes > 0
    True
    """

    rate_per_s: float
    rate_source: str
    memory_bytes: int

    @classmethod
    def this_one(cls, rate_per_s: float = 0.0, memory_bytes: int = 0) -> Machine:
        """This computer; 0 assumes a rate for its cores and takes the memory that is free."""
        cores = os.cpu_count() or 1
        if rate_per_s > 0:
            source = 'given'
        else:
            rate_per_s, source = ASSUMED_RATE_PER_CORE * cores, f'assumed for {cores} cores'
        return cls(rate_per_s, source, memory_bytes or available_bytes())
