# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Makes sure that `msg_conversions` is the package that belongs to this one.

It stands beside `sar_imaging` under a name that another package of a workspace may have, too:
Python then imports whichever comes first on its path.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

NAME = 'msg_conversions'
MARKER = 'of_sar_imaging.py'  # a module that the package of another project does not have


def check_companion() -> None:
    """Find `msg_conversions` without importing it.

    Raises
    ------
    ImportError
        There is none, or Python finds one of another project first; the text names the places.
    """
    beside = Path(__file__).resolve().parents[1] / NAME
    spec = importlib.util.find_spec(NAME)
    places = (spec.submodule_search_locations or (spec.origin,)) if spec else ()
    found = [place for place in places if place]
    if any((Path(folder) / MARKER).is_file() for folder in found):
        return
    if not found:
        raise ImportError(f'no package {NAME} is on the path of Python; it belongs to sar_imaging '
                          f'and is installed with it, expected at {beside}', name=NAME)
    raise ImportError(
        f'Python finds the package {NAME} of another project, {found[0]}; sar_imaging needs its '
        f'own, {beside}. Two packages of one name do not work in one environment: source only the '
        'workspace with sar_imaging, put its folder first in PYTHONPATH, or rename the other one',
        name=NAME)
