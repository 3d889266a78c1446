"""Processing step of a stage without its input, shared by its node and the pipeline."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING

from rclpy.qos import QoSProfile, ReliabilityPolicy

from sar_imaging.signal.pulses.sequence import StreamEvent

from .health import Health, Part
from .inlet import Inlet, PulseBlocks
from .parameters import Parameter

if TYPE_CHECKING:
    from .managed import ManagedNode
    from .stage import Stage


class Step:
    """One stage of the processing: takes items in order, returns what became complete.

    `Stage` makes a step when it is configured and hands the items to it, in the worker's thread
    alone. What a step returns is published by its own `publish` and is the input of the next
    step, if there is one.

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
        When the latest message of the node came, on `time.monotonic`.
    """

    NAME: str
    INLET: type[Inlet] = PulseBlocks
    PARAMETERS: tuple[Parameter, ...] = ()
    COUNTERS: tuple[str, ...] = ()
    FAULTS: tuple[str, ...] = ()
    IDLE_PARAMETER: str | None = None
    FORMS_IMAGES = False
    SAVE_SERVICE = ''

    def __init__(self, parameters: Mapping[str, object], health: Health | Part):
        self.parameters = parameters
        self.health = health
        self.received_s = 0.0

    @classmethod
    def create(cls, parameters: Mapping[str, object], health: Health | Part) -> Step:
        """Step of this class, or of the subclass that the parameters ask for."""
        return cls(parameters, health)

    def create_outputs(self, node: ManagedNode) -> None:
        """Create the publishers of the step's products."""

    def activate(self, node: Stage) -> None:
        """Begin to work: publish what stands already, subscribe to what else is needed."""

    def deactivate(self, node: Stage) -> None:
        """Undo `activate`; safe when that failed halfway."""

    def process(self, item) -> list:
        """Work on an item and return the products that became complete.

        Raises
        ------
        ValueError, MemoryError, DeviceError
            The item is impossible or too large, or a device fails that was asked for; the item is
            rejected, counted and logged.
        """
        raise NotImplementedError(f'{type(self).__name__} must implement process')

    def publish(self, product) -> None:
        """Publish a product for whoever listens."""

    def prepare(self) -> list:
        """Get ready for the next item, once the products of the last one went on.

        Returns
        -------
        list
            Products that could wait until then.
        """
        return []

    def flush(self) -> list:
        """Products of what is underway: the input pauses, or somebody asks."""
        return []

    def collect(self) -> list:
        """Products that became complete otherwise than by an item; after `Stage.wake`."""
        return []

    def describe(self, product) -> str:
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

    def skip(self, aperture: int | None) -> list:
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


def stream_qos(parameters: Mapping[str, object]) -> QoSProfile:
    """Reliable, keeping the last `queue_depth` messages."""
    return QoSProfile(depth=parameters['queue_depth'], reliability=ReliabilityPolicy.RELIABLE)
