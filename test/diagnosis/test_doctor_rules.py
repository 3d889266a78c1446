# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Rules of the doctor for what hardly shows in the focus: walk through range, jumps, arrays."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.support.doctor_cases import right_case, rotating_arm
from benchmarks.support.doctor_families import family_case
from benchmarks.support.doctor_faults import FAULTS
from benchmarks.support.mistake_recordings import DATA, arcsar, mimo
from sar_imaging.diagnosis.channel_phases import array_phases, channel_phases, phase_findings
from sar_imaging.diagnosis.coherence import OVERSAMPLING, CoherenceProbe
from sar_imaging.diagnosis.diagnose import Diagnosis, diagnose
from sar_imaging.diagnosis.doctor import _lever_arm, examine
from sar_imaging.diagnosis.hypotheses import (
    GEOMETRY,
    HYPOTHESES,
    clock_offsets,
    congruent,
    slopes,
    with_slope,
)
from sar_imaging.diagnosis.lever_arm import find_lever_arm
from sar_imaging.diagnosis.range_walk import walk_scale
from sar_imaging.diagnosis.track import fills_a_plane, jump_findings
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.echoes import EchoSimulator

RADAR = fmcw_parameters(start_frequency_hz=77e9, slope_hz_per_s=39e12, sample_rate_hz=2.65e6,
                        n_samples=128, adc_start_s=4e-6)
GRID = MapGrid.from_size((0.0, 2.0, 0.0), 2.0, 1.6, 0.02)
POINTS_M = [[-0.6, 1.5, 0.0], [0.1, 2.0, 0.0], [0.5, 1.8, 0.0], [-0.2, 2.5, 0.0]]
measured = pytest.mark.skipif(not DATA.is_dir(), reason='measured data are not here')


def recorded(tx_m, rx_m=None, noise=0.3) -> PulseBlock:
    """Pulses (P, C, 3) of the radar over the four points, 0.1 s apart."""
    rng = np.random.default_rng(1)
    rx_m = tx_m if rx_m is None else rx_m
    samples = EchoSimulator(RADAR, 128, compressed=False, points_m=POINTS_M,
                            amplitudes=np.ones(4))(tx_m, rx_m)
    samples = samples + noise * (rng.standard_normal(samples.shape)
                                 + 1j * rng.standard_normal(samples.shape))
    n = len(tx_m)
    return PulseBlock(RADAR, False, 10**9 + 10**8 * np.arange(n), np.arange(n), samples, tx_m,
                      rx_m)


def arc(n=160) -> np.ndarray:
    """(P, 1, 3) places on an arc of 0.2 m and 80 degrees."""
    angle = np.linspace(np.radians(50), np.radians(130), n)
    return (0.2 * np.c_[np.cos(angle), np.sin(angle), 0 * angle])[:, None]


def raster() -> np.ndarray:
    """(P, 1, 3) places of three columns of 48 pulses."""
    z = np.tile(0.002 * np.arange(48), 3)
    return np.c_[np.repeat([0.0, 0.02, 0.04], 48), 0 * z, z][:, None]


@pytest.mark.parametrize('factor', [0.9, 1.0, 1.2])
def test_scatterers_walk_by_the_error_of_the_slope(factor):
    wrong = with_slope(recorded(arc()), factor)
    profiles = RangeCompressor.for_block(wrong, oversampling=OVERSAMPLING)(wrong)
    walk = walk_scale(profiles, GRID)
    # the beat is that of the true slope: ranges are 1 / factor times as long. Places move with
    # them, and a half of what sharpness the arc has, so that the walk tells 0.06 too little
    assert walk.n_scatterers >= 2
    assert walk.scale == pytest.approx(1 / factor, abs=0.08)


def test_slope_that_leaves_the_focus_is_named():
    wrong = with_slope(recorded(arc()), 1.2)
    [finding] = examine(wrong, GRID).findings
    assert finding.fault == 'wrong slope'
    right = float(finding.advice.split(' Hz/s, ')[1].split(' times')[0])
    assert right == pytest.approx(1 / 1.2, rel=0.05)


