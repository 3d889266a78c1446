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


def _errors(row: dict, prefix: str = '') -> str:
    """Error over the image, and of the brightest pixels in brackets."""
    return f'{row[prefix + "error_db"]} ({row[prefix + "brightest_error_db"]})'


def main() -> None:
    """Print the tables of all results there are."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--results', type=pathlib.Path, default=RESULTS)
    folder = parser.parse_args().results
    for name, describe in (('backprojection', backprojection), ('afbp', afbp)):
        path = folder / f'{name}.json'
        if path.exists():
            print(f'## {name}\n\n{describe(json.loads(path.read_text()))}\n')


if __name__ == '__main__':
    main()
