# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The house rules that no single module's test would notice."""

from __future__ import annotations

import ast
import functools
import pathlib
import re
import runpy
import subprocess
import sys
import urllib.parse
import xml.etree.ElementTree as ElementTree

import pytest
import yaml

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10, where pytest brings it
    import tomli as tomllib

import sar_imaging
from sar_imaging.tools import environment
from sar_imaging.tools.command import COMMANDS

ROOT = pathlib.Path(__file__).parent.parent
PACKAGES = ('msg_conversions', 'sar_imaging')
MODULES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob('*.py'))
# Rooms that may know ROS; everything else is arrays in, arrays out.
ROS_ROOMS = ('msg_conversions', 'sar_imaging/nodes', 'sar_imaging/recordings', 'sar_imaging/tools',
             'sar_imaging/launch')

# Import names whose rosdep key is not the name itself.
ROSDEP_KEYS = {
    'matplotlib': 'python3-matplotlib',
    'numpy': 'python3-numpy',
    'scipy': 'python3-scipy',
    'tf2_ros': 'tf2_ros_py',
    'tqdm': 'python3-tqdm',
    'yaml': 'python3-yaml',
}


# What no distribution's rosdep key brings; nodes run without it, see docs/install.md.
WITHOUT_KEY = {'llvmlite', 'numba', 'rosbags'}


def _name(path) -> str:
    return path.relative_to(ROOT).as_posix()


@functools.cache
def _names(path) -> tuple[set[str], set[str]]:
    """Absolute names that a file imports, at any depth of nesting, and names that its code gives.

    Among these are those of what it imports.
    """
    package = path.relative_to(ROOT).parent.parts
    imported, defined = set(), set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Name):
            if isinstance(node.ctx, ast.Store):
                defined.add(node.id)
        elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            defined.add(node.name)
        elif isinstance(node, ast.alias):
            defined.add(node.asname or node.name)
        elif isinstance(node, ast.Import):
            imported.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[:len(package) - node.level + 1] if node.level else ()
            module = '.'.join([*base, *([node.module] if node.module else [])])
            imported.update(f'{module}.{alias.name}' for alias in node.names)
        elif isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == '_HOMES':
            defined.update(ast.literal_eval(node.value))  # imported when they are used first
    return imported, defined


def _third_party(path) -> set[str]:
    tops = {name.split('.')[0] for name in _names(path)[0]}
    return tops - set(sys.stdlib_module_names) - set(PACKAGES)


@functools.cache
def _project() -> dict:
    """What pyproject.toml says of the project."""
    return tomllib.loads((ROOT / 'pyproject.toml').read_text())['project']


def _setup_keywords(command='bdist_wheel') -> dict:
    """What setup.py calls setup() with, for pip or, by another command, for colcon."""
    with pytest.MonkeyPatch.context() as patch:
        given = {}
        patch.setattr('setuptools.setup', lambda **keywords: given.update(keywords))
        patch.setattr('sys.argv', ['setup.py', command])
        patch.chdir(ROOT)
        runpy.run_path('setup.py')
    return given


def _manifest() -> ElementTree.Element:
    return ElementTree.parse(ROOT / 'package.xml').getroot()


def test_manifest_is_an_ament_python_package():
    manifest = _manifest()
    assert manifest.get('format') == '3'
    assert manifest.findtext('name') == 'sar_imaging'
    assert manifest.findtext('export/build_type') == 'ament_python'
    assert manifest.findtext('license') == _setup_keywords()['license'] == 'Apache-2.0'
    # colcon takes a package whose maintainer has no plausible address for plain Python.
    address = manifest.find('maintainer').get('email')
    assert re.fullmatch(r'[-\w%+]+(\.[-\w%+]+)*@[-\w%]+(\.[-\w%]+)*\.[a-zA-Z]{2,}', address)


def test_who_maintains_it_is_the_same_everywhere():
    maintainer = _manifest().find('maintainer')
    assert _project()['maintainers'] == [{'name': maintainer.text,
                                          'email': maintainer.get('email')}]


