# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Second stage of AFBP while sub-aperture images arrive: fused images of every aperture."""

from __future__ import annotations

import collections
import dataclasses
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ..backends import AUTO, backend as find_backend
from ..device_arrays import to_host
from ..geometry.grids import MapGrid
from ..geometry.half_paths import half_paths
from ..memory import IMAGE_BYTES, PUBLISHED_BYTES, check_memory
from ..planning.afbp.polar_grids import UnifiedPolarGrids, covers
from ..signal.pulses.sequence import EventSource, counter_distance
from .subaperture_image import SubapertureImage

if TYPE_CHECKING:
    from ..backends.protocol import Backend

Focus = Callable[[np.ndarray, UnifiedPolarGrids, tuple[float, float]], tuple[np.ndarray, object]]


@dataclasses.dataclass(frozen=True)
class FusedImage:
    """Image of one aperture, or of a part of it.

    Parameters
    ----------
    image, grid, aperture, predicted_error_db, carrier_hz :
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
    carrier_hz: float
    focus: object | None = None


@dataclasses.dataclass(frozen=True)
class Header:
    """What is remembered of a sub-aperture once it is fused; `slopes_m` of sliding ones."""

    first_counter: int
    n_pulses: int
    n_missing: int
    stamp_ns: int
    centre_m: float
    slopes_m: tuple[float, float]
    error: float
    power: float

    @property
    def length(self) -> int:
        """Pulses of the sub-aperture, whether they came or not."""
        return self.n_pulses + self.n_missing


class Fusing:
    """An aperture being fused."""

    def __init__(self, example: SubapertureImage, backend: Backend, *, first: bool, period: int):
        self.kind, self.revision = kind_of(example), example.revision
        (fusion, self.grid, self.n_subapertures, self.n_window, self._length) = self.kind
        self.sliding = self.n_window < self.n_subapertures
        self._weighted = _is_weighted(example)
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
        self.period = period  # of `images_every` sub-apertures, the latest that was imaged

    def add(self, sub: SubapertureImage) -> None:
        """Add a sub-aperture, and take out those that its window has left behind."""
        takes_device_arrays = getattr(self._backend, 'DEVICE_ARRAYS', False)
        self.fusion.add(sub.number, sub.image if takes_device_arrays else to_host(sub.image),
                        sub.centre_m)
        self.headers[sub.number] = Header(sub.first_counter, sub.n_pulses, sub.n_missing,
                                           sub.stamp_ns, sub.centre_m,
                                           _slopes_m(sub) if self.sliding else (0.0, 0.0),
                                           10 ** (sub.predicted_error_db / 10), _power(sub))
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
        # The grid of a sliding aperture is as fine as one of its windows needs.
        low, high = zip(*(h.slopes_m for h in headers), strict=True)
        centre_m = 0.5 * (min(low) + max(high))
        polar = (self.fusion.take_polar_image() if final and not self.sliding
                 else self.fusion.polar_image(centre_m))
        self.imaged, told = True, None
        if focus is not None and not self.sliding:
            polar = to_host(polar)
            focused, told = focus(polar[0] + 1j * polar[1], self.fusion.grid, self._ends_m())
            polar = np.stack([focused.real, focused.imag])
        error = self._error()
        image = self._backend.form_map(polar, self.fusion.grid, self.grid, centre_m)
        return FusedImage(to_host(image), self.grid, self.stamp_ns(final=final), self.aperture,
                          n_pulses, n_missing, len(self.headers), final,
                          None if math.isnan(error) else 10 * math.log10(error),
                          self.fusion.grid.carrier_hz, told)

    def _error(self) -> float:
        """Predicted mean squared error of the image, relative to its power.

        The newest sub-aperture alone knows how this window is read. With an antenna's pattern its
        error is relative to its own power, which may be little.
        """
        headers = self.headers.values()
        powers = [h.power for h in headers]
        error = float(np.average([h.error for h in headers],
                                 weights=powers if any(powers) else None))
        if self.sliding and not self._weighted:
            error = max(error, self.headers[max(self.headers)].error)
        return error

    def _ends_m(self) -> tuple[float, float]:
        """Ends of the aperture along its track, metres from the middle."""
        first, last = (self.headers[n] for n in self._ends())
        pulses = last.first_counter - first.first_counter + (last.length - first.length) / 2
        step = (last.centre_m - first.centre_m) / max(pulses, 1.0)
        ends = first.centre_m - step * first.length / 2, last.centre_m + step * last.length / 2
        return min(ends), max(ends)


def _slopes_m(sub: SubapertureImage) -> tuple[float, float]:
    """Least and largest derivative of its half paths by direction over the map, metres.

    Where range grows along the lines of the polar grid as it does from the antenna that is the
    middle of its band; over a wide aperture it grows less.
    """
    if sub.ends is None:
        return sub.centre_m, sub.centre_m
    polar, grid = sub.fusion.polar, sub.map_grid
    place = polar.from_map(*(v.ravel() for v in np.meshgrid(
        *(v[[0, len(v) // 2, -1]] for v in (grid.x_m, grid.y_m)))))
    slope = half_paths(np.array(sub.ends.tx_m), np.array(sub.ends.rx_m), polar.lines(*place)[0],
                       polar.by_direction(*place))[1]
    return float(slope.min()), float(slope.max())


def _power(sub: SubapertureImage) -> float:
    """Its part in the power of the fused image, in one unit for all of an aperture.

    Antennas light one sub-aperture more than another; else each pulse has the same part.
    """
    return float((abs(sub.image) ** 2).mean()) if _is_weighted(sub) else float(sub.n_pulses)


def _is_weighted(sub: SubapertureImage) -> bool:
    """Whether an antenna's pattern weighted its pulses."""
    return sub.ends is not None and sub.ends.weighted


