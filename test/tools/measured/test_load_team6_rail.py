"""The loader of the rail recordings: on made-up files of the same form, and measured."""

from __future__ import annotations

import pathlib

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.positioning import locate
from sar_imaging.signal.pulses import concatenate
from sar_imaging.signal.radar import SPEED_OF_LIGHT, Waveform
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.tools.measured import load_team6_rail
from sar_imaging.tools.recordings.bag_io import BagError, read_blocks, read_poses, read_truth

MEASURED = pathlib.Path(__file__).parents[4] / 'shared' / 'data' / 'bwsi2019_team6_rail'
REFLECTOR = np.array([2.0, 1.0, 0.0])
OFFSET_S, BIAS_M, ARM_M = 9.25, 0.6, np.array([0.3, 0.1, 0.0])


def rail(time_s):
    """Platform on the clock of motion capture: at rest, then along y with changing speed."""
    t = np.clip(np.asarray(time_s) - OFFSET_S - 4.2, 0.0, 3.9)
    y = 0.8 * t + 0.1 * np.sin(2.0 * t)
    return np.stack([np.full_like(y, -5.0), y - 0.5, np.full_like(y, 1.8)], axis=-1)


def profiles(time_s, range_start_m, range_bin_m, n):
    """Real echoes of one reflector, with a Gaussian pulse of 1.2 GHz, and the direct path."""
    path = np.linalg.norm(rail(time_s + OFFSET_S) + ARM_M - REFLECTOR, axis=1) + BIAS_M
    away = range_start_m + range_bin_m * np.arange(n) - path[:, None]
    k = 4 * np.pi * load_team6_rail.CARRIER_HZ / SPEED_OF_LIGHT
    echo = np.exp(-(away / 0.06) ** 2) * np.cos(k * away)
    return np.rint(5000 * echo + 30_000 * np.cos(0.3 * np.arange(n))).astype(np.int32)


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / 'npz'
    path.mkdir()
    time = np.round(np.arange(0.0, 10.4, 0.0173), 3)
    mocap = np.arange(0.0, 20.7, 1 / 360)
    np.savez(path / load_team6_rail.FILE, scan=profiles(time, 2.0, 0.009149, 960),
             scan_time_s=time, range_start_m=2.0, range_bin_m=0.009149, mocap_time_s=mocap,
             mocap_pos_m=rail(mocap), reflector_pos_m=REFLECTOR + [[0, 0, 0], [0.5, 2.0, 0.0]],
             fit_time_offset_s=OFFSET_S, fit_range_bias_m=BIAS_M, fit_lever_arm_m=ARM_M,
             nominal_time_offset_s=9.2, nominal_range_bias_m=0.4)
    return path


def peak(folder, kind, near, size_m=1.0, **options):
    """Where the image peaks near a place."""
    block, poses = load_team6_rail.read_folder(folder)
    located = locate(block, poses.track(), load_team6_rail.read_alignment(folder, kind))
    compressed = RangeCompressor.for_block(located, **options)(located)
    grid = MapGrid.from_size(near, size_m, size_m, 0.01)
    image = np.abs(exact_image(grid, compressed))
    row, column = np.unravel_index(image.argmax(), image.shape)
    return np.array([grid.x_m[column], grid.y_m[row]])


def test_a_reflector_focuses_where_it_stands_with_the_true_alignment(folder):
    # Times are rounded to 1 ms, at 0.9 m/s; pixels are 1 cm.
    assert np.abs(peak(folder, 'fitted', REFLECTOR) - REFLECTOR[:2]).max() <= 0.011
    # 50 ms at 0.9 m/s, 0.2 m of range and the lever arm: it must be elsewhere without them.
    assert np.linalg.norm(peak(folder, 'nominal', REFLECTOR) - REFLECTOR[:2]) > 0.05


def test_the_bag_has_raw_pulses_and_odometry_on_two_clocks(folder, tmp_path, capsys):
    output = tmp_path / 'bag'
    arguments = [str(folder), '--output', str(output), '--alignment', 'fitted']
    assert load_team6_rail.main(arguments) == 0
    block = concatenate(list(read_blocks(output)))
    assert block.radar.waveform == Waveform.PASSBAND and not block.compressed
    assert not block.has_positions
    assert not block.samples.imag.any()
    # What stands still is gone: the direct path was six times the echo. The median takes some
    # of the echo with it where that hardly moves.
    assert np.abs(block.samples.real).max() < 1.3 * 5000 * load_team6_rail.SAMPLE_SCALE
    start = load_team6_rail.START_NS
    assert 4.2 <= (block.stamp_ns[0] - start) * 1e-9 <= 4.22
    poses = read_poses(output)
    assert poses.stamp_ns[0] - start < 13.4e9 < 17.3e9 < poses.stamp_ns[-1] - start
    truth = read_truth(output)
    assert truth['alignment']['time_offset_s'] == OFFSET_S
    assert truth['alignment']['tx_m'] == [ARM_M.tolist()]
    assert load_team6_rail.main(arguments) == 1
    assert '--force' in capsys.readouterr().err


