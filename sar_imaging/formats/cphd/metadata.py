"""Metadata of written files: CPHD 1.1.0, every mandatory element, computed from the pulses."""

from __future__ import annotations

import math

import numpy as np

import sar_imaging

from ...geometry.earth import ecef_to_geographic
from ...geometry.grids import MapGrid
from ..extras import require
from .antennas.writing import OF_CHANNEL, PARAMETERS
from .collection import Collection, start_of
from .container import PURPOSE, CphdError
from .parameters import Pulses, words

NAMESPACE = 'http://api.nsgreg.nga.mil/schema/cphd/1.1.0'
SAMPLE_BYTES = {'CI2': 2, 'CI4': 4, 'CF8': 8}
_LONGEST_AREA_M = 1e6
# Degrees that angles of the reference geometry have to stay below.
_ANGLE_LIMITS = {'GrazeAngle': 90.0, 'IncidenceAngle': 90.0, 'SlopeAngle': 90.0,
                 'DopplerConeAngle': 180.0, 'BistaticAngle': 180.0, 'AzimuthAngle': 360.0,
                 'LayoverAngle': 360.0}
_OVER_LIMIT_DEG = 0.5  # between the Earth's normal and the line from its centre


def make_metadata(pulses: Pulses, vectors: np.ndarray, grid: MapGrid, collection: Collection,
                  sample_type: str, sign: int):
    """Metadata of a file of some pulses.

    Parameters
    ----------
    pulses : Pulses
        What is written.
    vectors : (C, P) structured array
        Their parameters, of `vector_parameters`.
    grid : MapGrid
        Area that the file is meant for; its middle is the reference point.
    collection : Collection
        Names and kinds, of every channel.
    sample_type : {'CI2', 'CI4', 'CF8'}
        Of the samples.
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


def _collection(collection: Collection, pulses: Pulses) -> dict:
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


def _global(pulses: Pulses, vectors: np.ndarray, sign: int) -> dict:
    return {'DomainType': pulses.domain, 'SGN': f'{sign:+d}',
            'Timeline': {'CollectionStart': start_of(pulses.start_ns),
                         'TxTime1': vectors['TxTime'].min(), 'TxTime2': vectors['TxTime'].max()},
            'FxBand': {'FxMin': vectors['FX1'].min(), 'FxMax': vectors['FX2'].max()},
            'TOASwath': {'TOAMin': vectors['TOA1'].min(), 'TOAMax': vectors['TOA2'].max()}}


def _scene(pulses: Pulses, grid: MapGrid) -> dict:
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


def _data(pulses: Pulses, vectors: np.ndarray, collection: Collection, sample_type: str) -> dict:
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


def _channels(pulses: Pulses, vectors: np.ndarray, collection: Collection) -> dict:
    antenna = {} if pulses.antenna is None else {'Antenna': OF_CHANNEL}
    n_vectors = vectors.shape[1]

    def parameters(own, name, polarisation):
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


def _layout(pulses: Pulses) -> dict:
    sarkit = require('sarkit.cphd', PURPOSE)
    out, offset = {}, 0
    for name, kind in pulses.layout.items():
        side = next((element for element, own in PARAMETERS.items() if name in own), None)
        target = out if side is None else out.setdefault(side, {})
        target[name] = {'Offset': offset, 'Size': words(kind),
                        'dtype': sarkit.binary_format_string_to_dtype(kind)}
        offset += words(kind)
    return out


def _dwell(vectors: np.ndarray) -> dict:
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


def _reference_geometry(tree, vectors: np.ndarray):
    sarkit = require('sarkit.cphd', PURPOSE)
    middle = vectors[0, vectors.shape[1] // 2]
    if not (np.linalg.norm(middle['TxVel']) or np.linalg.norm(middle['RcvVel'])):
        raise CphdError('the phase centres do not move, so that CPHD has no reference geometry '
                        'for them')
    with np.errstate(invalid='ignore', divide='ignore'):
        geometry = sarkit.compute_reference_geometry(tree, vectors[0])
    if any(node.text == 'nan' for node in geometry.iter()):
        raise CphdError('the reference geometry is not defined: a phase centre is at the middle '
                        'of the grid or above it, or moves straight towards, away from or over it')
    _within_limits(geometry)
    return geometry


def _within_limits(geometry) -> None:
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
