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
"""Give one aircraft's state to the operator's page, pass on clicks, find places in its video."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from rclpy.qos import QoSProfile
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from tirgeo_ros.core.camera.projection_covariance import CHI2_95, ellipse_95
from tirgeo_ros.core.checks.navigation_checks import nearest_causes
from tirgeo_ros.core.frames.rotations import matrix_from_quat, quat_from_matrix
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Terrain
from tirgeo_ros.core.ground.frame_geometry import Sight
from tirgeo_ros.core.ground.ground_point import Answer
from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus
from tirgeo_ros.io.messages import TOPIC_TYPES, answer_of, body_pose, finding_row, stamp_ns
from tirgeo_ros.io.messages.topics import IMAGE_DEPTH
from tirgeo_ros.nodes.aircraft_topics import (
    ODOMETRY,
    POSE,
    AircraftTopics,
    Reports,
    places_n,
)
from tirgeo_ros.nodes.graph_node import GraphNode, Output, latched, output

CLEAN, SHAPES = "tirgeo/overlay/clean/compressed", "tirgeo/overlay/shapes"
_MOST_HALVES = 8  # pictures, or shapes, that wait for their other half
#: Silence (s) of a needed stream, or time without a map, that ends GO; faultless time for GO.
_SILENT_S, _GOOD_S = 1.0, 2.0
#: Silence (s) from which an earlier stream or an input may be the cause that a stream has ended.
_ALSO_SILENT_S = 0.5
#: A node that has not reported for so long (s), which it does each second, does not answer.
_ANSWER_S = 1.6
#: Longest step (s) that counts as silence: in a longer one this node itself did not run.
_STEP_S = 0.4
Place = list[float]  # latitude, longitude (deg)
#: Largest age (s) of the last pose for a picture that was drawn with a predicted pose.
_LAST_POSE_S = 0.2
#: Least time between markers: those of 2000 targets take 0.4 s of processor time.
_MARKERS_S = 2.0
_DIGITS = 8  # of degrees: a millimetre
_NO_POSITION: Mapping[str, None] = dict.fromkeys(
    ("stamp_ns", "position", "heading_deg", "position_sigma_m", "speed_m_s", "above_ground_m")
)
_COLOUR = ColorRGBA(r=1.0, g=0.3, b=1.0, a=0.6)
_TEXT_HEIGHT_M = 1.0
_LEAST_AXIS_M = 2e-3  # RViz warns of a scale of zero
_RADIUS = math.sqrt(CHI2_95)  # semi-axis of the 95 % ellipse, in sigmas
#: Inputs of the nodes: topic -> its words for the operator; and the words for overlay_node.
_CAMERA = {"thermal/image_raw": "The camera", "thermal/image_raw/compressed": "The camera"}
_GIMBAL = {"gimbal/joint_states": "The gimbal", "gimbal/attitude": "The gimbal"}
_INFO = {"thermal/camera_info": "The camera's calibration"}
_OVERLAY = "overlay_node", "The overlay program"


class Verdict(NamedTuple):
    """Hold a verdict for the page: ``text`` is for the operator, ``more`` for the engineer.

    ``kind`` names its subject, and stays the same while the text counts seconds.
    """

    word: str
    tone: str  # good, caution, bad, or empty
    kind: str = ""
    text: str = ""
    more: str = ""
    alarm: bool = False


class Stream(NamedTuple):
    """Name a topic that is needed, the node that publishes it, and that node's inputs."""

    topic: str
    kind: str
    node: str
    program: str
    inputs: dict[str, str]  # topic -> words; the first topic that the node has received counts


#: Each stream depends on those before it.
STREAMS = (
    Stream("tirgeo/odometry", "position", "ekf_node", "The filter", {"imu/data": "The IMU"}),
    Stream("tirgeo/camera_pose", "camera pose", "gimbal_node", "The gimbal program", _GIMBAL),
    Stream(CLEAN, "picture", *_OVERLAY, _CAMERA),
    Stream("tirgeo/overlay/camera_info", "calibration", *_OVERLAY, _INFO),
)
_GO = Verdict("GO", "good")
_CHECKS = {
    None: Verdict("NO DATA", "caution", "checks", "No check has reported"),
    Severity.CAUTION: Verdict("CAUTION", "caution", "checks"),
    Severity.STOP: Verdict("NO GO", "bad", "checks"),
}


