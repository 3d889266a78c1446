# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Arguments that several commands have: one name, one text, and one way to read them."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from pathlib import Path

from sar_imaging.geometry.earth import Datum
from sar_imaging.memory import available_bytes
from sar_imaging.recordings import SourceError


def add_pulses(parser: argparse.ArgumentParser) -> None:
    """What `open_pulses` opens."""
    parser.add_argument('file', type=Path,
                        help='folder of a recording (rosbag2), CPHD file, or description of '
                             'arrays in YAML')


def add_output(parser: argparse.ArgumentParser, what: str = 'the results') -> None:
    """Folder that a command fills."""
    parser.add_argument('--output', type=Path, required=True, metavar='FOLDER',
                        help=f'folder for {what}, made when missing')


def add_aperture(parser: argparse.ArgumentParser) -> None:
    """Which pulses of a recording."""
    parser.add_argument('--aperture', type=int, metavar='N',
                        help='of a recording: number of the aperture, pulse counter // pulses per '
                             'aperture (default: the last complete one)')


def add_memory(parser: argparse.ArgumentParser) -> None:
    """How much memory, see `memory_bytes`."""
    parser.add_argument('--memory', type=float, metavar='GB',
                        help='most memory to take (default: half of what is free)')


def add_datum(parser: argparse.ArgumentParser) -> None:
    """Where a frame stands, see `datum_of`."""
    parser.add_argument('--datum', type=float, nargs='+', metavar='NUMBER',
                        help='latitude and longitude in degrees, ellipsoidal height in metres '
                             'and, optionally, heading of the frame in degrees: where its origin '
                             'stands, instead of what the file tells')


def positive(kind: type) -> Callable[[str], float]:
    """Reader of an argument that is a finite number of a kind, above 0."""
    def read(text: str) -> float:
        value = kind(text)
        if not 0 < value < math.inf:
            raise argparse.ArgumentTypeError(f'{text} is not a positive number')
        return value

    read.__name__ = kind.__name__  # which argparse tells where the text is none
    return read


def datum_of(arguments: argparse.Namespace) -> Datum | None:
    """Datum that the arguments tell.

    Raises
    ------
    SourceError
        There is no such place.
    """
    check_count('--datum', arguments.datum, 3, 4, 'latitude, longitude, height and heading')
    try:
        return None if arguments.datum is None else Datum(*arguments.datum)
    except ValueError as error:
        raise SourceError(f'--datum: {error}') from error


def memory_bytes(arguments: argparse.Namespace) -> float:
    """Memory that may be taken, bytes.

    Raises
    ------
    SourceError
        There is no such amount.
    """
    if arguments.memory is None:
        return available_bytes() / 2
    if not arguments.memory > 0:
        raise SourceError(f'--memory {arguments.memory:g}; expected a positive number of GB')
    return arguments.memory * 1e9


def check_count(name: str, values: Sequence[float] | None, least: int, most: int, meaning: str
                ) -> None:
    """Refuse another number of numbers, and what is not finite; None is not given.

    Raises
    ------
    SourceError
        The text says what was expected.
    """
    if values is not None and not (least <= len(values) <= most
                                   and all(map(math.isfinite, values))):
        raise SourceError(f'{name} {" ".join(f"{v:g}" for v in values)}: expected {least} to '
                          f'{most} finite numbers, {meaning}')
