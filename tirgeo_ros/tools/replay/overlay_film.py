"""Write the overlay's pictures as a video file, with metadata where the file takes them."""

from __future__ import annotations

from collections.abc import Callable

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.gimbal.pose_buffer import Miss
from tirgeo_ros.core.ground.frame_geometry import Sight
from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.core.overlay.picture_painter import Unpainted
from tirgeo_ros.core.types.arrays import Pixels
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

    def packet(self, picture: Unpainted, body_at: Callable[[int], BodyPose | Miss]) -> bytes:
        """Return a picture's metadata; ``body_at`` gives the aircraft's pose at an instant."""
        if not self._video.takes_metadata:
            return b""
        sight = self._sight(picture, body_at)
        return self._metadata.packet(picture.stamp_ns - self._latency_ns, sight)

    def add(self, stamp_ns: int, image: Pixels, packet: bytes) -> None:
        """Append a finished picture (h, w, 3) BGR with its metadata."""
        self._video.add(stamp_ns, image, packet)

    def _sight(
        self, picture: Unpainted, body_at: Callable[[int], BodyPose | Miss]
    ) -> Sight | None:
        """Return what is known of a picture; None without a trusted pose."""
        camera, pose, plane = picture.camera, picture.pose, self._overlay.plane
        if camera is None or pose is None or plane is None:
            return None
        body = body_at(pose.stamp_ns)
        known = None if isinstance(body, Miss) else body
        return Sight(camera, pose, plane, self._overlay.ground, known, picture.rates)
