"""What a filter is fed: samples in the order of arrival, each with the time it truly is of."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from flights import NAVIGATION_SAMPLES

from tirgeo_ros.core.types.measurements import NavigationInput, Source
from tirgeo_ros.tools.simulate.flight import SimulatedFlight

RTK = (Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING)
GPS = (Source.GPS_POSITION, Source.GPS_VELOCITY)
ALL = (Source.IMU, *RTK, *GPS)


@dataclass(frozen=True, slots=True)
class Delivery:
    """A sample as the filter gets it."""

    arrival_ns: int
    sample: NavigationInput
    true_ns: int  # of the measurement, whatever its stamp says
    clock_ns: int = 0  # how far the clock of stamps is ahead of the truth's

    @property
    def source(self) -> Source:
        return self.sample.source

    def with_sample(self, **values: object) -> Delivery:
        return replace(self, sample=replace(self.sample, **values))


@dataclass(frozen=True, slots=True)
class Interval:
    """When a fault lasts, in the time of measurement."""

    start_ns: int
    end_ns: int

    def holds(self, delivery: Delivery) -> bool:
        return self.start_ns <= delivery.true_ns < self.end_ns


Deliveries = list[Delivery]
#: What a fault makes of a flight's deliveries.
Fault = Callable[[Deliveries, Interval], Deliveries]


def deliveries(flown: SimulatedFlight) -> Deliveries:
    """All that a flight sends the filter, as it should be."""
    return [
        Delivery(arrival_ns, sample, sample.stamp_ns)
        for arrival_ns, sample in flown.samples
        if isinstance(sample, NAVIGATION_SAMPLES)
    ]


def in_order(found: Iterable[Delivery]) -> Deliveries:
    """Sorted by arrival; those of one instant stay in their order."""
    return sorted(found, key=lambda delivery: delivery.arrival_ns)


def each(sources: tuple[Source, ...], change: Callable[[Delivery], Deliveries]) -> Fault:
    """What a change makes of each delivery of some sources in the interval."""

    def fault(found: Deliveries, interval: Interval) -> Deliveries:
        out: Deliveries = []
        for delivery in found:
            hit = delivery.source in sources and interval.holds(delivery)
            out += change(delivery) if hit else [delivery]
        return in_order(out)

    return fault
