# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Search for the offset of two clocks by trial images, and what its curve is worth."""

from __future__ import annotations

import dataclasses
import pathlib
import types

import numpy as np
import pytest

from benchmarks.support.drone_flights import drone_flight
from benchmarks.support.references import exact_image
from sar_imaging.autofocus import Geometry
from sar_imaging.autofocus.live import live_autofocus
from sar_imaging.autofocus.offset_curve import OffsetCurve
from sar_imaging.autofocus.offset_search import BEYOND_S, OffsetSearch, visible_phase
from sar_imaging.autofocus.track import PhaseCentreTrack
from sar_imaging.backends import backend, optional_entry
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.quality import contrast
from sar_imaging.recordings import load
from sar_imaging.signal.positioning import locate
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.echoes import EchoSimulator

DATA = pathlib.Path(__file__).parents[3] / 'shared' / 'data'
SMALL = {'n_pixels': 72, 'n_pulses': 128}


def profiles_of(block, poses, alignment, reach_s):
    """Range profiles with the positions of an alignment, and the track around them."""
    located = locate(block, poses, alignment)
    profiles = RangeCompressor.for_block(located)(located)
    span = (int(profiles.stamp_ns[0] - reach_s * 1e9), int(profiles.stamp_ns[-1] + reach_s * 1e9))
    return profiles, PhaseCentreTrack.of_poses(poses, alignment, 1, span)


def focus(flight, offset_s, expected_s, **options):
    """Result of autofocus, and the contrast of the image with the right offset."""
    profiles, track = profiles_of(flight.block, flight.track(), flight.misaligned(offset_s),
                                  1.25 * expected_s + BEYOND_S)
    result = live_autofocus(flight.grid, time_offset_s=expected_s, track=track,
                            **options).process(profiles)
    true = locate(flight.block, flight.track(), flight.alignment)
    wanted = exact_image(flight.grid,
                         dataclasses.replace(profiles, tx_m=true.tx_m, rx_m=true.rx_m))
    return result, contrast(wanted)


def test_trial_images_are_those_of_exact_backprojection():
    flight = drone_flight(1, motion='turn', radar_kind='uwb', **SMALL)
    profiles, _ = profiles_of(flight.block, flight.track(), flight.alignment, 0.0)
    starts = np.array([[0.2 * k, -0.4, 0.0] for k in range(-3, 4)])
    step = np.array([0.0, 0.06, 0.0])
    compiled, formula = (optional_entry(name, 'TrialImages')(profiles.radar, profiles.samples)
                         for name in ('cpu', 'reference'))
    assert compiled.length == formula.length
    pixels = starts[:, None] + np.arange(compiled.length)[:, None] * step

    def relative_error(one, other):
        return np.linalg.norm(one - other) / np.linalg.norm(other)

    for bias_m in (0.5, 0.0):
        image, by_formula = (trials.image(profiles.tx_m, profiles.rx_m, starts, step, bias_m)
                             for trials in (compiled, formula))
        # Paths are quadratic along a piece, 0.96 m at some metres: a degree of phase.
        assert relative_error(image, by_formula) < 0.02
    # Linear interpolation of profiles at twice their rate: 9 % of the amplitude measured.
    assert relative_error(image[0] + 1j * image[1], exact_image(pixels, profiles)) < 0.15


def test_offsets_are_searched_for_with_the_backend_that_was_chosen():
    flight = drone_flight(1, motion='turn', radar_kind='uwb', **SMALL)
    profiles, track = profiles_of(flight.block, flight.track(), flight.misaligned(0.8), 1.25)
    four = types.SimpleNamespace(**{name: getattr(backend('cpu'), name) for name in (
        'Backprojection', 'SubapertureImager', 'SpectrumFusion', 'form_map')})
    with pytest.raises(ValueError, match='offers no TrialImages'):
        live_autofocus(flight.grid, time_offset_s=1.0, track=track,
                       backend=four).process(profiles)


@pytest.mark.parametrize(('seed', 'motion', 'radar_kind', 'offset_s'), [
    (1, 'turn', 'uwb', 0.8), (9, 'hover', 'uwb', -0.25), (5, 'turn', 'fmcw', -0.25)])
def test_a_clock_that_is_wrong_is_found_and_claimed(seed, motion, radar_kind, offset_s):
    flight = drone_flight(seed, motion=motion, radar_kind=radar_kind, **SMALL)
    expected_s = 1.0 if abs(offset_s) > 0.3 else 0.3
    result, wanted = focus(flight, offset_s, expected_s)
    report = result.report
    assert report.accepted and report.success, report
    # 0.98 and more measured, of these and of the benchmark's flights that were claimed
    assert report.contrast_after > 0.95 * wanted
    assert report.contrast_before < 0.8 * wanted
    assert report.parameters['time_offset_s'] == pytest.approx(-offset_s, abs=0.01)
    assert str(report).startswith('focused by autofocus: sharper')