class Judge:
    """Judge one aircraft at each call of ``look``, by a steady clock.

    ``came_s`` returns when the newest message of a topic came; None without one.
    """

    def __init__(self, reports: Reports, came_s: Callable[[str], float | None]) -> None:
        self._reports, self._newest_s = reports, came_s
        self._now_s = math.inf  # of the last look
        self._came_s: dict[str, float] = {}  # topic -> when its newest message came
        self._silence_s = dict.fromkeys((stream.topic for stream in STREAMS), 0.0)
        self._no_map_s = self._good_s = 0.0
        self._shown = Verdict("NO DATA", "")

    def look(self, now_s: float, worst: Severity | None, no_map: str) -> Verdict:
        """Return the verdict.

        ``worst`` is the worst severity of the checks' findings, None while no check reports;
        ``no_map`` is the notice in the picture.
        """
        step_s = min(max(now_s - self._now_s, 0.0), _STEP_S)
        self._now_s = now_s
        for topic in self._silence_s:
            self._count(topic, self._newest_s(topic), step_s)
        navigation = navigation_verdict(self._reports.navigation(now_s)[0])
        upstream = self._upstream(navigation)
        self._no_map_s = self._no_map_s + step_s if no_map and not upstream else 0.0
        verdict = upstream or self._downstream(_CHECKS.get(worst), no_map) or navigation or _GO
        self._good_s = self._good_s + step_s if verdict == _GO else 0.0
        if verdict != _GO or self._good_s >= _GOOD_S:
            self._shown = verdict
        return self._shown

    def _count(self, topic: str, at_s: float | None, step_s: float) -> None:
        """Add up how long a topic is silent while this node listens; None counts as silent."""
        if at_s is None or at_s == self._came_s.get(topic):
            self._silence_s[topic] += step_s
        else:
            self._came_s[topic], self._silence_s[topic] = at_s, min(self._now_s - at_s, step_s)

    def _silent(self, stream: Stream, limit_s: float) -> bool:
        """Return whether a stream is silent for longer than the limit, or has not begun."""
        return stream.topic not in self._came_s or self._silence_s[stream.topic] > limit_s

    def _upstream(self, navigation: Verdict | None) -> Verdict | None:
        """Return the first fault on the way from the sensors to the picture."""
        odometry, pose, picture, _ = STREAMS
        no_position = navigation if navigation and navigation.word != "CAUTION" else None
        if no_position or self._silent(odometry, _SILENT_S):
            self._silence_s[pose.topic] = 0.0  # without a position no camera pose can come
        # Streams with one cause do not end at one instant: the first in the order is blamed.
        ended = any(self._silent(stream, _SILENT_S) for stream in (odometry, pose, picture))
        limit_s = _ALSO_SILENT_S if ended else _SILENT_S
        if self._silent(odometry, limit_s):
            return self._no_data(odometry, no_position)
        silent = [stream for stream in (pose, picture) if self._silent(stream, limit_s)]
        return no_position or (self._no_data(silent[0]) if silent else None)

    def _downstream(self, checks: Verdict | None, no_map: str) -> Verdict | None:
        """Return what is wrong although all streams come; a caution of the checks comes last."""
        if checks and checks.word != "CAUTION":
            return checks
        if self._no_map_s > _SILENT_S:
            return Verdict("NO GO", "bad", "map", no_map, alarm=True)
        calibration = STREAMS[-1]  # one message of it is enough
        if not no_map and self._silent(calibration, math.inf):
            return self._no_data(calibration)
        return checks

    def _no_data(self, stream: Stream, otherwise: Verdict | None = None) -> Verdict:
        """Return the verdict on a silent stream and its cause; ``otherwise`` if none is known."""
        silence_s, began = self._silence_s[stream.topic], stream.topic in self._came_s
        cause = self._cause(stream, silence_s)
        if cause is None and otherwise is not None:
            return otherwise
        text, name, for_s = cause or (f"No {stream.kind}", stream.topic, silence_s)
        more = f"{name} silent for {for_s:.0f} s"
        return Verdict("NO DATA", "bad" if began else "caution", stream.kind, text, more, began)

    def _cause(self, stream: Stream, silence_s: float) -> tuple[str, str, float] | None:
        """Return the silent node or input: words, name and seconds; None if none is silent."""
        then_s, state = self._reports.state(stream.node)
        ago_s = self._now_s - then_s
        if min(ago_s, silence_s) >= _ANSWER_S:
            return f"{stream.program} does not answer", stream.node, min(ago_s, silence_s)
        ages = {name: input_.age_s for name, input_ in state.topics.items()} if state else {}
        topic = next((topic for topic in stream.inputs if ages.get(topic) is not None), "")
        age_s = ages.get(topic)
        if age_s is None or age_s <= _ALSO_SILENT_S:
            return None
        return f"{stream.inputs[topic]} is silent for {age_s + ago_s:.0f} s", topic, age_s + ago_s


