"""Descriptions of public measured data that come with the package."""

from __future__ import annotations

import importlib.resources
from pathlib import Path

from .description import DescriptionError


def shipped_names() -> list[str]:
    """Names of the descriptions in `config/recordings`.

    Returns
    -------
    list of str
        In alphabetical order.

    Examples
    --------
    >>> from sar_imaging.loading import shipped_names
    >>> [name for name in shipped_names() if 'arcsar' in name]
    ['arcsar', 'arcsar_7']
    """
    return sorted(path.stem for path in _folder().glob('*.yaml'))


def find_description(name: Path | str) -> Path:
    """Find the file of a description, one of the shipped ones by its name.

    Parameters
    ----------
    name : path
        A file, or the name of a shipped description.

    Returns
    -------
    pathlib.Path
        The YAML file.

    Raises
    ------
    DescriptionError
        Neither of both exists.

    Examples
    --------
    >>> from sar_imaging.loading import find_description
    >>> find_description('gotcha').name
    'gotcha.yaml'
    """
    if Path(name).is_file():
        return Path(name)
    if Path(name).is_dir():
        raise DescriptionError(f'{name} is a folder; expected the YAML file of the description, '
                               'the folder with the data goes behind it')
    path = _folder() / f'{name}.yaml'
    if str(name) not in shipped_names():
        raise DescriptionError(f'{name} does not exist; expected a YAML file or one of '
                               f'{", ".join(shipped_names())}')
    return path


def _folder() -> Path:
    return Path(str(importlib.resources.files('sar_imaging') / 'config' / 'recordings'))