# Ramps of the wrong sign that leave the phases in focus (42017), that another slope focuses in
# part (42021), that three channels see as less than noise (42048), and that leave more in focus in
# one half of the map (123004).
@pytest.mark.parametrize('seed', [42017, 42021, 42048, 123004])
def test_inverted_spectrum_is_named_where_the_image_hardly_tells(seed):
    case = right_case(seed)
    wrong = FAULTS['spectrum inverted'][0](case, np.random.default_rng(seed))
    found = diagnose(wrong.block, wrong.grid, thorough=True)
    assert found.mistake == 'sign of the slope'


def test_slope_is_not_sought_where_another_one_scales_the_scene_alone():
    """A track of 0.05 m sees 2 m under 1.4 degrees: curvature tells no range."""
    places = np.array([[0.0, 2.0, 0.0], [0.5, 1.5, 0.0]])
    track = np.linspace(-0.5, 0.5, 48)[:, None, None] * [1.0, 0.0, 0.0]
    assert len(slopes(recorded(0.4 * track), places))
    short = recorded(0.03 * track)
    assert not len(slopes(short, places))
    found = diagnose(short, GRID, thorough=True)
    assert not found.mistake and 'wrong slope' in found.undecided


def test_channels_above_each_other_do_not_hide_the_focus():
    """They agree over the whole map, and pulses of a right recording were told to be noise."""
    case = family_case('upright', 92000)
    profiles = RangeCompressor.for_block(case.block, oversampling=OVERSAMPLING)(case.block)
    conjugated = dataclasses.replace(profiles, samples=profiles.samples.conj())
    probe = CoherenceProbe(case.grid)
    assert probe(profiles).figure > 1.5 > 1.1 > probe(conjugated).figure


def test_no_clock_offset_is_sought_on_an_arc_at_constant_speed():
    """It turns the track, and with it the image."""
    block = recorded(arc())
    assert not len(clock_offsets(block, GRID.points()[::40, ::40].reshape(-1, 3), 2.0, 40))
    uneven = dataclasses.replace(block, stamp_ns=10**9 + np.rint(
        1e8 * (np.arange(160) + 8 * np.sin(np.arange(160) / 12))).astype(np.int64))
    assert len(clock_offsets(uneven, GRID.points()[::40, ::40].reshape(-1, 3), 2.0, 40))


def test_positions_that_shrink_to_a_point_are_no_correction():
    undo = {h.name: h.undo for h in GEOMETRY}['positions in millimetres']
    block = recorded(arc())
    assert undo(block) == []
    in_mm = dataclasses.replace(block, tx_m=1e3 * block.tx_m, rx_m=1e3 * block.rx_m)
    [right] = undo(in_mm)
    np.testing.assert_allclose(right.tx_m, block.tx_m, rtol=1e-12)


@pytest.mark.parametrize('late', [-14, 0, 17])
def test_echoes_that_jump_at_other_times_tell_the_offset(late):
    places = raster()
    block = recorded(places)
    n = len(places)
    given = slice(max(0, late), n + min(0, late))
    heard = slice(max(0, -late), n - max(0, late))
    block = dataclasses.replace(block.select(heard), tx_m=places[given], rx_m=places[given])
    found = jump_findings(block)
    if not late:
        assert found == []
        return
    [finding] = found
    assert finding.fault == 'clock offset'
    # places of `late` pulses later are given: those at t - 0.1 s * late are right
    assert f'at t {"-" if late > 0 else "+"} {0.1 * abs(late):.2g} s' in finding.advice


def test_echoes_that_jump_at_another_rate_tell_it():
    places = raster()
    middle = (len(places) - 1) / 2
    at = np.rint(middle + 0.9 * (np.arange(len(places)) - middle)).astype(int)
    block = recorded(places)
    [finding] = jump_findings(dataclasses.replace(block, tx_m=places[at], rx_m=places[at]))
    assert finding.fault == 'clock drift'
    told = float(finding.advice.split('stretched ')[1].split(' times')[0])
    assert told == pytest.approx(1 / 0.9, abs=0.03)  # a pulse in 24, between middle and jump


def test_tracks_without_jumps_tell_nothing_of_the_clock():
    assert jump_findings(recorded(arc())) == []


def array() -> PulseBlock:
    """Six channels upright on a track along x."""
    track = np.c_[np.linspace(-0.1, 0.1, 120), np.zeros((120, 2))]
    up = 0.002 * (np.arange(6) - 2.5)[:, None] * [0.0, 0.0, 1.0]
    return recorded(track[:, None] + up)


