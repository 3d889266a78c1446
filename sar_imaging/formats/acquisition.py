# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What is known of how an image was acquired, and an image with it and its place on the Earth."""

from __future__ import annotations

import dataclasses
import datetime
from collections.abc import Iterable
from typing import Any

import numpy as np

from ..geometry.earth import Datum
from ..geometry.illumination import AntennaPattern, Pointing
from ..imaging.image import Image
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters

EPOCH = datetime.datetime(1970, 1, 1, tzinfo=datetime.timezone.utc)
_POLARISATIONS = ('V', 'H', 'X', 'Y', 'RHC', 'LHC')
UNKNOWN = 'UNKNOWN'


def date_of(stamp_ns: int) -> datetime.datetime:
    """Date, UTC, of nanoseconds since 1970; what is below a microsecond is left out."""
    return EPOCH + datetime.timedelta(microseconds=int(stamp_ns) // 1000)


@dataclasses.dataclass(frozen=True, eq=False)
class Acquisition:
    """Radar, times and phase centres of the pulses of an image, without their samples.

    Parameters
    ----------
    radar : RadarParameters
        Radar parameters of the pulses.
    stamp_ns : (P,) int64
        Time of transmission of each pulse, nanoseconds since the epoch of their clock.
    tx_m, rx_m : (P, 3) float64
        Transmit and receive phase centre of each pulse, the mean of its channels, imaging frame,
        metres.
    polarisation : str
        Transmitted and received one, such as ``'V:H'`` or ``'RHC:V'``; ``'UNKNOWN'`` otherwise.
    collector : str
        Name of the radar or its platform.
    illuminator : str
        Name of what transmits, where that is another platform.
    name : str
        Name of the acquisition, unique among those of the collector; made of its name and the
        time of the first pulse where none is given.
    antenna : AntennaPattern, optional
        Pattern of the antenna, with `pointing`.
    pointing : Pointing, optional
        Where the antenna looked at each pulse.

    Raises
    ------
    ValueError
        Shapes disagree, there is no pulse, a position is not finite, or there is no such
        polarisation.

    Examples
    --------
    >>> from sar_imaging.formats import Acquisition
    >>> from sar_imaging.simulation import SCENARIOS
    >>> acquisition = Acquisition.of(SCENARIOS['psf']().blocks(50), polarisation='V:V',
    ...                              collector='drone 7')
    >>> acquisition.n_pulses, acquisition.centre_m.shape, acquisition.collector
    (200, (200, 3), 'drone 7')
    """

    radar: RadarParameters
    stamp_ns: np.ndarray
    tx_m: np.ndarray
    rx_m: np.ndarray
    polarisation: str = UNKNOWN
    collector: str = UNKNOWN
    illuminator: str = ''
    name: str = ''
    antenna: AntennaPattern | None = None
    pointing: Pointing | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, 'stamp_ns', np.asarray(self.stamp_ns, np.int64))
        if self.stamp_ns.ndim != 1 or not len(self.stamp_ns):
            raise ValueError(f'stamp_ns.shape={self.stamp_ns.shape}; expected (pulses,), the time '
                             'of at least one pulse')
        for name in ('tx_m', 'rx_m'):
            places = np.asarray(getattr(self, name), np.float64)
            if places.shape != (len(self.stamp_ns), 3) or not np.isfinite(places).all():
                raise ValueError(f'{name}.shape={places.shape}; expected {len(self.stamp_ns)} '
                                 'finite positions of pulses, (pulses, 3), metres')
            object.__setattr__(self, name, places)
        if self.polarisation != UNKNOWN and (
                not set(self.polarisation.split(':')) <= set(_POLARISATIONS)
                or self.polarisation.count(':') != 1):
            raise ValueError(f'polarisation={self.polarisation!r}; expected the transmitted and '
                             f'the received one of {", ".join(_POLARISATIONS)}, such as "V:H", '
                             f'or {UNKNOWN!r}')
        if self.pointing is not None and len(self.pointing) != len(self.stamp_ns):
            raise ValueError(f'the pointing is for {len(self.pointing)} pulses, there are '
                             f'{len(self.stamp_ns)}; give every pulse its boresight')
        order = np.argsort(self.stamp_ns, kind='stable')
        if self.pointing is not None:
            object.__setattr__(self, 'pointing', self.pointing.select(order))
        for name in ('stamp_ns', 'tx_m', 'rx_m'):
            object.__setattr__(self, name, getattr(self, name)[order])

    @classmethod
    def of(cls, blocks: PulseBlock | Iterable[PulseBlock], *,
           antenna: AntennaPattern | None = None, polarisation: str = UNKNOWN,
           collector: str = UNKNOWN, illuminator: str = '', name: str = '') -> Acquisition:
        """Acquisition of one block of pulses or of many, whose samples are not kept.

        Parameters
        ----------
        blocks : PulseBlock or iterable of PulseBlock
            With phase centres, in any order; their pointing is kept where all tell it.
        antenna : AntennaPattern, optional
            As of the constructor.
        polarisation, collector, illuminator, name : str
            As of the constructor.

        Raises
        ------
        ValueError
            There is no block, one has no phase centres, or the radars differ.
        """
        parts = [blocks] if isinstance(blocks, PulseBlock) else blocks
        kept: list[tuple[Any, ...]] = []
        looks: list[Pointing] = []
        radar = None
        for block in parts:
            if not block.has_positions:
                raise ValueError('the block has no phase centres; expected transmit and receive '
                                 'position of every pulse and channel')
            if radar is not None and block.radar != radar:
                raise ValueError(f'a block of {block.radar} follows blocks of {radar}; expected '
                                 'those of one radar')
            radar = block.radar
            kept.append((block.stamp_ns, *(places.mean(axis=1) for places in block.centres_m)))
            if block.pointing is not None:
                looks.append(block.pointing)
        if radar is None:
            raise ValueError('there is no block; expected at least one')
        stamp_ns, tx_m, rx_m = (np.concatenate(part) for part in zip(*kept, strict=True))
        return cls(radar, stamp_ns, tx_m, rx_m, polarisation=polarisation, collector=collector,
                   illuminator=illuminator, name=name, antenna=antenna,
                   pointing=Pointing.join(looks) if len(looks) == len(kept) else None)

    @property
    def n_pulses(self) -> int:
        """Number of pulses P."""
        return len(self.stamp_ns)

    @property
    def centre_m(self) -> np.ndarray:
        """(P, 3) float64 middle between transmit and receive phase centre, metres."""
        return 0.5 * (self.tx_m + self.rx_m)

    @property
    def wavenumbers_per_m(self) -> tuple[float, float]:
        """Two-way spatial frequencies ``2 f / c`` at the edges of the band, cycles per metre."""
        scale = 2 / self.radar.propagation_speed_m_per_s
        half = self.radar.bandwidth_hz / 2
        return scale * (self.radar.carrier_hz - half), scale * (self.radar.carrier_hz + half)


@dataclasses.dataclass(frozen=True, eq=False)
class ImageProduct:
    """An image that knows where on the Earth it is.

    Parameters
    ----------
    image : Image
        Samples and grid.
    datum : Datum
        Place of the grid's frame on the Earth.
    acquisition : Acquisition or None
        Where the radar was; None where the file does not tell.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import Image, MapGrid
    >>> from sar_imaging.formats import ImageProduct
    >>> from sar_imaging.geometry import Datum
    >>> from sar_imaging.imaging.image import Report
    >>> grid = MapGrid((100.0, 0.0, 0.0), 8, 6, 0.5)
    >>> image = Image(np.ones(grid.shape, np.complex64), grid, 10e9, Report('exact', '', -60.0))
    >>> product = ImageProduct(image, Datum(47.0, 8.0, 450.0))
    >>> latitude, longitude, _ = product.datum.to_geographic(product.image.grid.centre_m)
    >>> print(f'{latitude:.5f}, {longitude:.5f}')
    47.00000, 8.00131
    """

    image: Image
    datum: Datum
    acquisition: Acquisition | None = None
