"""What computes plans: one package per processor, all with the same four entries.

A plan (`sar_imaging.planning`) says what is computed and how well; a backend computes it. `cpu` is
the compiled one. `reference` is plain NumPy in float64, the formulas themselves: slow, and what
every other backend is tested against and written from.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .protocol import Backend

AUTO, BACKENDS = 'auto', ('cpu', 'reference')
_ENTRIES = ('Backprojection', 'SubapertureImager', 'SpectrumFusion', 'form_map')


def backend(name: str | Backend = AUTO) -> Backend:
    """What computes plans.

    Parameters
    ----------
    name : str or Backend
        One of `BACKENDS`, 'auto' for the quickest, or anything that has the four entries.

    Returns
    -------
    Backend

    Raises
    ------
    ValueError
        There is no such backend, or it lacks an entry.
    """
    if isinstance(name, str) and name in (AUTO, *BACKENDS):
        return importlib.import_module(f'.{"cpu" if name == AUTO else name}', __name__)
    if missing := [e for e in _ENTRIES if not callable(getattr(name, e, None))]:
        raise ValueError(f'backend={name!r}; expected {", ".join((AUTO, *BACKENDS))}, or an '
                         f'object that has {", ".join(missing)}, too')
    return name


def optional_entry(name: str | Backend, entry: str) -> Callable:
    """Entry that a backend may lack: those of `baselines.Baselines`, and ``'TrialImages'``.

    Parameters
    ----------
    name : str or Backend
        As for `backend`.
    entry : str
        Name of the entry.

    Raises
    ------
    ValueError
        The backend does not offer it.
    """
    found = getattr(backend(name), entry, None)
    if not callable(found):
        raise ValueError(f'backend={name!r} offers no {entry}; use backend={BACKENDS[0]!r}')
    return found


def compile_beforehand(*entries: str, name: str | Backend = AUTO) -> None:
    """Have a backend compile what some of its entries need, so that the first pulse does not wait.

    Nothing happens where a backend compiles nothing: it then has no `compile_kernels`.
    """
    compile_kernels = getattr(backend(name), 'compile_kernels', None)
    for entry in entries if compile_kernels else ():
        compile_kernels(entry)
