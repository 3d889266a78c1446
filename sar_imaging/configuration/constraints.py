# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Constraints of a configuration: errors and warnings, each with the parameter to change."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator

import numpy as np

from ..memory import PUBLISHED_BYTES
from .derived import Derived, pulse_duration_s
from .settings import Acquisition, Imaging, Machine

LEAST_OVERSAMPLING = 1.25  # of profiles, for the interpolation of backprojection
MESSAGE_BYTES = (0.1e6, 16e6)  # smaller: overhead; larger: page faults dominate
_ROUNDING = 1 + 1e-9


@dataclasses.dataclass(frozen=True)
class Finding:
    """One error or warning about a configuration.

    Parameters
    ----------
    severity : str
        ``'error'`` when no useful image can come of it, else ``'warning'``.
    text : str
        What is wrong with which numbers, and what to change.
    from_track : bool
        True when it follows from the assumption of a straight track.

    Examples
    --------
    >>> from sar_imaging.configuration import Finding
    >>> finding = Finding('error', 'pulses_per_aperture: 0; expected 2 or more')
    >>> print(f'{finding.severity}: {finding.text}')
    error: pulses_per_aperture: 0; expected 2 or more
    """

    severity: str
    text: str
    from_track: bool = False


def refusal(check: Callable[..., object], *arguments: object) -> list[Finding]:
    """What a check has against its arguments: its ValueError as the only error, or nothing."""
    try:
        check(*arguments)
    except ValueError as error:
        return [Finding('error', str(error))]
    return []


_STRAIGHT_VOLUME = Finding(
    'warning', 'mode: volume, and a straight track is assumed, which tells no heights unless '
    'receivers lie across it: aperture, azimuth resolution and pulse rate hold for one row of a '
    'raster or for the chord of an arc, and the resolution in height is not derived; compare with '
    'an image of simulated scatterers', from_track=True)


def check(acquisition: Acquisition, imaging: Imaging, machine: Machine,
          derived: Derived) -> list[Finding]:
    """Find errors and warnings of a configuration, errors first.

    Parameters
    ----------
    acquisition, imaging, machine
        The configuration.
    derived : Derived
        What `derive` made of it.

    Returns
    -------
    list of Finding

    Examples
    --------
    >>> from sar_imaging import MapGrid, RadarParameters
    >>> from sar_imaging.configuration import Acquisition, Imaging, Machine, check, derive
    >>> radar = RadarParameters(10e9, 300e6, 400e6, first_sample_delay_s=6e-7)
    >>> slow = Acquisition(radar, True, 256, 1, 20.0, (0.0, 0.0, 50.0), (0.0, 8.0, 0.0))
    >>> imaging = Imaging(MapGrid((120.0, 0.0, 0.0), 200, 200, 0.25), pulses_per_aperture=256)
    >>> machine = Machine(50e6, 'measured', 2 * 2**30)
    >>> for finding in check(slow, imaging, machine, derive(slow, imaging, machine))[:1]:
    ...     print(finding.severity + ':', finding.text)
    error: grid.spacing=0.25 m: scatterers between pixels vanish, the null spacing in ...
    """
    findings = [*check_settings(imaging, machine),
                *_check_profiles(derived), *_check_window(derived),
                *_check_pulse_rate(acquisition, derived),
                *_check_direction(acquisition, derived), *_check_pixels(imaging, derived),
                *_check_strip(acquisition, imaging, derived),
                *_check_blocks(acquisition, imaging, derived),
                *_check_load(imaging, machine, derived)]
    if imaging.mode == 'volume':
        findings = [_of_one_row(f) for f in findings] + [_STRAIGHT_VOLUME]
    return sorted(findings, key=lambda f: f.severity != 'error')


def _of_one_row(finding: Finding) -> Finding:
    """What is impossible on a straight track need not be so on a raster or an arc."""
    return dataclasses.replace(finding, severity='warning') if finding.from_track else finding


def check_settings(imaging: Imaging, machine: Machine) -> list[Finding]:
    """Findings that need no radar.

    Parameters
    ----------
    imaging : Imaging
        Settings of the nodes.
    machine : Machine
        Where they run.

    Returns
    -------
    list of Finding
    """
    grid = imaging.grid
    volume = imaging.mode == 'volume'
    size = ' x '.join(map(str, reversed((imaging.volume or grid).shape)))
    size += ' cells' if volume else ' pixels'
    raised = f'grid.spacing={grid.spacing_m:g}' + (
        f' or volume.spacing={imaging.volume_spacing:g}' if volume else '')
    findings = []
    if imaging.n_pixels > imaging.max_image_pixels:
        findings.append(Finding(
            'error', f'the grid has {size}, more than max_image_pixels='
            f'{imaging.max_image_pixels}; raise {raised}, or max_image_pixels if memory allows'))
    n_bytes = PUBLISHED_BYTES * imaging.n_pixels
    if n_bytes > machine.memory_bytes:
        findings.append(Finding(
            'error', f'{"a volume" if volume else "an image"} of {size} and its message need '
            f'{n_bytes / 1e6:.0f} MB, {machine.memory_bytes / 1e6:.0f} MB are available; raise '
            f'{raised} or choose a smaller grid'))
    if volume and imaging.method == 'afbp':
        findings.append(Finding('error', 'method: afbp images maps, not volumes; set method: '
                                'exact in mode: volume'))
    if volume and imaging.autofocus:
        findings.append(Finding(
            'error', f'autofocus.track_error={imaging.autofocus_track_error:g} and '
            f'autofocus.time_offset={imaging.autofocus_time_offset:g} are of no use in mode: '
            'volume, which has no autofocus; set both to 0.0, or use mode: image'))
    if imaging.autofocus and imaging.mode == 'subapertures':
        findings.append(Finding(
            'error', f'autofocus.track_error={imaging.autofocus_track_error:g} and '
            f'autofocus.time_offset={imaging.autofocus_time_offset:g} are of no use in mode: '
            f'{imaging.mode}, whose images have no pulses; set both to 0.0 and use '
            'autofocus.phase_gradient of afbp_fusion, or mode: image'))
    return findings