def test_phase_of_a_channel_across_the_track_is_measured():
    right = array()
    assert not channel_phases(right, GRID).any()
    turns = np.ones((6, 1), np.complex64)
    turns[1] = np.exp(1.8j)
    wrong = dataclasses.replace(right, samples=right.samples * turns)
    phases = channel_phases(wrong, GRID)
    assert phases[1] == pytest.approx(1.8, abs=0.2)
    assert np.abs(np.delete(phases, 1)).max() < 0.2
    [finding], _ = phase_findings(wrong, GRID)
    assert 'channel 1 by +1' in finding.evidence


def test_phases_that_grow_along_an_array_are_no_error():
    rng = np.random.default_rng(3)
    image = rng.standard_normal(400) ** 3 * np.exp(6.3j * rng.random(400))
    places = 0.002 * np.arange(6)
    turned = np.exp(1j * 1.1 * np.arange(6))[:, None] * image
    assert not array_phases(turned, places).any()
    turned[4] *= np.exp(1.5j)
    phases = array_phases(turned, places)
    assert phases[4] == pytest.approx(1.5, abs=0.05)


@pytest.mark.parametrize('turn_rad', [0.0, 2.0])
def test_phases_that_follow_from_another_mistake_are_not_named(turn_rad):
    """Three channels along a track, said to lie across it, differ by 164 degrees or more."""
    x = np.linspace(-0.1, 0.1, 120)
    track = np.c_[x, 0.002 * np.sin(25 * x + 2.5), 0 * x]
    block = recorded(track[:, None] + 0.003 * np.arange(-1, 2)[:, None] * [1.0, 0.0, 0.0])
    turns = np.exp([[0], [1j * turn_rad], [0]]).astype(np.complex64)
    block = dataclasses.replace(block, samples=block.samples * turns,
                                tx_m=block.tx_m[..., [1, 0, 2]], rx_m=block.rx_m[..., [1, 0, 2]])
    found = {finding.fault: finding for finding in examine(block, GRID).findings}
    assert set(found) == {'x and y exchanged', *(['phases of channels'] if turn_rad else [])}
    if turn_rad:  # 2 rad are 115 degrees
        assert found['phases of channels'].evidence.endswith(('1 by +114 degrees',
                                                              '1 by +115 degrees'))


def turning(rms_deg) -> Rotation:
    """Attitude of a carriage that yaws, at 160 pulses."""
    yaw = np.sqrt(2) * np.sin(np.linspace(0, 9, 160))
    return Rotation.from_rotvec(np.radians(rms_deg) * yaw[:, None] * [0, 0, 1])


def test_missing_lever_arm_is_found_where_the_platform_turns():
    track = np.c_[np.linspace(-0.15, 0.15, 160), np.zeros((160, 2))][:, None]
    attitude = turning(0.7)
    right = find_lever_arm(recorded(track), attitude, GRID)
    assert not right.found and np.linalg.norm(right.arm_m) < 0.02
    moved = attitude.apply([0.3, 0.0, 0.0])
    moved = (moved - moved.mean(axis=0))[:, None]
    block = dataclasses.replace(recorded(track + moved), tx_m=track, rx_m=track)
    missing = find_lever_arm(block, attitude, GRID)
    # 0.7 degrees of 0.03 m are 0.4 mm, a tenth of the wavelength
    assert missing.found
    assert missing.arm_m[0] == pytest.approx(0.3, abs=0.03)
    assert missing.finding().fault == 'lever arm'
    assert find_lever_arm(block, turning(0.01), GRID) is None


def test_arm_is_found_in_directions_that_blur_little():
    """Most of this arm lies where a metre blurs by 2 radians; it was taken for a clock once."""
    right = right_case(52063)
    rng = np.random.default_rng([52063, 7])
    case = FAULTS['lever arm'][0](right, rng)
    rng = np.random.default_rng([52063, 7])
    arm = rng.standard_normal(3)
    arm *= rng.uniform(0.3, 0.8) / np.linalg.norm(arm)
    found = find_lever_arm(case.block, case.attitude, case.grid)
    assert found.found and found.n_directions == 2
    # measured: 2 mm; the resolution is 0.1 m
    assert found.arm_m == pytest.approx(arm, abs=0.02)