class KnownBetween:
    """A track that is known for some offsets alone."""

    def __init__(self, track, lowest_s, highest_s):
        self._track, self._between = track, (lowest_s, highest_s)

    def at(self, stamp_ns, offset_s=0.0):
        if not self._between[0] <= offset_s <= self._between[1]:
            raise ValueError('no position is known')
        return self._track.at(stamp_ns, offset_s)


def test_where_the_right_offset_cannot_be_tried_the_refusal_says_what_was_found_and_why():
    flight = drone_flight(1, motion='turn', radar_kind='uwb', **SMALL)
    profiles, track = profiles_of(flight.block, flight.track(), flight.misaligned(1.6), 2.0)
    told = []
    report = live_autofocus(
        flight.grid, time_offset_s=1.0, track=KnownBetween(track, -1.0, 1.0),
        progress=lambda *numbers: told.append(numbers)).process(profiles).report
    tried = [k for k, _ in told]
    assert tried == list(range(1, len(told) + 1)) and told[-1] == (len(told), len(told))
    assert not report.accepted and not report.success
    assert report.verdict == 'not changed by autofocus, focus not confirmed'
    assert report.reason.startswith(
        f'a clock offset of {report.parameters["time_offset_s"]:+.4g} s would change the '
        f'contrast from {report.contrast_before:.3g} to {report.contrast_found:.3g}, but ')
    assert 'nothing sharper' not in report.reason


@pytest.mark.parametrize('offset_s', [0.1, -0.25])
def test_the_answer_does_not_depend_on_the_width_of_the_search(offset_s):
    """Straight legs, and profiles that end within the image, which far offsets move out."""
    flight = drone_flight(4, motion='legs', radar_kind='uwb', n_pixels=100, n_pulses=200)
    for expected_s in (0.3, 3.0):
        profiles, track = profiles_of(flight.block, flight.track(), flight.misaligned(offset_s),
                                      1.25 * expected_s + BEYOND_S)
        last = round(0.75 * profiles.n_samples)
        profiles = dataclasses.replace(profiles, samples=profiles.samples[..., :last].copy())
        report = live_autofocus(flight.grid, time_offset_s=expected_s, track=track,
                                n_phases=0).process(profiles).report
        assert report.accepted and report.success, report
        assert report.parameters['time_offset_s'] == pytest.approx(-offset_s, abs=0.01)


def curve(gain, halves=None, best=10):
    """A curve of 60 trials that are 1 rad apart."""
    n = len(gain)
    halves = [gain] * 6 if halves is None else halves
    return OffsetCurve(np.arange(n) * 0.01, np.arange(n) * 1.0, gain, np.array(halves),
                       best * 0.01, 0.012, n - 1.0)


def peaks(*where_and_height, n=60):
    out = np.zeros(n)
    for k, height in where_and_height:
        out[k] = height
    return out


def test_halves_that_are_sharpest_elsewhere_are_told_with_their_offset():
    clear, late = peaks((30, 9.0), (45, 2.0)), peaks((30, 2.0), (45, 5.0))
    assert not curve(clear, best=30).doubts() and not curve(clear, best=30).open_points()
    # five halves that are sure outweigh one that is not
    odd_one_out = curve(clear, [clear] * 3 + [late] + [clear] * 2, best=30)
    assert [margin for *_, margin in odd_one_out.margins()] == [7.0, 7.0, 7.0, -3.0, 7.0, 7.0]
    assert not odd_one_out.doubts() and not odd_one_out.open_points()
    [reason] = curve(clear, [late] * 6, best=30).doubts()
    assert 'the halves of the data prefer it to all others by -18.0' in reason
    assert 'the late pulses, taken alone, are sharpest at +0.45 s, by 3.0' in reason


def test_what_the_halves_tell_is_enough_for_a_claim_only_with_points_in_phase():
    some = curve(peaks((30, 4.0), (45, 2.0)), best=30)  # 2 of each half
    assert not some.doubts() and not some.open_points(coherence=0.85)
    assert some.open_points(coherence=0.8)
    [reason] = some.open_points()
    assert 'by 12.0 standard deviations together, less than 20' in reason


def test_two_offsets_that_are_equally_sharp_are_told():
    [reason] = curve(peaks((20, 8.0), (40, 7.9)), best=20).open_points(coherence=0.8)
    assert 'prefer it to all others by 0.6 standard deviations together' in reason
    # within one maximum there is no other
    assert not curve(peaks((20, 8.0), (24, 7.5)), best=20).open_points()


def test_an_offset_at_the_end_of_what_is_known_is_not_used_and_one_near_it_not_claimed():
    [reason] = curve(peaks((59, 9.0)), best=59).doubts()
    assert 'it is the last one of those that could be tried, +0 to +0.59 s' in reason
    near = curve(peaks((56, 9.0)), best=56)
    assert not near.doubts()
    [reason] = near.open_points()
    assert 'positions are not known far enough beyond it' in reason


