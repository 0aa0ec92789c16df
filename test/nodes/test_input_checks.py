"""A topic that nobody publishes, or of another type, is found by the node that needs it."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3Stamped
from graph_helpers import await_words
from tirgeo_ros.nodes.input_checks import InputChecks

from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.io.messages import diagnostic_level
from tirgeo_ros.nodes.monitor import ERROR, Monitor

JOINTS, ATTITUDE = "gimbal/joint_states", "gimbal/attitude"


class FakeNode:
    """A node of a namespace in a graph whose publishers are given: names with types."""

    def __init__(self, **published: str) -> None:
        self.published = {f"/{name.replace('__', '/')}": kind for name, kind in published.items()}

    def get_namespace(self) -> str:
        return "/uav1"

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        own = {f"/uav1/{name}": "of the node itself" for name in (JOINTS, ATTITUDE)}
        return [(name, [kind]) for name, kind in (own | self.published).items()]

    def count_publishers(self, name: str) -> int:
        return name in self.published

    def get_publishers_info_by_topic(self, topic: str) -> list[SimpleNamespace]:
        kind = self.published.get(f"/uav1/{topic}")
        return [SimpleNamespace(topic_type=kind)] if kind else []


def checks_of(node: FakeNode, heard: str = "") -> InputChecks:
    monitor = Monitor()
    if heard:
        monitor.received(heard)
    return InputChecks(node, monitor, (JOINTS, ATTITUDE))


def test_another_type_is_told_at_once():
    node = FakeNode(uav1__gimbal__joint_states="geometry_msgs/msg/Vector3Stamped")
    (found,) = checks_of(node).findings()
    assert found.severity is Severity.STOP
    assert found.parameter == JOINTS
    assert "/uav1/gimbal/joint_states is a geometry_msgs/msg/Vector3Stamped" in found.evidence


def test_what_nobody_publishes_is_waited_for_from_the_first_message_on():
    quiet, heard = checks_of(FakeNode()), checks_of(FakeNode(), "tirgeo/odometry")
    assert not any(quiet.findings() for _ in range(20))
    counts = [len(heard.findings()) for _ in range(20)]
    assert counts == [0] * 5 + [1] * 15
    (found,) = heard.findings()
    assert found.severity is Severity.STOP
    assert found.evidence.startswith("the graph has neither /uav1/gimbal/joint_states nor ")


def test_what_other_nodes_say_of_themselves_is_no_message_of_a_flight():
    checks = checks_of(FakeNode(), "/diagnostics")
    assert not any(checks.findings() for _ in range(20))


def test_a_topic_under_another_namespace_is_named():
    checks = checks_of(
        FakeNode(gimbal__attitude="geometry_msgs/msg/QuaternionStamped"), "imu/data"
    )
    (found,) = [found for _ in range(6) for found in checks.findings()]
    assert "there is /gimbal/attitude" in found.evidence
    assert "remap" in found.mend


@pytest.mark.parametrize("heard", [JOINTS, ATTITUDE])
def test_one_of_several_will_do(heard):
    checks = checks_of(FakeNode(), heard)
    assert not any(checks.findings() for _ in range(20))


@pytest.mark.graph
def test_joints_of_another_type_are_an_error_of_the_gimbals_set_up(spawn, meet):
    node, observer = spawn("gimbal_node"), meet(**{"/diagnostics": DiagnosticArray})
    await_words(node, "ready")
    observer.node.create_publisher(Vector3Stamped, JOINTS, 10)

    def told() -> bool:
        reports = observer.received["/diagnostics"]
        found = [status for array in reports for status in array.status]
        return any(
            status.name == "/gimbal_node: set-up"
            and diagnostic_level(status) == ERROR
            and "geometry_msgs/msg/Vector3Stamped" in status.message
            for status in found
        )

    observer.spin_until(told)
