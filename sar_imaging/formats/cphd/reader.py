# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""CPHD files as blocks of pulses in a local frame, in chunks of bounded memory.

In the domain TOA vectors are range profiles over the delay from that of the reference point. The
peak of an echo at tau has the phase ``-2 pi fx_C (tau - tau_SRP)``, in profiles of a block
``-2 pi f_c tau``: a vector is turned as a whole. By one Fourier transform profiles that do not
begin on one lattice of delays are shifted by a part of a sample, those of fewer samples than
imaging needs are resampled, and integers lose the noise that rounding adds beyond the band.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import fft

from ...files import naming
from ...geometry.earth import Datum, ecef_to_geographic, geographic_to_ecef
from ...geometry.grids import MapGrid
from ...geometry.illumination import AntennaPattern, Pointing
from ...planning.aliasing_error import cosine_fall
from ...signal.pulses import PulseBlock
from ...signal.radar import RadarParameters
from .antennas.reading import read_antenna
from .collection import read_collection, read_start_ns
from .container import Container, CphdError
from .phase_history import PhaseHistories, decode
from .vectors import Vectors, coinciding, read_vectors

_OFF_LATTICE = 1e-7  # of a sample, that needs no shift: -124 dB
_SAME_STEP = 1e-6  # of a sample, by which steps may add up over a profile
_SAME_CENTRE_HZ = 1e-2
_LONGEST = 64  # times the length of a vector
# Samples per 1 / bandwidth: of files (the standard: 1.1 or more), for imaging, and those of the
# band that integers keep.
_LEAST_RATE, _RATE, _INTEGER_RATE = 1.09, 1.25, 1.1
# Of a filter, in 1 / bandwidth, times the share of the band over which it falls: what ends there
# changes by -94 dB, by less than -60 dB at a fifth of it (`RangeGate.end_error`).
_REACH, _TOLD_REACH = 24.0, 0.2


