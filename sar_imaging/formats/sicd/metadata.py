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
from .elements import Elements
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
    sicd = require('sarkit.sicd', 'writing SICD')
    bistatic = description.track.bistatic
    make = Elements(BISTATIC if bistatic else MONOSTATIC)
    root = make('SICD', *(part(make, description) for part in (
        _collection, _creation, _image_data, _geo_data, _grid, _timeline, _position,
        _radar_collection, _image_formation)))
    root.append(sicd.compute_scp_coa(root.getroottree()))
    if description.radiometric is not None:
        root.append(radiometric_element(make, description.radiometric))
    if description.antenna is not None:
        root.append(antenna_element(make, description.antenna,
                                    description.acquisition.radar.carrier_hz))
    return root.getroottree()


def _collection(make: Elements, own: Description):
    acquisition, track = own.acquisition, own.track
    name = acquisition.name or f'{acquisition.collector}_{track.start:%Y%m%dT%H%M%S%f}'
    datum = json.dumps(dataclasses.asdict(own.datum))
    parameters = {DATUM: datum, RESIDUAL: f'{track.residual_m:.2g}',
                  SCALE: None if own.scale is None else repr(own.scale),
                  CALIBRATED: own.calibrated and json.dumps(dataclasses.asdict(own.calibrated)),
                  FACTORS_RESIDUAL: own.radiometric and f'{own.radiometric.residual_db:.2g}',
                  ANTENNA_RESIDUAL: own.antenna and f'{own.antenna.error_db:.2g}'}
    illuminator = acquisition.illuminator or (UNKNOWN if track.bistatic else '')
    return make('CollectionInfo', make('CollectorName', acquisition.collector),
                make('IlluminatorName', illuminator) if illuminator else None,
                make('CoreName', name),
                make('CollectType', 'BISTATIC' if track.bistatic else 'MONOSTATIC'),
                make('RadarMode', make('ModeType', 'SPOTLIGHT')),  # all pulses in each pixel
                make('Classification', own.classification),
                *(make('Parameter', text, name=key) for key, text in parameters.items()
                  if text is not None))


def _creation(make: Elements, own: Description):
    return make('ImageCreation', make('Application', f'sar_imaging {__version__}'),
                make('DateTime', datetime.datetime.now(datetime.timezone.utc)))


def _corners(layout: Layout) -> list[tuple[int, int]]:
    rows, columns = layout.shape
    return [(0, 0), (0, columns - 1), (rows - 1, columns - 1), (rows - 1, 0)]


def _image_data(make: Elements, own: Description):
    rows, columns = own.layout.shape
    size = (make('NumRows', rows), make('NumCols', columns))
    table = None if own.amplitudes is None else make.indexed('AmpTable', [
        make('Amplitude', float(value), index=i) for i, value in enumerate(own.amplitudes)])
    return make('ImageData', make('PixelType', own.pixel_type), table, *size,
                make('FirstRow', 0), make('FirstCol', 0),
                make('FullImage', make('NumRows', rows), make('NumCols', columns)),
                make.pixel('SCPPixel', *own.layout.scp_pixel),
                make.indexed('ValidData', [make.pixel('Vertex', *corner, index=i + 1)
                                           for i, corner in enumerate(_corners(own.layout))]))


def _geo_data(make: Elements, own: Description):
    labels = ('1:FRFC', '2:FRLC', '3:LRLC', '4:LRFC')
    places = np.column_stack(own.datum.to_geographic(_ground_corners(own))[:2])
    llh = [float(part) for part in own.datum.to_geographic(own.layout.scp_m)]
    return make(
        'GeoData', make('EarthModel', 'WGS_84'),
        make('SCP', make.vector('ECF', own.datum.to_ecef(own.layout.scp_m)),
             make.vector('LLH', llh, ('Lat', 'Lon', 'HAE'))),
        make('ImageCorners', *(make.vector('ICP', place, ('Lat', 'Lon'), index=label)
                               for label, place in zip(labels, places, strict=True))),
        make.indexed('ValidData', [make.vector('Vertex', place, ('Lat', 'Lon'), index=i + 1)
                                   for i, place in enumerate(places)]))


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


def _grid(make: Elements, own: Description):
    layout = own.layout
    polynomials = _local_spectra(own)
    return make('Grid', make('ImagePlane', layout.plane), make('Type', 'PLANE'),
                make.polynomial('TimeCOAPoly', [[own.track.middle_s]]),
                *(_direction(make, own, axis, polynomials[axis]) for axis in range(2)))


