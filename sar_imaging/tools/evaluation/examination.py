# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Focus of an evaluated image, the mistake that spoils it, and the results in words."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from ...autofocus.report import FOCUSED, FOCUSED_ALREADY
from ...diagnosis import Diagnosis, diagnose
from ...geometry.grids import MapGrid
from ...quality.measures import FocusFigure, focus_figure
from ...recordings.bag_io import BagError
from ...recordings.pulse_source import joined
from ...recordings.recording import Recording
from ...signal.pulses import PulseBlock

IN_FOCUS = (FOCUSED, FOCUSED_ALREADY)  # verdicts of autofocus
_MOST_BYTES = 512e6  # of samples that are read for it


def examine(recording: Recording, aperture: int, pulses_per_aperture: int, image: np.ndarray,
            grid: MapGrid, autofocus: dict[str, Any] | None = None) -> dict[str, Any]:
    """The entry `focus` of quality.json.

    Parameters
    ----------
    recording : Recording
        What was replayed.
    aperture, pulses_per_aperture : int
        Which of its pulses the image shows.
    image : (n_y, n_x) complex64
        Image.
    grid : MapGrid
        Its pixels.
    autofocus : dict, optional
        What autofocus of the node found. Where its verdict is that the image is in focus, a
        mistake of the recorded positions is not one of the image.

    Returns
    -------
    dict
        Of JSON types; `mistake` and `advice` are empty where nothing is wrong.
    """
    figure = focus_figure(image)
    try:
        diagnosis = diagnose(_pulses(recording, aperture, pulses_per_aperture), grid,
                             window=(recording.truth or {}).get('window', 'none'))
    except (ValueError, MemoryError, BagError) as error:
        diagnosis = Diagnosis(0.0, 0.0, '', f'the pulses could not be examined: {error}')
    if autofocus and autofocus['verdict'] in IN_FOCUS:
        diagnosis = dataclasses.replace(diagnosis, mistake='', advice='')
    if diagnosis.coverage and not diagnosis.mistake and not figure.at_noise_level:
        # Of clutter without strong reflectors the diagnosis of a few tiles sees nothing.
        diagnosis = dataclasses.replace(diagnosis, advice='')
    return _as_json(figure, diagnosis)


def doubtful(focus: dict[str, Any]) -> bool:
    """True when an image should not be used before somebody looked at it."""
    return focus['at_noise_level'] or bool(focus['mistake'])


def describe(focus: dict[str, Any]) -> str:
    """Lines for the summary."""
    line = (f'focus: peak {focus["peak_over_median_db"]:.1f} dB over the median (noise: up to '
            f'{focus["noise_db"]:.1f}), contrast {focus["contrast"]:.3g}, entropy '
            f'{focus["entropy"]:.2f}, coherence {focus["coherence"]:.2f}')
    return f'{line}\nwarning: {focus["advice"]}' if focus['advice'] else line


def _as_json(figure: FocusFigure, diagnosis: Diagnosis) -> dict[str, Any]:
    return {'peak_over_median_db': round(figure.peak_over_median_db, 2),
            'entropy': round(figure.entropy, 4), 'contrast': round(figure.contrast, 4),
            'noise_db': round(figure.noise_db, 2), 'at_noise_level': figure.at_noise_level,
            'coherence': round(diagnosis.coherence, 3), 'mistake': diagnosis.mistake,
            'advice': diagnosis.advice, 'coherence_corrected': round(diagnosis.corrected, 3)}


def _pulses(recording: Recording, aperture: int, length: int) -> PulseBlock:
    """Pulses of one aperture with positions, each once and in order."""
    block = next(joined(recording.blocks(aperture * length, (aperture + 1) * length), _MOST_BYTES))
    return block.select(np.argsort(block.counter, kind='stable'))


_COLUMNS = (('IRW (m)', 'irw', 'm', 3), ('PSLR (dB)', 'pslr', 'db', 2),
            ('ISLR (dB)', 'islr', 'db', 2), ('error (m)', 'position_error', 'm', 3))
_LEGEND = """\
Every column has two figures, along range (away from the radar) and along azimuth (across that).
IRW: impulse response width, of a point at half of its power. PSLR: peak sidelobe ratio, the
highest sidelobe over the peak. ISLR: integrated sidelobe ratio, the energy of all sidelobes over
that of the main lobe. error: measured minus true position. -: could not be measured, see below
its line or in quality.json. docs/evaluate.md explains how they are measured."""


def summary(quality: dict[str, Any]) -> str:
    """Readable text of what quality.json holds."""
    lines = []
    if quality['scatterers']:
        width = max(len('range, azimuth'), *(len(s['name']) for s in quality['scatterers']))
        lines.append('  '.join([f'{"range, azimuth":{width}}',
                                *(f'{title:>15}' for title, *_ in _COLUMNS)]))
    for s in quality['scatterers']:
        pairs = [', '.join(_number(s[f'{key}_{axis}_{unit}'], n) for axis in ('range', 'azimuth'))
                 for _, key, unit, n in _COLUMNS]
        lines.append('  '.join([f'{s["name"]:{width}}', *(f'{p:>15}' for p in pairs)]))
        if s['reason']:
            lines.append(f'{"":{width}}    {s["reason"]}')
    if quality['scatterers']:
        lines.append(_LEGEND)
    unplaced = quality['nodes'].get('pulse_buffer', {}).get('pulses_without_pose')
    if unplaced:
        lines.append(f'warning: {unplaced} pulses had no pose in time and are not in the image')
    lines.append(f'pulses received {quality["pulses_received"]}, missing '
                 f'{quality["pulses_missing"]}; blocks rejected {quality["blocks_rejected"]}; '
                 f'last pulse to image {quality["seconds_last_pulse_to_image"]:.2f} s; predicted '
                 f'error {_number(quality["predicted_error_db"], 0)} dB against exact correlation')
    lines.append(describe(quality['focus']))
    if found := quality['autofocus']:
        lines.append(f'autofocus: {found["verdict"]}; clock offset found '
                     f'{_number(found["time_offset_s"], 4)} s, largest correction of a position '
                     f'{_number(found["largest_move_m"], 3)} m, contrast '
                     f'{_number(found["contrast_before"], 2)} to '
                     f'{_number(found["contrast_after"], 2)}; {found["reason"]}')
    return '\n'.join(lines)


def _number(value: float | None, digits: int) -> str:
    return '-' if value is None else f'{value:.{digits}f}'
