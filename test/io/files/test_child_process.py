"""A child that answers, one that dies, one that is interrupted."""

from __future__ import annotations

import os
import signal

import pytest

from tirgeo_ros.io.files.child_process import ChildEndedError, ChildProcess

_ECHO = """
import pickle, sys
from tirgeo_ros.io.files.child_process import parent_pipes
with parent_pipes() as (tasks, answers):
    while True:
        task = pickle.load(tasks)
        print("said on stdout", flush=True)
        if task == "die":
            sys.exit("the last words")
        if task == "read":
            task = sys.stdin.read()
        pickle.dump(task, answers)
        answers.flush()
"""
_TIDY = """
import os, pickle, signal, sys, time
from tirgeo_ros.io.files.child_process import parent_pipes
signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
with parent_pipes(signal.SIGTERM) as (tasks, answers):
    try:
        pickle.dump(os.getpid(), answers)
        answers.flush()
        time.sleep(600)
    finally:
        time.sleep(0.3)
        sys.stderr.write("cleaned up")
"""
LARGE = bytes(range(256)) * 40_000  # ten times what a pipe holds


@pytest.fixture
def child():
    made = ChildProcess(_ECHO)
    yield made
    made.close()


def test_objects_come_back_and_printing_is_no_answer(child):
    for thing in ({"a": 1}, LARGE, "read", None):
        child.send(thing)
        assert child.receive() == ("" if thing == "read" else thing)
    child.close()
    assert child.said.splitlines() == 4 * ["said on stdout"]


def test_one_that_dies_leaves_its_code_and_its_last_line(child):
    child.send("die")
    with pytest.raises(ChildEndedError) as ended:
        child.receive()
    assert (ended.value.code, ended.value.last) == (1, ": the last words")
    child.close()  # again


def test_one_that_cannot_begin():
    child = ChildProcess("raise SystemExit(3)")
    with pytest.raises(ChildEndedError) as ended:
        child.send(LARGE)
    assert ended.value.code == 3


def test_ctrl_c_is_the_parents(child):
    child.send(1)
    assert child.receive() == 1  # it has begun
    os.kill(child._process.pid, signal.SIGINT)
    child.send(2)
    assert child.receive() == 2


def test_killed_from_elsewhere(child):
    child.kill()
    with pytest.raises(ChildEndedError) as ended:
        child.receive()
    assert ended.value.code == -signal.SIGKILL


def test_an_answer_can_be_waited_for(child):
    assert not child.answers_within(0.0)
    child.send(7)
    assert child.answers_within(60.0)
    assert child.receive() == 7
    child.kill()
    assert child.answers_within(60.0)  # its end is one, which ``receive`` tells


@pytest.mark.parametrize(("patience_s", "said"), [(60.0, "cleaned up"), (0.0, "")])
def test_one_that_is_told_to_end_may_clean_up(patience_s, said):
    """With no patience it is killed at once: it sleeps meanwhile."""
    child = ChildProcess(_TIDY)
    child.send(None)
    assert child.receive() == child.number
    child.end(patience_s)
    assert child.said == said
    child.end(patience_s)  # again