def _direction(make: Elements, own: Description, axis: int, polynomial: np.ndarray):
    """Row or Col of the grid, with the spectrum of the scene centre point and of the corners."""
    layout = own.layout
    own_support, spacing = layout.supports[axis], float(layout.spacing_m[axis])
    low, high = _spectrum_ends(layout, axis, polynomial)
    weights = own_support.weights
    return make(
        ('Row', 'Col')[axis],
        make.vector('UVectECF', own.datum.vectors_to_ecef(layout.axes[axis])),
        make('SS', spacing), make('ImpRespWid', own_support.width_m), make('Sgn', -1),
        make('ImpRespBW', own_support.bandwidth),
        make('KCtr', float(layout.centre_per_m[axis])),
        make('DeltaK1', low), make('DeltaK2', high),
        make.polynomial('DeltaKCOAPoly', polynomial),
        make('WgtType', make('WindowName', UNKNOWN)),
        make.indexed('WgtFunct', [make('Wgt', float(weight), index=i + 1)
                                  for i, weight in enumerate(weights)]))


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


def _timeline(make: Elements, own: Description):
    track, last = own.track, own.acquisition.n_pulses - 1
    interval = (track.pulse_s[-1] - track.pulse_s[0]) / last
    line = [-track.pulse_s[0] / interval, 1 / interval]
    even = np.abs(line[0] + line[1] * track.pulse_s - np.arange(last + 1)).max() < 0.1
    pulses = make('Set', make('TStart', float(track.pulse_s[0])), make('TEnd', track.duration_s),
                  make('IPPStart', 0), make('IPPEnd', last),
                  make.polynomial('IPPPoly', line), index=1)
    return make('Timeline', make('CollectStart', track.start),
                make('CollectDuration', track.duration_s),
                make.indexed('IPP', [pulses]) if even else None)


def _position(make: Elements, own: Description):
    track = own.track
    if not track.bistatic:
        return make('Position', make.path('ARPPoly', track.arp))
    scene = own.datum.to_ecef(own.layout.scp_m)[:, None]
    receiver = make('RcvAPC', make.path('RcvAPCPoly', track.rx, index=1), size=1)
    return make('Position', make.path('ARPPoly', track.arp), make.path('GRPPoly', scene),
                make.path('TxAPCPoly', track.tx), receiver)


def _radar_collection(make: Elements, own: Description):
    low, high = _band(own.acquisition)
    polarisation = own.acquisition.polarisation
    index = make('RcvAPCIndex', 1) if own.track.bistatic else None
    return make('RadarCollection', make('TxFrequency', make('Min', low), make('Max', high)),
                _waveform(make, own.acquisition),
                make('TxPolarization', polarisation.split(':')[0]),
                make.indexed('RcvChannels', [make(
                    'ChanParameters', make('TxRcvPolarization', polarisation), index, index=1)]))


def _waveform(make: Elements, acquisition: Acquisition):
    """The pulse, where it is a chirp of known length that sweeps the band."""
    radar = acquisition.radar
    swept = abs(radar.chirp_rate_hz_per_s) * radar.pulse_length_s
    if radar.waveform != Waveform.LFM or not 0.99 < swept / radar.bandwidth_hz < 1 + 1e-9:
        return None
    start = radar.carrier_hz - radar.chirp_rate_hz_per_s * radar.pulse_length_s / 2
    return make.indexed('Waveform', [make(
        'WFParameters', make('TxPulseLength', radar.pulse_length_s), make('TxRFBandwidth', swept),
        make('TxFreqStart', start), make('TxFMRate', radar.chirp_rate_hz_per_s), index=1)])


def _image_formation(make: Elements, own: Description):
    low, high = _band(own.acquisition)
    return make('ImageFormation',
                make('RcvChanProc', make('NumChanProc', 1), make('ChanIndex', 1)),
                make('TxRcvPolarizationProc', own.acquisition.polarisation),
                make('TStartProc', float(own.track.pulse_s[0])),
                make('TEndProc', own.track.duration_s),
                make('TxFrequencyProc', make('MinProc', low), make('MaxProc', high)),
                make('ImageFormAlgo', 'OTHER'), make('STBeamComp', 'NO'),
                make('ImageBeamComp', 'NO'), make('AzAutofocus', 'NO'),
                make('RgAutofocus', 'NO'),
                make('Processing', make('Type', 'Backprojection'), make('Applied', True)))


def _band(acquisition: Acquisition) -> tuple[float, float]:
    """Ends of the band, hertz."""
    return tuple(k * SPEED_OF_LIGHT / 2 for k in acquisition.wavenumbers_per_m)
