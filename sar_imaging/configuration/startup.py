# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Report of a node once its first block has told the radar, the pulse rate and the track.

Derived quantities and problems of its settings; what needs no radar `constraints.check_settings`
tells when the node is configured.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..diagnosis.hypotheses import reach_advice
from ..signal.pulses import PulseBlock
from .antenna import NONE
from .constraints import Finding, check
from .derived import derive
from .parameters import imaging_from_parameters
from .report import lines, rows
from .settings import Acquisition, Imaging, Machine

_STRAIGHT_SHARE = 0.75  # of an aperture that was flown straight, before it counts as such
_OFF_SHARE = 0.25  # of the way flown by which a straight track may be off


@dataclasses.dataclass(frozen=True)
class StartupReport:
    """Text for the log.

    Parameters
    ----------
    lines : tuple of str
        Derived quantities; empty where they are not known.
    warnings, errors : tuple of str
        What will disappoint, and what makes the configuration impossible.
    track : TrackWarnings, optional
        Warnings that hold if the track goes on straight.
    """

    lines: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()
    track: TrackWarnings | None = None


class TrackWarnings:
    """Warnings that wait until the track has gone on straight, as its first block did.

    The row of a raster is straight as well, and what follows from carrying it on is wrong.

    Parameters
    ----------
    texts : tuple of str
        The warnings.
    block : PulseBlock
        The first block.
    acquisition : Acquisition
        Its straight track.
    n_pulses : int
        Number of pulses of an aperture.
    """

    def __init__(self, texts: tuple[str, ...], block: PulseBlock, acquisition: Acquisition,
                 n_pulses: int) -> None:
        self.texts = texts
        first = int(np.argmin(block.counter))
        self._counter, self._place_m = int(block.counter[first]), block.phase_centre_m[first]
        self._step_m = np.array(acquisition.velocity_m_per_s) / acquisition.prf_hz
        self._enough = _STRAIGHT_SHARE * n_pulses

    def straight(self, block: PulseBlock) -> bool | None:
        """Whether the track is straight so far; None while too little of it is known.

        Parameters
        ----------
        block : PulseBlock
            The first or a later one, with phase centres.
        """
        count = block.counter.astype(np.int64) - self._counter
        off_m = block.phase_centre_m - self._place_m - count[:, None] * self._step_m
        flown_m = np.maximum(count, 1) * np.linalg.norm(self._step_m)
        later = count > 0
        if np.any(np.linalg.norm(off_m, axis=1)[later] > _OFF_SHARE * flown_m[later]):
            # Vibration and noise are large beside the first steps, not beside an aperture.
            if count.max() >= _OFF_SHARE * self._enough:
                return False
        return True if count.max() + 1 >= self._enough else None


def report_block(parameters: Mapping[str, Any], block: PulseBlock) -> StartupReport:
    """Derive and check everything that a first block and the parameters tell.

    The track is carried on straight from the block, so what follows from the track is a warning
    here where `check_config` has an error, and waits in `StartupReport.track` until the track has
    gone on so.

    Parameters
    ----------
    parameters : mapping
        Parameters of the node by name, those of the grid and `pulses_per_aperture` among them;
        those of range compression are used where they are given.
    block : PulseBlock
        Pulses or range profiles with phase centres.

    Returns
    -------
    StartupReport
        Empty when the block is too short to tell pulse rate and track: ask again with the next.
    """
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
        acquisition = dataclasses.replace(acquisition, beamwidth_rad=_beamwidth_rad(parameters))
        derived = derive(acquisition, imaging, machine)
    except ValueError as error:
        return StartupReport(errors=(str(error),))
    findings = check(acquisition, imaging, machine, derived)
    if advice := reach_advice(block, imaging.middle_grid):
        # What follows from the track is not worth reading then.
        findings = [Finding('warning', f'none of the grid lies within the profiles; {advice}'),
                    *(f for f in findings if not f.from_track)]
    waiting = tuple(f.text for f in findings if f.from_track)
    warnings, errors = (
        tuple(f.text for f in findings if f.severity == severity and not f.from_track)
        for severity in ('warning', 'error'))
    return StartupReport(
        tuple(lines(rows(acquisition, imaging, machine, derived))), warnings, errors,
        TrackWarnings(waiting, block, acquisition, imaging.pulses_per_aperture)
        if waiting else None)


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
    if block.n_pulses < 2 or block.rx_m is None:
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


def _beamwidth_rad(parameters: Mapping[str, Any]) -> float:
    """Width of the pattern that images are weighed by; 0 where it is not known."""
    if parameters.get('antenna.pattern', NONE) == NONE:
        return 0.0
    return math.radians(parameters['antenna.azimuth_width'])
