"""Second stage of AFBP while sub-aperture images arrive: fused images of every aperture."""

from __future__ import annotations

import collections
import dataclasses
from typing import TYPE_CHECKING

from ..backends import AUTO, backend as find_backend
from ..memory import IMAGE_BYTES, PUBLISHED_BYTES, check_memory
from ..planning.afbp.map_cover import covers
from ..signal.pulses.sequence import EventSource, counter_distance
from .fusing import Focus, FusedImage, Fusing, kind_of
from .subaperture_image import SubapertureImage

if TYPE_CHECKING:
    from ..backends.protocol import Backend

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
                sub, self._backend, first=current.begins_stream, turn=current.turn)
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
        return self._close_all()

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
        self._former.append(self._session)
        self._session, self._newest = None, None
        return images

    def _begin(self, sub: SubapertureImage) -> list[FusedImage]:
        """Begin an aperture and close those that it follows."""
        self._check(sub)
        before = (sub.sequence - 1) % 2**32
        overlaps = sub.n_window < sub.n_subapertures and before in self._open
        images = self._close_all(keeping=before if overlaps else None)
        # Images of the first half of a sliding aperture are of the one before.
        turn = sub.n_window // (self.images_every or 1) if overlaps else 0
        self._open[sub.sequence] = Fusing(sub, self._backend, first=not overlaps, turn=turn)
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
        turn = (number + 1) // (self.images_every or 1)
        if number != fusing.newest or number < first or turn <= fusing.turn:
            return []
        fusing.turn = turn
        return self._final(fusing)

    def _close_all(self, keeping: int | None = None) -> list[FusedImage]:
        return [image for sequence in list(self._open) if sequence != keeping
                for image in self._close(sequence)]

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
