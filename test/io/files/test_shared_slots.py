"""Arrays in memory that two processes share."""

from __future__ import annotations

import numpy as np
import pytest

from tirgeo_ros.io.files.child_process import ChildProcess
from tirgeo_ros.tools.replay.picture_stage import SharedSlots

_SUMS = """
import pickle
from tirgeo_ros.io.files.child_process import parent_pipes
from tirgeo_ros.tools.replay.picture_stage import SharedSlots
with parent_pipes() as (tasks, answers):
    slots = SharedSlots(*pickle.load(tasks))
    while True:
        array = slots.get(pickle.load(tasks))
        pickle.dump((array.shape, array.dtype.str, array.astype(int).sum()), answers)
        answers.flush()
"""


@pytest.fixture
def slots():
    made = SharedSlots(3)
    yield made
    made.close()


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(5, 7), (4, 3, 3)])
def test_a_child_sees_what_was_put(slots, shape, dtype):
    rng = np.random.default_rng(7)
    arrays = [rng.integers(0, 255, shape).astype(dtype)[:, ::-1] for _ in range(5)]
    child = ChildProcess(_SUMS, [slots.descriptor])
    child.send((slots.number, slots.descriptor))
    for array in arrays:  # two more than there are slots
        child.send(slots.put(array))
        assert child.receive() == (array.shape, array.dtype.str, array.astype(int).sum())
    child.close()


def test_the_newest_stay_and_the_oldest_goes(slots):
    places = [slots.put(np.full((2, 2), number)) for number in range(4)]
    assert [int(slots.get(place)[0, 0]) for place in places] == [3, 1, 2, 3]


def test_what_is_too_large_has_no_place(slots):
    assert slots.put(np.broadcast_to(np.uint8(1), (1 << 13, 1 << 13))) is None
