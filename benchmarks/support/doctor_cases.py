"""Random right recordings, and the faults that the campaign of the doctor injects into them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from sar_imaging.diagnosis.hypotheses import with_offset, with_slope
from sar_imaging.diagnosis.signals.samples import with_words_exchanged
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.echoes import EchoSimulator, quantise

from .mistake_recordings import DATA, MEASURED

KINDS = ('slider', 'rail', 'drone', 'uwb')
_START_NS = 1_700_000_000_000_000_000
_REAL = (Waveform.FMCW_REAL, Waveform.PASSBAND)


@dataclasses.dataclass(frozen=True)
class Case:
    """A recording of one aperture and where its scene is.

    Parameters
    ----------
    kind : str
        One of `KINDS`, or the name of a measured recording.
    block : PulseBlock
        Raw pulses with phase centres.
    grid : MapGrid
        Its scene.
    window : str
        Of the range compression.
    attitude : Rotation or None
        Of the platform at each pulse.
    """

    kind: str
    block: PulseBlock
    grid: MapGrid
    window: str = 'none'
    attitude: Rotation | None = None


def right_case(seed: int) -> Case:
    """A random recording without fault: radar, track, scene, noise and converter."""
    rng = np.random.default_rng([seed, 22])
    kind = KINDS[seed % len(KINDS)]
    radar, n_samples, range_m, track, rate_hz = _MAKERS[kind](rng)
    half = (0.08 if kind == 'drone' else 0.16) * range_m  # what its antenna sees
    spacing = max(0.4 * radar.range_resolution_m, 2 * half / 160)
    grid = MapGrid.from_size((0.0, range_m, 0.0), 2 * half, 2 * half, spacing)
    n_scatterers = int(rng.integers(4, 25))
    points = np.c_[rng.uniform(-0.9, 0.9, (n_scatterers, 2)) * half + [0.0, range_m],
                   np.zeros(n_scatterers)]
    amplitudes = rng.rayleigh(0.6, n_scatterers) * np.exp(2j * np.pi * rng.random(n_scatterers))
    amplitudes[:2] *= 2.5 / np.abs(amplitudes[:2])
    n_channels = 1 if radar.waveform == Waveform.PASSBAND else int(rng.integers(1, 5))
    places = (np.arange(n_channels) - (n_channels - 1) / 2) * rng.uniform(0.5, 2.0)
    centres = track[:, None] + places[:, None] * radar.wavelength_m * np.array([1.0, 0.0, 0.0])
    samples = EchoSimulator(radar, n_samples, compressed=False, points_m=points,
                            amplitudes=amplitudes)(centres, centres)
    rms = math.sqrt(np.mean(np.square(np.abs(samples))))
    noise = 10 ** (rng.uniform(-6.0, 3.0) / 20) * rms
    samples = samples + noise / math.sqrt(2) * (
        rng.standard_normal(samples.shape) + 1j * rng.standard_normal(samples.shape))
    if radar.waveform in _REAL:
        samples = samples.real
    largest = max(np.abs(samples.real).max(), np.abs(samples.imag).max())
    scale = 2.0 ** math.ceil(math.log2(largest * rng.uniform(1.0, 3.0)))
    samples = quantise(samples + 0j, int(rng.integers(10, 17)), scale)
    jitter_s = rng.uniform(0.0, 2e-6, len(track))  # of a radar that stamps its own pulses
    stamps = _START_NS + np.rint(1e9 * (np.arange(len(track)) / rate_hz + jitter_s)
                                 ).astype(np.int64)
    block = PulseBlock(radar, False, stamps, np.arange(len(track)) + int(rng.integers(1000)),
                       samples, centres, centres)
    return Case(kind, block, grid, attitude=turning(kind, seed, len(track)))


def turning(kind: str, seed: int, n: int) -> Rotation:
    """Attitudes of a platform at n pulses: of a slider and a rail mostly its yaw, by a degree."""
    rng = np.random.default_rng([seed, 23])
    time = np.linspace(0.0, 1.0, n)[:, None]
    waves = sum(rng.standard_normal(3) * np.sin(
        2 * np.pi * (rng.uniform(0.6, 1.2, 3) * k * time + rng.random(3))) for k in (1, 2, 3))
    guided = kind in ('slider', 'rail', 'arcsar', 'mimo')
    rms_deg = rng.uniform(0.3, 1.0) * np.array([0.3, 0.3, 1.0]) if guided else rng.uniform(
        1.5, 4.0, 3)
    return Rotation.from_rotvec(np.radians(rms_deg) * waves / waves.std(axis=0))


def measured_cases() -> Iterator[Case]:
    """The measured recordings, loaded as `sar-imaging load` does; none where they are absent."""
    if DATA.is_dir():
        for make in MEASURED.values():
            recording = make()
            yield Case(recording.name, recording.block, recording.grid, recording.window)


def _track(rng, n: int, length_m: float, height_m: float, wander: float) -> np.ndarray:
    """Along x, not quite uniform and not quite straight."""
    u = np.linspace(-0.5, 0.5, n)
    a, b, c = rng.uniform(0, 2 * np.pi, 3)
    # speed varies by some tens of per cent: a constant one hides errors of the clock
    x = length_m * (u + rng.uniform(0.04, 0.08) * np.sin(2 * np.pi * u * rng.uniform(1, 2) + a))
    return np.c_[x, wander * np.sin(2 * np.pi * rng.uniform(0.8, 2.0) * u + b),
                 height_m + wander * np.sin(2 * np.pi * rng.uniform(0.8, 2.0) * u + c)]


def _slider(rng):
    start = rng.choice([60e9, 77e9])
    radar = fmcw_parameters(start_frequency_hz=start, slope_hz_per_s=rng.uniform(40e12, 80e12),
                            sample_rate_hz=5e6, n_samples=256, adc_start_s=6e-6)
    n = int(rng.integers(320, 480))
    range_m = rng.uniform(2.0, 5.0)
    track = _track(rng, n, n * 0.24 * radar.wavelength_m, rng.uniform(0.1, 0.5), 1e-3)
    return radar, 256, range_m, track, rng.uniform(50, 500)


def _rail(rng):
    radar = fmcw_parameters(start_frequency_hz=24e9, slope_hz_per_s=rng.uniform(8e12, 15e12),
                            sample_rate_hz=2.5e6, n_samples=256, adc_start_s=6e-6,
                            **({'real_samples': True} if rng.random() < 0.3 else {}))
    n = int(rng.integers(320, 480))
    range_m = rng.uniform(6.0, 15.0)
    track = _track(rng, n, n * 0.3 * radar.wavelength_m, rng.uniform(0.5, 2.0), 4e-3)
    return radar, 256, range_m, track, rng.uniform(20, 200)


def _drone(rng):
    bandwidth = rng.uniform(150e6, 400e6)
    rate = 1.25 * bandwidth
    pulse_s = rng.uniform(0.4e-6, 0.8e-6)
    range_m = rng.uniform(250.0, 600.0)
    half = 0.2 * range_m
    start = 2 * (range_m - half) / SPEED_OF_LIGHT
    n_samples = int(math.ceil((pulse_s + 4 * half / SPEED_OF_LIGHT) * rate / 2) * 2)
    sign = rng.choice([-1, 1])
    radar = RadarParameters(rng.choice([5.4e9, 9.6e9]), bandwidth, rate, start, pulse_s,
                            sign * bandwidth / pulse_s, Waveform.LFM)
    n = int(rng.integers(240, 360))
    # pulses as close as the width of the scene demands
    track = _track(rng, n, n * rng.uniform(1.5, 3.0) * radar.wavelength_m,
                   rng.uniform(30.0, 100.0), 0.5)
    return radar, n_samples, range_m, track, rng.uniform(50, 200)


def _uwb(rng):
    radar = RadarParameters(3.95e9, 1.5e9, 16.384e9, 2 * 2.0 / SPEED_OF_LIGHT,
                            waveform=Waveform.PASSBAND)
    n = int(rng.integers(240, 400))
    range_m = rng.uniform(6.0, 11.0)
    track = _track(rng, n, rng.uniform(4.0, 8.0), rng.uniform(0.5, 4.0), 0.05)
    return radar, 1536, range_m, track, rng.uniform(20, 100)


_MAKERS = {'slider': _slider, 'rail': _rail, 'drone': _drone, 'uwb': _uwb}


class NotApplicable(Exception):
    """The recording cannot have this fault."""


def _with(case: Case, **changes) -> Case:
    return dataclasses.replace(case, block=dataclasses.replace(case.block, **changes))


def _complex_only(case: Case) -> None:
    if case.block.radar.waveform in _REAL:
        raise NotApplicable


def conjugated(case, rng):
    """Q before I, or the other sign of Q."""
    _complex_only(case)
    samples = case.block.samples
    return _with(case, samples=samples.conj() if rng.random() < 0.5
                 else samples.imag + 1j * samples.real)


def inverted(case, rng):
    """The ramp falls where it is said to rise."""
    if not case.block.radar.chirp_rate_hz_per_s or case.block.radar.waveform in _REAL:
        raise NotApplicable  # real samples hold both signs
    return dataclasses.replace(case, block=with_slope(case.block, -1.0))


def clipped(case, rng):
    """The converter's full scale is 1.3 to 3 times the rms of the samples."""
    samples = case.block.samples
    rms = math.sqrt(np.mean(np.square(samples.real), dtype=float))
    limit = rng.uniform(1.3, 3.0) * rms
    if limit > 0.8 * np.abs(samples.real).max():
        limit = 0.8 * np.abs(samples.real).max()
    return _with(case, samples=samples.real.clip(-limit, limit)
                 + 1j * samples.imag.clip(-limit, limit))


