"""What computes plans: one package per processor, all with the same four entries.

A plan (`sar_imaging.planning`) says what is computed and how well; a backend computes it. `cpu` is
the compiled one. `reference` is plain NumPy in float64, the formulas themselves: slow, and what
every other backend is tested against and written from.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .protocol import Backend

AUTO, BACKENDS = 'auto', ('cpu', 'reference')


def backend(name: str = AUTO) -> Backend:
    """What computes plans.

    Parameters
    ----------
    name : str
        One of `BACKENDS`, or 'auto' for the quickest.

    Returns
    -------
    Backend
        A package; what it needs is imported when an entry is used first.

    Raises
    ------
    ValueError
        There is no such backend.
    """
    if name not in (AUTO, *BACKENDS):
        raise ValueError(f'backend={name!r}; expected auto, {" or ".join(BACKENDS)}')
    return importlib.import_module(f'.{"cpu" if name == AUTO else name}', __name__)
