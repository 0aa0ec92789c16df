"""Register a flight for its products: the poses of its pictures, and what lies below them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import Miss, PoseBuffer
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.finding import stop_line
from tirgeo_ros.core.types.poses import BodyPose, CameraPose
from tirgeo_ros.core.types.verdicts import Verdict
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.parameters.parameter_file import Files
from tirgeo_ros.io.pictures.camera_file import given_camera
from tirgeo_ros.tools.export.flight_pictures import Chosen
from tirgeo_ros.tools.presentation.progress import Report
from tirgeo_ros.tools.replay.finding_lines import finding_items
from tirgeo_ros.tools.replay.flight_checks import FlightChecks
from tirgeo_ros.tools.replay.flight_poses import FlightPoses, RecordedFlight
from tirgeo_ros.tools.replay.node_configs import NodeConfigs
from tirgeo_ros.tools.replay.registration import Registered, Sample

_WHY_NOT = {
    Miss.EMPTY: "no pose near the exposure",
    Miss.TOO_OLD: "before the first pose",
    Miss.TOO_NEW: "after the last pose",
    Miss.GAP: "no pose near the exposure",
}


class Posed(NamedTuple):
    """Hold the poses at a picture's exposure."""

    stamp_ns: int  # of the picture's header
    pose: CameraPose
    body: BodyPose


class RegisteredFlight(NamedTuple):
    """Hold a flight whose pictures have poses, at least one of them."""

    camera: Camera
    plane: TangentPlane
    ground: Ground | None
    posed: Mapping[int, Posed]  # by the picture's number
    refused: Counter[str]  # pictures without a trusted pose, by reason
    states: Mapping[int, str]  # of the filter, by the exposures (ns)
    summary: Mapping[str, object]
    no_go: str | None  # the worst STOP of the checks


def register(
    reader: BagReader,
    configs: NodeConfigs,
    params: Files,
    namespace: str,
    chosen: Sequence[Chosen],
    progress: Report,
    *,
    smooth: bool = False,
) -> RegisteredFlight:
    """Read the flight once, and check it on the way.

    Raise BagError if no chosen picture has a pose; CameraError, ElevationError.
    """
    fitted, notes = configs.fitting(reader, namespace)
    ekf, gimbal, overlay, _ = fitted
    ground, camera = ground_of(overlay), given_camera(overlay)
    of_flight = (fitted, reader, params, namespace)
    checks = FlightChecks(*of_flight, ground=ground, camera=camera, pictures=True)
    recorded = RecordedFlight(reader, namespace, pictures=True, camera=camera, checks=checks)
    latency_ns = round(overlay.video_latency_s * 1e9)
    exposures_ns = [one.stamp_ns - latency_ns for one in chosen]
    bodies = _BodyPoses(exposures_ns)
    flight = recorded.registered(ekf, gimbal, exposures_ns, bodies, smooth=smooth)
    bodies.flight = flight
    flight.checks = checks
    recorded.read_all(progress)
    posed, refused = _posed(flight, bodies, chosen, latency_ns)
    navigation = flight.registration.navigation.status()
    if not posed or flight.plane is None:
        why = ", ".join(refused) or "none was recorded then (--from, --to)"
        state = f"; the filter is {navigation.state.value} at the end"
        one = f"{reader.path}: none of {len(chosen)} pictures has a trusted pose: {why}{state}"
        raise BagError(one)
    findings = checks.findings()
    summary = {
        "method": navigation.method,
        "composition": flight.registration.composer.composition,
        "state": navigation.state.value,
        "smoothed": smooth,
        "findings": finding_items(findings),
        "notes": [*notes, *(ground.notes if isinstance(ground, Terrain) else ())],
    }
    known = recorded.camera, flight.plane, ground
    return RegisteredFlight(*known, posed, refused, bodies.states, summary, stop_line(findings))


def _posed(
    flight: FlightPoses, bodies: _BodyPoses, chosen: Sequence[Chosen], latency_ns: int
) -> tuple[dict[int, Posed], Counter[str]]:
    """Return the pictures that have poses, and the number of the others by reason."""
    posed: dict[int, Posed] = {}
    refused: Counter[str] = Counter()
    for number, stamp_ns in chosen:
        pose, body = flight.cameras.at(stamp_ns - latency_ns), bodies.at(stamp_ns - latency_ns)
        if isinstance(pose, Miss) or isinstance(body, Miss):
            miss = pose if isinstance(pose, Miss) else body
            refused[_WHY_NOT[miss]] += 1  # type: ignore[index]
        else:
            posed[number] = Posed(stamp_ns, pose, body)
    return posed, refused


class _BodyPoses:
    """Keep the aircraft's poses at some instants (ns); a Watcher of a registration."""

    def __init__(self, instants_ns: Sequence[int]) -> None:
        self._waiting = sorted(instants_ns, reverse=True)
        self._recent: PoseBuffer[BodyPose] = PoseBuffer()
        self._found: dict[int, BodyPose | Miss] = {}
        self.flight: FlightPoses | None = None
        self.states: dict[int, str] = {}

    def heard(self, verdict: Verdict) -> None:
        """Ignore a verdict."""

    def took(self, _sample: Sample, found: Registered) -> None:
        """Take a new pose, and keep those at the instants before it."""
        if found.body is None or not self._recent.add(found.body):
            return
        while self._waiting and self._waiting[-1] <= found.body.stamp_ns:
            instant_ns = self._waiting.pop()
            self._found[instant_ns] = self._recent.at(instant_ns)
            if self.flight is not None:
                status = self.flight.registration.navigation.status()
                self.states[instant_ns] = status.state.value

    def at(self, instant_ns: int) -> BodyPose | Miss:
        """Return the pose at an instant, or why there was none."""
        return self._found.get(instant_ns, Miss.TOO_NEW)
