# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Sub-aperture images by way of beams, against exact backprojection to the same pixels."""

import dataclasses
import types

import numba
import numpy as np
import pytest

from benchmarks.support.references import exact_image
from sar_imaging.backends.cpu.beams import ECHOES, BeamformedSubaperture
from sar_imaging.geometry.half_paths import sample_paths
from sar_imaging.planning.afbp.beams import plan_beams
from sar_imaging.planning.afbp.plan import plan_afbp
from sar_imaging.planning.profiles import RangeGate, plan_resampling
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock

_PADDING = 64  # samples; echoes lie further apart than they would in practice


@dataclasses.dataclass(frozen=True)
class _Stage:
    """A sub-aperture, the coarse polar grid that its aperture was planned with, and its beams."""

    block: PulseBlock
    coarse: object
    lines: BeamformedSubaperture
    predicted_error_db: float


def _echoes(block):
    return block.tx_m.reshape(-1, 3), block.rx_m.reshape(-1, 3)


def _stage(grid, block, pulses, target_db):
    """Beams for some pulses of a block, or None, on the grid that AFBP chooses for all.

    Sub-apertures are 10 dB better than what is wanted of the image.
    """
    plan = plan_afbp(grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                     target_db=target_db + 10.0, pulses_per_subaperture=32).subapertures
    radar, window = block.radar, RangeGate.whole(block.radar, block.n_samples)
    part = block.select(pulses)
    r, alpha = (v.ravel() for v in np.meshgrid(plan.polar.range_m[[0, -1]],
                                               plan.polar.alpha[[0, -1]]))
    paths = sample_paths(*_echoes(block), plan.polar.lines(r, alpha))
    resampling = plan_resampling(paths, plan.polar.range_spacing_m, plan.polar.n_range, radar,
                           window.n_samples + _PADDING, target_db)
    range_m = paths.length.min() - 3.0, paths.length.max() + 3.0
    beams = plan_beams(plan.polar, radar, resampling, [_echoes(part)], target_db,
                       range_m[1] - range_m[0], _PADDING * radar.sample_spacing_m)
    if beams is None:
        return None
    lines = BeamformedSubaperture(types.SimpleNamespace(
        coarse=plan.polar, source=window, resampling=resampling, beams=beams, range_m=range_m,
        amplitudes=None))
    return _Stage(part, plan.polar, lines, beams.predicted_error_db)


def _image(stage, weights=None):
    polar, (tx, rx) = stage.coarse, _echoes(stage.block)
    parts = np.empty((2, polar.n_alpha, polar.n_range), np.float32)
    stage.lines.fill(stage.block.samples.reshape(len(tx), -1), tx, rx, parts, weights)
    return parts


