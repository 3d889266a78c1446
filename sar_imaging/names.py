"""Names that a user writes into files: what is said of one that nobody knows."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


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
