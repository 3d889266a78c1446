# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What the operations of a backend cost, in nanoseconds of one thread.

Plans choose by these costs what is quickest. They are the same everywhere unless measured costs
are asked for (`sar-imaging measure-costs`), so that a recording gives the same plan, and with it
the same image to the bit, on any machine.
"""

from __future__ import annotations

import contextlib
import contextvars
import dataclasses
import json
import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

# Former names in files of measured costs
_FORMER = {'lit_image': 'weighed_image', 'lit_knot': 'amplitude_node'}


@dataclasses.dataclass(frozen=True)
class CostModel:
    """Costs of the CPU backend's operations, nanoseconds of one thread.

    Of a shared AMD EPYC (Zen 4), by `tools/costs` and whole images of 96² to 1024² pixels.

    Attributes
    ----------
    line_pixel, line_segment, point_pixel : float
        Exact backprojection: along lines of a pixel and echo, and in addition of a segment and
        echo; onto points of a pixel and echo.
    upsampled_pixel, upsampled_part : float
        Azimuth upsampling: of a pixel and part, and in addition of a part.
    map_pixel : float
        Interpolation of a polar image to a map: of a pixel.
    beam_bin, beam_group, beam_cell : float
        Beams: of an echo, bin and beam; more of an echo, bin and group; of a cell's transform.
    beam_pixel, beam_segment : float
        Lines from beams: of a pixel, and in addition of a segment.
    weighed_image, amplitude_node : float
        More with illumination: of an image from beams, and of a node of its amplitudes.
    coarse_pixel, fine_pixel, subaperture : float
        Fusion: of a pixel of a sub-aperture image, of the fused image, and of a sub-aperture.
    part_coefficient, part_segment : float
        Groups of echoes: along lines of their parts, of a coefficient of a pixel's profile, and in
        addition of a segment and echo.
    summed_tap : float
        Sums of the parts of a group: of a line that a pixel is made of.
    grouped_pixel, grouped_tap, group : float
        The way of a group to the map: of a pixel, of a line that a range of a row is made of, and
        in addition of a group.
    merged_pixel, merged_tap, gathered_pixel, gathered_tap : float
        FFBP: of a pixel and part, of a neighbour along either axis; and of those looked up singly.
    profile_bin, profile_cell : float
        Range profiles: of an echo, by the samples of its spectrum and positions of its range grid.
    beam_path, beam_run, image : float
        Of an echo and beam; of an echo, group of beams and run of bins; of an image, and in
        addition of that of a sub-aperture. AFBP chooses nothing by these and the two before:
        predicted times contain them.
    """

    line_pixel: float = 0.5
    line_segment: float = 8.5
    point_pixel: float = 2.3
    upsampled_pixel: float = 0.95
    upsampled_part: float = 1e5
    map_pixel: float = 3.0
    beam_bin: float = 0.018
    beam_group: float = 0.1044
    beam_cell: float = 3.0
    beam_pixel: float = 0.65
    beam_segment: float = 90.0
    weighed_image: float = 4.5e4
    amplitude_node: float = 70.0
    coarse_pixel: float = 1.75
    fine_pixel: float = 2.0
    subaperture: float = 4.5e5
    part_coefficient: float = 0.03
    part_segment: float = 10.5
    summed_tap: float = 0.042
    grouped_pixel: float = 2.4
    grouped_tap: float = 0.2
    group: float = 1.1e5
    merged_pixel: float = 0.8
    merged_tap: float = 0.7
    gathered_pixel: float = 6.5
    gathered_tap: float = 1.1
    profile_bin: float = 8.0
    profile_cell: float = 2.5
    beam_path: float = 18.0
    beam_run: float = 25.0
    image: float = 6.5e5

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            if not (isinstance(value, int | float) and math.isfinite(value) and value > 0):
                raise ValueError(f'{name}={value!r}; expected a positive number of nanoseconds')

    def nanoseconds(self, operations: Mapping[str, Any]) -> Any:
        """Time of operations, from how often each is done; of arrays of numbers arrays."""
        return sum(getattr(self, name) * n for name, n in operations.items())

    def seconds(self, operations: Mapping[str, float]) -> float:
        """The same in seconds."""
        return 1e-9 * self.nanoseconds(operations)

    @classmethod
    def read(cls, path: Path) -> CostModel:
        """Costs from a file that `write` wrote; ValueError where it holds something else."""
        from ..files import read_text, told

        try:
            known = json.loads(read_text(path))
            if former := sorted(_FORMER.keys() & known.keys()):
                warnings.warn(f'{path}: {", ".join(former)} is now '
                              f'{", ".join(_FORMER[name] for name in former)}; the former names '
                              'go with the next release', DeprecationWarning, stacklevel=2)
            return cls(**{_FORMER.get(name, name): value for name, value in known.items()})
        except (AttributeError, OSError, TypeError, ValueError) as error:
            raise ValueError(f'{path} holds no costs ({told(error)}); write it with `sar-imaging '
                             'measure-costs`') from error

    def write(self, path: Path) -> None:
        """Write costs as JSON."""
        from ..files import replacing

        with replacing(path) as part:
            part.write_text(json.dumps(dataclasses.asdict(self), indent=2) + '\n')


DEFAULT = CostModel()
_used: contextvars.ContextVar[CostModel | None] = contextvars.ContextVar('costs', default=None)


_measured: Callable[[], CostModel] = CostModel  # until a backend tells more


def tell_costs(measured: Callable[[], CostModel]) -> None:
    """Make plans with what a function returns where no other costs are told.

    It is asked once: when costs are needed first, or first after ``using(None)``.
    """
    global _measured
    _measured = measured


def costs() -> CostModel:
    """Costs that plans are made with: those of `using`, those that a backend tells, or default."""
    model = _used.get()
    if model is None:
        model = _measured()
        _used.set(model)
    return model


@contextlib.contextmanager
def using(model: CostModel | None) -> Iterator[None]:
    """Make plans with other costs within a ``with`` block; None for those that a backend tells."""
    token = _used.set(model)
    try:
        yield
    finally:
        _used.reset(token)
