# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Check a parameter file: derived quantities, and what cannot work with what to change.

Run: python -m sar_imaging.tools.check_config sar_imaging/config/airborne_x_band.yaml
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence

import numpy as np

from sar_imaging.configuration.constraints import Finding, check, check_settings
from sar_imaging.configuration.derived import Derived, derive
from sar_imaging.configuration.parameters import (
    CHECKER,
    Configuration,
    read_configuration,
)
from sar_imaging.configuration.positions import check_positions, position_rows
from sar_imaging.configuration.report import lines, rows
from sar_imaging.configuration.settings import Acquisition, Imaging, Machine
from sar_imaging.files import naming, one_line
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.imaging.image import error_in_words
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.afbp.plan import AfbpPlan, plan_afbp
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.yaml_text import load_yaml

from .launching import named_config
from .program import command_parser, main_of

# A part of the problem that takes about a second; larger ones are faster per pixel and pulse.
MEASURED_PIXELS = 512
MEASURED_PULSES = 256

_EPILOG = f"""\
The file is a ROS parameter file. Its section /**/{CHECKER}, which no node reads, has the numbers
of radar and platform; without it only names, types and sizes are checked. docs/configuration.md
explains every quantity. Exit status: 0 when the configuration can work (warnings included), 1
when not, 2 for wrong options.

  check_config airborne_x_band.yaml
  check_config --measure my_radar.yaml
  check_config my_radar.yaml -p mode:=volume
"""


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = command_parser('check_config', 'Derive resolution, ambiguities, memory and time from a '
                       'parameter file, and refuse what cannot work.', _EPILOG)
    p.add_argument('file', type=named_config,
                   help='ROS parameter file, or name of a shipped one')
    p.add_argument('--measure', action='store_true',
                   help='measure how fast this machine images the configured geometry, instead '
                        'of assuming it; some seconds')
    p.add_argument('-p', dest='given', metavar='NAME:=VALUE', action='append', default=[],
                   type=_given, help='a value that every node gets besides, as from a launch '
                   'file; overrides the file')
    return p


def _given(text: str) -> tuple[str, object]:
    """Name and value of an argument."""
    name, separator, value = text.partition(':=')
    if not (separator and name):
        raise argparse.ArgumentTypeError(f'{text} is no NAME:=VALUE, such as mode:=volume')
    return name, load_yaml(value)


def run(arguments: argparse.Namespace) -> int:
    """Check the file and print what was found; returns the exit status."""
    configuration = read_configuration(arguments.file, dict(arguments.given))
    with naming(arguments.file, 'cannot work'):
        findings = [*configuration.findings, *_check(configuration, measure=arguments.measure)]
    sys.stdout.flush()  # the table first, also where both go into one log
    for finding in findings:
        print(f'{finding.severity}: {one_line(finding.text)}', file=sys.stderr)
    errors, warnings = (_counted(findings, severity) for severity in ('error', 'warning'))
    if errors:
        print(f'{arguments.file} cannot work: {errors}', file=sys.stderr)
        return 1
    sys.stderr.flush()
    known = '' if configuration.describes_radar else ' as far as can be told without a radar'
    print(f'{arguments.file} can work{known}: no errors, {warnings or "no warnings"}')
    return 0


def _counted(findings: Sequence[Finding], severity: str) -> str:
    """How many findings there are of a severity, in words; empty for none."""
    count = sum(f.severity == severity for f in findings)
    return f'{count} {severity}{"s" * (count > 1)}' if count else ''