def missing_addresses(manifest, address):
    """What a published version needs and a manifest, or the page of the index, lacks."""
    missing = [kind for kind in ('repository', 'bugtracker')
               if manifest.find(f"url[@type='{kind}']") is None]
    if manifest.find('maintainer').get('email').endswith('.example'):  # RFC 2606: never exists
        missing.append('maintainer')
    if urllib.parse.urlsplit(address).hostname.endswith('.example'):
        missing.append('ADDRESS in setup.py')
    return missing


def test_missing_addresses_are_told():
    text = '<package><maintainer email="{}"/>{}</package>'
    bare = ElementTree.fromstring(text.format('somebody@place.example', ''))
    assert missing_addresses(bare, 'https://place.example/sar') == [
        'repository', 'bugtracker', 'maintainer', 'ADDRESS in setup.py']
    full = ElementTree.fromstring(text.format(
        'somebody@place.org', '<url type="repository">a</url><url type="bugtracker">b</url>'))
    assert missing_addresses(full, 'https://place.org') == []


@pytest.mark.release
def test_a_published_version_has_addresses_that_can_exist():
    assert missing_addresses(_manifest(), _setup_keywords()['url']) == []


def test_links_of_the_page_of_the_index_are_addresses():
    setup, text = _setup_keywords(), (ROOT / 'README.md').read_text()
    page, address = setup['long_description'], setup['url']
    assert len(page) > len(text)
    for mark, target in re.findall(r'(!?)\[[^]]*\]\(([^)]+)\)', page):
        assert re.match('https://|#', target), f'{target} leads nowhere from an index'
        if target.startswith(f'{address}/'):
            kind, version, path = target.removeprefix(f'{address}/').split('/', 2)
            assert (kind, version) == ('raw' if mark else 'blob', sar_imaging.__version__)
            assert (ROOT / path.split('#')[0]).exists()
    assert setup['project_urls']['Source'] == address


def _sections() -> list[str]:
    """Titles of the changelog's sections, the newest first."""
    return re.findall(r'^(.+)\n-+$', (ROOT / 'CHANGELOG.rst').read_text(), re.MULTILINE)


@pytest.mark.release
def test_a_published_version_has_no_forthcoming_changes():
    assert _sections()[0].startswith(f'{sar_imaging.__version__} (')


def test_one_version_everywhere():
    setup, citation = _setup_keywords(), yaml.safe_load((ROOT / 'CITATION.cff').read_text())
    assert _manifest().findtext('version') == setup['version'] == sar_imaging.__version__
    [newest] = [title for title in _sections() if title != 'Forthcoming'][:1]
    assert newest == f'{setup["version"]} ({citation["date-released"]})'
    assert citation['version'] == setup['version']
    assert citation['license'] == setup['license']


def test_manifest_covers_every_import():
    declared = {element.text for tag in ('depend', 'exec_depend')
                for element in _manifest().iter(tag)}
    for path in MODULES:
        missing = {ROSDEP_KEYS.get(name, name) for name in _third_party(path) - WITHOUT_KEY
                   } - declared
        assert not missing, f'{_name(path)} needs {missing}; declare it in package.xml'
    # bloom refuses to release what depends on keys of pip
    assert not [name for name in declared if name.endswith('-pip')]


def test_setup_and_requirements_pin_the_same_versions():
    lines = (ROOT / 'requirements.txt').read_text().splitlines()
    pinned = {line.split(';')[0].strip() for line in lines if not line.startswith('#')}
    extras = _project()['optional-dependencies']
    wanted = {*_project()['dependencies'], *extras['tools'], *extras['test']}
    assert wanted <= pinned
    # On a robot rclpy and the messages come from apt; pip must never pull another set of them.
    assert not [name for name in wanted if name.startswith('ros-')]


