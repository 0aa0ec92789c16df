"""The pictures of a recorded flight as ``ExportFrame``s, without the verb that makes products."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import NamedTuple

from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.types.poses import BodyPose
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.bags.cdr import header_stamp_ns
from tirgeo_ros.tools.export.export_frame import ExportFrame
from tirgeo_ros.tools.replay.flight_poses import WHOLE_FLIGHT_S, RecordedFlight
from tirgeo_ros.tools.replay.node_configs import node_configs

_TOPIC = "thermal/image_raw/compressed"
GROUND_M = 11.5
UNDULATION_M = -9.0


class Exported(NamedTuple):
    """The frames of a flight, the stamps of all its pictures, the filter's state at an instant."""

    frames: list[ExportFrame]
    stamps_ns: list[int]
    states: dict[int, str]  # by the body's stamps

    def state_at(self, stamp_ns: int) -> str:
        return self.states[max(one for one in self.states if one <= stamp_ns)]


class _Bodies:
    """Keeps the aircraft's poses, and the filter's states."""

    def __init__(self) -> None:
        self.poses: PoseBuffer[BodyPose] = PoseBuffer(WHOLE_FLIGHT_S)
        self.states: dict[int, str] = {}
        self.navigation = None

    def heard(self, _verdict) -> None:
        pass

    def took(self, _sample, found) -> None:
        if found.body is not None:
            self.poses.add(found.body)
            self.states[found.body.stamp_ns] = self.navigation.status().state.value


@cache
def exported(folder: Path) -> Exported:
    """The sample flight: pictures before the alignment have no pose and are left out."""
    reader = BagReader(folder / "flight.mcap")
    configs, _ = node_configs(folder / "params.yaml").fitting(reader, "")
    latency_ns = round(configs.overlay.video_latency_s * 1e9)
    pictures = list(reader.messages([f"/{_TOPIC}"]))
    stamps_ns = [header_stamp_ns(one.data) for one in pictures]
    flight, bodies = RecordedFlight(reader), _Bodies()
    instants_ns = [one - latency_ns for one in stamps_ns]
    poses = flight.registered(configs.ekf, configs.gimbal, instants_ns, bodies)
    bodies.navigation = poses.registration.navigation
    flight.read_all(lambda *_: None)
    cdr, camera, frames = Cdr(), flight.camera, []
    for number, (message, stamp_ns) in enumerate(zip(pictures, stamps_ns, strict=True)):
        at = poses.at(stamp_ns - latency_ns)
        body = bodies.poses.at(stamp_ns - latency_ns)
        if at is None or not isinstance(body, BodyPose):
            continue
        pixels = convert.pixels(_TOPIC, cdr.deserialize(message.data, message.typename))
        seen = (pixels, camera, at[0], body, poses.plane, GROUND_M)
        frames.append(ExportFrame(number, stamp_ns, *seen))
    return Exported(frames, stamps_ns, bodies.states)