class VectorCompression:
    """How vectors of domain TOA become compressed blocks.

    Parameters, attributes and errors as of `PhaseHistories`; `integers` are rounded samples.
    """

    compressed = True

    def __init__(self, vectors: Vectors, n_samples: int, integers: bool = False):
        self.warnings: list[str] = []
        self._n_file = n_samples
        step = float(vectors.step.flat[0])
        centre_hz = vectors.fx_hz.mean(axis=-1)
        self._carrier_hz = float(centre_hz.flat[0])
        self._check(vectors, step, centre_hz)
        bandwidth_hz = float(np.ptp(vectors.fx_hz))
        rate = 1 / (step * bandwidth_hz)
        if rate < _LEAST_RATE:
            raise CphdError(f'SCSS of {step:.6g} s gives {rate:.3f} samples per 1 / bandwidth of '
                            f'FX1 to FX2, {bandwidth_hz:.6g} Hz; the standard asks for 1.1')
        self._delay_s = vectors.reference_delay_s
        start = vectors.first + self._delay_s
        first_s = start.min()
        offset = (start - first_s) / step
        moved = np.abs(offset - np.rint(offset)).max() > _OFF_LATTICE or rate < _RATE
        self._gain: np.ndarray | None = None
        if moved or integers:
            ratio = self._design(rate, min(rate, _INTEGER_RATE) if integers else rate)
            step, offset = step / ratio, offset * ratio
            n_samples = math.ceil((n_samples - 1) * ratio) + 1 + bool(moved)
        whole = np.floor(offset) if moved else np.rint(offset)
        if whole.max() > _LONGEST * n_samples:
            raise CphdError(f'profiles of {n_samples} samples begin at delays that differ by '
                            f'{whole.max():.4g} samples, number {vectors.farthest(start)} departs '
                            f'most; expected at most {_LONGEST} times their length: correct that '
                            'vector, or read fewer at once')
        self._offset, self._part, self._n_own = whole.astype(np.int64), offset - whole, n_samples
        self.n_samples = int(self._offset.max()) + n_samples
        if self._offset.max() >= n_samples:
            self.warnings.append('the profiles of some vectors do not overlap: no point is in the '
                                 'image with all pulses')
        self.radar = RadarParameters(
            carrier_hz=self._carrier_hz, bandwidth_hz=bandwidth_hz,
            sample_rate_hz=max(1 / step, _RATE * bandwidth_hz),  # which rounding may miss
            first_sample_delay_s=float(first_s))

    def _design(self, rate: float, last: float) -> float:
        """Choose transforms and a filter that falls from the band to `last` bandwidths.

        The ends of profiles ring as far as the filter reaches: the more gently it falls, the
        less. Returns how many samples there will be for one.
        """
        reach = math.ceil(_REACH / (last - 1) * rate)
        n_in = self._n_in = fft.next_fast_len(self._n_file + 1 + reach)
        n_out = self._n_out = n_in if rate >= _RATE else fft.next_fast_len(
            math.ceil(n_in * _RATE / rate))
        bins = np.arange(n_in // 2 + 1)
        self._gain = cosine_fall((2 * rate * bins / n_in - 1) / (last - 1)) * (n_out / n_in)
        cause = ('hold integers' if last < rate else 'begin at parts of a sample' if n_in == n_out
                 else f'have {rate:.3g} samples per 1 / bandwidth, imaging needs {_RATE}')
        self.warnings.append(f'profiles {cause}, and are filtered, which changes about '
                             f'{_TOLD_REACH * reach:.0f} samples at either end')
        return n_out / n_in

    def _check(self, vectors: Vectors, step: float, centre_hz: np.ndarray) -> None:
        if np.ptp(vectors.step) * self._n_file / step > _SAME_STEP:
            raise CphdError(f'SCSS differs by {np.ptp(vectors.step):.3g} s between vectors; '
                            'expected one sample spacing, resample the vectors first')
        if np.ptp(centre_hz) > _SAME_CENTRE_HZ:
            raise CphdError(f'the middle of the band differs by {np.ptp(centre_hz):.4g} Hz '
                            'between vectors of domain TOA; expected one, image such bands apart')

    def convert(self, samples: np.ndarray, rows: slice, channel: int) -> np.ndarray:
        """Samples of a block from those of some vectors, as `PhaseHistories.convert`."""
        turned = samples * self._turns(rows, channel)[:, None]
        offset, n = self._offset[rows, channel], self._n_own
        if self._gain is not None:
            turned = self._filtered(turned, self._part[rows, channel], self._gain)
        if n == self.n_samples and not offset.any():
            return turned.astype(np.complex64)
        out = np.zeros((len(samples), self.n_samples), np.complex64)
        for shift in np.unique(offset):
            own = offset == shift
            out[own, shift:shift + n] = turned[own]
        return out

    def _turns(self, rows: Any, channel: int) -> np.ndarray:
        cycles = self._carrier_hz * self._delay_s[rows, channel]
        return np.exp(-2j * np.pi * (cycles % 1.0))

    def _filtered(self, profiles: np.ndarray, part: np.ndarray, gain: np.ndarray) -> np.ndarray:
        """Profiles (P, N) in the blocks' sampling, beginning `part` of a sample, (P,), earlier."""
        bins = np.arange(-(self._n_in // 2), (self._n_in + 1) // 2)
        spectrum = np.zeros((len(profiles), self._n_out), np.complex128)
        spectrum[:, bins] = (fft.fft(profiles, self._n_in, axis=-1)[:, bins]
                             * gain[np.abs(bins)]
                             * np.exp(-2j * np.pi / self._n_out * np.multiply.outer(part, bins)))
        return fft.ifft(spectrum, axis=-1)[:, :self._n_own]


MEMORY_BYTES = 2**28
_WORK_BYTES = 64  # of a sample: complex numbers of double precision while it is converted
_LONGEST_AREA_M = 2e6
_PIXELS_PER_RESOLUTION = 2
_TOLD_TROPOSPHERE_S = 1e-12  # 0.15 mm of range


class CphdReader:
    """Read the pulses of a CPHD file.

    Channels of the file whose vectors were transmitted at the same times become channels of the
    blocks. A vector's number becomes the counter of its pulse.

    Parameters
    ----------
    path : path
        File to open.
    datum : Datum, optional
        Where the frame of the phase centres stands; by default at the file's reference point
        (IARP), x east and y north.
    channels : sequence of str, optional
        Identifiers of the channels to read; by default all of them.

    Attributes
    ----------
    container : Container
        The file itself: its metadata are ``container.tree``.
    datum : Datum
        Where the frame stands.
    collection : Collection
        Names and kinds that the file tells.
    radar : RadarParameters
        Radar parameters of all blocks.
    n_samples : int
        Samples of all blocks.
    compressed : bool
        False for phase histories (domain FX), True for range profiles (domain TOA).
    stamp_ns : (P,) int64
        Times of the pulses, nanoseconds since 1970.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres in the frame, metres.
    illumination : AntennaPattern or None
        Pattern of the antenna, where the file tells one that can be used; its blocks then have
        their pointing.
    warnings : list of str
        What a person should know of the file.

    Raises
    ------
    CphdError
        The file is no CPHD, is damaged, or holds what cannot become pulses of one radar.
    MissingExtraError
        sarkit is not installed.

    Examples
    --------
    >>> from sar_imaging import MapGrid
    >>> from sar_imaging.formats.cphd import CphdReader, write_cphd
    >>> from sar_imaging.geometry import Datum
    >>> from sar_imaging.simulation import SCENARIOS
    >>> area = MapGrid((10_000.0, 0.0, 0.0), 40, 40, 0.5)
    >>> _ = write_cphd('scene.cphd', SCENARIOS['psf']().blocks(), Datum(47.0, 8.0), area,
    ...                overwrite=True)
    >>> with CphdReader('scene.cphd') as reader:
    ...     print(reader.n_pulses, 'pulses,', reader.n_channels, 'channels')
    ...     print(sum(block.n_pulses for block in reader.blocks(memory_bytes=1e6)))
    200 pulses, 5 channels
    200
    """

    def __init__(self, path: Path | str, *, datum: Datum | None = None,
                 channels: Sequence[str] | None = None):
        self.container = Container(path)
        try:
            with naming(self.container.path, 'has no vectors that can be read', CphdError):
                self._open(datum, channels)
        except BaseException:
            self.container.close()
            raise

    def _open(self, datum: Datum | None, channels: Sequence[str] | None) -> None:
        container = self.container
        self.channels = self._chosen(channels)
        self.collection = read_collection(container, self.channels)
        self._vectors = vectors = read_vectors(container, self.channels)
        domain = container.text('Global/DomainType')
        if domain not in ('FX', 'TOA'):
            raise CphdError(f'{container.path}: domain {domain!r}; expected FX or TOA')
        sign = container.text('Global/SGN')
        if sign not in ('-1', '+1', '1'):
            raise CphdError(f'{container.path}: SGN is {sign!r}; expected -1 or +1')
        self.domain, self._sign = domain, int(sign)
        n_file = container.channels[self.channels[0]].n_samples
        self._samples = PhaseHistories(vectors, n_file) if domain == 'FX' else VectorCompression(
            vectors, n_file, integers=container.sample_type != 'CF8')
        self.radar, self.n_samples = self._samples.radar, self._samples.n_samples
        self.compressed = self._samples.compressed
        self.datum = datum or self._datum_of_file()
        self.tx_m, self.rx_m = (self.datum.from_ecef(m) for m in (vectors.tx_m, vectors.rx_m))
        self.stamp_ns = read_start_ns(container) + np.rint(vectors.tx_s * 1e9).astype(np.int64)
        self.warnings = self._samples.warnings + self._told()
        self.illumination, self._pointing = self._antenna()

    def close(self) -> None:
        """Close the file."""
        self.container.close()

    def __enter__(self) -> CphdReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def n_pulses(self) -> int:
        """Number of pulses P, vectors without signal left out."""
        return len(self.stamp_ns)

    @property
    def n_vectors(self) -> int:
        """Number of vectors of each channel in the file, those without signal included."""
        return self.container.channels[self.channels[0]].n_vectors

    @property
    def n_channels(self) -> int:
        """Number of channels C."""
        return len(self.channels)

    def blocks(self, *, memory_bytes: int = MEMORY_BYTES, start: int = 0,
               stop: int | None = None) -> Iterator[PulseBlock]:
        """Pulses in the order of the file, in blocks that take little memory.

        Parameters
        ----------
        memory_bytes : int
            What a block and the work on it may take; at least one pulse is read.
        start, stop : int
            First pulse, and the one after the last.

        Yields
        ------
        PulseBlock

        Raises
        ------
        CphdError
            Samples are no numbers, or the file was truncated since it was opened.
        """
        start, stop, _ = slice(start, stop).indices(self.n_pulses)
        n = max(self.n_samples, self.container.channels[self.channels[0]].n_samples)
        step = max(1, int(memory_bytes // (n * (8 * self.n_channels + _WORK_BYTES))))
        index = self._vectors.index
        while start < stop:  # vectors without signal are read, too, and count
            last = min(stop, int(np.searchsorted(index, index[start] + step)))
            with naming(self.container.path, 'has vectors that cannot be read', CphdError):
                block = self._block(slice(start, last))
            yield block
            start = last

    def _block(self, rows: slice) -> PulseBlock:
        index = self._vectors.index[rows]
        samples = np.empty((len(index), self.n_channels, self.n_samples), np.complex64)
        for number, name in enumerate(self.channels):
            with np.errstate(over='ignore', invalid='ignore'):  # told below
                own = self._samples.convert(self._read(name, number, rows), rows, number)
            own[~self._vectors.normal[rows, number]] = 0
            samples[:, number] = own
        finite = np.isfinite(samples.view(np.float32)).all(axis=(1, 2))
        if not finite.all():
            raise CphdError(f'{self.container.path}: samples of {np.count_nonzero(~finite)} '
                            f'vectors are NaN or infinite, first of number '
                            f'{index[(~finite).argmax()]}; the file is damaged')
        return PulseBlock(self.radar, self.compressed, self.stamp_ns[rows], index, samples,
                          self.tx_m[rows], self.rx_m[rows], 'map',
                          self._pointing and self._pointing.select(rows))

    def _read(self, channel: str, number: int, rows: slice) -> np.ndarray:
        """(P, N) complex64 samples of the file, of the package's sign."""
        index = self._vectors.index[rows]
        raw = self.container.read_samples(channel, int(index[0]), int(index[-1]) + 1)
        if len(raw) != len(index):
            raw = raw[index - index[0]]
        return decode(raw, self._vectors.amplitude[rows, number], self._sign)

    @property
    def area_m(self) -> np.ndarray:
        """(4, 3) float64 corners of the area that the file is meant for, in the frame, metres."""
        container = self.container
        with naming(container.path, 'has no SceneCoordinates that can be read', CphdError):
            (x1, y1), (x2, y2) = (
                [float(container.text(f'SceneCoordinates/ImageArea/{corner}/{axis}'))
                 for axis in 'XY'] for corner in ('X1Y1', 'X2Y2'))
            corners = np.array([(x1, y1), (x1, y2), (x2, y2), (x2, y1)])
            if not (np.abs(corners) < _LONGEST_AREA_M).all() or x1 >= x2 or y1 >= y2:
                raise CphdError(f'{container.path}: ImageArea from {(x1, y1)} to {(x2, y2)} m is '
                                'no area')
            with np.errstate(all='ignore'):  # told below
                area = self.datum.from_ecef(self._on_surface(corners))
            if not (np.ptp(area, axis=0) < 2 * _LONGEST_AREA_M).all():
                raise CphdError(f'{container.path}: the axes of ReferenceSurface are no axes of '
                                'an area')
            return area

    def _on_surface(self, area_m: np.ndarray) -> np.ndarray:
        """(N, 3) ECEF points of (N, 2) coordinates on the file's reference surface, metres."""
        def vector(path: str, axes: str | Sequence[str]) -> np.ndarray:
            return np.array([float(self.container.text(f'SceneCoordinates/{path}/{axis}'))
                             for axis in axes])

        planar = 'ReferenceSurface/Planar'
        if self.container.text(f'SceneCoordinates/{planar}/uIAX/X', ''):
            axes = np.stack([vector(f'{planar}/uIA{axis}', 'XYZ') for axis in 'XY'])
            return vector('IARP/ECF', 'XYZ') + area_m @ axes
        surface, angles = 'ReferenceSurface/HAE', ('Lat', 'Lon')  # radians per metre
        steps = np.stack([vector(f'{surface}/uIA{axis}LL', angles) for axis in 'XY'])
        latitude, longitude, height = vector('IARP/LLH', (*angles, 'HAE'))
        turned = np.degrees(area_m @ steps)
        return geographic_to_ecef(latitude + turned[:, 0], longitude + turned[:, 1], height)

    @property
    def resolution_m(self) -> tuple[float, float]:
        """Slant range resolution, and along the track in the area's middle, metres.

        The latter is ``lambda / 2 / angle``, where angle is how much of the circle the mean of
        both phase centres sees the middle from.
        """
        look = (self.tx_m + self.rx_m).mean(axis=1) / 2 - self.area_m.mean(axis=0)
        look /= np.linalg.norm(look, axis=-1, keepdims=True)
        angle = np.arccos(np.clip(look[0] @ look[-1], -1, 1))
        across = self.radar.wavelength_m / 2 / max(angle, 1e-9)
        return self.radar.range_resolution_m, float(across)

    def map_grid(self) -> MapGrid:
        """Map over the area, with two pixels in each resolution cell."""
        area = self.area_m
        low, high = area.min(axis=0), area.max(axis=0)
        spacing = min(self.resolution_m) / _PIXELS_PER_RESOLUTION
        return MapGrid.from_size((low + high) / 2, high[0] - low[0], high[1] - low[1], spacing)

    def _chosen(self, channels: Sequence[str] | None) -> tuple[str, ...]:
        groups = coinciding(self.container)
        if channels is None:
            if len(groups) == 1:
                return groups[0]
            told = '; '.join(', '.join(names) for names in groups)
            raise CphdError(f'{self.container.path}: channels were transmitted at different '
                            f'times, or are of different lengths; choose among: {told}')
        chosen = tuple(channels)
        unknown = [name for name in chosen if name not in self.container.channels]
        if unknown or not chosen:
            raise CphdError(f'{self.container.path} has no channel {", ".join(unknown)}; it has '
                            f'{", ".join(self.container.channels)}')
        if not any(set(chosen) <= set(names) for names in groups):
            raise CphdError(f'{self.container.path}: channels {", ".join(chosen)} were not '
                            'transmitted at the same times, or are of different lengths; read '
                            'one after the other')
        return chosen

    def _datum_of_file(self) -> Datum:
        """Frame at the reference point of the scene, or at the middle of those of vectors."""
        model = self.container.text('SceneCoordinates/EarthModel', 'WGS_84')
        if model != 'WGS_84':
            raise CphdError(f'{self.container.path}: EarthModel is {model}; expected WGS_84')
        texts = [self.container.text(f'SceneCoordinates/IARP/ECF/{axis}', '') for axis in 'XYZ']
        if all(texts):
            point = np.array([float(text) for text in texts])
        else:
            point = self._vectors.reference_m.mean(axis=(0, 1))
        latitude, longitude, height = ecef_to_geographic(point)
        return Datum(float(latitude), float(longitude), float(height))

    def _antenna(self) -> tuple[AntennaPattern | None, Pointing | None]:
        """Pattern and pointing that the file tells; a warning says why it tells none."""
        try:
            with naming(self.container.path, 'has no antenna that can be read', CphdError), \
                    np.errstate(all='ignore'):
                found = read_antenna(self.container, self.channels, self._vectors)
                if found is None:
                    return None, None
                pointing = Pointing(*map(self.datum.vectors_from_ecef,
                                         (found.boresight, found.up)))
        except CphdError as error:
            self.warnings.append(f'the antenna is not used, all is lit alike: {error}')
            return None, None
        self.warnings += found.warnings
        return found.pattern, pointing

    def _told(self) -> list[str]:
        """What a person should know besides what the samples tell."""
        vectors, told = self._vectors, []
        total = self.n_vectors
        if total > self.n_pulses:
            told.append(f'{total - self.n_pulses} of {total} vectors have no signal and are left '
                        'out')
        missing = np.count_nonzero(~vectors.normal)
        if missing:
            told.append(f'{missing} vectors of single channels have no signal and count as zero')
        if vectors.tropospheric_s > _TOLD_TROPOSPHERE_S:
            told.append(
                f'the file allows for a troposphere of {vectors.tropospheric_s * 1e9:.3g} ns at '
                'the reference point, where it is gone; elsewhere its difference remains')
        return told
