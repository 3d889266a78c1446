# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The XML of a SICD file, computed from the acquisition (NGA.STND.0024-1, sections 3 and 4).

In the antenna's frame x is our right, y is down and z the boresight (NGA.STND.0024-1, section 3,
Antenna). SICD has no tables: where the polynomial misses the gain, the file and the log tell by
how much. Frames that turn too quickly for polynomials of time are left out.

Scale factors turn the power of pixels into calibrated brightness: the power times a polynomial's
value at its place is the quantity (NGA.STND.0024-1, section 3, Radiometric). The polynomials are
fitted to `sar_imaging.radiometry` at 33 x 33 pixels.
"""

from __future__ import annotations

import dataclasses
import datetime
import functools
import json
import logging
from collections.abc import Sequence
from typing import Any

import numpy as np

from ... import __version__
from ...geometry.earth import Datum
from ...imaging.image import Image
from ...imaging.radiometry import Radiometry
from ...radiometry import ImageResponse, KnotResponse, RadarConstant, brightness, noise_equivalent
from ...radiometry.brightness import quantities_of
from ...signal.radar import SPEED_OF_LIGHT, Waveform
from ..acquisition import UNKNOWN, Acquisition
from ..cphd.antennas.writing import TOLD_DB, WrittenAntenna
from ..extras import require
from .layout import SicdLayout
from .track import Track, evaluate

_logger = logging.getLogger(__name__)

_ORDER = 5
_TURNED = 0.05  # of the antenna's width, by which axes may depart from their polynomials


@dataclasses.dataclass(frozen=True, eq=False)
class TwoWayAntenna:
    """Polynomials of an antenna.

    Attributes
    ----------
    x_axis, y_axis : (3, n) float64
        Axes of its frame, ECEF, by powers of seconds since the start.
    gain_db : (n, n) float64
        Gain of both ways relative to the boresight, by powers of the direction cosines DCX and
        DCY.
    error_db : float
        Largest departure of that where the gain of one way is above -10 dB.
    """

    x_axis: np.ndarray
    y_axis: np.ndarray
    gain_db: np.ndarray
    error_db: float


def two_way_antenna(acquisition: Acquisition, datum: Datum,
                    pulse_s: np.ndarray) -> TwoWayAntenna | None:
    """Antenna of an acquisition; None where it tells none that SICD can hold.

    Parameters
    ----------
    acquisition : Acquisition
        With its antenna and pointing, where they are known.
    datum : Datum
        Place of the imaging frame.
    pulse_s : (P,) float64
        Times of the pulses, seconds since the start of the collection.
    """
    if acquisition.antenna is None or acquisition.pointing is None:
        return None
    try:
        own = WrittenAntenna.of(acquisition.antenna, acquisition.pointing, datum)
    except ValueError:  # no gain on boresight
        return None
    order, width = min(_ORDER, len(pulse_s) - 1), acquisition.antenna.azimuth.width_rad
    axes = []
    for values in (own.x_axis, own.y_axis):
        fits = [np.polynomial.Polynomial.fit(pulse_s, part, order) for part in values.T]
        if max(np.abs(fit(pulse_s) - part).max()
               for fit, part in zip(fits, values.T, strict=True)) > _TURNED * width:
            return None
        powers = [fit.convert().coef for fit in fits]
        axes.append(np.stack([np.pad(part, (0, order + 1 - len(part))) for part in powers]))
    lobe = own.polynomial
    if 2 * lobe.error_db > TOLD_DB:
        _logger.warning(
            'the polynomial of the antenna departs by up to %.2g dB from its gain of both ways '
            'above -20 dB, and SICD has no tables: CPHD of the pulses has one', 2 * lobe.error_db)
    x_axis, y_axis = axes
    return TwoWayAntenna(x_axis, y_axis, 2 * lobe.coefficients, 2 * lobe.error_db)


def antenna_element(own: TwoWayAntenna, carrier_hz: float) -> dict[str, Any]:
    """Element of the antenna."""
    return {'TwoWay': {'XAxisPoly': own.x_axis.T, 'YAxisPoly': own.y_axis.T,
                       'FreqZero': carrier_hz,
                       'Array': {'GainPoly': own.gain_db, 'PhasePoly': [[0.0]]}}}


_KNOTS = 33  # along a side of the image
_HIGHEST_ORDER = 6
_WANTED_DB, _LARGEST_DB = 0.002, 0.05  # residual at which to stop, and above which to refuse
_BRIGHT = 0.1  # of the largest amplitude: what is darker is not fitted
_NAMES = {'rcs': 'RCSSFPoly', 'sigma0': 'SigmaZeroSFPoly', 'beta0': 'BetaZeroSFPoly',
          'gamma0': 'GammaZeroSFPoly'}


@dataclasses.dataclass(frozen=True, eq=False)
class Radiometric:
    """Polynomials by metres from the scene centre point along rows and columns.

    Attributes
    ----------
    factors : dict of str to (n, n) float64
        By quantity, for the power of SICD's pixels; those of the ground not in the slant plane.
    noise_db : (n, n) float64 or None
        Power of noise in a pixel, dB; None where it is not known.
    residual_db : float
        Largest departure from what was fitted, dB.
    """

    factors: dict[str, np.ndarray]
    noise_db: np.ndarray | None
    residual_db: float


def radiometric(image: Image, layout: SicdLayout, response: ImageResponse | KnotResponse,
                constant: RadarConstant, scale: float | None) -> Radiometric:
    """Scale factors of an image, calibrated or not.

    Parameters
    ----------
    image : Image
        Its `radiometry` tells whether its samples are calibrated already.
    layout : SicdLayout
        Layout of the image.
    response : ImageResponse or KnotResponse
        Response of the same pixels, or of some of them.
    constant : RadarConstant
        Constant of the radar.
    scale : float or None
        What samples were multiplied by in the file.

    Raises
    ------
    ValueError
        The response is of another image, or varies too much for polynomials.
    """
    some, index = _knots(response)
    shape = tuple(int(part.max()) + 1 for part in index)
    if shape != image.shape:
        raise ValueError(f'the response is for an image of {shape}, this one has {image.shape}; '
                         'expected that of the image')
    unit = {name: brightness(np.ones(some.amplitude.shape), some, constant, name)
            for name in quantities_of(some)}
    told = image.radiometry
    noise = noise_equivalent(some, constant, 'rcs') / unit['rcs']  # of a sample as formed
    stored = 1.0 if scale is None else scale**2
    if told is not None:
        if abs(told.gain_m / constant.gain - 1) > 1e-6:
            raise ValueError(f'the image was calibrated with gain {told.gain_m:g}, the constant '
                             f'has {constant.gain:g}; expected the same constant')
        noise = noise * unit[told.quantity]
        unit = {name: value / unit[told.quantity] for name, value in unit.items()}
    fit = _Fit(layout, image.grid.positions(*index)
               - layout.scp_m, some.amplitude > _BRIGHT * np.nanmax(some.amplitude))
    factors = {name: fit(value / stored) for name, value in unit.items()}
    known = np.isfinite(constant.noise_power) and constant.noise_power > 0
    noise_db = fit.decibels(10 * np.log10(noise * stored)) if known else None
    if fit.residual_db > _LARGEST_DB:
        raise ValueError(
            f'the scale factors vary so much over the image that polynomials miss them by '
            f'{fit.residual_db:.2g} dB: calibrate the image (sar_imaging.radiometry.calibrated) '
            'before it is written, then its factors are smooth; or write a smaller one')
    return Radiometric(factors, noise_db, fit.residual_db)


def _knots(response: ImageResponse | KnotResponse) -> tuple[ImageResponse, tuple[Any, ...]]:
    """Response at some pixels, and their rows (K_y, 1) and columns (1, K_x)."""
    if isinstance(response, KnotResponse):
        return response.values, np.ix_(response.rows, response.columns)
    index = np.ix_(*(np.unique(np.linspace(0, n - 1, min(n, _KNOTS)).round().astype(int))
                     for n in response.amplitude.shape))
    return ImageResponse(**{field.name: getattr(response, field.name)[index]
                            for field in dataclasses.fields(response)}), index


class _Fit:
    """Fits polynomials of as low an order as leaves 0.002 dB; keeps the largest residual."""

    def __init__(self, layout: SicdLayout, offset_m: np.ndarray, bright: np.ndarray):
        self._bright = bright
        places = offset_m[bright] @ layout.axes.T
        self._scales = np.maximum(np.abs(places).max(axis=0), 1e-3)
        self._places = places / self._scales
        self.residual_db = 0.0

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """(n, n) coefficients for positive values, whose relative error counts."""
        return self._fitted(values[self._bright], relative=True)

    def decibels(self, values: np.ndarray) -> np.ndarray:
        """(n, n) coefficients for values in dB."""
        return self._fitted(values[self._bright], relative=False)

    def _fitted(self, values: np.ndarray, *, relative: bool) -> np.ndarray:
        for order in range(_HIGHEST_ORDER + 1):
            n = order + 1
            matrix = np.polynomial.polynomial.polyvander2d(
                self._places[:, 0], self._places[:, 1], [order] * 2)
            weight = 1 / values if relative else np.ones(len(values))
            found = np.linalg.lstsq(matrix * weight[:, None], values * weight, rcond=None)[0]
            ratio = np.maximum(matrix @ found * weight, 1e-9)
            missed_db = np.abs(10 * np.log10(ratio) if relative
                               else matrix @ found - values).max()
            if missed_db < _WANTED_DB:
                break
        self.residual_db = max(self.residual_db, float(missed_db))
        powers = np.arange(n)
        return found.reshape(n, n) / np.multiply.outer(self._scales[0] ** powers,
                                                       self._scales[1] ** powers)


def radiometric_element(own: Radiometric) -> dict[str, Any]:
    """Element of the scale factors."""
    noise = {} if own.noise_db is None else {'NoiseLevel': {
        'NoiseLevelType': 'ABSOLUTE', 'NoisePoly': own.noise_db}}
    return {**noise, **{_NAMES[name]: factor for name, factor in own.factors.items()}}


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
        Amplitudes of the pixel type with a table.
    scale : float or None
        What our samples were multiplied by, where they were.
    classification : str
        Classification of the file.
    radiometric : Radiometric or None
        Scale factors of the pixels, where they are known.
    calibrated : Radiometry or None
        What the squared magnitude of the pixels is, where the image was calibrated.
    """

    layout: SicdLayout
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


