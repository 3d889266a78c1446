"""The XML of a SICD file, computed from the acquisition (NGA.STND.0024-1, sections 3 and 4)."""

from __future__ import annotations

import dataclasses
import datetime
import functools
import json

import numpy as np

from ... import __version__
from ...geometry.earth import Datum
from ...imaging.radiometry import Radiometry
from ...signal.radar import SPEED_OF_LIGHT, Waveform
from ..acquisition import UNKNOWN, Acquisition
from ..extras import require
from .antenna import TwoWayAntenna, antenna_element, two_way_antenna
from .layout import Layout
from .radiometric import Radiometric, radiometric_element
from .track import Track, evaluate

MONOSTATIC, BISTATIC = 'urn:SICD:1.3.0', 'urn:SICD:1.4.0'
DATUM, SCALE, RESIDUAL = ('sar_imaging datum', 'sar_imaging amplitude scale',
                          'sar_imaging track residual, metres')
CALIBRATED, FACTORS_RESIDUAL = 'sar_imaging radiometry', 'sar_imaging scale factor residual, dB'
ANTENNA_RESIDUAL = 'sar_imaging antenna gain residual, dB'
_SPECTRUM_ORDER = 3  # of the polynomials of the local spectra


@dataclasses.dataclass(frozen=True, eq=False)
class Description:
    """All that the XML is computed from.

    Attributes
    ----------
    layout, track, acquisition, datum :
        Of the image.
    pixel_type : str
        As SICD names it.
    amplitudes : (256,) float64 or None
        Of the pixel type with a table.
    scale : float or None
        What our samples were multiplied by, where they were.
    classification : str
        Of the file.
    radiometric : Radiometric or None
        Scale factors of the pixels, where they are known.
    calibrated : Radiometry or None
        What the squared magnitude of the pixels is, where the image was calibrated.
    """

    layout: Layout
    track: Track
    acquisition: Acquisition
    datum: Datum
    pixel_type: str
    amplitudes: np.ndarray | None
    scale: float | None
    classification: str
    radiometric: Radiometric | None = None
    calibrated: Radiometry | None = None

    @functools.cached_property
    def antenna(self) -> TwoWayAntenna | None:
        """Antenna of monostatic images, where it is known and polynomials can tell it."""
        return None if self.track.bistatic else two_way_antenna(self.acquisition, self.datum,
                                                                self.track.pulse_s)


def sicd_tree(description: Description):
    """Tree of elements of one file, with what is computed of the scene centre point."""
    etree, sicd = (require(name, 'writing SICD') for name in ('lxml.etree', 'sarkit.sicd'))
    namespace = BISTATIC if description.track.bistatic else MONOSTATIC
    root = etree.Element(f'{{{namespace}}}SICD', nsmap={None: namespace})
    file = sicd.ElementWrapper(root)
    file.from_dict({name: part(description) for name, part in _PARTS.items()})
    file['SCPCOA'] = sicd.compute_scp_coa(root.getroottree())
    if description.radiometric is not None:
        file['Radiometric'] = radiometric_element(description.radiometric)
    if description.antenna is not None:
        file['Antenna'] = antenna_element(description.antenna,
                                          description.acquisition.radar.carrier_hz)
    return root.getroottree()


def _collection(own: Description) -> dict:
    acquisition, track = own.acquisition, own.track
    name = acquisition.name or f'{acquisition.collector}_{track.start:%Y%m%dT%H%M%S%f}'
    datum = json.dumps(dataclasses.asdict(own.datum))
    parameters = {DATUM: datum, RESIDUAL: f'{track.residual_m:.2g}',
                  SCALE: None if own.scale is None else repr(own.scale),
                  CALIBRATED: own.calibrated and json.dumps(dataclasses.asdict(own.calibrated)),
                  FACTORS_RESIDUAL: own.radiometric and f'{own.radiometric.residual_db:.2g}',
                  ANTENNA_RESIDUAL: own.antenna and f'{own.antenna.error_db:.2g}'}
    illuminator = acquisition.illuminator or (UNKNOWN if track.bistatic else '')
    return {'CollectorName': acquisition.collector,
            **({'IlluminatorName': illuminator} if illuminator else {}), 'CoreName': name,
            'CollectType': 'BISTATIC' if track.bistatic else 'MONOSTATIC',
            'RadarMode': {'ModeType': 'SPOTLIGHT'},  # all pulses in each pixel
            'Classification': own.classification,
            'Parameter': [(key, text) for key, text in parameters.items() if text is not None]}


