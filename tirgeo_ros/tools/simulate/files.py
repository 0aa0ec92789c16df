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
"""Write the files of a simulated flight with truth from a scenario: ``tirgeo simulate``."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from tirgeo_ros.core.config.schema import values_of
from tirgeo_ros.core.types.errors import ScenarioError
from tirgeo_ros.core.types.measurements import USUAL_ORDER, ImuSample
from tirgeo_ros.core.types.poses import CameraPose, NavSolution
from tirgeo_ros.io.bags.bag import BagWriter
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, made_folder, write_files
from tirgeo_ros.io.messages import TOPIC_TYPES, Messages, sensed
from tirgeo_ros.io.surveys.survey import save_observations, save_survey
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.presentation.results import plain
from tirgeo_ros.tools.simulate.flight import SimulatedFlight, fly
from tirgeo_ros.tools.simulate.park import (
    WGS84_TEXT,
    Park,
    Relief,
    elevation_text,
    lay_out,
    map_text,
)
from tirgeo_ros.tools.simulate.processes import generator
from tirgeo_ros.tools.simulate.renderer import Renderer, Target, paint, targets_of, targets_text
from tirgeo_ros.tools.simulate.scenario import Scenario, load_scenario
from tirgeo_ros.tools.simulate.sensors import Epochs
from tirgeo_ros.tools.simulate.survey import frames, sightings, surveyed

#: An operator clicks on a target this long after the picture that shows it best.
_CLICK_AFTER_NS = 1_000_000_000

NAMES = (
    *("flight.mcap", "truth.mcap", "map.geojson", "survey.geojson", "targets.geojson"),
    *("observations.csv", "params.yaml"),
)
_CLEAR_M = 3.0  # smallest height above all ground
_HEAD = """\
# The nodes' parameters for the simulated flight {name}, written by 'tirgeo simulate'.
# They make 'map' the plane of truth.mcap. The map itself is given by --map or map:=.
"""
#: Priors of the filter, which are no properties of the flight.
_PRIORS = {"gyro_turn_on_bias", "accel_turn_on_bias"}

Outgoing = tuple[int, str, Any]  # log time in ns, topic, message


def _write(path: Path, streams: Sequence[Any], window: range, progress: Report) -> dict[str, int]:
    """Merge streams, write the messages in the window (ns), return their number by topic.

    Messages of equal times keep the order of the streams.
    """
    counts: dict[str, int] = {}
    with BagWriter(path) as bag:
        for log_time_ns, topic, message in heapq.merge(*streams, key=lambda outgoing: outgoing[0]):
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


def _pictures(
    messages: Messages, flight: SimulatedFlight, window: range, park: Park, targets: list[Target]
) -> Iterator[Outgoing]:
    scenario, video = flight.scenario, flight.scenario.video
    ground, relief = paint(park, scenario.park, flight.seed), Relief(scenario.park)
    renderer = Renderer(video.camera, ground, video, targets, relief)
    for number, (stamp_ns, t_s) in enumerate(frames(flight)):
        if stamp_ns not in window:  # rendering takes long
            continue
        position, q_pc = flight.gimbal.camera(t_s)
        # Each picture has its own generator, so that a window of the flight shows the same
        # pictures.
        rng = generator(flight.seed, f"picture {number}")
        picture = renderer.frame(position[0], q_pc[0], rng)
        if video.bits == 16:
            yield stamp_ns, "thermal/image_raw", messages.image(stamp_ns, picture)
            continue
        jpeg = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, video.jpeg_quality])[1]
        message = messages.compressed(stamp_ns, jpeg.tobytes())
        yield stamp_ns, "thermal/image_raw/compressed", message


def _clicked(
    messages: Messages, flight: SimulatedFlight, window: range, targets: Sequence[Target]
) -> Iterator[Outgoing]:
    """Yield an operator's clicks on targets, in pictures of the window."""
    for click in sightings(flight, flight.scenario.video.camera, targets):
        if click.stamp_ns in window:
            message = messages.pixel(click.stamp_ns, click.u, click.v)
            yield click.stamp_ns + _CLICK_AFTER_NS, "tirgeo/locate/pixel", message


def _true_body(messages: Messages, flight: SimulatedFlight, window: range) -> Iterator[Outgoing]:
    truth, plane = flight.truth, flight.plane
    places = truth.latitude_rad, truth.longitude_rad, truth.height_m
    rows = zip(truth.stamp_ns, *(x.tolist() for x in places), truth.velocity_n, strict=True)
    yield window.start, "tirgeo/origin", messages.origin(plane, window.start)
    for k, (stamp_ns, lat, lon, height, velocity_n) in enumerate(rows):
        if stamp_ns not in window:  # so that no message precedes the origin
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


