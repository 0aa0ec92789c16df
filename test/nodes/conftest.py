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
"""A short flight in a bag, and nodes as processes in a domain of their own."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from project import taken_port

from tirgeo_ros.core.config import NODE_CONFIGS
from tirgeo_ros.io.bags.bag import BagWriter
from tirgeo_ros.io.messages import TOPIC_TYPES, Messages, sensed
from tirgeo_ros.tools.graph.node_graph import GraphSetup, NodeProcess, graph_environment
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import Scenario

Spawn = Callable[..., NodeProcess]


@pytest.fixture(scope="session")
def flight_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four seconds of a simulated flight without pictures."""
    path = tmp_path_factory.mktemp("flight") / "flight.mcap"
    messages = Messages()
    with BagWriter(path) as writer:
        for arrival_ns, sample in fly(Scenario(duration_s=4.0)).samples:
            topic, message = sensed(messages, sample)
            writer.write(f"/{topic}", TOPIC_TYPES[topic], message, arrival_ns)
    return path


@pytest.fixture(scope="session")
def environment(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """For every process of the session: one domain that is free, and stays it.

    The port of the domain's first participant is held, so that no other worker and no demo takes
    the domain (``free_domain``) while none of the session's nodes runs.
    """
    folder = tmp_path_factory.mktemp("environment")
    while True:
        environment = graph_environment(GraphSetup(folder, folder))
        with suppress(OSError), taken_port(int(environment["ROS_DOMAIN_ID"])):
            yield environment
            return


@pytest.fixture(scope="session")
def sample_graph(sample: Path, environment: dict[str, str]) -> Callable[..., GraphSetup]:
    """The whole graph on the sample flight, its queues so deep that no message is lost.

    ``sample_graph(folder, serial=True)``: the folder takes the recording and the logs.
    """
    # ROS may be absent where the other tests run.
    from graph_helpers import deep_queues  # noqa: PLC0415  needs ROS

    def setup(folder: Path, **options: Any) -> GraphSetup:
        params = folder / "params.yaml"
        params.write_text((sample / "params.yaml").read_text() + deep_queues())
        domain = {"ROS_DOMAIN_ID": environment["ROS_DOMAIN_ID"]}
        bag, map_file = sample / "flight.mcap", sample / "map.geojson"
        return GraphSetup(bag, folder, [params], map_file, environment=domain, **options)

    return setup


@contextmanager
def spawning(folder: Path, environment: dict[str, str]) -> Iterator[Spawn]:
    processes: list[NodeProcess] = []

    def start(name: str, *arguments: str, **variables: str) -> NodeProcess:
        log = folder / f"{name}.{len(processes)}.log"
        processes.append(NodeProcess(name, arguments, environment | variables, log))
        return processes[-1]

    yield start
    for process in processes:
        process.signal(signal.SIGKILL)
        process.wait(5)


@pytest.fixture
def spawn_in(tmp_path: Path) -> Iterator[Callable[[dict[str, str]], Spawn]]:
    """Return what starts nodes in an environment; none outlives the test."""
    with ExitStack() as stack:
        yield lambda environment: stack.enter_context(spawning(tmp_path, environment))


@pytest.fixture
def spawn(spawn_in, environment: dict[str, str]) -> Spawn:
    """Start nodes: ``spawn("ekf_node", "-p", "method:=rtk")``; none outlives the test.

    Keyword arguments are variables of the environment.
    """
    return spawn_in(environment)


@pytest.fixture
def start_idle(spawn: Spawn, tmp_path: Path, flight_bag: Path) -> Callable[..., NodeProcess]:
    """Start a node that has nothing to do, with what keeps it running."""
    return lambda name: spawn(name, *idle_words(name, tmp_path, flight_bag))


@pytest.fixture(scope="module")
def idle_nodes(
    tmp_path_factory: pytest.TempPathFactory, environment: dict[str, str], flight_bag: Path
) -> Iterator[dict[str, NodeProcess]]:
    """Every node at once, each with nothing to do, for a whole file of tests."""
    from graph_helpers import await_words  # noqa: PLC0415 as below

    folder = tmp_path_factory.mktemp("idle")
    with spawning(folder, environment) as start:
        nodes = {name: start(name, *idle_words(name, folder, flight_bag)) for name in NODE_CONFIGS}
        for node in nodes.values():
            await_words(node, "ready")
        yield nodes


def idle_words(name: str, folder: Path, bag: Path) -> list[str]:
    given: dict[str, dict[str, object]] = {
        "bag_player": {"bag": bag, "wait_timeout_s": 600.0, "wait_for": "imu/data"},
        "recorder": {"output": folder / "out.mcap", "topics": "tirgeo/odometry"},
        "video_writer": {"output": folder / "out.ts"},
        "viewer_node": {"listen": "127.0.0.1:0", "targets": folder / "targets.gpkg"},
        "dji_node": {"port": folder / "no_port"},
    }
    pairs = given.get(name, {}).items()
    words = [word for key, value in pairs for word in ("-p", f"{key}:={value}")]
    return [*words, "-r", "imu/data:=unheard"] if name == "bag_player" else words


@pytest.fixture(scope="module", autouse=True)
def same_transport(environment: dict[str, str]) -> Iterator[None]:
    """Have the test's own participants meet the nodes, by the same transport and domain.

    For every module: Fast DDS reads its profile when a process makes its first participant.
    """
    with pytest.MonkeyPatch.context() as patch:
        for name, value in environment.items():
            if name.startswith(("ROS_", "FAST", "SKIP_DEFAULT_XML")):
                patch.setenv(name, value)
        yield


@pytest.fixture
def meet(environment):
    """Make strangers: ``meet(imu__data=Imu)`` listens to ``imu/data``."""
    from graph_helpers import Stranger  # noqa: PLC0415 ROS may be absent where the other tests run

    strangers = []

    def make(**topics: type) -> Stranger:
        named = {topic.replace("__", "/"): kind for topic, kind in topics.items()}
        strangers.append(Stranger(int(environment["ROS_DOMAIN_ID"]), named))
        return strangers[-1]

    yield make
    for stranger in strangers:
        stranger.close()