def test_arm_of_decimetres_is_found_on_an_arc_at_millimetre_waves():
    """Each millimetre is half a turn of phase; a rate of the clock undoes it in part."""
    right = family_case('wide', 158000)
    case = FAULTS['lever arm forgotten'][0](right, np.random.default_rng([158000, 7]))
    rate = Diagnosis(0.8, 1.0, 'clock drift', gain=20.0, sizes=(0.8,), corrected=2.0)
    arm, better = _lever_arm(case.block, case.grid, 'none', right.attitude, rate)
    # measured: 0.1 mm of 0.396 m; the wavelength is 4 mm
    assert arm.told_m == pytest.approx(case.sizes, abs=0.001)
    assert better == pytest.approx(arm.gain / 20)


def test_turns_about_a_track_itself_are_not_taken_out_of_an_arm():
    """Wiggles of a track that climbs a little were taken for its turns; half of the focus went."""
    right = family_case('near', 98000)
    case = FAULTS['lever arm'][0](right, np.random.default_rng([98000, 7]))
    found = find_lever_arm(case.block, right.attitude, case.grid)
    assert found.found and found.n_directions == 3
    assert np.linalg.norm(found.arm_m - case.sizes) < found.error_m < 0.15


def test_offset_is_compared_on_the_pulses_that_it_leaves():
    """A third of the aperture agrees widely by itself; it was taken for an offset of 0.6 s."""
    right = family_case('few', 99000)
    case = FAULTS['clock offset'][0](right, np.random.default_rng([99000, 7]))
    found = diagnose(case.block, case.grid, thorough=True)
    assert found.mistake == 'clock offset'
    # pulses are 0.006 s apart
    assert found.sizes == pytest.approx(case.sizes, abs=0.01)


# Offsets that reversed positions undo in part (123000), that one to the other side does on the
# pulses of the other end (123003), and that an arm does on all pulses (123008).
@pytest.mark.parametrize('seed', [123000, 123003, 123008])
def test_offset_is_compared_with_others_on_the_same_pulses(seed):
    right = right_case(seed)
    case = FAULTS['clock offset'][0](right, np.random.default_rng([seed, 7]))
    kept = np.isin(right.block.counter, case.block.counter)
    attitude = right.attitude[kept] if seed == 123008 else None
    [found] = examine(case.block, case.grid, attitude=attitude).findings
    assert found.fault == 'clock offset'
    assert found.sizes == pytest.approx(case.sizes, rel=0.05)


def test_exchanged_axes_are_named_where_a_wide_aperture_holds_few_scatterers():
    """Few tiles of the image did not hold what is in focus, and phases of channels were named."""
    case = FAULTS['x and y exchanged'][0](right_case(123002), None)
    assert diagnose(case.block, case.grid).mistake == 'x and y exchanged'


# Odd and even columns of a raster alias, and agree in what is not in focus (153100). On an array
# an offset searched on one channel, and reversed positions on all (151002), are compared on one.
# Of all orders of transmitters one leaves channels whose images do not differ in phase (153100).
@pytest.mark.parametrize(('family', 'seed', 'fault', 'named'), [
    ('volume', 153100, 'I and Q exchanged', ['samples conjugated']),
    ('upright', 151002, 'clock offset', ['clock offset']),
    ('upright', 151002, 'positions reversed', ['positions reversed']),
    ('upright', 153100, 'order of transmitters', ['order of transmitters', 'phases of channels'])])
def test_faults_of_apertures_that_fill_a_plane(family, seed, fault, named):
    case = FAULTS[fault][0](family_case(family, seed), np.random.default_rng([seed, 7]))
    assert [finding.fault for finding in examine(case.block, case.grid).findings] == named


def test_order_of_transmitters_is_not_told_where_the_scene_lies_at_one_elevation():
    right = family_case('upright', 151000)
    wrong = FAULTS['order of transmitters'][0](right, np.random.default_rng([151000, 7]))
    found = diagnose(wrong.block, wrong.grid, thorough=True)
    assert not found.mistake and 'order of transmitters' in found.undecided


