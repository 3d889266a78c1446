"""The worker thread: order, bounded queue, failures, idleness, orderly end."""

import threading

import pytest

pytest.importorskip('rclpy', reason='the package of the nodes needs ROS')

from sar_imaging.nodes.worker import Worker

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


def test_idleness_is_told_once_after_each_burst(start_worker):
    idle = threading.Semaphore(0)
    worked = threading.Semaphore(0)
    worker = start_worker(lambda item: worked.release(), on_idle=idle.release,
                          idle_s=lambda: 0.02)
    for _ in range(2):
        worker.put(0)
        assert worked.acquire(timeout=PATIENCE_S)
        assert idle.acquire(timeout=PATIENCE_S)
    assert not idle.acquire(timeout=0.1), 'told again without new work'


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
    assert worker.clear() == [1, 2]
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
