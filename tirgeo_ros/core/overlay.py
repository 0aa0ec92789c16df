"""The map on the video: each frame waits for the camera's pose at its exposure, then is drawn on.

No line is drawn that cannot be trusted. Where there is no camera, no origin, or no pose on both
sides of the exposure, the picture carries a plain notice in the lines' place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tirgeo_ros.core.camera import Camera
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frame_queue import Frame, FrameQueue
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.map_drawing import MapDrawing
from tirgeo_ros.core.map_layers import MapLayer
from tirgeo_ros.core.painting import coloured, paint_notice, paint_status
from tirgeo_ros.core.pose_history import Miss, PoseHistory
from tirgeo_ros.core.samples import CameraPose, NavigationStatus
from tirgeo_ros.core.status_line import status_line, words_of
from tirgeo_ros.core.text import Pixels

_MARGIN_S = 1.0  # poses are kept this much longer than the oldest exposure asks for


@dataclass(frozen=True, slots=True)
class OverlayResult:
    """One finished picture."""

    stamp_ns: int  # of the frame
    image: Pixels  # (h, w, 3) BGR
    pose: CameraPose | None  # at the exposure; None where nothing was drawn
    notice: str  # why nothing was drawn, else empty
    camera: Camera | None = None  # of the picture as it is shown; None where it is unknown
    predicted_s: float = 0.0  # by how much the pose is a prediction


class Overlay:
    """Frames and poses in, pictures out. Raises ConfigError if the map's heights are unknown."""

    def __init__(self, config: OverlayConfig, layers: Sequence[MapLayer]) -> None:
        self._latency_ns = round(config.video_latency_s * 1e9)
        self._wait_ns = round(config.max_pose_wait_s * 1e9)
        self._drawing = MapDrawing(config, layers)
        self._frames = FrameQueue()
        kept_s = max(config.video_latency_s, 0.0) + config.max_pose_wait_s + _MARGIN_S
        self._poses: PoseHistory[CameraPose] = PoseHistory(span_s=kept_s)
        self._plane: TangentPlane | None = None
        self._status: NavigationStatus | None = None
        self._results = {"drawn": 0, "notices": 0}

    @property
    def counts(self) -> dict[str, int]:
        """What became of the frames and the poses, for diagnostics."""
        poses = {
            "poses_invalid": self._poses.invalid,
            "poses_went_back": self._poses.went_back,
        }
        return self._results | self._frames.counts | poses

    def set_plane(self, plane: TangentPlane) -> None:
        """The map's plane. Poses in another plane are forgotten."""
        if plane != self._plane:
            self._plane = plane
            self._poses.clear()
            self._drawing.set_plane(plane)

    def set_camera(self, camera: Camera) -> None:
        """The camera's calibration."""
        self._drawing.set_camera(camera)

    def set_layers(self, layers: Sequence[MapLayer]) -> None:
        """Another map. Raises ConfigError, and keeps the present one, if heights are unknown."""
        self._drawing.set_layers(layers)

    def set_status(self, status: NavigationStatus) -> None:
        """What the estimator says of itself, for the status line and the notices."""
        self._status = status

    def add_pose(self, pose: CameraPose) -> None:
        """A pose of the camera, in order of time; one that is not finite is counted."""
        self._poses.add(pose)

    def add_frame(self, stamp_ns: int, pixels: Pixels, now_ns: int) -> None:
        """A frame (h, w) or (h, w, 3) BGR uint8. It takes the place of one that still waits."""
        self._frames.put(Frame(stamp_ns, pixels, now_ns))

    def take(self, now_ns: int) -> OverlayResult | None:
        """The waiting frame's picture, or None while it waits for a pose or there is none."""
        frame = self._frames.waiting
        if frame is None:
            return None
        exposure_ns = frame.stamp_ns - self._latency_ns
        pose = self._poses.at(exposure_ns)
        obstacle = self._obstacle(frame.pixels)
        if not obstacle and isinstance(pose, Miss):
            if pose in {Miss.EMPTY, Miss.TOO_NEW} and self._may_wait(frame, now_ns):
                return None
            obstacle = self._why_no_pose(pose, exposure_ns)
        self._frames.clear()
        if obstacle or isinstance(pose, Miss):
            return self._without_map(frame, now_ns, obstacle)
        return self._with_map(frame, now_ns, pose)

    def _may_wait(self, frame: Frame, now_ns: int) -> bool:
        # A clock that went back would keep the frame for ever.
        return 0 <= now_ns - frame.arrival_ns < self._wait_ns

    def _obstacle(self, pixels: Pixels) -> str:
        """Why no pose could help, else empty."""
        if self._drawing.empty:
            return "no map is given"
        if self._drawing.view is None:
            return "no camera info"
        camera = self._drawing.view.camera
        height, width = pixels.shape[:2]
        if (width, height) != (camera.width, camera.height):
            return f"image is {width}x{height}, camera info {camera.width}x{camera.height}"
        return "" if self._drawing.map else self._not_navigating() or "no origin"

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

    def _without_map(self, frame: Frame, now_ns: int, obstacle: str) -> OverlayResult:
        self._results["notices"] += 1
        notice = f"NO MAP: {obstacle}"
        image = coloured(frame.pixels)
        paint_notice(image, notice)
        self._paint_status(image, frame, now_ns)
        return OverlayResult(frame.stamp_ns, image, None, notice)

    def _with_map(self, frame: Frame, now_ns: int, pose: CameraPose) -> OverlayResult:
        self._results["drawn"] += 1
        image = coloured(frame.pixels)
        self._drawing.draw(image, pose)
        self._paint_status(image, frame, now_ns)
        return OverlayResult(frame.stamp_ns, image, pose, "")

    def _paint_status(self, image: Pixels, frame: Frame, now_ns: int) -> None:
        age_s = (now_ns - frame.stamp_ns) * 1e-9
        paint_status(image, status_line(self._status, age_s, self._frames.rate_hz))
