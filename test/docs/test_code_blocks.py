# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Every block of code of the pages is run; what cannot be run here stands with its reason."""

from __future__ import annotations

import importlib
import pathlib
import re
import shlex

import numpy as np
import pytest

from sar_imaging.simulation.scenarios import SCENARIOS
from sar_imaging.simulation.survey import Survey
from sar_imaging.tools.command import COMMANDS

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGES = {path.relative_to(ROOT).as_posix(): path for path in sorted([
    *ROOT.glob('*.md'), *(ROOT / 'docs').rglob('*.md'), ROOT / 'bags' / 'README.md'])}
# Tests that run a page and look at what comes out. They name the page.
RUN_BY = {
    'docs/install.md': 'test_docs.py', 'docs/theory.md': 'test_docs.py',
    'docs/grids.md': 'test_docs.py',
    'docs/radiometry.md': 'test_docs.py', 'docs/exploitation.md': 'test_docs.py',
    'docs/from_files_to_maps.md': 'test_docs.py', 'docs/earth.md': 'test_docs.py',
    'docs/illumination.md': 'test_docs.py', 'docs/weekend.md': 'test_weekend.py',
    'docs/start/robot.md': 'test_doors.py', 'docs/start/recordings.md': 'test_doors.py',
    'docs/start/arrays.md': 'test_doors.py', 'docs/extending.md': 'imaging/test_extending.py',
    'docs/configuration.md': 'configuration/test_documentation.py',
    'docs/evaluate.md': 'quality/test_quality.py',
    'docs/wire_format.md': 'msg_conversions/test_documented_format.py',
    'docs/preparing_radar_data.md': 'recordings/test_preparing_radar_data.py'}
# What a block or a line contains that is read but not run, and why.
NOT_RUN = {
    'from launch import': 'needs the package launch of a ROS installation',
    "backend='cuda'": 'needs a device',
    'SLURMCluster': 'needs a cluster with Slurm', 'KubeCluster': 'needs a Kubernetes cluster',
    '--scheduler': 'needs a cluster', '--launch-nodes': 'test/tools/evaluation does it',
    'shared/data': 'measured data, test/benchmarks/measured',
    'out/team6': 'measured data', 'out/bags/gotcha': 'measured data',
    'out/gotcha': 'measured data', 'out/bags/mimo': 'measured data',
    'my_': "stands for the reader's files",
    'out/bags/first_drive': "the reader's recording",
    ' BAG ': "stands for the reader's recording",
    'measure-costs': 'half a minute on an idle machine, test/tools/costs',
    'simulate archive': 'a hundred recordings; a survey of two is made here',
    'archive survey.yaml': 'the Python of the page does the same; test/archive has the rest',
    'doctor bags/countryside --output': 'test_doors.py does it'}
FENCE = re.compile(r'^```(\w*)\n(.*?)^```$', re.DOTALL | re.MULTILINE)


def blocks(page: str) -> list[tuple[str, str]]:
    return FENCE.findall(PAGES[page].read_text())


def commands(code: str) -> list[str]:
    """Lines of a block for a terminal: continued ones joined, prompts and answers left out."""
    lines = re.sub(r'\\\n\s*', '', code).splitlines()
    if any(line.startswith('$ ') for line in lines):
        return [line[2:] for line in lines if line.startswith('$ ')]
    return [line for line in lines if line.strip()]


def words_of_ours(line: str) -> list[str] | None:
    """Module and arguments of a line that starts one of our programs; None for other lines."""
    words = shlex.split(line.split(' && ')[0].removesuffix('&&'), comments=True)
    while words and re.fullmatch(r'[A-Z_]+=.*', words[0]):
        words = words[1:]
    if words[:2] == ['python', '-m'] and words[2].startswith('sar_imaging.tools.'):
        module, words = words[2].removeprefix('sar_imaging.tools.'), words[3:]
        if module != 'command':
            return [module, *words]
    elif words[:1] == ['sar-imaging']:
        words = words[1:]
    else:
        return None
    for n in (2, 1):
        if tuple(words[:n]) in COMMANDS:
            return [COMMANDS[tuple(words[:n])], *words[n:]]
    raise AssertionError(f'{line}: there is no such command')


def reason_not_to_run(text: str) -> str | None:
    return next((part for part in NOT_RUN if part in text), None)


