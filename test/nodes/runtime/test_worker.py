# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The worker thread: order, bounded queue, failures, idleness, orderly end."""

import os
import sys
import threading
import time

import pytest

pytest.importorskip('rclpy', reason='the package of the nodes needs ROS')

from sar_imaging.nodes.runtime.worker import Worker

PATIENCE_S = 30.0


@pytest.fixture
def start_worker():
    workers = []

    def start(work, **options):
        worker = Worker(work, **{'capacity': 10, 'on_error': lambda e: None} | options)
        worker.start()
        workers.append(worker)
        return worker

    yield start
    for worker in workers:
        worker.stop()


def test_items_are_worked_on_in_their_order(start_worker):
    done, finished = [], threading.Event()

    def work(item):
        done.append(item)
        if item == 9:
            finished.set()

    worker = start_worker(work)
    assert all(worker.put(i) for i in range(10))
    assert finished.wait(PATIENCE_S)
    assert done == list(range(10))


def test_a_full_queue_refuses_items(start_worker):
    begun, go_on = threading.Event(), threading.Event()

    def work(item):
        begun.set()
        go_on.wait(PATIENCE_S)

    worker = start_worker(work, capacity=2)
    worker.put('in work')
    assert begun.wait(PATIENCE_S)
    assert [worker.put(i) for i in range(3)] == [True, True, False]
    assert worker.waiting == 2
    go_on.set()


def test_a_failure_is_reported_and_the_thread_lives_on(start_worker):
    errors, finished = [], threading.Event()

    def work(item):
        if item == 'bad':
            raise KeyError(item)
        finished.set()

    worker = start_worker(work, on_error=errors.append)
    worker.put('bad')
    worker.put('good')
    assert finished.wait(PATIENCE_S)
    assert [type(e) for e in errors] == [KeyError]


def test_idleness_is_told_when_it_is_due(start_worker):
    idle, due = threading.Semaphore(0), []

    def on_idle():
        due.clear()
        idle.release()

    worker = start_worker(lambda item: due.append(time.monotonic() + 0.02), on_idle=on_idle,
                          idle_s=lambda: max(0.0, due[0] - time.monotonic()) if due else None)
    for _ in range(2):
        worker.put('something to be idle about')
        assert idle.acquire(timeout=PATIENCE_S)
    assert not idle.acquire(timeout=0.1), 'told again without new work'


def test_waiting_items_take_no_more_than_their_memory(start_worker):
    begun, go_on = threading.Event(), threading.Event()

    def work(item):
        begun.set()
        go_on.wait(PATIENCE_S)

    worker = start_worker(work, max_bytes=100)
    worker.put('in work', 1000)
    assert begun.wait(PATIENCE_S)
    assert [worker.put('waits', n) for n in (1000, 1)] == [True, False]  # alone: any size
    assert worker.fill == 1.0
    assert worker.clear() == ['waits']
    assert [worker.put('waits', n) for n in (50, 50, 1)] == [True, True, False]
    assert (worker.waiting, worker.fill) == (2, 1.0)
    go_on.set()


def test_stopping_finishes_the_item_in_work_and_discards_the_others():
    begun, go_on, done = threading.Event(), threading.Event(), []

    def work(item):
        begun.set()
        go_on.wait(PATIENCE_S)
        done.append(item)

    worker = Worker(work, capacity=10, on_error=lambda e: None)
    worker.start()
    for i in range(5):
        worker.put(i)
    assert begun.wait(PATIENCE_S)
    threading.Timer(0.05, go_on.set).start()
    worker.stop()
    assert done == [0]


def test_a_worker_that_never_started_can_be_stopped():
    Worker(print, capacity=1, on_error=print).stop()


def test_a_call_comes_after_what_waits_and_returns_its_result(start_worker):
    begun, go_on, done = threading.Event(), threading.Event(), []

    def work(item):
        begun.set()
        go_on.wait(PATIENCE_S)
        done.append(item)

    worker = start_worker(work, capacity=2)
    worker.put(0)
    assert begun.wait(PATIENCE_S)
    worker.put(1)
    call, failing = worker.call(done.copy), worker.call(lambda: done[100])
    go_on.set()
    assert call.result(PATIENCE_S) == [0, 1]
    assert isinstance(failing.exception(PATIENCE_S), IndexError)


def test_what_is_cleared_is_returned_and_calls_stay(start_worker):
    begun, go_on, done = threading.Event(), threading.Event(), []

    def work(item):
        begun.set()
        go_on.wait(PATIENCE_S)
        done.append(item)

    worker = start_worker(work)
    worker.put(0)
    assert begun.wait(PATIENCE_S)
    worker.put(1)
    call = worker.call(done.copy)
    worker.put(2)
    worker.put(3)
    assert worker.clear(lambda item: item == 2) == [2]
    assert worker.clear() == [1, 3]
    assert worker.waiting == 0
    go_on.set()
    assert call.result(PATIENCE_S) == [0]


def test_stopping_cancels_calls_that_wait_and_those_to_come():
    begun, go_on = threading.Event(), threading.Event()

    def work(item):
        begun.set()
        go_on.wait(PATIENCE_S)

    worker = Worker(work, capacity=10, on_error=lambda e: None)
    worker.start()
    worker.put(0)
    assert begun.wait(PATIENCE_S)
    worker.put(1)
    call = worker.call(list)
    threading.Timer(0.05, go_on.set).start()
    assert worker.stop() == [1]
    assert call.cancelled()
    assert worker.call(list).cancelled()


def test_a_stop_without_patience_leaves_the_item_in_work(start_worker):
    begun, go_on = threading.Event(), threading.Event()

    def work(item):
        begun.set()
        go_on.wait(PATIENCE_S)

    worker = start_worker(work)
    worker.put('in work')
    assert begun.wait(PATIENCE_S)
    worker.put('waits')
    assert worker.stop(0.01) == ['waits'] and worker.working
    go_on.set()
    worker.stop()
    assert not worker.working


@pytest.mark.skipif(sys.platform != 'linux', reason='threads have priorities on Linux alone')
def test_a_worker_in_the_background_has_a_low_priority(start_worker):
    def priority():
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    before = start_worker(print).call(priority).result(PATIENCE_S)
    worker = start_worker(print, background=True)
    assert worker.call(priority).result(PATIENCE_S) == max(before, 10)
