"""Cut parts out of a recorded flight: the work of ``tirgeo cut``.

Messages are copied as they are, also those of foreign types. What a late subscriber would have
received (latched topics, the calibration) is carried to the beginning of each part.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from itertools import islice
from pathlib import Path
from statistics import median
from typing import NamedTuple

from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.core.types.errors import BagError, MessageError, TargetError
from tirgeo_ros.core.types.texts import utc
from tirgeo_ros.io.bags.bag import BagMessage, BagReader, BagWriter, Cdr, TopicForm
from tirgeo_ros.io.bags.bag_writer import is_latched
from tirgeo_ros.io.bags.cdr import header_stamp_ns
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, made_folder
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.io.messages.json_codec import ANSWER_TOPIC, TARGETS_TOPIC
from tirgeo_ros.io.targets.formats import read_targets
from tirgeo_ros.tools.presentation.progress import Report, silent

_NS = 1_000_000_000
_CALIBRATION, _TRANSFORMS = "sensor_msgs/msg/CameraInfo", "tf2_msgs/msg/TFMessage"
_PICTURES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
_MOST_PICTURES = 100  # whose stamps are compared with their log times

#: Seconds after the flight's first message, or UTC.
Instant = float | datetime


class _Part(NamedTuple):
    """Hold one output: the log times from the first to the last that are in it."""

    path: Path
    start_ns: int
    end_ns: int


def cut(
    bag: PathLike,
    output: PathLike,
    *,
    begin: Instant = 0.0,
    end: Instant = math.inf,
    targets: PathLike | None = None,
    around: float = 15.0,
    before: float = 0.0,
    progress: Report = silent,
) -> dict[str, object]:
    """Write the part of a bag from ``begin`` to ``end`` and return a summary.

    With ``targets``, a file of targets, ``output`` is a folder; each pass over a target becomes a
    bag in it: from ``around`` seconds before a click to as long after. Parts begin ``before``
    seconds earlier. ``error`` in the summary is None, or what of the bag was lost. Raise BagError
    (no bag, nothing in the part) and TargetError (no such file, no click in the flight).
    """
    if targets is None or not Path(output).is_dir():
        check_outputs([bag, targets], [output], BagError)
    reader = BagReader(bag)
    if targets is None:
        chosen = [_Part(Path(output), *_window(reader, begin, end))]
    else:
        chosen = _around_clicks(reader, read_targets(targets), Path(output), around)
    parts = [part._replace(start_ns=part.start_ns - round(before * _NS)) for part in chosen]
    check_outputs([bag, targets], [part.path for part in parts], BagError)
    if targets is not None:
        made_folder(output, BagError)
    written = [_written(reader, part, progress) for part in parts]
    return {
        "input": os.fspath(bag),
        "output": os.fspath(output),
        "parts": written,
        "warning": "; ".join(_older_forms(reader)) or None,
        "error": f"{reader.path}: {reader.damage}" if reader.damage else None,
    }


def _older_forms(reader: BagReader) -> list[str]:
    """Return a line for each topic of an earlier version that programs of today cannot read."""
    return [
        f"{topic}: {kind}, as earlier versions had it; today it is {TOPIC_TYPES[name]}, and no "
        "program of tirgeo reads the older form"
        for topic, kind in reader.topics().items()
        for name in (ANSWER_TOPIC, TARGETS_TOPIC)
        if topic.endswith(f"/{name}") and kind != TOPIC_TYPES[name]
    ]


def _window(reader: BagReader, begin: Instant, end: Instant) -> tuple[int, int]:
    """Return the log times (ns) of a window. Raises BagError if it is not in the flight."""
    first_ns, last_ns = reader.span_ns
    start_ns, end_ns = (_log_time_ns(instant, first_ns, last_ns) for instant in (begin, end))
    if start_ns > last_ns or end_ns < first_ns or end_ns < start_ns:
        raise BagError(f"{reader.path}: nothing between these times: {_flight_times(reader)}")
    return start_ns, end_ns


def _log_time_ns(instant: Instant, first_ns: int, last_ns: int) -> int:
    if isinstance(instant, datetime):
        return round(instant.timestamp() * 1e6) * 1000
    return last_ns if math.isinf(instant) else first_ns + round(instant * _NS)


def _flight_times(reader: BagReader) -> str:
    first_ns, last_ns = reader.span_ns
    begun, ended = (utc(time_ns) for time_ns in (first_ns, last_ns))
    return f"the flight is {(last_ns - first_ns) / _NS:.1f} s long, from {begun} to {ended}"


def _around_clicks(
    reader: BagReader, targets: Sequence[Target], folder: Path, around_s: float
) -> list[_Part]:
    """Return a part for each pass over a target. Raises TargetError if no click is in the bag."""
    first_ns, last_ns = reader.span_ns
    around_ns, lag_ns = round(around_s * _NS), _picture_lag_ns(reader)
    parts = []
    for target in targets:
        clicks_ns = sorted(click.stamp_ns + lag_ns for click in target.clicks)
        flown_ns = [click_ns for click_ns in clicks_ns if first_ns <= click_ns <= last_ns]
        for number, (start_ns, end_ns) in enumerate(_passes(flown_ns, around_ns), 1):
            again = f"_{number}" if number > 1 else ""
            path = folder / f"target_{target.number}{again}.mcap"
            parts.append(_Part(path, max(start_ns, first_ns), min(end_ns, last_ns)))
    if not parts:
        raise TargetError(f"no target was clicked during this flight: {_flight_times(reader)}")
    return parts


def _picture_lag_ns(reader: BagReader) -> int:
    """Return by how much pictures were logged after their stamps, which a click has; 0 for none.

    It is much where the recorder's clock is not the camera's.
    """
    pictures = {topic for topic, kind in reader.topics().items() if kind in _PICTURES}
    lags_ns = [
        picture.log_time_ns - stamp_ns
        for picture in islice(reader.messages(pictures, any_form=True), _MOST_PICTURES)
        if (stamp_ns := _stamp_ns(picture))
    ]
    return int(median(lags_ns)) if lags_ns else 0


def _stamp_ns(picture: BagMessage) -> int:
    try:
        return header_stamp_ns(picture.data)
    except MessageError:
        return 0


def _passes(clicks_ns: Iterable[int], around_ns: int) -> list[tuple[int, int]]:
    """Return the spans (ns) around clicks, in order; those that touch are one."""
    spans: list[tuple[int, int]] = []
    for click_ns in clicks_ns:
        start_ns, end_ns = click_ns - around_ns, click_ns + around_ns
        if spans and start_ns <= spans[-1][1]:
            start_ns = spans.pop()[0]
        spans.append((start_ns, end_ns))
    return spans


def _written(reader: BagReader, part: _Part, progress: Report) -> dict[str, object]:
    """Write a part; return what is in it."""
    forms = reader.forms()
    part = part._replace(start_ns=max(part.start_ns, reader.span_ns[0]))
    counts: Counter[str] = Counter()
    carried = _carried(reader, forms, part)
    with BagWriter(part.path, forms=forms) as writer:
        for message in carried:
            writer.write(message.topic, message.typename, message.data, part.start_ns)
        for message in _messages(reader, None, part):
            writer.write(message.topic, message.typename, message.data, message.log_time_ns)
            counts[message.topic] += 1
            at_ns, length_ns = message.log_time_ns - part.start_ns, part.end_ns - part.start_ns
            progress(at_ns / _NS, length_ns / _NS)
        if not counts:
            raise BagError(f"{reader.path}: no message between these times")
    return {
        "output": os.fspath(part.path),
        "from_s": (part.start_ns - reader.span_ns[0]) / _NS,
        "to_s": (part.end_ns - reader.span_ns[0]) / _NS,
        "from_utc": utc(part.start_ns),
        "messages": dict(sorted(counts.items())),
        "carried": dict(sorted(Counter(message.topic for message in carried).items())),
    }


def _messages(
    reader: BagReader, topics: Iterable[str] | None, part: _Part
) -> Iterator[BagMessage]:
    wanted = None if topics is None else set(topics)
    for message in reader.messages(wanted, part.start_ns, any_form=True):
        if message.log_time_ns > part.end_ns:
            return
        yield message


def _carried(reader: BagReader, forms: dict[str, TopicForm], part: _Part) -> list[BagMessage]:
    """Return the messages before a part that its subscribers need, in order of time.

    These are the last one of each latched topic (of transforms the last one of each set of
    frames: each publisher has its own), and the last calibration where the part has none.
    """
    latched = {topic for topic, form in forms.items() if is_latched(topic, form.metadata)}
    cameras = {topic for topic, form in forms.items() if form.typename == _CALIBRATION} - latched
    for topic in sorted(cameras):
        if next(_messages(reader, {topic}, part), None) is not None:
            cameras.remove(topic)
    earlier = part._replace(start_ns=reader.span_ns[0], end_ns=part.start_ns - 1)
    last: dict[tuple[str, object], BagMessage] = {}
    if latched | cameras:
        cdr = Cdr()
        for message in _messages(reader, latched | cameras, earlier):
            last[message.topic, _frames(cdr, message)] = message
    return sorted(last.values(), key=lambda message: message.log_time_ns)


def _frames(cdr: Cdr, message: BagMessage) -> object:
    """Return the frames that a message places, None of other types."""
    if message.typename != _TRANSFORMS:
        return None
    try:
        placed = cdr.deserialize(message.data, message.typename).transforms
    except MessageError:
        return None
    return tuple(sorted(transform.child_frame_id for transform in placed))
