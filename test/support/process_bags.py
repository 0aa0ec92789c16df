"""Bags that are changed copies of others, what is in them, and the files of the sample flight."""

from __future__ import annotations

from tirgeo_ros.io.bags.bag import BagReader, BagWriter, Cdr

CDR = Cdr()
METHODS = ["raw", "rtk", "ekf", "ekf_heading"]
RTK = {f"/rtk/{name}" for name in ("fix", "vel", "heading")}
IMAGES = "/thermal/image_raw/compressed"
CAMERA_POSE = "/tirgeo/camera_pose"


def files(folder):
    """The sample flight's files for an evaluation."""
    return [folder / name for name in ("flight.mcap", "survey.geojson", "observations.csv")]


def same(item):
    return item.topic, item.data


def rewritten(source, target, edit=same, *, seconds=1e9, without=()):
    """Copy a bag; ``edit`` gives topic and data of each message, or None to leave it out."""
    reader = BagReader(source)
    end_ns = reader.span_ns[0] + seconds * 1e9
    with BagWriter(target) as writer:
        for item in reader.messages():
            kept = edit(item) if item.log_time_ns < end_ns and item.topic not in without else None
            if kept:
                writer.write(kept[0], item.typename, kept[1], item.log_time_ns)
    return target


def messages_of(path, *topics):
    """(log time, message) of some topics."""
    for item in BagReader(path).messages(topics or None):
        yield item.log_time_ns, CDR.deserialize(item.data, item.typename)


def data_of(path, *topics):
    """The bytes of each message of some topics."""
    return [item.data for item in BagReader(path).messages(topics)]
