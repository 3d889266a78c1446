# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Files that nodes write when asked to: where, and under which name."""

from __future__ import annotations

import datetime
import os
from pathlib import Path

from .parameters import ANY_TIME, Parameter


def _check_folder(name: str) -> None:
    folder = Path(name).absolute()
    there = next(path for path in (folder, *folder.parents) if os.path.lexists(path))
    if name and not (there.is_dir() and os.access(there, os.W_OK)):
        raise ValueError(f'no files can be written to {name}: {there} is '
                         f'{"not writable" if there.is_dir() else "no folder"}')


SAVE_FOLDER = Parameter(
    'save.folder', '', 'Folder for the files that the save service writes, made when missing; '
    'empty for none.', check=_check_folder, changes=ANY_TIME)


def file_stem(stamp_ns: int) -> str:
    """Time in a file's name, such as ``20231114T221320.123456789Z``."""
    seconds, rest = divmod(int(stamp_ns), 10**9)
    epoch = datetime.datetime(1970, 1, 1)
    return f'{epoch + datetime.timedelta(seconds=seconds):%Y%m%dT%H%M%S}.{rest:09d}Z'