def _check(configuration: Configuration, *, measure: bool) -> list[Finding]:
    """Print the table; returns what is wrong."""
    imaging, machine = configuration.imaging(), configuration.machine()
    if not configuration.describes_radar:
        print(f'no section /**/{CHECKER}: nothing is known about radar and platform, names, '
              'types and sizes alone were checked')
        return check_positions(configuration.nodes, None) + check_settings(imaging, machine)
    acquisition = configuration.acquisition()
    derived = derive(acquisition, imaging, machine)
    positions = check_positions(configuration.nodes, acquisition)
    findings = positions + check(acquisition, imaging, machine, derived)
    # What is impossible is told without planning or measuring it.
    possible = not any(f.severity == 'error' for f in findings)
    if possible and measure:
        machine = Machine(measure_rate(acquisition, imaging, derived), 'measured',
                          machine.memory_bytes)
        derived = derive(acquisition, imaging, machine)
        findings = positions + check(acquisition, imaging, machine, derived)
    table = [*position_rows(configuration.nodes, acquisition),
             *rows(acquisition, imaging, machine, derived)]
    if possible:
        row, forecast_findings = _forecast(acquisition, imaging, derived)
        table.append(row)
        findings += forecast_findings
    print('\n'.join(lines(table)))
    return findings


def _forecast(acquisition: Acquisition, imaging: Imaging,
              derived: Derived) -> tuple[tuple[str, str, str], list[Finding]]:
    """Row about sub-apertures, and an error where the mode needs what is impossible."""
    if imaging.mode == 'volume':
        return ('sub-apertures', 'none', 'they image maps, not volumes'), []
    try:
        plan = forecast_subapertures(acquisition, imaging, derived)
    except ValueError as error:
        findings = ([Finding('error', f'mode subapertures: {error}; set mode: image')]
                    if imaging.mode == 'subapertures' else [])
        return ('sub-apertures', 'none', f'mode image only: {error}'), findings
    pulses = plan.subapertures.sampling.pulses
    longest = max(some.stop - some.start for some in pulses)
    return ('sub-apertures', str(len(pulses)),
            f'pieces of up to {longest} pulses, in mode subapertures; '
            f'{error_in_words(plan.predicted_error_db)}'), []


def forecast_subapertures(acquisition: Acquisition, imaging: Imaging,
                          derived: Derived) -> AfbpPlan:
    """Plan AFBP for a configuration, on the straight track; takes some tenths of a second.

    Parameters
    ----------
    acquisition, imaging
        The configuration.
    derived : Derived
        What follows from it.

    Raises
    ------
    ValueError
        AFBP cannot image the scene; the text says why.
    """
    track = acquisition.track(imaging.pulses_per_aperture)[:, None]
    rx_m = track + acquisition.receiver_offsets()
    return plan_afbp(imaging.grid, derived.profile_radar, derived.n_profile,
                     np.broadcast_to(track, rx_m.shape), rx_m,
                     target_db=imaging.subaperture_target_db,
                     pulses_per_subaperture=imaging.subaperture_pulses or None)


def measure_rate(acquisition: Acquisition, imaging: Imaging, derived: Derived) -> float:
    """Pixels times pulses times channels that this machine backprojects per second.

    Parameters
    ----------
    acquisition, imaging
        The configuration; of its scene and aperture the middle is imaged.
    derived : Derived
        What follows from it.

    Returns
    -------
    float
        The faster of two runs, planning included.
    """
    full = imaging.grid
    grid = MapGrid(full.centre_m, min(full.n_x, MEASURED_PIXELS),
                   min(full.n_y, MEASURED_PIXELS), full.spacing_m)
    n_pulses = min(imaging.pulses_per_aperture, MEASURED_PULSES)
    track = acquisition.track(n_pulses)[:, None]
    shape = (n_pulses, acquisition.n_channels, derived.n_profile)
    samples = np.random.default_rng(1).standard_normal((*shape, 2), np.float32)
    profiles = PulseBlock(
        derived.profile_radar, True, np.arange(n_pulses), np.arange(n_pulses),
        samples.view(np.complex64)[..., 0],
        np.broadcast_to(track, (*shape[:2], 3)), track + acquisition.receiver_offsets())
    imager = plan_image(grid, derived.profile_radar, derived.n_profile, method='exact',
                        target_db=imaging.target_db)
    imager(profiles)  # compiles
    seconds = []
    for _ in range(2):
        started = time.perf_counter()
        imager(profiles)
        seconds.append(time.perf_counter() - started)
    return grid.n_x * grid.n_y * n_pulses * acquisition.n_channels / min(seconds)


main = main_of(parser, run)

if __name__ == '__main__':
    sys.exit(main())
