# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Blocks of pulses as CPHD: one pass over a stream of blocks, samples never all in memory.

Files are CPHD 1.1.0 with every mandatory element, computed from the pulses.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

import sar_imaging

from ...files import replacing
from ...geometry.earth import Datum, ecef_to_geographic
from ...geometry.grids import MapGrid
from ...geometry.illumination import AntennaPattern, Pointing
from ...signal.pulses import PulseBlock
from ...signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from ...signal.range_compression import RangeCompressor
from ..acquisition import date_of
from ..extras import require
from .antennas.writing import OF_CHANNEL, PARAMETERS, TABLE, WrittenAntenna
from .collection import Collection
from .container import PURPOSE, CphdError
from .phase_history import UNTURNED_CYCLES, encode, full_scale, ramp
from .vectors import NORMAL

OVERSAMPLING = 1.2  # samples per that of the saved window or band, as the standard advises
_ONE_PLATFORM = 0.01  # distance of transmitter and receiver, of that to the scene
_XYZ = 'X=F8;Y=F8;Z=F8;'
#: Parameters in the order of the standard; AmpSF only where samples are integers.
LAYOUT = {'TxTime': 'F8', 'TxPos': _XYZ, 'TxVel': _XYZ, 'RcvTime': 'F8', 'RcvPos': _XYZ,
          'RcvVel': _XYZ, 'SRPPos': _XYZ, 'AmpSF': 'F8', 'aFDOP': 'F8', 'aFRR1': 'F8',
          'aFRR2': 'F8', 'FX1': 'F8', 'FX2': 'F8', 'TOA1': 'F8', 'TOA2': 'F8', 'TDTropoSRP': 'F8',
          'SC0': 'F8', 'SCSS': 'F8', 'SIGNAL': 'I8'}


def words(kind: str) -> int:
    """Words of 8 bytes that a parameter takes."""
    return kind.count(';') or 1


def vector_type(layout: dict[str, str]) -> np.dtype:
    """Type of a vector's parameters."""
    kinds = {'F8': np.dtype('f8'), 'I8': np.dtype('i8')}
    return np.dtype([(name, kinds.get(kind, np.dtype(('f8', (words(kind),)))))
                     for name, kind in layout.items()])


@dataclasses.dataclass(frozen=True)
class WrittenPulses:
    """What was written: everything of the pulses but their samples.

    Parameters
    ----------
    radar : RadarParameters
        Radar parameters of the written samples.
    n_samples : int
        Samples of each vector.
    domain : {'FX', 'TOA'}
        What the samples are over.
    datum : Datum
        Where the frame of the phase centres stands.
    reference_m : (3,) float64
        Reference point, in the frame, metres.
    stamp_ns : (P,) int64
        Times of the pulses.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres in the frame, metres.
    amplitude : (P, C) float64 or None
        Factors of the samples, where they are integers.
    has_signal : (P, C) bool
        False where all samples of a vector are zero.
    antenna : WrittenAntenna or None
        Where it is known.
    """

    radar: RadarParameters
    n_samples: int
    domain: str
    datum: Datum
    reference_m: np.ndarray
    stamp_ns: np.ndarray
    tx_m: np.ndarray
    rx_m: np.ndarray
    amplitude: np.ndarray | None
    has_signal: np.ndarray
    antenna: WrittenAntenna | None = None

    @property
    def start_ns(self) -> int:
        """Whole second before the first pulse."""
        return int(self.stamp_ns[0]) // 10**9 * 10**9

    @property
    def layout(self) -> dict[str, str]:
        """Parameters of the vectors and their formats."""
        antenna = {} if self.antenna is None else {
            name: kind for own in PARAMETERS.values() for name, kind in own.items()}
        return {n: k for n, k in LAYOUT.items()
                if n != 'AmpSF' or self.amplitude is not None} | antenna

    @property
    def collect_type(self) -> str:
        """Whether transmitter and receiver are on one platform, by their distance."""
        apart = np.linalg.norm(self.tx_m - self.rx_m, axis=-1).max()
        away = np.linalg.norm(self.rx_m - self.reference_m, axis=-1).min()
        return 'MONOSTATIC' if apart < _ONE_PLATFORM * away else 'BISTATIC'


def reference_delays(tx_m: np.ndarray, rx_m: np.ndarray, reference_m: np.ndarray) -> np.ndarray:
    """(P, C) float64 two-way delay of the reference point, seconds."""
    return (np.linalg.norm(tx_m - reference_m, axis=-1)
            + np.linalg.norm(rx_m - reference_m, axis=-1)) / SPEED_OF_LIGHT