def test_apertures_that_fill_a_plane():
    track = np.linspace(-0.2, 0.2, 80)[:, None]
    line = np.c_[track, 0.01 * np.sin(20 * track), 0 * track]
    upright = line[:, None] + np.linspace(0, 0.02, 8)[:, None] * [0.0, 0.0, 1.0]
    assert fills_a_plane(recorded(raster())) and fills_a_plane(recorded(upright))
    assert not fills_a_plane(recorded(line[:, None])) and not fills_a_plane(recorded(arc()))


def test_sharp_slice_of_a_volume_is_not_accused():
    """Of its full array all but the scatterers cancels, so that groups agree less than noise.

    Reversed positions show the volume upside down, in which more may lie.
    """
    case = family_case('volume', 150004)
    found = diagnose(case.block, case.grid, thorough=True)
    assert found.focused and not found.mistake


def test_positions_reversed_are_those_of_a_mirrored_track_where_it_is_even():
    even = np.linspace(-0.2, 0.2, 80)[:, None, None] * [1.0, 0.2, 0.0]
    uneven = even + 0.01 * np.square(even[..., :1]) * [25.0, 0.0, 0.0]
    for track, alike in ((even, True), (uneven, False)):
        assert congruent(recorded(track), recorded(track[::-1])) == alike


@pytest.mark.parametrize(('wave_rad', 'named'), [
    (0.05, ['lever arm', 'clock offset']), (0.15, ['clock offset'])])
def test_arm_and_clock_are_both_named_where_they_are_alike(wave_rad, named):
    """The heading follows the track: on gentle curves an arm along it moves as a late clock does.

    Seven pulses at constant speed are 0.013 m. Beside the tangent the track curves by 0.1 mm in
    them, a third of a radian, on the gentle track, and by three times that on the other.
    """
    way = np.linspace(-0.15, 0.15, 167)
    heading = wave_rad * np.sin(2 * np.pi * way / 0.3 + 0.4)
    step = way[1] - way[0]
    track = np.cumsum(step * np.c_[np.cos(heading), np.sin(heading), 0 * way], axis=0)[:, None]
    block = recorded(track[7:], noise=0.1)
    late = dataclasses.replace(block, tx_m=track[:-7], rx_m=track[:-7])
    attitude = Rotation.from_rotvec(heading[:-7, None] * [0.0, 0.0, 1.0])
    findings = examine(late, GRID, attitude=attitude).findings
    assert [finding.fault for finding in findings] == named
    assert ('correct only one' in findings[0].advice) == (len(named) == 2)


@pytest.mark.parametrize(('fault', 'named'), [
    (None, []), ('lever arm', ['lever arm']), ('clocks drift apart', ['clock drift'])])
def test_small_blur_of_an_arm_is_not_taken_for_another_fault(fault, named):
    """A rail whose turns blur by a radian only, which an offset of the clock undoes in part."""
    case = right_case(42033)
    if fault is not None:
        case = FAULTS[fault][0](case, np.random.default_rng([42033, 7]))
    kept = np.isin(right_case(42033).block.counter, case.block.counter)
    found = examine(case.block, case.grid, attitude=case.attitude[kept]).findings
    assert [finding.fault for finding in found] == named


@measured
@pytest.mark.parametrize('exchanged', [False, True])
def test_faults_that_leave_the_arc_in_focus_are_named(exchanged):
    arm = arcsar()
    if exchanged:
        block = dataclasses.replace(arm.block, tx_m=arm.block.tx_m[..., [1, 0, 2]],
                                    rx_m=arm.block.rx_m[..., [1, 0, 2]])
    else:
        block = with_slope(arm.block, 1.2)
    found = [finding.fault for finding in examine(block, arm.grid, window=arm.window).findings]
    assert found == ['x and y exchanged' if exchanged else 'wrong slope']


@measured
def test_conjugated_arc_is_told_before_an_arm_that_makes_up_for_it():
    """An antenna on the other side of the pivot has the conjugated phases, and other ranges."""
    arm = arcsar()
    wrong = dataclasses.replace(arm.block, samples=arm.block.samples.conj())
    found = examine(wrong, arm.grid, window=arm.window,
                    attitude=rotating_arm(arm.block)).findings
    assert found[0].fault == 'samples conjugated'


