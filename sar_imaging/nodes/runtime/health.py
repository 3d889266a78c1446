"""Counters, log lines and diagnostics of a node."""

from __future__ import annotations

import collections
import math
import os
import threading
import time
from collections.abc import Iterable

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

RECENT_S = 10.0  # a fault colours the diagnostics for this long
LINES_PER_PERIOD = 20  # log lines between two diagnostics messages; the rest is counted
MEMORY = 'memory_megabytes'


class Tally:
    """Counters of a stage and what they mean for its diagnostics; for any thread.

    Parameters
    ----------
    name : str
        Of the stage, after the node's in the name of the status.
    counters : iterable of str
        Keys that are published from the start, as zeros.
    faults : iterable of str
        Those whose increase means a warning.
    errors : iterable of str
        Those whose increase means an error.
    """

    def __init__(self, name: str, *, counters: Iterable[str], faults: Iterable[str],
                 errors: Iterable[str]):
        self.name = name
        self._lock = threading.Lock()
        self._values: dict[str, int | float] = dict.fromkeys(counters, 0)
        self._texts: dict[str, str] = {}
        self._watched = {DiagnosticStatus.WARN: tuple(faults),
                         DiagnosticStatus.ERROR: tuple(errors)}
        self._totals: collections.Counter = collections.Counter()
        self._last_change: dict[bytes, float] = {}

    def clear(self) -> None:
        """Count from zero again, and forget the faults so far."""
        with self._lock:
            self._values = dict.fromkeys(self._values, 0)
            self._totals.clear()
            self._last_change.clear()
            self._texts.clear()

    def tell(self, key: str, text: str) -> None:
        """Set a text that stands among the counters until another or an empty one comes."""
        with self._lock:
            self._texts[key] = text

    def count(self, key: str, increment: int = 1) -> None:
        """Increase a counter."""
        with self._lock:
            self._values[key] += increment

    def set(self, key: str, value: int | float) -> None:
        """Set a counter that is kept elsewhere, or a measured figure."""
        with self._lock:
            self._values[key] = value

    def status(self, problem: str, state: str) -> DiagnosticStatus:
        """Counters and their judgement; see `Health.publish`."""
        with self._lock:
            level, message = self._judge(problem, state)
            values = [KeyValue(key=k, value=_format(v)) for k, v in self._values.items()]
            values += [KeyValue(key=k, value=v) for k, v in self._texts.items() if v]
        return DiagnosticStatus(level=level, name=self.name, message=message, values=values)

    def _judge(self, problem: str, state: str) -> tuple[bytes, str]:
        now = time.monotonic()
        for level, keys in self._watched.items():
            total = sum(self._values[k] for k in keys)
            if total > self._totals[level]:
                self._last_change[level] = now
            self._totals[level] = total
        recent = [level for level, t in self._last_change.items() if now - t < RECENT_S]
        if DiagnosticStatus.ERROR in recent:
            return DiagnosticStatus.ERROR, 'errors while working, see the log'
        if problem:
            return DiagnosticStatus.WARN, problem
        if recent:
            return DiagnosticStatus.WARN, 'recent losses, see the counters and the log'
        return DiagnosticStatus.OK, state


class Health(Tally):
    """Collect what a node has to tell and publish it on /diagnostics; for any thread.

    Parameters
    ----------
    node : rclpy.node.Node
        Node to speak for.
    counters, faults, errors : iterable of str
        See `Tally`.

    Attributes
    ----------
    parts : list of Part
        Stages of the node with a status of their own.
    """

    def __init__(self, node: Node, *, counters: Iterable[str], faults: Iterable[str],
                 errors: Iterable[str]):
        self._node_name = node.get_fully_qualified_name().lstrip('/')
        super().__init__(f'{self._node_name}: stage', counters=[*counters, MEMORY],
                         faults=faults, errors=errors)
        self.parts: list[Part] = []
        self._logger = node.get_logger()
        self._context = node.context
        self._clock = node.get_clock()
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._lines = 0
        self._suppressed = 0

    def part(self, name: str, *, counters: Iterable[str], faults: Iterable[str]) -> Part:
        """Add a stage with counters and a status of its own."""
        part = Part(self, f'{self._node_name}: {name}', counters=[*counters, *faults],
                    faults=faults, errors=())
        self.parts.append(part)
        return part

    def clear(self) -> None:
        """Count from zero again."""
        super().clear()
        for part in self.parts:
            part.clear()

    def info(self, text: str) -> None:
        """Log what a user wants to know."""
        # rclpy ties a severity to the line of code that logs: one line for each.
        if self._may_log():
            self._logger.info(text)

    def warning(self, text: str) -> None:
        """Log a loss or a fault that the node lives with."""
        if self._may_log():
            self._logger.warning(text)

    def error(self, text: str) -> None:
        """Log what should never happen."""
        if self._may_log():
            self._logger.error(text)

    def _may_log(self) -> bool:
        if not self._context.ok():
            return False  # Ctrl-C: /rosout is gone, and rcl complains about every line
        with self._lock:
            self._lines += 1
            if self._lines > LINES_PER_PERIOD:
                self._suppressed += 1
                return False
        return True

    def publish(self, problem: str = '', state: str = 'working') -> None:
        """Publish the diagnostics and allow new log lines; call it periodically.

        Parameters
        ----------
        problem : str
            What is wrong at the moment and no counter tells, empty when nothing is.
        state : str
            What the node does when nothing is wrong.
        """
        self.set(MEMORY, resident_megabytes())
        with self._lock:
            suppressed, self._suppressed, self._lines = self._suppressed, 0, 0
        if suppressed:
            self._logger.warning(f'{suppressed} more messages were not logged; see /diagnostics '
                                 'for the counts')
        array = DiagnosticArray(status=[
            self.status(problem, state), *(part.status('', state) for part in self.parts)])
        array.header.stamp = self._clock.now().to_msg()
        self._publisher.publish(array)


class Part(Tally):
    """Counters of one stage of a node that has several; it logs through the node's `Health`."""

    def __init__(self, health: Health, name: str, *, counters: Iterable[str],
                 faults: Iterable[str], errors: Iterable[str]):
        super().__init__(name, counters=counters, faults=faults, errors=errors)
        self.info, self.warning, self.error = health.info, health.warning, health.error


class Rates:
    """Pulses and bytes per second of the input, between two calls of `take`.

    Both are called in the thread of the callbacks.
    """

    KEYS = ('input_pulses_per_s', 'input_megabytes_per_s')

    def __init__(self):
        self._since = time.monotonic()
        self._n_pulses = self._n_bytes = 0

    def add(self, n_pulses: int, n_bytes: int) -> None:
        """Count a message."""
        self._n_pulses += n_pulses
        self._n_bytes += n_bytes

    def take(self) -> dict[str, float]:
        """Rates by key since the last call."""
        now = time.monotonic()
        seconds = max(now - self._since, 1e-9)
        values = self._n_pulses / seconds, self._n_bytes / 1e6 / seconds
        self._since, self._n_pulses, self._n_bytes = now, 0, 0
        return dict(zip(self.KEYS, values, strict=True))


def resident_megabytes() -> float:
    """Memory that this process has in RAM, MB; NaN where the system does not tell."""
    try:
        with open('/proc/self/statm') as statm:
            return int(statm.read().split()[1]) * os.sysconf('SC_PAGE_SIZE') / 1e6
    except OSError:
        return math.nan


def _format(value: int | float) -> str:
    # Figures always have a point or exponent, so that readers can tell them from counts.
    return str(float(f'{value:.4g}')) if isinstance(value, float) else str(value)
