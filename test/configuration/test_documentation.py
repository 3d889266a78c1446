# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The page on configuration tells what the checker derives and reads."""

import contextlib
import io
import pathlib
import re

import pytest

from sar_imaging.configuration import derive
from sar_imaging.configuration.parameters import (
    CHECKER_PARAMETERS,
    default_file,
    read_configuration,
)
from sar_imaging.configuration.report import rows
from sar_imaging.tools.launching import ARGUMENTS, REPLAY_ARGUMENTS

from .conftest import MACHINE

PAGE = (pathlib.Path(__file__).parents[2] / 'docs' / 'configuration.md').read_text()
PLATFORMS = ('airborne_x_band', 'drone_uwb', 'automotive_77ghz')


def section(title):
    return PAGE.split(f'# {title}\n')[1].split('\n#')[0]


def derived_rows(name):
    configuration = read_configuration(default_file().with_name(f'{name}.yaml'))
    setup = configuration.acquisition(), configuration.imaging(), MACHINE
    return {name: value for name, value, _ in rows(*setup, derive(*setup))}


@pytest.mark.parametrize('name', PLATFORMS)
def test_the_table_of_platforms(name):
    [row] = [line for line in PAGE.splitlines() if line.startswith(f'| [`{name}.yaml`]')]
    derived = derived_rows(name)
    assert f'| {derived["range resolution"]} × {derived["azimuth resolution"]} |' in row
    assert f'| {derived["input"]} |' in row


def test_every_derived_line_is_explained():
    documented = re.findall(r'^\| `([^`]+)`', section('What is derived'), re.MULTILINE)
    printed = []
    for name in PLATFORMS:
        printed += [re.sub(r'^memory of .*', 'memory of', row) for row in derived_rows(name)]
    assert set(documented) == {*printed, 'sub-apertures', 'positions', 'clock of the poses',
                               'datum'}


def test_every_number_of_radar_and_platform_is_explained():
    table = section('Radar and platform')
    documented = []
    for names in re.findall(r'^\| (`.+?`) \|', table, re.MULTILINE):
        first, *others = re.findall(r'`([^`]+)`', names)
        documented += [first, *(first[:-2] + other for other in others)]
    assert documented == list(CHECKER_PARAMETERS)
    for name, default in CHECKER_PARAMETERS.items():
        if not isinstance(default, type) and not name.startswith(('radar.sample_rate',
                                                                  'platform')):
            text = str(default).lower() if isinstance(default, bool) else str(default)
            assert f'| `{name}` | {text} |' in table


def test_every_argument_of_the_launch_files_is_explained():
    table = section('Starting the nodes').split('| argument |')[1]
    first_cells = ''.join(re.findall(r'^\| (`[^|]*) \|', table, re.MULTILINE))
    documented = re.findall(r'`(\w+)`', first_cells)
    assert documented == [name for name, *_ in (*ARGUMENTS, *REPLAY_ARGUMENTS)]


def test_the_python_example_runs():
    code = re.search(r'^```python\n(from sar_imaging.*?)^```', PAGE, re.DOTALL | re.MULTILINE)[1]
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        exec(code, {})
    assert output.getvalue().startswith('0.484 m x 0.339 m\n')