@measured
def test_phase_of_a_channel_of_the_slider_is_measured():
    slider = mimo()
    assert not np.any(np.abs(channel_phases(slider.block, slider.grid, window='hamming')) > 0.5)
    turns = np.ones((8, 1), np.complex64)
    turns[5] = np.exp(-2j)
    wrong = dataclasses.replace(slider.block, samples=slider.block.samples * turns)
    phases = channel_phases(wrong, slider.grid, window='hamming')
    # its channels differ by up to 20 degrees as they are
    assert phases[5] == pytest.approx(-2.0, abs=0.4)


@measured
def test_nothing_is_wrong_with_the_slider():
    """Its groups agree less than those of noise: positions that darken it were named once.

    Its columns resolve heights: with another slope another height of the chair shows.
    """
    slider = mimo()
    examined = examine(slider.block, slider.grid, window=slider.window)
    assert examined.findings == () and 'wrong slope' in examined.diagnosis.undecided


@pytest.mark.parametrize('told_m', [0.2, 0.08])
def test_arm_of_a_radar_that_rotates_is_told_whole(told_m):
    """The poses are of a place between the pivot and the antenna, which is at 0.2 m."""
    angle = np.linspace(np.radians(50), np.radians(130), 160)
    attitude = Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0])
    told = (told_m / 0.2) * arc()
    block = dataclasses.replace(recorded(arc()), tx_m=told, rx_m=told)
    found = find_lever_arm(block, attitude, GRID)
    assert found.found == (told_m < 0.2)
    if found.found:  # a milliradian of phase is felt: 0.3 rad are 0.5 mm of a radius
        assert found.arm_m[0] == pytest.approx(0.2 - told_m, abs=0.01)


def test_transmitters_in_another_order_are_put_right():
    undo = {h.name: h.undo for h in HYPOTHESES}['order of transmitters']
    track = np.c_[np.linspace(-0.1, 0.1, 20), np.zeros((20, 2))][:, None]
    up = np.array([0.0, 0.0, 1.0])
    tx = track + np.repeat([0.0, 0.01, 0.03], 2)[:, None] * up
    right = recorded(tx, track + np.tile([0.0, 0.002], 3)[:, None] * up)
    wrong = dataclasses.replace(right, samples=right.samples[:, [4, 5, 2, 3, 0, 1]])
    tried = undo(wrong)
    assert len(tried) == 5
    assert sum(np.array_equal(b.samples, right.samples) for b in tried) == 1
    assert undo(recorded(track)) == []


def test_pulses_of_a_platform_that_stands_do_not_count():
    x = np.r_[np.zeros(80), np.linspace(0.0, 0.2, 81), np.full(80, 0.2)]
    block = recorded(np.c_[x, 0 * x, 0 * x][:, None])
    moving = block.select(slice(80, 161))
    figures = []
    for some in (block, moving):
        profiles = RangeCompressor.for_block(some, oversampling=OVERSAMPLING)(some)
        figures.append(CoherenceProbe(GRID)(profiles).contrast)
    # the same 80 places but for one at each end: a tenth for the pulses chosen there
    assert figures[0] == pytest.approx(figures[1], rel=0.1)


def test_phases_of_channels_show_in_clutter():
    """Two channels along the track see the same clutter, in which nothing stands out."""
    rng = np.random.default_rng(5)
    track = np.c_[np.linspace(-0.1, 0.1, 100), np.zeros((100, 2))]
    centres = track[:, None] + np.array([[-0.001, 0, 0], [0.001, 0, 0]])
    points = np.c_[rng.uniform(-1, 1, 400), rng.uniform(1.2, 2.8, 400), np.zeros(400)]
    echoes = rng.standard_normal(400) + 1j * rng.standard_normal(400)
    samples = EchoSimulator(RADAR, 128, compressed=False, points_m=points,
                            amplitudes=echoes)(centres, centres)
    samples[:, 1] *= np.exp(1j * np.pi / 3)
    block = PulseBlock(RADAR, False, 10**9 + 10**8 * np.arange(100), np.arange(100), samples,
                       centres, centres)
    [finding], _ = phase_findings(block, GRID)
    assert finding.fault == 'phases of channels'
    assert '60 degrees' in finding.evidence or '59' in finding.evidence
