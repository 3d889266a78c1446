# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The reproduction of the spotlight letter: what it claims, and that the command runs."""

import dataclasses
import json

import numpy as np
import pytest

from benchmarks.reproduction import (
    letter_figures,
    letter_imagers as imagers,
    letter_measurements as measure,
    reproduce_spotlight_letter,
)
from benchmarks.reproduction.letter_recording import Recording
from benchmarks.reproduction.letter_scene import spotlight_letter
from benchmarks.reproduction.letter_spectra import measure_spectra
from sar_imaging.imaging.correlation import correlate
from sar_imaging.quality import error_db
from sar_imaging.signal.spectra import band_spectrum

FFBP_LINEAR = imagers.ffbp_name('linear', 1.3, 16)
FFBP_KNAB = imagers.ffbp_name('knab8', 1.8, 16)
AFBP = imagers.afbp_name(16)
SOME = (imagers.EXACT, FFBP_LINEAR, FFBP_KNAB, AFBP)
WHOLE = (FFBP_LINEAR, AFBP, imagers.afbp_name(None))


@pytest.fixture(scope='module')
def experiment():
    """The reflectors and no field: a scene just large enough for the subscene."""
    small = spotlight_letter('small')
    subscene = tuple(s for s in small.scatterers if not s.name.startswith('field'))
    return dataclasses.replace(small, scene_m=(96.0, 96.0), scatterers=subscene)


@pytest.fixture(scope='module')
def recording(experiment):
    samples = np.empty((experiment.n_pulses, experiment.n_samples), np.complex64)
    experiment.record(samples)
    return Recording(experiment, samples)


@pytest.fixture(scope='module')
def images(experiment, recording):
    grid = measure.subscene_grid(experiment)
    profiles = recording.patch_profiles(grid)
    return {name: measure.measure_subscene(form(grid, profiles).image, grid, experiment)
            for name, form in imagers.IMAGERS.items() if name in SOME}


def _sinc(offset):
    """Response of an unweighted aperture with nulls 0.15 m apart."""
    return np.sinc(offset / 0.15)


def test_windowed_phase_history_and_profiles_are_one_image(experiment, recording):
    """Correlation of the weighted spectra is what backprojection of the profiles forms."""
    grid = dataclasses.replace(measure.subscene_grid(experiment), n_x=40, n_y=30,
                               centre_m=experiment.scatterers[2].position_m)
    image = imagers.IMAGERS[imagers.EXACT](grid, recording.patch_profiles(grid)).image
    rows, columns = np.array([3, 14, 15, 22]), np.array([5, 19, 20, 33])
    points = grid.points()[rows, columns]
    expected = sum(correlate(*band_spectrum(b), b.tx_m, b.rx_m, points)
                   for b in recording.weighted_blocks())
    # The imager's own target is -80 dB.
    assert error_db(image[rows, columns], expected) < -75


def test_pair_of_separate_lobes():
    offset = np.arange(-600, 601) * 0.005
    cut = sum(a * np.exp(-((offset - x) / 0.05) ** 2)
              for a, x in ((1.0, -0.15), (0.5, 0.15), (0.1, 1.0)))
    pair = measure.measure_pair(cut, offset)
    assert pair.peaks_m == pytest.approx((-0.15, 0.15), abs=1e-6)
    assert pair.imbalance_db == pytest.approx(-6.02, abs=0.01)
    assert pair.sidelobe_db == pytest.approx(-20.0, abs=0.01)
    assert pair.dip_db < -60


def test_one_lobe_is_no_pair():
    offset = np.arange(-600, 601) * 0.005
    pair = measure.measure_pair(_sinc(offset - 0.03) + _sinc(offset + 0.03), offset)
    assert (pair.separation_m, pair.dip_db, pair.imbalance_db) == (0, 0, 0)
    # first sidelobe of a sinc -13.3 dB, of a slightly widened lobe less
    assert -16 < pair.sidelobe_db < -13


def test_phase_decides_whether_the_pair_separates():
    offset = np.arange(-600, 601) * 0.005
    pairs = measure.separability(_sinc(offset), offset)
    assert pairs[0].separation_m == 0
    # In quadrature powers add: sinc(1/2)^2 to (1 + sinc(1)^2) / 2, that is 2 (2/pi)^2.
    assert pairs[90].dip_db == pytest.approx(20 * np.log10(2 / np.pi) + 10 * np.log10(2), abs=0.1)
    assert pairs[180].dip_db < -60


def test_exact_image_has_the_closed_form_response(images):
    quality = images[imagers.EXACT].quality
    # Hamming: 1.303 of the nulls' spacing, c / 2B in range and wavelength R / 2 L in azimuth,
    # where R is point 3's 10534.6 m.
    assert quality.irw_range_m == pytest.approx(1.303 * 0.12922, rel=0.002)
    assert quality.irw_azimuth_m == pytest.approx(1.303 * 0.15 * 10534.6 / 10500, rel=0.003)
    # -42.7 dB and noise at -67 dB: a sidelobe may gain or lose half a decibel by it
    assert quality.pslr_range_db == pytest.approx(-42.7, abs=0.7)
    assert quality.pslr_azimuth_db == pytest.approx(-42.7, abs=0.7)
    assert abs(quality.position_error_azimuth_m) < 1e-3


