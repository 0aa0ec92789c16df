"""A short flight in a bag, and nodes as processes in a domain of their own."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from project import taken_port

from tirgeo_ros.io.bags.bag import BagWriter, Cdr
from tirgeo_ros.io.messages import TOPIC_TYPES, Messages, sensed
from tirgeo_ros.tools.graph.node_graph import GraphSetup, NodeProcess, graph_environment
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import Scenario

Spawn = Callable[..., NodeProcess]


@pytest.fixture(scope="session")
def flight_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four seconds of a simulated flight without pictures."""
    path = tmp_path_factory.mktemp("flight") / "flight.mcap"
    messages = Messages(Cdr().types)
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
    from graph_helpers import deep_queues  # noqa: PLC0415

    def setup(folder: Path, **options: Any) -> GraphSetup:
        params = folder / "params.yaml"
        params.write_text((sample / "params.yaml").read_text() + deep_queues())
        domain = {"ROS_DOMAIN_ID": environment["ROS_DOMAIN_ID"]}
        bag, map_file = sample / "flight.mcap", sample / "map.geojson"
        return GraphSetup(bag, folder, params, map_file, environment=domain, **options)

    return setup


@pytest.fixture
def spawn(tmp_path: Path, environment: dict[str, str]) -> Iterator[Spawn]:
    """Start nodes: ``spawn("ekf_node", "-p", "method:=rtk")``; none outlives the test.

    Keyword arguments are variables of the environment.
    """
    processes: list[NodeProcess] = []

    def start(name: str, *arguments: str, **variables: str) -> NodeProcess:
        log = tmp_path / f"{name}.{len(processes)}.log"
        processes.append(NodeProcess(name, arguments, environment | variables, log))
        return processes[-1]

    yield start
    for process in processes:
        process.signal(signal.SIGKILL)
        process.wait(5)


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
