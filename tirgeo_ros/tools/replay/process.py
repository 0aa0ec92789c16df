"""Process a recorded flight into its geo-registered flight: the work of ``tirgeo process``.

Messages go through the core objects of the nodes in the order of their log times, faster than real
time. The same input gives the same bytes.
"""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections import Counter
from collections.abc import Sequence

from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.map.draping import Ground
from tirgeo_ros.core.map.layers import MapLayer
from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.core.types.errors import BagError, ConfigError, MessageError
from tirgeo_ros.io.bags.bag import BagMessage, BagReader, BagWriter, Cdr
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs
from tirgeo_ros.io.maps import load_layers, map_files
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.io.parameters.parameter_file import Files, paths_of
from tirgeo_ros.io.pictures.camera_file import given_camera
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.presentation.video import VideoFile
from tirgeo_ros.tools.replay.finding_lines import finding_items
from tirgeo_ros.tools.replay.flight_checks import FlightChecks
from tirgeo_ros.tools.replay.flight_topics import done_without, inputs_of, resolved
from tirgeo_ros.tools.replay.message_pipeline import Pipeline
from tirgeo_ros.tools.replay.node_configs import NodeConfigs, node_configs

#: Of the messages that only the checks want, every tenth is decoded: 5 a second at 50 Hz.
_LOOKED_AT = 10


def process(
    bag_in: PathLike,
    bag_out: PathLike,
    *,
    params: Files = None,
    map: PathLike | None = None,  # noqa: A002 the option's name
    method: str | None = None,
    dem: PathLike | None = None,
    ground_height: float | None = None,
    images: bool = True,
    raw_images: bool = False,
    video: PathLike | None = None,
    namespace: str = "",
    camera: PathLike | None = None,
    progress: Report = silent,
) -> dict[str, object]:
    """Process a bag and return a summary.

    ``error`` in the summary is None, or what of the bag was lost; ``warning`` is None, or which
    topics were missing. ``notes`` say what of the map is not drawn, and which method was chosen by
    the bag's topics because none was given. The gimbal is needed for ``images`` only. ``params``
    are ROS 2 parameter files of the nodes; ``map``, ``dem`` or ``ground_height`` (ellipsoidal m)
    and ``camera``, a calibration file, override those in them. ``progress`` is called with seconds
    of the flight. A file gets its name only when it is complete. Raise BagError (no bag, a needed
    topic absent, nothing readable), CameraError, ConfigError, MapError, ElevationError,
    VideoError.
    """
    configs = node_configs(
        params, namespace, method=method, dem=dem, ground_height=ground_height, camera=camera
    )
    map_path = (configs.overlay.map if map is None else os.fspath(map)) if images else ""
    if (raw_images or video is not None) and not map_path:
        raise ConfigError("overlay images are asked for without a map or without images")
    given = [bag_in, *paths_of(params), *configs.files, *map_files(map_path)]
    check_outputs(given, (bag_out, video), BagError)
    reader = BagReader(bag_in)
    fitted, notes = configs.fitting(reader, namespace)
    ekf, gimbal, overlay, _ = fitted
    known = given_camera(overlay)
    topics = inputs_of(
        reader,
        ekf.method,
        gimbal.composition,
        namespace,
        pictures=bool(map_path),
        camera=known is None,
        gimbal=images,
    )
    layers: list[MapLayer] | None = None
    ground: Ground | None = None
    drawn: Overlay | None = None
    if map_path:
        layers = load_layers(map_path, overlay.style, overlay.label_field, network=overlay.network)
        ground = ground_of(overlay)
        terrain = ground if isinstance(ground, Terrain) else None
        drawn = Overlay(overlay, layers, terrain)
        if known is not None:
            drawn.set_camera(known)
        notes += [
            *(terrain.notes if terrain else ()),
            *(n for one in layers for n in one.left_out),
        ]
    checks = FlightChecks(
        fitted, reader, params, namespace, ground=ground, layers=layers, camera=known
    )
    begun_s = time.perf_counter()
    with contextlib.ExitStack() as stack:
        film = stack.enter_context(VideoFile(video)) if video is not None else None
        writer = stack.enter_context(BagWriter(bag_out))
        run = _Run(reader, fitted, drawn, writer, film, namespace, checks, raw_images=raw_images)
        run.through(topics, progress)
        if not run.read:
            because = f": {reader.damage}" if reader.damage else ""
            raise BagError(f"{bag_in}: no message could be read{because}")
    elapsed_s = time.perf_counter() - begun_s
    if not any(name.startswith("gimbal/") for name in topics.values()):
        notes.append("the bag has no gimbal topic: no camera poses")
    absent = [resolved(name, namespace) for name in done_without(topics.values(), ekf.method)]
    warning = f"{reader.path} has no {', '.join(absent)}: done without" if absent else None
    return {
        "input": os.fspath(bag_in),
        "output": os.fspath(bag_out),
        "warning": warning,
        "findings": finding_items(checks.findings()),  # damage is in the summary's error
        **run.summary(elapsed_s, notes),
    }


