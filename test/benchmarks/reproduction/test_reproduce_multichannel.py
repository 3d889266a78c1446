# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The reproduction of Rosenberg & Gray: what it claims, and that the command runs."""

import json

import numpy as np
import pytest

from benchmarks.reproduction import (
    multichannel_measurements as measure,
    reproduce_multichannel,
)


def _ignore():
    pass


@pytest.fixture
def fewer_pixels(monkeypatch):
    every = measure.letter_points
    monkeypatch.setattr(measure, 'letter_points', lambda *where: every(*where)[::3])


@pytest.mark.parametrize('rate_hz', measure.RATES_HZ)
def test_islr_of_correlation_is_the_papers(rate_hz):
    measured = measure.measure_point_spread(rate_hz, [50], _ignore)
    assert measured.tdc_islr_db == pytest.approx([-10.49, -10.53], abs=0.02)


def test_islr_between_given_nulls():
    offset = np.linspace(-3, 3, 601)
    # Main lobe of a sinc holds 0.9028 of its energy; within six nulls there is 0.9832 of it.
    expected = 10 * np.log10((0.9832 - 0.9028) / 0.9028)
    assert measure.islr_db(np.sinc(2 * offset), offset, 0.5) == pytest.approx(expected, abs=0.02)


def test_ratio_within_is_the_last_to_settle():
    spread = measure.PointSpread(
        6e8, [], [], [], [-10.0, -10.0], {}, np.array([20, 30, 40]),
        np.array([[-10.0, -5.0], [-9.0, -10.0], [-10.2, -8.0]]))
    assert spread.ratio_within(0.5) == [40, None]
    assert spread.ratio_within(5.0) == [20, 20]


@pytest.mark.usefixtures('fewer_pixels')
@pytest.mark.parametrize('rate_hz', measure.RATES_HZ)
def test_bumps_follow_the_pixel_columns(rate_hz):
    """1 dB and more at an odd multiple of 25, reversed by 1/50 of a sample; none at 0.1 m."""
    measured = measure.measure_distortion(rate_hz, [74, 75, 76], _ignore)
    on, half_way, grid = (measured.bumps_db(p)[75] for p in measure.PLACEMENTS)
    assert on > 0.8 and half_way < -0.8
    assert abs(grid) < 0.6


def test_published_wavenumber_image_loses_half_the_corner():
    compared = measure.compare_imagers(measure.RATES_HZ[0], 0.25, _ignore)
    published, default = 'wavenumber, as published', 'wavenumber, default'
    # At the very edge the interpolation passes half the amplitude and repeats the other half.
    assert compared.corner_db[published] == pytest.approx(-6.0, abs=0.1)
    assert compared.ghost_db[published] == pytest.approx(-6.0, abs=0.1)
    for name in ('TDC', 'BP, ratio 100', default):
        assert abs(compared.corner_db[name]) < 0.2
        assert compared.ghost_db[name] < -25.0


def test_table_3_is_table_2_evaluated():
    computed = measure.complexity(**reproduce_multichannel.TABLE_3)
    for name, printed in reproduce_multichannel.PAPER['table_3'].items():
        assert computed[name] == pytest.approx(printed, rel=0.01)  # two digits are printed


@pytest.mark.usefixtures('fewer_pixels')
def test_command_writes_figures_and_numbers(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(measure, 'ratios', lambda quick: [20, 74, 75, 76])
    monkeypatch.setattr(measure, 'SHOWN_RATIOS', (20,))
    monkeypatch.setattr(reproduce_multichannel, 'SPACING_M', 0.2)  # of --quick, a quarter
    folder = tmp_path / 'new' / 'folder'
    assert reproduce_multichannel.main(['--quick', '--output', str(folder)]) == 0
    names = {f'figure_{n}.png' for n in ('05', '06', '07', '08', '09', '09_bumps', '10', '11')}
    assert {p.name for p in folder.iterdir()} == names | {'results.json'}
    assert all((folder / n).read_bytes().startswith(b'\x89PNG') for n in names)
    results = json.loads((folder / 'results.json').read_text())
    assert set(results['by_sample_rate']) == {'600 MHz', '400 MHz'}
    at_600 = results['by_sample_rate']['600 MHz']
    assert at_600['figure_9_bumps']['on samples']['at_multiples_of_25_db']['75'] > 0.8
    assert set(results['run_time']['seconds']) == {'TDC', 'wavenumber', 'BP', 'exact'}
    assert 'TDC, ISLR in range (dB)' in capsys.readouterr().out


def test_command_reports_a_folder_it_cannot_make(tmp_path, capsys):
    (tmp_path / 'file').write_text('')
    assert reproduce_multichannel.main(['--output', str(tmp_path / 'file' / 'x')]) == 1
    assert capsys.readouterr().err.startswith('error: ')