def lost(case, rng):
    """Pulses lost in some gaps; their numbers tell it."""
    block = case.block
    keep = np.ones(block.n_pulses, bool)
    for _ in range(int(rng.integers(1, 6))):
        start = int(rng.integers(4, block.n_pulses - 12))
        keep[start:start + int(rng.integers(1, 8))] = False
    return dataclasses.replace(case, block=block.select(keep))


def lost_uncounted(case, rng):
    """Pulses lost, and numbered by the program that received the others."""
    case = lost(case, rng)
    return _with(case, counter=np.arange(case.block.n_pulses))


def wrong_slope(case, rng):
    """The slope of the ramp is 10 to 30 per cent off."""
    if not case.block.radar.chirp_rate_hz_per_s:
        raise NotApplicable
    sign = -1 if case.kind == 'drone' else rng.choice([-1, 1])  # else it is sampled too slowly
    factor = 1 + sign * rng.uniform(0.1, 0.3)
    return dataclasses.replace(case, block=with_slope(case.block, factor))


def clock_drift(case, rng):
    """The clocks of pulses and positions run 5 to 20 per cent apart."""
    rate = 1 + rng.choice([-1, 1]) * rng.uniform(0.05, 0.2)
    return dataclasses.replace(case, block=with_offset(case.block, 0.0, rate))


