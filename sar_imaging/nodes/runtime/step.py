# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Processing steps of a stage without its input, shared by its node and the pipeline."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any

from rclpy.qos import QoSProfile, ReliabilityPolicy

from sar_imaging.backends import DeviceError
from sar_imaging.signal.pulses.sequence import StreamEvent

from .health import Health, Part
from .inlet import Inlet, PulseBlocks
from .parameters import ANY_TIME, Parameter

if TYPE_CHECKING:
    from sar_imaging.signal.pulses.apertures import ApertureSequence
    from sar_imaging.streaming.fusion import LiveFusion

    from .managed import ManagedNode
    from .stage import Stage

_MOST_WAIT = 10_000  # messages


class Step:
    """One stage of the processing: takes items in order, returns what became complete.

    `Stage` makes a step when it is configured and hands the items to `work` of the first one, in
    the worker's thread alone. What a step returns is published by its own `publish` and is the
    input of the next step, if there is one.

    Parameters
    ----------
    parameters : mapping
        Current values of `PARAMETERS` and of the parameters common to all nodes.
    health : Health or Part
        Counters, with `COUNTERS` and `FAULTS`, and log.

    Attributes
    ----------
    PARAMETERS : tuple of Parameter
        What the step needs to know.
    COUNTERS, FAULTS : tuple of str
        Diagnostics keys; an increase of a fault means a warning.
    IDLE_PARAMETER : str or None
        Parameter with the seconds without input after which `flush` is called, once.
    NAME : str
        Name of the step, of its own node and of its part of the diagnostics of the pipeline.
    INLET : type of Inlet
        How to read the items.
    FORMS_IMAGES : bool
        Whether the products are images; then `describe` and `nothing_formed` answer requests.
    SAVE_SERVICE : str
        Name of the service that calls `saving`; empty for none.
    received_s : float
        When the message came that the latest item was made of, on `time.monotonic`.
    """

    NAME: str
    INLET: type[Inlet] = PulseBlocks
    PARAMETERS: tuple[Parameter, ...] = ()
    COUNTERS: tuple[str, ...] = ()
    FAULTS: tuple[str, ...] = ()
    IDLE_PARAMETER: str | None = None
    FORMS_IMAGES = False
    SAVE_SERVICE = ''
    _reject: Callable[[str, Exception], None]  # by the chain

    def __init__(self, parameters: Mapping[str, Any], health: Health | Part):
        self.parameters = parameters
        self.health = health
        self.received_s = 0.0
        self._next: Step | None = None
        self._idle_since_s: float | None = None  # None: nothing is underway
        self._told: list[str] | None = None  # products of a call of `Chain.form_image`, in words

    @classmethod
    def create(cls, parameters: Mapping[str, Any], health: Health | Part) -> Step:
        """Step of this class, or of the subclass that the parameters ask for."""
        return cls(parameters, health)

    def create_outputs(self, node: ManagedNode) -> None:
        """Create the publishers of the step's products."""

    def activate(self, node: Stage) -> None:
        """Begin to work: publish what stands already, subscribe to what else is needed.

        What is not undone by the node itself goes to `ManagedNode.activity`.
        """

    def work(self, item: Any, received_s: float) -> None:
        """Process an item and hand on what became complete.

        Parameters
        ----------
        item
            Of the kind that the inlet reads.
        received_s : float
            When it came, or what it was made of, on `time.monotonic`.
        """
        self.received_s = received_s
        try:
            products = self.process(item)
        except (ValueError, MemoryError, DeviceError) as error:
            self._reject(self.INLET.describe(item), error)
            return
        finally:
            self._idle_since_s = time.monotonic()
        self.hand_on(products)
        self.hand_on(self.prepare())

    def hand_on(self, products: Iterable[Any]) -> None:
        """Publish products, each before the next step works on it."""
        for product in products:
            self.publish(product)
            if self._next is not None:
                self._next.work(product, self.received_s)
            elif self._told is not None:
                self._told.append(self.describe(product))

    @property
    def flush_due_s(self) -> float | None:
        """When the input will have paused for too long; None where nothing is underway."""
        if self.IDLE_PARAMETER is None or self._idle_since_s is None:
            return None
        return self._idle_since_s + self.parameters[self.IDLE_PARAMETER]

    def process(self, item: Any) -> list[Any]:
        """Work on an item and return the products that became complete.

        Raises
        ------
        ValueError, MemoryError, DeviceError
            The item is impossible or too large, or a device fails that was asked for; the item is
            rejected, counted and logged.
        """
        raise NotImplementedError(f'{type(self).__name__} must implement process')

    def publish(self, product: Any) -> None:
        """Publish a product for whoever listens."""

    def prepare(self) -> list[Any]:
        """Get ready for the next item, once the products of the last one went on.

        Returns
        -------
        list
            Products that could wait until then.
        """
        return []

    def flush(self) -> list[Any]:
        """Products of what is underway: the input pauses, or somebody asks."""
        return []

    def collect(self) -> list[Any]:
        """Products that became complete otherwise than by an item; after `Stage.wake`."""
        return []

    def describe(self, product: Any) -> str:
        """A product in words."""
        raise NotImplementedError(f'{type(self).__name__} must implement describe')

    def nothing_formed(self) -> str:
        """Why the latest `flush` gave nothing."""
        return 'nothing was underway'

    def saving(self) -> Callable[[], str]:
        """Function that writes the latest product to a file and says what it wrote.

        It is called in another thread, while the step goes on.

        Raises
        ------
        ValueError
            There is nothing to write, or nowhere to write it.
        """
        raise NotImplementedError(f'{type(self).__name__} must implement saving')

    def skip(self, aperture: int | None) -> list[Any]:
        """Leave out an aperture that the machine cannot keep up with, None for none any more.

        Returns
        -------
        list
            Products that the next step should have before it is told the same.
        """
        return []

    def discard(self) -> int:
        """Forget what is underway and return its number of pulses."""
        return 0

    def update_counters(self) -> None:
        """Bring the counters up to date before they are published."""

    def show(self, statistics: object, names: Mapping[str, str]) -> None:
        """Set counters to what the attributes of statistics are, whose names stand by key."""
        for key, name in names.items():
            self.health.set(key, getattr(statistics, name))

    def summary(self) -> str:
        """Settings for the log line at the start."""
        return ''

    def report(self, events: Iterable[StreamEvent]) -> None:
        """Log what the step's plain class has to tell."""
        for event in events:
            if event.kind == 'start':
                self.health.info(event.text)
            else:
                self.health.warning(event.text)


