"""Run steps one after the other in one thread; each gets the products of the one before."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from sar_imaging.backends import DeviceError

from .inlet import PulseBlocks
from .step import Step


class Chain:
    """Pass items through steps; all methods are called in the same thread.

    Parameters
    ----------
    steps : list of Step
        In the order of the work.
    reject : callable
        Called with an item in words and the error with which a step refused it.
    """

    def __init__(self, steps: list[Step], reject: Callable[[str, Exception], None]):
        self.steps = steps
        self._reject = reject
        self._worked_s: list[float | None] = [None] * len(steps)  # None: nothing is underway
        self._formed: list[str] | None = None  # products of a call of `form_image`, in words

    def work(self, item, received_s: float) -> None:
        """Pass an item of the input through the steps.

        Parameters
        ----------
        item
            Of the kind that the first step takes.
        received_s : float
            When it came, on `time.monotonic`.
        """
        for step in self.steps:
            step.received_s = received_s
        self._take(0, item)

    def idle_s(self) -> float | None:
        """Seconds until a step has been without input for too long; None when none waits."""
        now = time.monotonic()
        return min((max(0.0, due - now) for due in map(self._due_s, range(len(self.steps)))
                    if due is not None), default=None)

    def idle(self) -> None:
        """Flush the steps that have been without input for too long."""
        for number, step in enumerate(self.steps):
            due = self._due_s(number)
            if due is not None and due <= time.monotonic():
                self._worked_s[number] = None
                self._pass_on(number, step.flush())

    def collect(self) -> None:
        """Pass on what steps have ready without an item of the input; see `Step.collect`."""
        for number, step in enumerate(self.steps):
            self._pass_on(number, step.collect())

    def form_image(self) -> tuple[bool, str]:
        """Finish what is underway in all steps; whether that gave something, and what or why."""
        self._formed = []
        for number, step in enumerate(self.steps):
            self._pass_on(number, step.flush())
        formed, self._formed = self._formed, None
        return (True, '; '.join(formed)) if formed else (False, self.steps[-1].nothing_formed())

    def skip(self, aperture: int | None) -> None:
        """Leave out an aperture in every step; see `Step.skip`."""
        for number, step in enumerate(self.steps):
            self._pass_on(number, step.skip(aperture))

    def discard(self) -> int:
        """Forget what is underway and return its number of pulses."""
        self._worked_s = [None] * len(self.steps)
        dropped = [step.discard() for step in self.steps]
        # What a step of another input holds was made from pulses that are counted already.
        return sum(n for n, step in zip(dropped, self.steps, strict=True)
                   if step is self.steps[0] or issubclass(step.INLET, PulseBlocks))

    def _take(self, number: int, item) -> None:
        step = self.steps[number]
        try:
            products = step.process(item)
        except (ValueError, MemoryError, DeviceError) as error:
            self._reject(step.INLET.describe(item), error)
            return
        finally:
            self._worked_s[number] = time.monotonic()
        self._pass_on(number, products)
        self._pass_on(number, step.prepare())

    def _pass_on(self, number: int, products: Iterable) -> None:
        last = number == len(self.steps) - 1
        for product in products:
            self.steps[number].publish(product)
            if not last:
                self._take(number + 1, product)
            elif self._formed is not None:
                self._formed.append(self.steps[number].describe(product))

    def _due_s(self, number: int) -> float | None:
        parameter, worked_s = self.steps[number].IDLE_PARAMETER, self._worked_s[number]
        if parameter is None or worked_s is None:
            return None
        return worked_s + self.steps[number].parameters[parameter]