def navigation_verdict(status: NavigationStatus | None) -> Verdict | None:
    """Return the verdict on the filter by its own status; None while it runs well."""
    if status is None:
        return Verdict("NO DATA", "caution", "position", "The filter has not reported", "ekf_node")
    if status.state is FilterState.RUNNING:
        return None
    if status.state is FilterState.LOST or status.began_again:
        return Verdict("LOST", "bad", "position", status.for_operator, status.reason, alarm=True)
    word = "CAUTION" if status.state.navigating else "WAIT"
    return Verdict(word, "caution", "position", status.for_operator, status.reason)


class PicturePairs:
    """Join pictures with the shapes of the same stamp; ``show`` takes stamp, JPEG and shapes.

    A half whose other one does not come is forgotten when newer ones have come.
    """

    def __init__(self, show: Callable[[int, bytes, bytes], None]) -> None:
        self._show = show
        self._pictures, self._shapes = dict[int, bytes](), dict[int, bytes]()

    def take_picture(self, stamp: int, jpeg: bytes) -> None:
        """Take a picture: its stamp (ns) and its JPEG."""
        self._take(stamp, jpeg, self._pictures)

    def take_shapes(self, stamp: int, shapes: bytes) -> None:
        """Take what is drawn on the picture of a stamp (ns)."""
        self._take(stamp, shapes, self._shapes)

    def _take(self, stamp: int, half: bytes, halves: dict[int, bytes]) -> None:
        halves[stamp] = half
        if stamp in self._pictures and stamp in self._shapes:
            self._show(stamp, self._pictures.pop(stamp), self._shapes.pop(stamp))
        while len(halves) > _MOST_HALVES:
            del halves[next(iter(halves))]


