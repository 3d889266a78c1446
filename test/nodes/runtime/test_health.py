# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Counters and their judgement: how long a warning lasts, what a clean-up forgets."""

import types

import pytest

pytest.importorskip('rclpy', reason='the package of the nodes needs ROS')

from diagnostic_msgs.msg import DiagnosticStatus

from sar_imaging.nodes.runtime import health
from sar_imaging.nodes.runtime.health import Cause, Rates, Tally

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Clock:
    def __init__(self):
        self.now_s = 1000.0

    def monotonic(self):
        return self.now_s


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(health, 'time', types.SimpleNamespace(monotonic=clock.monotonic))
    return clock


@pytest.fixture
def tally():
    return Tally('stage', counters=('blocks', 'lost', 'errors'), faults=('lost',))


def judgement(tally):
    status = tally.status('working')
    return status.level, status.message


@pytest.mark.parametrize(('key', 'level', 'text'), [
    ('lost', WARN, 'recent losses'), ('errors', ERROR, 'errors while working')])
def test_a_fault_colours_the_diagnostics_for_ten_seconds(clock, tally, key, level, text):
    assert judgement(tally) == (OK, 'working')
    tally.count(key)
    clock.now_s += 5.0
    for _ in range(2):
        seen_s = clock.now_s
        assert judgement(tally)[0] == level
        clock.now_s = seen_s + 9.99
        assert judgement(tally)[0] == level and text in judgement(tally)[1]
        clock.now_s = seen_s + 10.0
        assert judgement(tally) == (OK, 'working')
        tally.count(key)  # the next one begins anew


def test_each_fault_begins_the_ten_seconds_anew(clock, tally):
    for _ in range(5):
        tally.count('lost')
        assert judgement(tally)[0] == WARN
        clock.now_s += 8.0
    assert judgement(tally)[0] == WARN
    clock.now_s += 2.0
    assert judgement(tally)[0] == OK


def test_an_error_weighs_more_than_a_cause_and_that_more_than_a_loss(clock, tally):
    lines = tally.warning, tally.info = [], []
    tally.warning, tally.info = lines[0].append, lines[1].append
    assert tally.cause(Cause.BEHIND, 'the work is late by 5 s')
    tally.count('lost', 3)
    assert judgement(tally) == (WARN, 'the work is late by 5 s')
    assert tally.cause(Cause.OTHER_TYPE, 'it carries images')
    assert not tally.cause(Cause.BEHIND, 'the work is late by 6 s')
    assert judgement(tally) == (WARN, 'it carries images')
    clock.now_s += 5.1  # somebody has to remove it: an error that lasts
    assert judgement(tally) == (ERROR, 'it carries images')
    tally.cause(Cause.OTHER_TYPE, '')
    assert judgement(tally) == (WARN, 'the work is late by 6 s')
    tally.count('errors')
    assert judgement(tally) == (ERROR, 'errors while working, see the log')
    clock.now_s += 100.0
    tally.cause(Cause.BEHIND, '')
    assert judgement(tally) == (OK, 'working')
    assert lines == (['the work is late by 5 s', 'it carries images'],
                     ['the type of the input is right',
                      'the work keeps up with the input again'])


def test_losses_are_named_with_their_numbers(clock, tally):
    tally.count('lost', 25)
    assert judgement(tally) == (WARN, 'recent losses: 25 lost')
    clock.now_s += 6.0
    tally.count('lost', 5)
    assert judgement(tally) == (WARN, 'recent losses: 30 lost')


def test_what_counts_no_fault_colours_nothing(clock, tally):
    tally.count('blocks', 5)
    tally.set('lost', 0)
    assert judgement(tally) == (OK, 'working')


def test_a_clean_up_counts_from_zero_and_sees_the_next_fault(clock, tally):
    tally.count('blocks', 7)
    tally.count('lost', 5)
    assert judgement(tally)[0] == WARN
    tally.clear()
    assert {v.key: v.value for v in tally.status('').values} == {
        'blocks': '0', 'lost': '0', 'errors': '0'}
    assert judgement(tally) == (OK, 'working')
    tally.count('lost', 5)
    assert judgement(tally)[0] == WARN
    tally.clear()
    tally.count('lost')  # fewer than before
    assert judgement(tally)[0] == WARN


def test_figures_have_a_point_and_counts_have_none(tally):
    tally.set('blocks', 3)
    tally.set('lost', 3.0)
    tally.set('errors', 12345.678)
    assert [v.value for v in tally.status('').values] == ['3', '3.0', '12350.0']


def test_rates_are_those_since_the_last_look(clock):
    rates = Rates()
    rates.add(30, 4_000_000)
    rates.add(10, 4_000_000)
    clock.now_s += 2.0
    assert list(rates.take().values()) == [20.0, 4.0]
    clock.now_s += 1.0
    assert list(rates.take().values()) == [0.0, 0.0]
    rates.add(5, 1_000_000)
    clock.now_s += 0.5
    assert list(rates.take().values()) == [10.0, 2.0]


def test_what_may_pass_by_itself_is_no_severe_cause():
    assert [cause.name for cause in Cause if not cause.severe] == [
        'COMPILING', 'PLANNING', 'BEHIND', 'NO_SUBSCRIBER']
