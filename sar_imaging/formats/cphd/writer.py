"""Blocks of pulses as CPHD: one pass over a stream of blocks, samples never all in memory."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ...files import replacing
from ...geometry.earth import Datum
from ...geometry.grids import MapGrid
from ...geometry.illumination import AntennaPattern, Pointing
from ...signal.pulses import PulseBlock
from ...signal.radar import SPEED_OF_LIGHT, Waveform
from ...signal.range_compression import RangeCompressor
from ..extras import require
from .antennas.writing import TABLE, WrittenAntenna
from .collection import Collection
from .container import PURPOSE, CphdError
from .metadata import SAMPLE_BYTES, make_metadata
from .parameters import Pulses, reference_delays, vector_parameters
from .phase_history import UNTURNED_CYCLES
from .samples import encode, full_scale, ramp

_COPIED_BYTES = 2**24  # at a time, from the spool to the file


def write_cphd(path: Path | str, blocks: Iterable[PulseBlock], datum: Datum, grid: MapGrid, *,
               collection: Collection | None = None, domain: str | None = None, sign: int = -1,
               sample_type: str = 'CF8', antenna: AntennaPattern | None = None,
               overwrite: bool = False) -> int:
    """Write pulses as a CPHD 1.1.0 file, complete or not at all.

    Phase histories (stepped frequency) are written in domain FX, everything else as range
    profiles in domain TOA; raw pulses are compressed first. The reference point is the middle of
    the grid for all vectors.

    Parameters
    ----------
    path : path
        File to make. Beside it, samples are collected in temporary files of the same size.
    blocks : iterable of PulseBlock
        Of one radar, in the order of their times, with phase centres.
    datum : Datum
        Where the frame of the phase centres stands.
    grid : MapGrid
        Area that is meant to be imaged, and the pixels proposed for it.
    collection : Collection, optional
        Names and kinds that the pulses do not tell.
    domain : {'FX', 'TOA'}, optional
        ``'TOA'`` compresses phase histories, too.
    sign : {-1, 1}
        SGN; -1 is that of this package.
    sample_type : {'CF8', 'CI4', 'CI2'}
        Complex floats of 8 bytes, or integers of 4 or 2 with a factor for each vector.
    antenna : AntennaPattern, optional
        Pattern of the antenna; the pulses then tell where it looked. It is written as
        polynomials over its main lobe and as a table, which `CphdReader` takes.
    overwrite : bool
        Replace an existing file.

    Returns
    -------
    int
        Number of pulses written.

    Raises
    ------
    CphdError
        The pulses cannot be written, or the file exists.
    MissingExtraError
        sarkit is not installed.

    Examples
    --------
    >>> from sar_imaging import MapGrid
    >>> from sar_imaging.formats.cphd import Collection, write_cphd
    >>> from sar_imaging.geometry import Datum
    >>> from sar_imaging.simulation import SCENARIOS
    >>> area = MapGrid((10_000.0, 0.0, 0.0), 40, 40, 0.5)
    >>> write_cphd('scene.cphd', SCENARIOS['psf']().blocks(), Datum(47.0, 8.0, 450.0), area,
    ...            collection=Collection(collector_name='simulator'), overwrite=True)
    200
    """
    path = Path(path)
    require('sarkit.cphd', PURPOSE)
    if path.is_dir() or (os.path.lexists(path) and not overwrite):
        raise CphdError(f'{path} exists already; choose another file, or replace it on purpose')
    if sign not in (-1, 1):
        raise CphdError(f'sign={sign}; expected -1 or +1')
    if sample_type not in SAMPLE_BYTES:
        raise CphdError(f'sample_type={sample_type!r}; expected one of {", ".join(SAMPLE_BYTES)}')
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as partial, contextlib.ExitStack() as files:
        spool = _Spool(partial, files, datum, np.array(grid.centre_m), domain, sign, sample_type)
        for block in blocks:
            spool.add(block)
        pulses = spool.pulses(antenna)
        vectors = vector_parameters(pulses)
        named = (collection or Collection()).named(len(vectors))
        tree = make_metadata(pulses, vectors, grid, named, sample_type, sign)
        _assemble(partial, tree, vectors, named, spool, pulses.antenna)
    return len(pulses.stamp_ns)


class _Spool:
    """Samples of the channels, each in a file of its own, and what else the pulses tell."""

    def __init__(self, path: Path, files: contextlib.ExitStack, datum: Datum,
                 reference_m: np.ndarray, domain: str | None, sign: int, sample_type: str):
        self._path, self._files = path, files
        self._datum, self._reference_m = datum, reference_m
        self._wanted_domain, self._sign, self._sample_type = domain, sign, sample_type
        self._first: PulseBlock | None = None
        self._compressor: RangeCompressor | None = None
        self._told: list[tuple[np.ndarray, ...]] = []
        self._looks: list[Pointing | None] = []

    def add(self, block: PulseBlock) -> None:
        """Write the samples of a block."""
        if self._first is None:
            self._begin(block)
        elif not block.matches(self._first):
            raise CphdError('blocks differ in radar, frame, channels or samples; write one file '
                            'for each')
        if not block.n_pulses:
            return
        if self._compressor is not None:
            block = self._compressor(block)
        if not np.isfinite(block.samples.view(np.float32)).all():
            raise CphdError('samples are NaN or infinite; leave such pulses out')
        delay_s = reference_delays(block.tx_m, block.rx_m, self._reference_m)
        samples = self._turned(block, delay_s)
        amplitude = np.empty(delay_s.shape)
        for channel, file in enumerate(self.files):
            own = samples[:, channel]
            amplitude[:, channel] = full_scale(own, self._sample_type)
            file.write(encode(own, amplitude[:, channel], self._sign,
                              self._sample_type).tobytes())
        self._told.append((block.stamp_ns, block.tx_m, block.rx_m, amplitude,
                           block.samples.any(axis=-1)))
        self._looks.append(block.pointing)

    def _begin(self, block: PulseBlock) -> None:
        radar = block.radar
        if not block.has_positions:
            raise CphdError('the pulses have no phase centres; CPHD needs those of every vector')
        if radar.propagation_speed_m_per_s != SPEED_OF_LIGHT:
            raise CphdError(f'waves of {radar.propagation_speed_m_per_s:g} m/s; CPHD is for '
                            'radars in air')
        natural = ('FX' if radar.waveform == Waveform.STEPPED_FREQUENCY and not block.compressed
                   else 'TOA')
        self._domain = self._wanted_domain or natural
        if self._domain not in ('FX', 'TOA'):
            raise CphdError(f'domain={self._domain!r}; expected FX or TOA')
        if self._domain == 'FX' != natural:
            raise CphdError('only phase histories (stepped frequency, raw) can be written in '
                            'domain FX; write these pulses in domain TOA')
        self._first, self.radar, self._n_samples = block, radar, block.n_samples
        if self._domain == 'TOA' and not block.compressed:
            self._compressor = RangeCompressor(radar, block.n_samples)
            self.radar, self._n_samples = self._compressor.output_radar, self._compressor.n_output
        self.files = [self._files.enter_context(open(f'{self._path}.{i}', 'w+b'))
                      for i in range(block.n_channels)]

    def _turned(self, block: PulseBlock, delay_s: np.ndarray) -> np.ndarray:
        """(P, C, N) complex64 samples whose phase refers to the reference point."""
        radar, shape = block.radar, block.samples.shape
        if self._domain == 'TOA':
            turns = np.exp(2j * np.pi * (radar.carrier_hz * delay_s % 1.0))
            return (block.samples * turns[..., None]).astype(np.complex64)
        step = radar.bandwidth_hz / block.n_samples
        earlier = (radar.first_sample_delay_s - delay_s).ravel()
        highest_hz = radar.carrier_hz + radar.bandwidth_hz
        if np.abs(earlier * highest_hz).max() <= UNTURNED_CYCLES:
            return block.samples
        turns = ramp(earlier * (radar.carrier_hz - (block.n_samples - 1) / 2 * step),
                     earlier * step, block.n_samples)
        return (block.samples * turns.reshape(shape)).astype(np.complex64)

    def pulses(self, pattern: AntennaPattern | None) -> Pulses:
        """What was written, without its samples."""
        if not self._told:
            raise CphdError('there is no pulse to write')
        antenna = None
        if pattern is not None:
            if None in self._looks:
                raise CphdError('pulses do not tell where the antenna looked; give them their '
                                'pointing, or leave the antenna out')
            antenna = WrittenAntenna.of(pattern, Pointing.join(self._looks), self._datum)
        stamp_ns, tx_m, rx_m, amplitude, has_signal = map(np.concatenate,
                                                          zip(*self._told, strict=True))
        return Pulses(self.radar, self._n_samples, self._domain, self._datum, self._reference_m,
                      stamp_ns, tx_m, rx_m, None if self._sample_type == 'CF8' else amplitude,
                      has_signal, antenna)


def _assemble(path: Path, tree, vectors: np.ndarray, collection: Collection,
              spool: _Spool, antenna: WrittenAntenna | None) -> None:
    """Header, metadata and parameters by sarkit; behind them the samples of each channel."""
    sarkit = require('sarkit.cphd', PURPOSE)
    with open(path, 'w+b') as file:
        writer = sarkit.Writer(file, sarkit.Metadata(xmltree=tree))
        for name, own in zip(collection.channels, vectors, strict=True):
            writer.write_pvp(name, own)
        if antenna is not None:
            writer.write_support_array(TABLE, antenna.table)
        file.seek(0)
        _, header = sarkit.read_file_header(file)
        file.seek(int(header['SIGNAL_BLOCK_BYTE_OFFSET']))
        for samples in spool.files:
            samples.seek(0)
            shutil.copyfileobj(samples, file, _COPIED_BYTES)
            samples.truncate(0)  # gives its space back before the next one is copied