class AircraftView(AircraftTopics):
    """Give the page the state of one aircraft; ``answered`` takes the answers to clicks."""

    def __init__(
        self,
        node: GraphNode,
        aircraft: str,
        terrain: Terrain | None,
        show: Callable[[int, bytes, bytes], None],
        answered: Callable[[Answer], None],
    ) -> None:
        self._pairs = PicturePairs(show)
        super().__init__(node, aircraft, terrain, self._pairs.take_picture, CLEAN)
        take_shapes = self._pairs.take_shapes
        self.listen(SHAPES, lambda m: take_shapes(stamp_ns(m), bytes(m.data)), output(IMAGE_DEPTH))
        self._track, self._sent = list[Place](), list[Place]()
        self.listen("tirgeo/path", self._take_path, output(1))
        now_s, take = time.monotonic, self.reports.take_findings
        self.listen("tirgeo/findings", lambda message: take(now_s(), message), output(10))
        self.listen("tirgeo/locate/answer", lambda m: answered(answer_of(m)), output())
        self._pixel = self._advertise("tirgeo/locate/pixel", output())
        self.targets = self._advertise("tirgeo/targets", latched())
        self._markers = self._advertise("tirgeo/targets/markers", latched())
        self._judge = Judge(self.reports, self.came_s)
        self._marked: tuple[object, ...] = ()  # revision of the targets, plane and frame
        self._marked_s = -math.inf

    def _advertise(self, topic: str, qos: QoSProfile) -> Output:
        return self._node.advertise(f"{self._prefix}{topic}", qos, TOPIC_TYPES[topic])

    def mark(self, targets: Sequence[Target], revision: int) -> None:
        """Show these targets in RViz while it listens, unless it shows them in this plane."""
        marked, now_s = (revision, self.plane, self.map_frame), time.monotonic()
        soon = now_s - self._marked_s < _MARKERS_S
        if self.plane is None or soon or marked == self._marked or not self._markers.is_wanted:
            return
        self._markers.publish(target_markers(self.map_frame, self.plane, targets))
        self._marked, self._marked_s = marked, now_s

    def _take_path(self, message: Any) -> None:
        if self.plane is not None:
            points_n = places_n(pose.pose.position for pose in message.poses)
            self._track = places(points_n, self.plane)

    def click(self, stamp: int, u: float, v: float) -> bool:
        """Publish a click; return whether anybody subscribes to clicks."""
        self._pixel.publish(self._node.messages.pixel(stamp, u, v))
        return self._pixel.is_wanted

    def state(self, more_findings: Sequence[Finding]) -> dict[str, Any]:
        """Return the page's state of this aircraft, without ``recording`` and ``sharing``."""
        now_s, plane = time.monotonic(), self.plane
        footprint_n, odometry = self.footprint_n(), self.newest(ODOMETRY)
        state: dict[str, Any] = dict(_NO_POSITION)
        if plane and odometry is not None:
            state |= position_fields(odometry, plane, footprint_n)
        state |= navigation_fields(self.reports, now_s)
        sent, self._sent = self._sent, self._track
        state |= track_fields(sent, self._sent)
        state["footprint"] = places(footprint_n, plane) if plane else []
        state |= self._verdict_fields(now_s, more_findings)
        streams = {"video": CLEAN, "pose": ODOMETRY, "camera": POSE}
        ages = {name: self.age_s(topic) for name, topic in streams.items()}
        state["ages_s"] = ages | {"rtk": self.reports.input_age_s("ekf_node", "rtk/fix", now_s)}
        video = self._node.monitor.topics().get(f"{self._prefix}{CLEAN}")
        return state | {"video_hz": video.rate_hz if video else 0.0}

    def _verdict_fields(self, now_s: float, more: Sequence[Finding]) -> dict[str, Any]:
        reported, picture = self.reports.findings(now_s), self.reports.picture(now_s)
        no_map = picture.notice if picture else None
        findings = sorted(
            nearest_causes([*(reported or ()), *more]), key=lambda finding: -finding.severity
        )
        worst = max((finding.severity for finding in findings), default=Severity.NOTE)
        verdict = self._judge.look(now_s, None if reported is None else worst, no_map or "")
        rows = [finding_row(finding) for finding in findings]
        fields = {"verdict": verdict._asdict(), "no_map": no_map, "findings": rows}
        if verdict.kind == "position" and verdict.word == "NO DATA":
            fields |= dict.fromkeys(("rtk", "heading_sigma_deg"))  # their values are out of date
        return fields

    def where(self, latitude_rad: float, longitude_rad: float) -> tuple[int, float, float] | str:
        """Return stamp, column and row of a place in the newest picture, or why it isn't there.

        The place lies on the elevation model, or on the level ground of the picture's footprint.
        """
        stamp = self.newest_ns
        sight = self.sight(stamp, last_pose_s=_LAST_POSE_S)
        if sight is None:
            return "the newest picture has no trusted pose"
        place, ground = (latitude_rad, longitude_rad), sight.ground
        height_m = ground if isinstance(ground, float) else float(ground.height_m(*place))
        if math.isnan(height_m):
            return "the height of the ground there is not known: set dem of viewer_node"
        uv = pixel_of(sight, sight.plane.ned_from_geodetic(*place, height_m))
        return (stamp, *uv) if uv else "it is outside the picture"


def navigation_fields(reports: Reports, now_s: float) -> dict[str, Any]:
    """Return state, reason, RTK and the heading's sigma; a silent estimator counts as lost."""
    status, has_reported = reports.navigation(now_s)
    if status is None:
        reason, state = "ekf_node does not report", "lost" if has_reported else "waiting"
        silent = dict.fromkeys(("rtk", "heading_sigma_deg"))
        return {"navigation": {"state": state, "reason": reason}, **silent}
    return {
        "navigation": {"state": status.state.value, "reason": status.reason},
        "rtk": status.rtk_status.name.lower(),
        "heading_sigma_deg": math.degrees(status.heading_sigma_rad),
    }


def position_fields(odometry: Any, plane: TangentPlane, footprint_n: Array) -> dict[str, Any]:
    """Return the aircraft's position and motion from ``nav_msgs/Odometry``, as the page's fields.

    The height above ground is that above the middle of the footprint (N, 3), NED in the plane.
    """
    pose = body_pose(odometry)
    latitude, longitude, height_m = (float(x) for x in plane.geodetic_from_ned(pose.position_n))
    rotation, v_n = matrix_from_quat(pose.q_nb), velocity_n(odometry)
    down_m = float(np.median(footprint_n[:, 2])) if len(footprint_n) else math.nan
    semi_axes, _ = ellipse_95(pose.covariance[:2, :2])
    return {
        "stamp_ns": str(pose.stamp_ns),
        "position": [*_degrees(latitude, longitude), round(height_m, 3)],
        "heading_deg": math.degrees(math.atan2(rotation[1, 0], rotation[0, 0])) % 360,
        "position_sigma_m": float(semi_axes[0, 0]) / _RADIUS,
        "speed_m_s": float(np.hypot(v_n[0], v_n[1])),
        "above_ground_m": down_m - float(pose.position_n[2]),
    }


