"""Write what overlay_node publishes of pictures, and keep the order of all that is written.

A picture may come out later than what follows it. Then what follows waits for it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.gimbal.pose_buffer import Miss
from tirgeo_ros.core.ground.frame_geometry import Sight
from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.core.overlay.picture_painter import Unpainted
from tirgeo_ros.core.streams.stamps import RateLimit
from tirgeo_ros.core.types.arrays import Pixels
from tirgeo_ros.core.types.poses import BodyPose
from tirgeo_ros.io.messages import Messages
from tirgeo_ros.io.video.frame_metadata import FrameMetadata
from tirgeo_ros.io.video.video_file import VideoFile
from tirgeo_ros.tools.replay.picture_stage import PictureStage

#: Messages that may wait for pictures: some 10 s without a picture, a few MB.
_MOST_WAITING = 4096

#: Write a message to a contract topic: topic, message, log time (ns).
Write = Callable[[str, object, int], None]


class _Message(NamedTuple):
    topic: str
    message: object
    log_time_ns: int


class _Picture(NamedTuple):
    stamp_ns: int
    camera: Camera | None
    packet: bytes  # metadata of the video
    log_time_ns: int


class PictureOutputs:
    """Draw pictures, and write all messages in the order in which they were put or added."""

    def __init__(
        self,
        stage: PictureStage,
        messages: Messages,
        write: Write,
        film: OverlayFilm | None,
        footprint_rate_hz: float,
        *,
        raw_images: bool,
    ) -> None:
        self._stage, self._messages, self._write, self._film = stage, messages, write, film
        self._footprint_rate = RateLimit(footprint_rate_hz)
        self._raw_images = raw_images
        self._waiting: deque[_Message | _Picture] = deque()  # the first one is a picture
        self._under_way = 0

    def put(self, topic: str, message: object, log_time_ns: int) -> None:
        """Write a message after all that were put, and pictures that were added, before."""
        if not self._waiting:
            self._write(topic, message, log_time_ns)
            return
        self._waiting.append(_Message(topic, message, log_time_ns))
        if len(self._waiting) > _MOST_WAITING:
            self._receive()

    def add(
        self,
        picture: Unpainted,
        overlay: Overlay,
        body_at: Callable[[int], BodyPose | Miss],
        log_time_ns: int,
    ) -> None:
        """Draw a picture of an overlay; ``body_at`` gives the aircraft's pose at an instant."""
        due = self._footprint_rate.due(picture.stamp_ns)
        packet = self._film.packet(picture, body_at) if self._film is not None else b""
        self._stage.send(picture, overlay.scene, with_outline=due)
        self._waiting.append(_Picture(picture.stamp_ns, picture.camera, packet, log_time_ns))
        self._under_way += 1
        while self._under_way > self._stage.most_under_way:
            self._receive()

    def finish(self) -> None:
        """Write all that waits."""
        while self._under_way:
            self._receive()

    def _receive(self) -> None:
        """Write the oldest picture and the messages up to the next one."""
        oldest = self._waiting.popleft()
        assert isinstance(oldest, _Picture)
        self._under_way -= 1
        self._write_picture(oldest)
        while self._waiting and isinstance(self._waiting[0], _Message):
            self._write(*self._waiting.popleft())

    def _write_picture(self, picture: _Picture) -> None:
        """Write a finished picture, its calibration, and its footprint if that is due."""
        painted, made = self._stage.receive(), self._messages
        stamp_ns, camera, packet, log_time_ns = picture
        if self._film is not None and painted.image is not None:
            self._film.add(stamp_ns, painted.image, packet)
        jpeg = made.compressed(stamp_ns, painted.jpeg)
        self._write("tirgeo/overlay/image/compressed", jpeg, log_time_ns)
        if self._raw_images and painted.image is not None:
            self._write("tirgeo/overlay/image", made.image(stamp_ns, painted.image), log_time_ns)
        if camera is not None:
            info = made.camera_info(camera, stamp_ns)
            self._write("tirgeo/overlay/camera_info", info, log_time_ns)
        if painted.outline_n is not None:
            outline = made.footprint(stamp_ns, painted.outline_n)
            self._write("tirgeo/footprint", outline, log_time_ns)


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
