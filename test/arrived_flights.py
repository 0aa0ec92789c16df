"""Flights through the checks of the filter's inputs, with faults planted in samples on the way."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.checks.finding import Finding
from tirgeo_ros.core.checks.navigation_checks import NavigationChecks
from tirgeo_ros.core.config import EkfConfig, GimbalConfig
from tirgeo_ros.core.samples import NavigationInput
from tirgeo_ros.io.bag import BagReader, Cdr
from tirgeo_ros.io.messages import TOPIC_TYPES, sensed
from tirgeo_ros.io.messages.encode import Messages
from tirgeo_ros.tools.flight_errors import NAVIGATION_SAMPLES
from tirgeo_ros.tools.registration import SAMPLES, Registration
from tirgeo_ros.tools.simulate.flight import Flight


class Arrived(NamedTuple):
    """A sample with its topic and the time of its arrival."""

    topic: str
    sample: NavigationInput
    arrival_ns: int


#: What a fault makes of a sample; None loses it.
Change = Callable[[Arrived], Arrived | None]


def recorded(path: Path) -> list[Arrived]:
    """Return the filter's inputs of a bag."""
    cdr = Cdr()
    wanted = {f"/{topic}": decode for topic, decode in SAMPLES.items() if topic in TOPIC_TYPES}
    found = [
        Arrived(m.topic[1:], wanted[m.topic](cdr.deserialize(m.data, m.typename)), m.log_time_ns)
        for m in BagReader(path).messages(wanted)
    ]
    return [one for one in found if isinstance(one.sample, NAVIGATION_SAMPLES)]


def simulated(flight: Flight) -> list[Arrived]:
    """Return the filter's inputs of a simulated flight."""
    messages = Messages(Cdr().types)
    return [
        Arrived(sensed(messages, sample)[0], sample, arrival_ns)
        for arrival_ns, sample in flight.samples
        if isinstance(sample, NAVIGATION_SAMPLES)
    ]


def checked(
    flight: Iterable[Arrived],
    config: EkfConfig,
    change: Change = lambda arrived: arrived,
    given: Collection[str] | None = None,
    *,
    filtered: bool = False,
) -> list[Finding]:
    """Return what the checks find at the end of a flight; ``filtered``: they hear the filter."""
    checks = NavigationChecks(config, given)
    registration = Registration(config, GimbalConfig()) if filtered else None
    for arrived in map(change, flight):
        if arrived is None:
            continue
        checks.take(*arrived)
        solution = registration.take(arrived.sample).solution if registration else None
        if solution is not None:
            checks.solution(solution)
    return checks.findings()


def lost(*topics: str) -> Change:
    """Return a fault: these topics, or all that begin so, never come."""
    return lambda arrived: None if arrived.topic.startswith(topics) else arrived


def changed(topics: str, **fields: Callable[[Any], Any]) -> Change:
    """Return a fault: fields of the samples of topics (in one text) are functions of themselves.

    Arrays come as copies, so that a function may write into them.
    """

    def change(arrived: Arrived) -> Arrived:
        if arrived.topic not in topics.split():
            return arrived
        sample = arrived.sample
        values = {}
        for name, function in fields.items():
            value = getattr(sample, name)
            values[name] = function(value.copy() if isinstance(value, np.ndarray) else value)
        return arrived._replace(sample=replace(sample, **values))

    return change