def _check_profiles(d: Derived) -> Iterator[Finding]:
    radar = d.profile_radar
    if radar.sample_rate_hz < LEAST_OVERSAMPLING * radar.bandwidth_hz:
        yield Finding('error', 'range profiles are sampled at '
                      f'{radar.sample_rate_hz / radar.bandwidth_hz:.3g} times their bandwidth; '
                      f'backprojection needs {LEAST_OVERSAMPLING}: raise oversampling '
                      '(2.0 is the default)')


def _check_window(d: Derived) -> Iterator[Finding]:
    near, far = d.scene.near_m, d.scene.far_m
    start, stop = d.window_m
    extents = (f'the scene lies {near:.4g} to {far:.4g} m away, the profiles cover {start:.4g} '
               f'to {stop:.4g} m')
    if near > stop or far < start:
        yield Finding('error', f'{extents}: nothing of it was recorded; move the range window '
                      '(radar.range_start_m) or the grid', from_track=True)
    elif near < start or far > stop:
        covered = (min(far, stop) - max(near, start)) / max(far - near, 1e-12)
        yield Finding('warning', f'{extents}, {100 * covered:.0f} % of its depth; the rest of '
                      'the image stays dark: record a longer window or make the grid smaller',
                      from_track=True)
    if far - near > d.unambiguous_depth_m:
        yield Finding('error', f'the scene is {far - near:.4g} m deep, the frequency step repeats '
                      f'ranges every {d.unambiguous_depth_m:.4g} m; use more frequencies over '
                      'the same bandwidth or a smaller grid', from_track=True)


def _check_pulse_rate(a: Acquisition, d: Derived) -> Iterator[Finding]:
    if not a.compressed and a.prf_hz > d.largest_prf_hz * _ROUNDING:
        yield Finding('error', f'prf_hz={a.prf_hz:g}: a recording of {a.n_samples} samples takes '
                      f'longer than the {1e6 / a.prf_hz:.4g} us between pulses; at most '
                      f'{d.largest_prf_hz:.4g} Hz, or record fewer samples')
    length = pulse_duration_s(a)
    if not length:
        return
    if length > 1 / a.prf_hz:
        return  # told above: the recording holds a whole pulse
    ahead = math.floor(2 * d.scene.far_m / a.radar.propagation_speed_m_per_s * a.prf_hz)
    if ahead:
        yield Finding('warning', f'the scene at {d.scene.far_m:.4g} m is beyond the unambiguous '
                      f'range of {d.unambiguous_range_m:.4g} m: {ahead} later pulses are in '
                      'flight, and echoes from nearer by overlap those of the scene unless the '
                      'antenna suppresses them; lower prf_hz', from_track=True)
    # The receiver is deaf while a later pulse goes out.
    start = a.radar.first_sample_delay_s * a.prf_hz % 1.0
    stop = start + a.n_samples / a.radar.sample_rate_hz * a.prf_hz
    if start < length * a.prf_hz * (1 - 1e-9) or stop > _ROUNDING:
        yield Finding('warning', f'at prf_hz={a.prf_hz:g} a pulse is sent while echoes are '
                      'recorded; a receiver that is blanked meanwhile loses them: change prf_hz '
                      'or the range window')


def _check_direction(a: Acquisition, d: Derived) -> Iterator[Finding]:
    if d.needed_direction > d.unambiguous_direction * _ROUNDING:
        what = 'the illuminated scene' if a.beamwidth_rad else 'the scene'
        # Without a beamwidth most of a wide grid may be dark.
        yield Finding('error' if a.beamwidth_rad else 'warning',
                      f'pulses every {d.pulse_spacing_m:.4g} m repeat scatterers every '
                      f'{d.unambiguous_direction:.3g} in direction cosine (about '
                      f'{d.ambiguity_m:.4g} m), {what} is {d.needed_direction:.3g} wide: raise '
                      f'prf_hz={a.prf_hz:g} to {d.least_prf_hz:.4g} or more, fly slower, or make '
                      'the grid narrower along the track', from_track=True)
    if d.scene.both_sides:
        yield Finding('warning', 'the grid extends across the track: only the antenna pattern '
                      'separates scatterers left and right of it at equal ranges', from_track=True)
    if d.azimuth_width_m > d.scene.range_m:
        yield Finding('error', f'the aperture of {d.aperture_m:.3g} m resolves '
                      f'{d.azimuth_width_m:.3g} m in azimuth, more than the range: raise '
                      'pulses_per_aperture, or look away from the direction of flight',
                      from_track=True)
    if d.range_width_m > d.scene.range_m:
        yield Finding('error', f"the grid's centre is directly below the radar, "
                      f'{d.scene.range_m:.4g} m away: ranges on the ground are not resolved; '
                      'image beside the track', from_track=True)


