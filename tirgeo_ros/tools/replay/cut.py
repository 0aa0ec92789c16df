# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Cut a part out of a recorded flight: the work of ``tirgeo cut``.

Messages are copied as they are, also those of unknown types. Messages that a late subscriber would
have received (latched topics, the calibration) are carried to the beginning of the part.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Collection, Iterator
from datetime import datetime

from tirgeo_ros.core.types.errors import BagError, MessageError
from tirgeo_ros.core.types.texts import utc
from tirgeo_ros.io.bags.bag import BagMessage, BagReader, BagWriter, Cdr, TopicForm
from tirgeo_ros.io.bags.bag_writer import is_latched
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs
from tirgeo_ros.tools.presentation.progress import Report, silent

_NS = 1_000_000_000
_CALIBRATION, _TRANSFORMS = "sensor_msgs/msg/CameraInfo", "tf2_msgs/msg/TFMessage"

#: Seconds after the flight's first message, or UTC.
Instant = float | datetime


def cut(
    bag: PathLike,
    output: PathLike,
    *,
    begin: Instant = 0.0,
    end: Instant = math.inf,
    progress: Report = silent,
) -> dict[str, object]:
    """Write the part of a bag from ``begin`` to ``end`` and return a summary.

    ``error`` in the summary is None, or tells what was lost of the bag. Raise BagError (no bag, no
    message in the part).
    """
    check_outputs([bag], [output], BagError)
    reader = BagReader(bag)
    first_ns, last_ns = reader.span_ns
    start_ns, end_ns = _log_time_ns(begin, reader), _log_time_ns(end, reader)
    if start_ns > last_ns or end_ns < max(first_ns, start_ns):
        whole = f"{(last_ns - first_ns) / _NS:.1f} s long, from {utc(first_ns)} to {utc(last_ns)}"
        raise BagError(f"{reader.path}: no message between these times: the flight is {whole}")
    start_ns = max(start_ns, first_ns)
    forms = reader.forms()
    counts: Counter[str] = Counter()
    carried = _carried(reader, forms, start_ns, end_ns)
    with BagWriter(output, forms=forms) as writer:
        for message in carried:
            writer.write(message.topic, message.typename, message.data, start_ns)
        for message in _messages(reader, None, start_ns, end_ns):
            writer.write(message.topic, message.typename, message.data, message.log_time_ns)
            counts[message.topic] += 1
            progress((message.log_time_ns - start_ns) / _NS, (end_ns - start_ns) / _NS)
        if not counts:
            raise BagError(f"{reader.path}: no message between these times")
    return {
        "input": os.fspath(bag),
        "output": os.fspath(output),
        "from_s": (start_ns - first_ns) / _NS,
        "to_s": (end_ns - first_ns) / _NS,
        "from_utc": utc(start_ns),
        "messages": dict(sorted(counts.items())),
        "carried": dict(sorted(Counter(message.topic for message in carried).items())),
        "error": f"{reader.path}: {reader.damage}" if reader.damage else None,
    }


def _log_time_ns(instant: Instant, reader: BagReader) -> int:
    if isinstance(instant, datetime):
        return round(instant.timestamp() * 1e6) * 1000
    first_ns, last_ns = reader.span_ns
    return last_ns if math.isinf(instant) else first_ns + round(instant * _NS)


def _messages(
    reader: BagReader, topics: Collection[str] | None, start_ns: int, end_ns: int
) -> Iterator[BagMessage]:
    for message in reader.messages(topics, start_ns, any_form=True):
        if message.log_time_ns > end_ns:
            return
        yield message


def _carried(
    reader: BagReader, forms: dict[str, TopicForm], start_ns: int, end_ns: int
) -> list[BagMessage]:
    """Return the messages before a part that its subscribers need, in order of time.

    These are the last message of each latched topic (of transforms, the last of each set of
    frames, because each publisher has its own set), and the last calibration if the part has none.
    """
    latched = {topic for topic, form in forms.items() if is_latched(topic, form.metadata)}
    cameras = {topic for topic, form in forms.items() if form.typename == _CALIBRATION} - latched
    part = start_ns, end_ns
    cameras = {name for name in cameras if next(_messages(reader, {name}, *part), None) is None}
    last: dict[tuple[str, object], BagMessage] = {}
    if latched | cameras:
        cdr = Cdr()
        for message in _messages(reader, latched | cameras, reader.span_ns[0], start_ns - 1):
            last[message.topic, _frames(cdr, message)] = message
    return sorted(last.values(), key=lambda message: message.log_time_ns)


def _frames(cdr: Cdr, message: BagMessage) -> object:
    """Return the child frames of a message with transforms, None for other types."""
    if message.typename != _TRANSFORMS:
        return None
    try:
        placed = cdr.deserialize(message.data, message.typename).transforms
    except MessageError:
        return None
    return tuple(sorted(transform.child_frame_id for transform in placed))
