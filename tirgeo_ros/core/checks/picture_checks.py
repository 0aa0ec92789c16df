"""Check the set-up with pictures, lens, camera poses and ground together."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
from typing import Any

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.checks.height_checks import HeightChecks, ground_parameter
from tirgeo_ros.core.checks.motion_findings import motion_findings
from tirgeo_ros.core.checks.parameter_checks import lens_findings
from tirgeo_ros.core.checks.picture_motion import PictureMotion
from tirgeo_ros.core.checks.picture_tracks import PictureTracker
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.streams.sanity_checks import pose_fault
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.poses import CameraPose

_, CAUTION, STOP = Severity
_TOPIC = "thermal/image_raw"
_KEPT = 3000  # the newest frames
_FEWEST = 20  # frames before anything is reported
_SHARE = 0.1  # of the frames: a fault that is more frequent is reported
#: Limits of a stamp's differences: from its arrival, and from the newest pose's stamp.
_AHEAD_S, _LATE_S, _APART_S = 0.1, 1.0, 2.0
_CLOCK = "use one clock for camera and aircraft"
#: For each fault: severity, evidence and mend.
_FAULTS = {
    "picture_stamps_zero": (
        CAUTION,
        "{count} of {frames} pictures have no stamp",
        "let the driver stamp them; until then video_latency_s must include the time to arrival",
    ),
    "picture_stamps_ahead": (
        CAUTION,
        "stamps of pictures are {mean} s ahead of their arrival",
        f"{_CLOCK}, and stamp at the exposure",
    ),
    "picture_stamps_late": (
        CAUTION,
        "stamps of pictures are {mean} s behind their arrival",
        f"{_CLOCK}, and stamp at the exposure",
    ),
    "picture_clock": (
        STOP,
        "pictures are stamped {mean} s ahead of the camera's poses (negative: behind)",
        f"{_CLOCK}; no map is drawn on such pictures",
    ),
    "picture_stamps_back": (
        CAUTION,
        "{count} of {frames} stamps of pictures do not grow",
        "check that only one driver sends pictures, each once and in order",
    ),
}


class FrameStamps:
    """Check the stamps of frames."""

    def __init__(self) -> None:
        self._pose_ns = 0  # stamp of the newest pose since the last frame, or 0
        # of each frame: its stamp, its arrival and that pose, ns; 0 where unknown
        self._frames: deque[tuple[int, int, int]] = deque(maxlen=_KEPT)

    def pose(self, stamp_ns: int) -> None:
        """Take the stamp of a camera pose."""
        self._pose_ns = stamp_ns

    def frame(self, stamp_ns: int, arrival_ns: int) -> None:
        """Take a frame's stamp and its arrival time.

        An arrival time of 0 means unknown, because a clock that is played with a bag is 0 until
        its first message.
        """
        self._frames.append((stamp_ns, arrival_ns, self._pose_ns))
        self._pose_ns = 0  # compare only with a pose that came since the last frame

    def findings(self) -> list[Finding]:
        """Return the findings so far."""
        found = []
        if len(self._frames) < _FEWEST:
            return []
        stamps, arrivals, poses = np.array(self._frames, np.int64).T
        known = stamps != 0
        early = (stamps - arrivals) * 1e-9 * (known & (arrivals != 0))
        apart = (stamps - poses) * 1e-9 * (known & (poses != 0))
        steps = np.diff(stamps[known]) * 1e-9
        for check, off_s, wrong in (
            ("picture_stamps_zero", stamps * 1e-9, ~known),
            ("picture_stamps_ahead", early, early > _AHEAD_S),
            ("picture_stamps_late", -early, -early > _LATE_S),
            ("picture_clock", apart, np.abs(apart) > _APART_S),
            ("picture_stamps_back", steps, steps <= 0),
        ):
            if wrong.any() and wrong.mean() > _SHARE:
                severity, text, mend = _FAULTS[check]
                mean = f"{off_s[wrong].mean():.2f}"
                evidence = text.format(count=wrong.sum(), frames=len(stamps), mean=mean)
                found.append(Finding(check, severity, evidence, _TOPIC, mend))
        return found


class PictureChecks:
    """Take frames and poses as the overlay gets them; return findings at any time.

    ``ground`` is what lies under the map, None if nothing gives it. ``given`` are the parameters
    of overlay_node that were set explicitly, None if not known. A frame costs 3 ms two or three
    times a second, and almost nothing otherwise; a fit, every eight seconds, 20 to 60 ms, and
    0.2 s of pictures that fit nothing.
    """

    def __init__(
        self,
        config: OverlayConfig,
        ground: Ground | None,
        given: Collection[str] | None = None,
    ) -> None:
        self._latency_s = config.video_latency_s
        self._default = given is not None and "video_latency_s" not in given
        self._lens = "overlay_node camera" if config.camera else "thermal/camera_info"
        self._ground = ground_parameter(ground)
        self._camera: Camera | None = None
        self._heights = HeightChecks(ground)
        self._stamps = FrameStamps()
        self._tracker = PictureTracker()
        self._motion = PictureMotion(config.video_latency_s, ground)
        self._size: tuple[int, int] | None = None  # of a picture that does not fit the lens

    def configure(self, config: OverlayConfig) -> None:
        """Take other parameters; the evidence against a former latency is forgotten."""
        if config.video_latency_s != self._latency_s:
            self._latency_s, self._default = config.video_latency_s, False
            self._motion.set_latency(self._latency_s)

    def camera(self, camera: Camera) -> None:
        """Set the calibration."""
        if camera != self._camera:
            self._camera = self._motion.camera = camera
            self._motion.forget()
            self._size = None

    def plane(self, plane: TangentPlane) -> None:
        """Set the plane of the poses."""
        if plane != self._motion.plane:
            self._motion.plane = self._heights.plane = plane
            self._motion.forget()

    def pose(self, pose: CameraPose) -> None:
        """Take a camera pose, in order of time."""
        self._stamps.pose(pose.stamp_ns)
        is_due = self._camera is not None or self._heights.is_due(pose.stamp_ns)
        if is_due and not pose_fault(pose.position_n, pose.q_nc, pose.covariance):
            self._heights.pose(pose)
            self._motion.pose(pose)

    def wants_pixels(self, stamp_ns: int, arrival_ns: int) -> bool:
        """Return whether a frame's pixels are needed; for the others call ``passed``."""
        return self._tracker.wants(stamp_ns or arrival_ns)

    def passed(self, stamp_ns: int, arrival_ns: int) -> None:
        """Take a frame of which only the stamp is known."""
        self._stamps.frame(stamp_ns, arrival_ns)

    def frame(self, stamp_ns: int, pixels: npt.NDArray[Any], arrival_ns: int) -> None:
        """Take a frame (h, w) uint8 or uint16, or (h, w, 3) uint8."""
        height, width = pixels.shape[:2]
        self._stamps.frame(stamp_ns, arrival_ns)
        camera = self._camera
        if camera is not None and (width, height) != (camera.width, camera.height):
            self._size = width, height
            return
        tracks = self._tracker.take(stamp_ns or arrival_ns, pixels)
        if tracks is not None:
            self._motion.tracks(tracks)

    def findings(self) -> list[Finding]:
        """Return the findings so far."""
        found = [*self._heights.findings(), *self._stamps.findings()]
        if self._camera is not None:
            found += self._lens_findings(self._camera)
        if self._default and self._tracker.pairs:
            evidence = f"latency of the video at its default, {self._latency_s:g} s"
            where = "overlay_node video_latency_s"
            mend = "measure it with tirgeo calibrate boresight, and set it"
            found.append(Finding("latency_default", Severity.NOTE, evidence, where, mend))
        return found

    def _lens_findings(self, camera: Camera) -> list[Finding]:
        found = lens_findings(camera, self._lens, self._size)
        fit = self._motion.fit()
        if fit is not None:
            ground = self._ground if self._motion.knows_ground else ""
            found += motion_findings(fit, self._latency_s, camera.fx, self._lens, ground)
        return found