def sicd_tree(description: Description) -> Any:
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


def _collection(own: Description) -> dict[str, Any]:
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


def _creation(own: Description) -> dict[str, Any]:
    return {'Application': f'sar_imaging {__version__}',
            'DateTime': datetime.datetime.now(datetime.timezone.utc)}


def _corners(layout: SicdLayout) -> list[tuple[int, int]]:
    rows, columns = layout.shape
    return [(0, 0), (0, columns - 1), (rows - 1, columns - 1), (rows - 1, 0)]


def _image_data(own: Description) -> dict[str, Any]:
    size = dict(zip(('NumRows', 'NumCols'), own.layout.shape, strict=True))
    return {'PixelType': own.pixel_type,
            **({} if own.amplitudes is None else {'AmpTable': own.amplitudes}), **size,
            'FirstRow': 0, 'FirstCol': 0, 'FullImage': size,
            'SCPPixel': [int(n) for n in own.layout.scp_pixel],
            'ValidData': _corners(own.layout)}


def _geo_data(own: Description) -> dict[str, Any]:
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


def _up(geographic: Sequence[float | np.ndarray]) -> np.ndarray:
    latitude, longitude = np.radians(geographic[0]), np.radians(geographic[1])
    return np.array([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude),
                     np.sin(latitude)])