class _Run:
    """Make one pass through a bag."""

    def __init__(
        self,
        reader: BagReader,
        configs: NodeConfigs,
        overlay: Overlay | None,
        writer: BagWriter,
        film: VideoFile | None,
        namespace: str,
        checks: FlightChecks,
        *,
        raw_images: bool,
    ) -> None:
        self.read: Counter[str] = Counter()
        self._written: Counter[str] = Counter()
        self._writer, self._film = writer, film
        self._names = {topic: resolved(topic, namespace) for topic in TOPIC_TYPES}
        self._reader = reader
        self._cdr = Cdr()
        self._undecoded: Counter[str] = Counter()
        self._first_ns: int | None = None
        self._last_ns = 0
        self._unwanted = 0
        self.pipeline = Pipeline(
            configs,
            overlay,
            self._cdr.types,
            self._write,
            None if film is None else film.add,
            namespace,
            checks,
            raw_images=raw_images,
        )

    def _write(self, topic: str, message: object, log_time_ns: int) -> None:
        """Write an output under its resolved name."""
        name = self._names[topic]
        self._writer.write(name, TOPIC_TYPES[topic], message, log_time_ns)
        self._written[name] += 1

    def through(self, topics: dict[str, str], progress: Report) -> None:
        """Process every message of the topics (resolved name -> contract topic)."""
        first_ns, last_ns = self._reader.span_ns
        for message in self._reader.messages(topics):
            self._first_ns = message.log_time_ns if self._first_ns is None else self._first_ns
            self._last_ns = message.log_time_ns
            progress(self.duration_s, (last_ns - first_ns) * 1e-9)
            self._take(topics[message.topic], message)
        if self.read:
            self.pipeline.finish(self._last_ns)

    @property
    def duration_s(self) -> float:
        """Return the time from the first to the newest message."""
        return 0.0 if self._first_ns is None else (self._last_ns - self._first_ns) * 1e-9

    def _take(self, topic: str, message: BagMessage) -> None:
        """Process a message; of those that only the checks want, decode every tenth."""
        is_wanted = self.pipeline.wants(topic)
        self._unwanted += not is_wanted
        if not is_wanted and self._unwanted % _LOOKED_AT:
            return
        try:
            decoded = self._cdr.deserialize(message.data, message.typename)
        except MessageError:
            self._undecoded[message.topic] += is_wanted
            return
        if not is_wanted:
            self.pipeline.look_at(topic, decoded, message.log_time_ns)
            return
        self.read[message.topic] += 1
        self.pipeline.take(topic, decoded, message.log_time_ns)

    def summary(self, elapsed_s: float, notes: Sequence[str]) -> dict[str, object]:
        """Return what was read, computed and refused.

        ``notes`` come before the run's own notes.
        """
        navigation = self.pipeline.registration.navigation.status()
        composer = self.pipeline.registration.composer
        overlay, film = self.pipeline.overlay, self._film
        return {
            "method": navigation.method,
            "composition": composer.composition,
            "duration_s": self.duration_s,
            "elapsed_s": elapsed_s,
            "speed": self.duration_s / elapsed_s,
            "read": dict(self.read),
            "undecodable": {topic: n for topic, n in self._undecoded.items() if n},
            "unreadable": dict(self.pipeline.unreadable),
            "unreadable_because": dict(self.pipeline.unreadable_because),
            "stamped_at_arrival": self.pipeline.arrivals.counts,
            "written": dict(self._written),
            "state": navigation.state.value,
            "reason": navigation.reason,
            "states_s": dict(self.pipeline.states_s),
            "verdicts": {f"{a} {b}": number for (a, b), number in navigation.counts.items()},
            "heading_sigma_deg": math.degrees(navigation.heading_sigma_rad),
            "gimbal": composer.counts,
            "overlay": overlay.counts if overlay is not None else {},
            "notes": [*notes, *(overlay.notes if overlay else ())],
            "video": None if film is None else {"frames": film.frames, "rate_hz": film.rate_hz},
            "error": self._error(navigation.reason),
        }

    def _error(self, reason: str) -> str | None:
        """Return what makes the run a failure although there is an output, or None."""
        if self._reader.damage is not None:
            return f"{self._reader.path}: {self._reader.damage}; the output is made from these"
        if not any(name.endswith("tirgeo/odometry") for name in self._written):
            return f"{self._reader.path}: no pose could be made: {reason or 'see verdicts'}"
        return None
