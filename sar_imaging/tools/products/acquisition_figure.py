"""Drawing of an acquisition: track, scene and lines of sight, from above and from behind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

_TRACK, _SCENE, _SIGHT = '#1f5f8b', '#c26b1f', '0.6'


def save_acquisition_png(path: Path | str, track_m: np.ndarray, corners_m: np.ndarray) -> None:
    """Draw where the radar flew and what it imaged.

    Parameters
    ----------
    path : path
        PNG file to write.
    track_m : (P, 3) float64
        Mean phase centres in the order flown, metres.
    corners_m : (4, 3) float64
        Corners of the image, in turn, metres.
    """
    figure = Figure(figsize=(9.0, 4.4), layout='constrained')
    FigureCanvasAgg(figure)
    above, beside = figure.subplots(1, 2)
    middle, centre = track_m.mean(axis=0), corners_m.mean(axis=0)
    sight = centre - middle
    away = sight[:2] / max(float(np.linalg.norm(sight[:2])), 1e-9)
    if not away.any():
        away = np.array([1.0, 0.0])
    _draw(above, track_m[:, :2], corners_m[:, :2])
    if len(track_m) > 1:
        above.annotate('', track_m[-1, :2], track_m[-max(2, len(track_m) // 10), :2],
                       arrowprops={'arrowstyle': '-|>', 'color': _TRACK, 'lw': 2})
    above.set(title='from above', xlabel='x (m)', ylabel='y (m)', aspect='equal')
    # heights over the horizontal distance along the line of sight
    section = [np.column_stack([(points[:, :2] - middle[:2]) @ away, points[:, 2]])
               for points in (track_m, corners_m)]
    _draw(beside, *section)
    beside.set(title='along the track', xlabel='distance from the track (m)',
               ylabel='z (m)', aspect='equal')
    for axes in (above, beside):
        axes.margins(0.08)
        axes.grid(True, color='0.9', linewidth=0.6)
        axes.set_axisbelow(True)
        axes.tick_params(labelsize=8)
        axes.set_adjustable('datalim')
    above.legend(loc='best', fontsize=8)
    figure.savefig(path, dpi=110)


def _draw(axes, track: np.ndarray, corners: np.ndarray) -> None:
    centre = corners.mean(axis=0)
    for end in (track[0], track[-1]):
        axes.plot(*np.stack([end, centre]).T, color=_SIGHT, lw=0.8, ls='--')
    axes.add_patch(Polygon(corners, closed=True, facecolor=_SCENE, edgecolor=_SCENE, alpha=0.5,
                           label='image'))
    axes.plot(*corners[[0, 1, 2, 3, 0]].T, color=_SCENE, lw=1.2)
    axes.plot(*track.T, color=_TRACK, lw=2.4, label='phase centres', marker='.', ms=3)
