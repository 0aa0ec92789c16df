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
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import islice

from tirgeo_ros.core.ground.dem import Terrain
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
from tirgeo_ros.tools.replay import FlightChecks, finding_items, setting_of
from tirgeo_ros.tools.replay.flight_topics import done_without, inputs_of, prefix, resolved
from tirgeo_ros.tools.replay.message_pipeline import Pipeline, Settings
from tirgeo_ros.tools.replay.node_configs import node_configs

#: Number of messages decoded together, for the same reason as in ``message_pipeline``.
_BLOCK = 32
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
    settings = Settings(ekf, gimbal, overlay, raw_images=raw_images)
    if map_path:
        layers = load_layers(map_path, overlay.style, overlay.label_field, network=overlay.network)
        settings = replace(settings, layers=layers, ground=ground_of(overlay), camera=known)
    checks = FlightChecks(
        setting_of(
            fitted,
            reader,
            params,
            namespace,
            ground=settings.ground,
            layers=settings.layers,
            camera=known,
        )
    )
    begun_s = time.perf_counter()
    with contextlib.ExitStack() as stack:
        film = stack.enter_context(VideoFile(video)) if video is not None else None
        writer = stack.enter_context(BagWriter(bag_out))
        run = _Run(reader, settings, writer, film, namespace, checks)
        run.through(topics, progress)
        if not run.read:
            because = f": {reader.damage}" if reader.damage else ""
            raise BagError(f"{bag_in}: no message could be read{because}")
    elapsed_s = time.perf_counter() - begun_s
    if not any(name.startswith("gimbal/") for name in topics.values()):
        notes.append("the bag has no gimbal topic: no camera poses")
    summary = run.summary(elapsed_s, notes)
    summary["warning"] = _warning(reader, topics, ekf.method, namespace)
    summary["findings"] = finding_items(checks.findings())  # damage is in the summary's error
    return {"input": os.fspath(bag_in), "output": os.fspath(bag_out)} | summary


def _warning(reader: BagReader, topics: dict[str, str], method: str, namespace: str) -> str | None:
    absent = [resolved(name, namespace) for name in done_without(topics.values(), method)]
    return f"{reader.path} has no {', '.join(absent)}: done without" if absent else None


class _Run:
    """Make one pass through a bag."""

    def __init__(
        self,
        reader: BagReader,
        settings: Settings,
        writer: BagWriter,
        film: VideoFile | None,
        namespace: str,
        checks: FlightChecks,
    ) -> None:
        self.read: Counter[str] = Counter()
        self._written: Counter[str] = Counter()
        self._writer, self._film = writer, film
        self._names = {topic: resolved(topic, namespace) for topic in TOPIC_TYPES}
        self._reader = reader
        self._settings = settings
        self._cdr = Cdr()
        self._undecoded: Counter[str] = Counter()
        self._span_ns = (0, 0)
        self._unwanted = 0
        self.pipeline = Pipeline(
            settings,
            self._cdr.types,
            self._write,
            None if film is None else film.add,
            prefix(namespace),
            checks,
        )

    def _write(self, topic: str, message: object, log_time_ns: int) -> None:
        """Write an output under its resolved name."""
        name = self._names[topic]
        self._writer.write(name, TOPIC_TYPES[topic], message, log_time_ns)
        self._written[name] += 1

    def through(self, topics: dict[str, str], progress: Report) -> None:
        """Process every message of the topics (resolved name -> contract topic)."""
        for block in self._blocks(topics, progress):
            early = [
                self._decoded(message) if self.pipeline.wants(topics[message.topic]) else None
                for message in block
            ]
            for message, decoded in zip(block, early, strict=True):
                self._take(topics[message.topic], message, decoded)
        if self.read:
            self.pipeline.finish(self._span_ns[1])

    def _take(self, topic: str, message: BagMessage, decoded: object | None) -> None:
        """Process a message; ``decoded`` is None if it was not wanted when its block began."""
        if not self.pipeline.wants(topic):
            self._look_at(topic, message)
            return
        if decoded is None:
            decoded = self._decoded(message)
        if decoded is None:
            self._undecoded[message.topic] += 1
            return
        self.read[message.topic] += 1
        self.pipeline.take(topic, decoded, message.log_time_ns)

    def _look_at(self, topic: str, message: BagMessage) -> None:
        """Pass every tenth of the messages that nothing else wants to the checks."""
        self._unwanted += 1
        if self._unwanted % _LOOKED_AT == 0:
            decoded = self._decoded(message)
            if decoded is not None:
                self.pipeline.look_at(topic, decoded, message.log_time_ns)

    def _decoded(self, message: BagMessage) -> object | None:
        try:
            decoded: object = self._cdr.deserialize(message.data, message.typename)
        except MessageError:
            return None
        return decoded

    def _blocks(self, topics: Collection[str], progress: Report) -> Iterator[list[BagMessage]]:
        messages = self._reader.messages(topics)
        total_s = _seconds(self._reader.span_ns)
        begun_ns: int | None = None
        while block := list(islice(messages, _BLOCK)):
            begun_ns = block[0].log_time_ns if begun_ns is None else begun_ns
            self._span_ns = (begun_ns, block[-1].log_time_ns)
            progress(_seconds(self._span_ns) or 0.0, total_s)
            yield block

    def summary(self, elapsed_s: float, notes: Sequence[str]) -> dict[str, object]:
        """Return what was read, computed and refused.

        ``notes`` come before the run's own notes.
        """
        duration_s = _seconds(self._span_ns) or 0.0
        navigation = self.pipeline.registration.navigation.status()
        composer = self.pipeline.registration.composer
        overlay, film = self.pipeline.overlay, self._film
        return {
            "method": navigation.method,
            "composition": composer.composition,
            "duration_s": duration_s,
            "elapsed_s": elapsed_s,
            "speed": duration_s / elapsed_s,
            "read": dict(self.read),
            "undecodable": dict(self._undecoded),
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
            "notes": [*notes, *self._notes()],
            "video": None if film is None else {"frames": film.frames, "rate_hz": film.rate_hz},
            "error": self._error(navigation.reason),
        }

    def _notes(self) -> list[str]:
        """Return one line for each part of map or ground that is not drawn as its files say."""
        layers, ground = self._settings.layers or (), self._settings.ground
        notes = list(ground.notes) if isinstance(ground, Terrain) else []
        notes += [note for layer in layers for note in layer.left_out]
        return notes + list(self.pipeline.overlay.notes if self.pipeline.overlay else ())

    def _error(self, reason: str) -> str | None:
        """Return what makes the run a failure although there is an output, or None."""
        if self._reader.damage is not None:
            return f"{self._reader.path}: {self._reader.damage}; the output is made from these"
        if not any(name.endswith("tirgeo/odometry") for name in self._written):
            return f"{self._reader.path}: no pose could be made: {reason or 'see verdicts'}"
        return None


def _seconds(span_ns: tuple[int, int] | None) -> float | None:
    return None if span_ns is None else (span_ns[1] - span_ns[0]) * 1e-9
