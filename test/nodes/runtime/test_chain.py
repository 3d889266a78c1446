# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Steps in a row without nodes: what is handed on, flushed when idle, counted when dropped."""

import types

import pytest

pytest.importorskip('rclpy', reason='the package of the nodes needs ROS')

from sar_imaging.nodes.runtime import step as module
from sar_imaging.nodes.runtime.inlet import PulseBlocks, SubapertureImages
from sar_imaging.nodes.runtime.step import Chain, Step


class Keeper(Step):
    """Holds numbers until three came, then hands on their sum."""

    IDLE_PARAMETER = 'timeout_s'

    def __init__(self, name, *, timeout_s=None, inlet=PulseBlocks):
        super().__init__({'timeout_s': timeout_s}, None)
        self.NAME, self.INLET = name, inlet
        if timeout_s is None:
            self.IDLE_PARAMETER = None
        self.held, self.published, self.told = [], [], []

    def process(self, item):
        if item < 0:
            raise ValueError(f'{item} is negative')
        self.held.append(item)
        return self.flush() if len(self.held) == 3 else []

    def publish(self, product):
        self.published.append(product)

    def flush(self):
        held, self.held = self.held, []
        return [sum(held)] if held else []

    def collect(self):
        return self.flush()

    def skip(self, aperture):
        self.told.append(aperture)
        return []

    def discard(self):
        dropped, self.held = len(self.held), []
        return dropped

    def describe(self, product):
        return f'{self.NAME} {product}'


@pytest.fixture
def clock(monkeypatch):
    clock = types.SimpleNamespace(now_s=50.0)
    monkeypatch.setattr(module, 'time', types.SimpleNamespace(monotonic=lambda: clock.now_s))
    return clock


def make(*steps):
    rejected = []
    return Chain(list(steps), lambda what, error: rejected.append(str(error))), rejected


def test_products_are_published_and_handed_on():
    first, second = Keeper('first'), Keeper('second')
    row, _ = make(first, second)
    for number in range(1, 7):
        row.steps[0].work(number, 3.5)
    assert (first.published, second.held, second.published) == ([6, 15], [6, 15], [])
    assert first.received_s == second.received_s == 3.5
    assert row.form_image() == (True, 'second 21')
    assert row.form_image() == (False, 'nothing was underway')


def test_what_one_step_made_for_another_is_not_counted_twice_when_both_are_reset():
    """Sub-apertures that the fusion holds consist of pulses that backprojection had counted."""
    pulses, images = Keeper('pulses'), Keeper('images', inlet=SubapertureImages)
    row, _ = make(pulses, images)
    for number in range(5):
        row.steps[0].work(number, 0.0)
    assert (len(pulses.held), len(images.held)) == (2, 1)
    assert row.discard() == 2
    assert (pulses.held, images.held) == ([], [])
    # Steps of one kind of input hold different pulses.
    row, _ = make(Keeper('pulses'), Keeper('blocks'))
    for number in range(5):
        row.steps[0].work(number, 0.0)
    assert row.discard() == 3
    assert row.discard() == 0


def test_what_could_wait_is_handed_on_before_the_next_item():
    class Later(Keeper):
        def prepare(self):
            return self.flush()

    first, second = Later('first'), Keeper('second')
    row, _ = make(first, second)
    for number in (4, 5):
        row.steps[0].work(number, 0.0)
        assert first.held == []
    assert (first.published, second.held) == ([4, 5], [4, 5])


def test_a_refused_item_is_told_and_the_next_one_worked_on(monkeypatch):
    monkeypatch.setattr(PulseBlocks, 'describe', staticmethod(str))
    step = Keeper('step')
    row, rejected = make(step)
    for number in (1, -2, 2, 3):
        row.steps[0].work(number, 0.0)
    assert rejected == ['-2 is negative'] and step.published == [6]


def test_a_step_is_flushed_once_when_its_input_pauses(clock):
    first, second = Keeper('first', timeout_s=2.0), Keeper('second', timeout_s=5.0)
    row, _ = make(first, second)
    assert row.idle_s() is None  # nothing is underway
    row.steps[0].work(1, 0.0)
    assert row.idle_s() == 2.0
    clock.now_s += 1.5
    row.steps[0].work(2, 0.0)
    clock.now_s += 1.999
    row.idle()
    assert first.published == []
    assert row.idle_s() == pytest.approx(0.001)
    clock.now_s = 50.0 + 1.5 + 2.0  # to the moment
    assert row.idle_s() == 0.0
    row.idle()
    assert (first.published, second.published) == ([3], [])
    assert row.idle_s() == 5.0  # that of the second one, whose input came just now
    row.idle()
    assert first.published == [3]
    clock.now_s += 5.001
    row.idle()
    assert second.published == [3]
    assert row.idle_s() is None


def test_a_refused_item_is_input_too(clock, monkeypatch):
    monkeypatch.setattr(PulseBlocks, 'describe', staticmethod(str))
    row, _ = make(Keeper('step', timeout_s=2.0))
    row.steps[0].work(-1, 0.0)
    assert row.idle_s() == 2.0
    row.discard()
    assert row.idle_s() is None


def test_without_a_timeout_nothing_is_flushed(clock):
    step = Keeper('step')
    row, _ = make(step)
    row.steps[0].work(1, 0.0)
    clock.now_s += 1e9
    row.idle()
    assert row.idle_s() is None and step.held == [1]


def test_every_step_is_told_of_an_aperture_left_out_and_what_is_ready_goes_on():
    first, second = Keeper('first'), Keeper('second')
    row, _ = make(first, second)
    row.steps[0].work(7, 0.0)
    row.skip(4)
    row.skip(None)
    assert first.told == second.told == [4, None]
    row.collect()
    assert (first.published, second.published) == ([7], [7])