APERTURE_TIMEOUT = Parameter(
    'aperture_timeout_s', 5.0, 'An aperture is closed when no input came for this long, by the '
    'wall clock.', 's', 0.01, 3600.0, changes=ANY_TIME)
MIN_PULSE_FRACTION = Parameter(
    'min_pulse_fraction', 0.5, 'Least share of its pulses with which an aperture is used.',
    '', 0.0, 1.0, changes=ANY_TIME)


class LiveStep(Step):
    """A step around a class that works on apertures while pulses arrive, and tells of it.

    Attributes
    ----------
    live : ApertureSequence or LiveFusion
        That class.
    LIVE_PARAMETERS : tuple of str
        Parameters that are attributes of it, set before each work.
    STATISTICS : mapping
        Names of its statistics by the counters that show them.
    WORK, UNDERWAY : str
        What its work is, in names of counters; what happens to an aperture meanwhile.
    """

    FORMS_IMAGES = True
    LIVE_PARAMETERS: tuple[str, ...] = ('min_pulse_fraction',)
    STATISTICS: Mapping[str, str]
    WORK, UNDERWAY = 'image', 'filled'
    live: ApertureSequence | LiveFusion

    def __init__(self, parameters: Mapping[str, Any], health: Health | Part):
        super().__init__(parameters, health)
        self._seconds = 0.0  # of work since the last product
        self._dropped = False  # by the latest flush

    def flush(self) -> list[Any]:
        """Close the aperture: the input pauses, or somebody asks."""
        dropped = self.live.statistics.apertures_dropped
        products = self.follow(self.live.flush)
        self._dropped = self.live.statistics.apertures_dropped > dropped
        return products

    def nothing_formed(self) -> str:
        """Why the latest `flush` gave nothing."""
        if not self._dropped:
            return f'no aperture is being {self.UNDERWAY}'
        if not self.LIVE_PARAMETERS:
            return 'the aperture was dropped'
        return ('the aperture has fewer pulses than min_pulse_fraction='
                f'{self.parameters["min_pulse_fraction"]:g} of it and was dropped')

    def skip(self, aperture: int | None) -> list[Any]:
        """Leave out an aperture; see `Step`."""
        if aperture is not None and self.live.filling == aperture:
            self.health.count('pulses_skipped', self.discard())
        return []

    def discard(self) -> int:
        """Forget the aperture underway; returns what `live` does."""
        dropped = self.live.reset()
        self.report(self.live.take_events())
        self._seconds = 0.0
        return dropped

    def update_counters(self) -> None:
        """Take the statistics over."""
        self.show(self.live.statistics, self.STATISTICS)

    def follow(self, work: Callable[..., list[Any]], *arguments: object) -> list[Any]:
        """Products of some work, whose time counts and whose events are logged."""
        for name in self.LIVE_PARAMETERS:
            setattr(self.live, name, self.parameters[name])
        started = time.perf_counter()
        try:
            return work(*arguments)
        finally:
            self._seconds += time.perf_counter() - started
            self.report(self.live.take_events())

    def count_work(self) -> float:
        """Seconds of work on the latest product; counted with what it is late."""
        seconds, self._seconds = self._seconds, 0.0
        self.health.set(f'last_{self.WORK}_seconds', seconds)
        self.health.set(f'{self.WORK}_latency_seconds', time.monotonic() - self.received_s)
        return seconds


