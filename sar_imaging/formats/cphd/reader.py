"""CPHD files as blocks of pulses in a local frame, in chunks of bounded memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ...files import naming
from ...geometry.earth import Datum, ecef_to_geographic, geographic_to_ecef
from ...geometry.grids import MapGrid
from ...geometry.illumination import AntennaPattern, Pointing
from ...signal.pulses import PulseBlock
from .antennas.reading import read_antenna
from .collection import read_collection, read_start_ns
from .container import Container, CphdError
from .phase_history import PhaseHistories
from .profiles import Profiles
from .samples import decode
from .vectors import coinciding, read_vectors

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
        Of all blocks.
    n_samples : int
        Of all blocks.
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
        self._samples = PhaseHistories(vectors, n_file) if domain == 'FX' else Profiles(
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

    def __exit__(self, *_):
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
        def vector(path, axes):
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
