# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Derive resolution, ambiguities, sampling and data rates from a configuration, in closed form.

A straight track, a stationary scene on the plane of the grid, and the middle of the grid for
what changes over it. Widths are those of a point response at -3 dB. Memory is an upper bound, from
the lengths of the queues and the image.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np

from ..geometry.grids import MapGrid
from ..memory import IMAGE_BYTES
from ..signal.radar import RadarParameters, Waveform
from ..signal.range_compression import GUARD_SAMPLES, RangeCompressor
from ..signal.waveforms import n_pulse_samples
from ..signal.windows import window as window_weights
from .settings import Acquisition, Imaging, Machine

# Interpreter, libraries and compiled kernels (measured; see docs/configuration.md).
BASE_BYTES = {'pulse_buffer': 170e6, 'range_compression': 340e6, 'backprojection': 340e6,
              'afbp_fusion': 340e6}
PRODUCT_BYTES = 13  # of a pixel in the messages: complex, amplitude and quicklook
PRODUCTS_KEPT = 6  # by the middleware (depth 5), and the one being serialised
POLAR_IMAGES = 2.5  # polar image and its interpolation, relative to the image
CALIBRATED_IMAGES = 1.5  # the image scaled, and its scale of 4 bytes a pixel
VOLUME_IMAGES = 3  # the volume, its magnitudes and what is sorted of them
SPECTRUM_IMAGES = 2.6  # fused spectrum and transforms, relative to the image (docs/benchmarks.md)


@dataclasses.dataclass(frozen=True)
class NodeMemory:
    """Bound of one node.

    Parameters
    ----------
    node : str
        Name of the executable.
    n_bytes : int
        When all its queues are full.
    formula : str
        Where the number comes from.
    """

    node: str
    n_bytes: int
    formula: str


def node_memory(imaging: Imaging, n_pixels: int, *, block_bytes: int, profile_block_bytes: int,
                pulse_bytes: int, aperture_bytes: int) -> tuple[NodeMemory, ...]:
    """Bounds of the nodes that the mode needs.

    Parameters
    ----------
    imaging : Imaging
        Settings of the nodes.
    n_pixels : int
        Pixels of the image or volume.
    block_bytes, profile_block_bytes : int
        Blocks of samples and of range profiles.
    pulse_bytes : int
        Samples of one pulse, all channels.
    aperture_bytes : int
        Range profiles of an aperture.

    Returns
    -------
    tuple of NodeMemory
    """
    q = imaging.queue_depth

    def waiting(n_bytes: int) -> int:
        """Most blocks in front of the worker."""
        return min(imaging.worker_queue_size,
                   max(1, int(1e6 * imaging.worker_queue_megabytes / n_bytes)))

    products = n_pixels * PRODUCT_BYTES * PRODUCTS_KEPT
    image = n_pixels * IMAGE_BYTES
    calibrated = 0 if imaging.radiometry_quantity == 'none' else CALIBRATED_IMAGES
    w, w_profiles = waiting(block_bytes), waiting(profile_block_bytes)
    sizes: dict[str, tuple[float, str]] = {
        'pulse_buffer': ((q + w + q) * block_bytes
                         + imaging.reorder_window_pulses * pulse_bytes,
                         f'({q} + {w} + {q}) blocks + reorder window'),
        'range_compression': ((q + w) * block_bytes + q * profile_block_bytes,
                              f'({q} + {w}) blocks + {q} blocks of profiles'),
    }
    if imaging.mode == 'volume':
        images = VOLUME_IMAGES + calibrated
        sizes['backprojection'] = (
            (q + w_profiles) * profile_block_bytes + images * image,
            f'({q} + {w_profiles}) blocks of profiles + {images:g} x 8 B/cell')
    elif imaging.mode == 'image':
        kept = aperture_bytes if imaging.keeps_pulses else 0
        images = 1 + POLAR_IMAGES + (2 if imaging.autofocus else 0) + calibrated
        images += SPECTRUM_IMAGES if imaging.method != 'exact' else 0
        sizes['backprojection'] = (
            (q + w_profiles) * profile_block_bytes + kept + images * image + products,
            f'({q} + {w_profiles}) blocks of profiles'
            + (' + profiles of 1 aperture' if kept else '')
            + f' + {images:g} x 8 B/pixel + {PRODUCTS_KEPT} x {PRODUCT_BYTES} B/pixel')
    else:
        n = 2 if imaging.subaperture_sliding else 1
        sizes['backprojection'] = (
            (q + w_profiles) * profile_block_bytes + n * aperture_bytes + POLAR_IMAGES * image,
            f'({q} + {w_profiles}) blocks of profiles + profiles of {n} aperture(s) + '
            f'{POLAR_IMAGES:g} x 8 B/pixel')
        images = 1 + SPECTRUM_IMAGES + POLAR_IMAGES + calibrated
        sizes['afbp_fusion'] = (
            images * image + products,
            f'{images:g} x 8 B/pixel + {PRODUCTS_KEPT} x {PRODUCT_BYTES} B/pixel')
    return tuple(NodeMemory(node, round(BASE_BYTES[node] + n_bytes),
                            f'{BASE_BYTES[node] / 1e6:.0f} MB + {formula}')
                 for node, (n_bytes, formula) in sizes.items())