class Chain:
    """The steps of a stage in their order, linked; all methods are called in the same thread.

    Parameters
    ----------
    steps : list of Step
        In the order of the work.
    reject : callable
        Called with an item in words and the error with which a step refused it.
    """

    def __init__(self, steps: list[Step], reject: Callable[[str, Exception], None]):
        self.steps = steps
        for step, following in zip(steps, [*steps[1:], None], strict=True):
            step._next, step._reject = following, reject

    def idle_s(self) -> float | None:
        """Seconds until a step has been without input for too long; None when none waits."""
        due = [step.flush_due_s for step in self.steps if step.flush_due_s is not None]
        return max(0.0, min(due) - time.monotonic()) if due else None

    def idle(self) -> None:
        """Flush the steps that have been without input for too long."""
        for step in self.steps:
            if step.flush_due_s is not None and step.flush_due_s <= time.monotonic():
                step._idle_since_s = None
                step.hand_on(step.flush())

    def collect(self) -> None:
        """Pass on what steps have ready without an item of the input; see `Step.collect`."""
        for step in self.steps:
            step.hand_on(step.collect())

    def form_image(self) -> tuple[bool, str]:
        """Finish what is underway in all steps; whether that gave something, and what or why."""
        last = self.steps[-1]
        last._told = []
        for step in self.steps:
            step.hand_on(step.flush())
        formed, last._told = last._told, None
        return (True, '; '.join(formed)) if formed else (False, last.nothing_formed())

    def skip(self, aperture: int | None) -> None:
        """Leave out an aperture in every step; see `Step.skip`."""
        for step in self.steps:
            step.hand_on(step.skip(aperture))

    def discard(self) -> int:
        """Forget what is underway and return its number of pulses."""
        n_pulses = 0
        for step in self.steps:
            step._idle_since_s = None
            dropped = step.discard()
            # What a step of another input holds was made from pulses that are counted already.
            if step is self.steps[0] or issubclass(step.INLET, PulseBlocks):
                n_pulses += dropped
        return n_pulses


def stream_qos(parameters: Mapping[str, Any]) -> QoSProfile:
    """Reliable, keeping the last `queue_depth` messages."""
    return QoSProfile(depth=parameters['queue_depth'], reliability=ReliabilityPolicy.RELIABLE)


def subaperture_qos(parameters: Mapping[str, Any]) -> QoSProfile:
    """Reliable, keeping the sub-apertures of an aperture, which come in one burst when planned.

    An aperture has no more of them than pulses. The depth takes no memory until messages wait.
    """
    depth = max(parameters['queue_depth'], min(parameters['pulses_per_aperture'], _MOST_WAIT))
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)
