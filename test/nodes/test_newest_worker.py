"""Slow work in a thread: in order, the newest first when it falls behind, and a clean end."""

from __future__ import annotations

import threading

from tirgeo_ros.nodes.newest_worker import NewestWorker

_WAIT_S = 30.0  # generous: it ends as soon as the work is done


def test_items_come_in_order_and_none_is_lost_while_the_work_keeps_up():
    done: list[int] = []
    came = threading.Event()
    worker = NewestWorker("test", lambda item: (done.append(item), came.set()))
    for item in range(20):
        came.clear()
        worker.put(item)
        assert came.wait(_WAIT_S)
    worker.close()
    assert done == [*range(20)]
    assert worker.replaced == 0


def test_the_newest_item_replaces_one_that_waits_and_is_counted():
    done: list[int] = []
    begun, go_on = threading.Event(), threading.Event()

    def work(item: int) -> None:
        begun.set()
        assert go_on.wait(_WAIT_S)
        done.append(item)
        if item == 3:
            finished.set()

    finished = threading.Event()
    worker = NewestWorker("test", work)
    worker.put(0)
    assert begun.wait(_WAIT_S)
    for item in (1, 2, 3):
        worker.put(item)
    go_on.set()
    assert finished.wait(_WAIT_S)
    worker.close()
    assert done == [0, 3]
    assert worker.replaced == 2


def test_close_waits_for_the_work_and_drops_what_waits():
    done: list[int] = []
    begun, go_on = threading.Event(), threading.Event()

    def work(item: int) -> None:
        begun.set()
        assert go_on.wait(_WAIT_S)
        done.append(item)

    worker = NewestWorker("test", work)
    worker.put(0)
    assert begun.wait(_WAIT_S)
    worker.put(1)
    closing = threading.Thread(target=worker.close)
    closing.start()
    assert done == []  # close has not returned early with the work undone
    go_on.set()
    closing.join(_WAIT_S)
    assert not closing.is_alive()
    worker.put(2)
    assert done in ([0], [0, 1])


def test_a_worker_that_never_worked_closes_at_once():
    worker = NewestWorker("test", print)
    worker.close()
    worker.close()
