# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Record aircraft, bag and video, each by a child process of viewer_node, as live streams are."""

from __future__ import annotations

import json
import math
import os
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import urlsplit

from tirgeo_ros.core.config import ViewerConfig
from tirgeo_ros.core.config.schema import parameters_of
from tirgeo_ros.core.config.viewer_parameters import GroundConfig
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.missing_package import missing_line
from tirgeo_ros.io.files.child_process import node_command
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.io.video.live_stream import stream_url
from tirgeo_ros.nodes.graph_node import GraphNode, message_class
from tirgeo_ros.nodes.monitor import OK, WARN

_END_S = 20.0
_BEGIN_S = 30.0
_POLL_S = 0.05
_RETRY_S = 5.0
_MEET_S = 5.0  # until a node that has just started has discovered a camera
_RAW, _COMPRESSED = "thermal/image_raw", "thermal/image_raw/compressed"
_TF = ("/tf", "/tf_static")
#: What the page's video is made of; it can be made again from the rest.
_FOR_PAGES = {f"tirgeo/overlay/{name}" for name in ("clean/compressed", "shapes", "markers")}
#: Not in every recording. The overlay only as JPEG: overlay_node would have to make the raw form
#: for the recording alone.
_LEFT_OUT = {
    _RAW,
    _COMPRESSED,
    "tirgeo/overlay/image",
    "tirgeo/targets/markers",
    "/clock",
    *_TF,
    *_FOR_PAGES,
}
TOPICS = [topic for topic in TOPIC_TYPES if topic not in _LEFT_OUT]


