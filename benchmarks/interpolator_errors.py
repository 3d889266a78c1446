# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Write the errors of interpolators that plans look up, since designing them takes seconds.

Run from the repository root after a change of `sar_imaging.planning.interpolators`::

    python -m benchmarks.interpolator_errors
"""

from __future__ import annotations

import json

import numpy as np

from sar_imaging.planning import interpolators
from sar_imaging.planning.exact.groups import DEGREE, LENGTHS

OVERSAMPLING, MARGINS = np.arange(13, 40) / 10, 0.05 * np.arange(12) + 0.03


def of_lines(taps: int) -> list[float]:
    """By oversampling."""
    return [round(interpolators.design_interpolator(o, taps=taps, degree=DEGREE).error_db, 3)
            for o in interpolators.OVERSAMPLING]


def of_profiles(degree: int) -> list[list[float]]:
    """By oversampling and margin."""
    return [[round(interpolators.design_interpolator(o, m, degree=degree).error_db, 3)
             for m in MARGINS] for o in OVERSAMPLING]


def main() -> None:
    """Write the file of the package."""
    taps = sorted({n for lengths in LENGTHS.values() for n in (lengths.taps, lengths.part_taps)})
    found = {'lines': {str(n): of_lines(n) for n in taps},
             'profiles': {str(v.degree): of_profiles(v.degree) for v in LENGTHS.values()}}
    interpolators.ERRORS.write_text(json.dumps(found).replace('], ', '],\n') + '\n')


if __name__ == '__main__':
    main()
