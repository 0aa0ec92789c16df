# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Bags of samples or changed copies of others, what is in them, and the sample flight's files."""

from __future__ import annotations

from dataclasses import replace

from flights import navigation_samples

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.types.measurements import ImuSample, Source
from tirgeo_ros.io.bags.bag import BagReader, BagWriter, Cdr
from tirgeo_ros.io.messages import TOPIC_TYPES, Messages, sensed

CDR = Cdr()
METHODS = ["raw", "rtk", "ekf", "ekf_heading"]
RTK = {f"/rtk/{name}" for name in ("fix", "vel", "heading")}
IMAGES = "/thermal/image_raw/compressed"
CAMERA_POSE = "/tirgeo/camera_pose"


def files(folder):
    """The sample flight's files for an evaluation."""
    return [folder / name for name in ("flight.mcap", "survey.geojson", "observations.csv")]


def located_or_evaluated(verb, sample, folder):
    """The words of ``locate`` or ``evaluate`` over the sample flight, but for its parameters."""
    bag, survey, observed = files(sample)
    if verb == "locate":
        return [verb, bag, "--pixels", observed, "-o", folder / "points.geojson"]
    given = ["--survey", survey, "--observations", observed]
    return [verb, bag, *given, "-o", folder / "evaluation"]


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


def write_samples(path, samples):
    """A bag of samples; log time = stamp."""
    messages = Messages()
    with BagWriter(path) as bag:
        for sample in sorted(samples, key=lambda one: one.stamp_ns):
            topic, message = sensed(messages, sample)
            bag.write(f"/{topic}", TOPIC_TYPES[topic], message, sample.stamp_ns)
    return path


def write_hover(path, flown, *reports):
    """A flight without ``rtk/heading`` and the autopilot's attitude, with what else is told."""
    samples = [s for s in navigation_samples(flown) if s.source is not Source.RTK_HEADING]
    samples = [replace(s, autopilot_q_nb=None) if isinstance(s, ImuSample) else s for s in samples]
    return write_samples(path, [*samples, *reports])


def picture_bag(path, stamps_ns, images, *, info=True, namespace=""):
    """A bag of raw pictures, with the calibration of XT2 beside each unless ``info`` is false."""
    messages = Messages()
    with BagWriter(path) as writer:
        for stamp_ns, image in zip(stamps_ns, images, strict=True):
            made = messages.image(stamp_ns, image)
            writer.write(f"{namespace}/thermal/image_raw", "sensor_msgs/msg/Image", made, stamp_ns)
            if info:
                made = messages.camera_info(XT2, stamp_ns)
                writer.write("/thermal/camera_info", "sensor_msgs/msg/CameraInfo", made, stamp_ns)
    return path
