"""Run messages of a flight through the whole node graph, in log-time order.

This is ``tirgeo process`` without its files: the core objects of ekf_node, gimbal_node and
overlay_node, with the conversions that those nodes use. The log time of an output is that of the
input that caused it.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.core.streams.arrival_stamps import Arrivals
from tirgeo_ros.core.streams.rates import RateLimit
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.messages import DiagnosticItem, Messages
from tirgeo_ros.tools.replay.flight_checks import FlightChecks
from tirgeo_ros.tools.replay.flight_topics import CAMERA_INFO, prefix
from tirgeo_ros.tools.replay.node_configs import NodeConfigs
from tirgeo_ros.tools.replay.registration import SAMPLES, Registered, Registration

DIAGNOSTICS_PERIOD_NS = 1_000_000_000


class Pipeline:
    """Run the chain from sensor messages to overlay, and count messages that cannot be read."""

    def __init__(
        self,
        configs: NodeConfigs,
        overlay: Overlay | None,
        types: Callable[[str], type],
        write: Callable[[str, object, int], None],
        film: Callable[[int, npt.NDArray[np.uint8]], None] | None,
        namespace: str,
        checks: FlightChecks,
        *,
        raw_images: bool = False,
    ) -> None:
        """Set up the chain.

        ``types`` returns the class of a message type, as for ``Messages``. ``write`` takes an
        output's topic of the contract, message and log time (ns), ``film`` the stamp (ns) and the
        pixels (h, w, 3) BGR of an overlay picture. ``checks`` get all inputs and outputs, and
        change nothing of them.
        """
        self.registration = Registration(configs.ekf, configs.gimbal)
        self.overlay = overlay
        self.unreadable: Counter[str] = Counter()
        self.unreadable_because: dict[str, str] = {}  # the newest reason
        self.states_s: Counter[str] = Counter()
        self.arrivals = Arrivals()
        self._fix_rate = RateLimit(configs.ekf.fix_rate_hz)
        self._jpeg_quality, self._raw_images = configs.overlay.jpeg_quality, raw_images
        self._checks = checks
        self._messages = Messages(types)
        self._write, self._film = write, film
        self._names = prefix(namespace)
        self._plane: TangentPlane | None = None
        self._diagnosed_ns: int | None = None

    def wants(self, topic: str) -> bool:
        """Return whether a message of a topic can still change an output."""
        return topic != "gimbal/attitude" or self.registration.composer.composition == "paper"

    def look_at(self, topic: str, message: Any, log_time_ns: int) -> None:
        """Pass a message that ``wants`` refuses to the checks."""
        with contextlib.suppress(TirgeoError):
            self._checks.sample(topic, SAMPLES[topic](message), log_time_ns)

    def take(self, topic: str, message: Any, log_time_ns: int) -> None:
        """Process a message of a contract topic; count one that cannot be used."""
        found: Registered | None = None
        try:
            if topic in SAMPLES:
                sample = SAMPLES[topic](message)
                self._checks.sample(topic, sample, log_time_ns)
                stamped = self.arrivals.stamped(topic, sample, log_time_ns)
                found = self.registration.take(stamped)
            elif topic == "tirgeo/locate/pixel":
                self._locate(message, log_time_ns)
            else:
                self._picture(topic, message, log_time_ns)
        except TirgeoError as error:
            self.unreadable[topic] += 1
            self.unreadable_because[topic] = str(error)
            self._checks.refused(topic, str(error))
        if found is not None:
            self._publish(found, log_time_ns)
        self._draw(log_time_ns, log_time_ns)
        if self._diagnosed_ns is None:
            self._diagnosed_ns = log_time_ns
        late_ns = log_time_ns - self._diagnosed_ns
        if late_ns >= DIAGNOSTICS_PERIOD_NS:
            self._diagnosed_ns = log_time_ns - late_ns % DIAGNOSTICS_PERIOD_NS
            self._publish_diagnostics(log_time_ns)

    def finish(self, log_time_ns: int) -> None:
        """Output the frames that still wait for their poses, and the last diagnostics."""
        if self.overlay is not None:
            for deadline_ns in self.overlay.deadlines_ns:
                self._draw(log_time_ns, deadline_ns)
        self._publish_diagnostics(log_time_ns)

    def _locate(self, message: Any, log_time_ns: int) -> None:
        if self.overlay is None:
            return
        stamp_ns, u, v = convert.pixel(message)
        answer = self.overlay.clicks.locate((u, v), stamp_ns)
        if isinstance(answer, Located):
            self._write("tirgeo/locate/fix", self._messages.located_fix(answer), log_time_ns)
            self._write("tirgeo/locate/point", self._messages.located_point(answer), log_time_ns)

    def _publish(self, found: Registered, log_time_ns: int) -> None:
        plane = self.registration.navigation.plane
        self._checks.registered(found, plane)
        if found.solution is not None and found.body is not None:
            if plane is not None and plane != self._plane:
                self._new_plane(plane, found.body.stamp_ns, log_time_ns)
            odometry = self._messages.odometry(found.solution, found.body)
            self._write("tirgeo/odometry", odometry, log_time_ns)
            if self._fix_rate.due(found.solution.stamp_ns):
                self._write("tirgeo/fix", self._messages.fix(found.solution), log_time_ns)
        for pose in found.cameras:
            if self.overlay is not None:
                self.overlay.add_pose(pose)
            self._write("tirgeo/camera_pose", self._messages.camera_pose(pose), log_time_ns)

    def _new_plane(self, plane: TangentPlane, stamp_ns: int, log_time_ns: int) -> None:
        self._plane = plane
        self._write("tirgeo/origin", self._messages.origin(plane, stamp_ns), log_time_ns)
        if self.overlay is not None:
            self.overlay.set_plane(plane)
            if self.overlay.laid is not None:
                self._checks.map(self.overlay.laid)

    def _picture(self, topic: str, message: Any, log_time_ns: int) -> None:
        if self.overlay is None:
            return
        if topic == CAMERA_INFO:
            camera = convert.camera(message)
            self._checks.camera(camera, log_time_ns)
            self.overlay.set_camera(camera)
            return
        self.overlay.set_status(self.registration.navigation.status())
        pixels, stamp_ns = convert.pixels(topic, message), convert.stamp_ns(message)
        self._checks.frame(topic, stamp_ns, pixels, log_time_ns)
        stamp_ns = self.arrivals.stamp_ns(topic, stamp_ns, log_time_ns)
        self.overlay.add_frame(stamp_ns, pixels, log_time_ns)

    def _draw(self, log_time_ns: int, now_ns: int) -> None:
        """Output the frame, if any, that is drawn at ``now_ns``."""
        result = self.overlay.take(now_ns) if self.overlay is not None else None
        if result is None:
            return
        if self._film is not None:
            self._film(result.stamp_ns, result.image)
        quality = [cv2.IMWRITE_JPEG_QUALITY, self._jpeg_quality]
        jpeg = cv2.imencode(".jpg", result.image, quality)[1].tobytes()
        compressed = self._messages.compressed(result.stamp_ns, jpeg)
        self._write("tirgeo/overlay/image/compressed", compressed, log_time_ns)
        if self._raw_images:
            raw = self._messages.image(result.stamp_ns, result.image)
            self._write("tirgeo/overlay/image", raw, log_time_ns)

    def _publish_diagnostics(self, log_time_ns: int) -> None:
        status = self.registration.navigation.status()
        self.states_s[status.state.value] += 1
        name = f"{self._names}ekf_node: navigation"
        items = [self._messages.navigation_diagnostic(name, status)]
        items[0].values.update(self.arrivals.diagnostics)
        composer, overlay = self.registration.composer, self.overlay
        composition = f"composition: {composer.composition}"
        items.append(self._counts("gimbal_node: camera pose", composer.diagnostics, composition))
        if overlay is not None:
            clicks = {f"clicks_{name}": n for name, n in sorted(overlay.clicks.counts.items())}
            items.append(self._counts("overlay_node: overlay", overlay.counts | clicks, "ok"))
        self._write("/diagnostics", self._messages.diagnostics(log_time_ns, items), log_time_ns)

    def _counts(self, name: str, counts: Mapping[str, int | str], message: str) -> DiagnosticItem:
        values = {key: str(number) for key, number in counts.items()}
        return DiagnosticItem(self._names + name, 0, message, values)