def receipt(case, rng):
    """Stamps of a computer that serves the radar's data when it has time."""
    block = case.block
    interval = float(np.median(np.diff(block.stamp_ns)))
    late = rng.exponential(rng.uniform(0.1, 0.6), block.n_pulses) * interval
    stamps = np.maximum.accumulate(block.stamp_ns + late.astype(np.int64))
    return _with(case, stamp_ns=stamps)


def frame_stamps(case, rng):
    """All pulses of a frame have its time."""
    frame = int(rng.integers(4, 33))
    index = np.arange(case.block.n_pulses) // frame * frame
    return _with(case, stamp_ns=case.block.stamp_ns[index])


def _channels(case: Case) -> int:
    if case.block.n_channels < 2:
        raise NotApplicable
    return case.block.n_channels


def unbalanced(case, rng):
    """One channel 4 to 12 dB louder or fainter than the others."""
    n = _channels(case)
    gain = np.ones(n, np.float32)
    gain[int(rng.integers(n))] = 10 ** (rng.choice([-1, 1]) * rng.uniform(4, 12) / 20)
    return _with(case, samples=case.block.samples * gain[:, None])


def dead(case, rng):
    """One channel holds the noise of its converter alone."""
    n = _channels(case)
    samples = case.block.samples.copy()
    at = int(rng.integers(n))
    level = 1e-3 * np.abs(samples).std()
    samples[:, at] = level * (rng.standard_normal(samples[:, at].shape)
                              + 1j * rng.standard_normal(samples[:, at].shape))
    return _with(case, samples=samples)


