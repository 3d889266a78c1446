# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Files at the door: what is read is a regular file, and what is written replaces no input.

Every reader opens its files by `reading` or `check_file`, every writer makes its own within
`replacing` or `filling`: in a new folder beside the target, from which they are moved when they
are complete. So nothing is half written, and nothing is written through a link.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import stat
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

MOST_TEXT_BYTES = 1_000_000  # of a file that a person writes
NEW = '.sar_imaging.'  # begin of the names of folders in which files are made
_LONGEST_TEXT = 500  # characters of an error of another library
_OF_PYTHON = (  # within texts, and what a person reads in their place
    (re.compile(r'<(?:\w+\.)*(\w+) object at 0x\w+>|\b\w+Error\(([^()]*)\)'), r'\1\2'),
    (re.compile(r"'[\w-]+' codec can't [^:]*: [a-z ]+"), 'it is no text'))
_inputs: dict[tuple[int, int], Path] | None = None  # device and inode; None outside of commands


def check_file(path: os.PathLike[str] | str, most_bytes: int = sys.maxsize) -> None:
    """Refuse what is no regular file of a sensible size: devices and pipes never end.

    Parameters
    ----------
    path : path
        File that is to be read.
    most_bytes : int
        Largest size.

    Raises
    ------
    ValueError
        It does not exist, cannot be looked at, is no regular file, or is larger.
    """
    try:
        status = Path(path).stat()
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise ValueError(f'{path!s} cannot be read: {getattr(error, "strerror", error)}'
                         ) from error
    if not stat.S_ISREG(status.st_mode):
        raise ValueError(f'{path!s} is no regular file')
    if status.st_size > most_bytes:
        raise ValueError(f'{path!s} has {status.st_size / 1e6:.3g} MB; expected at most '
                         f'{most_bytes / 1e6:.3g} MB')
    if _inputs is not None:
        _inputs[status.st_dev, status.st_ino] = Path(path).resolve()


def read_text(path: os.PathLike[str] | str, most_bytes: int = MOST_TEXT_BYTES) -> str:
    """Text of a file that people write.

    Raises
    ------
    ValueError
        It cannot be read (see `check_file`), or is no text.
    """
    check_file(path, most_bytes)
    with naming(path, 'cannot be read'):
        return Path(path).read_text(encoding='utf-8-sig')


@contextlib.contextmanager
def reading(path: os.PathLike[str] | str, what: str, error: type[Exception] = ValueError
            ) -> Iterator[None]:
    """Let whatever goes wrong while a file is read be one line of one exception with its name.

    Damaged and hostile files make the libraries that read them raise anything: within the block
    all of it becomes `error`. An `ImportError`, such as of an extra that is not installed, stays.

    Parameters
    ----------
    path : path
        File that is read; it has to be a regular one.
    what : str
        What it should be, such as ``'a GeoTIFF'``.
    error : type
        Exception to raise.

    Raises
    ------
    FileNotFoundError
        There is no such file.
    """
    if not os.path.lexists(path):
        raise FileNotFoundError(f'{path!s} does not exist; expected {what}')
    with naming(path, f'cannot be read as {what}', error):
        check_file(path)
        yield


@contextlib.contextmanager
def naming(path: os.PathLike[str] | str, trouble: str, error: type[Exception] = ValueError
           ) -> Iterator[None]:
    """As `reading`, for what is done with a file that is open; `trouble` follows its name."""
    try:
        yield
    except ImportError:
        raise
    except Exception as problem:
        text = told(problem)
        named = re.search(rf'(?<!\w){re.escape(Path(path).name)}(?!\w)', text)
        if named and (isinstance(problem, error) or _ours(problem)):
            raise
        if named and type(problem).__module__ == 'builtins':
            raise error(text) from problem
        raise error(f'{path!s} {trouble}: {text}') from problem


def told(error: BaseException) -> str:
    """Text of an error in one line of bounded length, in words where Python has none."""
    text = one_line(str(error))
    if isinstance(error, UnicodeDecodeError):
        return f'it is no text (byte {error.start} is no {error.encoding.upper()})'
    if isinstance(error, UnicodeEncodeError):
        return 'its name is no UTF-8'
    if isinstance(error, json.JSONDecodeError):
        return f'it is no JSON (line {error.lineno}, column {error.colno})'
    if isinstance(error, RecursionError):
        return 'it is nested too deeply'
    if isinstance(error, MemoryError):
        return text or 'there is not enough memory'
    if text and (_ours(error) or isinstance(error, OSError | ValueError)):
        return text
    return f'it is damaged ({type(error).__name__}{text and ": "}{text})'


