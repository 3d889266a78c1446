# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Names that nobody knows, or that went elsewhere: what is said of them."""

from __future__ import annotations

import difflib
import importlib
import warnings
from collections.abc import Callable, Iterable
from typing import Any


def advice_on(name: object, known: Iterable[str]) -> str:
    """What is probably meant by a name that is not known.

    Parameters
    ----------
    name : object
        What the file has; YAML also takes numbers for keys.
    known : iterable of str
        Names that there are.

    Returns
    -------
    str
        ``'did you mean grid.spacing?'``, or all known names where none is like it or begins so.

    Examples
    --------
    >>> from sar_imaging.names import advice_on
    >>> advice_on('grid.spaceing', ['grid.size_x', 'grid.spacing'])
    'did you mean grid.spacing?'
    >>> advice_on('carrier', ['carrier_hz', 'bandwidth_hz'])
    'did you mean carrier_hz?'
    >>> advice_on('colour', ['carrier_hz', 'bandwidth_hz'])
    'expected one of carrier_hz, bandwidth_hz'
    """
    known = list(known)
    close = (difflib.get_close_matches(str(name), known, 1)
             or [other for other in known if other.startswith(f'{name}_')])
    return f'did you mean {close[0]}?' if close else f'expected one of {", ".join(known)}'


def moved(module: str, home: str, names: Iterable[str] = (), **renamed: str
          ) -> Callable[[str], object]:
    """The `__getattr__` of a module whose names went elsewhere: a warning says where they are.

    Parameters
    ----------
    module, home : str
        Where they were and are.
    names : iterable of str
        What went there.
    **renamed : str
        Former and present name of what also got another one, or another home:
        ``'module:name'``.
    """
    present = {name: name for name in names} | renamed

    def find(name: str) -> Any:
        if name not in present:
            raise AttributeError(f'module {module!r} has no attribute {name!r}')
        where, _, called = present[name].rpartition(':')
        where = where or home
        warnings.warn(f'{module}.{name} is now {where}.{called}; the former name goes with the '
                      'next release', DeprecationWarning, stacklevel=2)
        return getattr(importlib.import_module(where), called)

    return find