def coupled(case, rng):
    """Antennas couple 6 to 30 dB above the strongest echo, nearest to the radar."""
    block, radar = case.block, case.block.radar
    away = radar.range_start_m + 0.1 * (case.grid.centre_m[1] - radar.range_start_m)
    still = np.zeros((1, 1, 3))
    coupling = EchoSimulator(radar, block.n_samples, compressed=False,
                             points_m=[[0.0, max(away, 0.3), 0.0]],
                             amplitudes=[1.0])(still, still)
    added = dataclasses.replace(block, samples=np.repeat(coupling, block.n_pulses, axis=0).repeat(
        block.n_channels, axis=1).astype(np.complex64))
    echo, one = (_peak(b) for b in (block, added))
    level = 10 ** (rng.uniform(6, 30) / 20) * echo / one
    return _with(case, samples=block.samples + (level * added.samples).astype(np.complex64))


def _peak(block: PulseBlock) -> float:
    """Largest magnitude of the range profiles."""
    return float(np.abs(RangeCompressor.for_block(block)(block).samples).max())


def axes(case, rng):
    """Positions of another frame: x and y exchanged."""
    return _with(case, tx_m=case.block.tx_m[..., [1, 0, 2]], rx_m=case.block.rx_m[..., [1, 0, 2]])


def clock_offset(case, rng):
    """The clocks of pulses and positions are a fifth to a third of the aperture apart."""
    block = case.block
    shift = int(rng.uniform(0.2, 0.33) * block.n_pulses) * int(rng.choice([-1, 1]))
    some = block.select(slice(max(0, shift), block.n_pulses + min(0, shift)))
    moved = block.select(slice(max(0, -shift), block.n_pulses - max(0, shift)))
    back = (moved.tx_m - some.tx_m).mean(axis=(0, 1))  # the scene stays where it is
    return dataclasses.replace(case, block=dataclasses.replace(
        some, stamp_ns=moved.stamp_ns, counter=moved.counter, samples=moved.samples,
        tx_m=some.tx_m + back, rx_m=some.rx_m + back))


def outside(case, rng):
    """The scene lies beyond the window of range that was recorded."""
    far = case.block.n_samples * case.block.radar.sample_spacing_m
    centre = np.array(case.grid.centre_m)
    away = centre - case.block.tx_m.mean(axis=(0, 1))
    away[2] = 0.0
    distance = np.linalg.norm(away)
    centre += max(3 * far / distance, 5) * away
    return dataclasses.replace(case, grid=dataclasses.replace(case.grid, centre_m=tuple(centre)))


def words(case, rng):
    """Words of I and Q in another order."""
    _complex_only(case)
    return _with(case, samples=with_words_exchanged(case.block.samples))


def unequal(case, rng):
    """Gain and phase of Q differ from those of I."""
    _complex_only(case)
    gain = 1 + rng.choice([-1, 1]) * rng.uniform(0.1, 0.4)
    phase = rng.choice([-1, 1]) * rng.uniform(0.1, 0.4)
    samples = case.block.samples
    q = gain * (samples.imag * math.cos(phase) + samples.real * math.sin(phase))
    return _with(case, samples=samples.real + 1j * q)


def without_q(case, rng):
    """Only I was recorded."""
    _complex_only(case)
    return _with(case, samples=case.block.samples.real + 0j)


def magnitudes(case, rng):
    """The driver published magnitudes, as that of the BGT60 does unless told otherwise."""
    return _with(case, samples=np.abs(case.block.samples) + 0j)


