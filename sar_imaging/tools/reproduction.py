"""What the programs that reproduce a paper share: their end, and the look of their figures."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np


def run_reproduction(folder: Path, reproduce: Callable[[], dict],
                     summary: Callable[[dict], str]) -> int:
    """Reproduce a paper, write results.json and print a summary.

    Parameters
    ----------
    folder : path
        For the figures and results.json; created if need be.
    reproduce : callable
        Writes the figures and returns what goes into results.json.
    summary : callable
        Text for people from that.

    Returns
    -------
    int
        Exit status of the program.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        results = reproduce()
        (folder / 'results.json').write_text(json.dumps(results, indent=1) + '\n')
    except OSError as error:
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