def _check_pixels(imaging: Imaging, d: Derived) -> Iterator[Finding]:
    spacing = imaging.grid.spacing_m
    for name, null in (('range', d.range_null_m), ('azimuth', d.azimuth_null_m)):
        if spacing >= 2 * null:
            yield Finding('error', f'grid.spacing={spacing:g} m: scatterers between pixels '
                          f'vanish, the null spacing in {name} is {null:.3g} m; use at most '
                          f'half of it, {_round_down(null / 2):g} m, or lower the '
                          + ('bandwidth' if name == 'range' else 'number of pulses per aperture'),
                          from_track=True)
        elif spacing > 0.5 * null * _ROUNDING:
            loss = -20 * math.log10(np.sinc(spacing / (2 * null)))
            yield Finding('warning', f'grid.spacing={spacing:g} m is more than half of the '
                          f'null spacing in {name}, {null:.3g} m: a scatterer between pixels '
                          f'loses up to {loss:.1f} dB; {_round_down(null / 2):g} m or less keep '
                          'it below 1 dB, and obstacles of obstacle_map reliable',
                          from_track=True)


def _check_strip(a: Acquisition, imaging: Imaging, d: Derived) -> Iterator[Finding]:
    if not (imaging.subaperture_follow and imaging.mode == 'subapertures'):
        return
    grid = imaging.grid
    # Sliding or not, the map moves on when an aperture begins.
    for axis, n_pixels, speed in zip('xy', (grid.n_x, grid.n_y), a.velocity_m_per_s, strict=False):
        size_m, moved_m = n_pixels * grid.spacing_m, abs(speed) * d.aperture_s
        if moved_m > size_m * _ROUNDING:
            yield Finding('warning', f'the image follows the antenna, {moved_m:.4g} m along '
                          f'{axis} from aperture to aperture, and is {size_m:.4g} m long there: '
                          f'{moved_m - size_m:.4g} m in between are never imaged; raise '
                          f'grid.size_{axis} to {moved_m:.4g} m or more, or lower '
                          f'pulses_per_aperture={imaging.pulses_per_aperture}', from_track=True)


def _check_blocks(a: Acquisition, imaging: Imaging, d: Derived) -> Iterator[Finding]:
    largest = max(d.block_bytes, d.profile_block_bytes)
    if largest / 4 > imaging.max_message_elements:
        yield Finding('error', f'a block of {imaging.pulses_per_block} pulses has '
                      f'{largest // 4} floats, more than max_message_elements='
                      f'{imaging.max_message_elements}; lower pulses_per_block')
    elif largest > MESSAGE_BYTES[1]:
        yield Finding('warning', f'blocks of {largest / 1e6:.3g} MB take long to transfer; lower '
                      f'pulses_per_block={imaging.pulses_per_block} (0.25 to 2 MB are best)')
    elif d.block_bytes < MESSAGE_BYTES[0] and imaging.pulses_per_block < 0.5 * a.prf_hz:
        yield Finding('warning', f'blocks of {d.block_bytes / 1e3:.3g} kB are small, so there are '
                      f'many; raise pulses_per_block={imaging.pulses_per_block} (0.25 to 2 MB '
                      'are best)')


def _check_load(imaging: Imaging, machine: Machine, d: Derived) -> Iterator[Finding]:
    if imaging.mode != 'subapertures' and d.imaging_s > d.aperture_s:
        yield Finding('warning', f'an image takes about {d.imaging_s:.3g} s of work, the next '
                      f'aperture comes after {d.aperture_s:.3g} s: blocks will be dropped when '
                      'this runs live; raise grid.spacing, make the grid smaller, or use '
                      'mode: subapertures', from_track=True)
    if d.obstacle_map_s > d.aperture_s:
        yield Finding('warning', f'an obstacle map takes about {d.obstacle_map_s:.3g} s of work, '
                      f'the next aperture comes after {d.aperture_s:.3g} s: maps of some '
                      'apertures will be skipped while obstacle_map has a subscriber; raise '
                      'grid.spacing or make the grid smaller', from_track=True)
    total = sum(m.n_bytes for m in d.memory)
    if total > machine.memory_bytes:
        yield Finding('warning', f'the nodes may need {total / 1e6:.0f} MB, '
                      f'{machine.memory_bytes / 1e6:.0f} MB are available; lower queue_depth, '
                      'worker_queue_size or the number of pixels')


def _round_down(value: float) -> float:
    """Two digits, never more than `value`."""
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.floor(value / digit * _ROUNDING) * digit
