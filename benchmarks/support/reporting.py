# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Common parts of the programs that make figures: exit status, and the look of the figures."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from sar_imaging.files import filling
from sar_imaging.tools.program import run_command


def run_and_report(folder: Path, run: Callable[[Path], dict], summary: Callable[[dict], str]
                   ) -> int:
    """Run an experiment, write results.json and print a summary.

    Parameters
    ----------
    folder : path
        For the figures and results.json.
    run : callable
        Writes the figures into a folder and returns what goes into results.json.
    summary : callable
        Text for people from that.

    Returns
    -------
    int
        Exit status of the program.
    """
    def report() -> str:
        with filling(folder) as part:
            results = run(part)
            (part / 'results.json').write_text(json.dumps(results, indent=1) + '\n')
        return f'{summary(results)}\nFigures and results.json are in {folder}'

    return run_command(report)


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
