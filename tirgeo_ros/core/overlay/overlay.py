"""The map on the video: each frame waits for the camera's pose at its exposure, then is drawn on.

No line is drawn that cannot be trusted. Where there is no camera, no origin, or no pose on both
sides of the exposure and none that can be predicted, the picture carries a plain notice in the
lines' place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from tirgeo_ros.core.camera.model import Camera
from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.camera.rectification import Rectifier
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import Miss, PoseHistory
from tirgeo_ros.core.gimbal.pose_extrapolation import FIT_S, TRIAL_S, predicted
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.map.layers import MapLayer
from tirgeo_ros.core.overlay.clicks import Clicks
from tirgeo_ros.core.overlay.frame_queue import Frame, FrameQueue
from tirgeo_ros.core.overlay.map_renderer import LaidMap, MapDrawing, Verdict
from tirgeo_ros.core.overlay.status_text import VERDICT_BGR, status_line, words_of
from tirgeo_ros.core.overlay.text_boxes import paint_notice, paint_status, place_notice
from tirgeo_ros.core.overlay.tone_mapping import Toner
from tirgeo_ros.core.types.arrays import Pixels, RawPixels
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.core.types.verdicts import NavigationStatus

_MARGIN_S = 1.0  # poses are kept this much longer than the oldest exposure asks for
_READING, _FAILED = "reading", "its reading failed"
_RATES_NS = 100_000_000  # over which the camera's motion is taken: short of a turn, beyond noise


@dataclass(frozen=True, slots=True)
class OverlayResult:
    """One finished picture."""

    stamp_ns: int  # of the frame
    image: Pixels  # (h, w, 3) BGR
    pose: CameraPose | None  # at the exposure; None where nothing was drawn
    notice: str  # why nothing was drawn, or nothing is in view; else empty
    camera: Camera | None = None  # of the picture as it is shown; None where it is unknown
    predicted_s: float = 0.0  # by how much the pose is a prediction


class Overlay:
    """Frames and poses in, pictures out. Raises ConfigError if the map's heights are unknown.

    ``layers`` are laid here as soon as the plane is known, which takes a second or two of a large
    map; with None the map is laid elsewhere, for each plane anew, and given to ``set_map``.
    ``clicks`` locates on the pictures that were given out.
    """

    def __init__(
        self,
        config: OverlayConfig,
        layers: Sequence[MapLayer] | None,
        terrain: Terrain | None = None,
    ) -> None:
        self._latency_ns = round(config.video_latency_s * 1e9)
        self._wait_ns = round(config.max_pose_wait_s * 1e9)
        self._prediction_ns = round(config.max_prediction_s * 1e9)
        self._drawing = MapDrawing(config, layers or (), terrain)
        self._laid_elsewhere = layers is None
        given = layers is None or len(layers) > 0
        self._no_map = "the map has no features" if given else "no map is given"
        self._lacking = _READING if layers is None else ""  # why a map from elsewhere is not here
        self.clicks = Clicks(config.confidence)
        self.clicks.set_ground(self._drawing.ground)
        self._toner = Toner(config.picture, config.palette)
        self._frames = FrameQueue()
        kept_s = max(config.video_latency_s, 0.0) + config.max_pose_wait_s + _MARGIN_S
        self._poses: PoseHistory[CameraPose] = PoseHistory(span_s=kept_s)
        self._plane: TangentPlane | None = None
        self._camera: Camera | None = None
        self._rectify = config.rectify
        self._rectifier: Rectifier | None = None
        self._status: NavigationStatus | None = None
        self._verdict = Verdict()
        self._results = {"drawn": 0, "predicted": 0, "notices": 0, "late": 0}

    @property
    def counts(self) -> dict[str, int]:
        """What became of the frames and the poses, for diagnostics.

        Frames: those of FrameQueue; ``drawn`` have lines, of which ``predicted`` with a predicted
        pose; ``notices`` have none; of both, ``late`` came out no sooner than the wait for a pose
        may last. Poses: ``poses_invalid`` and ``poses_went_back``.
        """
        poses = {
            "poses_invalid": self._poses.invalid,
            "poses_went_back": self._poses.went_back,
        }
        return self._results | self._frames.counts | poses

    @property
    def pose_fault(self) -> str:
        """Why the newest pose that was refused was; empty where none was."""
        return self._poses.fault

    @property
    def waiting(self) -> int:
        """How many frames wait for a pose, or to be taken."""
        return len(self._frames)

    @property
    def deadlines_ns(self) -> list[int]:
        """Until when, by the caller's clock, each waiting frame waits at most; oldest first."""
        return [frame.arrival_ns + self._wait_ns for frame in self._frames][::-1]

    @property
    def notes(self) -> tuple[str, ...]:
        """What a person should be told of the map as it lies on the ground."""
        return self._drawing.map.notes if self._drawing.map else ()

    @property
    def no_map_yet(self) -> str:
        """Why the map is not drawn that is laid elsewhere; empty where it is, or has no plane."""
        return self._lacking if self._plane else ""

    @property
    def rate_hz(self) -> float:
        """Of the frames, by their stamps; nan with less than two."""
        return self._frames.rate_hz

    def set_plane(self, plane: TangentPlane) -> None:
        """The map's plane. Poses in another plane are forgotten."""
        if plane != self._plane:
            self._plane = plane
            self._poses.clear()
            self._drawing.set_plane(plane)
            self._lacking = _READING if self._laid_elsewhere else ""
            self.clicks.set_plane(plane)

    def set_camera(self, camera: Camera) -> None:
        """The camera's calibration. Raises CameraError where its pictures cannot be rectified."""
        if camera != self._camera:
            self._rectifier = Rectifier(camera) if self._rectify else None
            self._camera = camera
            self._drawing.set_camera(self._rectifier.camera if self._rectifier else camera)

    @property
    def plane(self) -> TangentPlane | None:
        """The map's plane, once it is known."""
        return self._plane

    @property
    def laid(self) -> LaidMap | None:
        """Return the map as it lies in the plane, once both are known."""
        return self._drawing.laid

    def set_map(self, new: LaidMap) -> None:
        """Draw a map that was laid elsewhere from here on; one in another plane is refused."""
        if new.plane == self._plane:
            self._laid_elsewhere, self._lacking = True, ""
            self._drawing.set_map(new)

    def map_failed(self) -> None:
        """The map that is laid elsewhere will not come; one that is drawn stays."""
        self._lacking = self._lacking and _FAILED

    def set_status(self, status: NavigationStatus) -> None:
        """What the estimator says of itself, for the status line and the notices."""
        self._status = status

    def set_verdict(self, verdict: Verdict) -> None:
        """What the checks say of the set-up, for the notice above and the status line."""
        self._verdict = verdict

    def add_pose(self, pose: CameraPose) -> None:
        """A pose of the camera, in order of time; one that is not finite is counted."""
        self._poses.add(pose)

    def add_frame(self, stamp_ns: int, pixels: RawPixels, now_ns: int) -> None:
        """A frame (h, w) uint8 or uint16, or (h, w, 3) BGR uint8; ``now_ns`` as in ``take``."""
        self._frames.put(Frame(stamp_ns, pixels, now_ns))

    def take(self, now_ns: int) -> OverlayResult | None:
        """The newest picture that need not wait any more; None where all wait, or none is there.

        Older frames give way to it. ``now_ns`` is the caller's clock, that of the stamps.
        """
        for frame in self._frames:
            pose = self._poses.at(frame.stamp_ns - self._latency_ns)
            obstacle = self._obstacle(frame.pixels)
            if obstacle or not self._waits(frame, pose, now_ns):
                self._frames.take(frame)
                self._results["late"] += now_ns - frame.arrival_ns >= self._wait_ns
                return self._finished(frame, now_ns, pose, obstacle)
        return None

    def _waits(self, frame: Frame, pose: CameraPose | Miss, now_ns: int) -> bool:
        may_come = pose is Miss.EMPTY or pose is Miss.TOO_NEW
        return may_come and self._may_wait(frame, now_ns)

    def _may_wait(self, frame: Frame, now_ns: int) -> bool:
        # A clock that went back would keep the frame for ever.
        return 0 <= now_ns - frame.arrival_ns < self._wait_ns

    def _obstacle(self, pixels: RawPixels) -> str:
        """Why no pose could help, else empty."""
        if self._drawing.empty and not self._lacking:
            return self._no_map
        camera = self._camera
        if camera is None:
            return "no camera info"
        height, width = pixels.shape[:2]
        if (width, height) != (camera.width, camera.height):
            return f"image is {width}x{height}, camera info {camera.width}x{camera.height}"
        if self._plane is None:
            return self._not_navigating() or "no origin"
        return self._lacking

    def _why_no_pose(self, miss: Miss, exposure_ns: int) -> str:
        newest_ns = self._poses.newest_ns
        if miss is Miss.TOO_NEW and newest_ns is not None:
            return self._not_navigating() or f"pose {(exposure_ns - newest_ns) / 1e9:.1f} s old"
        if miss is Miss.GAP:
            return self._not_navigating() or "camera poses are missing"
        return self._not_navigating() or "no pose at this frame"

    def _not_navigating(self) -> str:
        """What the estimator says of its silence, if it does not navigate."""
        if self._status is None or self._status.state.navigating:
            return ""
        reason = f": {self._status.reason}" if self._status.reason else ""
        return f"{words_of(self._status.state)}{reason}"

    def _finished(
        self, frame: Frame, now_ns: int, pose: CameraPose | Miss, obstacle: str
    ) -> OverlayResult:
        exposure_ns, predicted_s = frame.stamp_ns - self._latency_ns, 0.0
        if not obstacle and pose is Miss.TOO_NEW:
            pose, predicted_s = self._predicted(exposure_ns)
        if not obstacle and isinstance(pose, Miss):
            obstacle = self._why_no_pose(pose, exposure_ns)
        image = self._picture(frame)
        if obstacle or isinstance(pose, Miss):
            return self._without_map(frame, image, now_ns, obstacle)
        return self._with_map(frame, image, now_ns, pose, predicted_s)

    def _predicted(self, exposure_ns: int) -> tuple[CameraPose | Miss, float]:
        """A pose that goes on from the last ones, and by how much; a Miss where that is too far.

        Where the estimator says that it is silent with reason, nothing is predicted.
        """
        ahead_ns = exposure_ns - (self._poses.newest_ns or 0)
        if ahead_ns > self._prediction_ns or self._not_navigating():
            return Miss.TOO_NEW, 0.0
        latest = self._poses.latest(FIT_S + TRIAL_S)
        pose = predicted(latest, exposure_ns, self._poses.max_gap_s)
        return (pose, ahead_ns * 1e-9) if pose is not None else (Miss.TOO_NEW, 0.0)

    def _picture(self, frame: Frame) -> Pixels:
        """In colour, and rectified where it is of the camera's size."""
        image = self._toner.tone(frame.pixels, frame.stamp_ns)
        fits = self._camera and image.shape[:2] == (self._camera.height, self._camera.width)
        return self._rectifier.rectified(image) if self._rectifier and fits else image

    def _without_map(
        self, frame: Frame, image: Pixels, now_ns: int, obstacle: str
    ) -> OverlayResult:
        self._results["notices"] += 1
        notice = f"NO MAP YET: {obstacle}" if obstacle == _READING else f"NO MAP: {obstacle}"
        paint_notice(image, notice, self._paint_verdict(image))
        self._paint_status(image, frame, now_ns)
        camera = self._drawing.camera
        if camera is not None:
            self.clicks.show(frame.stamp_ns, camera, None)
        return OverlayResult(frame.stamp_ns, image, None, notice, camera)

    def _with_map(
        self, frame: Frame, image: Pixels, now_ns: int, pose: CameraPose, predicted_s: float
    ) -> OverlayResult:
        camera = self._drawing.camera
        assert camera is not None
        self._results["drawn"] += 1
        self._results["predicted"] += predicted_s > 0
        rates = self._rates(pose)
        self.clicks.show(frame.stamp_ns, camera, pose, rates)
        markers = self.clicks.markers()
        drawn = self._drawing.draw(image, pose, rates, markers, self._verdict)
        self._paint_status(image, frame, now_ns, predicted_s, drawn.above_m)
        notice = f"NO MAP IN VIEW: {drawn.absence}" if drawn.absence else ""
        return OverlayResult(frame.stamp_ns, image, pose, notice, camera, predicted_s)

    def _paint_verdict(self, image: Pixels) -> int:
        """The row under it."""
        severity, words = self._verdict
        if not severity:
            return 0
        notice = place_notice(image, words, VERDICT_BGR[severity])
        notice.paint(image)
        return notice.box.bottom

    def _rates(self, pose: CameraPose) -> CameraRates | None:
        """The camera's motion up to a pose; None where it is not known."""
        before = self._poses.at(pose.stamp_ns - _RATES_NS)
        return None if isinstance(before, Miss) else CameraRates.between(before, pose)

    def _paint_status(
        self,
        image: Pixels,
        frame: Frame,
        now_ns: int,
        predicted_s: float = 0.0,
        above_m: float = math.nan,
    ) -> None:
        age_s = (now_ns - frame.stamp_ns) * 1e-9
        dropped = self._frames.counts["replaced"]
        rate_hz = self._frames.rate_hz
        fields = status_line(
            self._status, age_s, rate_hz, predicted_s, dropped, above_m, self._verdict.severity
        )
        paint_status(image, fields)
