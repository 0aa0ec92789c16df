"""Samples that do not come, or late, or twice, or with other stamps, in the interval of a fault.

Each call gives a ``Fault``, which takes the deliveries of a flight and the interval, leaves what
is outside as it is, and draws its random numbers from a seed of its own.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from scenario.deliveries import Deliveries, Delivery, Fault, Interval, each, in_order

from tirgeo_ros.core.types.measurements import Source

_SEED = 41


def nothing(found: Deliveries, interval: Interval) -> Deliveries:
    """No fault at all."""
    return found


def both(*faults: Fault) -> Fault:
    """One fault after the other, in the same interval."""

    def fault(found: Deliveries, interval: Interval) -> Deliveries:
        for one in faults:
            found = one(found, interval)
        return found

    return fault


def between(start_s: float, end_s: float, one: Fault) -> Fault:
    """A fault for a part of the interval, in seconds from its start."""

    def fault(found: Deliveries, interval: Interval) -> Deliveries:
        first_ns = interval.start_ns
        part = Interval(first_ns + round(start_s * 1e9), first_ns + round(end_s * 1e9))
        return one(found, part)

    return fault


def drop(*sources: Source) -> Fault:
    """Nothing comes."""
    return each(sources, lambda _: [])


def lossy(share: float, *sources: Source) -> Fault:
    """A share of the samples is missing, at random."""

    def fault(found: Deliveries, interval: Interval) -> Deliveries:
        rng = np.random.default_rng(_SEED)
        some = each(sources, lambda delivery: [delivery] if rng.random() > share else [])
        return some(found, interval)

    return fault


def late(extra_s: float, *sources: Source) -> Fault:
    """Samples come later, with the right stamps."""
    return each(sources, lambda delivery: [_delayed(delivery, extra_s)])


def shuffled(largest_s: float, *sources: Source) -> Fault:
    """Samples come later by random times, so that they overtake each other."""

    def fault(found: Deliveries, interval: Interval) -> Deliveries:
        rng = np.random.default_rng(_SEED)
        some = each(sources, lambda delivery: [_delayed(delivery, rng.uniform(0, largest_s))])
        return some(found, interval)

    return fault


def duplicated(*sources: Source) -> Fault:
    """Each sample comes twice."""
    return each(sources, lambda delivery: [delivery, delivery])


def swapped(source: Source) -> Fault:
    """Each second sample comes just after the one that follows it."""

    def fault(found: Deliveries, interval: Interval) -> Deliveries:
        mine = [d for d in found if d.source is source and interval.holds(d)]
        turned = {
            id(first): replace(first, arrival_ns=second.arrival_ns + 1)
            for first, second in zip(mine[::2], mine[1::2], strict=False)
        }
        return in_order(turned.get(id(d), d) for d in found)

    return fault


def polled(rate_hz: float, *sources: Source) -> Fault:
    """A receiver that is asked more often than it measures: old values with new stamps."""
    step_ns = round(1e9 / rate_hz)

    def fault(found: Deliveries, interval: Interval) -> Deliveries:
        again: Deliveries = []
        for source in sources:
            mine = [d for d in found if d.source is source and interval.holds(d)]
            for first, second in pairwise(mine):
                ages_ns = range(step_ns, second.true_ns - first.true_ns, step_ns)
                again += [_stamped_again(first, age_ns) for age_ns in ages_ns]
        return in_order([*found, *again])

    return fault


def clock(shift_s: float, *sources: Source) -> Fault:
    """Stamps of another clock: later by ``shift_s``, or earlier where that is negative."""
    shift_ns = round(shift_s * 1e9)
    moved_on = misstamped(shift_s, *sources)

    def fault(found: Deliveries, interval: Interval) -> Deliveries:
        return [
            replace(d, clock_ns=shift_ns) if d.source in sources and interval.holds(d) else d
            for d in moved_on(found, interval)
        ]

    return fault


def misstamped(shift_s: float, *sources: Source) -> Fault:
    """The clock stays what it was, but stamps are wrong by ``shift_s``."""
    shift_ns = round(shift_s * 1e9)
    return each(sources, lambda d: [d.with_sample(stamp_ns=d.sample.stamp_ns + shift_ns)])


def _delayed(delivery: Delivery, extra_s: float) -> Delivery:
    return replace(delivery, arrival_ns=delivery.arrival_ns + round(extra_s * 1e9))


def _stamped_again(delivery: Delivery, age_ns: int) -> Delivery:
    later = delivery.with_sample(stamp_ns=delivery.sample.stamp_ns + age_ns)
    return replace(later, arrival_ns=delivery.arrival_ns + age_ns)
