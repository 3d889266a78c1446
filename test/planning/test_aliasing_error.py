# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What tapers do to the lines that a map is read from, against lines that were tapered."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from benchmarks.support.random_cases import random_case
from sar_imaging.backends.edge_brightness import EdgeBrightness
from sar_imaging.geometry import MapGrid
from sar_imaging.planning.afbp.plan import plan_afbp
from sar_imaging.planning.afbp.polar_grids import covers
from sar_imaging.planning.aliasing_error import (
    TONES,
    PixelDensity,
    aliasing_error,
    correction_error,
    guard_taper,
)
from sar_imaging.planning.interpolators import design_interpolator
from sar_imaging.planning.polar_cover import DEAPODISED_TAPS, DEGREE, cover_map


def _tone_error(frequency, n, guard, beta):
    """Mean squared error of a tapered tone between the guards, interpolated by its spectrum."""
    spectrum = np.fft.fft(guard_taper(n, guard, beta)
                          * np.exp(2j * np.pi / n * frequency * np.arange(n))) / n
    place = np.linspace(guard, n - guard, 5 * n, endpoint=False)
    read = np.exp(2j * np.pi / n * np.outer(place, n * np.fft.fftfreq(n))) @ spectrum
    return np.mean(np.abs(read - np.exp(2j * np.pi / n * frequency * place)) ** 2)


@pytest.mark.parametrize(('n', 'guard', 'beta', 'within_db'), [
    (30, 5.0, 2.0, 1.0), (84, 8.875, 3.75, 1.0), (181, 4.25, 1.5, 1.0), (301, 12.0, 5.0, 2.5)])
def test_tones_err_as_told_whatever_their_share_of_a_bin(n, guard, beta, within_db):
    """From bin to bin errors swing by up to 10 dB; tables of fewer cells lost where: 5 dB rms.

    Near the band's end, where an echo at the end of a sub-aperture holds most of the error.
    """
    frequency = round(0.36 * n) + np.arange(0, 3, 0.25)  # that the table has
    frequency = np.concatenate([frequency, -frequency])
    told = aliasing_error(n, guard, beta, frequency[:, None])
    measured = [_tone_error(f, n, guard, beta) for f in frequency]
    off = 10 * np.log10(told / measured)
    assert math.sqrt(np.mean(off ** 2)) < within_db  # measured: 0.1, 0.3, 0.6, 1.9


def test_places_and_densities_may_be_lists():
    n, guard, beta, place, density = 84, 8.9, 3.75, [0.0, 0.5, 1.0], [0.5, 1.5]
    frequency = [[20.0, 24.0, 28.0]]
    assert aliasing_error(n, guard, beta, frequency, place, density).tolist() == aliasing_error(
        n, guard, beta, np.array(frequency), np.array(place), np.array(density)).tolist()


@pytest.mark.parametrize(('first', 'last'), [(0.68, 0.81), (0.5, 0.8), (0.3, 0.8)])
def test_chirps_err_by_their_frequencies_at_the_guards(first, last):
    """Tapers widen the spectrum: the middle of a near scene errs by what its edges do.

    Told by the frequencies of each place, the middle was up to 30 dB better, the whole 3 to 7 dB.
    """
    n, guard, beta = 84, 8.9, 3.75
    place, parts = np.linspace(-0.5 * guard / (n - 2 * guard), 1, 5), np.zeros((2, 3))
    place[-1] = 1 - place[0]  # frequencies are those in the middle of the tapers
    read = np.linspace(guard, n - guard, 600, endpoint=False)

    def phase(cell, bins):
        u = (cell - guard) / (n - 2 * guard)
        cycles = bins[0] * u + (bins[1] - bins[0]) * u ** 2 / 2
        return np.exp(2j * np.pi * cycles * (n - 2 * guard) / n)

    for shift in np.arange(0, 1, 0.125):  # errors swing from bin to bin
        bins = np.array([first, last]) * n / 2 + shift
        spectrum = np.fft.fft(guard_taper(n, guard, beta) * phase(np.arange(n), bins)) / n
        error = np.exp(2j * np.pi / n * np.outer(read, n * np.fft.fftfreq(n))) @ spectrum
        error -= phase(read, bins)
        parts[0] += [np.mean(np.abs(part) ** 2) for part in np.split(error, 3)]
        parts[1] += [aliasing_error(n, guard, beta, bins[0] + place * (bins[1] - bins[0]),
                                    np.linspace(0, 1, 5), np.repeat(3 * (np.arange(3) == part), 8)
                                    )[()] for part in range(3)]
    assert np.abs(10 * np.log10(parts[1] / parts[0])).max() < 1.0  # measured: at most 0.6 dB


def _read_error(between, cycles, n, guard, beta, places):
    """Mean squared error of a tapered tone that is corrected and read at some places."""
    tone = np.exp(2j * np.pi * cycles * np.arange(n)) * guard_taper(n, guard, beta)
    spectrum = np.fft.fft(tone) * between.gain(np.fft.fftfreq(n))
    lines = np.fft.ifft(spectrum)
    read = np.zeros(len(places), complex)
    for i, place in enumerate(places):
        first, t = int(place), place % 1
        for tap in range(between.n_taps):
            weight = sum(w * t ** q for q, w in enumerate(between.weights[:, tap].astype(float)))
            read[i] += weight * lines[(first + between.first + tap) % n]
    return np.mean(np.abs(read - np.exp(2j * np.pi * cycles * places)) ** 2)