def phases(case, rng):
    """Cables of one channel differ in length: its phase is 60 to 180 degrees off."""
    n = _channels(case)
    turn = np.ones(n, np.complex64)
    turn[int(rng.integers(n))] = np.exp(1j * rng.choice([-1, 1]) * rng.uniform(np.pi / 3, np.pi))
    _complex_only(case)
    return _with(case, samples=case.block.samples * turn[:, None])


def incomplete(case, rng):
    """Some pulses lost their last packets."""
    samples = case.block.samples.copy()
    n = int(rng.integers(1, 12))
    start = int(rng.uniform(0.3, 0.9) * samples.shape[2])
    samples[rng.integers(0, len(samples), n), :, start:] = 0
    return _with(case, samples=samples)


def interfered(case, rng):
    """Another radar in a few pulses."""
    samples = case.block.samples.copy()
    at = rng.integers(0, len(samples), int(rng.integers(1, 8)))
    level = 10 ** (rng.uniform(14, 30) / 20) * math.sqrt(np.mean(np.square(np.abs(samples))))
    noise = rng.standard_normal((len(at), *samples.shape[1:], 2)) / math.sqrt(2)
    real = case.block.radar.waveform in _REAL
    samples[at] += (level * (noise[..., 0] + (0 if real else 1j) * noise[..., 1])
                    ).astype(np.complex64)
    return _with(case, samples=samples)


def lever_arm(case, rng):
    """The antenna is 0.3 to 0.8 m beside the point that the poses are of."""
    block = case.block
    attitude = case.attitude or turning(case.kind, int(rng.integers(1000)), block.n_pulses)
    arm = rng.standard_normal(3)
    moved = attitude.apply(rng.uniform(0.3, 0.8) / np.linalg.norm(arm) * arm)
    moved = (moved - moved.mean(axis=0))[:, None]
    return dataclasses.replace(_with(case, tx_m=block.tx_m - moved, rx_m=block.rx_m - moved),
                               attitude=attitude)


# Each fault and the findings that name it.
FAULTS: dict[str, tuple[Callable, tuple[str, ...]]] = {
    'I and Q exchanged': (conjugated, ('samples conjugated',)),
    'spectrum inverted': (inverted, ('sign of the slope', 'samples conjugated')),
    'clipping': (clipped, ('clipping',)),
    'lost pulses': (lost, ('lost pulses',)),
    'lost pulses, not counted': (lost_uncounted, ('lost pulses without gaps in their numbers',)),
    # a slope scales ranges as a clock scales the track: either focuses the other's mistake
    'wrong slope': (wrong_slope, ('wrong slope', 'clock drift')),
    'clocks drift apart': (clock_drift, ('clock drift', 'wrong slope')),
    'stamps of receipt': (receipt, ('stamps of receipt',)),
    'stamps of frames': (frame_stamps, ('stamps of frames',)),
    'unbalanced channel': (unbalanced, ('unbalanced channels',)),
    'dead channel': (dead, ('dead channel',)),
    'coupling': (coupled, ('coupling',)),
    'x and y exchanged': (axes, ('x and y exchanged', 'scene outside the window')),
    'clock offset': (clock_offset, ('clock offset',)),
    'scene outside the window': (outside, ('scene outside the window',)),
    'words in another order': (words, ('order of I and Q',)),
    'unequal I and Q': (unequal, ('unequal I and Q',)),
    'Q missing': (without_q, ('real samples',)),
    'magnitudes only': (magnitudes, ('magnitudes only',)),
    'phase of a channel': (phases, ('phases of channels',)),
    'incomplete pulses': (incomplete, ('incomplete pulses',)),
    'interference': (interfered, ('interference',)),
    'lever arm': (lever_arm, ('lever arm',)),
}
# Faults that show in the image alone, or in where the scene is.
OF_IMAGES = ('I and Q exchanged', 'spectrum inverted', 'wrong slope', 'clocks drift apart',
             'x and y exchanged', 'clock offset', 'scene outside the window',
             'phase of a channel', 'lever arm')