def kind_of(sub: SubapertureImage) -> tuple[Any, ...]:
    """What all sub-apertures of an aperture agree in."""
    return (sub.fusion, sub.map_grid, sub.n_subapertures, sub.n_window,
            sub.pulses_per_aperture)


_SESSIONS = 16  # former senders that are remembered


@dataclasses.dataclass
class FusionStatistics:
    """Counts of what `LiveFusion` did; sub-apertures unless the name says otherwise."""

    fused: int = 0
    duplicate: int = 0
    late: int = 0
    refused: int = 0
    revisions: int = 0
    restarts: int = 0
    images: int = 0
    apertures_dropped: int = 0


class LiveFusion(EventSource):
    """Fuse sub-aperture images while they arrive, and return images of their apertures.

    The images say themselves which aperture they belong to, on which grid they are, on which map
    the result is wanted, and whether the aperture slides. They may come in any order. An image is
    formed

    - after every `images_every` sub-apertures, of those that came so far;
    - when an aperture is closed: all of it came, one of a later aperture came, or by `flush`;
    - of a sliding aperture, with every `images_every`-th sub-aperture once it has its length.

    Sub-apertures that come twice, late, or of a revision that was replaced are counted and
    dropped. Memory is bounded: one fused spectrum, for sliding apertures two with the
    contributions of one aperture each, some six times that.

    Parameters
    ----------
    images_every : int
        Sub-apertures from image to image; 0 for final images only, or for every one of a sliding
        aperture. May be changed at any time through the attribute of this name.
    min_pulse_fraction : float
        Share of its pulses, 0 to 1, that an aperture must have for a final image; an attribute,
        too.
    max_image_pixels : int
        Maps with more are refused.
    backend : str or Backend
        As for `plan_image`. Spectra and fused images stay on the device until the map is formed.

    Attributes
    ----------
    focus : callable or None
        Called with the fused polar image, at range baseband, of every final image of an aperture
        that does not slide, its `UnifiedPolarGrids`, and the ends of the aperture in metres along
        the track; returns the polar image to use, and what to tell in `FusedImage.focus`.

    Raises
    ------
    ValueError
        A number is out of range.

    Examples
    --------
    >>> from sar_imaging.simulation import SCENARIOS
    >>> from sar_imaging.streaming.fusion import LiveFusion
    >>> from sar_imaging.streaming.subapertures import LiveSubapertures
    >>> scenario, fusion = SCENARIOS['psf'](), LiveFusion()
    >>> live = LiveSubapertures(scenario.grid, pulses_per_aperture=scenario.n_pulses)
    >>> for block in scenario.blocks():  # as they arrive
    ...     for image in (i for part in live.add(block) for i in fusion.add(part)):
    ...         print(f'peak {abs(image.image).max():.0f}')
    peak 1000
    """

    def __init__(self, *, images_every: int = 0, min_pulse_fraction: float = 0.5,
                 max_image_pixels: int = 2**25, backend: str | Backend = AUTO):
        if images_every < 0:
            raise ValueError(f'images_every={images_every}; expected 0 or more')
        if not 0.0 <= min_pulse_fraction <= 1.0:
            raise ValueError(f'min_pulse_fraction={min_pulse_fraction}; expected 0 to 1')
        super().__init__()
        self.images_every = images_every
        self.min_pulse_fraction = min_pulse_fraction
        self.statistics = FusionStatistics()
        self.focus: Focus | None = None
        self._max_image_pixels, self._backend = max_image_pixels, find_backend(backend)
        self._session: int | None = None
        self._former: collections.deque[int] = collections.deque(maxlen=_SESSIONS)
        self._open: dict[int, Fusing] = {}  # by sequence
        self._newest: int | None = None  # sequence

    def add(self, sub: SubapertureImage) -> list[FusedImage]:
        """Add a sub-aperture image and return the images that this made possible.

        Raises
        ------
        ValueError
            The map is too large or not within the polar grid, or the sub-aperture contradicts
            others of its aperture; it is not used.
        MemoryError
            The fused spectrum, and the map with its message, exceed the memory that is available.
        """
        if sub.session in self._former:
            return self._drop_late(sub)
        if self._session is not None and sub.session != self._session:
            return self._begin_session(sub) + self.add(sub)
        current = self._open.get(sub.sequence)
        if current is not None and sub.revision > current.revision:
            self._check(sub)
            # Windows that were imaged are not imaged again.
            self._open[sub.sequence] = Fusing(
                sub, self._backend, first=current.begins_stream, period=current.period)
            self.statistics.revisions += 1
            self._report('plan', f'aperture {sub.aperture} is fused anew: its track had been '
                         'foreseen too poorly')
            return self._fuse(sub)
        if current is None:
            if self._newest is not None and counter_distance(sub.sequence, self._newest) <= 0:
                return self._drop_late(sub)
            return self._begin(sub) + self._fuse(sub)
        if sub.revision < current.revision or sub.number <= current.newest - current.n_window:
            return self._drop_late(sub)
        if sub.number in current.headers:
            self.statistics.duplicate += 1
            return []
        if kind_of(sub) != current.kind:
            self.statistics.refused += 1
            raise ValueError(f'sub-aperture {sub.number} of aperture {sub.aperture} has another '
                             'grid, map, length or number of sub-apertures than those before of '
                             'the same revision; the message is corrupt or two senders share a '
                             'session')
        return self._fuse(sub)

    def is_open(self, sub: SubapertureImage) -> bool:
        """Whether the aperture of a sub-aperture is being fused."""
        return sub.sequence in self._open

    @property
    def filling(self) -> int | None:
        """Number of the newest aperture being fused, None when there is none."""
        return self._open[self._newest].aperture if self._newest in self._open else None

    def flush(self) -> list[FusedImage]:
        """Close what is being fused; nothing more is expected for now."""
        return [image for sequence in list(self._open) for image in self._close(sequence)]

    def reset(self) -> int:
        """Forget what is being fused and its sender; returns the sub-apertures so dropped."""
        dropped = sum(len(f.headers) for f in self._open.values())
        self._open, self._session, self._newest = {}, None, None
        self._former.clear()
        return dropped

    def _begin_session(self, sub: SubapertureImage) -> list[FusedImage]:
        images = self.flush()
        self.statistics.restarts += 1
        self._report('restart', 'sub-apertures come from another sender or it was started again; '
                     'a new aperture begins')
        if self._session is not None:
            self._former.append(self._session)
        self._session, self._newest = None, None
        return images

    def _begin(self, sub: SubapertureImage) -> list[FusedImage]:
        """Begin an aperture and close those that it follows."""
        self._check(sub)
        before = (sub.sequence - 1) % 2**32
        overlaps = sub.n_window < sub.n_subapertures and before in self._open
        images = [image for sequence in list(self._open) if not overlaps or sequence != before
                  for image in self._close(sequence)]
        # Images of the first half of a sliding aperture are of the one before.
        period = sub.n_window // (self.images_every or 1) if overlaps else 0
        self._open[sub.sequence] = Fusing(sub, self._backend, first=not overlaps, period=period)
        self._session, self._newest = sub.session, sub.sequence
        return images

    def _check(self, sub: SubapertureImage) -> None:
        """Refuse what cannot be imaged before anything is changed."""
        grid = sub.map_grid
        try:
            if grid.n_x * grid.n_y > self._max_image_pixels:
                raise ValueError(f'the map has {grid.n_x} x {grid.n_y} pixels; expected at most '
                                 f'max_image_pixels={self._max_image_pixels}')
            if not covers(sub.fusion.polar, grid):
                raise ValueError('the polar grid of the sub-aperture does not cover its map; the '
                                 'message is corrupt')
            copies = 8 if sub.n_window < sub.n_subapertures else 3
            n_pixels = sub.fusion.n_fine * sub.fusion.n_fine_range
            check_memory(copies * IMAGE_BYTES * n_pixels
                         + PUBLISHED_BYTES * grid.n_x * grid.n_y,
                         'fusing an aperture', 'choose a smaller map')
        except (ValueError, MemoryError):
            self.statistics.refused += 1
            raise

    def _fuse(self, sub: SubapertureImage) -> list[FusedImage]:
        fusing = self._open[sub.sequence]
        fusing.add(sub)
        self.statistics.fused += 1
        if fusing.sliding:
            return self._slide(fusing, sub.number)
        if fusing.complete:
            return self._close(sub.sequence)
        every = self.images_every
        if every and len(fusing.headers) % every == 0:
            self.statistics.images += 1
            return [fusing.image(final=False)]
        return []

    def _slide(self, fusing: Fusing, number: int) -> list[FusedImage]:
        """Image of the window, where it belongs to this aperture and not to the one before."""
        first = fusing.n_window - (1 if fusing.begins_stream else 0)
        period = (number + 1) // (self.images_every or 1)
        if number != fusing.newest or number < first or period <= fusing.period:
            return []
        fusing.period = period
        return self._final(fusing)

    def _close(self, sequence: int) -> list[FusedImage]:
        fusing = self._open.pop(sequence)
        # Windows of a sliding aperture were imaged as they came, but a first one that is short.
        if fusing.sliding and (fusing.imaged or not fusing.begins_stream
                               or fusing.newest >= fusing.n_window):
            return []
        return self._final(fusing)

    def _final(self, fusing: Fusing) -> list[FusedImage]:
        n_pulses, n_missing = fusing.counts(final=True)
        if n_pulses < self.min_pulse_fraction * (n_pulses + n_missing):
            self.statistics.apertures_dropped += 1
            self._report('aperture', f'aperture {fusing.aperture} dropped: {n_pulses} of '
                         f'{n_pulses + n_missing} pulses, fewer than '
                         f'min_pulse_fraction={self.min_pulse_fraction:g}')
            return []
        self.statistics.images += 1
        return [fusing.image(final=True, focus=self.focus)]

    def _drop_late(self, sub: SubapertureImage) -> list[FusedImage]:
        self.statistics.late += 1
        self._report('late', f'dropped sub-aperture {sub.number} of aperture {sub.aperture}: '
                     'closed before, or planned anew since')
        return []