def velocity_n(odometry: Any) -> Array:
    """Return the velocity (3,), NED in the plane, m/s, from ``nav_msgs/Odometry``."""
    linear = odometry.twist.twist.linear
    body = np.array([linear.x, -linear.y, -linear.z])
    return np.asarray(matrix_from_quat(body_pose(odometry).q_nb) @ body)


def track_fields(sent: list[Place], track: list[Place]) -> dict[str, Any]:
    """Return the points of a track from the first that differs from ``sent``, and its index."""
    same = len(sent)
    while same and sent[same - 1 : same] != track[same - 1 : same]:
        same -= 1
    return {"track": track[same:], "track_from": same}


def places(points_n: Array, plane: TangentPlane) -> list[Place]:
    """Return latitude and longitude (deg) of points (N, 3), NED in the plane."""
    latitude, longitude, _ = plane.geodetic_from_ned(points_n)
    return [_degrees(*place) for place in zip(latitude.tolist(), longitude.tolist(), strict=True)]


def _degrees(latitude_rad: float, longitude_rad: float) -> Place:
    return [round(math.degrees(angle), _DIGITS) for angle in (latitude_rad, longitude_rad)]


def pixel_of(sight: Sight, point_n: Array) -> tuple[float, float] | None:
    """Return column and row of a point (3,), NED, in a picture; None outside it."""
    offset_n, camera = point_n - sight.pose.position_n, sight.camera
    uv, visible = camera.project(offset_n[None] @ matrix_from_quat(sight.pose.q_nc))
    u, v = uv[0].tolist()
    inside = visible[0] and -0.5 <= u < camera.width - 0.5 and -0.5 <= v < camera.height - 0.5
    return (u, v) if inside else None


def target_markers(map_frame: str, plane: TangentPlane, targets: Sequence[Target]) -> MarkerArray:
    """Return the markers of all targets, placed in the map's plane.

    The first one deletes all others. For each target there is an ellipsoid, whose projection onto
    the ground is the 95 % ellipse, and its label as text. Their stamp is zero, for which RViz
    takes the newest transform.
    """
    header = Header(frame_id=map_frame)
    markers = [Marker(header=header, action=Marker.DELETEALL)]
    for number, target in enumerate(targets, 1):
        own = {"header": header, "id": number, "text": target.label, "color": _COLOUR}
        place = target.place
        geodetic = place.latitude_rad, place.longitude_rad, place.height_m
        north, east, down = plane.ned_from_geodetic(*geodetic).tolist()
        lengths, turn = _ellipsoid(np.reshape(place.covariance_enu, (3, 3)))
        pose = Pose(position=Point(x=east, y=north, z=-down), orientation=turn)
        markers.append(Marker(ns="targets", type=Marker.SPHERE, pose=pose, scale=lengths, **own))
        above = Pose(position=Point(x=east, y=north, z=_TEXT_HEIGHT_M - down))
        size = Vector3(z=_TEXT_HEIGHT_M)
        kind = Marker.TEXT_VIEW_FACING
        markers.append(Marker(ns="labels", type=kind, pose=above, scale=size, **own))
    return MarkerArray(markers=markers)


def _ellipsoid(covariance: Array) -> tuple[Vector3, Quaternion]:
    """Return axis lengths (m) and attitude of the 95 % ellipsoid of a covariance (3, 3)."""
    variances, axes = np.linalg.eigh(covariance)
    axes[:, 2] *= np.sign(np.linalg.det(axes))  # right-handed
    lengths_m = 2 * _RADIUS * np.sqrt(np.maximum(variances, 0.0))
    x, y, z = np.maximum(lengths_m, _LEAST_AXIS_M).tolist()
    turn = dict(zip("wxyz", quat_from_matrix(axes).tolist(), strict=True))
    return Vector3(x=x, y=y, z=z), Quaternion(**turn)
