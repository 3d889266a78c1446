# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Compile all kernels of the nodes once, so that their first start does not wait for it.

Run: python -m sar_imaging.tools.compile_kernels

Numba keeps machine code beside the modules or below the home folder, whichever can be written to,
or in the folder that NUMBA_CACHE_DIR names.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import time
from collections.abc import Callable

from tqdm import tqdm

from sar_imaging.compilation import counted, require_numba
from sar_imaging.compilation_helper import helped

from .program import command_parser, main_of

_DESCRIPTION = """\
Compile what the nodes compute with, or load what was compiled before. It takes half a minute on a
desktop and minutes on a small board, once for each version of the package on each machine. Run it
as the user who will run the nodes.
"""


def _jobs() -> list[tuple[str, Callable[[], None]]]:
    """What is compiled, in words, and the functions that do it."""
    from sar_imaging.autofocus.live import compile_autofocus
    from sar_imaging.backends import compile_beforehand
    from sar_imaging.diagnosis.coherence import compile_kernels as compile_diagnosis
    from sar_imaging.exploitation.obstacles import obstacle_map

    return [('exact backprojection', lambda: compile_beforehand('Backprojection')),
            ('sub-aperture images', lambda: compile_beforehand('SubapertureImager')),
            ('fusion of sub-apertures', lambda: compile_beforehand('SpectrumFusion')),
            ('autofocus', compile_autofocus), ('diagnosis', compile_diagnosis),
            ('obstacle maps', obstacle_map.compile_kernels)]


def call_kernels() -> None:
    """Call what is compiled, for `compilation_helper`; stages fail that need values of kernels."""
    for _, call in _jobs():
        with contextlib.suppress(Exception):
            call()


def parser() -> argparse.ArgumentParser:
    """Command line of this program."""
    return command_parser(None, _DESCRIPTION)


def run(_: argparse.Namespace) -> str:
    """Compile all of it; returns a line about that."""
    require_numba('what is compiled')
    started = time.monotonic()
    # the helper finds it in the module by its name, not in what this program is
    job = importlib.import_module('sar_imaging.tools.compile_kernels').call_kernels
    with counted() as kernels, helped(job), tqdm(_jobs(), unit='stage') as bar:
        for name, compile_them in bar:
            bar.set_description(name)
            compile_them()
    if not kernels.n:
        return 'nothing to compile, all kernels were there already'
    return f'kernels compiled in {time.monotonic() - started:.0f} s, ready'


main = main_of(parser, run,
               interrupted='interrupted; what was compiled so far is kept')

if __name__ == '__main__':
    raise SystemExit(main())
