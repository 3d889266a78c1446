# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Every public name has an example in its docstring, and every example shows what happens."""

from __future__ import annotations

import ast
import contextlib
import doctest
import enum
import importlib
import inspect
import pathlib
import re
from typing import Protocol

import pytest

from docs.public_names import (
    INTERNAL,
    MODULES as FROM_MODULES,
    pages,
    public_names,
    public_objects,
)

pytest.importorskip('std_msgs', reason='names that convert ROS messages are public, too')

ROOT = pathlib.Path(__file__).parent.parent
PAGES = [ROOT / 'README.md', *sorted((ROOT / 'docs').rglob('*.md'))]
# Classes whose arguments are no business of users.
MADE_BY_OTHERS = {'sar_imaging.imaging.imager.Imager'}  # `plan_image`
EXAMPLES = sorted((ROOT / 'docs' / 'examples').rglob('*.py'))  # of the gallery
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def _module(path) -> str:
    return '.'.join(path.relative_to(ROOT).with_suffix('').parts).removesuffix('.__init__')


MODULES = [_module(path) for package in ('sar_imaging', 'msg_conversions')
           for path in sorted((ROOT / package).rglob('*.py')) if '>>> ' in path.read_text()]
PAGES_WITH_EXAMPLES = [page for page in PAGES if '\n>>> ' in page.read_text()]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder beside the recordings of `bags`; workers that examples start are forked."""
    (tmp_path / 'bags').symlink_to(ROOT / 'bags')
    monkeypatch.chdir(tmp_path)
    workers = contextlib.nullcontext
    with contextlib.suppress(ImportError):  # the extra archive
        from .archive.forked_workers import forked_workers as workers
    with workers():
        yield


@pytest.mark.parametrize('name', sorted(public_objects()))
def test_a_public_name_has_an_example(name):
    text = public_objects()[name].__doc__ or ''
    assert re.search(r'^ *Examples\n *-{8}\n *>>> ', text, re.MULTILINE)


@pytest.mark.parametrize('name', sorted(public_objects()))
def test_a_public_name_explains_its_arguments_and_result(name):
    value = public_objects()[name]
    text = inspect.getdoc(value) or ''
    if isinstance(value, type) and (issubclass(value, (Exception, enum.Enum, Protocol))
                                    or name in MADE_BY_OTHERS):
        return
    signature = inspect.signature(value)
    for argument in signature.parameters:
        line = rf'^[\w, *]*\b{argument}\b[\w, *]*( :.*)?$'
        assert re.search(line, text, re.MULTILINE), argument
    if inspect.isfunction(value) and signature.return_annotation not in ('None', None):
        assert re.search(r'^(Returns|Yields)\n-{6}', text, re.MULTILINE)


def _examples(name: str) -> list[doctest.DocTest]:
    """Examples of a module by its name, or of a page by its path, the text of it all."""
    # Without the names of the module: what a reader copies has to import what it uses.
    if not name.endswith('.md'):
        return doctest.DocTestFinder().find(importlib.import_module(name), globs={})
    text = re.sub('^```.*$', '', (ROOT / name).read_text(), flags=re.MULTILINE)
    return [doctest.DocTestParser().get_doctest(text, {}, name, name, 0)]


@pytest.mark.parametrize(
    'name', [*MODULES, *(page.relative_to(ROOT).as_posix() for page in PAGES_WITH_EXAMPLES)])
def test_examples_show_what_happens(name, folder):
    runner, failures = doctest.DocTestRunner(optionflags=OPTIONS, verbose=False), []
    for example in _examples(name):
        assert not any(doctest.SKIP in part.options for part in example.examples), (
            f'{example.name}: an example that is left out shows nothing')
        runner.run(example, out=failures.append)
    if any('MissingExtraError: ' in text for text in failures):
        pytest.skip('needs a library of an extra')
    assert not failures, ''.join(failures)


def test_examples_that_show_something_else_are_noticed():
    example = doctest.DocTestParser().get_doctest('>>> 1 + 1\n3\n', {}, 'wrong', None, 0)
    shown = []
    assert doctest.DocTestRunner(optionflags=OPTIONS).run(example, out=shown.append).failed == 1
    assert 'Expected:\n    3\nGot:\n    2' in ''.join(shown)


def _imports(page) -> set[tuple[str, str]]:
    """Modules and names that the Python code of a page imports of this package."""
    found = set()
    text = page.read_text()
    for code in [text] if page.suffix == '.py' else re.findall(
            r'^```python\n(.*?)^```', text, re.DOTALL | re.MULTILINE):
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.ImportFrom) and (node.module or '').startswith(
                    ('sar_imaging', 'msg_conversions')):
                found.update((node.module, alias.name) for alias in node.names)
    return found


@pytest.mark.parametrize('page', [*PAGES, *EXAMPLES],
                         ids=lambda page: page.relative_to(ROOT).as_posix())
def test_what_pages_import_is_public(page):
    public = [getattr(importlib.import_module(module), name)
              for module, names in public_names().items() for name in names]
    for module, name in sorted(_imports(page)):
        value = getattr(importlib.import_module(module), name, None)
        if value is None or type(value).__name__ == 'module':
            continue  # a module, whose own names count
        assert any(value is other for other in public), (
            f'{page.name} imports {name} of {module}, which is not public: list it in the '
            "package's __all__ or in docs/public_names.py")


def test_the_reference_lists_what_is_public():
    listed = re.findall(r'^   ([\w.]+)$', (ROOT / 'docs/api/index.rst').read_text(), re.MULTILINE)
    names = public_names()
    packages = {name for name in names if name not in INTERNAL and name not in FROM_MODULES}
    of_modules = {f'{module}.{name}' for module, of in FROM_MODULES.items() for name in of}
    empty = {name for name in listed if name not in packages | of_modules}
    assert packages | of_modules <= set(listed) and len(listed) == len(set(listed))
    # What says what a package is for, and exports nothing.
    assert not [n for n in empty if getattr(importlib.import_module(n), '__all__', ())]


def test_a_name_of_several_packages_has_one_page():
    found = pages()
    assert found['sar_imaging.signal.pulses']['PulseBlock'] == 'sar_imaging.PulseBlock'
    assert found['sar_imaging.formats.sicd']['read_sicd'] == 'sar_imaging.formats.read_sicd'
    # Another function of the same name.
    assert (found['sar_imaging.backends.reference']['correlate_profiles']
            == 'sar_imaging.backends.reference.correlate_profiles')


def test_reasons_are_given_for_packages_that_are_not_public():
    for package, reason in INTERNAL.items():
        assert (ROOT / package.replace('.', '/') / '__init__.py').is_file() and len(reason) > 20
