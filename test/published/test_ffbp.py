# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Fast factorised backprojection against float64 time-domain correlation of the same profiles."""

import dataclasses
import tracemalloc

import numpy as np
import pytest

from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.polar import PolarGrid
from sar_imaging.imaging.correlation import correlate
from sar_imaging.imaging.imager import plan_image
from sar_imaging.published.ffbp import TAPS, Node, half_bands, kernel_weights, plan_ffbp
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters
from sar_imaging.signal.spectra import band_spectrum

# Worst measured over the cases below, with up to five interpolations one after the other, is
# -52.6, -25.3 and -18.0 dB. Rounding is far below; the margin is for the choice of pixels.
LARGEST_ERROR_DB = {'knab8': -51.5, 'cubic': -24.3, 'linear': -17.0}


# Samples per reciprocal bandwidth, with which they are measured.
OVERSAMPLING = {'linear': 4.0, 'cubic': 2.5, 'knab8': 1.8}


def _imager(case, grid=None, *, kernel='knab8', progress=False, **own):
    block, both = case.block, OVERSAMPLING.get(kernel, 2.0)
    own = {'merge_factor': 2, 'range_oversampling': both, 'angle_oversampling': both, **own}
    return plan_image(grid or case.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                      method='ffbp', kernel=kernel, progress=progress, **own)


def _image(case, *arguments, **options):
    return _imager(case, *arguments, **options)(case.block).samples


def _error_db(case, image, points=None):
    """Error against TDC over the brightest and as many random pixels, dB."""
    flat = image.ravel()
    chosen = np.r_[np.argsort(np.abs(flat))[-200:],
                   np.random.default_rng(0).integers(0, flat.size, 200)]
    points = case.grid.points() if points is None else points
    reference = correlate(*band_spectrum(case.block), case.block.tx_m, case.block.rx_m,
                          points.reshape(-1, 3)[chosen])
    return 10 * np.log10(np.sum(np.abs(flat[chosen] - reference) ** 2)
                         / np.sum(np.abs(reference) ** 2))


@pytest.mark.parametrize('merge_factor', [2, 4])
@pytest.mark.parametrize('kernel', list(TAPS))
def test_every_kernel_and_merge_factor(make_case, kernel, merge_factor):
    case = make_case(1e3, pulses=128)
    imager = _imager(case, kernel=kernel, merge_factor=merge_factor, pulses_per_subaperture=8)
    assert [len(level.nodes) for level in imager.report.plan.levels] == {
        2: [16, 8, 4, 2], 4: [16, 4]}[merge_factor]
    assert _error_db(case, imager(case.block).samples) <= LARGEST_ERROR_DB[kernel]


@pytest.mark.parametrize(('pulses', 'per_subaperture', 'merge_factor'), [
    (48, 16, 2), (50, 4, 2), (50, 7, 3), (48, 48, 2), (11, 1, 4), (1, 16, 2), (90, 10, 16)])
