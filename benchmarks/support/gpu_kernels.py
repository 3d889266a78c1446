# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of the CUDA backend compiled without a device: registers, spills, and their loops.

`TYPES` lists the types that each kernel is launched with; the simulator's tests hold launches
against it. Run from the repository root where the extra `cuda` is installed; with ``ptxas`` and
``nvdisasm`` of CUDA on the path it prints what the machine code of each kernel is like::

    python -m benchmarks.support.gpu_kernels
"""

from __future__ import annotations

import collections
import contextlib
import importlib
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import types as python_types
from collections.abc import Iterator

from numba import types

CAPABILITY = (9, 0)  # H100 and H200
_F, _D, _N = types.float32, types.float64, types.int64


def _a(kind, n_axes: int, layout: str = 'C') -> types.Array:
    return types.Array(kind, n_axes, layout)


PAIRS = _a(_N, 1)  #: Complex numbers, complex64 in the simulator; see `arrays.pairs`.

_LINES = (PAIRS, types.Tuple((_N, _N, _D, _D, _D, _D)), _N, _a(_D, 2), _a(_D, 3),
          _a(types.complex64, 1), _a(_F, 1), _a(_N, 1))
_TILES = (*[_a(_D, 1)] * 3, _a(_N, 2), types.Tuple((_N, _N, _N, _N, _D)), _a(_D, 2))
_POINTS = (PAIRS, types.Tuple((_N, _D, _D, _D, _D)), _a(_D, 2), *_TILES, _a(_F, 1))

_RANGES = (_a(_F, 1), _N, _N, _a(_D, 1), _a(_D, 1), _a(_F, 1), _N, _a(_F, 1))
_FORMED = (PAIRS, _a(_F, 1), _a(_N, 2), _a(_D, 3), _a(_D, 1), _a(_F, 1), _D,
           _a(types.complex64, 1), _N, PAIRS)
_READ = (PAIRS, _N, _N, _a(_N, 2), _a(_D, 2), _a(_D, 1), _a(_F, 2), _a(_F, 2), _N, _N, _a(_F, 4))

#: By module of the backend and name.
TYPES: dict[str, tuple[tuple, ...]] = {
    'profiles.farrow_coefficients': (
        (PAIRS, _N, _a(_F, 2), _N, _N, _N, types.boolean, _N, _N, _N, PAIRS),),
    'illumination.amplitudes_at_nodes': ((_a(_D, 2), _a(_D, 1), _a(_D, 1), _a(_D, 2), _a(_F, 2)),),
    'lines.add_lines': (_LINES,),
    'lines.add_weighted_lines': ((*_LINES, _a(_F, 2), _a(_F, 1), _N, _N),),
    'points.bound_tiles': (_TILES,),
    'points.add_points': (_POINTS,),
    'points.add_weighted_points': (
        (*_POINTS, _a(_F, 2), _a(_N, 1), _a(_D, 2), _a(_F, 1), _a(_F, 1), _a(_D, 1)),),
    'points.add_pieces': (
        (PAIRS, _N, _a(_D, 2), _a(_D, 2), _a(_D, 1), _a(_D, 1), _a(_F, 3)),),
    'backprojection.merge_parts': (
        (_a(_F, 1), _N, _a(types.complex64, 2), _a(types.int32, 1), _a(_F, 2),
         _a(types.complex64, 2), _a(_F, 3)),),
    'polar_to_map.to_ranges': (_RANGES,),
    'polar_to_map.to_ranges_by_few': (_RANGES,),
    'polar_to_map.to_pixels': tuple(
        (_a(_F, 1), _N, *[_a(_D, 1)] * 3, _a(_F, 1), _N, _a(types.complex64, 2, layout))
        for layout in 'CFA'),  # a map, one whose range follows y, and some columns of that
    'fusion.taper_images': ((_a(_F, 4), _a(_F, 1), _a(_F, 1), PAIRS),),
    'fusion.add_bands': (
        (PAIRS, _N, _N, _a(_D, 1), _a(_D, 1), _N, _a(types.complex64, 2)),),
    'fusion.edge_powers': ((_a(_F, 4), _a(_F, 2), _a(_F, 2), _a(_D, 1)),),
    'beams.beam_paths': (
        (_a(_D, 2), _a(_N, 2), _a(_D, 2), _a(_D, 1), _a(_D, 3)),),
    'beams.form_beams': (_FORMED,),
    'beams.form_single_beams': (_FORMED,),
    'beams.interpolate_beams': (_READ,),
    'beams.interpolate_weighted_beams': ((*_READ, _a(_F, 4), _N),),
    'beams.fit_parabolas': (
        (_a(_D, 2), _a(_D, 1), _a(_D, 1), _a(_D, 2), _a(_N, 2), _a(_D, 2), _a(_D, 1), _a(_D, 3),
         _a(_F, 3)),)}


@contextlib.contextmanager
def without_a_device() -> Iterator[None]:
    """Have functions that kernels call compiled for `CAPABILITY`, whatever there is."""
    from numba.cuda import dispatcher

    before = dispatcher.get_current_device
    dispatcher.get_current_device = lambda: python_types.SimpleNamespace(
        compute_capability=CAPABILITY)
    try:
        yield
    finally:
        dispatcher.get_current_device = before


def compiled(name: str, signature: tuple) -> tuple[str, int | None]:
    """A kernel in PTX, and the registers that a thread may have."""
    from numba import cuda

    module, kernel = name.rsplit('.', 1)
    found = getattr(importlib.import_module(f'sar_imaging.backends.cuda.{module}'), kernel)
    with without_a_device():
        ptx, _ = cuda.compile(found.py_func, signature, cc=CAPABILITY, device=False, abi='numba',
                              output='ptx')
    return ptx, found.targetoptions.get('max_registers')


def machine_code(ptx: str, registers: int | None, folder: pathlib.Path) -> tuple[str, str]:
    """What the assembler says of a kernel, and its instructions."""
    version = re.search(r'release (\d+\.\d+)', subprocess.run(
        ['ptxas', '--version'], capture_output=True, text=True, check=True).stdout)[1]
    # an older assembler reads what a newer compiler writes, but for the number
    newest = re.search(r'^\.version .*', ptx, re.M)[0]
    if version.startswith('13.0'):
        ptx = ptx.replace(newest, '.version 9.0')
    (folder / 'kernel.ptx').write_text(ptx)
    limit = [f'--maxrregcount={registers}'] if registers else []
    said = subprocess.run(['ptxas', '-arch=sm_90', '-v', *limit, '-o', 'kernel.cubin',
                           'kernel.ptx'], cwd=folder, capture_output=True, text=True, check=True)
    code = subprocess.run(['nvdisasm', 'kernel.cubin'], cwd=folder, capture_output=True,
                          text=True, check=True)
    return said.stderr, code.stdout


def loops(code: str) -> Iterator[tuple[int, collections.Counter]]:
    """Innermost loops: where they begin, and how many instructions of each kind they have."""
    found, labels, back = [], {}, []
    for line in code.splitlines():
        if label := re.match(r'\s*(\.L_\w+):', line):
            labels[label[1]] = len(found)
        elif instruction := re.match(r'\s+/\*[0-9a-f]+\*/\s+(.*?);', line):
            found.append(instruction[1])
    for end, instruction in enumerate(found):
        to = re.search(r'BRA.*\((\.L_\w+)\)', instruction)
        if to and labels.get(to[1], end + 1) < end:
            back.append((labels[to[1]], end))
    for start, end in sorted(set(back)):
        if not any(start <= a and b <= end and (a, b) != (start, end) for a, b in back):
            yield start, collections.Counter(
                re.sub(r'^@!?U?P\w+\s+', '', text).split()[0].split('.')[0]
                for text in found[start:end + 1])


def main() -> int:
    """Compile every kernel and print what it is like; returns the exit status."""
    tools = all(shutil.which(tool) for tool in ('ptxas', 'nvdisasm'))
    for name, signatures in TYPES.items():
        ptx, registers = compiled(name, signatures[0])
        if not tools:
            print(f'{name}: {len(ptx.splitlines())} lines of PTX')
            continue
        with tempfile.TemporaryDirectory() as folder:
            said, code = machine_code(ptx, registers, pathlib.Path(folder))
        print(f'{name}: ' + ', '.join(re.findall(
            r'\d+ registers|[1-9]\d* bytes (?:spill stores|spill loads|smem)', said)))
        for start, kinds in loops(code):
            print(f'  loop at {start}: {sum(kinds.values())} instructions, ' + ' '.join(
                f'{kind} {n}' for kind, n in kinds.most_common(9)))
    return 0


if __name__ == '__main__':
    sys.exit(main())
