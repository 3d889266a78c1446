"""Whose Fourier transforms are used: those of this package, or SciPy's in their place."""

from __future__ import annotations

import os

VARIABLE = 'SAR_IMAGING_TRANSFORMS'  # of the environment
OWN, SCIPY = 'own', 'scipy'


def own_transforms() -> bool:
    """Whether the transforms of this package are used, where they know the length.

    Raises
    ------
    ValueError
        The environment asks for some that there are not.
    """
    choice = os.environ.get(VARIABLE, OWN)
    if choice not in (OWN, SCIPY):
        raise ValueError(f'{VARIABLE}={choice!r}; expected {OWN}, or {SCIPY} for those of SciPy')
    return choice == OWN
