# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Measure how large the code is, and how much of it an image passes, from the tree as it is.

Run: python -m benchmarks.structure
"""

from __future__ import annotations

import argparse
import ast
import collections
import dataclasses
import functools
import importlib.util
import io
import json
import pathlib
import subprocess
import sys
import time
import tokenize

ROOT = pathlib.Path(__file__).parent.parent
PACKAGE = ('sar_imaging', 'msg_conversions')
LONG = 40  # lines of a function; more does not fit on a screen
_NOT_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
             tokenize.ENCODING, tokenize.ENDMARKER}
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
_COMPILED = ('njit', 'kernel', 'jit')


@dataclasses.dataclass(frozen=True)
class Module:
    """One file of Python: its path below the root, its syntax tree and its lines of code."""

    path: str
    tree: ast.Module
    n_code: int
    longest_line: int

    @property
    def name(self) -> str:
        """Dotted name, that of the package for `__init__`."""
        return self.path.removesuffix('.py').replace('/', '.').removesuffix('.__init__')

    @functools.cached_property
    def functions(self) -> list[ast.FunctionDef]:
        """Functions and methods, nested ones too."""
        return [node for node in ast.walk(self.tree) if isinstance(node, _FUNCTIONS)]


def read_module(path: pathlib.Path) -> Module:
    """Parse a file; lines of docstrings, comments and blank ones are not code."""
    text = path.read_text()
    tree = ast.parse(text)
    docstrings = set()
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, *_FUNCTIONS)) and ast.get_docstring(node):
            docstrings.update(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    code = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in _NOT_CODE:
            code.update(range(token.start[0], token.end[0] + 1))
    return Module(path.relative_to(ROOT).as_posix(), tree, len(code - docstrings),
                  max(map(len, text.splitlines()), default=0))


@functools.cache
def modules(*folders: str) -> tuple[Module, ...]:
    """All modules below some folders of the root."""
    return tuple(read_module(path) for folder in folders
                 for path in sorted((ROOT / folder).rglob('*.py')))


def _is_compiled(function: ast.FunctionDef) -> bool:
    decorators = (d.func if isinstance(d, ast.Call) else d for d in function.decorator_list)
    return any(getattr(d, 'id', getattr(d, 'attr', '')) in _COMPILED for d in decorators)


def _n_arguments(function: ast.FunctionDef) -> int:
    a = function.args
    names = [x.arg for x in (*a.posonlyargs, *a.args, *a.kwonlyargs)]
    return len([name for name in names if name not in ('self', 'cls')])


def _n_lines(function: ast.FunctionDef) -> int:
    """Lines of a function, its docstring left out."""
    n = function.end_lineno - function.lineno + 1
    if ast.get_docstring(function):
        n -= function.body[0].end_lineno - function.body[0].lineno + 1
    return n


def widest(compiled: bool) -> tuple[int, str]:
    """Most arguments of a function of the package, and which; compiled kernels or others."""
    return max((_n_arguments(f), f'{m.path}:{f.name}') for m in modules(*PACKAGE)
               for f in m.functions if _is_compiled(f) == compiled)


def imports(module: Module) -> set[str]:
    """Modules of the package that a module imports as it is loaded or later, by dotted name."""
    known = {m.name for m in modules(*PACKAGE)}
    package = module.name.split('.') if module.path.endswith('__init__.py') else (
        module.name.split('.')[:-1])
    found = set()
    for node in _runtime(module.tree):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[:len(package) - node.level + 1] if node.level else []
            origin = '.'.join([*base, *([node.module] if node.module else [])])
            found.update(name if (name := f'{origin}.{alias.name}') in known else origin
                         for alias in node.names)
    return (found & known) - {module.name}


def _runtime(node: ast.AST):
    """Nodes of a syntax tree, those that only type checkers see left out."""
    for child in ast.iter_child_nodes(node):
        if not (isinstance(child, ast.If) and 'TYPE_CHECKING' in ast.dump(child.test)):
            yield child
            yield from _runtime(child)


def circles() -> list[list[str]]:
    """Groups of modules that import each other (Tarjan's strongly connected components)."""
    arrows = {m.name: imports(m) for m in modules(*PACKAGE)}
    index, low, stack, groups = {}, {}, [], []

    def visit(name):
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in arrows[name]:
            if other not in index:
                visit(other)
            if other in stack:
                low[name] = min(low[name], low[other])
        if low[name] == index[name]:
            group = stack[stack.index(name):]
            del stack[-len(group):]
            if len(group) > 1:
                groups.append(sorted(group))

    sys.setrecursionlimit(10_000)
    for name in arrows:
        if name not in index:
            visit(name)
    return groups


def only_children() -> list[tuple[str, str]]:
    """Modules that one sibling in their folder imports, and nobody else."""
    users = collections.defaultdict(set)
    for module in modules(*PACKAGE):
        for name in imports(module):
            users[name].add(module.name)
    return sorted((name, user) for name, (user, *others) in
                  ((n, sorted(u)) for n, u in users.items())
                  if not others and name.rpartition('.')[0] == user.rpartition('.')[0])


_IMAGE = """
import json, sys
from sar_imaging import MapGrid, concatenate, plan_image
from sar_imaging.simulation import SCENARIOS
profiles = concatenate(list(SCENARIOS['psf']().blocks()))
before = {name for name in sys.modules if name.startswith('sar_imaging')}
grid = MapGrid((10_000.0, 0.0, 0.0), 160, 160, 0.5)
def image():
    return plan_image(grid, profiles.radar, profiles.n_samples, method=METHOD)(profiles)
image()
passed = set()
def watch(frame, event, _):
    name = frame.f_globals.get('__name__', '')
    if (event == 'call' and name.startswith('sar_imaging')
            and not frame.f_code.co_name.startswith('<')):
        passed.add((name, frame.f_code.co_name, frame.f_code.co_firstlineno))
sys.setprofile(watch)
image()
sys.setprofile(None)
print(json.dumps(sorted(passed)))
"""
_LOADED = """
import json, sys
import numpy as np
from sar_imaging import MapGrid, PulseBlock, RadarParameters, plan_image
radar = RadarParameters(carrier_hz=10e9, sample_rate_hz=200e6, bandwidth_hz=150e6,
                        first_sample_delay_s=66e-6, pulse_length_s=0.0, chirp_rate_hz_per_s=0.0,
                        waveform=1)
track = np.zeros((64, 1, 3))
track[:, 0, 1] = np.linspace(-50, 50, 64)
path = np.hypot(10_000.0, track[..., 1:2])  # to a scatterer in the middle: no dark image
place = (path - radar.range_start_m) / radar.sample_spacing_m
phase = radar.wavenumber_rad_per_m * path
samples = np.sinc(0.75 * (np.arange(256) - place)) * np.exp(-1j * phase)
imager = plan_image(MapGrid((10_000.0, 0.0, 0.0), 64, 64, 0.5), radar, 256, method='exact')
imager(PulseBlock(radar, True, np.arange(64), np.arange(64, dtype=np.uint32),
                  samples.astype(np.complex64), track, track))
print(json.dumps(sorted(name for name in sys.modules if name.startswith('sar_imaging'))))
"""
_LAYERS = """
import json, os, sys, threading
import rclpy
from msg_conversions.pulse_block import to_message
from sar_imaging.nodes.backprojection import BackprojectionNode
from sar_imaging.simulation import SCENARIOS
ways = {'put': [], 'add': []}
def watch(frame, event, _):
    name, module = frame.f_code.co_name, frame.f_globals.get('__name__', '')
    entered = {'put': 'sar_imaging.nodes', 'add': 'sar_imaging.backends'}.get(name)
    if event == 'call' and entered and module.startswith(entered):
        on_stack = []
        while frame is not None:
            if frame.f_globals.get('__name__', '').startswith('sar_imaging'):
                on_stack.append(frame.f_locals.get('self'))
            frame = frame.f_back
        ways[name] = max(ways[name], [x for x in on_stack[::-1] if x is not None], key=len)
sys.argv = ['backprojection']
values = {'pulses_per_aperture': 200, 'grid.centre_x': 10_000.0, 'grid.size_x': 12.0,
          'grid.size_y': 12.0, 'backend': 'cpu'}
rclpy.init(args=['--ros-args', '--log-level', 'fatal'] + [
    word for name, value in values.items() for word in ('-p', f'{name}:={value}')])
threading.setprofile(watch)
node = BackprojectionNode()
node.start()
sys.setprofile(watch)
node._receive(to_message(next(SCENARIOS['psf']().blocks(50))))
node._worker.call(lambda: None).result()
layers = dict.fromkeys(
    'backend' if type(x).__module__.startswith('sar_imaging.backends') else type(x).__name__
    for way in ways.values() for x in way)
print(json.dumps([*layers, 'kernel']), flush=True)
os._exit(0)
"""


def _child(program: str) -> list:
    done = subprocess.run([sys.executable, '-c', program], cwd=ROOT, check=True,
                          capture_output=True, text=True)
    return json.loads(done.stdout.splitlines()[-1])


def passed_by_image(method: str) -> tuple[int, int]:
    """Modules and functions entered while one image is planned and formed, kernels compiled."""
    passed = _child(_IMAGE.replace('METHOD', repr(method)))
    return len({name for name, *_ in passed}), len(passed)


def loaded_by_exact() -> int:
    """Lines of code of the modules that an exact image loads."""
    names = set(_child(_LOADED))
    return sum(m.n_code for m in modules(*PACKAGE) if m.name in names)


def layers_of_a_live_block() -> list[str]:
    """Objects that hand a block on from a node's callback to the kernel, by their classes.

    Those on the call stack when the block is queued and when the backend adds it to the image,
    each once; the backend and the kernel count one each. What is asked on the way and answers is
    none, such as the inlet that reads the message. Empty without ROS.
    """
    return _child(_LAYERS) if importlib.util.find_spec('rclpy') else []


def import_seconds() -> float:
    """Shortest of some first imports of the package, seconds."""
    taken = []
    for _ in range(5):
        begin = time.perf_counter()
        subprocess.run([sys.executable, '-c', 'import sar_imaging'], cwd=ROOT, check=True)
        taken.append(time.perf_counter() - begin)
    return min(taken)


def measure() -> dict[str, object]:
    """All figures, by name."""
    package = modules(*PACKAGE)
    functions = [_n_lines(f) for m in package for f in m.functions]
    sizes = {folder: sum(m.n_code for m in modules(folder))
             for folder in (*PACKAGE, 'benchmarks', 'test')}
    layers = layers_of_a_live_block()
    exact, afbp = passed_by_image('exact'), passed_by_image('afbp')
    return {
        'modules': len(package), 'lines of code': sum(sizes[name] for name in PACKAGE),
        'lines of code, with benchmarks and tests': sum(sizes.values()),
        'functions': len(functions), f'functions above {LONG} lines':
        sum(n > LONG for n in functions), 'longest line': max(m.longest_line for m in package),
        'exact image: modules, functions': exact, 'AFBP image: modules, functions': afbp,
        'lines loaded by an exact imager': loaded_by_exact(),
        'layers of a live block': (len(layers), ', '.join(layers)),
        'widest kernel': widest(True), 'widest function': widest(False),
        'circles of imports': circles(), 'modules of one sibling': len(only_children()),
        'import of sar_imaging, s': round(import_seconds(), 2)}


def by_subject() -> dict[str, tuple[int, int]]:
    """Modules and lines of code of each folder below the package."""
    found = collections.defaultdict(lambda: [0, 0])
    for module in modules(*PACKAGE):
        parts = module.path.split('/')
        subject = '/'.join(parts[1:-1][:2]) or parts[0]
        found[subject][0] += 1
        found[subject][1] += module.n_code
    return {subject: tuple(found[subject]) for subject in sorted(found)}


def main(argv: list[str] | None = None) -> None:
    """Print all figures, a line each."""
    p = argparse.ArgumentParser(prog='python -m benchmarks.structure', description=__doc__)
    p.add_argument('--subjects', action='store_true', help='lines of code of each folder, too')
    p.add_argument('--fragments', action='store_true', help='modules that one sibling imports')
    arguments = p.parse_args(argv)
    for name, value in measure().items():
        print(f'{name:<42}', value)
    if arguments.subjects:
        print('\nsubject: modules, lines of code')
        for subject, (n, lines) in by_subject().items():
            print(f'  {subject:<36}{n:4d} {lines:6d}')
    if arguments.fragments:
        print('\nmodules that one sibling imports')
        for name, user in only_children():
            print(f'  {name}  <-  {user.rpartition(".")[2]}')


if __name__ == '__main__':
    main()