def _creation(own: Description) -> dict:
    return {'Application': f'sar_imaging {__version__}',
            'DateTime': datetime.datetime.now(datetime.timezone.utc)}


def _corners(layout: Layout) -> list[tuple[int, int]]:
    rows, columns = layout.shape
    return [(0, 0), (0, columns - 1), (rows - 1, columns - 1), (rows - 1, 0)]


def _image_data(own: Description) -> dict:
    size = dict(zip(('NumRows', 'NumCols'), own.layout.shape, strict=True))
    return {'PixelType': own.pixel_type,
            **({} if own.amplitudes is None else {'AmpTable': own.amplitudes}), **size,
            'FirstRow': 0, 'FirstCol': 0, 'FullImage': size,
            'SCPPixel': [int(n) for n in own.layout.scp_pixel],
            'ValidData': _corners(own.layout)}


def _geo_data(own: Description) -> dict:
    places = np.column_stack(own.datum.to_geographic(_ground_corners(own))[:2])
    return {'EarthModel': 'WGS_84',
            'SCP': {'ECF': own.datum.to_ecef(own.layout.scp_m),
                    'LLH': own.datum.to_geographic(own.layout.scp_m)},
            'ImageCorners': places, 'ValidData': places}


def _ground_corners(own: Description) -> np.ndarray:
    """(4, 3) corners, carried along the slant plane's normal onto the horizontal at the middle.

    That is how SICD projects corners of an image that lies on no ground (NGA.STND.0024-1, 2.6).
    """
    places = own.layout.position(*np.array(_corners(own.layout)).T)
    own_up = own.datum.vectors_from_ecef(_up(own.datum.to_geographic(own.layout.scp_m)))
    arp, velocity = _aperture_centre(own)
    normal = np.cross(own.layout.scp_m - arp, velocity)
    normal /= np.linalg.norm(normal)
    height = (places - own.layout.scp_m) @ own_up
    return places - (height / (normal @ own_up))[:, None] * normal


def _aperture_centre(own: Description) -> tuple[np.ndarray, np.ndarray]:
    middle = own.track.middle_s
    velocity = evaluate(np.polynomial.polynomial.polyder(own.track.arp, axis=1), middle)
    return (own.datum.from_ecef(evaluate(own.track.arp, middle)),
            own.datum.vectors_from_ecef(velocity))


def _up(geographic) -> np.ndarray:
    latitude, longitude = np.radians(geographic[0]), np.radians(geographic[1])
    return np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude),
                     np.sin(latitude)])


def _grid(own: Description) -> dict:
    polynomials = _local_spectra(own)
    return {'ImagePlane': own.layout.plane, 'Type': 'PLANE',
            'TimeCOAPoly': [[own.track.middle_s]],
            'Row': _direction(own, 0, polynomials[0]), 'Col': _direction(own, 1, polynomials[1])}


def _direction(own: Description, axis: int, polynomial: np.ndarray) -> dict:
    """Row or Col of the grid, with the spectrum of the scene centre point and of the corners."""
    layout = own.layout
    own_support = layout.supports[axis]
    low, high = _spectrum_ends(layout, axis, polynomial)
    return {'UVectECF': own.datum.vectors_to_ecef(layout.axes[axis]),
            'SS': layout.spacing_m[axis], 'ImpRespWid': own_support.width_m, 'Sgn': -1,
            'ImpRespBW': own_support.bandwidth, 'KCtr': layout.centre_per_m[axis],
            'DeltaK1': low, 'DeltaK2': high, 'DeltaKCOAPoly': polynomial,
            'WgtType': {'WindowName': UNKNOWN}, 'WgtFunct': own_support.weights}


def _local_spectra(own: Description) -> np.ndarray:
    """(2, 4, 4) polynomials of the centre of the local spectrum less KCtr, by metres from SCP."""
    layout = own.layout
    ends = [(np.linspace(0, n - 1, 9) - middle) * step for n, middle, step in zip(
        layout.shape, layout.scp_pixel, layout.spacing_m, strict=True)]
    rows, columns = (part.ravel() for part in np.meshgrid(*ends, indexing='ij'))
    points = layout.scp_m + rows[:, None] * layout.axes[0] + columns[:, None] * layout.axes[1]
    values = layout.offsets(own.acquisition, points)
    scales = [np.abs(part).max() for part in (rows, columns)]
    n = _SPECTRUM_ORDER + 1
    vandermonde = np.polynomial.polynomial.polyvander2d(rows / scales[0], columns / scales[1],
                                                        [_SPECTRUM_ORDER] * 2)
    fits = np.linalg.lstsq(vandermonde, values.T, rcond=None)[0].T.reshape(2, n, n)
    return fits / np.multiply.outer(scales[0] ** np.arange(n), scales[1] ** np.arange(n))


