"""Measure what the operations of imaging cost on this machine, for plans and predicted times.

Run: python -m sar_imaging.tools.measure_costs --output costs.json
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path

from sar_imaging.planning.costs import DEFAULT, VARIABLE, CostModel

_DESCRIPTION = """\
Time small images on one thread, find the costs that explain their times best, and write them to a
file. It takes some 20 seconds; let the machine do nothing else.
"""


def parser() -> argparse.ArgumentParser:
    """Command line of this program."""
    made = argparse.ArgumentParser(
        description=_DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument('--output', type=Path, default=Path('costs.json'),
                      help='file for the costs (%(default)s)')
    return made


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns the exit status."""
    path = parser().parse_args(argv).output
    if not path.absolute().parent.is_dir():  # not after all the measuring
        print(f'error: {path.absolute().parent} is no folder; make it first', file=sys.stderr)
        return 1
    from sar_imaging.tools.costs.measurement import measure, solve

    try:
        model, predicted = solve(measure(progress=True))
        model.write(path)
    except OSError as error:
        print(f'error: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('interrupted; nothing is written', file=sys.stderr)
        return 130
    print(table(model))
    print(f'\nWith them the predicted times of {len(predicted)} experiments are '
          f'{predicted.min():.2f} to {predicted.max():.2f} of the measured ones.\n\n'
          f'{_usage(path)}')
    return 0


def table(model: CostModel) -> str:
    """Costs beside their defaults, a line each."""
    rows = [f'{"nanoseconds":17s}{"default":>12s}{"measured":>12s}{"ratio":>8s}']
    for name, usual in dataclasses.asdict(DEFAULT).items():
        value = getattr(model, name)
        rows.append(f'{name:17s}{usual:12.4g}{value:12.4g}{value / usual:8.2f}')
    return '\n'.join(rows)


def _usage(path: Path) -> str:
    return (f'Written to {path}. Programs and nodes that start with\n\n'
            f'    export {VARIABLE}={path.absolute()}\n\n'
            'plan with these costs. Their plans, and the last bits of their images, then differ '
            'from\nthose of other machines.')


if __name__ == '__main__':
    sys.exit(main())
