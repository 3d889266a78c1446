"""Derive resolution, ambiguities, sampling and data rates from a configuration, in closed form.

A straight track, a stationary scene on the plane of the grid, and the middle of the grid for
what changes over it. Widths are those of a point response at -3 dB.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np

from ..signal.radar import RadarParameters, Waveform
from ..signal.range_compression import RangeCompressor
from ..signal.range_compression.phase_history import GUARD_SAMPLES
from ..signal.waveforms import n_pulse_samples
from ..signal.windows import window as window_weights
from .memory import NodeMemory, node_memory
from .scene import Scene, see_scene
from .settings import Acquisition, Imaging, Machine

SAMPLE_BYTES = 8  # complex64
PHASE_HISTORIES = (Waveform.STEPPED_FREQUENCY, Waveform.FMCW, Waveform.FMCW_REAL)
LEAST_SPEED_M_PER_S = 1e-6  # below it a platform stands still
_WINDOW_BINS = 201
# Pixels and polar samples of which one core makes maps of obstacles, below what was measured.
_OBSTACLES_PER_S = 8e6


@dataclasses.dataclass(frozen=True)
class Derived:
    """What follows from a configuration: resolution, ambiguities, times and memory.

    In metres, seconds, hertz, bytes and direction cosines.

    Parameters
    ----------
    scene : Scene
        What the platform sees of the grid.
    profile_radar : RadarParameters
        Of the range profiles.
    n_profile : int
        Samples of a profile.
    window_m : (2,) floats
        Ranges between which profiles hold whole responses.
    unambiguous_depth_m : float
        Range after which samples of one pulse repeat, ``N c / 2 B`` of a phase history;
        infinite for others.
    unambiguous_range_m : float
        ``c / 2 PRF``.
    range_null_m, range_width_m : float
        Null spacing ``c / (2 B cos psi)`` and width of the response in range, on the ground.
    pulse_spacing_m, aperture_m, aperture_s, aperture_rad : float
        ``v / PRF``; length, duration and angle of the aperture, seen from the grid.
    azimuth_null_m, azimuth_width_m : float
        Null spacing ``lambda / (4 sin(aperture_rad / 2))`` and width in cross-range.
    unambiguous_direction : float
        ``lambda_min / (2 v / PRF)``.
    needed_direction : float
        Of the scene, or of the part of it that the antenna illuminates.
    ambiguity_m : float
        Distance in azimuth after which scatterers repeat, ``lambda R / (2 v / PRF)``.
    least_prf_hz, largest_prf_hz : float
        From direction, and from the length of the recorded window (the largest without a
        second pulse in the air is that of `unambiguous_range_m`).
    input_rate, profile_rate : float
        Bytes per second of samples as they come and as profiles.
    block_bytes, profile_block_bytes : int
        Largest blocks behind pulse_buffer and range_compression.
    aperture_bytes : int
        Profiles of an aperture.
    n_pixels : int
        Of the image or volume.
    imaging_s : float
        Expected work on one image.
    obstacle_map_s : float
        Expected work on its map of obstacles, which a thread of its own makes; 0 of volumes.
    memory : tuple of NodeMemory
        Bounds of the nodes.

    Examples
    --------
    >>> from sar_imaging import MapGrid, RadarParameters
    >>> from sar_imaging.configuration import Acquisition, Imaging, Machine, derive
    >>> radar = RadarParameters(10e9, 300e6, 400e6, first_sample_delay_s=6e-7)
    >>> drone = Acquisition(radar, True, 256, 1, 200.0, (0.0, 0.0, 50.0), (0.0, 8.0, 0.0))
    >>> imaging = Imaging(MapGrid((120.0, 0.0, 0.0), 200, 200, 0.25), pulses_per_aperture=256)
    >>> derived = derive(drone, imaging, Machine(50e6, 'measured', 2 * 2**30))
    >>> print(f'aperture of {derived.aperture_m:.1f} m in {derived.aperture_s:.2f} s')
    aperture of 10.2 m in 1.28 s
    >>> print(f'pulses per second: {derived.least_prf_hz:.0f} at the least')
    pulses per second: 244 at the least
    """

    scene: Scene
    profile_radar: RadarParameters
    n_profile: int
    window_m: tuple[float, float]
    unambiguous_depth_m: float
    unambiguous_range_m: float
    range_null_m: float
    range_width_m: float
    pulse_spacing_m: float
    aperture_m: float
    aperture_s: float
    aperture_rad: float
    azimuth_null_m: float
    azimuth_width_m: float
    unambiguous_direction: float
    needed_direction: float
    ambiguity_m: float
    least_prf_hz: float
    largest_prf_hz: float
    input_rate: float
    profile_rate: float
    block_bytes: int
    profile_block_bytes: int
    aperture_bytes: int
    n_pixels: int
    imaging_s: float
    obstacle_map_s: float
    memory: tuple[NodeMemory, ...]


def derive(acquisition: Acquisition, imaging: Imaging, machine: Machine) -> Derived:
    """Compute what follows from a configuration: resolution, ambiguities, times and memory.

    Parameters
    ----------
    acquisition : Acquisition
        Radar and track.
    imaging : Imaging
        Settings of the nodes.
    machine : Machine
        Where they run.

    Returns
    -------
    Derived

    Raises
    ------
    ValueError
        The platform stands still, or the range compression cannot work with the samples; the
        text says what to change.

    Examples
    --------
    >>> from sar_imaging import MapGrid, RadarParameters
    >>> from sar_imaging.configuration import Acquisition, Imaging, Machine, derive
    >>> radar = RadarParameters(10e9, 300e6, 400e6, first_sample_delay_s=6e-7)
    >>> drone = Acquisition(radar, True, 256, 1, 200.0, (0.0, 0.0, 50.0), (0.0, 8.0, 0.0))
    >>> imaging = Imaging(MapGrid((120.0, 0.0, 0.0), 200, 200, 0.25), pulses_per_aperture=256)
    >>> derived = derive(drone, imaging, Machine(50e6, 'measured', 2 * 2**30))
    >>> print(f'{derived.range_width_m:.2f} m by {derived.azimuth_width_m:.2f} m on the ground')
    0.48 m by 0.17 m on the ground
    """
    a, radar = acquisition, acquisition.radar
    if a.speed_m_per_s < LEAST_SPEED_M_PER_S:
        raise ValueError('the platform stands still: there is no synthetic aperture; give its '
                         'velocity')
    profile_radar, n_profile = plan_profiles(a, imaging)
    scene = see_scene(a, imaging)
    step = a.speed_m_per_s / a.prf_hz
    aperture_rad = _seen_angle(scene, effective_aperture(a, imaging))
    wavelength = radar.wavelength_m
    azimuth_null = _ratio(wavelength, 4 * math.sin(aperture_rad / 2) * scene.across_cosine)
    range_null = _ratio(radar.range_resolution_m, scene.grazing_cosine)
    shortest = radar.shortest_wavelength_m
    needed = scene.direction_extent
    if a.beamwidth_rad:
        needed = min(needed, 2 * math.sin(a.beamwidth_rad / 2))
    pulse = a.n_channels * SAMPLE_BYTES
    blocks = imaging.pulses_per_block * pulse
    n_pixels = imaging.n_pixels
    rows = imaging.pulses_per_aperture * a.n_channels
    return Derived(
        scene=scene, profile_radar=profile_radar, n_profile=n_profile,
        window_m=_window(a, profile_radar, n_profile),
        unambiguous_depth_m=_unambiguous_depth(a),
        unambiguous_range_m=radar.propagation_speed_m_per_s / (2 * a.prf_hz),
        range_null_m=range_null, range_width_m=width_factor(imaging.window) * range_null,
        pulse_spacing_m=step, aperture_m=step * (imaging.pulses_per_aperture - 1),
        aperture_s=imaging.pulses_per_aperture / a.prf_hz, aperture_rad=aperture_rad,
        azimuth_null_m=azimuth_null, azimuth_width_m=width_factor('none') * azimuth_null,
        unambiguous_direction=shortest / (2 * step), needed_direction=needed,
        ambiguity_m=wavelength * scene.range_m / (2 * step),
        least_prf_hz=2 * a.speed_m_per_s * needed / shortest,
        largest_prf_hz=radar.sample_rate_hz / a.n_samples,
        input_rate=a.prf_hz * pulse * a.n_samples, profile_rate=a.prf_hz * pulse * n_profile,
        block_bytes=blocks * a.n_samples, profile_block_bytes=blocks * n_profile,
        aperture_bytes=imaging.pulses_per_aperture * pulse * n_profile, n_pixels=n_pixels,
        imaging_s=n_pixels * rows / machine.rate_per_s,
        obstacle_map_s=_obstacle_map_s(imaging, n_pixels, range_null, azimuth_null),
        memory=node_memory(imaging, n_pixels, block_bytes=blocks * a.n_samples,
                           profile_block_bytes=blocks * n_profile,
                           pulse_bytes=pulse * a.n_samples,
                           aperture_bytes=imaging.pulses_per_aperture * pulse * n_profile))


def plan_profiles(acquisition: Acquisition, imaging: Imaging) -> tuple[RadarParameters, int]:
    """Parameters and samples of the range profiles.

    Raises
    ------
    ValueError
        As `RangeCompressor`.
    """
    plan = RangeCompressor(acquisition.radar, acquisition.n_samples, window=imaging.window,
                           oversampling=imaging.oversampling, range_filter=imaging.range_filter,
                           compressed=acquisition.compressed,
                           range_window_m=imaging.range_window_m)
    return plan.output_radar, plan.n_output


def effective_aperture(acquisition: Acquisition, imaging: Imaging) -> float:
    """Length of a uniform aperture with the main lobe of pulses and array together, metres.

    Phase centres are halfway between the common transmitter and the receivers. Two sincs
    multiplied have the curvature of one whose length is the root of the sum of squares.
    """
    step = acquisition.speed_m_per_s / acquisition.prf_hz
    return math.hypot(imaging.pulses_per_aperture * step,
                      acquisition.n_channels * acquisition.channel_spacing_m / 2
                      if acquisition.n_channels > 1 else 0.0)


@functools.lru_cache(maxsize=64)
def width_factor(window: str) -> float:
    """Width at -3 dB of the response of a windowed band, times the bandwidth.

    Parameters
    ----------
    window : str
        See `sar_imaging.signal.windows`.

    Returns
    -------
    float
        0.886 without a window, 1.303 for Hamming.
    """
    weights = window_weights(window, _WINDOW_BINS)
    frequency = (np.arange(_WINDOW_BINS) - (_WINDOW_BINS - 1) / 2) / _WINDOW_BINS
    low, high = 0.0, 3.0
    for _ in range(50):
        middle = 0.5 * (low + high)
        response = weights @ np.cos(2 * np.pi * frequency * middle) / weights.sum()
        low, high = (middle, high) if response > math.sqrt(0.5) else (low, middle)
    return 2 * low


def _obstacle_map_s(imaging: Imaging, n_pixels: int, *nulls_m: float) -> float:
    """Seconds of work on pixels, and on the samples of the polar image, two in a null spacing."""
    if imaging.volume is not None:
        return 0.0
    samples = math.prod(2 * imaging.grid.spacing_m / null for null in nulls_m) * n_pixels
    return (n_pixels + samples) / _OBSTACLES_PER_S


def _ratio(a: float, b: float) -> float:
    """Quotient of two positive numbers, infinite where nothing is resolved."""
    return a / b if b > 1e-9 * a else math.inf


def _seen_angle(scene: Scene, length_m: float) -> float:
    """Angle of an aperture seen from the middle of the grid, radians."""
    return 2 * math.atan(length_m * scene.squint_sine / (2 * max(scene.range_m, 1e-9)))


def _window(acquisition: Acquisition, radar: RadarParameters, n_profile: int):
    """Ranges between which the profiles hold whole responses, once."""
    guard = GUARD_SAMPLES if is_phase_history(acquisition) else 0
    return tuple(radar.range_start_m + n * radar.sample_spacing_m
                 for n in (guard, n_profile - 1 - guard))


def _unambiguous_depth(acquisition: Acquisition) -> float:
    if not is_phase_history(acquisition):
        return math.inf
    return acquisition.n_samples * acquisition.radar.range_resolution_m


def is_phase_history(acquisition: Acquisition) -> bool:
    """True when a sample is a frequency: stepped frequency or FMCW, not yet compressed."""
    return not acquisition.compressed and acquisition.radar.waveform in PHASE_HISTORIES


def pulse_duration_s(acquisition: Acquisition) -> float:
    """Length of a transmitted pulse, seconds; 0 for other waveforms and range profiles."""
    radar = acquisition.radar
    if acquisition.compressed or radar.waveform != Waveform.LFM:
        return 0.0
    return n_pulse_samples(radar) / radar.sample_rate_hz