def test_extras_are_what_make_installs():
    extras = _project()['optional-dependencies']
    for extra in ('formats', 'archive', 'docs', 'lint', 'release'):
        lines = [line.split('  #')[0] for line in (
            ROOT / f'requirements-{extra}.txt').read_text().splitlines()]
        missing = {*extras[extra]} - {*lines, 'sar_imaging[formats]', 'sar_imaging[tools]'}
        assert not missing, f'requirements-{extra}.txt lacks {missing}'
    assert 'sar_imaging[formats]' in extras['archive']
    assert 'sar_imaging[tools]' in extras['formats']


def test_versions_of_all_requirements_are_told_of_a_machine():
    extras = [name for extra in ('tools', 'formats', 'archive', 'hdf5', 'cuda')
              for name in _project()['optional-dependencies'][extra]]

    def names(requirements):
        return {re.match(r'[\w-]+', requirement).group() for requirement in requirements}

    assert set(environment.REQUIRED) == names(_project()['dependencies'])
    assert set(environment.OPTIONAL) == names(extras) - {'sar_imaging', 'numcodecs', 'numpy'}


def test_executables_exist():
    scripts = _setup_keywords('install')['entry_points']['console_scripts']
    for script in scripts:
        name, module, function = re.fullmatch(r'(\w+) = ([\w.]+):(\w+)', script).groups()
        assert module.split('.')[-1] == name
        tree = ast.parse((ROOT / (module.replace('.', '/') + '.py')).read_text())
        assert function in {node.name if isinstance(node, ast.FunctionDef)
                            else ast.unparse(node.targets[0])
                            for node in tree.body
                            if isinstance(node, (ast.Assign, ast.FunctionDef))}


def test_every_command_is_an_executable_of_ros():
    scripts = _setup_keywords('install')['entry_points']['console_scripts']
    modules = {script.split(' = ')[1].split(':')[0] for script in scripts}
    assert {f'sar_imaging.tools.{module}' for module in COMMANDS.values()} <= modules


def test_every_source_file_names_its_holder_and_its_licence():
    """Two lines at its head, after the interpreter's; ament_copyright reads the first."""
    made = ('docs/auto_examples', 'docs/api/generated')
    files = [path for folder in (*PACKAGES, 'test', 'benchmarks', 'docs')
             for path in (ROOT / folder).rglob('*.py') if not _name(path).startswith(made)]
    head = ('# Copyright 2026 SAR Imaging contributors', '# SPDX-License-Identifier: Apache-2.0')
    for path in [*files, ROOT / 'setup.py', ROOT / 'Makefile', ROOT / '.ci' / 'run']:
        lines = path.read_text().splitlines()
        first = bool(lines) and lines[0].startswith('#!')
        assert not lines or tuple(lines[first:first + 2]) == head, \
            f'{_name(path)} begins without the two lines ' + ' and '.join(head)


@pytest.mark.parametrize(('command', 'expected'), [
    ('bdist_wheel', {'sar-imaging'}), ('install', None), ('develop', None)])
def test_pip_puts_one_program_on_the_path(command, expected):
    scripts = _setup_keywords(command)['entry_points']['console_scripts']
    names = {script.split(' = ')[0] for script in scripts}
    if expected is None:  # colcon: for `ros2 run`
        assert {'backprojection', 'simulate', 'evaluate'} <= names
    else:
        assert names == expected


@pytest.mark.parametrize('path', MODULES, ids=_name)
def test_module_is_documented(path):
    tree = ast.parse(path.read_text())
    assert ast.get_docstring(tree), 'the first line says what the module is for'
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    for node in tree.body:
        if not isinstance(node, (*functions, ast.ClassDef)) or node.name.startswith('_'):
            continue
        assert ast.get_docstring(node), f'{node.name} has no docstring'
        methods = node.body if isinstance(node, ast.ClassDef) else ()
        for method in methods:
            if isinstance(method, functions) and not method.name.startswith('_'):
                assert ast.get_docstring(method), f'{node.name}.{method.name} has no docstring'


def test_folders_are_packages():
    """A folder without `__init__.py` would not be installed."""
    assert [_name(p) for p in {path.parent for path in MODULES}
            if not (p / '__init__.py').exists() and p.name != 'launch'] == []