_TRACK_POINTS = 33  # of the aperture, and of each side of the grid


@dataclasses.dataclass(frozen=True)
class SceneExtent:
    """Ranges and directions of the grid.

    Parameters
    ----------
    range_m : float
        From the middle of the aperture to the middle of the grid, metres.
    near_m, far_m : float
        Least and largest distance of a pixel during the aperture, metres.
    direction : (2,) floats
        Least and largest direction cosine to the track, seen from the middle of the aperture.
    grazing_cosine : float
        Ground range over slant range at the middle of the grid.
    across_cosine : float
        Part of the cross-range direction that lies in the ground and across the line of sight.
    squint_sine : float
        Sine of the angle between track and line of sight; 1 is broadside.
    both_sides : bool
        True when the grid has pixels left and right of the track.
    """

    range_m: float
    near_m: float
    far_m: float
    direction: tuple[float, float]
    grazing_cosine: float
    across_cosine: float
    squint_sine: float
    both_sides: bool

    @property
    def direction_extent(self) -> float:
        """Extent of the scene in direction cosine."""
        return self.direction[1] - self.direction[0]


def see_scene(acquisition: Acquisition, imaging: Imaging) -> SceneExtent:
    """Scene of a grid from a straight track.

    Parameters
    ----------
    acquisition : Acquisition
        Track; it has to move.
    imaging : Imaging
        Grid and length of the aperture.

    Returns
    -------
    SceneExtent
    """
    grid, top_m = imaging.grid, imaging.top_m
    centre = np.asarray(acquisition.centre_m)
    velocity = np.asarray(acquisition.velocity_m_per_s)
    along = velocity / np.linalg.norm(velocity)
    half_s = 0.5 * (imaging.pulses_per_aperture - 1) / acquisition.prf_hz
    track = centre + np.linspace(-half_s, half_s, _TRACK_POINTS)[:, None] * velocity
    edge = _boundary(grid)
    if top_m != grid.z_m:  # a volume: around its highest layer, too
        edge = np.concatenate([edge[:-1], _boundary(dataclasses.replace(
            grid, centre_m=(*grid.centre_m[:2], top_m)))])
    corners = edge[:: _TRACK_POINTS - 1]
    # The nearest pixel of a rectangle or box to a point: the point's coordinates, clipped.
    nearest = np.stack([np.clip(track[:, 0], grid.x_m[0], grid.x_m[-1]),
                        np.clip(track[:, 1], grid.y_m[-1], grid.y_m[0]),
                        np.clip(track[:, 2], grid.z_m, top_m)], axis=1)
    far = np.linalg.norm(track[:, None] - corners, axis=-1).max()
    from_middle = np.concatenate([edge, _straight_ahead(grid, centre, along)]) - centre
    # On the platform itself every direction is as good as another.
    distance = np.maximum(np.linalg.norm(from_middle, axis=1), 1e-9)
    cosines = from_middle @ along / distance
    beside = from_middle[:, 1] * along[0] - from_middle[:, 0] * along[1]
    to_grid = np.asarray(imaging.middle_grid.centre_m) - centre
    range_m = float(np.linalg.norm(to_grid))
    sight = to_grid / max(range_m, 1e-9)
    cross = along - (along @ sight) * sight
    squint = float(np.linalg.norm(cross))
    ground = math.hypot(*sight[:2])
    beside_sight = np.array([-sight[1], sight[0], 0.0]) / max(ground, 1e-9)
    return SceneExtent(
        range_m=range_m, near_m=float(np.linalg.norm(track - nearest, axis=1).min()),
        far_m=float(far), direction=(float(cosines.min()), float(cosines.max())),
        grazing_cosine=ground, across_cosine=abs(float(cross @ beside_sight)) / max(squint, 1e-9),
        squint_sine=squint, both_sides=bool(beside.min() < 0 < beside.max()))


def _straight_ahead(grid: MapGrid, centre: np.ndarray, along: np.ndarray) -> np.ndarray:
    """(0 or 1, 3) pixel that the line of flight points at: the extreme direction inside a grid."""
    height = grid.z_m - centre[2]
    if abs(along[2]) * 1e9 <= abs(height) or height == 0:
        return np.empty((0, 3))
    x, y = centre[:2] + along[:2] * (height / along[2])
    return np.array([[np.clip(x, grid.x_m[0], grid.x_m[-1]),
                      np.clip(y, grid.y_m[-1], grid.y_m[0]), grid.z_m]])


