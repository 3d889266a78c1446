"""Estimates of channel errors from range profiles: at a reflector, or from the scene as a whole.

Errors of a channel are relative to the others: amplitudes have the geometric mean 1, phases the
mean 0, delays the mean 0. What all channels share is a matter of the radar's range bias.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy import fft

from ..geometry.track_frame import main_axis
from ..signal.calibration import ChannelCalibration
from ..signal.pulses import PulseBlock
from ..signal.spectra import band_spectrum
from .backprojection import Backprojector

COHERENT = 0.5  # share of the strongest component from which channel images count as alike
_PADDING = 16
_STANDS_OUT = 10.0  # power of a reflector's peak over the mean power at all ranges
_ITERATIONS = 300
_SETTLED_RAD = 1e-3
_BRIGHT_PIXELS = 8192
_SLOPES = 1441


def calibrate_at_reflector(profiles: PulseBlock, position_m, *,
                           search_m: float | None = None) -> ChannelCalibration:
    """Errors of the channels from the echo of one strong reflector at a known place.

    The pulses of each channel are focused to the place at every frequency of the band; the
    transform of that is the channel's range response around the reflector, whose peak tells
    amplitude, phase and delay.

    Parameters
    ----------
    profiles : PulseBlock
        Range profiles with phase centres.
    position_m : (3,) array_like
        Of the reflector, metres. An error of the place moves the relative phases by the
        difference of its paths to the channels.
    search_m : float, optional
        Largest range error of a channel, metres; by default four resolution cells.

    Returns
    -------
    ChannelCalibration
        Relative errors; removing them makes the channels alike at this place.

    Raises
    ------
    ValueError
        There is no pulse, the place lies outside the profiles, or a channel has no peak there
        that stands out by 10 dB.
    """
    radar = profiles.radar
    if profiles.n_pulses == 0:
        raise ValueError('the block has no pulse to calibrate with')
    frequency, spectra = band_spectrum(profiles)
    place = np.asarray(position_m, float)
    path_m = (np.linalg.norm(profiles.tx_m - place, axis=-1)
              + np.linalg.norm(profiles.rx_m - place, axis=-1))
    end_m = radar.range_start_m + (profiles.n_samples - 1) * radar.sample_spacing_m
    if path_m.min() / 2 < radar.range_start_m or path_m.max() / 2 > end_m:
        raise ValueError(f'the reflector is {path_m.min() / 2:.2f} to {path_m.max() / 2:.2f} m '
                         f'away, the profiles cover {radar.range_start_m:.2f} to {end_m:.2f} m')
    speed = radar.propagation_speed_m_per_s
    cycles = path_m[..., None] / speed * frequency
    response = np.mean(spectra * np.exp(2j * np.pi * np.remainder(cycles, 1.0)), axis=0)
    baseband = frequency - radar.carrier_hz
    limit_m = 4 * radar.range_resolution_m if search_m is None else search_m
    delay_s = np.array([_peak_delay(r, baseband, limit_m, speed) for r in response])
    value = np.sum(response * np.exp(2j * np.pi * delay_s[:, None] * baseband), axis=1)
    return _relative(np.abs(value), np.angle(value), delay_s)


def _peak_delay(response: np.ndarray, baseband_hz: np.ndarray, limit_m: float,
                speed_m_per_s: float) -> float:
    """Delay of the highest magnitude of a channel's response within a range, seconds."""
    n = fft.next_fast_len(_PADDING * response.size)
    step_s = 1.0 / (n * (baseband_hz[1] - baseband_hz[0]))
    magnitude = np.abs(fft.ifft(response, n))
    reach = min(int(2 / speed_m_per_s * limit_m / step_s), n // 2 - 1)
    near = np.roll(magnitude, reach)[:2 * reach + 1]
    top = int(near.argmax())
    stands_out = near[top] ** 2 > _STANDS_OUT * np.mean(magnitude**2)
    if top in (0, 2 * reach) or not stands_out:
        raise ValueError(f'a channel has no peak within {limit_m:.3f} m of the '
                         'reflector that stands out; check its position, or search farther')
    low, middle, high = near[top - 1:top + 2]
    return (top - reach + 0.5 * (low - high) / (low - 2 * middle + high)) * step_s


def find_reflector(profiles: PulseBlock, points_m) -> np.ndarray:
    """Place of the strongest reflector, whatever the errors of the channels.

    Parameters
    ----------
    profiles : PulseBlock
        Range profiles with phase centres.
    points_m : (..., 3) array_like
        Where to look, at most half a resolution cell apart, metres.

    Returns
    -------
    (3,) float64
        The point where the powers of the channels' own images add up to most, metres.
    """
    points_m = np.asarray(points_m, float).reshape(-1, 3)
    images = _channel_images(profiles, points_m)
    power = np.sum(np.square(np.abs(images), dtype=float), axis=0)
    return points_m[int(power.argmax())]


@dataclasses.dataclass(frozen=True)
class Balance:
    """Result of `balance_channels`.

    Attributes
    ----------
    calibration : ChannelCalibration
        Relative errors of the channels.
    method : str
        ``'coherence'`` or ``'sharpness'``.
    coherence : float
        Share of the strongest common component in the channels' images, 1 / C to 1.
    peak_gain_db : float
        Brightest pixel of the image of all channels, after over before, dB.
    """

    calibration: ChannelCalibration
    method: str
    coherence: float
    peak_gain_db: float


def balance_channels(profiles: PulseBlock, points_m, *, passes: int = 2) -> Balance:
    """Errors of the channels from the scene itself: no reflector needs to be known.

    Where each channel's own aperture resolves the scene, their images are alike but for the
    errors: the strongest eigenvector of their covariance holds them (method 'coherence'). Where
    only the array together resolves it, those phases are taken that make the image of all
    channels sharpest, by repeating ``w_c <- phase of sum_x conj(I_c) F |F|^2`` with F the weighted
    sum of the channel images I_c, which never lowers ``sum |F|^4`` (method 'sharpness'). A phase
    that is linear along the array turns the whole image and is not for the scene to tell: it is
    left at zero then, so that the array goes on looking where its geometry says.

    Delays follow from the phases in the two halves of the band.

    Parameters
    ----------
    profiles : PulseBlock
        Range profiles with phase centres.
    points_m : (..., 3) array_like
        Pixels of the scene, half a resolution cell apart or less where it is bright, metres.
        Azimuth ambiguities of bright scatterers should lie outside: their phases differ from
        channel to channel.
    passes : int
        Estimates in a row, each with the errors found so far removed.

    Returns
    -------
    Balance

    Raises
    ------
    ValueError
        There are fewer than two channels, or no echo in the pixels.
    """
    if profiles.n_channels < 2:
        raise ValueError('one channel has nothing to be balanced against')
    points_m = np.asarray(points_m, float).reshape(-1, 3)
    images = _channel_images(profiles, points_m)
    before = np.abs(images.sum(axis=0)).max()
    method, coherence = '', 0.0
    array_m = 0.5 * (profiles.tx_m + profiles.rx_m).mean(axis=0)
    total, current = ChannelCalibration.none(profiles.n_channels), profiles
    for _ in range(passes):
        if method == '':
            coherence = _coherence(images)
            method = 'coherence' if coherence >= COHERENT else 'sharpness'
        found = _estimate(current, images, points_m, method, array_m)
        total = _relative_of(total.followed_by(found))
        current = total.apply(profiles)
        images = _channel_images(current, points_m)
    gain_db = 20 * math.log10(np.abs(images.sum(axis=0)).max() / before)
    return Balance(total, method, coherence, gain_db)


def _estimate(profiles, images, points_m, method, array_m) -> ChannelCalibration:
    """One estimate: phases of the whole band, delays from those of its halves."""
    amplitude, phase = _amplitude_and_phase(images, method, array_m)
    halves, separation_hz = _half_bands(profiles)
    low, high = (_amplitude_and_phase(_channel_images(half, points_m), method, array_m)[1]
                 for half in halves)
    turn = np.angle(np.exp(1j * (high - low)))
    return _relative(amplitude, phase, -turn / (2 * np.pi * separation_hz))


def _amplitude_and_phase(images, method, array_m) -> tuple[np.ndarray, np.ndarray]:
    """Of each channel, from images of shape (C, X)."""
    amplitude = np.sqrt(np.mean(np.square(np.abs(images), dtype=float), axis=1))
    if not amplitude.all():
        raise ValueError('a channel has no echo in the pixels given; choose brighter ones')
    scaled = images / amplitude[:, None]
    if method == 'coherence':
        _, vectors = np.linalg.eigh(_covariance(scaled))
        return amplitude, np.angle(vectors[:, -1])
    power = np.sum(np.square(np.abs(scaled)), axis=0)
    bright = np.argsort(power)[-_BRIGHT_PIXELS:]  # what is dark has no say in a fourth power
    scaled = np.ascontiguousarray(scaled[:, bright], np.complex64)
    weights, pointing = np.ones(len(images), complex), _Pointing(array_m)
    for _ in range(_ITERATIONS):
        # einsum: products this small are not worth the threads of a matrix product
        image = np.einsum('c,cx->x', weights.astype(np.complex64), scaled)
        new = np.einsum('x,cx->c', (image * np.square(np.abs(image))).conj(), scaled)
        new = pointing.remove(np.exp(-1j * np.angle(new)))
        moved = np.abs(new - weights).max()
        weights = new
        if moved < _SETTLED_RAD:
            break
    return amplitude, -np.angle(weights)


class _Pointing:
    """Removes from phasors of the channels what only turns the array's view.

    Parameters
    ----------
    array_m : (C, 3) float64
        Mean phase centre of each channel, metres.
    """

    def __init__(self, array_m: np.ndarray):
        centred = array_m - array_m.mean(axis=0)
        axes, extent = main_axis(array_m)
        self._steering = []
        for axis in axes[extent > 1e-3 * extent[0]] if extent[0] > 0 else ():
            place = centred @ axis
            spacing = np.diff(np.unique(np.round(place, 9))).min()
            slopes = np.linspace(-math.pi, math.pi, _SLOPES) / spacing
            self._steering.append(np.exp(1j * np.outer(slopes, place)))

    def remove(self, weights: np.ndarray) -> np.ndarray:
        """Phasors without mean phase and without what is linear along the array."""
        for steering in self._steering:
            sums = np.einsum('sc,c->s', steering, weights)
            weights = weights * steering[int(np.abs(sums).argmax())]
        return weights * np.exp(-1j * np.angle(weights.sum()))


def _half_bands(profiles: PulseBlock) -> tuple[tuple[PulseBlock, PulseBlock], float]:
    """Profiles of the lower and the upper half of the band, and how far these are apart, Hz."""
    frequency = fft.fftfreq(profiles.n_samples, 1.0 / profiles.radar.sample_rate_hz)
    spectra = fft.fft(profiles.samples)
    power = np.sum(np.square(np.abs(spectra), dtype=float), axis=(0, 1))
    middle = float(np.sum(power * frequency) / power.sum())
    halves, centres = [], []
    for inside in (frequency < middle, frequency >= middle):
        halves.append(dataclasses.replace(
            profiles, samples=fft.ifft(spectra * inside).astype(np.complex64)))
        centres.append(float(np.sum(power * frequency * inside) / np.sum(power * inside)))
    return (halves[0], halves[1]), centres[1] - centres[0]


def _channel_images(profiles: PulseBlock, points_m: np.ndarray) -> np.ndarray:
    """(C, X) complex64 images of the channels."""
    plan = Backprojector(points_m, profiles.radar, profiles.n_samples, target_db=-50.0,
                         per_channel=True)
    return plan(profiles)


def _covariance(images: np.ndarray) -> np.ndarray:
    return (images @ images.conj().T).astype(complex) / images.shape[1]


def _coherence(images: np.ndarray) -> float:
    """Share of the strongest component in images of equal power."""
    covariance = _covariance(images)
    power = np.sqrt(np.diag(covariance).real)
    if not power.all():
        raise ValueError('a channel has no echo in the pixels given; choose brighter ones')
    values = np.linalg.eigvalsh(covariance / np.outer(power, power))
    return float(values[-1] / values.sum())


def _relative(amplitude, phase_rad, delay_s) -> ChannelCalibration:
    """Errors relative to the channels' mean."""
    phasor = np.exp(1j * np.asarray(phase_rad))
    phase = np.angle(phasor * np.conj(phasor.mean()))
    return ChannelCalibration(amplitude / np.exp(np.mean(np.log(amplitude))), phase,
                              delay_s - np.mean(delay_s))


def _relative_of(calibration: ChannelCalibration) -> ChannelCalibration:
    return _relative(calibration.amplitude, calibration.phase_rad, calibration.delay_s)
