"""Tables of numbers in text files: a line of column names, then a row for each pose or pulse."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..description import DescriptionError

_SEPARATORS = ',;\t'


def read_table(path: Path) -> tuple[list[str], np.ndarray]:
    """Column names and rows of a CSV file.

    Parameters
    ----------
    path : Path
        Columns are separated by commas, semicolons, tabs or spaces.

    Returns
    -------
    names : list of str
    rows : (N, len(names)) float64

    Raises
    ------
    DescriptionError
        It is no such table.
    """
    try:
        text = path.read_text(encoding='utf-8-sig')
    except UnicodeDecodeError as error:
        raise DescriptionError(f'{path.name} is no text: {error}; expected a table with a line of '
                               'column names') from error
    lines = [line for line in text.splitlines() if line.strip()]
    if len(lines) < 2:
        raise DescriptionError(f'{path.name} has no rows; expected a line of column names and one '
                               'line for each pose')
    separator = next((s for s in _SEPARATORS if s in lines[0]), None)
    names = [name.strip().strip('#').strip().strip('"') for name in lines[0].split(separator)]
    if all(_is_number(name) for name in names):
        raise DescriptionError(f'{path.name} has no line of column names, its first line is '
                               f'{lines[0][:60]!r}; put a line such as time,x,y,z before it')
    return names, numbers(path, lines[1:], separator, len(names), first=2)


def numbers(path: Path, lines: list[str], separator: str | None, n_columns: int, *,
            first: int = 1, expected: str = '') -> np.ndarray:
    """(N, n_columns) float64 numbers of lines of text.

    Parameters
    ----------
    path : Path
        For messages.
    lines : list of str
        Rows.
    separator : str or None
        Between columns; None for blanks.
    n_columns : int
        Of each row.
    first : int
        Number of the first row, for messages.
    expected : str
        What the columns are, for messages.

    Raises
    ------
    DescriptionError
        A row is longer or shorter, or holds something else.
    """
    rows = [line.split(separator) for line in lines]
    for number, row in enumerate(rows, first):
        if len(row) != n_columns:
            raise DescriptionError(f'{path.name}: row {number} has {len(row)} columns; expected '
                                   f'{n_columns}' + (f', {expected}' if expected else ''))
    try:
        return np.array(rows, np.float64)
    except ValueError:
        number, text = next((number, text) for number, row in enumerate(rows, first)
                            for text in row if not _is_number(text))
        advice = ('write decimals with a point' if _is_number(text.replace(',', '.')) else
                  'write times in seconds and angles as quaternions')
        raise DescriptionError(f'{path.name}: row {number} holds {text.strip()!r}; expected '
                               f'numbers: {advice}') from None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
