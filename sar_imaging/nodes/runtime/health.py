# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Counters, causes, log lines and diagnostics of a node."""

from __future__ import annotations

import enum
import math
import os
import re
import threading
import time
from collections.abc import Iterable, Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
RECENT_S = 10.0  # a fault colours the diagnostics for this long
SEVERE_AFTER_S = 5.0  # a severe cause that lasts longer is an error
LINES_PER_PERIOD = 20  # log lines between two diagnostics messages; the rest is counted
MEMORY = 'memory_megabytes'
ERRORS = 'errors'  # counter of what should never happen
REJECTION, CHANGE = 'last_rejection', 'last_change'
_EXPLAINED = {'blocks_rejected': REJECTION, 'images_rejected': REJECTION,
              'configuration_changes': CHANGE}  # faults by texts


class Cause(enum.Enum):
    """Why a node does not work as it should, what weighs most first.

    The value tells what the log says once it ends, and whether somebody has to remove it
    (severe: an error after `SEVERE_AFTER_S`, until then a warning) or it may pass by itself.
    """

    OTHER_TYPE = 'the type of the input is right', True
    INCOMPATIBLE_QOS = 'quality of service of the input is right', True
    NO_PUBLISHER = 'the input has a publisher', True
    TWO_PUBLISHERS = 'the input comes from one publisher', True
    POSES_IN_OTHER_FRAME = 'the frame of the poses is right', True
    NO_POSES = 'poses go on', True
    NO_MAP = 'the reference map is there', True
    IMAGES_IN_OTHER_FRAME = 'the frame of the images is right', True
    CLOCKS_APART = 'the clocks of poses and pulses agree', True
    COMPILING = 'kernels are compiled', False
    PLANNING = 'the aperture is planned', False
    STALLED = 'input continues', True
    BEHIND = 'the work keeps up with the input again', False
    NO_SUBSCRIBER = 'the output has a subscriber', False

    def __init__(self, ended: str, severe: bool):
        self.ended, self.severe = ended, severe


class Tally:
    """Counters of a stage and what they mean for its diagnostics; for any thread.

    Parameters
    ----------
    name : str
        Name of the stage, after the node's in the name of the status.
    counters : iterable of str
        Keys that are published from the start, as zeros.
    faults : iterable of str
        Those whose increase means a warning; that of `ERRORS` means an error.
    """

    def __init__(self, name: str, *, counters: Iterable[str], faults: Iterable[str]):
        self.name = name
        self._lock = threading.Lock()
        self._values: dict[str, int | float] = dict.fromkeys(counters, 0)
        self._texts: dict[str, str] = {}
        self._faults = tuple(faults)
        self._seen: dict[str, int | float] = {}  # faults and errors when last judged
        self._risen: dict[str, tuple[float, int | float]] = {}  # when last, by how much of late
        self._causes: dict[Cause, tuple[str, float]] = {}  # text, and since when

    def clear(self) -> None:
        """Count from zero again, and forget the faults so far."""
        with self._lock:
            self._values = dict.fromkeys(self._values, 0)
            self._seen.clear()
            self._risen.clear()
            self._texts.clear()
            self._causes.clear()

    def forget_causes(self) -> None:
        """End all causes without a word, as when the work ends."""
        with self._lock:
            self._causes.clear()

    def cause(self, which: Cause, text: str, log: str = '') -> bool:
        """State a cause, or that it has ended; the log tells when it begins, changes and ends.

        Parameters
        ----------
        which : Cause
            What kind.
        text : str
            For the diagnostics; empty when there is no such cause any more.
        log : str
            For the log, if it differs from `text`.

        Returns
        -------
        bool
            Whether it has begun.
        """
        with self._lock:
            before, since = self._causes.pop(which, ('', time.monotonic()))
            if text:
                self._causes[which] = text, since
        if text and _wording(text) != _wording(before):
            self.warning(log or text)
        elif before and not text:
            self.info(which.ended)
        return bool(text and not before)

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

    def causes_of(self, kinds: Iterable[Cause], found: tuple[Cause, str, str] | None) -> None:
        """State that of some causes one lasts, or none: cause, text, and text for the log."""
        for which in kinds:
            self.cause(which, *(found[1:] if found and found[0] is which else ('',)))

    def get(self, key: str) -> int | float:
        """Value of a counter, 0 where there is none of this name."""
        with self._lock:
            return self._values.get(key, 0)

    def status(self, state: str, causes: Mapping[Cause, tuple[str, float]] | None = None
               ) -> DiagnosticStatus:
        """Counters and their judgement; see `Health.publish`.

        Parameters
        ----------
        state : str
            What the stage does when nothing is wrong.
        causes : mapping, optional
            Those of others that concern this stage, too.
        """
        with self._lock:
            level, message = self._judge(state, {**(causes or {}), **self._causes})
            values = [KeyValue(key=k, value=_format(v)) for k, v in self._values.items()]
            values += [KeyValue(key=k, value=v) for k, v in self._texts.items() if v]
        return DiagnosticStatus(level=level, name=self.name, message=message, values=values)

    @property
    def causes(self) -> dict[Cause, tuple[str, float]]:
        """Text of each cause that lasts, and since when on `time.monotonic`."""
        with self._lock:
            return dict(self._causes)

    def _judge(self, state: str, causes: Mapping[Cause, tuple[str, float]]) -> tuple[bytes, str]:
        now = time.monotonic()
        for key in (*self._faults, ERRORS):
            value = self._values.get(key, 0)
            rise, self._seen[key] = value - self._seen.get(key, 0), value
            since, amount = self._risen.get(key, (-math.inf, 0))
            if rise > 0:
                self._risen[key] = now, rise + (amount if now - since < RECENT_S else 0)
        recent = {key: amount for key, (t, amount) in self._risen.items() if now - t < RECENT_S}
        if ERRORS in recent:
            return ERROR, 'errors while working, see the log'
        lasting = [(which, *causes[which]) for which in Cause if which in causes]
        for which, text, since in lasting:
            if which.severe and now - since > SEVERE_AFTER_S:
                return ERROR, text
        if lasting:
            return WARN, lasting[0][1]
        if recent:
            told = ', '.join(f'{amount} {key}' for key, amount in recent.items())
            why = [self._texts.get(text, '') for key, text in _EXPLAINED.items() if key in recent]
            return WARN, '; '.join(filter(None, (f'recent losses: {told}', *why)))
        return OK, state


