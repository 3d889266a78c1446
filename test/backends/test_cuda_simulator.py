# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The tests of the CUDA backend in Numba's simulator of a device.

The longest, of whole images, are left to `make simulator`.
"""

import os
import pathlib
import re
import subprocess
import sys

FOLDER = pathlib.Path(__file__).parent / 'cuda'


def test_in_the_simulator():
    run = subprocess.run(
        [sys.executable, '-m', 'pytest', '-p', 'no:cacheprovider', str(FOLDER)],
        env=os.environ | {'NUMBA_ENABLE_CUDASIM': '1'}, cwd=FOLDER.parents[2],
        capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
    # none is skipped
    assert re.search(r'^\d+ passed, \d+ deselected in', run.stdout.splitlines()[-1])