def test_other_files_are_refused(tmp_path, capsys):
    assert load_team6_rail.main([str(tmp_path), '--output', str(tmp_path / 'bag')]) == 1
    assert 'holds no team6_rail_trial6.npz and no team5_rail_pass_a.npz' in capsys.readouterr().err
    (tmp_path / load_team6_rail.FILE).write_text('no archive')
    with pytest.raises(BagError, match='cannot be read'):
        load_team6_rail.read_folder(tmp_path)
    np.savez(tmp_path / load_team6_rail.FILE, other=np.zeros(3))
    with pytest.raises(BagError, match='is not the team 6 recording'):
        load_team6_rail.read_folder(tmp_path)
    with pytest.raises(BagError, match='is not the team 6 recording'):
        load_team6_rail.read_alignment(tmp_path, 'fitted')


@pytest.mark.data
@pytest.mark.skipif(not MEASURED.is_dir(), reason='needs the team 6 recording in '
                    '../shared/data/bwsi2019_team6_rail beside the repository')
@pytest.mark.parametrize(('kind', 'limit_m'), [('nominal', 0.20), ('fitted', 0.10)])
def test_measured_reflectors_focus_near_the_survey(kind, limit_m):
    # Measured: 0.03 and 0.17 m with the nominal alignment, 0.03 and 0.08 m with the fitted one.
    for reflector in load_team6_rail.read_reflectors(MEASURED):
        found = peak(MEASURED, kind, tuple(reflector))
        assert np.linalg.norm(found - reflector[:2]) <= limit_m


@pytest.mark.data
@pytest.mark.skipif(not MEASURED.is_dir(), reason='needs the team 6 recording in '
                    '../shared/data/bwsi2019_team6_rail beside the repository')
def test_the_image_alone_tells_the_time_offset_and_says_what_it_cannot_tell():
    block, poses = load_team6_rail.read_folder(MEASURED)
    nominal = load_team6_rail.read_alignment(MEASURED, 'nominal')
    found, report = load_team6_rail.estimate_alignment(block, poses, nominal)
    assert report.accepted and report.contrast_after > report.contrast_before
    # The survey gives 9.2794 s, the nominal value is 54 ms off; measured 9.265 to 9.284 s.
    assert found.time_offset_s == pytest.approx(9.2794, abs=0.025)
    assert report.uncertainty['range_bias_m'] > 0.5 * load_team6_rail.EXPECTED_ERROR[
        'range_bias_m']
    assert found.range_bias_m == pytest.approx(nominal.range_bias_m, abs=0.01)


def test_too_little_to_see_leaves_the_alignment(folder):
    block, poses = load_team6_rail.read_folder(folder)
    nominal = load_team6_rail.read_alignment(folder, 'nominal')
    found, report = load_team6_rail.estimate_alignment(block, poses, nominal)
    assert not report.accepted
    assert found is nominal


@pytest.fixture
def other_folder(folder):
    """The same rail with the file of team 5: other names, the moving interval in the file."""
    with np.load(folder / load_team6_rail.FILE) as data:
        kept = {name: data[name] for name in data.files if not name.startswith(('fit', 'nominal'))}
    (folder / load_team6_rail.FILE).unlink()
    kept['reflector_pos_m'] = np.array([[-1.0, 1.1, 0.0]])
    np.savez(folder / load_team6_rail.TEAM_5.file, **kept, moving_s=[5.0, 7.0],
             reference_time_offset_s=OFFSET_S, reference_range_bias_m=BIAS_M)
    return folder


