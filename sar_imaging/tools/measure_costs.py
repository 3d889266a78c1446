# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Measure what the operations of imaging cost on this machine, for plans and predicted times.

Run: python -m sar_imaging.tools.measure_costs --output costs.json
     python -m sar_imaging.tools.measure_costs --device --output device-costs.json
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import Any

from sar_imaging.backends import CUDA, backend
from sar_imaging.files import check_target
from sar_imaging.planning.costs import DEFAULT, CostModel

from .program import command_parser, main_of

_DESCRIPTION = """\
Time small images on one thread, find the costs that explain their times best, and write them to a
file. It takes some 20 seconds, on a device a minute or two; let the machine do nothing else.
"""


def parser() -> argparse.ArgumentParser:
    """Command line of this program."""
    made = command_parser(None, _DESCRIPTION)
    made.add_argument('--output', type=Path, default=Path('costs.json'),
                      help='file for the costs (%(default)s)')
    made.add_argument('--device', action='store_true',
                      help='costs of the CUDA device, by which plans are sent there or not, '
                      'instead of those of one thread')
    return made


def run(arguments: argparse.Namespace) -> str:
    """Measure and write the costs; returns what a person reads."""
    path, device = arguments.output, arguments.device
    check_target(path)  # not after all the measuring
    if not path.absolute().parent.is_dir():
        raise FileNotFoundError(f'{path.absolute().parent} is no folder; make it first')
    from sar_imaging.tools import costs

    name = CUDA if device else 'cpu'
    made: Any = backend(name)
    usual = made.DEFAULT if device else DEFAULT
    model, predicted = costs.solve(costs.measure(name, progress=True), usual)
    model.write(path)
    return (f'{table(model, usual)}\n\nWith them the predicted times of {len(predicted)} '
            f'experiments are {predicted.min():.2f} to {predicted.max():.2f} of the measured '
            f'ones.\n\n{_usage(path, device)}')


def table(model: CostModel, usual: CostModel = DEFAULT) -> str:
    """Costs beside their defaults, a line each."""
    rows = [f'{"nanoseconds":17s}{"default":>12s}{"measured":>12s}{"ratio":>8s}']
    for name, default in dataclasses.asdict(usual).items():
        value = getattr(model, name)
        rows.append(f'{name:17s}{default:12.4g}{value:12.4g}{value / default:8.2f}')
    return '\n'.join(rows)


def _usage(path: Path, device: bool) -> str:
    made: Any = backend(CUDA if device else 'cpu')
    if device:
        return (f'Written to {path}. Programs and nodes that start with\n\n'
                f'    export {made.VARIABLE}={path.absolute()}\n\n'
                "compute on the device, with backend 'auto', what is done there sooner by these "
                'costs.\nPlans stay the same.')
    return (f'Written to {path}. Programs and nodes that start with\n\n'
            f'    export {made.VARIABLE}={path.absolute()}\n\n'
            'plan with these costs. Their plans, and the last bits of their images, then differ '
            'from\nthose of other machines.')


main = main_of(parser, run)

if __name__ == '__main__':
    sys.exit(main())
