"""Turn tables of samples into one stream in the order of arrival."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.types.errors import TableError, nearest
from tirgeo_ros.io.messages import SensedSample
from tirgeo_ros.library.sensor_columns import SENSORS, Form
from tirgeo_ros.library.tables import Numbers, Table, numbers_of


class Arrived(NamedTuple):
    """Hold a sample, its topic and the time at which it arrived, ns."""

    topic: str
    arrival_ns: int
    sample: SensedSample


def form_of(topic: str) -> Form:
    """Return the form of a topic's table. Raises TableError for a topic that is no sensor's."""
    if topic not in SENSORS:
        raise TableError(f"{topic}: no topic of a sensor{nearest(topic, SENSORS)}")
    return SENSORS[topic]


def arrived(
    tables: Mapping[str, Table], names: Mapping[str, str] | None = None
) -> Iterator[Arrived]:
    """Yield the samples of tables (by topic) in the order of arrival.

    That is by ``arrival_ns``, then ``arrival_order``, then the order of the tables. ``names`` are
    what errors call the tables, by default the topics. Raises TableError.
    """
    topics, names = list(tables), names or {}
    forms = [form_of(topic) for topic in topics]
    read = [
        numbers_of(names.get(topic, topic), tables[topic], form.columns)
        for topic, form in zip(topics, forms, strict=True)
    ]
    for place, row in _in_order(read):
        numbers, form = read[place], forms[place]
        sample = form.sample(int(numbers.stamps_ns[row]), numbers.rows[row].tolist())
        yield Arrived(topics[place], int(numbers.arrivals_ns[row]), sample)


def _in_order(read: Sequence[Numbers]) -> Iterator[tuple[int, int]]:
    """Yield the place of the table and the row in it, of one sample after the other."""
    if not read:
        return
    lengths = [len(one.stamps_ns) for one in read]
    place = np.repeat(np.arange(len(read)), lengths)
    row = np.concatenate([np.arange(length) for length in lengths])
    arrival_ns = np.concatenate([one.arrivals_ns for one in read])
    order = np.lexsort((np.concatenate([one.order for one in read]), arrival_ns))
    yield from zip(place[order].tolist(), row[order].tolist(), strict=True)
