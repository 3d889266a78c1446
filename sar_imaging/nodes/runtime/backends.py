"""Parameter that says what computes: the processor or a CUDA device."""

from __future__ import annotations

from collections.abc import Mapping

from sar_imaging.backends import AUTO, CUDA, DeviceError, backend

from .parameters import ConfigurationError, Parameter, one_of

BACKEND = Parameter(
    'backend', AUTO, f'What computes: the processor, or a device by {CUDA}, which must be there; '
    f'{AUTO}: whichever is quicker.', check=one_of(AUTO, 'cpu', CUDA))


def backend_of(parameters: Mapping[str, object]) -> str:
    """Backend that the parameters name.

    Raises
    ------
    ConfigurationError
        A device was asked for, and there is none that works.
    """
    name = parameters[BACKEND.name]
    try:
        backend(name)
    except DeviceError as error:
        raise ConfigurationError(f'parameter {BACKEND.name}: {error}') from error
    return name
