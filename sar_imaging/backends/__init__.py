# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What computes plans: one package per processor, all with the same four entries.

A plan (`sar_imaging.planning`) says what is computed and how well; a backend computes it. `cpu` is
the compiled one, `cuda` that for NVIDIA's devices. `reference` is plain NumPy in float64, the
formulas themselves: slow, and what every other backend is tested against and written from.
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, cast

from ..planning.costs import tell_costs
from .device import DeviceError, device_backend, require_device

if TYPE_CHECKING:
    from ..planning.afbp.plan import AfbpPlan
    from ..planning.plan import Plan
    from .protocol import Backend

__all__ = ['AUTO', 'BACKENDS', 'CUDA', 'DeviceError', 'backend', 'compile_beforehand',
           'optional_entry']

AUTO, CUDA = 'auto', 'cuda'
BACKENDS = ('cpu', CUDA, 'reference')
_logger = logging.getLogger(__name__)
_ENTRIES = ('Backprojection', 'SubapertureImager', 'SpectrumFusion', 'form_map')


def backend(name: str | Backend = AUTO, plan: Plan | None = None) -> Backend:
    """Choose the backend that computes plans.

    Parameters
    ----------
    name : str or Backend
        One of `BACKENDS`, or anything that has the four entries. 'auto' is the processor's, and
        where there is a CUDA device whichever of the two is quicker, plan by plan. Where Numba is
        missing, it is the reference, after a warning in the log.
    plan : Plan, optional
        What is to be computed, where several entries share the work.

    Returns
    -------
    Backend

    Raises
    ------
    ValueError
        There is no such backend, or it lacks an entry.
    DeviceError
        'cuda' was asked for, and there is no device that works.
    ImportError
        'cpu' was asked for, and Numba is missing.

    Examples
    --------
    >>> from sar_imaging.backends import backend
    >>> backend('reference').__name__
    'sar_imaging.backends.reference'
    >>> backend('fpga')
    Traceback (most recent call last):
        ...
    ValueError: backend='fpga'; expected auto, cpu, cuda, reference, or an object that ...
    """
    if name == CUDA:
        return require_device()
    if name == AUTO:
        name = 'cpu' if device_backend() is None else 'automatic'
        if plan is not None and name == 'automatic':
            return importlib.import_module('.automatic', __name__).quicker(plan)
        if name == 'cpu' and not _compiles():
            name = 'reference'
    if name == 'cpu':
        from ..compilation import require_numba

        require_numba("backend='cpu'")
    if isinstance(name, str) and name in ('automatic', *BACKENDS):
        return importlib.import_module(f'.{name}', __name__)
    if missing := [e for e in _ENTRIES if not callable(getattr(name, e, None))]:
        raise ValueError(f'backend={name!r}; expected {", ".join((AUTO, *BACKENDS))}, or an '
                         f'object that has {", ".join(missing)}, too')
    return cast('Backend', name)  # for it has all of them


@functools.cache
def _compiles() -> bool:
    """Whether Numba works, which whoever will compute loads; a warning where it does not."""
    from ..compilation import SLOWLY

    if SLOWLY:
        _logger.warning(SLOWLY)
    return not SLOWLY


def optional_entry(name: str | Backend, entry: str) -> Callable[..., Any]:
    """Find an entry of a backend that it may lack, such as correlation.

    Parameters
    ----------
    name : str or Backend
        As for `backend`.
    entry : str
        Name of one of `protocol.Correlation`, or ``'TrialImages'``.

    Returns
    -------
    callable
        As `backends.protocol` describes it.

    Raises
    ------
    ValueError
        The backend does not offer it.

    Examples
    --------
    >>> from sar_imaging.backends import optional_entry
    >>> correlate_spectra = optional_entry('reference', 'correlate_spectra')
    >>> correlate_spectra.__name__
    'correlate_spectra'
    >>> optional_entry('reference', 'ApertureFusion')
    Traceback (most recent call last):
        ...
    ValueError: backend='reference' offers no ApertureFusion; use backend='cpu'
    """
    found = getattr(backend(name), entry, None)
    if not callable(found):
        raise ValueError(f'backend={name!r} offers no {entry}; use backend={BACKENDS[0]!r}')
    return found


def check_illumination(name: str | Backend) -> None:
    """Check that a backend weighs echoes by the illumination of its plans.

    Raises
    ------
    ValueError
        It does not say so: it has no true attribute ``ILLUMINATION``.
    """
    if not getattr(backend(name), 'ILLUMINATION', False):
        raise ValueError(f'backend={name!r} knows no illumination; use '
                         f'backend={BACKENDS[0]!r}')


def compile_beforehand(*entries: str, name: str | Backend = AUTO) -> None:
    """Have a backend compile what some of its entries need, so that the first pulse does not wait.

    Nothing happens where a backend compiles nothing: it then has no `compile_kernels`.

    Parameters
    ----------
    *entries : str
        Their names, such as ``'SpectrumFusion'``.
    name : str or Backend
        As for `backend`.

    Examples
    --------
    >>> from sar_imaging.backends import compile_beforehand
    >>> compile_beforehand('form_map', name='reference')  # nothing is compiled
    """
    compile_kernels = getattr(backend(name), 'compile_kernels', None)
    if compile_kernels is not None:
        for entry in entries:
            compile_kernels(entry)


def compilation_announced() -> contextlib.AbstractContextManager[None]:
    """`compilation.announced`, of which a backend that compiles nothing makes no use."""
    from ..compilation import announced  # now, since Numba takes a second to load

    return announced()


def compilation_helped(plan: AfbpPlan, n_samples: int
                       ) -> contextlib.AbstractContextManager[None]:
    """`compilation_helper.helped` for an image of echoes of so many samples."""
    from ..compilation_helper import helped

    return helped(functools.partial(_form_silently, plan, n_samples))


def _form_silently(plan: AfbpPlan, n_samples: int) -> None:
    importlib.import_module('.cpu.beforehand', __name__).form_silently(plan, n_samples)


# Plans are made for the processor, wherever they are computed.
tell_costs(lambda: importlib.import_module('.cpu', __name__).measured_costs())
