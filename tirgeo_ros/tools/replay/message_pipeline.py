"""Run messages of a flight through the whole node graph, in log-time order.

This is ``tirgeo process`` without its files: the core objects of ekf_node, gimbal_node and
overlay_node, with the conversions that those nodes use. The log time of an output is that of the
input that caused it.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.config import EkfConfig, GimbalConfig, OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.map.draping import Ground
from tirgeo_ros.core.map.layers import MapLayer
from tirgeo_ros.core.overlay.overlay import Overlay, OverlayResult
from tirgeo_ros.core.streams.arrival_stamps import Arrivals
from tirgeo_ros.core.streams.rates import RateLimit
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.messages import DiagnosticItem, Messages
from tirgeo_ros.tools.replay import FlightChecks
from tirgeo_ros.tools.replay.registration import SAMPLES, Registered, Registration

DIAGNOSTICS_PERIOD_NS = 1_000_000_000
#: Number of pose results that are converted to messages together. Work of one kind in a row uses
#: the processor's caches better: it takes two thirds of the time.
_BLOCK = 32
_NOTHING = Registered()


@dataclass(frozen=True)
class Settings:
    """Hold the three nodes' parameters, the map, and whether raw overlay images are wanted."""

    ekf: EkfConfig
    gimbal: GimbalConfig
    overlay: OverlayConfig
    layers: Sequence[MapLayer] | None = None  # None: no overlay
    ground: Ground | None = None  # ground under the map, if the parameters name one
    camera: Camera | None = None  # overrides thermal/camera_info
    raw_images: bool = False