def _boundary(grid: MapGrid) -> np.ndarray:
    """(4 (n - 1) + 1, 3) points around the grid, from corner to corner; the first comes twice."""
    x = [grid.x_m[0], grid.x_m[-1], grid.x_m[-1], grid.x_m[0], grid.x_m[0]]
    y = [grid.y_m[0], grid.y_m[0], grid.y_m[-1], grid.y_m[-1], grid.y_m[0]]
    at = np.arange(4 * (_TRACK_POINTS - 1) + 1) / (_TRACK_POINTS - 1)
    return np.stack([np.interp(at, range(5), x), np.interp(at, range(5), y),
                     np.full(len(at), grid.z_m)], axis=1)


SAMPLE_BYTES = 8  # complex64
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
    scene : SceneExtent
        What the platform sees of the grid.
    profile_radar : RadarParameters
        Radar parameters of the range profiles.
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
        Direction of the scene, or of the part of it that the antenna illuminates.
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
        Number of pixels of the image or volume.
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

    scene: SceneExtent
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
    illuminated = _illuminated_directions(a, scene)
    pulse = a.n_channels * SAMPLE_BYTES
    blocks = imaging.pulses_per_block * pulse
    n_pixels = imaging.n_pixels
    rows = imaging.pulses_per_aperture * a.n_channels
    sizes = {'block_bytes': blocks * a.n_samples, 'profile_block_bytes': blocks * n_profile,
             'aperture_bytes': imaging.pulses_per_aperture * pulse * n_profile}
    return Derived(
        scene=scene, profile_radar=profile_radar, n_profile=n_profile,
        window_m=_window(a, profile_radar, n_profile),
        unambiguous_depth_m=_unambiguous_depth(a),
        unambiguous_range_m=radar.propagation_speed_m_per_s / (2 * a.prf_hz),
        range_null_m=range_null, range_width_m=width_factor(imaging.window) * range_null,
        pulse_spacing_m=step, aperture_m=step * (imaging.pulses_per_aperture - 1),
        aperture_s=imaging.pulses_per_aperture / a.prf_hz, aperture_rad=aperture_rad,
        azimuth_null_m=azimuth_null, azimuth_width_m=width_factor('none') * azimuth_null,
        unambiguous_direction=shortest / (2 * step), needed_direction=illuminated,
        ambiguity_m=wavelength * scene.range_m / (2 * step),
        least_prf_hz=2 * a.speed_m_per_s * illuminated / shortest,
        largest_prf_hz=radar.sample_rate_hz / a.n_samples,
        input_rate=a.prf_hz * pulse * a.n_samples, profile_rate=a.prf_hz * pulse * n_profile,
        **sizes, n_pixels=n_pixels, imaging_s=n_pixels * rows / machine.rate_per_s,
        obstacle_map_s=_obstacle_map_s(imaging, n_pixels, range_null, azimuth_null),
        memory=node_memory(imaging, n_pixels, pulse_bytes=pulse * a.n_samples, **sizes))


def _illuminated_directions(acquisition: Acquisition, scene: SceneExtent) -> float:
    """Extent of the directions from which echoes come, as sines of angles."""
    if not acquisition.beamwidth_rad:
        return scene.direction_extent
    return min(scene.direction_extent, 2 * math.sin(acquisition.beamwidth_rad / 2))


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


def _seen_angle(scene: SceneExtent, length_m: float) -> float:
    """Angle of an aperture seen from the middle of the grid, radians."""
    return 2 * math.atan(length_m * scene.squint_sine / (2 * max(scene.range_m, 1e-9)))


def _window(acquisition: Acquisition, radar: RadarParameters, n_profile: int
            ) -> tuple[float, float]:
    """Ranges between which the profiles hold whole responses, once."""
    guard = GUARD_SAMPLES if is_phase_history(acquisition) else 0
    return (radar.range_start_m + guard * radar.sample_spacing_m,
            radar.range_start_m + (n_profile - 1 - guard) * radar.sample_spacing_m)


def _unambiguous_depth(acquisition: Acquisition) -> float:
    if not is_phase_history(acquisition):
        return math.inf
    return acquisition.n_samples * acquisition.radar.range_resolution_m


def is_phase_history(acquisition: Acquisition) -> bool:
    """True when a sample is a frequency: stepped frequency or FMCW, not yet compressed."""
    return not acquisition.compressed and acquisition.radar.waveform.is_phase_history


def pulse_duration_s(acquisition: Acquisition) -> float:
    """Length of a transmitted pulse, seconds; 0 for other waveforms and range profiles."""
    radar = acquisition.radar
    if acquisition.compressed or radar.waveform != Waveform.LFM:
        return 0.0
    return n_pulse_samples(radar) / radar.sample_rate_hz