def test_where_things_go_exists():
    """Places that the table of CONTRIBUTING names; capitals stand for any name."""
    text = (ROOT / 'CONTRIBUTING.md').read_text()
    table = text[text.index('| I want to change'):].split('\n\n')[0]
    places = [p for p in re.findall(r'`([\w.]+/[\w./]*)`', table) if p.lower() == p]
    assert len(places) > 40
    assert [p for p in places if not any((r / p).exists() for r in (ROOT, ROOT / 'sar_imaging'))
            ] == []


def test_numerical_core_does_not_know_ros():
    ros = {element.text for element in _manifest().iter('depend')}
    forbidden = {*ros, 'tf2_ros', 'launch', 'launch_ros', 'rosbags'}
    core = [path for path in MODULES if not _name(path).startswith(ROS_ROOMS)]
    assert len(core) > 10
    for path in core:
        names, _ = _names(path)
        assert not {name.split('.')[0] for name in names} & {*forbidden, 'msg_conversions'}, path
        rooms = ('sar_imaging.nodes', 'sar_imaging.tools', 'sar_imaging.launch')
        assert not [name for name in names if name.startswith(rooms)], path


def test_wire_format_imports_without_ros():
    # A machine that only writes bags has no message classes.
    code = "import sys, msg_conversions; sys.exit('rclpy' in sys.modules)"
    subprocess.run([sys.executable, '-c', code], cwd=ROOT, check=True)


def test_missing_numba_is_explained():
    code = """import sys
sys.modules['numba'] = None
from sar_imaging.backends import backend
print(backend().__name__)
backend('cpu')"""
    result = subprocess.run([sys.executable, '-c', code], cwd=ROOT, text=True, capture_output=True)
    assert result.stdout == 'sar_imaging.backends.reference\n'
    assert 'without Numba images are formed by NumPy' in result.stderr
    assert "backend='cpu' needs Numba: " in result.stderr.splitlines()[-1]


@pytest.mark.parametrize(('tool', 'arguments'), [
    ('simulate', ['psf', '--output', 'never']), ('evaluate', ['bags/psf', '--output', 'never']),
    ('calibrate', ['bags/psf', '--output', 'never'])])
def test_tools_explain_that_rosbags_is_missing(tool, arguments):
    code = (f"import sys; sys.modules['rosbags'] = None; from sar_imaging.tools import {tool};"
            f'sys.exit({tool}.main({arguments}))')
    result = subprocess.run([sys.executable, '-c', code], cwd=ROOT, text=True, capture_output=True)
    assert result.returncode not in (0, None)
    assert 'recordings need the Python package rosbags, which is not installed' in result.stderr
    assert 'Traceback' not in result.stderr


def test_what_is_imported_exists():
    """Also what is imported when a function is called, and by tests that are skipped here."""
    sources = [*MODULES, *(ROOT / 'benchmarks').rglob('*.py')]
    files = {'.'.join(path.relative_to(ROOT).with_suffix('').parts).removesuffix('.__init__'): path
             for path in sources}
    for caller in [*sources, *(ROOT / 'test').rglob('*.py')]:
        ours = {name for name in _names(caller)[0]
                if name.split('.')[0] in (*PACKAGES, 'benchmarks')}
        for name in ours - files.keys():
            module, _, last = name.rpartition('.')
            assert module in files and last in _names(files[module])[1], \
                f'{_name(caller)} imports {name}, which does not exist'