def test_exact_image_separates_points_in_opposition(images):
    pair = images[imagers.EXACT].pair
    assert pair.dip_db < -40
    assert abs(pair.imbalance_db) < 0.1
    # behind the window both maxima are pushed outwards from 0.15 m
    assert pair.separation_m == pytest.approx(0.26, abs=0.01)


def test_ffbp_raises_the_sidelobes_unless_its_interpolation_is_good(images):
    """The letter has them "up to -15 dB"; linear interpolation near critical sampling does it."""
    level = {name: m.quality.pslr_azimuth_db for name, m in images.items()}
    assert -22 < level[FFBP_LINEAR] < -12  # measured -16.6 dB
    assert level[FFBP_KNAB] == pytest.approx(level[imagers.EXACT], abs=1)  # measured 0.2 dB
    assert error_db(images[FFBP_KNAB].image, images[imagers.EXACT].image) < -45  # -48.3 dB


def test_afbp_keeps_the_sidelobes_and_the_separation_of_the_exact_image(images):
    """The letter: below -25 dB with 16 pulses a sub-aperture, points 1 and 2 separated."""
    afbp, exact = images[AFBP], images[imagers.EXACT]
    assert afbp.quality.pslr_azimuth_db == pytest.approx(exact.quality.pslr_azimuth_db, abs=1)
    assert afbp.pair.dip_db < -40
    assert error_db(afbp.image, exact.image) < -50  # the imager's own target


def _share(magnitude, inside) -> float:
    """Energy where `inside` over all."""
    return float(np.sum(magnitude[inside] ** 2) / np.sum(magnitude ** 2))


def test_spectra_stand_where_the_pulses_were(experiment, recording):
    """Equation 16: the band of a sub-aperture is k times its place on the track."""
    spectra = measure_spectra(dataclasses.replace(recording, window='none'))
    stretch = 1 + spectra.frequency_hz / spectra.carrier_hz
    track = spectra.track_m[:, None] / stretch
    bins = np.diff(spectra.track_m)[0]
    start, stop = spectra.subaperture_m
    assert stop - start == pytest.approx(experiment.aperture_m / 16, rel=0.01)
    # The rest is in the skirts: of the finite image, and of the band's own drift with direction.
    beyond = 4 * bins
    assert _share(spectra.placed, (track > start - beyond) & (track < stop + beyond)) > 0.99
    half = experiment.aperture_m / 2 + beyond
    assert _share(spectra.fused, np.abs(track) < half) > 0.99
    # Folded it holds the same energy.
    assert np.sum(spectra.coarse ** 2) == pytest.approx(np.sum(spectra.placed ** 2), rel=1e-5)


def test_command_writes_figures_and_numbers(tmp_path, experiment, monkeypatch, capsys):
    monkeypatch.setattr(reproduce_spotlight_letter, 'spotlight_letter', lambda size: experiment)
    monkeypatch.setattr(reproduce_spotlight_letter, 'SCENE_SPACING_M', 0.5)
    monkeypatch.setattr(imagers, 'IMAGERS', {n: imagers.IMAGERS[n] for n in SOME})
    monkeypatch.setattr(imagers, 'WHOLE_SCENE', {n: imagers.WHOLE_SCENE[n] for n in WHOLE})
    monkeypatch.setattr(letter_figures, 'CUTS', SOME)
    monkeypatch.setattr(letter_figures, 'DPI', 40)
    monkeypatch.setattr(reproduce_spotlight_letter, 'CHECKED_PIXELS', 8)
    monkeypatch.setattr(reproduce_spotlight_letter, 'CHECKED_BRIGHTEST', 8)
    folder = tmp_path / 'new' / 'folder'
    assert reproduce_spotlight_letter.main(['--size', 'small', '--output', str(folder)]) == 0
    names = {f'figure_0{n}.png' for n in range(3, 9)}
    assert {p.name for p in folder.iterdir()} == names | {'results.json'}
    assert all((folder / n).read_bytes().startswith(b'\x89PNG') for n in names)
    results = json.loads((folder / 'results.json').read_text())
    assert set(results['points']) == set(SOME)
    assert set(results['scene']['imagers']) == set(WHOLE)
    for found in results['scene']['imagers'].values():
        assert found['peak_memory_gb'] > 0.05  # at least the interpreter
    assert 'whole scene' in capsys.readouterr().out


def test_command_reports_a_folder_it_cannot_make(tmp_path, capsys):
    (tmp_path / 'file').write_text('')
    assert reproduce_spotlight_letter.main(['--output', str(tmp_path / 'file' / 'x')]) == 1
    assert capsys.readouterr().err.startswith('error: ')
