# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""First stage of AFBP while the pulses arrive: sub-aperture images of every aperture."""

from __future__ import annotations

import dataclasses
import secrets
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..backends import AUTO, backend as find_backend
from ..backends.edge_brightness import EdgeBrightness
from ..device_arrays import on_device
from ..geometry.grids import MapGrid
from ..geometry.illumination import AntennaPattern, Illumination, Pointing
from ..geometry.track import mean_centres, predict_track, unit_vector
from ..planning.afbp.illumination import seen_subapertures
from ..planning.afbp.live import LivePlan, extension, plan_live
from ..signal.pulses import PulseBlock
from ..signal.pulses.apertures import AperturePulses, ApertureSequence, ApertureStatistics
from ..signal.pulses.sequence import COUNTER_MASK
from .mosaic import patch_beside
from .subaperture_image import SubapertureEnds, SubapertureImage

if TYPE_CHECKING:
    from ..backends.protocol import Backend


@dataclasses.dataclass
class LiveStatistics(ApertureStatistics):
    """Counts of `LiveSubapertures`; `images` are those of sub-apertures."""

    plans: int = 0
    plans_anew: int = 0
    plan_seconds: float = 0.0


class SubapertureStage:
    """Backprojects sub-apertures by the `LivePlan` of their aperture.

    Parameters
    ----------
    plan : LivePlan
        What is computed.
    backend : str or Backend
        As for `plan_image`.
    """

    def __init__(self, plan: LivePlan, backend: str | Backend = AUTO):
        self.plan = plan
        self._imager = find_backend(backend).SubapertureImager(plan.subapertures)

    def image(self, block: PulseBlock) -> tuple[np.ndarray, float]:
        """Backproject the range profiles of a sub-aperture.

        Returns
        -------
        image : (n_alpha, n_range) complex64
            On the coarse grid of the plan, at range baseband; on the device where a device formed
            it.
        uneven_db : float
            By how much its error exceeds the predicted one, because what lies right beyond the
            edges is brighter than the image, dB.

        Raises
        ------
        ValueError
            The block does not match the plan.
        """
        plan = self.plan.subapertures
        illumination = plan.illumination_of(block)
        if illumination and not seen_subapertures(plan.coarse, [slice(0, block.n_pulses)],
                                                  illumination, plan.n_channels):
            return np.zeros((plan.coarse.n_alpha, plan.coarse.n_range), np.complex64), 0.0
        parts = self._imager.image(0, block)
        if on_device(parts):
            image = parts[0] + np.complex64(1j) * parts[1]
        else:
            image = np.empty(parts.shape[1:], np.complex64)
            image.real, image.imag = parts
        brightness = EdgeBrightness(plan.fusion_grid, plan.sampling.coverage)
        brightness.add(parts)
        return image, brightness.uneven_db


@dataclasses.dataclass
class Target:
    """An image to be: apertures that it is made of, and the plan of their sub-apertures."""

    first: int  # aperture
    n_apertures: int
    sequence: int
    apertures: list[AperturePulses] = dataclasses.field(default_factory=list)
    stage: SubapertureStage | None = None
    revision: int = 0
    waits: bool = False  # for the whole track
    refused: bool = False

    def window(self, aperture: AperturePulses, part: slice
               ) -> tuple[np.ndarray, np.ndarray] | None:
        """Phase centres (P, C, 3) of the sliding aperture that ends with a sub-aperture, metres.

        None where apertures do not slide. The first ones of a stream are as short as they are.
        """
        if self.n_apertures == 1:
            return None
        stop = aperture.first + part.stop
        found = []
        for other in self.apertures:
            number = other.first + np.arange(len(other.seen))
            some = other.seen & (number < stop) & (number >= stop - len(aperture.seen))
            found.append((other.tx_m[some], other.rx_m[some]))
        tx_m, rx_m = map(np.concatenate, zip(*found, strict=True))
        return tx_m, rx_m


_LEAST_PULSES = 16  # from which a track is carried on, where nothing came before
_SHARE_TO_PLAN_AHEAD = 0.75  # of an aperture that must be known
_SAME_LEG = np.cos(np.deg2rad(15.0))
_MOST_REVISIONS = 3  # after which the whole track is awaited