@pytest.mark.parametrize('oversampling', [1.12, 1.22, 1.5])
@pytest.mark.parametrize(('n', 'guard', 'beta'), [(36, 4.0, 4.0), (48, 5.2, 2.6), (400, 9.0, 6.0)])
def test_lines_mixed_with_tapered_ones_err_as_told(oversampling, n, guard, beta):
    between = design_interpolator(oversampling, taps=DEAPODISED_TAPS, degree=DEGREE,
                                  deapodised=True)
    share = 0.5 / TONES
    for number in (0, TONES // 2, int(TONES / oversampling) - 1):
        tones = (np.arange(TONES) == number).astype(float)
        cycles = (number + 0.5) * share
        # all of the grid between its guards is wanted, but for eight lines at each end
        density = np.zeros(n * 8)
        wanted = slice(*(round(8 * n * v / (n - 2 * guard)) for v in (8, n - 2 * guard - 8)))
        density[wanted] = 1
        density /= density.mean()
        wanted = PixelDensity(density, between=between, tones=tones)
        told = correction_error(wanted, n, guard, beta)
        places = np.linspace(guard + 8, n - guard - 8, 2000)
        all_lines = float(between.error_at(cycles))
        measured = _read_error(between, cycles, n, guard, beta, places)
        # Both errors add up but for what they have in common; a table of lines is coarse
        assert 10 * np.log10(measured) == pytest.approx(10 * np.log10(told + all_lines), abs=2.0)


def test_nothing_is_mixed_where_no_map_is_read():
    assert correction_error(PixelDensity(), 64, 5.0, 3.0) == 0.0


def _brightness(brighter_db, where):
    """Of an image of noise that is brighter in one place, judged for a map in its middle."""
    case = random_case(7)
    p = case.profiles
    plan = plan_afbp(case.grid, p.radar, p.n_samples, p.tx_m, p.rx_m, target_db=-50.0)
    fusion = plan.subapertures.fusion_grid
    rng = np.random.default_rng(1)
    parts = rng.normal(size=(2, fusion.n_coarse, fusion.n_coarse_range)).astype(np.float32)
    parts[(slice(None), *where(fusion))] *= np.float32(10 ** (brighter_db / 20))
    brightness = EdgeBrightness(fusion, plan.subapertures.sampling.coverage)
    brightness.add(parts)
    return brightness


@pytest.mark.parametrize('where', [
    lambda g: (slice(0, math.ceil(g.n_guard)),), lambda g: (slice(-math.ceil(g.n_guard), None),),
    lambda g: (slice(None), slice(0, g.range_guard)),
    lambda g: (slice(None), slice(-g.range_guard, None))], ids=['first', 'last', 'near', 'far'])
def test_bright_guards_are_noticed_on_each_side(where):
    # noise of a few hundred samples is known within 0.5 dB
    assert _brightness(20.0, where).uneven_db == pytest.approx(20.0, abs=1.0)
    assert _brightness(0.0, where).uneven_db == 0.0


def test_an_empty_image_beside_a_bright_edge_has_a_finite_figure():
    brightness = _brightness(-400.0, lambda g: (slice(math.ceil(g.n_guard), None),))
    assert 20.0 < brightness.uneven_db <= 100.0


@pytest.mark.parametrize('n_coarse', [9, 10, 11])
def test_images_of_hardly_more_lines_than_guards_are_judged_by_what_is_between(n_coarse):
    """As of a subscene from short sub-apertures: ten lines between two guards of 4.5."""
    case = random_case(7)
    p = case.profiles
    plan = plan_afbp(case.grid, p.radar, p.n_samples, p.tx_m, p.rx_m, target_db=-50.0)
    fusion = dataclasses.replace(plan.subapertures.fusion_grid, n_coarse=n_coarse,
                                 n_guard=n_coarse / 2 - 0.5, n_fine=2048)
    brightness = EdgeBrightness(fusion, plan.subapertures.sampling.coverage)
    brightness.add(np.ones((2, n_coarse, fusion.n_coarse_range), np.float32))
    assert brightness.uneven_db == 0.0


def test_a_bright_map_is_not_uneven():
    middle = _brightness(20.0, lambda g: (slice(math.ceil(g.n_guard), -math.ceil(g.n_guard)),
                                          slice(g.range_guard, -g.range_guard)))
    assert middle.uneven_db == 0.0 and middle.excess_db < -15.0


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 1999))
def test_a_cover_reaches_as_far_as_the_rows_of_its_map_read(seed):
    """Slanting rows, too; and what ends with the directions of the map itself does not."""
    case = random_case(seed)
    p = case.profiles
    rows = (a.reshape(-1, 3) for a in (p.tx_m, p.rx_m))
    cover = cover_map(case.grid, *rows, p.radar, p.n_samples, -60.0, -60.0,
                      fused=True)
    if cover is None:
        return
    assert covers(cover.polar, case.grid)
    grid = case.grid
    wider = MapGrid(grid.centre_m, grid.n_x + 64, grid.n_y + 64, grid.spacing_m)
    assert not covers(cover.polar, wider)
