"""Geometry model whose unknowns align a radar with the poses of its platform."""

from __future__ import annotations

import dataclasses

import numpy as np

from ..geometry.alignment import Alignment
from ..geometry.poses import PoseTable, PoseTrack
from ..signal.positioning import locate
from ..signal.pulses import PulseBlock
from .models import Geometry, GeometryModel

NAMES = ('time_offset_s', 'range_bias_m', 'lever_x_m', 'lever_y_m', 'lever_z_m')


def alignment_model(block: PulseBlock, track: PoseTrack | PoseTable, start: Alignment,
                    **scale: float) -> GeometryModel:
    """Phase centres as a function of time offset, range bias and lever arm.

    A constant lever arm of a platform that does not turn displaces the image and sharpens
    nothing: leave it out there.

    Parameters
    ----------
    block : PulseBlock
        Pulses located with `start`.
    track : PoseTrack or PoseTable
        Poses of the platform, reaching beyond the pulses by more than the time offset may be
        wrong.
    start : Alignment
        Nominal alignment.
    scale : float
        Expected error of each parameter to estimate, by its name in `NAMES`. The others keep
        their nominal values. A lever arm moves all phase centres alike, in the body frame.

    Returns
    -------
    GeometryModel
        Its parameters are the values themselves, but for the lever arm, which is added to the
        nominal ones, metres.

    Raises
    ------
    ValueError
        A name is unknown. The model raises it where a pulse has no pose.
    """
    if unknown := set(scale) - set(NAMES):
        raise ValueError(f'unknown parameters {", ".join(sorted(unknown))}; use some of '
                         f'{", ".join(NAMES)}')
    names = [name for name in NAMES if name in scale]
    nominal = dict.fromkeys(NAMES, 0.0) | {'time_offset_s': start.time_offset_s,
                                           'range_bias_m': start.range_bias_m}

    def geometry(parameters):
        changed = aligned(start, dict(zip(names, parameters, strict=True)))
        located = locate(block, track, changed)
        return Geometry(located.tx_m, located.rx_m, changed.range_bias_m - start.range_bias_m)

    return GeometryModel(names, [nominal[name] for name in names],
                         [scale[name] for name in names], geometry)


def aligned(start: Alignment, parameters: dict[str, float]) -> Alignment:
    """Alignment with parameters of `alignment_model`, by name; the others stay."""
    values = {name: float(parameters[name]) for name in NAMES[:2] if name in parameters}
    arm = np.array([parameters.get(name, 0.0) for name in NAMES[2:]])
    return dataclasses.replace(start, tx_m=start.tx_m + arm, rx_m=start.rx_m + arm, **values)