class Pipeline:
    """Run the chain from sensor messages to overlay, and count messages that cannot be read."""

    def __init__(
        self,
        settings: Settings,
        types: Callable[[str], type],
        write: Callable[[str, object, int], None],
        film: Callable[[int, npt.NDArray[np.uint8]], None] | None,
        names: str,
        checks: FlightChecks,
    ) -> None:
        """Set up the chain.

        ``types`` returns the class of a message type, as for ``Messages``. ``write`` takes an
        output's topic of the contract, message and log time (ns), ``film`` the stamp (ns) and the
        pixels (h, w, 3) BGR of an overlay picture. ``names`` is the prefix of names in
        diagnostics: the namespace with a slash at both ends. ``checks`` get all inputs and
        outputs, and change nothing of them.
        """
        self.registration = Registration(settings.ekf, settings.gimbal)
        self.overlay: Overlay | None = None
        if settings.layers is not None:
            ground = settings.ground if isinstance(settings.ground, Terrain) else None
            self.overlay = Overlay(settings.overlay, settings.layers, ground)
            if settings.camera is not None:
                self.overlay.set_camera(settings.camera)
        self.unreadable: Counter[str] = Counter()
        self.unreadable_because: dict[str, str] = {}  # the newest reason
        self.states_s: Counter[str] = Counter()
        self.arrivals = Arrivals()
        self._fix_rate = RateLimit(settings.ekf.fix_rate_hz)
        self._settings = settings
        self._checks = checks
        self._messages = Messages(types)
        self._write, self._film = write, film
        self._names = names
        self._plane: TangentPlane | None = None
        self._unsent: list[tuple[Registered, int]] = []  # with log times
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
        try:
            found = self._registered(topic, message, log_time_ns)
        except TirgeoError as error:
            self.unreadable[topic] += 1
            self.unreadable_because[topic] = str(error)
            self._checks.refused(topic, str(error))
        else:
            self._publish(found, log_time_ns)
        self._draw(log_time_ns)
        self._diagnose(log_time_ns)

    def finish(self, log_time_ns: int) -> None:
        """Output the frames that still wait for their poses, and the last diagnostics."""
        if self.overlay is not None:
            for deadline_ns in self.overlay.deadlines_ns:
                self._draw(log_time_ns, deadline_ns)
        self._publish_diagnostics(log_time_ns)

    def _registered(self, topic: str, message: Any, log_time_ns: int) -> Registered:
        convert_sample = SAMPLES.get(topic)
        if convert_sample is not None:
            sample = convert_sample(message)
            self._checks.sample(topic, sample, log_time_ns)
            stamped = self.arrivals.stamped(topic, sample, log_time_ns)
            found = self.registration.take(stamped)
            self._checks.registered(found, self.registration.navigation.plane)
            return found
        if topic == "tirgeo/locate/pixel":
            self._locate(message, log_time_ns)
        else:
            self._picture(topic, message, log_time_ns)
        return _NOTHING

    def _locate(self, message: Any, log_time_ns: int) -> None:
        if self.overlay is None:
            return
        stamp_ns, u, v = convert.pixel(message)
        answer = self.overlay.clicks.locate((u, v), stamp_ns)
        if isinstance(answer, Located):
            self._send("tirgeo/locate/fix", self._messages.located_fix(answer), log_time_ns)
            self._send("tirgeo/locate/point", self._messages.located_point(answer), log_time_ns)

    def _publish(self, found: Registered, log_time_ns: int) -> None:
        if found.body is not None:
            self._new_plane(found.body.stamp_ns, log_time_ns)
        elif not found.cameras:
            return
        if self.overlay is not None:
            for pose in found.cameras:
                self.overlay.add_pose(pose)
        self._unsent.append((found, log_time_ns))
        if len(self._unsent) >= _BLOCK:
            self._send_poses()

    def _send_poses(self) -> None:
        unsent, self._unsent = self._unsent, []
        made = [
            (topic, message, log_time_ns)
            for found, log_time_ns in unsent
            for topic, message in self._pose_messages(found)
        ]
        for topic, message, log_time_ns in made:
            self._write(topic, message, log_time_ns)

    def _pose_messages(self, found: Registered) -> Iterator[tuple[str, Any]]:
        if found.solution is not None and found.body is not None:
            yield "tirgeo/odometry", self._messages.odometry(found.solution, found.body)
            if self._fix_rate.due(found.solution.stamp_ns):
                yield "tirgeo/fix", self._messages.fix(found.solution)
        for pose in found.cameras:
            yield "tirgeo/camera_pose", self._messages.camera_pose(pose)

    def _send(self, topic: str, message: object, log_time_ns: int) -> None:
        """Output a message after all queued poses, which are older."""
        self._send_poses()
        self._write(topic, message, log_time_ns)

    def _new_plane(self, stamp_ns: int, log_time_ns: int) -> None:
        plane = self.registration.navigation.plane
        if plane is self._plane or plane is None or plane == self._plane:
            return
        self._plane = plane
        self._send("tirgeo/origin", self._messages.origin(plane, stamp_ns), log_time_ns)
        if self.overlay is not None:
            self.overlay.set_plane(plane)
            if self.overlay.laid is not None:
                self._checks.map(self.overlay.laid)

    def _picture(self, topic: str, message: Any, log_time_ns: int) -> None:
        if self.overlay is None:
            return
        if topic == "thermal/camera_info":
            camera = convert.camera(message)
            self._checks.camera(camera, log_time_ns)
            self.overlay.set_camera(camera)
            return
        self.overlay.set_status(self.registration.navigation.status())
        pixels, stamp_ns = convert.pixels(topic, message), convert.stamp_ns(message)
        self._checks.frame(topic, stamp_ns, pixels, log_time_ns)
        stamp_ns = self.arrivals.stamp_ns(topic, stamp_ns, log_time_ns)
        self.overlay.add_frame(stamp_ns, pixels, log_time_ns)

    def _draw(self, log_time_ns: int, now_ns: int | None = None) -> None:
        if self.overlay is None:
            return
        result = self.overlay.take(log_time_ns if now_ns is None else now_ns)
        if result is not None:
            self._give_out(result, log_time_ns)

    def _give_out(self, result: OverlayResult, log_time_ns: int) -> None:
        if self._film is not None:
            self._film(result.stamp_ns, result.image)
        quality = [cv2.IMWRITE_JPEG_QUALITY, self._settings.overlay.jpeg_quality]
        jpeg = cv2.imencode(".jpg", result.image, quality)[1].tobytes()
        compressed = self._messages.compressed(result.stamp_ns, jpeg)
        self._send("tirgeo/overlay/image/compressed", compressed, log_time_ns)
        if self._settings.raw_images:
            raw = self._messages.image(result.stamp_ns, result.image)
            self._send("tirgeo/overlay/image", raw, log_time_ns)

    def _diagnose(self, log_time_ns: int) -> None:
        if self._diagnosed_ns is None:
            self._diagnosed_ns = log_time_ns
        late_ns = log_time_ns - self._diagnosed_ns
        if late_ns >= DIAGNOSTICS_PERIOD_NS:
            self._diagnosed_ns = log_time_ns - late_ns % DIAGNOSTICS_PERIOD_NS
            self._publish_diagnostics(log_time_ns)

    def _publish_diagnostics(self, log_time_ns: int) -> None:
        status = self.registration.navigation.status()
        self.states_s[status.state.value] += 1
        name = f"{self._names}ekf_node: navigation"
        items = [self._messages.navigation_diagnostic(name, status)]
        items[0].values.update(self.arrivals.diagnostics)
        composer = self.registration.composer
        composition = f"composition: {composer.composition}"
        items.append(self._counts("gimbal_node: camera pose", composer.diagnostics, composition))
        if self.overlay is not None:
            items.append(self._counts("overlay_node: overlay", self._overlay_counts(), "ok"))
        message = self._messages.diagnostics(log_time_ns, items)
        self._send("/diagnostics", message, log_time_ns)

    def _overlay_counts(self) -> dict[str, int]:
        assert self.overlay is not None
        clicks = sorted(self.overlay.clicks.counts.items())
        return self.overlay.counts | {f"clicks_{name}": number for name, number in clicks}

    def _counts(self, name: str, counts: Mapping[str, int | str], message: str) -> DiagnosticItem:
        values = {key: str(number) for key, number in counts.items()}
        return DiagnosticItem(self._names + name, 0, message, values)
