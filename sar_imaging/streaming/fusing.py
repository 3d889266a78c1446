"""An aperture while its sub-aperture images are fused, and the images that come of it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..device_arrays import to_host
from ..geometry.grids import MapGrid
from ..planning.afbp.polar_grids import UnifiedPolarGrids
from .subaperture_image import SubapertureImage

if TYPE_CHECKING:
    from ..backends.protocol import Backend

Focus = Callable[[np.ndarray, UnifiedPolarGrids, tuple[float, float]], tuple[np.ndarray, object]]


@dataclasses.dataclass(frozen=True)
class FusedImage:
    """Image of one aperture, or of a part of it.

    Parameters
    ----------
    image, grid, aperture, predicted_error_db :
        As of `ApertureImage`.
    stamp_ns : int
        Time of the middle of the aperture, or of its part so far, nanoseconds since the epoch of
        the pulses' clock.
    n_pulses, n_missing, n_subapertures : int
        Pulses in the image, pulses that it lacks, and sub-apertures in it.
    final : bool
        The aperture is closed; False for an image of what came so far.
    focus : object
        What `LiveFusion.focus` has to tell; None where it was not called.
    """

    image: np.ndarray
    grid: MapGrid
    stamp_ns: int
    aperture: int
    n_pulses: int
    n_missing: int
    n_subapertures: int
    final: bool
    predicted_error_db: float | None
    focus: object | None = None


@dataclasses.dataclass(frozen=True)
class Header:
    """What is remembered of a sub-aperture once it is fused."""

    first_counter: int
    n_pulses: int
    n_missing: int
    stamp_ns: int
    centre_m: float
    error: float
    share: float

    @property
    def length(self) -> int:
        """Pulses of the sub-aperture, whether they came or not."""
        return self.n_pulses + self.n_missing


class Fusing:
    """An aperture being fused."""

    def __init__(self, example: SubapertureImage, backend: Backend, *, first: bool, turn: int):
        self.kind, self.revision = kind_of(example), example.revision
        (fusion, self.grid, self.n_subapertures, self.n_window, self._length) = self.kind
        self.sliding = self.n_window < self.n_subapertures
        self.begins_stream = first  # there is no aperture before that it overlaps with
        self._backend = backend
        self.fusion = backend.SpectrumFusion(fusion, keep=self.sliding)
        self.headers: dict[int, Header] = {}
        self._n_parts = min(self.n_window, self.n_subapertures)  # of one aperture
        before = self._n_parts - 1
        is_last = before and example.number % self._n_parts == before
        self._cut = (self._length - example.length) // before if is_last else example.length
        self.newest = -1
        self.aperture = example.aperture
        self.imaged = False  # since the latest sub-aperture came
        self.turn = turn  # of the images of a sliding aperture

    def add(self, sub: SubapertureImage) -> None:
        """Add a sub-aperture, and take out those that its window has left behind."""
        takes_device_arrays = getattr(self._backend, 'DEVICE_ARRAYS', False)
        self.fusion.add(sub.number, sub.image if takes_device_arrays else to_host(sub.image),
                        sub.centre_m)
        self.headers[sub.number] = Header(sub.first_counter, sub.n_pulses, sub.n_missing,
                                           sub.stamp_ns, sub.centre_m,
                                           10 ** (sub.predicted_error_db / 10), _share(sub))
        if sub.number > self.newest:
            self.newest, self.aperture = sub.number, sub.aperture
        self.imaged = False
        for number in [n for n in self.headers if n <= self.newest - self.n_window]:
            self.fusion.remove(number)
            del self.headers[number]

    @property
    def complete(self) -> bool:
        """Whether all sub-apertures of the aperture are in."""
        return len(self.headers) == self.n_subapertures

    def counts(self, *, final: bool) -> tuple[int, int]:
        """Pulses in the image and missing ones; in those of a closed aperture all that lack."""
        n_pulses = sum(h.n_pulses for h in self.headers.values())
        start, stop = self._extent(final=final)
        return n_pulses, max(0, stop - start - n_pulses)

    def stamp_ns(self, *, final: bool) -> int:
        """Time of the middle, from the line through the first and last sub-aperture's stamps."""
        first, last = self._ends()
        begin, end = (self._start(n) + (self.headers[n].length - 1) / 2 for n in (first, last))
        begin_ns, end_ns = self.headers[first].stamp_ns, self.headers[last].stamp_ns
        if begin == end:
            return begin_ns
        middle = (sum(self._extent(final=final)) - 1) / 2
        return begin_ns + round((end_ns - begin_ns) * ((middle - begin) / (end - begin)))

    def _ends(self) -> tuple[int, int]:
        return min(self.headers), max(self.headers)

    def _start(self, number: int) -> int:
        """First pulse of a sub-aperture, from the first one of sub-aperture 0."""
        aperture, part = divmod(number, self._n_parts)
        return aperture * self._length + part * self._cut

    def _extent(self, *, final: bool) -> tuple[int, int]:
        """First pulse of an image and the one after its last, whether they came or not."""
        first, last = self._ends()
        if final:
            first, last = (0, self.n_subapertures - 1) if not self.sliding else (
                max(0, self.newest + 1 - self.n_window), max(self.newest, self.n_window - 1))
        return self._start(first), self._start(last + 1)

    def image(self, *, final: bool, focus: Focus | None = None) -> FusedImage:
        """Image of what is in, in the memory of the host."""
        n_pulses, n_missing = self.counts(final=final)
        headers = self.headers.values()
        centres = [h.centre_m for h in headers]
        # The grid of a sliding aperture is as fine as one of its windows needs.
        centre_m = 0.5 * (min(centres) + max(centres)) if self.sliding else 0.0
        polar = (self.fusion.take_polar_image() if final and not self.sliding
                 else self.fusion.polar_image(centre_m))
        self.imaged, told = True, None
        if focus is not None and not self.sliding:
            polar = to_host(polar)
            focused, told = focus(polar[0] + 1j * polar[1], self.fusion.grid, self._ends_m())
            polar = np.stack([focused.real, focused.imag])
        shares = [h.share for h in headers]
        error = np.average([h.error for h in headers], weights=shares if any(shares) else None)
        image = self._backend.form_map(polar, self.fusion.grid, self.grid, centre_m)
        return FusedImage(to_host(image), self.grid, self.stamp_ns(final=final), self.aperture,
                          n_pulses, n_missing, len(self.headers), final,
                          None if math.isnan(error) else 10 * math.log10(error), told)

    def _ends_m(self) -> tuple[float, float]:
        """Ends of the aperture along its track, metres from the middle."""
        first, last = (self.headers[n] for n in self._ends())
        pulses = last.first_counter - first.first_counter + (last.length - first.length) / 2
        step = (last.centre_m - first.centre_m) / max(pulses, 1.0)
        ends = first.centre_m - step * first.length / 2, last.centre_m + step * last.length / 2
        return min(ends), max(ends)


def _share(sub: SubapertureImage) -> float:
    """Its part in the power of the fused image, in one unit for all of an aperture.

    Antennas light one sub-aperture more than another; else each pulse has the same part.
    """
    if sub.ends is None or not sub.ends.weighted:
        return float(sub.n_pulses)
    return float((abs(sub.image) ** 2).mean())


def kind_of(sub: SubapertureImage) -> tuple:
    """What all sub-apertures of an aperture agree in."""
    return (sub.fusion, sub.map_grid, sub.n_subapertures, sub.n_window,
            sub.pulses_per_aperture)