class Health(Tally):
    """Collect what a node has to tell and publish it on /diagnostics; for any thread.

    Parameters
    ----------
    node : rclpy.node.Node
        Node to speak for.
    counters, faults : iterable of str
        See `Tally`.

    Attributes
    ----------
    parts : list of Part
        Stages of the node with a status of their own.
    """

    def __init__(self, node: Node, *, counters: Iterable[str], faults: Iterable[str]):
        self._node_name = node.get_fully_qualified_name().lstrip('/')
        super().__init__(f'{self._node_name}: stage', counters=[*counters, MEMORY],
                         faults=faults)
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
                    faults=faults)
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

    def forget_causes(self) -> None:
        """End all causes, those of the parts, too."""
        super().forget_causes()
        for part in self.parts:
            part.forget_causes()

    def publish(self, state: str = 'working') -> None:
        """Publish the diagnostics and allow new log lines; call it periodically.

        What concerns the node concerns its parts, and it names the causes of these as its own.

        Parameters
        ----------
        state : str
            What the node does when nothing is wrong.
        """
        self.set(MEMORY, resident_megabytes())
        with self._lock:
            suppressed, self._suppressed, self._lines = self._suppressed, 0, 0
        if suppressed:
            self._logger.warning(f'{suppressed} more messages were not logged; see /diagnostics '
                                 'for the counts')
        of_parts = {k: v for part in self.parts for k, v in part.causes.items()}
        array = DiagnosticArray(status=[
            self.status(state, of_parts),
            *(part.status(state, self.causes) for part in self.parts)])
        array.header.stamp = self._clock.now().to_msg()
        self._publisher.publish(array)


class Part(Tally):
    """Counters of one stage of a node that has several; it logs through the node's `Health`."""

    def __init__(self, health: Health, name: str, **keys: Iterable[str]):
        super().__init__(name, **keys)
        self.info, self.warning, self.error = health.info, health.warning, health.error


class Rates:
    """Pulses and bytes per second of the input, between two calls of `take`.

    Both are called in the thread of the callbacks.
    """

    KEYS = ('input_pulses_per_s', 'input_megabytes_per_s')

    def __init__(self) -> None:
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


def _wording(text: str) -> str:
    """A text without its figures, which change while a cause lasts."""
    return re.sub(r'\d+(\.\d+)?(e[+-]?\d+)?', '', text)


def _format(value: int | float) -> str:
    # Figures always have a point or exponent, so that readers can tell them from counts.
    return str(float(f'{value:.4g}')) if isinstance(value, float) else str(value)
