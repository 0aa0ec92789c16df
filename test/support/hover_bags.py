"""Bags of a hover in which nothing tells the heading."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from flights import navigation_samples

from tirgeo_ros.core.types.measurements import ImuSample, SetHeading, Source
from tirgeo_ros.io.bags.bag import BagWriter, Cdr
from tirgeo_ros.io.messages import TOPIC_TYPES, Messages, sensed
from tirgeo_ros.tools.simulate.flight import SimulatedFlight


def write_hover(path: Path, flown: SimulatedFlight, told: SetHeading | None = None) -> Path:
    """Write a flight without ``rtk/heading`` and the autopilot's attitude; ``told`` is set."""
    messages = Messages(Cdr().types)
    samples = [s for s in navigation_samples(flown) if s.source is not Source.RTK_HEADING]
    if told is not None:
        samples = sorted([*samples, told], key=lambda s: s.stamp_ns)
    with BagWriter(path) as writer:
        for given in samples:
            sample = given
            if isinstance(sample, ImuSample):
                sample = replace(sample, autopilot_q_nb=None)
            topic, message = sensed(messages, sample)
            writer.write(f"/{topic}", TOPIC_TYPES[topic], message, sample.stamp_ns)
    return path
