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
"""Check a recorded flight's set-up and sensors: the work of ``tirgeo check``."""

from __future__ import annotations

import math
import os
from collections import Counter

import numpy as np

from tirgeo_ros.core.checks.finding_table import finding
from tirgeo_ros.core.navigation.estimator.filter_status import MOST_GPS_SIGMAS
from tirgeo_ros.core.types.finding import Finding, sorted_findings, stop_line
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.parameters.parameter_file import Files
from tirgeo_ros.io.pictures.camera_file import configured_camera
from tirgeo_ros.tools.convert.direct_input import NO_OPTIONS
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.presentation.results import finding_items, tally_line
from tirgeo_ros.tools.replay.flight import Flight, FlightPoses
from tirgeo_ros.tools.replay.flight_checks import FlightChecks, try_load
from tirgeo_ros.tools.replay.node_configs import configured_layers, open_flight
from tirgeo_ros.tools.replay.picture_overlaps import PictureOverlaps
from tirgeo_ros.tools.replay.registration import SAMPLES, Registered, Sample, biases_of

#: Pictures of other headings disagree if the median of so many pairs is so many standard
#: deviations. Flights without an error reached 2.4.
_LEAST_PAIRS, _MOST_SIGMAS = 3, 3.0


def check(
    bag: PathLike,
    *,
    params: Files = None,
    map: PathLike | None = None,  # noqa: A002 the option's name
    dem: PathLike | None = None,
    ground_height: float | None = None,
    camera: PathLike | None = None,
    namespace: str = "",
    logs: LogOptions = NO_OPTIONS,
    progress: Report = silent,
) -> dict[str, object]:
    """Run a bag through filter, gimbal and all checks, and return findings and numbers.

    ``error`` is the verdict if it is NO GO, else None. A map, an elevation model or a calibration
    that cannot be read is a finding. Raise BagError and ConfigError.
    """
    options = {"map": map, "dem": dem, "ground_height": ground_height, "camera": camera}
    opened = open_flight(bag, (), params, namespace, options, logs=logs, progress=progress)
    reader, configs, overlay = opened.reader, opened.configs, opened.configs.overlay
    findings: list[Finding] = []
    ground = try_load(findings, "dem", lambda: ground_of(overlay))
    lens = try_load(findings, "camera", lambda: configured_camera(overlay))
    layers = try_load(findings, "map", lambda: configured_layers(overlay))
    checks = FlightChecks(opened, ground=ground, layers=layers, camera=lens, pictures=True)
    wanted = {"pictures": True, "needs_camera": False, "all_pixels": True}
    flight = Flight(reader, namespace, camera=lens, checks=checks, **wanted)
    counts: Counter[str] = Counter()

    def count(_sample: Sample, registered: Registered) -> None:
        counts["solutions"] += registered.solution is not None

    overlaps, watchers = PictureOverlaps(reader, namespace, overlay, ground), [checks.watch, count]
    poses = FlightPoses(configs.ekf, configs.gimbal, SAMPLES, overlaps.instants_ns, watchers)
    flight.add_poses(poses)
    flight.read_all(progress)
    if reader.damage is not None:
        findings.append(finding("damaged_bag", damage=reader.damage))
    findings += checks.findings()
    disagreement = overlaps.disagreement(flight, poses)
    turned = disagreement.get("other_headings", {"pairs": 0})
    if turned["pairs"] >= _LEAST_PAIRS and turned["sigmas"] > _MOST_SIGMAS:
        findings.append(finding("pictures_disagree", **turned))
    status = poses.registration.navigation.status()
    if late := status.late_imu(configs.ekf.imu.delay_s):
        findings.append(finding("imu_late", **late))
    if status.gps_sigmas > MOST_GPS_SIGMAS:
        findings.append(finding("gps_contradiction", sigmas=status.gps_sigmas))
    if not counts["solutions"] and stop_line(findings) is None:
        state = f"{status.state.value}{': ' if status.reason else ''}{status.reason}"
        findings.append(finding("no_pose", state=state, method=status.method))
    findings = sorted_findings(findings)
    return {
        "input": os.fspath(bag),
        "verdict": tally_line(findings),
        "findings": finding_items(findings),
        "checked": _numbers(reader, poses, checks) | {"disagreement": disagreement},
        "notes": opened.notes,
        "error": stop_line(findings),
    }


def _numbers(reader: BagReader, poses: FlightPoses, checks: FlightChecks) -> dict[str, object]:
    """Return numbers of the flight and its topics, and the set-up that was checked."""
    registration = poses.registration
    status = registration.navigation.status()
    first_ns, last_ns = reader.span_ns
    topics: dict[str, object] = {}
    for topic, arrivals_ns in sorted(checks.arrivals_ns.items()):
        steps_s = np.diff(arrivals_ns) * 1e-9
        span_s = float(steps_s.sum())
        topics[topic] = {
            "messages": len(arrivals_ns),
            "rate_hz": len(steps_s) / span_s if span_s > 0 else None,
            "longest_gap_s": float(steps_s.max(initial=0.0)),
        }
    return {
        "duration_s": (last_ns - first_ns) * 1e-9,
        "topics": topics,
        "method": status.method,
        "state": status.state.value,
        "imu": biases_of(registration.navigation),
        "heading_sigma_deg": math.degrees(status.heading_sigma_rad),
        "imu_delay_s": status.imu_delay_s,
        "imu_delay_sigma_s": status.imu_delay_sigma_s,
        "composition": registration.composer.composition,
        "picture_size": checks.picture_size,
    }
