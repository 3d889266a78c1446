# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Markdown tables of the results in `benchmarks/results`, for docs/benchmarks.md.

Run from the repository root: ``python -m benchmarks.tables``.
"""

from __future__ import annotations

import argparse
import json
import pathlib

RESULTS = pathlib.Path(__file__).parent / 'results'


def table(*columns: str, rows: list[list]) -> str:
    """Table with `columns` as its head."""
    lines = [columns, ['---'] * len(columns), *rows]
    return '\n'.join('| ' + ' | '.join(map(str, line)) + ' |' for line in lines)


def backprojection(results: dict) -> str:
    """Rates and errors of exact imagers, growth law and peak memory."""
    cases = results['cases']
    rates = [[f'{row["range_m"] / 1e3:g} km', f'{row["n_side"]}²',
              f'{row["n_pulses"]} × {row["n_channels"]}',
              f'{row["ours_rate"]} ({row["ours_method"]})', _errors(row, 'ours_'),
              row['fastsar_cubic_rate'], _errors(row, 'fastsar_cubic_'),
              row['fastsar_linear_rate'], _errors(row, 'fastsar_linear_'), row['ratio_to_cubic']]
             for row in cases]
    memory = [[f'{row["n_side"]}²', f'{row["n_pulses"]} × {row["n_channels"]}', row['input_mib'],
               row['output_mib'], round(row['peak_mib'] - row['output_mib'], 1)]
              for row in cases if 'peak_mib' in row]
    laws = '\n'.join(f'- {name}: exponent {value}'
                     for name, value in results['exponents'].items())
    return '\n\n'.join([
        table('range', 'pixels', 'pulses × channels', 'this project', 'error dB',
              'FastSAR cubic', 'error dB', 'FastSAR linear', 'error dB', 'ratio to cubic',
              rows=rates),
        laws,
        table('pixels', 'pulses × channels', 'profiles MiB', 'image MiB', 'more than both MiB',
              rows=memory)])


def afbp(results: dict) -> str:
    """Our own imagers side by side, and AFBP beside FastSAR."""
    own = [[f'{row["range_m"] / 1e3:g} km', name, entry['seconds'], entry['plan_s'],
            entry.get('predicted_db', ''), _errors(entry)]
           for row in results['imagers'] for name, entry in row.get('imagers', {}).items()]
    peer = [[f'{row["range_m"] / 1e3:g} km', f'{row["n_side"]}²', row['n_pulses'],
             *(value for name in ('afbp', 'fastsar')
               for value in (row[name]['seconds'], row[name]['plan_s'],
                             row[name]['predicted_db'], _errors(row[name]))), row['ratio']]
            for row in results['fastsar'] if 'refused' not in row]
    memory = [[f'{row["n_side"]}²', row['spectrum_mib'], row['peak_mib'],
               round(row['peak_mib'] / row['spectrum_mib'], 2)]
              for row in results['fastsar'] if 'peak_mib' in row]
    refused = [f'- refused: {row["range_m"] / 1e3:g} km, {row["n_side"]}²: {row["refused"]}'
               for name in ('imagers', 'fastsar') for row in results[name] if 'refused' in row]
    laws = [f'- {name}: exponent {value}' for name, value in results['exponents'].items()]
    return '\n\n'.join([
        table('range', 'imager', 'seconds', 'plan', 'predicted dB', 'error dB', rows=own),
        table('range', 'pixels', 'pulses', 'AFBP s', 'plan', 'predicted dB', 'error dB',
              'FastSAR s', 'plan', 'predicted dB', 'error dB', 'ratio', rows=peer),
        '\n'.join(laws + refused),
        table('pixels', 'fused spectrum MiB', 'peak MiB', 'ratio', rows=memory)])


def live(results: dict) -> str:
    """The live system: a table of each part of `benchmarks.live`."""
    def rows(part, *columns):
        return [[name, row['failed']] if 'failed' in row else
                [name, *(_entry(row, column) for column in columns)]
                for name, row in results.get(part, {}).items()]

    run = ('pulses_per_s', 'megabytes_per_s', 'images', 'losses', 'latency_ms',
           'processors.transport', 'processors.work', 'memory_mb')
    heads = ('', 'pulses/s', 'MB/s', 'images', 'losses', 'latency ms', 'transport', 'work', 'MB')
    tables = {
        'startup': table('', 'first image s', 'connected s', rows=rows(
            'startup', 'first_image_s', 'connected_s')),
        'flight': table(*heads, 'difference dB', rows=rows(
            'flight', *run, 'largest_difference_db')),
        'million': table(*heads, rows=rows('million', *run)),
        'progressive': table('', 'images', 'losses', 'progressive ms', 'final ms', rows=rows(
            'progressive', 'images', 'losses', 'progressive_latency_ms', 'final_latency_ms')),
        'sliding': table('', 'images', 'losses', 'latency ms', 'of complex images ms', 'fusion ms',
                         'processor ms',
                         rows=rows('sliding', 'images', 'losses', 'latency_ms',
                                   'complex_latency_ms', 'fusion_work_ms',
                                   'processor_ms_per_update')),
        'endurance': table('', 'times real time', 'pulses/s', 'minutes', 'images', 'losses',
                           'latency ms', 'growth ms/min', 'memory MB', 'growth MB/min',
                           rows=rows('endurance', 'rate', 'pulses_per_s', 'minutes', 'images',
                                     'losses', 'latency_ms', 'latency_ms.growth_per_minute',
                                     'memory_mb.last', 'memory_mb.slope_mb_per_minute'))}
    tables |= {part: table(heads[0], 'times real time', *heads[1:], rows=rows(part, 'rate', *run))
               for part in ('rate', 'transport')}
    loads = [row['load'] for part in tables for row in results.get(part, {}).values()]
    return '\n\n'.join([f'Load of the machine: {min(loads)} to {max(loads)}.',
                        *(f'### {part}\n\n{tables[part]}' for part in tables if part in results)])


def obstacles(results: dict) -> str:
    """Maps of obstacles beside the former rule."""
    names = {'former': 'former rule, one image', 'first': 'one image', 'all': 'three images'}
    strengths = [[name, names[rule], *(f'{found} of {n}' for found, n in
                                       platform[rule]['by_strength'].values())]
                 for name, platform in results['platforms'].items() for rule in names]
    columns = next(iter(results['platforms'].values()))['all']['by_strength']
    return '\n\n'.join([
        table('platform', 'map', 'found of those 10 dB above clutter', 'false cells per image',
              'most', 'scenes with any', rows=[
                  [name, names[rule], f'{100 * p[rule]["detection_probability"]:.1f} %',
                   p[rule]['false_cells_mean'], p[rule]['false_cells_max'],
                   f'{p[rule]["scenes_with_false_cells"]} of {p["scenes"]}']
                  for name, p in results['platforms'].items() for rule in names]),
        table('platform', 'map', *columns, rows=strengths),
        table('platform', 'error, median (cells)', '95 %', 'free', 'unknown', 's per image', rows=[
            [name, p['error_cells_median'], p['error_cells_95_percent'], p['free'], p['unknown'],
             p['seconds']] for name, p in results['platforms'].items()])])


def _entry(row: dict, column: str):
    """Value of a column of a table; ``a.b`` is within a group."""
    for key in column.split('.'):
        row = row.get(key, '') if isinstance(row, dict) else ''
    if column == 'losses':
        return ', '.join(f'{n} {key}' for key, n in row.items()) or 'none'
    if isinstance(row, dict):
        return f'{row["median"]} (at most {row["max"]})' if row else ''
    return row


def _errors(row: dict, prefix: str = '') -> str:
    """Error over the image, and of the brightest pixels in brackets."""
    return f'{row[prefix + "error_db"]} ({row[prefix + "brightest_error_db"]})'


def main() -> None:
    """Print the tables of all results there are."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--results', type=pathlib.Path, default=RESULTS)
    folder = parser.parse_args().results
    for name, describe in (('backprojection', backprojection), ('afbp', afbp),
                           ('live', live), ('obstacles', obstacles)):
        path = folder / f'{name}.json'
        if path.exists():
            print(f'## {name}\n\n{describe(json.loads(path.read_text()))}\n')


if __name__ == '__main__':
    main()
