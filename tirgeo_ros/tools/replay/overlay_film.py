"""Write the overlay's pictures as a video file, with metadata where the file takes them."""

from __future__ import annotations

from collections.abc import Callable

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.gimbal.pose_buffer import Miss
from tirgeo_ros.core.ground.frame_geometry import Sight
from tirgeo_ros.core.overlay.camera_motion import rates_up_to
from tirgeo_ros.core.overlay.overlay import Overlay, OverlayResult
from tirgeo_ros.core.types.poses import BodyPose
from tirgeo_ros.io.video.frame_metadata import FrameMetadata
from tirgeo_ros.io.video.video_file import VideoFile


class OverlayFilm:
    """Append finished pictures to a video file.

    Heights above sea level are in its metadata if ``undulation_m`` is not nan.
    """

    def __init__(
        self, video: VideoFile, overlay: Overlay, config: OverlayConfig, undulation_m: float
    ) -> None:
        self._video, self._overlay = video, overlay
        self._latency_ns = round(config.video_latency_s * 1e9)
        self._metadata = FrameMetadata(config.confidence, undulation_m)

    @property
    def described(self) -> dict[str, object]:
        """Return the number of pictures and their mean rate."""
        return {"frames": self._video.frames, "rate_hz": self._video.rate_hz}

    def add(self, result: OverlayResult, body_at: Callable[[int], BodyPose | Miss]) -> None:
        """Append a picture; ``body_at`` gives the aircraft's pose at an instant."""
        packet = b""
        if self._video.takes_metadata:
            sight = self._sight(result, body_at)
            packet = self._metadata.packet(result.stamp_ns - self._latency_ns, sight)
        self._video.add(result.stamp_ns, result.image, packet)

    def _sight(
        self, result: OverlayResult, body_at: Callable[[int], BodyPose | Miss]
    ) -> Sight | None:
        """Return what is known of a picture; None without a trusted pose."""
        camera, pose, plane = result.camera, result.pose, self._overlay.plane
        if camera is None or pose is None or plane is None:
            return None
        body = body_at(pose.stamp_ns)
        rates = rates_up_to(pose, self._overlay.poses)
        known = None if isinstance(body, Miss) else body
        return Sight(camera, pose, plane, self._overlay.ground, known, rates)
