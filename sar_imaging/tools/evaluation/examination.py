"""Focus of an evaluated image and, from the recorded pulses, the mistake that spoils it."""

from __future__ import annotations

import dataclasses

import numpy as np

from sar_imaging.autofocus.report import FOCUSED, FOCUSED_ALREADY
from sar_imaging.diagnosis import Diagnosis, diagnose
from sar_imaging.geometry.alignment import Alignment
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.quality.measures import FocusFigure, focus_figure
from sar_imaging.signal.positioning import locate
from sar_imaging.signal.pulses import PulseBlock, concatenate

from ..recordings.bag_io import deserialise, raw_messages, read_poses
from ..recordings.recording import Recording

IN_FOCUS = (FOCUSED, FOCUSED_ALREADY)  # verdicts of autofocus
_MOST_BYTES = 512e6  # of samples that are read for it


def examine(recording: Recording, aperture: int, pulses_per_aperture: int, image: np.ndarray,
            grid: MapGrid, autofocus: dict | None = None) -> dict:
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
    except (ValueError, MemoryError) as error:
        diagnosis = Diagnosis(0.0, 0.0, '', f'the pulses could not be examined: {error}')
    if autofocus and autofocus['verdict'] in IN_FOCUS:
        diagnosis = dataclasses.replace(diagnosis, mistake='', advice='')
    if diagnosis.coverage and not diagnosis.mistake and not figure.at_noise_level:
        # Of clutter without strong reflectors the diagnosis of a few tiles sees nothing.
        diagnosis = dataclasses.replace(diagnosis, advice='')
    return _as_json(figure, diagnosis)


def doubtful(focus: dict) -> bool:
    """True when an image should not be used before somebody looked at it."""
    return focus['at_noise_level'] or bool(focus['mistake'])


def describe(focus: dict) -> str:
    """Lines for the summary."""
    line = (f'focus: peak {focus["peak_over_median_db"]:.1f} dB over the median (noise: up to '
            f'{focus["noise_db"]:.1f}), contrast {focus["contrast"]:.3g}, entropy '
            f'{focus["entropy"]:.2f}, coherence {focus["coherence"]:.2f}')
    return f'{line}\nwarning: {focus["advice"]}' if focus['advice'] else line


def _as_json(figure: FocusFigure, diagnosis: Diagnosis) -> dict:
    return {'peak_over_median_db': round(figure.peak_over_median_db, 2),
            'entropy': round(figure.entropy, 4), 'contrast': round(figure.contrast, 4),
            'noise_db': round(figure.noise_db, 2), 'at_noise_level': figure.at_noise_level,
            'coherence': round(diagnosis.coherence, 3), 'mistake': diagnosis.mistake,
            'advice': diagnosis.advice, 'coherence_corrected': round(diagnosis.corrected, 3)}


def _pulses(recording: Recording, aperture: int, length: int) -> PulseBlock:
    """Pulses of one aperture with positions, each once and in order."""
    poses = read_poses(recording.path)
    track = None if poses is None else poses.track()
    blocks, n_bytes = [], 0
    for _, cdr in raw_messages(recording.path):
        try:
            block = deserialise(cdr)
        except Exception:  # damaged bytes fail in many ways; the nodes have counted them
            continue
        block = block.select(block.counter.astype(np.int64) // length == aperture)
        if not block.n_pulses or (blocks and not block.matches(blocks[0])):
            continue
        n_bytes += block.samples.nbytes
        if n_bytes > _MOST_BYTES:
            break
        blocks.append(block)
    joined = concatenate(blocks)
    _, first = np.unique(joined.counter, return_index=True)
    joined = joined.select(first)
    if joined.has_positions or track is None:
        return joined
    return locate(joined, track, Alignment(**(recording.truth or {}).get('alignment', {})))