def execute(page: str, names: dict) -> dict:
    """Run Python and our commands in the order of the page, in the working directory."""
    for language, code in blocks(page):
        if language == 'yaml' and (name := re.match(r'# (\S+\.yaml)\n', code)):
            pathlib.Path(name[1]).write_text(code)
        elif language == 'python':
            compiled = compile(code, page, 'exec')
            if not reason_not_to_run(code):
                exec(compiled, names)
        elif language in ('bash', 'console'):
            for line in commands(code):
                if (ours := words_of_ours(line)) and not reason_not_to_run(line):
                    module = importlib.import_module(f'sar_imaging.tools.{ours[0]}')
                    assert module.main(ours[1:]) == 0, line
    return names


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / 'bags').symlink_to(ROOT / 'bags')
    monkeypatch.chdir(tmp_path)
    return tmp_path


def has_code(page: str) -> bool:
    return any(language == 'python' or language in ('bash', 'console') and any(
        words_of_ours(line) for line in commands(code)) for language, code in blocks(page))


ARCHIVES = ['docs/archives.md', 'docs/archive_products.md']
ALONE = [page for page in PAGES if has_code(page) and page not in
         (*RUN_BY, *ARCHIVES, 'docs/formats.md', 'docs/troubleshooting.md')]


@pytest.mark.parametrize('page', ALONE)
def test_code_of_a_page_runs(page, folder):
    execute(page, {})


def test_formats(folder, capsys):
    for library in ('sarkit', 'rasterio', 'pystac'):
        pytest.importorskip(library, reason=f'{library} is not installed, see requirements')
    names = execute('docs/formats.md', {})
    assert (names['back'].image.samples == names['image'].samples).all()
    assert 'exact' in capsys.readouterr().out
    written = {path.name for path in folder.iterdir()}
    assert written >= {'scene.cphd', 'image.nitf', 'map.tif', 'complex.tif', 'north_up.tif',
                       'map.png', 'map.pgw', 'map.prj', 'map.kml', 'image.json'}


def test_troubleshooting(folder, capsys):
    scenario = SCENARIOS['psf']()
    [block] = scenario.blocks(scenario.n_pulses)
    image = np.zeros(scenario.grid.shape, np.complex64)
    image[3, 4] = 1.0
    execute('docs/troubleshooting.md', {'image': image, 'block': block, 'grid': scenario.grid})
    assert capsys.readouterr().out


@pytest.mark.campaign
def test_archives(folder, capsys):
    pytest.importorskip('distributed', reason='the extra archive is not installed')
    from sar_imaging.tools.simulate_archive import write_archive

    write_archive(Survey(n_recordings=2, pixels=64, clutter=0), folder / 'flights')
    names = {'__name__': '__main__'}
    for page in ARCHIVES:
        execute(page, names)
    assert not names['summary'].losses
    error_db = float(capsys.readouterr().out.split()[-1])
    assert np.nanmax(names['power']) > 0
    # that of an image planned for -60 dB; its 100 pixels are a sample
    assert -80.0 < error_db < -55.0


@pytest.mark.parametrize('page', PAGES)
def test_what_a_page_types_exists(page):
    """Lines for a terminal: options of our programs, executables, targets of make."""
    targets = re.findall(r'^([\w-]+):', (ROOT / 'Makefile').read_text(), re.MULTILINE)
    executables = re.findall(r"'(\w+) = sar_imaging", (ROOT / 'setup.py').read_text())
    for language, code in blocks(page):
        for line in commands(code) if language in ('bash', 'console') else ():
            if ours := words_of_ours(line):
                parser = importlib.import_module(f'sar_imaging.tools.{ours[0]}').parser()
                if '$' not in line:
                    parser.parse_args(ours[1:])
            for target in re.findall(r'^make ([a-z][\w-]+)', line):
                assert target in targets, line
            for name in re.findall(r'\bros2 run sar_imaging (\w+)', line):
                assert name in executables, line


def test_every_reason_is_needed():
    texts = [text for page in PAGES for language, code in blocks(page)
             for text in ([code] if language == 'python' else commands(code)
                          if language in ('bash', 'console') else [])
             if language == 'python' or words_of_ours(text)]
    assert {part for part in NOT_RUN if not any(part in text for text in texts)} == set()
    for page, test in RUN_BY.items():
        name = pathlib.PurePath(page).stem
        assert re.search(rf'\b{name}\b', (ROOT / 'test' / test).read_text()), (page, test)
