"""Write a flight as bags: the aircraft's recording and the truth, as the contract's messages."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.core.types.poses import CameraPose, NavSolution
from tirgeo_ros.io.bags.bag import BagWriter, Cdr
from tirgeo_ros.io.messages import TOPIC_TYPES, Messages, sensed
from tirgeo_ros.io.surveys.survey import Observation
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.simulate.flight import SimulatedFlight
from tirgeo_ros.tools.simulate.processes import generator
from tirgeo_ros.tools.simulate.renderer import Renderer
from tirgeo_ros.tools.simulate.sensors import Epochs
from tirgeo_ros.tools.simulate.survey import exposures

#: An operator clicks on a target so long after a picture shows it best.
_CLICK_AFTER_NS = 1_000_000_000

Outgoing = tuple[int, str, Any]  # log time in ns, topic, message


def write_flight(
    path: Path,
    flight: SimulatedFlight,
    window: range,
    camera: Camera,
    renderer: Renderer | None,
    clicks: Sequence[Observation],
    progress: Report,
) -> dict[str, int]:
    """Write what the aircraft recorded, and an operator's clicks on its pictures.

    Without a renderer no pictures are written. Only messages whose log time (ns) is in ``window``
    are. Return the number of messages by topic.
    """
    messages = Messages(Cdr().types)
    infos = (
        (stamp_ns, "thermal/camera_info", messages.camera_info(camera, stamp_ns))
        for _, stamp_ns, _ in _frames(flight)
    )
    pictures = _pictures(messages, flight, window, renderer) if renderer else ()
    clicked = (
        (
            click.stamp_ns + _CLICK_AFTER_NS,
            "tirgeo/locate/pixel",
            messages.pixel(click.stamp_ns, click.u, click.v),
        )
        for click in clicks
        if click.stamp_ns in window
    )
    streams = (_sensed(messages, flight), infos, pictures, clicked)
    return _write(path, streams, window, progress)


def write_truth(path: Path, flight: SimulatedFlight, window: range) -> dict[str, int]:
    """Write the true poses: the body's at the IMU's rate, the camera's at the gimbal's."""
    messages = Messages(Cdr().types)
    streams = (_true_body(messages, flight, window), _true_camera(messages, flight))
    return _write(path, streams, window, silent)


def _write(path: Path, streams: Sequence[Any], window: range, progress: Report) -> dict[str, int]:
    """Merge streams and write what is in the window; return the number of messages by topic."""
    counts: dict[str, int] = {}
    with BagWriter(path) as bag:
        # Messages of equal times keep the order of the streams.
        for log_time_ns, topic, message in heapq.merge(*streams, key=lambda one: one[0]):
            if log_time_ns in window:
                bag.write(f"/{topic}", TOPIC_TYPES[topic], message, log_time_ns)
                counts[topic] = counts.get(topic, 0) + 1
                progress((log_time_ns - window.start) / 1e9, len(window) / 1e9)
    return dict(sorted(counts.items()))


def _sensed(messages: Messages, flight: SimulatedFlight) -> Iterator[Outgoing]:
    pilot = flight.scenario.autopilot
    sigmas = np.radians([*pilot.tilt_rms_deg, pilot.heading_rms_deg])
    covariance = np.diag(sigmas**2).ravel()
    for arrival_ns, sample in flight.samples:
        topic, message = sensed(messages, sample)
        if isinstance(sample, ImuSample):
            message.orientation_covariance = covariance
        yield arrival_ns, topic, message


def _frames(flight: SimulatedFlight) -> Iterator[tuple[int, int, float]]:
    """Yield number, stamp (ns) and exposure time (s) of pictures, which arrive at their stamps."""
    latency_ns = round(flight.scenario.video.latency_s * 1e9)
    epochs = exposures(flight)
    for number, (exposed_ns, t_s) in enumerate(zip(epochs.stamp_ns, epochs.t_s, strict=True)):
        yield number, exposed_ns + latency_ns, float(t_s)


def _pictures(
    messages: Messages, flight: SimulatedFlight, window: range, renderer: Renderer
) -> Iterator[Outgoing]:
    for number, stamp_ns, t_s in _frames(flight):
        if stamp_ns not in window:  # rendering takes long
            continue
        position, q_pc = flight.gimbal.camera(t_s)
        # Each picture has its own generator, so that a window of the flight shows the same
        # pictures.
        rng = generator(flight.seed, f"picture {number}")
        picture = renderer.frame(position[0], q_pc[0], rng)
        if flight.scenario.video.bits == 16:
            yield stamp_ns, "thermal/image_raw", messages.image(stamp_ns, picture)
            continue
        quality = [cv2.IMWRITE_JPEG_QUALITY, flight.scenario.video.jpeg_quality]
        jpeg = cv2.imencode(".jpg", picture, quality)[1].tobytes()
        yield stamp_ns, "thermal/image_raw/compressed", messages.compressed(stamp_ns, jpeg)


def _true_body(messages: Messages, flight: SimulatedFlight, window: range) -> Iterator[Outgoing]:
    truth, plane = flight.truth, flight.plane
    places = truth.latitude_rad, truth.longitude_rad, truth.height_m
    rows = zip(truth.stamp_ns, *(x.tolist() for x in places), truth.velocity_n, strict=True)
    yield window.start, "tirgeo/origin", messages.origin(plane, window.start)
    for k, (stamp_ns, lat, lon, height, velocity_n) in enumerate(rows):
        if stamp_ns not in window:  # also for the order: none comes before the origin
            continue
        solution = NavSolution(
            *(stamp_ns, lat, lon, height, velocity_n),
            *(truth.q_nb[k], truth.angular_rate_b[k], (0.0, 0.0, 0.0), np.zeros((9, 9))),
        )
        pose = plane.body_pose(solution)
        yield stamp_ns, "tirgeo/odometry", messages.odometry(solution, pose)
        yield stamp_ns, "tirgeo/fix", messages.fix(solution)


def _true_camera(messages: Messages, flight: SimulatedFlight) -> Iterator[Outgoing]:
    epochs = Epochs.at_rate(flight.scenario, flight.scenario.gimbal.rate_hz)
    position, q_pc = flight.gimbal.camera(epochs.t_s)
    for pose in map(CameraPose, epochs.stamp_ns, position, q_pc, [np.zeros((6, 6))] * len(q_pc)):
        yield pose.stamp_ns, "tirgeo/camera_pose", messages.camera_pose(pose)
