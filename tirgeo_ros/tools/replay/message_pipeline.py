"""Run messages of a flight through the whole node graph, in log-time order.

These are the core objects of ekf_node, gimbal_node and overlay_node, with the conversions that
those nodes use. The log time of an output is that of the input that caused it.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import islice
from typing import Any

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.navigation.smoothing.backward_pass import SmoothedRun
from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.core.streams.arrivals import Arrivals
from tirgeo_ros.core.types.errors import MessageError, TirgeoError
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagMessage, BagReader, BagWriter, Cdr
from tirgeo_ros.io.messages import TOPIC_TYPES, DiagnosticItem, Messages, navigation_item
from tirgeo_ros.tools.presentation.progress import Report
from tirgeo_ros.tools.replay.flight_checks import FlightChecks
from tirgeo_ros.tools.replay.flight_topics import CAMERA_INFO, PICTURES, prefix, resolved
from tirgeo_ros.tools.replay.node_configs import NodeConfigs
from tirgeo_ros.tools.replay.picture_outputs import OverlayFilm, PictureOutputs
from tirgeo_ros.tools.replay.picture_stage import PictureStage
from tirgeo_ros.tools.replay.pose_outputs import PoseOutputs
from tirgeo_ros.tools.replay.registration import SAMPLES, Registered, Registration

DIAGNOSTICS_PERIOD_NS = 1_000_000_000
#: Messages that are decoded together: work of one kind in a row uses the caches better.
_BLOCK = 32
#: Of the messages that only the checks want, every tenth is decoded: 5 a second at 50 Hz.
_LOOKED_AT = 10


class Pipeline:
    """Run the chain from sensor messages to overlay.

    ``read``, ``undecoded`` and ``written`` count messages by name in the bag, ``unreadable`` those
    of contract topics that cannot be used, and ``states_s`` the seconds in each filter state.
    """

    def __init__(
        self,
        configs: NodeConfigs,
        overlay: Overlay | None,
        writer: BagWriter,
        film: OverlayFilm | None,
        namespace: str,
        checks: FlightChecks,
        stage: PictureStage,
        *,
        raw_images: bool = False,
        smoothed: Sequence[SmoothedRun] | None = None,
    ) -> None:
        """Set up the chain; ``checks`` get all inputs and outputs, and change nothing of them.

        ``smoothed`` are the smoothed runs of the same messages.
        """
        self.registration = Registration(configs.ekf, configs.gimbal, smoothed=smoothed)
        self.overlay = overlay
        self.read: Counter[str] = Counter()
        self.undecoded: Counter[str] = Counter()
        self.written: Counter[str] = Counter()
        self.unreadable: Counter[str] = Counter()
        self.unreadable_because: dict[str, str] = {}  # the newest reason
        self.states_s: Counter[str] = Counter()
        self.arrivals = Arrivals()
        self.duration_s = 0.0  # from the first to the newest message
        self._checks, self._decoder = checks, stage.decoder
        self._cdr = Cdr()
        self._messages = Messages(self._cdr.types, configs.ekf.frame_ids)
        self._pictures = PictureOutputs(
            stage,
            self._messages,
            self._write_one,
            film,
            configs.overlay.footprint_rate_hz,
            raw_images=raw_images,
        )
        self._poses = PoseOutputs(configs, self._messages, self._pictures.put)
        self._writer = writer
        self._prefix = prefix(namespace)
        self._names = {topic: resolved(topic, namespace) for topic in TOPIC_TYPES}
        self._plane: TangentPlane | None = None
        self._diagnosed_ns: int | None = None
        self._unwanted = 0

    def through(
        self,
        reader: BagReader,
        topics: Mapping[str, str],
        checked: Mapping[str, str],
        progress: Report,
    ) -> None:
        """Process every message of the topics (resolved name -> contract topic).

        Those of ``checked`` go to the checks alone, and change no output.
        """
        begin_ns, end_ns = reader.span_ns
        first_ns = last_ns = 0
        messages = reader.messages({*topics, *checked})
        while block := list(islice(messages, _BLOCK)):
            progress((block[-1].log_time_ns - begin_ns) * 1e-9, (end_ns - begin_ns) * 1e-9)
            used = [one for one in block if one.topic in topics]
            if used:
                last_ns = used[-1].log_time_ns
                first_ns = first_ns or used[0].log_time_ns
            self.duration_s = (last_ns - first_ns) * 1e-9
            contents = iter([self._wanted_content(topics[one.topic], one) for one in used])
            for message in block:
                if message.topic in topics:
                    self._take(topics[message.topic], message, next(contents))
                else:
                    self._checks.message(checked[message.topic], message)
        if self.read:
            self._finish(last_ns)

    def _is_wanted(self, topic: str) -> bool:
        """Return whether a topic changes outputs: attitudes do until the joints are trusted."""
        return topic != "gimbal/attitude" or self.registration.composer.composition == "paper"

    def _wanted_content(self, topic: str, message: BagMessage) -> object | None:
        """Return the content, or None; of what only the checks want, each tenth is decoded."""
        if not self._is_wanted(topic):
            self._unwanted += 1
            if self._unwanted % _LOOKED_AT:
                return None
        content = self._decoded(message)
        if topic in PICTURES and content is not None and self.overlay is not None:
            self._decoder.begin(topic, content)
        return content

    def _decoded(self, message: BagMessage) -> object | None:
        try:
            content: object = self._cdr.deserialize(message.data, message.typename)
        except MessageError:
            return None
        return content

    def _take(self, topic: str, message: BagMessage, content: object | None) -> None:
        """Process a message; it is decoded here if it was not wanted when its block was."""
        if not self._is_wanted(topic):
            if content is not None:
                with contextlib.suppress(TirgeoError):
                    self._checks.sample(topic, SAMPLES[topic](content), message.log_time_ns)
            return
        content = content or self._decoded(message)
        if content is None:
            self.undecoded[message.topic] += 1
            return
        self.read[message.topic] += 1
        self._process(topic, content, message.log_time_ns)

    def _process(self, topic: str, message: Any, log_time_ns: int) -> None:
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

    def _finish(self, log_time_ns: int) -> None:
        """Output the frames that still wait for their poses, and the last diagnostics."""
        if self.overlay is not None:
            for deadline_ns in self.overlay.deadlines_ns:
                self._draw(log_time_ns, deadline_ns)
        self._poses.finish(log_time_ns)
        self._publish_diagnostics(log_time_ns)
        self._pictures.finish()

    def _write(self, topic: str, message: object, log_time_ns: int) -> None:
        """Write an output under its resolved name, after all poses, which are older."""
        self._poses.flush()
        self._pictures.put(topic, message, log_time_ns)

    def _write_one(self, topic: str, message: object, log_time_ns: int) -> None:
        name = self._names[topic]
        self._writer.write(name, TOPIC_TYPES[topic], message, log_time_ns)
        self.written[name] += 1

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
        if found.body is not None and plane is not None and plane != self._plane:
            self._new_plane(plane, found.body.stamp_ns, log_time_ns)
        for pose in found.cameras:
            if self.overlay is not None:
                self.overlay.add_pose(pose)
        self._poses.add(found, self.registration.composer.body_at, log_time_ns)

    def _new_plane(self, plane: TangentPlane, stamp_ns: int, log_time_ns: int) -> None:
        self._plane = plane
        self._poses.new_plane(plane, stamp_ns, log_time_ns)
        if self.overlay is not None:
            self.overlay.set_plane(plane)
            if self.overlay.map_given and self.overlay.draped is not None:
                self._checks.map(self.overlay.draped)

    def _picture(self, topic: str, message: Any, log_time_ns: int) -> None:
        if self.overlay is None:
            return
        if topic == CAMERA_INFO:
            camera = convert.camera(message)
            self._checks.camera(camera, log_time_ns)
            self.overlay.set_camera(camera)
            return
        self.overlay.set_status(self.registration.navigation.status())
        pixels, stamp_ns = self._decoder.pixels(topic, message), convert.stamp_ns(message)
        self._checks.frame(topic, stamp_ns, pixels, log_time_ns)
        stamp_ns = self.arrivals.stamp_ns(topic, stamp_ns, log_time_ns)
        self.overlay.add_frame(stamp_ns, pixels, log_time_ns)

    def _draw(self, log_time_ns: int, now_ns: int) -> None:
        """Output the frame, if any, that is drawn at ``now_ns``, after all poses."""
        if self.overlay is None:
            return
        picture = self.overlay.take_unpainted(now_ns)
        if picture is not None:
            self._poses.flush()
            body_at = self.registration.composer.body_at
            self._pictures.add(picture, self.overlay, body_at, log_time_ns)

    def _publish_diagnostics(self, log_time_ns: int) -> None:
        status = self.registration.navigation.status()
        self.states_s[status.state.value] += 1
        name = f"{self._prefix}ekf_node: navigation"
        items = [navigation_item(name, status)]
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
        return DiagnosticItem(self._prefix + name, 0, message, values)
