"""Common parts of the programs that make figures: exit status, and the look of the figures."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np


def run_and_report(folder: Path, run: Callable[[], dict], summary: Callable[[dict], str], *,
                   errors: tuple[type[Exception], ...] = ()) -> int:
    """Run an experiment, write results.json and print a summary.

    Parameters
    ----------
    folder : path
        For the figures and results.json.
    run : callable
        Makes the folder, writes the figures into it and returns what goes into results.json.
    summary : callable
        Text for people from that.
    errors : tuple of type
        What `run` may raise, besides OSError, whose text is enough for people.

    Returns
    -------
    int
        Exit status of the program.
    """
    try:
        results = run()
        (folder / 'results.json').write_text(json.dumps(results, indent=1) + '\n')
    except (OSError, *errors) as error:
        print(f'error: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('interrupted', file=sys.stderr)
        return 130
    print(summary(results))
    print(f'Figures and results.json are in {folder}')
    return 0


def decibels(values, reference: float | None = None) -> np.ndarray:
    """Levels in dB below a reference, by default the largest magnitude; at least -120 dB."""
    magnitude = np.abs(np.asarray(values))
    reference = magnitude.max() if reference is None else reference
    return 20 * np.log10(np.maximum(magnitude / reference, 1e-6))


def draw_grid(axes, **labels) -> None:
    """Label axes and draw a light grid behind what they show."""
    axes.set(**labels)
    axes.grid(True, color='0.88', linewidth=0.6)
    axes.set_axisbelow(True)