def _grid(own: Description) -> dict[str, Any]:
    polynomials = _local_spectra(own)
    return {'ImagePlane': own.layout.plane, 'Type': 'PLANE',
            'TimeCOAPoly': [[own.track.middle_s]],
            'Row': _direction(own, 0, polynomials[0]), 'Col': _direction(own, 1, polynomials[1])}


def _direction(own: Description, axis: int, polynomial: np.ndarray) -> dict[str, Any]:
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


def _spectrum_ends(layout: SicdLayout, axis: int, polynomial: np.ndarray) -> tuple[float, float]:
    """DeltaK1 and DeltaK2: the spectra of all corners, or all there is where they wrap around."""
    corners = (np.array(_corners(layout)) - layout.scp_pixel) * layout.spacing_m
    offsets = np.polynomial.polynomial.polyval2d(corners[:, 0], corners[:, 1], polynomial)
    half, edge = layout.supports[axis].bandwidth / 2, 0.5 / layout.spacing_m[axis]
    low, high = offsets.min() - half, offsets.max() + half
    return (float(low), float(high)) if -edge <= low and high <= edge else (-edge, edge)


def _timeline(own: Description) -> dict[str, Any]:
    track, last = own.track, own.acquisition.n_pulses - 1
    interval = (track.pulse_s[-1] - track.pulse_s[0]) / last
    line = [-track.pulse_s[0] / interval, 1 / interval]
    even = np.abs(line[0] + line[1] * track.pulse_s - np.arange(last + 1)).max() < 0.1
    pulses = {'@index': 1, 'TStart': track.pulse_s[0], 'TEnd': track.duration_s, 'IPPStart': 0,
              'IPPEnd': last, 'IPPPoly': line}
    return {'CollectStart': track.start, 'CollectDuration': track.duration_s,
            **({'IPP': {'@size': 1, 'Set': [pulses]}} if even else {})}


