"""What a node tells at its start: derived quantities and what is wrong with its settings.

Two questions, as soon as each can be answered: `report_parameters` when the node is configured,
`report_block` when the first block has told the radar, the pulse rate and the track.
"""

from __future__ import annotations

import contextlib
import dataclasses
from typing import Protocol

import numpy as np

from ..diagnosis.reach import reach_advice
from ..signal.pulses import PulseBlock
from .constraints import Finding, check, check_settings
from .derived import derive
from .parameters import IMAGING_PARAMETERS, imaging_from_parameters
from .report import lines, rows
from .settings import Acquisition, Imaging, Machine


class Parameters(Protocol):
    """Values by name, such as those of a node; KeyError for a name that it does not have."""

    def __getitem__(self, name: str): ...


@dataclasses.dataclass(frozen=True)
class StartupReport:
    """Text for the log.

    Parameters
    ----------
    lines : tuple of str
        Derived quantities; empty where they are not known.
    warnings, errors : tuple of str
        What will disappoint, and what makes the configuration impossible.
    """

    lines: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()


def report_parameters(parameters: Parameters) -> StartupReport:
    """Check what needs no radar.

    Parameters
    ----------
    parameters : mapping or ParameterValues
        Parameters of the node by name, those of the grid and `pulses_per_aperture` among them.

    Returns
    -------
    StartupReport
        Without lines.
    """
    try:
        imaging = imaging_from_parameters(_known(parameters))
        findings = check_settings(imaging, Machine.this_one())
    except ValueError as error:
        return StartupReport(errors=(str(error),))
    return _report((), findings)


def report_block(parameters: Parameters, block: PulseBlock) -> StartupReport:
    """Derive and check everything that a first block and the parameters tell.

    The track is carried on straight from the block, so what follows from the track is a warning
    here where `check_config` has an error.

    Parameters
    ----------
    parameters : mapping or ParameterValues
        As for `report_parameters`; those of range compression are used where they are given.
    block : PulseBlock
        Pulses or range profiles with phase centres.

    Returns
    -------
    StartupReport
        Empty when the block is too short to tell pulse rate and track: ask again with the next.
    """
    parameters = _known(parameters)
    try:
        imaging = imaging_from_parameters(parameters)
        if block.compressed and 'oversampling' not in parameters:  # as they come
            imaging = dataclasses.replace(imaging, oversampling=1.0)
        if 'pulses_per_block' not in parameters:
            imaging = dataclasses.replace(imaging, pulses_per_block=block.n_pulses)
        machine = Machine.this_one()
        acquisition = acquisition_of(block, imaging)
        if acquisition is None:
            return StartupReport()
        derived = derive(acquisition, imaging, machine)
    except ValueError as error:
        return StartupReport(errors=(str(error),))
    findings = check(acquisition, imaging, machine, derived)
    if advice := reach_advice(block, imaging.grid):
        # What follows from the track is not worth reading then.
        findings = [Finding('warning', f'none of the grid lies within the profiles; {advice}'),
                    *(f for f in findings if not f.from_track)]
    findings = [dataclasses.replace(f, severity='warning') if f.from_track else f
                for f in findings]
    return _report(lines(rows(acquisition, imaging, machine, derived)), findings)


def acquisition_of(block: PulseBlock, imaging: Imaging) -> Acquisition | None:
    """Radar, pulse rate and straight track of a block.

    Parameters
    ----------
    block : PulseBlock
        With phase centres.
    imaging : Imaging
        Tells how long the aperture is, in whose middle the platform is asked for.

    Returns
    -------
    Acquisition or None
        None when the block has fewer than two pulses at different times and places.
    """
    if block.n_pulses < 2 or not block.has_positions:
        return None
    first, last = np.argsort(block.counter, kind='stable')[[0, -1]]
    counts = int(block.counter[last]) - int(block.counter[first])
    duration_s = (int(block.stamp_ns[last]) - int(block.stamp_ns[first])) * 1e-9
    centres = block.phase_centre_m
    travel = centres[last] - centres[first]
    distance = float(np.linalg.norm(travel))
    if counts < 1 or duration_s <= 0 or distance == 0:
        return None
    length = imaging.pulses_per_aperture
    ahead = (length - 1) / 2 - int(block.counter[first]) % length
    along = block.rx_m[first] @ (travel / distance)
    return Acquisition(
        radar=block.radar, compressed=block.compressed, n_samples=block.n_samples,
        n_channels=block.n_channels, prf_hz=counts / duration_s,
        centre_m=tuple(centres[first] + travel * (ahead / counts)),
        velocity_m_per_s=tuple(travel / duration_s),
        channel_spacing_m=float(np.ptp(along)) / max(1, block.n_channels - 1))


def _known(parameters: Parameters) -> dict:
    """Those of interest that there are."""
    values = {}
    for name in IMAGING_PARAMETERS:
        with contextlib.suppress(KeyError):
            values[name] = parameters[name]
    return values


def _report(text, findings: list[Finding]) -> StartupReport:
    return StartupReport(tuple(text), *(tuple(f.text for f in findings if f.severity == severity)
                                        for severity in ('warning', 'error')))