def _spectrum_ends(layout: Layout, axis: int, polynomial: np.ndarray) -> tuple[float, float]:
    """DeltaK1 and DeltaK2: the spectra of all corners, or all there is where they wrap around."""
    corners = (np.array(_corners(layout)) - layout.scp_pixel) * layout.spacing_m
    offsets = np.polynomial.polynomial.polyval2d(*corners.T, polynomial)
    half, edge = layout.supports[axis].bandwidth / 2, 0.5 / layout.spacing_m[axis]
    low, high = offsets.min() - half, offsets.max() + half
    return (float(low), float(high)) if -edge <= low and high <= edge else (-edge, edge)


def _timeline(own: Description) -> dict:
    track, last = own.track, own.acquisition.n_pulses - 1
    interval = (track.pulse_s[-1] - track.pulse_s[0]) / last
    line = [-track.pulse_s[0] / interval, 1 / interval]
    even = np.abs(line[0] + line[1] * track.pulse_s - np.arange(last + 1)).max() < 0.1
    pulses = {'@index': 1, 'TStart': track.pulse_s[0], 'TEnd': track.duration_s, 'IPPStart': 0,
              'IPPEnd': last, 'IPPPoly': line}
    return {'CollectStart': track.start, 'CollectDuration': track.duration_s,
            **({'IPP': {'@size': 1, 'Set': [pulses]}} if even else {})}


def _position(own: Description) -> dict:
    track = own.track
    if not track.bistatic:
        return {'ARPPoly': track.arp.T}
    return {'ARPPoly': track.arp.T, 'GRPPoly': own.datum.to_ecef(own.layout.scp_m)[None],
            'TxAPCPoly': track.tx.T, 'RcvAPC': [track.rx.T]}


def _radar_collection(own: Description) -> dict:
    low, high = _band(own.acquisition)
    polarisation = own.acquisition.polarisation
    channel = {'@index': 1, 'TxRcvPolarization': polarisation,
               **({'RcvAPCIndex': 1} if own.track.bistatic else {})}
    return {'TxFrequency': {'Min': low, 'Max': high}, **_waveform(own.acquisition),
            'TxPolarization': polarisation.split(':')[0],
            'RcvChannels': {'@size': 1, 'ChanParameters': [channel]}}


def _waveform(acquisition: Acquisition) -> dict:
    """The pulse, where it is a chirp of known length that sweeps the band."""
    radar = acquisition.radar
    swept = abs(radar.chirp_rate_hz_per_s) * radar.pulse_length_s
    if radar.waveform != Waveform.LFM or not 0.99 < swept / radar.bandwidth_hz < 1 + 1e-9:
        return {}
    return {'Waveform': {'@size': 1, 'WFParameters': [{
        '@index': 1, 'TxPulseLength': radar.pulse_length_s, 'TxRFBandwidth': swept,
        'TxFreqStart': radar.carrier_hz - radar.chirp_rate_hz_per_s * radar.pulse_length_s / 2,
        'TxFMRate': radar.chirp_rate_hz_per_s}]}}


def _image_formation(own: Description) -> dict:
    low, high = _band(own.acquisition)
    return {'RcvChanProc': {'NumChanProc': 1, 'ChanIndex': [1]},
            'TxRcvPolarizationProc': own.acquisition.polarisation,
            'TStartProc': own.track.pulse_s[0], 'TEndProc': own.track.duration_s,
            'TxFrequencyProc': {'MinProc': low, 'MaxProc': high}, 'ImageFormAlgo': 'OTHER',
            'STBeamComp': 'NO', 'ImageBeamComp': 'NO', 'AzAutofocus': 'NO', 'RgAutofocus': 'NO',
            'Processing': [{'Type': 'Backprojection', 'Applied': True}]}


def _band(acquisition: Acquisition) -> tuple[float, float]:
    """Ends of the band, hertz."""
    return tuple(k * SPEED_OF_LIGHT / 2 for k in acquisition.wavenumbers_per_m)


_PARTS = {'CollectionInfo': _collection, 'ImageCreation': _creation, 'ImageData': _image_data,
          'GeoData': _geo_data, 'Grid': _grid, 'Timeline': _timeline, 'Position': _position,
          'RadarCollection': _radar_collection, 'ImageFormation': _image_formation}