def vector_parameters(pulses: WrittenPulses) -> np.ndarray:
    """(C, P) structured array of the parameters of all vectors.

    Velocities are those between neighbouring pulses. aFRR1 and aFRR2 are zero: pulses of this
    package are as if the platform stood still while they travel.

    Raises
    ------
    CphdError
        Times do not increase, or there are too few pulses for velocities.
    """
    if len(pulses.stamp_ns) < 2:
        raise CphdError('one pulse has no velocity, which CPHD needs; write two or more')
    if (np.diff(pulses.stamp_ns) <= 0).any():
        worst = int((np.diff(pulses.stamp_ns) <= 0).argmax())
        raise CphdError(f'pulse {worst + 1} was transmitted at {pulses.stamp_ns[worst + 1]} ns, '
                        f'not after {pulses.stamp_ns[worst]} ns; put pulses in the order of time')
    tx_s = (pulses.stamp_ns - pulses.start_ns) * 1e-9
    delay_s = reference_delays(pulses.tx_m, pulses.rx_m, pulses.reference_m)
    tx_v, rx_v = (_velocity(m, tx_s) for m in (pulses.tx_m, pulses.rx_m))
    out = np.zeros(pulses.tx_m.shape[1::-1], vector_type(pulses.layout))
    out['TxTime'] = tx_s
    out['RcvTime'] = (tx_s[:, None] + delay_s).T
    out['SRPPos'] = pulses.datum.to_ecef(pulses.reference_m)
    for name, position_m, velocity in (('Tx', pulses.tx_m, tx_v), ('Rcv', pulses.rx_m, rx_v)):
        out[f'{name}Pos'] = pulses.datum.to_ecef(position_m).swapaxes(0, 1)
        out[f'{name}Vel'] = pulses.datum.vectors_to_ecef(velocity).swapaxes(0, 1)
    out['aFDOP'] = -(_range_rate(pulses.tx_m - pulses.reference_m, tx_v)
                     + _range_rate(pulses.rx_m - pulses.reference_m, rx_v)).T / SPEED_OF_LIGHT
    if pulses.amplitude is not None:
        out['AmpSF'] = pulses.amplitude.T
    if pulses.antenna is not None:  # the same at both ends of a pulse's way
        for side in ('Tx', 'Rcv'):
            out[f'{side}ACX'], out[f'{side}ACY'] = pulses.antenna.x_axis, pulses.antenna.y_axis
    out['SIGNAL'] = np.where(pulses.has_signal, NORMAL, 0).T
    (_phase_history_window if pulses.domain == 'FX' else _profile_window)(pulses, delay_s, out)
    return out


def _phase_history_window(pulses: WrittenPulses, delay_s: np.ndarray, out: np.ndarray) -> None:
    """Band and window of phase histories: frequencies are samples, delays one period."""
    radar, n = pulses.radar, pulses.n_samples
    step = radar.bandwidth_hz / n
    out['SC0'] = out['FX1'] = radar.carrier_hz - (n - 1) / 2 * step
    out['FX2'] = radar.carrier_hz + (n - 1) / 2 * step
    out['SCSS'] = step
    half = 0.5 / (OVERSAMPLING * step) * (1 - 1e-6)  # for rounding
    middle = radar.first_sample_delay_s - delay_s
    # Around the reference point where the period around the radar's own reference holds that.
    if np.abs(middle).max() <= 0.5 / step - half:
        middle = np.zeros_like(delay_s)
    out['TOA1'], out['TOA2'] = (middle - half).T, (middle + half).T


def _profile_window(pulses: WrittenPulses, delay_s: np.ndarray, out: np.ndarray) -> None:
    """Band and window of profiles: delays are samples, the band is the radar's."""
    radar = pulses.radar
    if radar.sample_rate_hz < 1.1 * radar.bandwidth_hz:
        raise CphdError(f'profiles have {radar.sample_rate_hz / radar.bandwidth_hz:.3g} samples '
                        'per 1 / bandwidth; CPHD asks for 1.1 or more: compress with '
                        f'oversampling={OVERSAMPLING} or more')
    out['FX1'] = radar.carrier_hz - radar.bandwidth_hz / 2
    out['FX2'] = radar.carrier_hz + radar.bandwidth_hz / 2
    out['SCSS'] = 1 / radar.sample_rate_hz
    out['SC0'] = out['TOA1'] = (radar.first_sample_delay_s - delay_s).T
    out['TOA2'] = out['TOA1'] + (pulses.n_samples - 1) / radar.sample_rate_hz