def test_the_other_recording_has_its_own_interval_and_alignment(other_folder, tmp_path, capsys):
    block, poses = load_team6_rail.read_folder(other_folder)
    start = load_team6_rail.START_NS
    assert 5.0 <= (block.stamp_ns[0] - start) * 1e-9 <= 5.02
    assert 6.98 <= (block.stamp_ns[-1] - start) * 1e-9 <= 7.0
    # three seconds of poses around, for clocks that are wrong
    assert (poses.stamp_ns[0] - start) * 1e-9 == pytest.approx(5.0 + OFFSET_S - 3.0, abs=0.03)
    alignment = load_team6_rail.read_alignment(other_folder, 'nominal')
    assert (alignment.time_offset_s, alignment.range_bias_m) == (OFFSET_S, BIAS_M)
    assert not alignment.tx_m.any()
    output = tmp_path / 'bag'
    arguments = [str(other_folder), '--output', str(output)]
    assert load_team6_rail.main([*arguments, '--alignment', 'fitted']) == 1
    assert 'the team 5 recording has no fitted alignment; use nominal or estimated' in \
        capsys.readouterr().err
    assert load_team6_rail.main([*arguments, '--wrong-by', '-1.5']) == 0
    truth = read_truth(output)
    assert truth['scenario'] == 'team5_rail'
    assert truth['alignment']['time_offset_s'] == pytest.approx(OFFSET_S - 1.5)
    assert truth['grid']['centre_m'] == list(load_team6_rail.TEAM_5.grid.centre_m)


def changed(folder, **values):
    """The same file with other arrays."""
    with np.load(folder / load_team6_rail.FILE) as data:
        kept = dict(data)
    np.savez(folder / load_team6_rail.FILE, **kept | values)


def test_another_pass_is_not_cut_as_the_known_one(folder):
    with np.load(folder / load_team6_rail.FILE) as data:
        late = data['mocap_time_s'] + 2.0  # the platform moves from 6.2 to 10.1 s
        still = np.tile(data['mocap_pos_m'][:1], (len(late), 1))
    changed(folder, mocap_time_s=late)
    with pytest.raises(BagError, match=r'pulses of 4.2 to 8.1 s .* moves from 6.\d to 10.\d s'):
        load_team6_rail.read_folder(folder)
    changed(folder, moving_s=[6.3, 10.1])
    block, _ = load_team6_rail.read_folder(folder)
    start = load_team6_rail.START_NS
    assert 6.3 <= (block.stamp_ns[0] - start) * 1e-9 <= 6.32
    changed(folder, mocap_pos_m=still)
    with pytest.raises(BagError, match='stands still'):
        load_team6_rail.read_folder(folder)


def test_a_short_motion_within_the_interval_is_told(folder):
    with np.load(folder / load_team6_rail.FILE) as data:
        time = data['mocap_time_s']
    # Moves for 1.9 of the 3.9 s; the rest would be imaged at rest.
    changed(folder, mocap_pos_m=rail(np.where(time > OFFSET_S + 6.1, OFFSET_S + 6.1, time)))
    with pytest.raises(BagError, match='another pass'):
        load_team6_rail.read_folder(folder)


def test_another_scene_gets_a_grid_around_its_reflectors(folder, tmp_path, capsys):
    far_m = np.array([[12.0, 1.0, 0.0], [15.0, 13.0, 0.0]])
    changed(folder, reflector_pos_m=far_m)
    assert load_team6_rail.main([str(folder), '--output', str(tmp_path / 'bag')]) == 0
    assert 'imaging around them' in capsys.readouterr().out
    grid = MapGrid(**read_truth(tmp_path / 'bag')['grid'])
    assert grid.centre_m == (13.5, 7.0, 0.0)
    assert grid.spacing_m == load_team6_rail.TEAM_6.grid.spacing_m
    # the known grid's 6.5 m along x, and a metre on both sides of the reflectors along y
    assert np.ptp(grid.x_m) == pytest.approx(6.5, abs=0.03)
    assert np.ptp(grid.y_m) == pytest.approx(14.0, abs=0.03)
    known = load_team6_rail.scene_grid(load_team6_rail.TEAM_6, np.array([[2.0, 1.0, 0.0]]))
    assert known == load_team6_rail.TEAM_6.grid


TEAM_5 = pathlib.Path(__file__).parents[4] / 'shared' / 'data' / 'bwsi2019_team5_rail'


@pytest.mark.data
@pytest.mark.skipif(not TEAM_5.is_dir(), reason='needs the team 5 recording in '
                    '../shared/data/bwsi2019_team5_rail beside the repository')
def test_the_reflector_of_team_5_is_where_an_independent_image_has_it():
    block, _ = load_team6_rail.read_folder(TEAM_5)
    assert block.samples.shape == (500, 1, 1152)
    # A float64 backprojection put it at (-1.00, 1.14) and a second object at (-0.10, 4.38) m.
    for place in ((-1.00, 1.14, 0.067), (-0.10, 4.38, 0.067)):
        assert np.abs(peak(TEAM_5, 'nominal', place, 0.6) - place[:2]).max() <= 0.03