def _error_db(stage, exact, weights=None):
    polar, parts = stage.coarse, _image(stage, weights)
    cycles = 2 * (polar.range_m - polar.range_start_m) * stage.block.radar.carrier_hz
    exact = exact * np.exp(-2j * np.pi * np.fmod(cycles / SPEED_OF_LIGHT, 1.0))
    # in the middle of the grid every echo has its profile, whatever the geometry
    inside = slice(polar.n_range // 5, -(polar.n_range // 5))
    error = (parts[0] + 1j * parts[1] - exact)[:, inside]
    return 10 * np.log10(np.sum(np.abs(error) ** 2) / np.sum(np.abs(exact[:, inside]) ** 2))


def _exact(stage, block):
    polar = stage.coarse
    points = np.ascontiguousarray(polar.lines(polar.range_m[None, :], polar.alpha[:, None])[0])
    return exact_image(points, block)


GEOMETRIES = [
    {'range_m': 100.0, 'aperture_m': 1.0}, {'range_m': 1e3}, {'range_m': 5e3, 'aperture_m': 60.0},
    {'range_m': 5e4, 'aperture_m': 100.0}, {'range_m': 1e3, 'channels': 5},
    {'range_m': 1e3, 'bend_m': 3.0}, {'range_m': 1e3, 'height_m': 500.0, 'heading_rad': 2.5}]


@pytest.mark.parametrize('target_db', [-60.0, -75.0])
@pytest.mark.parametrize('options', GEOMETRIES, ids=str)
def test_beams_are_as_exact_as_predicted(make_case, options, target_db):
    case = make_case(n=96, pulses=96, n_points=100, **options)
    # from the end of the aperture, where lines bend most; echoes do not fill the last block
    stage = _stage(case.grid, case.block, slice(0, 2 * ECHOES + 3), target_db)
    error = _error_db(stage, _exact(stage, stage.block))
    # Measured: 0.5 to 5 dB better; 1.5 to 6 dB better at -75 dB. At -60 dB 12 dB worse where the
    # growth of errors that start again with each group is left out
    assert error <= stage.predicted_error_db + 1.0 <= target_db + 1.0


@pytest.mark.parametrize('target_db', [-60.0, -75.0])
def test_gains_follow_a_wide_band(make_case, target_db):
    """An echo's frequency from beam to beam changes by 30 % over the band, and its gain too."""
    case = make_case(3e3, n=96, pulses=96, n_points=100, aperture_m=150.0, carrier_hz=1e9)
    stage = _stage(case.grid, case.block, slice(0, 2 * ECHOES + 3), target_db)
    # Measured: 10 dB better
    assert _error_db(stage, _exact(stage, stage.block)) <= stage.predicted_error_db + 1.0


@pytest.mark.parametrize('target_db', [-60.0, -75.0])
def test_profiles_sampled_finer_than_cells(make_case, target_db):
    """What their cut ends leave beyond the band would ring where the spectrum of cells ends."""
    case = make_case(1e3, n=96, pulses=96, n_points=100)
    block, n = case.block, case.block.n_samples
    spectrum = np.fft.fftshift(np.fft.fft(block.samples), axes=-1)
    spectrum = np.pad(spectrum, ((0, 0), (0, 0), (n // 2, n // 2)))
    samples = 2 * np.fft.ifft(np.fft.ifftshift(spectrum, axes=-1))
    radar = dataclasses.replace(block.radar, sample_rate_hz=2 * block.radar.sample_rate_hz)
    block = dataclasses.replace(block, radar=radar, samples=samples.astype(np.complex64))
    stage = _stage(case.grid, block, slice(0, 2 * ECHOES + 3), target_db)
    # Measured: 2 to 3 dB better than predicted; 2.8 dB worse at -75 dB without the taper
    assert _error_db(stage, _exact(stage, stage.block)) <= stage.predicted_error_db + 1.0


def test_curvature_is_that_of_each_distance(make_case):
    """The scene is half as deep as it is far; without the second derivative 18 dB are lost."""
    case = make_case(100.0, n=128, spacing_m=0.4, pulses=64, aperture_m=3.0, n_points=100)
    stage = _stage(case.grid, case.block, slice(0, 16), -50.0)
    assert _error_db(stage, _exact(stage, stage.block)) <= stage.predicted_error_db + 1.0


def test_echoes_are_weighted(make_case):
    case = make_case(1e3, n=96, pulses=96, n_points=50)
    stage = _stage(case.grid, case.block, slice(20, 30), -60.0)
    weights = np.hamming(10).astype(np.float32)
    weighted = dataclasses.replace(
        stage.block, samples=stage.block.samples * weights[:, None, None])
    assert _error_db(stage, _exact(stage, weighted), weights) <= -59.0


def test_single_row(make_case):
    case = make_case(1e3, n=96, pulses=96, n_points=50)
    stage = _stage(case.grid, case.block, slice(7, 8), -60.0)
    assert _error_db(stage, _exact(stage, stage.block)) <= stage.predicted_error_db + 1.0


def test_echoes_too_far_apart_for_beams_have_none(make_case):
    case = make_case(1e3, n=96, pulses=96, n_points=5, aperture_m=60.0)
    assert _stage(case.grid, case.block, slice(0, 32), -60.0) is None


def test_echoes_at_uneven_places(make_case):
    """Rows on opposite sides of the centre that are not opposite do not share phasors."""
    rng = np.random.default_rng(3)
    track = np.zeros((64, 3))
    track[:, 1] = np.linspace(-8.0, 8.0, 64) + rng.normal(0, 0.05, 64)
    track[:, [0, 2]] = rng.normal(0, 0.01, (64, 2))
    case = make_case(1e3, n=96, pulses=64, n_points=100, track_m=track)
    stage = _stage(case.grid, case.block, slice(0, 21), -60.0)
    # Measured: -63.4 dB; -38 dB where they are made to share
    assert _error_db(stage, _exact(stage, stage.block)) <= stage.predicted_error_db + 1.0


def test_echoes_beside_the_track(make_case):
    """Beams whose paths bend between the sides of their group share no phasors."""
    track = np.zeros((64, 3))
    track[:, 1] = np.linspace(-8.0, 8.0, 64)
    track[:, 0] = np.random.default_rng(3).normal(0, 0.3, 64)
    case = make_case(1e3, n=96, pulses=64, n_points=100, track_m=track)
    stage = _stage(case.grid, case.block, slice(0, 11), -50.0)
    # Measured: -55.4 dB, predicted -50.0; -42.6 dB with beams chosen without regard to it
    assert _error_db(stage, _exact(stage, stage.block)) <= stage.predicted_error_db + 1.0


@pytest.mark.parametrize('n_echoes', [8, 24])
def test_few_echoes_beside_the_track_near_by(make_case, n_echoes):
    """Beams lie so far apart that those beside the grid see other paths than those within."""
    track = np.zeros((96, 3))
    track[:, 1] = np.linspace(-0.25, 0.25, 96)
    track[:, 0] = np.random.default_rng(3).normal(0, 0.1, 96)
    case = make_case(100.0, n=96, pulses=96, n_points=200, extent=1.5, track_m=track)
    stage = _stage(case.grid, case.block, slice(0, n_echoes), -60.0)
    # Measured: -68 and -70 dB, predicted -67
    assert _error_db(stage, _exact(stage, stage.block)) <= stage.predicted_error_db + 1.0


def test_number_of_threads_changes_nothing(make_case, monkeypatch):
    case = make_case(1e3, n=96, pulses=96, n_points=50)
    images = []
    for n_threads in (1, 2, 7):
        monkeypatch.setattr(numba, 'get_num_threads', lambda n=n_threads: n)
        images.append(_image(_stage(case.grid, case.block, slice(20, 31), -60.0)))
    np.testing.assert_array_equal(images[1], images[0])
    np.testing.assert_array_equal(images[2], images[0])