def _velocity(position_m: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """(P, C, 3) float64 velocities, metres per second."""
    return np.gradient(position_m, time_s, axis=0, edge_order=2 if len(time_s) > 2 else 1)


def _range_rate(line_m: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """(P, C) float64 rate of the length of some lines, metres per second."""
    return np.einsum('pcx,pcx->pc', line_m, velocity) / np.linalg.norm(line_m, axis=-1)


NAMESPACE = 'http://api.nsgreg.nga.mil/schema/cphd/1.1.0'
SAMPLE_BYTES = {'CI2': 2, 'CI4': 4, 'CF8': 8}
_LONGEST_AREA_M = 1e6
# Degrees that angles of the reference geometry have to stay below.
_ANGLE_LIMITS = {'GrazeAngle': 90.0, 'IncidenceAngle': 90.0, 'SlopeAngle': 90.0,
                 'DopplerConeAngle': 180.0, 'BistaticAngle': 180.0, 'AzimuthAngle': 360.0,
                 'LayoverAngle': 360.0}
_OVER_LIMIT_DEG = 0.5  # between the Earth's normal and the line from its centre


def make_metadata(pulses: WrittenPulses, vectors: np.ndarray, grid: MapGrid,
                  collection: Collection, sample_type: str, sign: int) -> Any:
    """Metadata of a file of some pulses.

    Parameters
    ----------
    pulses : WrittenPulses
        What is written.
    vectors : (C, P) structured array
        Their parameters, of `vector_parameters`.
    grid : MapGrid
        Area that the file is meant for; its middle is the reference point.
    collection : Collection
        Names and kinds, of every channel.
    sample_type : {'CI2', 'CI4', 'CF8'}
        Sample type of the samples.
    sign : int
        SGN of the samples.

    Returns
    -------
    lxml.etree.ElementTree

    Raises
    ------
    CphdError
        The geometry has no reference geometry: nothing moves, or the radar is at the reference.
    """
    etree, sarkit = require('lxml.etree', PURPOSE), require('sarkit.cphd', PURPOSE)
    root = etree.Element(f'{{{NAMESPACE}}}CPHD', nsmap={None: NAMESPACE})
    file, antenna = sarkit.ElementWrapper(root), pulses.antenna
    file.from_dict({
        'CollectionID': _collection(collection, pulses),
        'Global': _global(pulses, vectors, sign),
        'SceneCoordinates': _scene(pulses, grid),
        'Data': _data(pulses, vectors, collection, sample_type),
        'Channel': _channels(pulses, vectors, collection),
        'PVP': _layout(pulses),
        'Dwell': _dwell(vectors),
        'ProductInfo': {'Parameter': [('Application', f'sar_imaging {sar_imaging.__version__}')]}})
    if antenna is not None:
        file['SupportArray'] = antenna.support_array()
        file['Antenna'] = antenna.metadata(vectors['TxTime'][0], pulses.radar.carrier_hz)
    file['ReferenceGeometry'] = _reference_geometry(root.getroottree(), vectors)
    return root.getroottree()


def _collection(collection: Collection, pulses: WrittenPulses) -> dict[str, Any]:
    told = {'CollectorName': collection.collector_name,
            'IlluminatorName': collection.illuminator_name,
            'CoreName': collection.core_name,
            'CollectType': collection.collect_type or pulses.collect_type,
            'RadarMode': {'ModeType': collection.mode_type,
                          **({'ModeID': collection.mode_id} if collection.mode_id else {})},
            'Classification': collection.classification,
            'ReleaseInfo': collection.release_info,
            'CountryCode': collection.country_code}
    return {name: value for name, value in told.items() if value}


def _global(pulses: WrittenPulses, vectors: np.ndarray, sign: int) -> dict[str, Any]:
    return {'DomainType': pulses.domain, 'SGN': f'{sign:+d}',
            'Timeline': {'CollectionStart': date_of(pulses.start_ns),
                         'TxTime1': vectors['TxTime'].min(), 'TxTime2': vectors['TxTime'].max()},
            'FxBand': {'FxMin': vectors['FX1'].min(), 'FxMax': vectors['FX2'].max()},
            'TOASwath': {'TOAMin': vectors['TOA1'].min(), 'TOAMax': vectors['TOA2'].max()}}


def _scene(pulses: WrittenPulses, grid: MapGrid) -> dict[str, Any]:
    datum = pulses.datum
    origin = datum.to_ecef(pulses.reference_m)
    half = np.array([grid.n_x, grid.n_y]) * grid.spacing_m / 2
    if max(half) > _LONGEST_AREA_M:
        raise CphdError(f'an area of {2 * half[0]:.3g} by {2 * half[1]:.3g} m is no scene on one '
                        'plane')
    latitude, longitude, height = (float(v) for v in ecef_to_geographic(origin))
    # Clockwise, and on the side of the date line that the reference point is on: a polygon of
    # latitudes and longitudes cannot cross it.
    signs = np.array([(-1, -1), (-1, 1), (1, 1), (1, -1)])
    corners = np.column_stack([signs * half, np.zeros(4)]) + pulses.reference_m
    latitudes, longitudes, _ = datum.to_geographic(corners)
    crossed = np.abs(longitudes - longitude) > 180
    longitudes = np.where(crossed, np.copysign(180.0, longitude), longitudes)
    x_axis, y_axis, _ = datum.axes_ecef
    return {
        'EarthModel': 'WGS_84',
        'IARP': {'ECF': origin, 'LLH': [latitude, longitude, height]},
        'ReferenceSurface': {'Planar': {'uIAX': x_axis, 'uIAY': y_axis}},
        'ImageArea': {'X1Y1': -half, 'X2Y2': half},
        'ImageAreaCornerPoints': np.column_stack([latitudes, longitudes]),
        'ImageGrid': {
            'IARPLocation': [(grid.n_x - 1) / 2, (grid.n_y - 1) / 2],
            'IAXExtent': {'LineSpacing': grid.spacing_m, 'FirstLine': 0, 'NumLines': grid.n_x},
            'IAYExtent': {'SampleSpacing': grid.spacing_m, 'FirstSample': 0,
                          'NumSamples': grid.n_y}}}


def _data(pulses: WrittenPulses, vectors: np.ndarray, collection: Collection,
          sample_type: str) -> dict[str, Any]:
    n_channels, n_vectors = vectors.shape
    signal = n_vectors * pulses.n_samples * SAMPLE_BYTES[sample_type]
    return {
        'SignalArrayFormat': sample_type, 'NumBytesPVP': vectors.itemsize,
        'NumCPHDChannels': n_channels,
        'Channel': [{'Identifier': name, 'NumVectors': n_vectors,
                     'NumSamples': pulses.n_samples, 'SignalArrayByteOffset': i * signal,
                     'PVPArrayByteOffset': i * n_vectors * vectors.itemsize}
                    for i, name in enumerate(collection.channels)],
        'NumSupportArrays': int(pulses.antenna is not None),
        **({} if pulses.antenna is None else {'SupportArray': [pulses.antenna.data()]})}


def _fixed(vectors: np.ndarray, first: str, second: str) -> bool:
    return bool((vectors[first] == vectors[first].flat[0]).all()
                and (vectors[second] == vectors[second].flat[0]).all())


def _channels(pulses: WrittenPulses, vectors: np.ndarray, collection: Collection
              ) -> dict[str, Any]:
    antenna = {} if pulses.antenna is None else {'Antenna': OF_CHANNEL}
    n_vectors = vectors.shape[1]

    def parameters(own: np.ndarray, name: str, polarisation: Any) -> dict[str, Any]:
        low, high = own['FX1'].min(), own['FX2'].max()
        return {'Identifier': name, 'RefVectorIndex': n_vectors // 2,
                'FXFixed': _fixed(own, 'FX1', 'FX2'), 'TOAFixed': _fixed(own, 'TOA1', 'TOA2'),
                'SRPFixed': True, 'SignalNormal': bool((own['SIGNAL'] == 1).all()),
                'Polarization': {'TxPol': polarisation[0], 'RcvPol': polarisation[1]},
                'FxC': (low + high) / 2, 'FxBW': high - low,
                'TOASaved': own['TOA2'].max() - own['TOA1'].min(),
                'DwellTimes': {'CODId': 'all', 'DwellId': 'all'}, **antenna}

    return {'RefChId': collection.channels[0], 'FXFixedCPHD': _fixed(vectors, 'FX1', 'FX2'),
            'TOAFixedCPHD': _fixed(vectors, 'TOA1', 'TOA2'), 'SRPFixedCPHD': True,
            'Parameters': [parameters(*of) for of in zip(
                vectors, collection.channels, collection.polarisations, strict=True)]}


def _layout(pulses: WrittenPulses) -> dict[str, Any]:
    sarkit = require('sarkit.cphd', PURPOSE)
    out: dict[str, Any] = {}
    offset = 0
    for name, kind in pulses.layout.items():
        side = next((element for element, own in PARAMETERS.items() if name in own), None)
        target = out if side is None else out.setdefault(side, {})
        target[name] = {'Offset': offset, 'Size': words(kind),
                        'dtype': sarkit.binary_format_string_to_dtype(kind)}
        offset += words(kind)
    return out


def _dwell(vectors: np.ndarray) -> dict[str, Any]:
    """The whole area was seen all the time that all channels were on."""
    delay = vectors['RcvTime'] - vectors['TxTime']
    to_target = np.linalg.norm(vectors['TxPos'] - vectors['SRPPos'], axis=-1)
    back = np.linalg.norm(vectors['RcvPos'] - vectors['SRPPos'], axis=-1)
    time = vectors['TxTime'] + delay * to_target / (to_target + back)
    first, last = time[:, 0].max(), time[:, -1].min()

    return {'NumCODTimes': 1, 'CODTime': [{'Identifier': 'all',
                                           'CODTimePoly': [[(first + last) / 2]]}],
            'NumDwellTimes': 1, 'DwellTime': [{'Identifier': 'all',
                                               'DwellTimePoly': [[last - first]]}]}


def _reference_geometry(tree: Any, vectors: np.ndarray) -> Any:
    sarkit = require('sarkit.cphd', PURPOSE)
    middle = vectors[0, vectors.shape[1] // 2]
    if not (np.linalg.norm(middle['TxVel']) or np.linalg.norm(middle['RcvVel'])):
        raise CphdError('the phase centres do not move, so that CPHD has no reference geometry '
                        'for them')
    with np.errstate(invalid='ignore', divide='ignore'):
        geometry = sarkit.compute_reference_geometry(tree, vectors[0])
    undefined = {node.tag.rpartition('}')[2]: node for node in geometry.iter()
                 if node.text == 'nan'}
    if undefined.keys() <= {'BistaticAngle', 'BistaticAngleRate'}:
        for node in undefined.values():  # arccos of what rounding put above 1: both ways are one
            node.text = '0.0'
    else:
        raise CphdError('the reference geometry is not defined: a phase centre is at the middle '
                        'of the grid or above it, or moves straight towards, away from or over it')
    _within_limits(geometry)
    return geometry


def _within_limits(geometry: Any) -> None:
    """Angles at an end of what the schema allows, by rounding or in the limit, to just inside.

    Tracks that lead straight over the reference have a slope of 90 degrees, which it excludes.
    """
    for node in geometry.iter():
        limit = _ANGLE_LIMITS.get(node.tag.rpartition('}')[2])
        if limit is None or float(node.text) < limit:
            continue
        if float(node.text) > limit + _OVER_LIMIT_DEG:
            raise CphdError(f'{node.tag.rpartition("}")[2]} of the reference geometry is '
                            f'{float(node.text):.3g} degrees; CPHD allows less than {limit:g}')
        node.text = repr(math.nextafter(limit, 0.0))


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
        Blocks of one radar, in the order of their times, with phase centres.
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
        self._looks: list[Pointing] = []

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
        tx_m, rx_m = block.centres_m
        delay_s = reference_delays(tx_m, rx_m, self._reference_m)
        samples = self._turned(block, delay_s)
        amplitude = np.empty(delay_s.shape)
        for channel, file in enumerate(self.files):
            own = samples[:, channel]
            amplitude[:, channel] = full_scale(own, self._sample_type)
            file.write(encode(own, amplitude[:, channel], self._sign,
                              self._sample_type).tobytes())
        self._told.append((block.stamp_ns, tx_m, rx_m, amplitude,
                           np.asarray(block.samples.any(axis=-1))))
        if block.pointing is not None:
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

    def pulses(self, pattern: AntennaPattern | None) -> WrittenPulses:
        """What was written, without its samples."""
        if not self._told:
            raise CphdError('there is no pulse to write')
        antenna = None
        if pattern is not None:
            if len(self._looks) < len(self._told):
                raise CphdError('pulses do not tell where the antenna looked; give them their '
                                'pointing, or leave the antenna out')
            antenna = WrittenAntenna.of(pattern, Pointing.join(self._looks), self._datum)
        stamp_ns, tx_m, rx_m, amplitude, has_signal = map(np.concatenate,
                                                          zip(*self._told, strict=True))
        return WrittenPulses(
            self.radar, self._n_samples, self._domain, self._datum, self._reference_m, stamp_ns,
            tx_m, rx_m, None if self._sample_type == 'CF8' else amplitude, has_signal, antenna)


def _assemble(path: Path, tree: Any, vectors: np.ndarray, collection: Collection, spool: _Spool,
              antenna: WrittenAntenna | None) -> None:
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
