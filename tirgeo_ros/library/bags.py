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
"""Read bags into tables and write tables to bags."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.arrays import Array, IntArray, RawPixels
from tirgeo_ros.core.types.errors import BagError, TableError, TirgeoError, nearest
from tirgeo_ros.core.types.measurements import LAST_NS
from tirgeo_ros.io.bags.bag import BagMessage, BagReader, BagWriter, Cdr
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.messages import (
    SENSED_SAMPLES,
    TOPIC_TYPES,
    Messages,
    pictures as picture_messages,
    sensed,
)
from tirgeo_ros.io.messages.cdr import header_stamp_ns
from tirgeo_ros.io.messages.topics import CAMERA_INFO, PICTURES, resolved
from tirgeo_ros.library.tables import ARRIVAL, ORDER, OUTPUTS, SENSORS, STAMP, Table, arrived

T = TypeVar("T")


class Picture(NamedTuple):
    """Hold a picture of a bag."""

    stamp_ns: int
    """Stamp of its header, ns: the time of exposure plus the video's latency."""
    pixels: RawPixels
    """(h, w) 8 or 16 bit, or (h, w, 3) blue, green, red."""


def read_bag(
    path: PathLike, topics: str | Collection[str] | None = None, *, namespace: str = ""
) -> dict[str, dict[str, Array | IntArray]]:
    """Read a bag's sensors and poses: a table of 1-D arrays for each topic.

    ``topics`` is a name without a leading slash (``imu/data``) or several names; None: all sensors
    and poses that the bag has. ``namespace`` is that of the bag. The columns are those that
    ``filter_flight`` takes, in SI units and radians, with axes forward-right-down and
    north-east-down; then ``arrival_ns`` (the message's log time) and ``arrival_order`` (its number
    among the messages read). ``pandas.DataFrame(table)`` converts a table. A warning names what
    could not be read. Raises BagError if the path is not a bag or has no sensors and poses, or if
    a topic is absent, unknown or of another type.
    """
    reader = BagReader(path)
    several = topics if np.iterable(topics) and not isinstance(topics, str) else [topics]
    chosen = None if topics is None else [str(topic) for topic in several]
    if not {CAMERA_INFO, *PICTURES}.isdisjoint(chosen or ()):
        raise BagError(f"{path}: pictures are not a table: use read_pictures and read_camera")
    names = _chosen(reader, chosen, namespace)
    rows: dict[str, list[Any]] = {topic: [] for topic in names.values()}

    def row_of(topic: str, message: Any) -> tuple[int, Sequence[float]]:
        if topic in OUTPUTS:
            return OUTPUTS[topic].values(message)
        sample = SENSED_SAMPLES[topic](message)
        return sample.stamp_ns, SENSORS[topic].values(sample)

    for number, message, (stamp_ns, values) in _read(reader, names, row_of):
        row = (stamp_ns, message.log_time_ns, number, *values)
        rows[names[message.topic]].append(row)
    return {topic: _table(topic, read) for topic, read in rows.items()}


def read_camera(path: PathLike, *, namespace: str = "") -> Camera:
    """Return the camera's calibration in a bag (``thermal/camera_info``).

    Raises BagError if there is none that can be used.
    """
    reader = BagReader(path)
    names = _chosen(reader, [CAMERA_INFO], namespace)
    for _, _, camera in _read(
        reader, names, lambda topic, info: picture_messages.camera(info, topic)
    ):
        return camera
    raise BagError(f"{path}: no {CAMERA_INFO} could be used")


def read_pictures(path: PathLike, *, namespace: str = "") -> Iterator[Picture]:
    """Yield a bag's pictures in the order of their log times, one in memory at a time.

    A warning at the end names what could not be read. Raises BagError if the bag has none.
    """
    reader = BagReader(path)
    present = [topic for topic in PICTURES if resolved(topic, namespace) in reader.topics()]
    names = _chosen(reader, present[:1] or [PICTURES[-1]], namespace)
    for _, message, pixels in _read(reader, names, picture_messages.pixels):
        yield Picture(header_stamp_ns(message.data), pixels)


