# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The libraries that formats need: an optional extra, whose absence is one clear line."""

from __future__ import annotations

import importlib
from types import ModuleType


class MissingExtraError(ImportError):
    """A library of an optional extra is not installed; the text says how to install it.

    Examples
    --------
    >>> from sar_imaging.formats import MissingExtraError, require
    >>> try:
    ...     require('library_that_nobody_has', 'reading holograms')
    ... except MissingExtraError as error:
    ...     print(error)
    reading holograms needs library_that_nobody_has, which this Python does not have (No ...
    """


def require(module: str, purpose: str, extra: str = 'formats') -> ModuleType:
    """Import a library that an optional extra installs.

    Parameters
    ----------
    module : str
        Full name, such as ``'sarkit.cphd'``.
    purpose : str
        What needs it, such as ``'reading CPHD'``.
    extra : str
        Extra of this package that installs it.

    Returns
    -------
    module
        The library.

    Raises
    ------
    MissingExtraError
        It is not installed, or not for this version of Python.

    Examples
    --------
    >>> from sar_imaging.formats import require
    >>> require('json', 'writing a catalogue').dumps({'looks': 4})
    '{"looks": 4}'
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f'{purpose} needs {module.split(".")[0]}, which this Python does not have '
            f'({error}); install the extra: pip install sar_imaging[{extra}]') from error
