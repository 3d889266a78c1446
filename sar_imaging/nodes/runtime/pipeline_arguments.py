"""Let sar_pipeline read the parameter files of the separate nodes."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from .parameters import ConfigurationError

_FLAG = '--params-file'


def merged_arguments(arguments: Sequence[str], name: str, stages: Iterable[str],
                     folder: Path) -> list[str]:
    """Command line whose parameter files speak of one node instead of several.

    Parameters
    ----------
    arguments : sequence of str
        Command line.
    name : str
        Node that takes the sections of the others, beside its own.
    stages : iterable of str
        Nodes whose sections it takes, in any namespace.
    folder : Path
        Where the rewritten files go.

    Returns
    -------
    list of str

    Raises
    ------
    ConfigurationError
        A file cannot be read.
    """
    out = list(arguments)
    # As text: sections of the same node may come several times, and numbers stay as written.
    section = re.compile(rf'^(\s*["\']?(?:\S*/)?)(?:{"|".join(stages)})(["\']?\s*:\s*(?:#.*)?)$',
                         re.MULTILINE)
    for index in range(1, len(out)):
        if out[index - 1] == _FLAG:
            merged = folder / f'{index}.yaml'
            try:
                merged.write_text(section.sub(rf'\1{name}\2', Path(out[index]).read_text()))
            except (OSError, UnicodeDecodeError) as error:
                raise ConfigurationError(f'{_FLAG} {out[index]}: {error}') from error
            out[index] = str(merged)
    return out