class LiveSubapertures(ApertureSequence):
    """Backproject sub-apertures while their pulses arrive.

    See `ApertureSequence` for what an aperture is. Its sub-apertures are cut by the pulse
    counter, so that missing pulses do not move the cuts. One is imaged when its pulses are
    complete, when a pulse of a later one came, or by `flush`.

    The polar grids of an aperture are planned from the track as it is foreseen. Every
    sub-aperture is checked with its real phase centres; where the error would exceed the target,
    the aperture is planned anew from what is known by then and imaged again from the profiles
    kept, as another revision. Where that happens too often, the end of the aperture is awaited.
    An aperture that begins where the one before began, as when a radar flies its leg again, takes
    over that one's plan.

    Memory is bounded: the profiles of one aperture, two of a sliding one, and one sub-aperture.

    Parameters
    ----------
    grid : MapGrid
        Map that images are wanted on.
    pulses_per_aperture, pulses_per_subaperture : int
        Lengths, pulses; 0 for the sub-apertures that are quickest.
    target_db : float
        Wanted error of an image against time-domain correlation, dB.
    sliding : bool
        Every sub-aperture ends an image of one aperture's length. Each is imaged twice, on the
        polar grids of the two apertures before and after.
    follow_m : (float, float), optional
        The map moves along with the antenna: its middle stays this far ahead and to the left of
        the middle of the aperture, metres, on the pixels that `grid` continues to. Ahead is the
        direction of the aperture that began the leg; another leg begins where an aperture's
        differs by 15 degrees.
    illumination : AntennaPattern, optional
        As for `plan_image`; pulses then tell where the antenna looked.
    backend : str or Backend
        As for `plan_image`; images that a device forms stay there.

    Attributes
    ----------
    planning_since_s : float or None
        Since when an aperture whose pulses wait is planned, on `time.perf_counter`.

    Raises
    ------
    ValueError
        A length or the target is out of range.

    Examples
    --------
    >>> from sar_imaging import MapGrid
    >>> from sar_imaging.simulation import SCENARIOS
    >>> from sar_imaging.streaming.subapertures import LiveSubapertures
    >>> grid = MapGrid((10_000.0, 0.0, 0.0), 33, 33, 0.5)
    >>> live = LiveSubapertures(grid, pulses_per_aperture=200, pulses_per_subaperture=50)
    >>> parts = [part for block in SCENARIOS['psf']().blocks(25) for part in live.add(block)]
    >>> len(parts)
    4
    """

    def __init__(self, grid: MapGrid, *, pulses_per_aperture: int,
                 pulses_per_subaperture: int = 0, target_db: float = -60.0,
                 sliding: bool = False, follow_m: tuple[float, float] | None = None,
                 illumination: AntennaPattern | None = None,
                 backend: str | Backend = AUTO):
        if not 0 <= pulses_per_subaperture <= pulses_per_aperture:
            raise ValueError(f'pulses_per_subaperture={pulses_per_subaperture}; expected 0 (to be '
                             f'planned) to pulses_per_aperture={pulses_per_aperture}')
        if not -85.0 <= target_db <= -20.0:
            raise ValueError(f'target_db={target_db}; expected -85 to -20 dB')
        self.grid, self._follow_m, self._pattern = grid, follow_m, illumination
        self._backend = backend
        self._target_db, self._wanted_cut = target_db, pulses_per_subaperture
        self._n_apertures = 2 if sliding else 1
        self._session, self._sequence = secrets.randbits(32), 0
        self._memory: list[np.ndarray] = []
        self._targets: list[Target] = []
        # Images that can wait: target, its revision, aperture and number of the sub-aperture.
        self._waiting: list[tuple[Target, int, AperturePulses, int]] = []
        self._ahead: Target | None = None
        self._tried: int | None = None
        self.planning_since_s: float | None = None
        self.statistics: LiveStatistics
        super().__init__(pulses_per_aperture, LiveStatistics())

    def catch_up(self) -> list[SubapertureImage]:
        """Images that can wait until others were made use of; call this once they were.

        Of a sliding aperture a sub-aperture's image on the older polar grid ends a window, that
        on the newer one is needed no sooner than the next aperture. What is called next returns
        them where this was not called.
        """
        waiting, self._waiting = self._waiting, []
        images = [image for target, revision, aperture, number in waiting
                  # a plan that was made anew has imaged what came before
                  if target.revision == revision
                  for image in self._image(target, aperture, number)]
        self.statistics.images += len(images)
        return images

    def plan_ahead(self) -> None:
        """Plan the next aperture, where it can be foreseen; call this while nothing waits.

        It can from three quarters of the one before. What is planned ahead does not delay the
        images of the first sub-apertures.
        """
        before = self._open or self._previous
        if self._ahead is not None or not self._cut or before is None:
            return
        enough = np.flatnonzero(before.seen)[-1:] + 1 >= _SHARE_TO_PLAN_AHEAD * len(before.seen)
        number = before.number + 1
        if not enough.any() or number * self._length > COUNTER_MASK or number == self._tried:
            return
        self._tried = number
        if self._again and self._targets and self._targets[-1].stage is not None:
            self._ahead = self._new_target(number)
            self._ahead.stage = self._targets[-1].stage  # and so on, as far as can be told
            return
        try:
            # Another cut has to wait: the aperture being filled is cut like this to its end.
            stage = self._stage_for(Target(number, self._n_apertures, 0), self._cut, slack=1.0)
        except ValueError:
            return
        self.statistics.plans += 1
        self._ahead = self._new_target(number)
        self._ahead.stage = stage

    def _configure(self, block: PulseBlock) -> PulseBlock:
        if self._pattern is not None:
            Illumination.of_pulses(self._pattern, block.pointing, *block.centres_m)  # told
        return block.select(slice(0, 0))

    def _begin_sequence(self) -> None:
        super()._begin_sequence()
        self._cut = self._wanted_cut
        self._targets = []
        self._waiting = []
        self._ahead = None
        self._tried = None  # aperture that was to be planned ahead
        self._previous: AperturePulses | None = None
        self._memory.clear()
        self._former: Target | None = None  # the latest that ended, and its plan
        self._again = False  # the leg before was flown again
        self._flight: np.ndarray | None = None  # direction of the leg that a strip follows

    def _begin(self, number: int) -> AperturePulses:
        aperture = AperturePulses(number, self._length, self._plan, self._memory)
        follows = self._previous is not None and number == self._previous.number + 1
        self._targets = [t for t in self._targets
                         if follows and number < t.first + t.n_apertures]
        if self._ahead is not None and self._ahead.first == number:
            self._targets.append(self._ahead)
        else:
            # Numbers that follow each other are of apertures that do.
            self._targets.append(self._new_target(number, step=1 if follows else 2))
        self._ahead = None
        for target in self._targets:
            target.apertures.append(aperture)
        return aperture

    def _new_target(self, number: int, step: int = 1) -> Target:
        self._sequence = (self._sequence + step) & COUNTER_MASK
        return Target(number, self._n_apertures, self._sequence)

    def _fill(self, aperture: AperturePulses, block: PulseBlock) -> list[SubapertureImage]:
        results = self.catch_up()
        late = aperture.position(block) < aperture.next
        if late.any():
            self._count_late(block.select(late))
            block = block.select(~late)
        aperture.keep(block)
        self.statistics.imaged += block.n_pulses
        return results + self._advance(aperture, closing=False)

    def _finish(self, aperture: AperturePulses) -> list[SubapertureImage]:
        results = self._advance(aperture, closing=True) + self.catch_up()
        for target in self._targets:
            ends = aperture.number == target.first + target.n_apertures - 1
            if target.waits and ends:
                target.waits = False
                results += self._image_again(target, slack=0.0)
            if target.refused and ends:
                self.statistics.apertures_dropped += 1
            if target.stage is not None and ends:
                self._former = target
        if aperture.next < len(aperture.seen):  # the last plan has cut it anew
            results += self._advance(aperture, closing=True) + self.catch_up()
        done = aperture if self._n_apertures == 1 else self._previous
        if done is not None and done.memory is not None:
            self._memory.append(done.memory)
            done.memory = None  # its track stays
        self._previous = aperture
        return results

    def _advance(self, aperture: AperturePulses, *, closing: bool) -> list[SubapertureImage]:
        """Image the sub-apertures that became complete."""
        newest = int(np.flatnonzero(aperture.seen)[-1]) if aperture.seen.any() else -1
        if not self._cut:
            # A map that follows lies where the middle of the aperture is foreseen.
            least = len(aperture.seen) // 2 if self._follow_m else 0
            if (newest + 1 < max(least, _LEAST_PULSES) and self._previous is None
                    and not closing):
                return []
            if not (self._targets[-1].refused or self._targets[-1].waits):
                self._make_plan(self._targets[-1])  # chooses the cut, unless it refuses
        results = []
        while self._cut:  # the plan of an image may cut the aperture anew
            number = -(-aperture.next // self._cut)
            part = aperture.part(number, self._cut)
            complete = closing or newest >= part.stop or aperture.seen[part].all()
            if part.start >= part.stop or not complete:
                break
            aperture.next = part.stop
            if aperture.seen[part].any():
                results += self._image(self._targets[0], aperture, number)
                self._waiting += [(target, target.revision, aperture, number)
                                  for target in self._targets[1:]]
        self.statistics.images += len(results)
        return results

    def _image(self, target: Target, aperture: AperturePulses, number: int
               ) -> list[SubapertureImage]:
        """Image one sub-aperture, or all so far where the plan does not suit it."""
        if target.stage is None and not (target.refused or target.waits):
            self._make_plan(target)
        if target.refused or target.waits:
            return []
        images = self._form(target, [(aperture, aperture.part(number, self._cut))])
        if images is None:
            images = self._fly_again(target)
        return self._image_again(target) if images is None else images

    def _fly_again(self, target: Target) -> list[SubapertureImage] | None:
        """Images with the plan of the aperture before; None where this is not its leg."""
        former, foreseen = self._former, target.stage
        if (target.revision or former is None or former.stage in (None, foreseen)
                or former.stage.plan.length != self._cut
                or not all(one.begins_like(other, self._cut) for one, other in zip(
                    target.apertures, former.apertures, strict=False))):
            return None
        target.stage, target.revision = former.stage, 1
        if (images := self._form(target, self._closed_parts(target))) is None:
            target.stage, target.revision = foreseen, 0
            return None
        self._again = True
        self._report('plan', f'aperture {target.first} begins where aperture {former.first} began '
                     'and takes over its plan')
        return images

    def _image_again(self, target: Target, slack: float | None = None) -> list[SubapertureImage]:
        """Plan an aperture anew and image what it has so far."""
        self._again = False
        while target.revision < _MOST_REVISIONS or slack == 0.0:
            target.revision += 1
            self.statistics.plans_anew += 1
            self._make_plan(target, slack)
            if target.refused or target.waits:
                return []
            if (images := self._form(target, self._closed_parts(target))) is not None:
                return images
        self._wait(target)
        return []

    def _wait(self, target: Target) -> None:
        target.waits = True
        self._report('plan', f'the track of aperture {target.first} cannot be foreseen well '
                     f'enough for target_db={self._target_db:g}; its end is awaited')

    def _closed_parts(self, target: Target) -> list[tuple[AperturePulses, slice]]:
        """Sub-apertures that are not to grow any more."""
        parts = ((aperture, aperture.part(number, self._cut)) for aperture in target.apertures
                 for number in range(-(-aperture.next // self._cut)))
        return [(aperture, part) for aperture, part in parts if aperture.seen[part].any()]

    def _form(self, target: Target, parts: Sequence[tuple[AperturePulses, slice]]
              ) -> list[SubapertureImage] | None:
        """Images of sub-apertures; None where one does not suit the plan."""
        assert target.stage is not None  # as was planned
        found, plan = [], target.stage.plan
        for aperture, part in parts:
            block = aperture.block(part)
            band = plan.check(*block.centres_m, plan.subapertures.illumination_of(block),
                              target.window(aperture, part))
            if band is None:
                return None
            found.append((aperture, part, block, *band))
        return [self._formed(target, target.stage, *some) for some in found]

    def _formed(self, target: Target, stage: SubapertureStage, aperture: AperturePulses,
                part: slice, block: PulseBlock, centre_m: float, error_db: float,
                power_db: float) -> SubapertureImage:
        # Apertures are equally long but for the last before the counter wraps around.
        counts = [self._count_parts(target.first + i) for i in range(target.n_apertures)]
        before = sum(counts[:aperture.number - target.first])
        plan, (image, uneven_db) = stage.plan, stage.image(block)
        error_db += max(uneven_db + min(power_db, 0.0), 0.0)
        if self._pattern is not None:  # of its own brightness, which the fusion measures
            error_db = min(error_db - power_db, 0.0)
        return SubapertureImage(
            image, plan.subapertures.fusion_grid, centre_m, plan.grid, block.radar.bandwidth_hz,
            self._session, target.sequence, target.revision, aperture.number,
            before + part.start // self._cut, sum(counts), counts[0],
            aperture.first + part.start, block.n_pulses, part.stop - part.start - block.n_pulses,
            len(target.apertures[0].seen), aperture.centre_ns(part), error_db,
            SubapertureEnds.of(block, plan.subapertures.polar.track,
                               weighted=self._pattern is not None))

    def _count_parts(self, number: int) -> int:
        """Sub-apertures of an aperture."""
        n_pulses = min(self._length, COUNTER_MASK + 1 - number * self._length)
        return max(1, -(-n_pulses // self._cut))

    def _make_plan(self, target: Target, slack: float | None = None) -> None:
        """Plan an aperture from what is known, or refuse it."""
        slack = 2.0 ** target.revision if slack is None else slack
        begin = self.planning_since_s = time.perf_counter()
        try:
            try:
                target.stage = self._stage_for(target, self._cut, slack)
            except ValueError:
                if not self._cut or self._wanted_cut or self._n_apertures > 1:
                    raise
                target.stage = self._stage_for(target, 0, slack)
        except ValueError as error:
            # What was foreseen by the aperture before may not suit where the flight itself does.
            if slack and (target.revision or self._previous is not None):
                self._wait(target)
                return
            target.refused, target.stage, self._cut = True, None, self._wanted_cut
            self._report('aperture', f'aperture {target.first} cannot be imaged by sub-apertures: '
                         f'{error}; use mode image')
            return
        finally:
            self.statistics.plans += 1
            self.statistics.plan_seconds = time.perf_counter() - begin
            self.planning_since_s = None
        plan = target.stage.plan
        self._warn(target.first, plan.warnings)
        if target.revision:
            self._report('plan', f'aperture {target.first} planned anew, its track differs from '
                         f'the one foreseen: {plan}')
        if plan.length != self._cut:
            self._cut = plan.length
            for aperture in target.apertures:
                aperture.next = aperture.next // self._cut * self._cut

    def _stage_for(self, target: Target, cut: int, slack: float) -> SubapertureStage:
        apertures = {a.number: a for a in target.apertures}
        apertures |= {a.number: a for a in (self._previous, self._open)
                      if a is not None and a.number < target.first}
        known = [apertures[number] for number in sorted(apertures)]
        n_pulses = target.n_apertures * self._length
        before, after = extension(n_pulses, cut or 1, slack)
        first = target.first * self._length
        numbers = np.concatenate([a.known for a in known])
        wanted, illumination = np.arange(first - before, first + n_pulses + after), None
        tx_m, rx_m = predict_track(numbers, np.concatenate([a.tx_m[a.seen] for a in known]),
                                   np.concatenate([a.rx_m[a.seen] for a in known]), wanted)
        if self._pattern is not None:
            looks = np.concatenate([a.looks[:, a.seen] for a in known  # all of them
                                    if a.looks is not None], axis=1)[:, :, None]
            boresight, up = predict_track(numbers, looks[0], looks[1], wanted)
            pointing = Pointing(boresight[:, 0], up[:, 0])
            illumination = Illumination.of_pulses(self._pattern, pointing, tx_m, rx_m,
                                                  foreseen=True)
        return SubapertureStage(plan_live(
            self._map(tx_m, rx_m), self._plan.radar, self._plan.n_samples, tx_m, rx_m,
            target_db=self._target_db, pulses_per_subaperture=cut or None, slack=slack,
            n_window=self._length if self._n_apertures > 1 else 0, illumination=illumination),
            self._backend)

    def _map(self, tx_m: ArrayLike, rx_m: ArrayLike) -> MapGrid:
        """Map of an aperture with these phase centres."""
        if self._follow_m is None:
            return self.grid
        middles = mean_centres(tx_m, rx_m)[:, :2]
        flight = unit_vector(middles[-1] - middles[0])
        # A few degrees of weaving would swing distant patches to and fro.
        if self._flight is None or flight @ self._flight < _SAME_LEG:
            self._flight = flight
        return patch_beside(self.grid, middles.mean(axis=0), self._flight, self._follow_m)
