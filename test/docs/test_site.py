# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The documentation site builds without a warning; drawings are those of their blocks."""

from __future__ import annotations

import importlib.util
import pathlib
import re
import shutil
import subprocess
import sys

import pytest
import yaml

ROOT = pathlib.Path(__file__).resolve().parents[2]
DOCS = ROOT / 'docs'
MADE = ('generated', 'auto_examples', '__pycache__')
MARKDOWN = [*sorted(ROOT.glob('*.md')), *sorted(DOCS.rglob('*.md'))]
# Nothing of what Sphinx reads becomes garbage, which Python looked for in a sixth of the time. And
# numpydoc compiles its one template for each docstring, in a seventh.
SPHINX = """
import gc, sys
from jinja2 import Environment
from sphinx.cmd.build import main

compiled, compile_anew = {}, Environment.compile

def compile_once(environment, *template, **options):
    key = type(environment), *template, *options.items()
    if key not in compiled:
        compiled[key] = compile_anew(environment, *template, **options)
    return compiled[key]

gc.disable()
Environment.compile = compile_once
sys.exit(main())
"""


def _sphinx(folder: pathlib.Path) -> subprocess.CompletedProcess:
    """Read all pages of a copy and resolve their links; examples are read, not run."""
    pytest.importorskip('sphinx', reason='`make docs-libraries` installs Sphinx')
    return subprocess.run(
        [sys.executable, '-c', SPHINX, '-q', '-W', '--keep-going', '-b', 'dummy',
         '-D', 'plot_gallery=0', folder / 'docs', folder / 'out'], capture_output=True, text=True)


def _copy(folder: pathlib.Path) -> pathlib.Path:
    """Links to the repository beside a copy of docs, in which the build leaves its own files."""
    for path in ROOT.iterdir():
        if path.name not in ('docs', 'out', 'build', '.git'):
            (folder / path.name).symlink_to(path)
    shutil.copytree(DOCS, folder / 'docs', ignore=shutil.ignore_patterns(*MADE))
    return folder


def test_every_page_builds_and_its_links_lead_somewhere(tmp_path):
    run = _sphinx(_copy(tmp_path))
    assert (run.returncode, run.stderr) == (0, '')
    built = {path.stem for path in (tmp_path / 'docs' / 'auto_examples').glob('*.rst')}
    assert built >= {path.stem for path in (DOCS / 'examples').glob('*.py')}


def test_a_link_to_nowhere_is_noticed(tmp_path):
    """By the same Sphinx, of one page: links to pages, to headings and out of docs."""
    (tmp_path / 'docs').mkdir()
    for name in ('conf.py', 'public_names.py', 'extensions', '_templates', '_static'):
        (tmp_path / 'docs' / name).symlink_to(DOCS / name)
    for name in ('sar_imaging', 'msg_conversions'):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / 'docs' / 'examples').mkdir()
    (tmp_path / 'docs' / 'examples' / 'GALLERY_HEADER.rst').write_text('None\n====\n')
    (tmp_path / 'docs' / '_contents.md').write_text('')
    (tmp_path / 'docs' / 'index.md').write_text(
        '# Title\n\n[a](missing.md) [b](#no-such-heading) [c](../missing.py)\n')
    run = _sphinx(tmp_path)
    assert run.returncode != 0
    for target in ('missing.md', 'no-such-heading', 'missing.py'):
        assert target in run.stderr


def test_every_drawing_is_that_of_its_block():
    """File names are digests of the blocks; Sphinx is not needed to compare them."""
    names = set()
    for page in MARKDOWN:
        for block in re.findall(r'^```mermaid\n(.*?)^```', page.read_text(),
                                re.DOTALL | re.MULTILINE):
            assert 'accTitle: ' in block, f'{page.name}: a drawing needs a line accTitle'
            names |= {f'{digest(block)}-{shade}.svg' for shade in ('light', 'dark')}
    assert names == {path.name for path in (DOCS / 'images' / 'drawings').iterdir()}, \
        '`make drawings` draws blocks that were changed'


def digest(block: str) -> str:
    spec = importlib.util.spec_from_file_location('digest', DOCS / 'extensions' / 'digest.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.digest(block)


@pytest.mark.parametrize('path', sorted((ROOT / '.github' / 'workflows').glob('*.yml')),
                         ids=lambda path: path.name)
def test_workflows_call_what_the_makefile_has(path):
    workflow = yaml.safe_load(path.read_text())
    assert {'push', 'pull_request'} <= workflow[True].keys()  # YAML 1.1 reads `on` as true
    targets = set(re.findall(r'^([\w-]+):', (ROOT / 'Makefile').read_text(), re.MULTILINE))
    called = {target for job in workflow['jobs'].values() for step in job['steps']
              for target in re.findall(r'^make ([\w-]+)', step.get('run', ''), re.MULTILINE)}
    assert called and called <= targets


def test_docs_ros_org_builds_these_pages():
    kind, settings = yaml.safe_load_all((ROOT / 'rosdoc2.yaml').read_text())
    assert kind == {'type': 'rosdoc2 config', 'version': 1}
    [builder] = settings['builders']
    # rosdoc2 refuses builders without `output_dir`, and keys that it does not know
    assert set(builder['sphinx']) == {'name', 'sphinx_sourcedir', 'output_dir'}
    assert builder['sphinx']['sphinx_sourcedir'] == 'docs'
    assert '<rosdoc2>rosdoc2.yaml</rosdoc2>' in (ROOT / 'package.xml').read_text()
