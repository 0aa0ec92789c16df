"""Turn tables of samples into one stream in the order of arrival."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.types.errors import TableError
from tirgeo_ros.io.messages import SensedSample
from tirgeo_ros.io.parameters.parameter_file import nearest
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


def arrived(tables: Mapping[str, Table], names: Mapping[str, str] | None = None) -> list[Arrived]:
    """Return the samples of tables (by topic) in the order of arrival.

    That is by ``arrival_ns``, then ``arrival_order``, then the order of the tables. ``names`` are
    what errors call the tables, by default the topics. Raises TableError.
    """
    found, numbers = [], []
    for topic, table in tables.items():
        form = form_of(topic)
        numbers.append(numbers_of((names or {}).get(topic, topic), table, form.columns))
        found += list(_samples(topic, form, numbers[-1]))
    if not numbers:
        return []
    arrivals_ns = np.concatenate([one.arrivals_ns for one in numbers])
    order = np.concatenate([one.order for one in numbers])
    return [found[place] for place in np.lexsort((order, arrivals_ns)).tolist()]


def _samples(topic: str, form: Form, numbers: Numbers) -> Iterator[Arrived]:
    columns = (numbers.stamps_ns, numbers.arrivals_ns, numbers.rows)
    for stamp_ns, arrival_ns, row in zip(*(one.tolist() for one in columns), strict=True):
        yield Arrived(topic, arrival_ns, form.sample(stamp_ns, row))
