# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The figures of README.md are those of the results that its table names, and of their pages."""

from __future__ import annotations

import json
import pathlib
import re
import statistics

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]


def _results(name: str) -> dict:
    return json.loads((ROOT / 'benchmarks' / 'results' / f'{name}.json').read_text())


def _from_to(values, digits: str = '.0f') -> str:
    return f'{max(values):{digits}} to {min(values):{digits}}'


def _backprojection():
    cases = _results('backprojection')['cases']
    ratios = [case['ours_rate'] / case['fastsar_cubic_rate'] for case in cases]
    errors = {name: _from_to([case[f'{name}_error_db'] for case in cases])
              for name in ('ours', 'fastsar_cubic', 'fastsar_linear')}
    return {'error': [f'{errors["ours"]} dB', f'cubic {errors["fastsar_cubic"]} dB',
                      f'linear {errors["fastsar_linear"]} dB'],
            'speed': [f'{min(ratios):.1f} to {max(ratios):.0f} times',
                      f'median {statistics.median(ratios):.1f}']}


def _robots():
    cases = _results('robots')['cases']
    ratios = [cases[name]['exact, -60 dB']['times_fastsar'] for name in ('R1', 'R2', 'R3', 'R4')]
    return {'what robots see': [f'{min(ratios):.0f} to {max(ratios):.0f} times']}


def _afbp():
    [case] = [case for case in _results('afbp')['fastsar']
              if (case['range_m'], case['n_side'], case['n_pulses']) == (10_000.0, 4096, 4096)]
    return {'4096² pixels, 4096 pulses, 10 km': [
        f'{case["afbp"]["seconds"]:.2f} s, {case["afbp"]["error_db"]} dB',
        f'{case["fastsar"]["seconds"]:.1f} s, {case["fastsar"]["error_db"]} dB']}


def _gpu():
    [case] = [case for case in _results('gpu')['cases'].values()
              if case['pixels'] == [8192, 8192] and case['pulses'] == 11_566]
    return {'11,566 pulses': [f'{1e3 * case["resident_s"]:.0f} ms, {case["error_db"]:.0f} dB',
                              f'{1e3 * case["end_to_end_s"]:.0f} ms']}


def _live():
    results = _results('live')
    nodes, pipeline = (results['flight'][way] for way in ('separate nodes', 'sar_pipeline'))
    long = results['endurance']['sar_pipeline']
    assert not (nodes['losses'] or pipeline['losses'] or long['losses'])
    assert nodes['largest_difference_db'] == pipeline['largest_difference_db']
    assert long['memory_mb']['last'] == pytest.approx(long['memory_mb']['first'], abs=1.0)
    latencies = [run['latency_ms']['median'] for run in (nodes, pipeline)]
    return {'a minute of flight': ['no pulse lost', f'{nodes["largest_difference_db"]} dB',
                                   '{:.0f} and {:.0f} ms'.format(*latencies)],
            'ten minutes at six times': [f'{long["megabytes_per_s"]:.0f} MB/s', 'no pulse lost',
                                         f'latency {long["latency_ms"]["median"]:.0f} ms']}


def _predictions():
    imagers = _results('predictions')['imagers'].values()
    judged = sum(imager['above_prediction_db']['n'] for imager in imagers)
    above = sum(len(imager['exceeding']) for imager in imagers)
    return {'predicted errors': [f'{above} of {judged:,} images more than 3 dB above']}


def _autofocus_flights():
    all_ = _results('autofocus_flights')['summary']['all']
    assert all_['falsely_claimed'] == 0
    return {f'autofocus of {all_["flights"]} random drone flights': [
        f'{all_["right"]} right, {all_["claimed"]} claimed, none falsely',
        f'{all_["right_before"]} right before']}


def _mistakes():
    results = _results('mistakes')
    judged = [case['named'] for case in results['cases'] if case['named'] is not None]
    assert not [case for case in results['right'] if case['mistake']]
    return {'twenty mistakes': [f'{sum(judged)} of {len(judged)} named, none in right data']}


def _obstacles():
    platforms = _results('obstacles')['platforms'].values()
    found = [100 * p['all']['detection_probability'] for p in platforms]
    false = [p['all']['false_cells_mean'] for p in platforms]
    before = [100 * p['former']['detection_probability'] for p in platforms]
    false_before = [p['former']['false_cells_mean'] for p in platforms]
    return {f'obstacles of {sum(p["scenes"] for p in platforms)} random scenes': [
        f'{min(found):.0f} to {max(found):.0f} % found',
        f'{min(false):.2f} to {max(false):.2f} false cells',
        f'{min(before):.0f} to {max(before):.0f} %, '
        f'{min(false_before):.0f} to {max(false_before):.0f}']}


def _exploitation():
    movers = _results('exploitation')['movers']
    five, one = (movers['systems'][name]['1e-06'] for name in ('five channels', 'one channel'))
    assert five['false_detections'] == 0
    return {f'moving targets of {movers["scenes"]} scenes': [
        f'{100 * five["detection_probability"]:.0f} % found, no false detection',
        f'one channel: {100 * one["detection_probability"]:.1f} %']}


def _conversions():
    times = {name: row['median_ms'] for name, row in _results('conversions')['results'][
        '4 MiB'].items() if isinstance(row, dict)}
    return {'4 MiB of pulses': [f'{times["pulse block to message"]:.2f} ms; '
                                f'{times["pulse block from message"]:.2f} ms',
                                f'plain copy {times["copy to memory in use"]:.2f} ms']}


FIGURES = {name.removeprefix('_'): function for name, function in {
    f.__name__: f for f in (_backprojection, _robots, _afbp, _gpu, _live, _predictions,
                            _autofocus_flights, _mistakes, _obstacles, _exploitation,
                            _conversions)}.items()}
# Pages that tell the same of a file, in these words.
PAGES = {'afbp': ('benchmarks.md', ['0.23', '-66.5', '-60.3']),
         'backprojection': ('benchmarks.md', ['6.7 to 35, median 11.6']),
         'live': ('live_performance.md', ['-90.9']),
         'mistakes': ('troubleshooting.md', ['135 of 137']),
         'gpu': ('gpu.md', ['147 ms'])}


def _rows() -> list[tuple[str, str]]:
    """Rows of the table in README.md, and the results that each names."""
    return re.findall(r'^(\| .*)\| \[\w+\]\(benchmarks/results/(\w+)\.json\) \|$',
                      (ROOT / 'README.md').read_text(), re.MULTILINE)


def test_every_row_names_results_that_are_compared():
    assert {name for _, name in _rows()} == FIGURES.keys()


@pytest.mark.parametrize('name', FIGURES)
def test_figures_of_the_read_me_are_those_of_the_results(name):
    for case, told in FIGURES[name]().items():
        [row] = [row for row, of in _rows() if of == name and f'| {case}' in row
                 or of == name and case in row.split('|')[1]]
        for figure in told:
            assert figure in row, f'README.md tells {row}; {name}.json has {figure}'


@pytest.mark.parametrize('name', PAGES)
def test_pages_tell_the_figures_of_the_read_me(name):
    page, figures = PAGES[name]
    text, told = (ROOT / 'docs' / page).read_text(), '\n'.join(
        row for row, of in _rows() if of == name)
    for figure in figures:
        assert figure in text, f'docs/{page} does not tell {figure}'
        assert all(part in told for part in re.findall(r'-?[\d.]+', figure)), figure


def test_the_read_me_is_short():
    text = (ROOT / 'README.md').read_text()
    assert len(text.splitlines()) <= 150
    assert len(re.findall(r'!\[', text)) == 2