def write_bag(path: PathLike, tables: Mapping[str, Table], *, namespace: str = "") -> None:
    """Write sensors' tables (by topic, without a leading slash) to a bag.

    The tables are as for ``filter_flight``. The messages are those of the contract, which ROS 2,
    Foxglove and ``tirgeo process`` take; they are in the order of arrival, and the log time of
    each is its arrival. The bag is complete or absent. Raises TableError for a wrong topic or
    column, BagError if it cannot be written.
    """
    if not isinstance(tables, Mapping):
        raise TableError(f"{path}: tables must be a dict of tables by topic; it is {tables!r}")
    messages, written = Messages(), 0
    with BagWriter(path) as writer:
        for written, (topic, arrival_ns, sample) in enumerate(arrived(tables), 1):  # noqa: B007  used after the loop
            if not (0 <= sample.stamp_ns < LAST_NS and 0 <= arrival_ns < LAST_NS):
                times = f"stamp_ns {sample.stamp_ns} and arrival_ns {arrival_ns}"
                raise TableError(f"{topic}: {times}: a bag holds times from 1970 to 2038")
            name = resolved(topic, namespace)
            writer.write(name, TOPIC_TYPES[topic], sensed(messages, sample)[1], arrival_ns)
        if not written:
            raise TableError(f"{path}: no table has a row: there is nothing to write")


def _chosen(reader: BagReader, topics: Collection[str] | None, namespace: str) -> dict[str, str]:
    """Return the topics to read: resolved name -> topic of the contract. Raises BagError."""
    present = reader.topics()
    tables = [*SENSORS, *OUTPUTS]
    if topics is None:
        names = {resolved(topic, namespace): topic for topic in tables}
        chosen = {
            name: topic for name, topic in names.items() if present.get(name) == TOPIC_TYPES[topic]
        }
        if not chosen:
            has = ", ".join(present) or "nothing"
            here = f"in namespace {namespace}" if namespace else "without a namespace"
            raise BagError(f"{reader.path}: no sensor and no pose {here}; it has: {has}")
        return chosen
    for topic in topics:
        name = resolved(topic, namespace)
        if topic not in {*tables, CAMERA_INFO, *PICTURES}:
            raise BagError(f"{reader.path}: {topic} has no table{nearest(topic, tables)}")
        if name not in present:
            raise BagError(f"{reader.path}: no topic {name}; it has: {', '.join(present)}")
        if present[name] != TOPIC_TYPES[topic]:
            wanted = TOPIC_TYPES[topic]
            raise BagError(f"{reader.path}: {name} is of type {present[name]}, not {wanted}")
    return {resolved(topic, namespace): topic for topic in topics}


def _read(
    reader: BagReader, names: Mapping[str, str], converted: Callable[[str, Any], T]
) -> Iterator[tuple[int, BagMessage, T]]:
    """Yield each message's number, the message, and its content ``converted``.

    Messages that cannot be read are left out; a warning at the end counts them.
    """
    cdr, lost, why = Cdr(), Counter[str](), dict[str, str]()
    for number, message in enumerate(reader.messages(names)):
        name = message.topic
        try:
            decoded = cdr.deserialize(message.data, message.typename, name)
            content = converted(names[name], decoded)
        except TirgeoError as error:
            lost[name] += 1
            why[name] = str(error)
        else:
            yield number, message, content
    losses = [f"{lost[topic]} messages of {topic} left out: {text}" for topic, text in why.items()]
    for loss in [*losses, reader.damage]:
        if loss:
            warnings.warn(f"{reader.path}: {loss}", stacklevel=3)


def _table(topic: str, rows: Sequence[Sequence[Any]]) -> dict[str, Array | IntArray]:
    """Return rows (stamp, arrival, order, the topic's values) as columns by name."""
    if topic in OUTPUTS:
        names = OUTPUTS[topic].columns
    else:
        names = tuple(column.name for column in SENSORS[topic].columns)
    whole = np.array([row[:3] for row in rows], np.int64).reshape(-1, 3)
    values = np.array([row[3:] for row in rows], float).reshape(-1, len(names))
    table: dict[str, Array | IntArray] = dict(zip((STAMP, ARRIVAL, ORDER), whole.T, strict=True))
    return table | dict(zip(names, values.T, strict=True))
