"""Logs of Time Domain's radars P410, P440 and P452: one line of text for each scan.

The maker's program MRM-RET and its sample application write lines of comma-separated fields, the
second of which names the kind. A scan is a line of the kind ``MrmFullScanInfo``: times, first and
last delay in picoseconds, step in bins, then the samples. Other lines are passed over.
"""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np

from ...signal.radar import SPEED_OF_LIGHT
from ..description import DescriptionError

_SCAN = 'MrmFullScanInfo'
_BIN_S = 1 / (512 * 1.024e9)  # of the radar's timer
_RAW = 1  # of the field filtering: others were filtered in range or over time
# Places of the fields by the number of those before the samples, the last of which counts these:
# MRM-RET, and the sample application without its five reserved fields.
_PLACES = {16: {'time': 4, 'start': 9, 'step': 11, 'filtering': 12, 'antenna': 13},
           11: {'time': 4, 'start': 5, 'step': 7, 'filtering': 8, 'antenna': 9}}
_SEARCHED = 10_000  # characters in which the first scan is announced


def is_log(path: Path) -> bool:
    """Whether a text file is such a log."""
    with path.open(encoding='utf-8', errors='replace') as file:
        return _SCAN in file.read(_SEARCHED)


def read_log(path: Path) -> dict[str, np.ndarray]:
    """Variables of a log.

    Parameters
    ----------
    path : Path
        Text file.

    Returns
    -------
    dict of str to array
        ``scan`` (P, N) int32; ``time_s`` (P,) float64 by the radar's clock, in steps of a
        millisecond; ``host_time_s`` (P,) float64 when the computer received it, since 1970;
        ``range_start_m`` and ``range_bin_m``, float64: range of the first sample, antenna delays
        included, and from sample to sample.

    Raises
    ------
    DescriptionError
        It holds no raw scans, or scans of several settings.
    """
    return _read(path, path.stat().st_mtime_ns)


@functools.lru_cache(maxsize=1)  # one description asks for each variable
def _read(path: Path, _: int) -> dict[str, np.ndarray]:
    heads, scans, filtered = [], [], 0
    with path.open(encoding='utf-8', errors='replace') as file:
        for number, line in enumerate(file, 1):
            fields = line.split(',')
            if len(fields) < 2 or fields[1].strip() != _SCAN or fields[0].strip() == 'Timestamp':
                continue
            try:
                head, samples = _scan(fields)
            except (ValueError, OverflowError):
                raise DescriptionError(
                    f'{path.name}: line {number} is no whole {_SCAN}: expected 16 or 11 fields, '
                    'the last of which counts the samples behind it; was the file cut off? '
                    'Remove the line') from None
            if head['filtering'] != _RAW:
                filtered += 1
                continue
            heads.append(head)
            scans.append(samples)
    if not scans:
        raise DescriptionError(f'{path.name} holds no raw scans but {filtered} filtered ones; '
                               'expected lines MrmFullScanInfo with Filtering 1: switch the raw '
                               'scans on in the program that logs')
    for key, meaning in (('start', 'ScanStartPs'), ('step', 'ScanStepBins'),
                         ('antenna', 'AntennaId')):
        found = {head[key] for head in heads}
        if len(found) > 1:
            raise DescriptionError(f'{path.name}: scans with {meaning} of '
                                   f'{", ".join(map(str, sorted(found)))}; expected one setting: '
                                   'cut the log into one file for each')
    if len({scan.size for scan in scans}) > 1:
        raise DescriptionError(f'{path.name}: scans of {min(s.size for s in scans)} to '
                               f'{max(s.size for s in scans)} samples; expected one length')
    return {'scan': np.stack(scans),
            'time_s': 1e-3 * np.array([head['time'] for head in heads]),
            'host_time_s': np.array([head['host'] for head in heads]),
            'range_start_m': np.array(0.5e-12 * SPEED_OF_LIGHT * heads[0]['start']),
            'range_bin_m': np.array(0.5 * SPEED_OF_LIGHT * _BIN_S * heads[0]['step'])}


def _scan(fields: list[str]) -> tuple[dict[str, float], np.ndarray]:
    """Numbers before the samples, and (N,) int32 samples."""
    for n, places in _PLACES.items():
        if len(fields) > n and int(float(fields[n - 1])) == len(fields) - n:
            head = {key: int(fields[place]) for key, place in places.items()}
            return {**head, 'host': float(fields[0])}, np.array(fields[n:], np.int32)
    raise ValueError(fields[:2])
