"""The MCAP writer against the mcap package's own."""

from __future__ import annotations

import io

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from tirgeo_ros.io.mcap_writer import McapWriter

SEED = 12
LIBRARY = "tirgeo test"


def messages(number, size):
    """Channel, log time, data and publish time, not in order of time."""
    rng = np.random.default_rng(SEED)
    times = rng.integers(1, 2**62, number).tolist()
    for time in times:
        length = int(rng.integers(0, size))
        yield int(rng.integers(1, 4)), time, rng.bytes(length), time + 5


def fill(writer, calls):
    for name in ("/a", "/b", "/c"):
        schema = writer.register_schema(f"pkg/msg/T{name[1:]}", "ros2msg", b"float64 x\n")
        assert writer.register_channel(name, "cdr", schema) == schema
    for call in calls:
        writer.add_message(*call)
    writer.finish()


def written(calls):
    stream = io.BytesIO()
    fill(McapWriter(stream, "ros2", LIBRARY), calls)
    return stream.getvalue()


# None at all, one, many in one chunk, and chunks of 1 MiB that end in the midst of the messages.
@pytest.mark.parametrize(("number", "size"), [(0, 1), (1, 1), (300, 90), (400, 20_000)])
def test_the_same_bytes_as_the_package_writes(number, size):
    calls = list(messages(number, size))
    theirs = io.BytesIO()
    writer = Writer(theirs)
    writer.start("ros2", LIBRARY)
    fill(writer, calls)
    assert written(calls) == theirs.getvalue()


def test_it_is_read_with_checksums_and_by_its_index():
    calls = list(messages(400, 20_000))
    reader = make_reader(io.BytesIO(written(calls)), validate_crcs=True)
    summary = reader.get_summary()
    assert summary.statistics.message_count == len(calls)
    assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 2
    found = [
        (message.channel_id, message.log_time, message.data, message.publish_time)
        for _, _, message in reader.iter_messages()
    ]
    assert found == sorted(calls, key=lambda call: call[1])