def _position(own: Description) -> dict[str, Any]:
    track = own.track
    if not track.bistatic:
        return {'ARPPoly': track.arp.T}
    return {'ARPPoly': track.arp.T, 'GRPPoly': own.datum.to_ecef(own.layout.scp_m)[None],
            'TxAPCPoly': track.tx.T, 'RcvAPC': [track.rx.T]}


def _radar_collection(own: Description) -> dict[str, Any]:
    low, high = _band(own.acquisition)
    polarisation = own.acquisition.polarisation
    channel = {'@index': 1, 'TxRcvPolarization': polarisation,
               **({'RcvAPCIndex': 1} if own.track.bistatic else {})}
    return {'TxFrequency': {'Min': low, 'Max': high}, **_waveform(own.acquisition),
            'TxPolarization': polarisation.split(':')[0],
            'RcvChannels': {'@size': 1, 'ChanParameters': [channel]}}


def _waveform(acquisition: Acquisition) -> dict[str, Any]:
    """The pulse, where it is a chirp of known length that sweeps the band."""
    radar = acquisition.radar
    swept = abs(radar.chirp_rate_hz_per_s) * radar.pulse_length_s
    if radar.waveform != Waveform.LFM or not 0.99 < swept / radar.bandwidth_hz < 1 + 1e-9:
        return {}
    return {'Waveform': {'@size': 1, 'WFParameters': [{
        '@index': 1, 'TxPulseLength': radar.pulse_length_s, 'TxRFBandwidth': swept,
        'TxFreqStart': radar.carrier_hz - radar.chirp_rate_hz_per_s * radar.pulse_length_s / 2,
        'TxFMRate': radar.chirp_rate_hz_per_s}]}}


def _image_formation(own: Description) -> dict[str, Any]:
    low, high = _band(own.acquisition)
    return {'RcvChanProc': {'NumChanProc': 1, 'ChanIndex': [1]},
            'TxRcvPolarizationProc': own.acquisition.polarisation,
            'TStartProc': own.track.pulse_s[0], 'TEndProc': own.track.duration_s,
            'TxFrequencyProc': {'MinProc': low, 'MaxProc': high}, 'ImageFormAlgo': 'OTHER',
            'STBeamComp': 'NO', 'ImageBeamComp': 'NO', 'AzAutofocus': 'NO', 'RgAutofocus': 'NO',
            'Processing': [{'Type': 'Backprojection', 'Applied': True}]}


def _band(acquisition: Acquisition) -> tuple[float, float]:
    """Ends of the band, hertz."""
    low, high = acquisition.wavenumbers_per_m
    return low * SPEED_OF_LIGHT / 2, high * SPEED_OF_LIGHT / 2


_PARTS = {'CollectionInfo': _collection, 'ImageCreation': _creation, 'ImageData': _image_data,
          'GeoData': _geo_data, 'Grid': _grid, 'Timeline': _timeline, 'Position': _position,
          'RadarCollection': _radar_collection, 'ImageFormation': _image_formation}