def test_noise_tells_no_offset():
    flight = drone_flight(4, motion='hover', radar_kind='uwb', **SMALL)
    rng = np.random.default_rng(0)
    noise = dataclasses.replace(flight.block, samples=rng.standard_normal(
        flight.block.samples.shape))
    result, _ = focus(dataclasses.replace(flight, block=noise), 0.1, 0.2)
    assert not result.report.accepted and not result.report.success
    assert result.report.curve.doubts()


def test_a_clock_that_is_right_leaves_the_image():
    flight = drone_flight(1, motion='turn', radar_kind='uwb', **SMALL)
    result, wanted = focus(flight, 0.0, 0.3)
    assert result.report.success
    assert contrast(result.image) > 0.99 * wanted


def straight_flight():
    """Profiles of a straight flight of constant speed, two points."""
    radar = RadarParameters(10e9, 300e6, 600e6, 2 * 180.0 / 299792458.0)
    time_s = np.arange(128) * 0.02
    centres = np.zeros((128, 1, 3))
    centres[:, 0, 0], centres[:, 0, 1], centres[:, 0, 2] = 2.0 * (time_s - 1.27), -200.0, 30.0
    points = np.array([[1.0, 2.0, 0.0], [-4.0, -3.0, 0.0]])
    samples = EchoSimulator(radar, 256, compressed=True, points_m=points,
                            amplitudes=np.ones(2))(centres, centres)
    return PulseBlock(radar, True, np.rint(time_s * 1e9).astype(np.int64), np.arange(128),
                      samples, centres, centres)


def test_a_straight_flight_cannot_tell_its_offset_and_says_so():
    block = straight_flight()
    far = dataclasses.replace(block, stamp_ns=2 * block.stamp_ns - block.stamp_ns[64],
                              tx_m=2 * block.tx_m - block.tx_m[64],
                              rx_m=2 * block.rx_m - block.rx_m[64])
    track = PhaseCentreTrack(far.stamp_ns, far.tx_m, far.rx_m)
    grid = MapGrid((0.0, 0.0, 0.0), 64, 64, 0.25)
    result = live_autofocus(grid, time_offset_s=1.0, track=track).process(block)
    report = result.report
    assert not report.accepted and not report.success
    assert 'only displace this image' in report.reason
    assert report.uncertainty['time_offset_s'] > 1.0
    assert result.block is block


def test_visible_phase_leaves_out_what_only_displaces():
    block = straight_flight()
    still = Geometry(block.tx_m, block.rx_m)
    points = [[0.0, 0.0, 0.0]]
    k = block.radar.wavenumber_rad_per_m
    shifted = still._replace(tx_m=block.tx_m + [0.05, 0.0, 0.0], rx_m=block.rx_m
                             + [0.05, 0.0, 0.0])
    # second order of 0.05 m at 200 m: 0.05^2 / 400 m, 2.6 mrad
    assert visible_phase(still, shifted, points, k) < 5e-3
    wave = 1e-3 * np.sin(2 * np.pi * 5 * np.arange(128) / 128)[:, None, None] * [0, 1, 0]
    shaken = still._replace(tx_m=block.tx_m + wave, rx_m=block.rx_m + wave)
    # k a cos(grazing) / sqrt(2), less the little that a line takes of five full waves
    assert visible_phase(still, shaken, points, k) == pytest.approx(
        k * 1e-3 * 200 / np.hypot(200, 30) / np.sqrt(2), rel=0.05)


def test_nothing_is_tried_without_positions():
    block = straight_flight()
    track = PhaseCentreTrack.of_pulses([block])
    with pytest.raises(ValueError, match='no position is known for these pulses'):
        OffsetSearch(block, lambda offset: Geometry(*track.at(block.stamp_ns, 9.0 + offset)),
                     MapGrid((0.0, 0.0, 0.0), 16, 16, 0.25), 0.1)


@pytest.mark.data
@pytest.mark.parametrize(('folder', 'right_s', 'wrong_s'), [
    ('bwsi2019_team5_rail', 4.48, -1.0), ('bwsi2019_team6_rail', 9.2794, 0.3)])
def test_the_offset_of_a_rail_pass_is_found(folder, right_s, wrong_s):
    folder = DATA / folder
    if not folder.is_dir():
        pytest.skip(f'needs the recording in ../shared/data/{folder.name} beside the repository')
    rail = load(folder.name.split('_', 1)[1], folder)
    grid = rail.scene.grid
    grid = MapGrid.from_size(grid.centre_m, 4.5, 6.5, 0.06)
    alignment = dataclasses.replace(rail.alignment,
                                    time_offset_s=right_s + wrong_s)
    profiles, track = profiles_of(rail.block, rail.poses, alignment, 1.25)
    report = live_autofocus(grid, time_offset_s=1.0, track=track).process(profiles).report
    assert report.accepted
    # "the image tells the offset to about 0.05 s"; 0.01 s measured
    assert report.parameters['time_offset_s'] == pytest.approx(-wrong_s, abs=0.05)
    assert report.contrast_after > 1.8 * report.contrast_before
