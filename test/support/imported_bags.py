"""What is in the bags that tirgeo import writes."""

from __future__ import annotations

from ros1_bags import (
    Flight,
)

from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr

CDR = Cdr()


FLIGHT = Flight()


def messages(path, topic):
    return [CDR.deserialize(m.data, m.typename) for m in BagReader(path).messages([topic])]


def by_time(path, topic, flight=FLIGHT):
    """Seconds of the flight and message."""
    return [((convert.stamp_ns(m) - flight.begun_ns) * 1e-9, m) for m in messages(path, topic)]