def simulate(
    scenario_path: PathLike,
    out_dir: PathLike,
    *,
    seed: int | None = None,
    start_s: float = 0.0,
    duration_s: float | None = None,
    images: bool = True,
    progress: Report = silent,
) -> dict[str, object]:
    """Fly a scenario and write the files NAMES to ``out_dir``; a seed gives the same bytes.

    ``start_s`` and ``duration_s`` cut only bags and observations. Without ``images`` there are no
    pictures or clicks. Return a summary. Raise ScenarioError, BagError, SurveyError.
    """
    outputs = [Path(out_dir) / name for name in (*NAMES, "dem.asc", "dem.prj")]
    check_outputs([scenario_path], outputs, ScenarioError)
    scenario = load_scenario(scenario_path)
    window, camera = _window(scenario, scenario_path, start_s, duration_s), scenario.video.camera
    flight = fly(scenario, seed)
    park, relief = lay_out(scenario.park, flight.seed), Relief(scenario.park)
    points, clicks = surveyed(flight, camera, park)
    clicks = [click for click in clicks if click.stamp_ns in window]
    targets = targets_of(scenario, flight.seed)
    route_p = flight.truth.position_p[flight.truth.t_s >= flight.trajectory.begin_s]
    lowest_m = -float(route_p[:, 2].max(initial=-math.inf))
    if relief.highest_m > lowest_m - _CLEAR_M:
        raise ScenarioError(
            f"park: the ground rises to {relief.highest_m:.1f} m, and the flight is as low as "
            f"{lowest_m:.1f} m: fly {_CLEAR_M:g} m above the ground, or reduce park.slope_deg"
        )
    folder = made_folder(out_dir, ScenarioError)
    texts = {
        "map.geojson": map_text(park, flight.plane, relief),
        "targets.geojson": targets_text(targets, flight.plane, relief),
        "params.yaml": parameters_text(scenario),
    }
    if scenario.park.slope_deg:
        texts |= {"dem.asc": elevation_text(relief, flight.plane), "dem.prj": WGS84_TEXT}
    write_files({folder / name: text for name, text in texts.items()}, ScenarioError)
    save_survey(folder / "survey.geojson", points)
    save_observations(folder / "observations.csv", clicks)
    messages = Messages()
    truth = _true_body(messages, flight, window), _true_camera(messages, flight)
    _write(folder / "truth.mcap", truth, window, silent)
    infos = (
        (stamp_ns, "thermal/camera_info", messages.camera_info(camera, stamp_ns))
        for stamp_ns, _ in frames(flight)
    )
    streams = [_sensed(messages, flight), infos]
    if images:
        streams.append(_pictures(messages, flight, window, park, targets))
        streams.append(_clicked(messages, flight, window, targets))
    counts = _write(folder / "flight.mcap", streams, window, progress)
    return {
        "folder": str(folder),
        "scenario": scenario.name,
        "seed": flight.seed,
        "duration_s": (len(window) - 1) / 1e9,
        "control_points": len(points),
        "observations": len(clicks),
        "targets": len(targets),
        "messages": counts,
        "bytes": {name: (folder / name).stat().st_size for name in NAMES},
    }


def _window(scenario: Scenario, path: PathLike, start_s: float, duration_s: float | None) -> range:
    """Return the range of written log times (ns). Raise ScenarioError outside the flight."""
    if duration_s is None:
        duration_s = scenario.duration_s - start_s
    end_s = start_s + duration_s
    if not (start_s >= 0 and duration_s > 0 and end_s <= scenario.duration_s + 1e-9):  # nor nan
        raise ScenarioError(
            f"{path}: {duration_s:g} s from {start_s:g} s on are not within the flight of "
            f"{scenario.duration_s:g} s; change the start or the duration"
        )
    start_ns = scenario.start_ns + round(start_s * 1e9)
    return range(start_ns, start_ns + round(duration_s * 1e9) + 1)


def parameters_text(scenario: Scenario) -> str:
    """Return a ROS 2 parameter file: the aircraft for all nodes, then each node's own part."""
    site, order = scenario.site, scenario.gimbal.joint_order
    noise = values_of(scenario.imu.noise).items()
    imu = {name: plain(value) for name, value in noise if name not in _PRIORS}
    joints: dict[str, object] = {} if order == USUAL_ORDER else {"joint_order": order}
    straight = not any(scenario.gimbal.boresight_rpy_deg)
    # For sloping ground the user gives --dem.
    ground = {} if scenario.park.slope_deg else {"ground_height_m": site.ground_height_m}
    undulation = {"geoid_undulation_m": site.geoid_undulation_m}
    places = values_of(scenario.aircraft).items()
    nodes: dict[str, dict[str, object]] = {
        # An empty list has no type in a parameter file.
        "/**": {"aircraft": {name: plain(value) for name, value in places if value != ()}},
        "/**/dji_node": {
            **undulation,
            "rtk": {"delay_s": scenario.rtk.arrival_delay_s},
            "delay": {"gps_s": scenario.gps.arrival_delay_s},
        },
        "/**/ekf_node": {
            "origin_lat_lon_h": [site.latitude_deg, site.longitude_deg, site.ground_height_m],
            "imu": imu,
        },
        "/**/gimbal_node": joints | ({"boresight_rpy_deg": [0.0] * 3} if straight else {}),
        "/**/overlay_node": {**ground, "video_latency_s": scenario.video.latency_s},
        "/**/bag_player": {"simulated_aircraft": {**undulation, **joints}},
    }
    tree = {pattern: {"ros__parameters": values} for pattern, values in nodes.items() if values}
    body: str = yaml.safe_dump(tree, sort_keys=False, default_flow_style=None, width=95)
    return _HEAD.format(name=scenario.name) + body