def test_imports_run_downward():
    """The layers stand in pyproject.toml."""
    pytest.importorskip('importlinter', reason='import-linter comes with requirements.txt')
    run = subprocess.run([sys.executable, '-c', 'from importlinter.cli import lint_imports_command'
                          ' as lint; lint()', '--no-cache'],
                         cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout


def test_the_exact_imager_loads_no_beams_no_fusion_and_no_kernels():
    """`python -m benchmarks.structure` counts the lines that it loads."""
    program = ('import sys, sar_imaging.imaging.exact\n'
               'print(*(n for n in sys.modules if n.startswith("sar_imaging")))')
    run = subprocess.run([sys.executable, '-c', program], cwd=ROOT, capture_output=True,
                         text=True, check=True)
    names = run.stdout.split()
    assert not [n for n in names if 'afbp' in n or '.backends.cpu' in n or 'streaming' in n]


def test_the_package_lists_what_a_first_image_needs():
    for name in sar_imaging.__all__:
        assert getattr(sar_imaging, name).__doc__, name
    assert set(sar_imaging.__all__) <= set(dir(sar_imaging))
    with pytest.raises(AttributeError, match='plan_images'):
        sar_imaging.plan_images  # noqa: B018


def test_functions_take_few_arguments():
    """Fewer than twelve, but for the one entry, whose options have names, and compiled loops.

    Of these the interpolation to a map has its arguments in groups, too.
    """
    many = {}
    for package in ('planning', 'imaging', 'streaming', 'backends/cpu', 'published'):
        for path in (ROOT / 'sar_imaging' / package).rglob('*.py'):
            for node in ast.walk(ast.parse(path.read_text())):
                if not isinstance(node, ast.FunctionDef):
                    continue
                compiled = any(name in ast.dump(d) for d in node.decorator_list
                               for name in ('njit', 'kernel'))
                if not compiled or node.name == '_resample':
                    given = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
                    many[node.name] = max(many.get(node.name, 0), len(given))
    # those that were hardest to follow (form_beams took 27) are still there to be counted
    assert many.keys() > {'form_beams', 'echo_phasors', 'plan_beams', 'shared_errors', '_resample',
                          'fusion_error', 'aliasing_error', '_whole', '_band', 'plan',
                          'overwriting_rounds', '_expansion_errors', '_commensurate'}
    assert {name for name, n in many.items() if n >= 12} == {'plan_image'}


# What Numba compiles; `function` and `kernel` are those of devices.
COMPILED = {'njit', 'kernel_part', 'cfunc', 'intrinsic', 'instructions', 'function', 'kernel'}


def _without_types(tree, within=''):
    """Names of functions that leave a type out, but for what is compiled and what writes code."""
    for node in ast.iter_child_nodes(tree):
        if not isinstance(node, ast.FunctionDef):
            yield from _without_types(node, f'{within}{node.name}.' if isinstance(
                node, ast.ClassDef) else within)
            continue
        name = within + node.name
        given = [*node.args.posonlyargs, *node.args.args]
        decorators = {re.match(r'[\w.]*', ast.unparse(d))[0] for d in node.decorator_list}
        if decorators & COMPILED or given and given[0].arg == 'b':
            continue
        given += [*node.args.kwonlyargs, node.args.vararg, node.args.kwarg]
        given = [a for a in given if a is not None and a.arg not in ('self', 'cls')]
        made = node.name == '__init__' and given  # where mypy takes None for granted
        if any(a.annotation is None for a in given) or not (node.returns or made):
            yield name
        yield from _without_types(node, f'{name}.')


def test_functions_beside_compiled_loops_state_their_types():
    """In modules with compiled loops mypy lets functions pass that state no types."""
    assert [*_without_types(ast.parse('class A:\n def f(self, x: int): ...'))] == ['A.f']
    found = [f'{_name(path)}: {name}' for path in MODULES
             if path.name != 'compilation.py' and path.parent.name != 'launch'
             for name in _without_types(ast.parse(path.read_text()))]
    assert not found, found


def test_the_conda_recipe_is_of_this_version():
    recipe = yaml.safe_load((ROOT / 'conda' / 'recipe.yaml').read_text())
    assert recipe['context']['version'] == sar_imaging.__version__
    needed = {'python' + _setup_keywords()['python_requires'], *_project()['dependencies']}
    assert {line.replace(' ', '') for line in recipe['requirements']['run']} == needed
    [program] = _setup_keywords()['entry_points']['console_scripts']
    assert recipe['build']['python']['entry_points'] == [program]
    about = recipe['about']
    assert (about['homepage'], about['summary'], about['license']) == (
        _setup_keywords()['url'], _project()['description'], _setup_keywords()['license'])
