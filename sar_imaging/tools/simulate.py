# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulate a scenario or a configured radar and write a rosbag2 recording with its truth.

Run: python -m sar_imaging.tools.simulate psf --output bags/psf
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
from pathlib import Path
from typing import Any

from sar_imaging.configuration.datum import configured_datum
from sar_imaging.configuration.parameters import ConfigurationFileError, read_configuration
from sar_imaging.geometry.earth import Datum
from sar_imaging.simulation.scenarios import SCENARIOS
from sar_imaging.simulation.scenarios.catalogue import configured_scenario
from sar_imaging.simulation.scenarios.scenario import Scenario

from ..recordings.bag_io import check_target, with_progress, write_bag
from ..recordings.truth import antenna_truth, make_truth
from .arguments import positive
from .launching import named_config
from .program import command_parser, main_of

_EPILOG = """\
The recording is a rosbag2 folder (mcap) with the topic /pulses. The same command gives the same
bytes on every machine. Scene, grid and radar are stored in its metadata, where evaluate finds
them:

  python -m sar_imaging.tools.simulate letter_s --output out/bags/letter_s
  python -m sar_imaging.tools.evaluate out/bags/letter_s --output out/letter_s --launch-nodes

With --config a radar of your own sees five scatterers in its scene; the file is that of
check_config:

  python -m sar_imaging.tools.simulate --config my_radar.yaml --apertures 2
"""


def scenario_truth(scenario: Scenario, *, window: str = 'none', frame: str = 'map',
                   datum: Datum | None = None) -> dict[str, Any]:
    """Truth to store with a recording of the scenario, see `recordings.make_truth`."""
    truth = make_truth(
        scenario=scenario.name, description=scenario.description,
        scatterers=[{'name': s.name, 'position_m': list(s.position_m),
                     # Rounded: the last digit of a logarithm differs between machines.
                     'amplitude_db': round(s.amplitude_db, 9)} for s in scenario.scatterers],
        grid=scenario.grid, pulses_per_aperture=scenario.pulses_per_aperture,
        n_pulses=scenario.n_pulses, n_channels=scenario.n_channels,
        cut_half_width_m=scenario.cut_half_width_m, radar=scenario.radar,
        compressed=scenario.compressed, notes=scenario.notes, window=window, frame=frame,
        datum=datum) | antenna_truth(scenario.antenna)
    if scenario.movers:  # time zero of their positions is the middle of the recording
        truth['movers'] = [{'name': m.name, 'position_m': list(m.position_m),
                            'velocity_m_per_s': list(m.velocity_m_per_s),
                            'amplitude_db': round(20 * math.log10(abs(m.amplitude)), 9)}
                           for m in scenario.movers]
    return truth


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = command_parser('simulate', 'Simulate radar pulses and write them as a rosbag2 recording '
                       '(mcap) with the truth in its metadata.', _EPILOG)
    p.add_argument('scenario', nargs='?', metavar='SCENARIO',
                   help=f'one of {", ".join(SCENARIOS)}; --list describes them')
    p.add_argument('--config', type=named_config, metavar='FILE',
                   help='parameter file with the numbers of a radar and its platform, or name of '
                        'a shipped one, instead of a scenario')
    p.add_argument('--apertures', type=positive(int), default=1, metavar='N',
                   help='length of a recording with --config (default: %(default)s)')
    p.add_argument('--list', action='store_true', help='describe the scenarios and stop')
    p.add_argument('--output', type=Path, metavar='FOLDER',
                   help='bag folder to make (default: out/bags/SCENARIO)')
    p.add_argument('--pulses-per-message', type=positive(int), default=25, metavar='N',
                   help='pulses in one message (default: %(default)s); messages of 0.25 to 2 MB '
                        'travel best')
    p.add_argument('--noise-std', type=_not_negative, metavar='SIGMA',
                   help='standard deviation of the complex noise per sample, the echo of a unit '
                        "scatterer being 1 (default: the scenario's own)")
    p.add_argument('--seed', type=int, metavar='SEED',
                   help="seed of the noise (default: the scenario's own)")
    p.add_argument('--force', action='store_true', help='replace an existing bag')
    return p


def _not_negative(text: str) -> float:
    value = float(text)
    if not 0 <= value < float('inf'):
        raise argparse.ArgumentTypeError(f'{text} is not a finite number of at least 0')
    return value


def run(arguments: argparse.Namespace) -> str:
    """Write the recording; returns a line about it, or the list of scenarios."""
    name = arguments.scenario
    if arguments.list:
        return describe_scenarios()
    if arguments.config is not None:
        if name:
            parser().error(f'name a scenario, {name}, or --config, not both')
        return _write_configured(arguments)
    if name not in SCENARIOS:
        parser().error(f'scenario {name!r} is unknown; use one of {", ".join(SCENARIOS)}'
                       if name else 'name a scenario, or --list')
    return _write(SCENARIOS[name](), arguments)


def describe_scenarios() -> str:
    """One paragraph per scenario."""
    lines = []
    for name, make in SCENARIOS.items():
        s = make()
        kind = 'range profiles' if s.compressed else 'raw samples'
        size = s.n_pulses * s.n_channels * s.n_samples * 8 / 1e6
        lines += [name, f'    {s.description}.',
                  f'    {s.n_pulses} pulses x {s.n_channels} channels x {s.n_samples} {kind}, '
                  f'{size:.1f} MB, {s.n_pulses // s.pulses_per_aperture} aperture(s)']
    return '\n'.join(lines)


def _write_configured(arguments: argparse.Namespace) -> str:
    configuration = read_configuration(arguments.config)
    try:
        imaging = configuration.imaging()
        scenario = configured_scenario(arguments.config.stem, configuration.acquisition(),
                                       imaging, apertures=arguments.apertures)
        node = configuration.nodes['backprojection']
        return _write(scenario, arguments, window=imaging.window, frame=node['frame_id'],
                      datum=configured_datum(node))
    except ValueError as error:
        raise ConfigurationFileError(f'{arguments.config}: {error}; check_config says more'
                                     ) from error


def _write(scenario: Scenario, arguments: argparse.Namespace, *, window: str = 'none',
           frame: str = '', datum: Datum | None = None) -> str:
    if arguments.noise_std is not None:
        scenario = dataclasses.replace(scenario, noise_std=arguments.noise_std)
    if arguments.seed is not None:
        scenario = dataclasses.replace(scenario, seed=arguments.seed)
    output = arguments.output or Path('out/bags') / scenario.name
    check_target(output, overwrite=arguments.force)
    pulses = (dataclasses.replace(block, frame=frame)
              for block in scenario.blocks(arguments.pulses_per_message))
    count = write_bag(output, with_progress(pulses, scenario.n_pulses),
                      scenario_truth(scenario, window=window, frame=frame or 'map',
                                     datum=datum),
                      overwrite=arguments.force)
    return (f'{output}: {scenario.n_pulses} pulses of {scenario.n_channels} channels in {count} '
            f'messages, {len(scenario.scatterers)} scatterers')


main = main_of(parser, run)

if __name__ == '__main__':
    sys.exit(main())