def one_line(text: str) -> str:
    """A text in one line of bounded length, without what only Python calls so, for people."""
    for pattern, words in _OF_PYTHON:
        text = pattern.sub(words, text)
    line = printable(' '.join(text.split()))
    return line if len(line) <= _LONGEST_TEXT else f'{line[:_LONGEST_TEXT]} ...'


def printable(text: str) -> str:
    """A text whose characters move no cursor: those that are not printed are escaped."""
    return ''.join(c if c.isprintable() or c == '\n' else repr(c)[1:-1] for c in text)


def _ours(error: BaseException) -> bool:
    # `python -m` names the module of a command so.
    return type(error).__module__.partition('.')[0] in (
        'sar_imaging', 'msg_conversions', '__main__')


@contextlib.contextmanager
def protecting_inputs() -> Iterator[None]:
    """Within, files that were read are not replaced by `replacing` and `filling`; for commands."""
    global _inputs
    before, _inputs = _inputs, {}
    try:
        yield
    finally:
        _inputs = before


@contextlib.contextmanager
def replacing(path: os.PathLike[str] | str, *, folder: bool = False) -> Iterator[Path]:
    """Make a file or a folder completely, then put it in its place at once.

    A link in its place is replaced, what it leads to is left alone.

    Parameters
    ----------
    path : path
        What to make; its parent exists.
    folder : bool
        Whether it is a folder.

    Yields
    ------
    Path
        What to write instead, of the same name, in a new folder for whatever is needed besides.

    Raises
    ------
    FileExistsError
        `path` is an input of the command (see `protecting_inputs`) or holds one, or is neither
        file nor link; or only one of both is a folder.
    """
    path = Path(os.path.abspath(path))
    check_target(path, folder=folder)
    with _beside(path.parent, path) as beside:
        part = beside / path.name
        yield part
        _move(part, path)


@contextlib.contextmanager
def filling(folder: os.PathLike[str] | str) -> Iterator[Path]:
    """Make files of a folder, all of them or none; the folder is made where it is missing.

    Parameters
    ----------
    folder : path
        Whose files are replaced by those of the same names.

    Yields
    ------
    Path
        New folder to write them into.

    Raises
    ------
    FileExistsError
        As `replacing`, for one of the files.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with _beside(folder, folder) as beside:
        yield beside
        made = sorted(beside.iterdir())
        for part in made:
            check_target(folder / part.name, folder=part.is_dir())
        for part in made:
            _move(part, folder / part.name)


def write_json(path: Path, content: object) -> None:
    """Write figures for programs; a number that is not finite is no JSON.

    Raises
    ------
    ValueError
        There is one.
    """
    path.write_text(json.dumps(content, indent=2, allow_nan=False) + '\n')


@contextlib.contextmanager
def _beside(folder: Path, target: Path) -> Iterator[Path]:
    """New folder that goes again; errors of files in it name what was to be made."""
    beside = str(folder / NEW)
    try:
        made = tempfile.TemporaryDirectory(prefix=NEW, dir=folder)
        try:
            yield Path(made.name)
        finally:
            try:
                made.cleanup()
            except KeyboardInterrupt:  # while it removed them
                made.cleanup()
                raise
    except OSError as error:
        there = str(error.filename or '')
        if error.errno is None and beside not in str(error) or there and beside not in there:
            raise
        while isinstance(error.__cause__, OSError):  # of a file within this folder
            error = error.__cause__
        kind = type(error) if type(error).__module__ == 'builtins' else OSError
        raise kind(f'{target} cannot be written: {error.strerror or told(error)}') from error


def check_target(path: Path, *, folder: bool = False) -> None:
    """Raise `FileExistsError` where a file or folder may not be replaced; see `replacing`."""
    if not os.path.lexists(path):
        return
    mode = path.lstat().st_mode
    if not (stat.S_ISREG(mode) or stat.S_ISLNK(mode) or stat.S_ISDIR(mode)):
        raise FileExistsError(f'{path} is no regular file; choose another path')
    if not stat.S_ISLNK(mode) and stat.S_ISDIR(mode) != folder:
        raise FileExistsError(f'{path} is {"a" if stat.S_ISDIR(mode) else "no"} folder; choose '
                              'another path')
    try:
        status, real = path.stat(), path.resolve()
    except OSError:  # a link to nothing
        return
    for identity, source in (_inputs or {}).items():
        if identity == (status.st_dev, status.st_ino) or real in source.parents:
            raise FileExistsError(f'{path} would replace the input {source}; choose another path')


def _move(part: Path, path: Path) -> None:
    """Put what was made in its place; a folder that stood there goes with that of `part`."""
    check_target(path, folder=part.is_dir())
    if part.is_dir() and os.path.lexists(path):
        old = part.with_name(f'{part.name}.old')
        path.rename(old)
        try:
            part.rename(path)
        except OSError:
            old.rename(path)
            raise
    else:
        part.replace(path)
