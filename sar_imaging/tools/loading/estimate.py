"""Time offset and range bias between radar and poses, from the image alone."""

from __future__ import annotations

from sar_imaging.autofocus.alignment_model import aligned, alignment_model
from sar_imaging.autofocus.autofocus import Autofocus, AutofocusReport
from sar_imaging.geometry.alignment import Alignment
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.poses import PoseTable
from sar_imaging.signal.positioning import locate
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.range_compression import RangeCompressor

# What the alignment may be wrong by
EXPECTED_ERROR = {'time_offset_s': 0.05, 'range_bias_m': 0.2}


def estimate_alignment(block: PulseBlock, poses: PoseTable, start: Alignment,
                       grid: MapGrid) -> tuple[Alignment, AutofocusReport]:
    """Time offset and range bias from the image alone, beginning with `start`.

    A platform that does not turn shows the same image, displaced, with any lever arm: that stays
    as it is.

    Parameters
    ----------
    block : PulseBlock
        Raw pulses without positions.
    poses : PoseTable
        Of the platform.
    start : Alignment
        What to begin with.
    grid : MapGrid
        Where to image.

    Returns
    -------
    Alignment, AutofocusReport
        The alignment is `start` where autofocus did not accept what it found. A parameter whose
        uncertainty is as large as `EXPECTED_ERROR` has not been determined.
    """
    located = locate(block, poses, start)
    profiles = RangeCompressor.for_block(located)(located)
    report = Autofocus(grid, n_phases=0, model=lambda pulses: alignment_model(
        pulses, poses, start, **EXPECTED_ERROR)).process(profiles).report
    return (aligned(start, report.parameters) if report.accepted else start), report


def describe(report: AutofocusReport) -> str:
    """What autofocus found, and which parameter the image does not determine."""
    found = ', '.join(
        f'{name} {value:.4f}' + (' (not determined by the image)'
                                 if report.uncertainty[name] > 0.5 * EXPECTED_ERROR[name] else '')
        for name, value in report.parameters.items())
    return f'{report}; {found}'