class ChildNode:
    """Run a node in a process that has the clock of ``node``, and ends with this thread."""

    def __init__(
        self, node: GraphNode, name: str, values: Mapping[str, object], namespace: str
    ) -> None:
        self.name = name
        simulated = node.get_parameter("use_sim_time").value
        words = [word for pair in values.items() for word in _assignment(*pair)]
        words += ["-p", f"use_sim_time:={json.dumps(simulated)}"]
        words += ["-r", f"__ns:={namespace or '/'}"]
        self._process = subprocess.Popen(  # noqa: S603  this very Python
            node_command(name, words, ends_with=os.getpid()),
            stdin=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
        )
        self._line = "it printed nothing"
        self._reader = threading.Thread(target=self._read, name=f"{name}'s log", daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            self._line = line.strip() or self._line

    @property
    def fault(self) -> str:
        """Return why the process has ended by itself; empty while it runs."""
        if self._process.poll() is None:
            return ""
        self._reader.join(1.0)
        return f"{self.name} ended (exit code {self._process.returncode}): {self._line}"

    def end(self) -> str:
        """End the process; return the fault, or an empty text."""
        for number in (signal.SIGINT, signal.SIGKILL):
            self._process.send_signal(number)
            with suppress(subprocess.TimeoutExpired):
                return self.fault if self._process.wait(_END_S) else ""
        return f"{self.name} does not end"


def ground_values(config: GroundConfig) -> dict[str, object]:
    """Return the parameters of the ground, for a child process."""
    return {p.name: getattr(config, p.name) for p in parameters_of(GroundConfig)}


def _assignment(name: str, value: object) -> list[str]:
    """Return the arguments that set a parameter; none for nan, which means unset."""
    if isinstance(value, float):
        return [] if math.isnan(value) else ["-p", f"{name}:={value!r}"]
    # ROS reads the value as YAML: a file named 7 would be a number without its quotes.
    return ["-p", f"{name}:={json.dumps(str(value), ensure_ascii=False)}"]


def no_video() -> str:
    """Return why this computer can write no video; empty if it can."""
    return f"no video: {missing_line('av')}" if find_spec("av") is None else ""


@dataclass
class Recording:
    """Hold one recording: its bag, and the processes that write it and the video."""

    bag: Path
    children: list[ChildNode]

    @property
    def fault(self) -> str:
        """Return why one of its processes has ended by itself; empty while all run."""
        return next(filter(None, (child.fault for child in self.children)), "")

    def end(self) -> str:
        """End all processes; return the faults in one text."""
        return "; ".join(filter(None, [child.end() for child in self.children]))


class Recordings:
    """Hold the recordings in progress, by aircraft. Any thread may call it.

    ``namespaces`` are those of the aircraft; ``troubles`` is what went wrong last with each.
    """

    def __init__(
        self, node: GraphNode, config: ViewerConfig, namespaces: Mapping[str, str]
    ) -> None:
        self._node, self._config, self._folder = node, config, Path(config.record_to)
        self._namespaces = namespaces
        self._lock = threading.Lock()
        self._active: dict[str, Recording] = {}
        self.troubles: dict[str, str] = {}
        #: A child ends with the thread that started it: this thread stays.
        self._thread = ThreadPoolExecutor(1, "recordings")

    def is_on(self, aircraft: str) -> bool:
        """Return whether an aircraft is recorded."""
        return aircraft in self._active

    def findings(self, aircraft: str) -> list[Finding]:
        """Return the finding of what went wrong last with an aircraft's recording."""
        if aircraft not in self.troubles:
            return []
        evidence = f"the recording has failed: {self.troubles[aircraft]}"
        where, mend = "viewer_node record_to", "check the disk, then record again"
        return [Finding("recording", Severity.CAUTION, evidence, where, mend)]

    def begin(self, aircraft: str) -> str:
        """Begin to record; return words for the operator when it has begun, or why it has not."""
        with self._lock:
            if aircraft in self._active:
                return f"already recording to {self._active[aircraft].bag}"
            trouble = self._folder_trouble()
            if trouble:
                return f"not recorded: {trouble}"
            new = self._started(aircraft)
            _wait(lambda: new.bag.exists() or new.fault, _BEGIN_S)
            if new.fault or not new.bag.exists():
                trouble = new.fault or f"{new.bag} does not exist after {_BEGIN_S:.0f} s"
                new.end()
                self.troubles[aircraft] = trouble
                return f"not recorded: {trouble}"
            self._active[aircraft] = new
            self.troubles.pop(aircraft, None)
        trouble = no_video()
        video = f"; {trouble}" if trouble else f" and {new.bag.with_suffix('.ts').name}"
        words = f"recording to {new.bag}{video}"
        self._node.log(OK, words)
        return words

    def go_on(self, aircraft: str) -> None:
        """Record an aircraft again, into new files: the last run was killed while recording it."""
        if aircraft in self._namespaces:
            self._thread.submit(self._begin_again, aircraft)
            return
        what = f"{aircraft or 'the only aircraft'} was recorded when viewer_node was killed"
        trouble = f"{what}, and is not in its parameter namespaces now"
        self.troubles |= dict.fromkeys(self._namespaces, trouble)

    def _begin_again(self, aircraft: str) -> None:
        camera = f"{self._namespaces[aircraft]}/{_COMPRESSED}"
        _wait(lambda: self._node.count_publishers(camera), _MEET_S)
        words = self.begin(aircraft)
        if not self.is_on(aircraft):
            self.troubles[aircraft] = f"it ended when viewer_node was killed; {words}"

    def end(self, aircraft: str) -> str:
        """End a recording; return words for the operator when its files are complete."""
        with self._lock:
            recording = self._active.pop(aircraft, None)
            if recording is None:
                return "nothing is being recorded"
            trouble, bag = recording.end(), recording.bag
        megabytes = bag.stat().st_size / 1e6 if bag.exists() else 0.0
        words = f"recorded {bag}: {megabytes:.0f} MB"
        self._node.log(WARN if trouble else OK, f"{words}; {trouble}" if trouble else words)
        return f"{words}; {trouble}" if trouble else words

    def end_all(self) -> None:
        """End every recording."""
        self._thread.shutdown()
        for aircraft in list(self._active):
            self.end(aircraft)

    def watch(self) -> None:
        """End recordings whose disk is nearly full, or whose process has ended; call each second.

        It does not wait: while a recording begins or ends, nothing is checked.
        """
        if not self._lock.acquire(blocking=False):
            return
        try:
            full = self._folder_trouble() if self._active else ""
            troubles = {name: each.fault or full for name, each in self._active.items()}
        finally:
            self._lock.release()
        for aircraft, trouble in troubles.items():
            if trouble:
                self.troubles[aircraft] = trouble
                self._node.log(WARN, f"the recording ends: {trouble}")
                threading.Thread(target=self.end, args=(aircraft,), name="recording ends").start()

    def _folder_trouble(self) -> str:
        """Return why nothing can be recorded to the folder; empty if it can."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            free_gb = shutil.disk_usage(self._folder).free / 1e9
        except OSError as error:
            return f"{self._folder}: {error.strerror or error}"
        if free_gb < self._config.least_free_gb:
            return f"{self._folder}: only {free_gb:.1f} GB are free; make room on this disk"
        return ""

    def _started(self, aircraft: str) -> Recording:
        utc = time.strftime("%Y-%m-%dT%H-%M-%SZ", time.gmtime())
        name = "-".join([*filter(None, aircraft.split("/")), utc])
        while (self._folder / f"{name}.mcap").exists():  # the clock was set back
            name += "-again"
        bag, video = self._folder / f"{name}.mcap", self._folder / f"{name}.ts"
        namespace = self._namespaces[aircraft]
        # The camera's JPEG where it sends one, else the raw form.
        compressed = self._node.count_publishers(f"{namespace}/{_COMPRESSED}")
        topics = [*TOPICS, _COMPRESSED if compressed else _RAW]
        with suppress(ConfigError):  # tf2_msgs is not installed everywhere
            topics += [topic for topic in _TF if message_class(TOPIC_TYPES[topic])]
        programs: dict[str, dict[str, object]]
        programs = {"recorder": {"output": bag, "topics": ",".join(topics)}}
        if not no_video():
            ground = ground_values(self._config)
            programs["video_writer"] = {"output": video, "platform": aircraft} | ground
        children = [ChildNode(self._node, *each, namespace) for each in programs.items()]
        return Recording(bag, children)


def _wait(done: Callable[[], object], timeout_s: float) -> None:
    end_s = time.monotonic() + timeout_s
    while not done() and time.monotonic() < end_s:
        time.sleep(_POLL_S)


class PageStreams:
    """Run a video_writer for each aircraft, the first at the given port.

    ``troubles`` says of each aircraft why its stream ended. Raises VideoError for an invalid
    address.
    """

    def __init__(
        self, node: GraphNode, config: ViewerConfig, namespaces: Mapping[str, str]
    ) -> None:
        self.troubles: dict[str, str] = {}
        self._node, self._config, self._namespaces = node, config, namespaces
        self._on = bool(config.stream)
        if self._on:
            stream_url(config.stream)
            if trouble := no_video():
                self._on, self.troubles = False, dict.fromkeys(namespaces, trouble)
                node.log(WARN, f"parameter stream: {trouble}")
        self._children: dict[str, ChildNode] = {}
        self._retry_s = 0.0

    def end(self) -> None:
        """End all streams."""
        for child in self._children.values():
            child.end()

    def watch(self) -> None:
        """Start each stream that does not run; call it each second, in one thread that stays."""
        if not self._on or time.monotonic() < self._retry_s:
            return
        for number, (name, namespace) in enumerate(self._namespaces.items()):
            fault = self._children[name].fault if name in self._children else ""
            if fault:
                self.troubles[name] = fault
                self._node.log(WARN, f"the stream has ended and is started again: {fault}")
                self._retry_s = time.monotonic() + _RETRY_S
            if fault or name not in self._children:
                parts = urlsplit(self._config.stream)
                port = f"{parts.netloc.rpartition(':')[0]}:{(parts.port or 0) + number}"
                values = {"stream": parts._replace(netloc=port).geturl(), "platform": name}
                values |= ground_values(self._config)
                self._children[name] = ChildNode(self._node, "video_writer", values, namespace)
