"""Files of the sample flight for evaluations, whole and cut."""

from __future__ import annotations

import math

from tirgeo_ros.io.bags.bag import BagReader, BagWriter

METHODS = ["raw", "rtk", "ekf", "ekf_heading"]
RTK = {f"/rtk/{name}" for name in ("fix", "vel", "heading")}


def files(folder):
    return [folder / name for name in ("flight.mcap", "survey.geojson", "observations.csv")]


def cut(bag, path, *, without=(), seconds=math.inf):
    """A copy of a bag without some topics, or its first seconds."""
    reader = BagReader(bag)
    end_ns = reader.span_ns[0] + seconds * 1e9
    with BagWriter(path) as writer:
        for item in reader.messages():
            if item.topic not in without and item.log_time_ns <= end_ns:
                writer.write(item.topic, item.typename, item.data, item.log_time_ns)
    return path