def test_any_number_of_subapertures(make_case, pulses, per_subaperture, merge_factor):
    case = make_case(1e3, pulses=pulses)
    imager = _imager(case, pulses_per_subaperture=per_subaperture, merge_factor=merge_factor)
    assert len(imager.report.plan.levels[0].nodes) == -(-pulses // per_subaperture)
    assert _error_db(case, imager(case.block).samples) <= LARGEST_ERROR_DB['knab8']


@pytest.mark.parametrize('options', [
    {'range_m': 100.0, 'spacing_m': 0.1},
    {'range_m': 1e4, 'channels': 3},
    {'range_m': 5e4},
    {'range_m': 1e3, 'height_m': 500.0, 'channels': 3, 'heading_rad': 0.5},
    {'range_m': 1e3, 'heading_rad': -2.0},
    {'range_m': 1e3, 'bend_m': 5.0, 'channels': 3},  # curved track
    {'range_m': 1e3, 'bend_m': 3.0, 'height_m': 400.0},
], ids=str)
@pytest.mark.parametrize('kernel', ['knab8', 'cubic'])
def test_any_range_direction_height_and_track(make_case, options, kernel):
    case = make_case(**options, pulses=72)
    image = _image(case, kernel=kernel, pulses_per_subaperture=8)
    assert _error_db(case, image) <= LARGEST_ERROR_DB[kernel]


@pytest.mark.parametrize('kernel', list(TAPS))
def test_near_scene_is_merged_pixel_by_pixel(make_case, kernel):
    case = make_case(100.0, height_m=50.0, aperture_m=20.0, pulses=72, channels=2)
    imager = _imager(case, kernel=kernel, pulses_per_subaperture=8)
    assert any(not level.segment for level in imager.report.plan.levels[1:])
    assert _error_db(case, imager(case.block).samples) <= LARGEST_ERROR_DB[kernel]


def test_squint_and_perturbed_track(make_case):
    case = make_case(1e3, pulses=72)
    away = np.random.default_rng(3).normal(0.0, 0.05, (72, 1, 3))
    turn = np.array([[np.cos(0.6), np.sin(0.6), 0], [-np.sin(0.6), np.cos(0.6), 0], [0, 0, 1]])
    # The track turns under the scene that it looked at broadside; what it would have received
    # does not matter, any profiles will do.
    block = dataclasses.replace(case.block, tx_m=case.block.tx_m @ turn + away,
                                rx_m=case.block.rx_m @ turn + away)
    case = dataclasses.replace(case, block=block)
    image = _image(case, pulses_per_subaperture=8)
    assert _error_db(case, image) <= LARGEST_ERROR_DB['knab8']


@pytest.mark.parametrize('kernel', list(TAPS))
def test_polar_grid(make_case, kernel):
    case = make_case(1e3, pulses=64, height_m=200.0)
    # the map's 24 m about broadside, on the left of a track along -y
    grid = PolarGrid((0.0, 0.0, 200.0), (0.0, -1.0), 1, 0.0, 988.0, 0.25, 96, -0.012, 0.0002, 120)
    image = _image(case, grid, kernel=kernel, pulses_per_subaperture=8)
    assert image.shape == (120, 96) and image.dtype == np.complex64
    points = grid.lines(grid.range_m, grid.alpha[:, None])[0]
    assert _error_db(case, image, points) <= LARGEST_ERROR_DB[kernel]


def test_oversampling_lowers_the_error(make_case):
    case = make_case(1e3, pulses=64)
    errors = [_error_db(case, _image(case, kernel='linear', range_oversampling=v,
                                     angle_oversampling=v)) for v in (3.0, 6.0)]
    # linear interpolation: the error's amplitude falls with the square of the spacing, 12 dB
    assert errors[1] <= errors[0] - 9.0


@pytest.mark.parametrize('shape', [(1, 1), (1, 70), (70, 1), (5, 131)])
def test_any_image_shape(make_case, shape):
    case = make_case(1e3)
    grid = MapGrid(case.grid.centre_m, shape[1], shape[0], 0.11)
    image = _image(case, grid)
    points = grid.points()
    reference = correlate(*band_spectrum(case.block), case.block.tx_m, case.block.rx_m, points)
    # a small patch may hold no scatterer: compare with the brightest possible pixel
    assert np.abs(image - reference).max() < 3e-3 * np.abs(case.block.samples).max() * 48


def test_plan_serves_again(make_case):
    case = make_case(1e3)
    imager = _imager(case, pulses_per_subaperture=5)
    np.testing.assert_array_equal(imager(case.block), imager(case.block))


def test_one_image_per_level_is_alive(make_case):
    case = make_case(1e3, pulses=128, n=384)
    imager = _imager(case, pulses_per_subaperture=4)
    imager(case.block)  # compiled
    tracemalloc.start()
    imager(case.block)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    levels = imager.report.plan.levels
    images = 8 * sum(level.size for level in levels) + 8 * case.grid.n_x * case.grid.n_y
    together = 8 * sum(n.shape[0] * n.shape[1] for level in levels for n in level.nodes)
    # profiles of one sub-aperture and work space come on top
    assert peak <= images + 2_000_000 < together


@pytest.mark.parametrize('kernel', list(TAPS))
def test_weights_interpolate(kernel):
    taps = TAPS[kernel]
    weights = kernel_weights(kernel, 1.8).astype(float)
    samples = np.arange(taps) + 1 - taps // 2
    for t in (0.0, 0.3, 0.5, 1.0):
        w = weights @ (t - 0.5) ** np.arange(8)
        # exact at samples; the least frequencies to one part in a thousand between them
        if t in (0.0, 1.0):
            np.testing.assert_allclose(w, samples == t, atol=2e-5)
        assert w @ np.cos(0.02 * (samples - t)) == pytest.approx(1.0, abs=1e-3)
        assert w @ np.sin(0.02 * (samples - t)) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(('options', 'message'), [
    ({'kernel': 'sinc'}, 'expected one of linear, cubic, knab8'),
    ({'merge_factor': 1}, 'expected an integer of 2 or more'),
    ({'merge_factor': 2.5}, 'expected an integer of 2 or more'),
    ({'pulses_per_subaperture': 0}, 'expected an integer of 1 or more'),
    ({'range_oversampling': 1.2}, 'range_oversampling=1.2; expected more than 1.25'),
    ({'angle_oversampling': np.inf}, 'angle_oversampling=inf; expected more than 1'),
])
def test_bad_options_are_refused(make_case, options, message):
    with pytest.raises(ValueError, match=message):
        _imager(make_case(1e3), **options)


def test_malformed_positions_are_refused(make_case):
    case = make_case(1e3)
    block = case.block
    rest = (case.grid, block.radar, block.n_samples)
    with pytest.raises(ValueError, match='at least one pulse'):
        plan_ffbp(*rest, block.tx_m[:0], block.rx_m[:0])
    with pytest.raises(ValueError, match='expected the same'):
        plan_ffbp(*rest, block.tx_m[:5], block.rx_m)
    with pytest.raises(ValueError, match='NaN or infinity'):
        plan_ffbp(*rest, block.tx_m * np.nan, block.rx_m)
    coarse = dataclasses.replace(block.radar, sample_rate_hz=310e6)
    with pytest.raises(ValueError, match='1.25 times the bandwidth'):
        plan_ffbp(case.grid, coarse, block.n_samples, block.tx_m, block.rx_m)


@pytest.mark.parametrize('centre', [(0.0, 0.0, 0.0), (0.0, 1e3, 0.0), (20.0, 0.0, -990.0)])
def test_scene_around_ahead_or_below_is_refused(make_case, centre):
    case = make_case(1e3)
    with pytest.raises(ValueError, match='use exact backprojection'):
        _imager(case, MapGrid(centre, 96, 96, 0.5))


def test_scene_out_of_the_range_window_is_refused(make_case):
    case = make_case(1e3)
    with pytest.raises(ValueError, match='the profiles cover'):
        _imager(case, MapGrid((1500.0, 0.0, 0.0), 96, 96, 0.25))


def test_other_blocks_are_planned_anew_or_refused(make_case):
    case = make_case(1e3)
    imager, part = _imager(case), case.block.select(slice(0, 40))
    shorter = dataclasses.replace(case, block=part)
    assert _error_db(shorter, imager(part).samples) <= LARGEST_ERROR_DB['knab8']
    with pytest.raises(ValueError, match='raw pulses'):
        imager(dataclasses.replace(part, compressed=False))


def test_progress_bar(make_case, capsys):
    case = make_case(1e3)
    _image(case, progress=True)
    assert '3/3' in capsys.readouterr().err


def test_half_bands_are_the_largest_local_frequencies():
    """Numerical derivatives of the half path by range and by direction cosine."""
    rng = np.random.default_rng(4)
    n_pulses = 5  # those that are looked at
    tx, rx = (np.column_stack([np.linspace(-3.0, 3.0, n_pulses) + x, rng.normal(0, 0.1, n_pulses),
                               100 + rng.normal(0, 0.1, n_pulses)])[:, None] for x in (0.2, -0.4))
    radar = RadarParameters(carrier_hz=2e9, bandwidth_hz=300e6, sample_rate_hz=400e6,
                            first_sample_delay_s=0.0)
    centre = np.array([0.1, 0.05, 100.0])
    points = np.column_stack([rng.uniform(-150, 150, 20), rng.uniform(300, 600, 20), np.zeros(20)])
    r = np.linalg.norm(points - centre, axis=1)
    alpha = (points[:, 0] - centre[0]) / r

    def half_path(r, alpha):
        ground = np.sqrt(r ** 2 * (1 - alpha ** 2) - centre[2] ** 2)
        place = np.column_stack([centre[0] + r * alpha, centre[1] + ground, 0 * r])
        return 0.5 * sum(np.linalg.norm(c - place, axis=-1) for c in (tx, rx))

    step = 1e-4
    by_range = (half_path(r + step, alpha) - half_path(r - step, alpha)) / (2 * step)
    by_alpha = (half_path(r, alpha + step / 500) - half_path(r, alpha - step / 500)) / (
        2 * step / 500)
    band = 2 * np.pi * 300e6 / SPEED_OF_LIGHT  # half of the wavenumbers of both ways
    highest = 4 * np.pi * 2.15e9 / SPEED_OF_LIGHT
    wanted = (band * np.abs(by_range).max() + highest * np.abs(by_range - 1).max(),
              highest * np.abs(by_alpha).max())
    # beside it a level of two sub-apertures, from farther away
    node, away = Node(slice(0, n_pulses), 0, (), centre), centre - [0.0, 5.0, 0.0]
    others = [Node(slice(0, 3), 1, (), away), Node(slice(3, 5), 1, (), away)]
    found = half_bands([[node], others], tx, rx, points, radar)
    wanted = np.multiply(1.02, wanted)  # for what lies between
    assert [by_level[0] for by_level in found] == pytest.approx(wanted, rel=1e-5)
    alone = [half_bands([[n]], tx, rx, points, radar)[1][0] for n in others]
    assert found[1][1] == max(alone) and alone[0] != alone[1]


@pytest.mark.parametrize(('range_m', 'segment'), [(100.0, 48), (1e3, 112), (5e3, 112)])
def test_geometry_is_expanded_along_long_segments(make_case, range_m, segment):
    """Which is what makes merges quick; near the track over fewer pixels."""
    plan = _imager(make_case(range_m)).report.plan
    assert [level.segment for level in plan.levels[1:]] == [segment]
