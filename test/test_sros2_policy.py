"""The SROS 2 policy as a file: its schema's rules, and that its parts fit each other."""

from __future__ import annotations

import fnmatch
import re

import pytest
from project import NODES, PROJECT
from sros2_policy import allowed, breaches

POLICY = PROJECT / "config" / "sros2_policy.xml"


def test_the_policy_keeps_the_rules_of_its_schema():
    assert breaches(POLICY) == []


@pytest.mark.parametrize(
    ("old", "new", "wrong"),
    [
        ('version="0.2.0"', 'version="0.1.0"', "no policy 0.2.0"),
        ('publish="ALLOW"', 'publish="allow"', "topics: {'publish': 'allow'}"),
        ('<profile ns="/"', "<profile", r"profile {'node': 'dji_node'}: \['ns'\]"),
        ("<topic>imu/data<", "<topic> imu/data<", "topic: ' imu/data' is no name"),
        ('"/tirgeo/ekf_node"', '"/tirgeo/dji_node"', "/tirgeo/dji_node: more than once"),
        ("<enclaves>", "<enclaves><!-- all -->", "enclaves: a comment"),
        ("<services reply=", "<services subscribe=", r"services .*: \['subscribe'\]"),
    ],
)
def test_a_breach_of_the_schema_is_seen(tmp_path, old, new, wrong):
    spoilt = tmp_path / "policy.xml"
    text = POLICY.read_text()
    assert old in text
    spoilt.write_text(text.replace(old, new, 1))
    assert any(re.match(wrong, found) for found in breaches(spoilt)), breaches(spoilt)


def test_every_executable_has_an_enclave():
    assert not NODES - allowed(POLICY).keys()


def test_whoever_listens_is_spoken_to_and_whoever_asks_is_answered():
    """But for psdk_ros2, whose own policy is its own."""
    nodes = allowed(POLICY, "/uav1").values()
    for there, here in (("publish", "subscribe"), ("reply", "request")):
        offered = set().union(*(node[there] for node in nodes))
        for name in set().union(*(node[here] for node in nodes)):
            if "/psdk_ros2/" not in name:
                assert fnmatch.filter(offered, name), name


def test_only_the_bag_player_may_set_the_time():
    """Whoever sets it can hold a graph in sim time still."""
    assert {n for n, may in allowed(POLICY).items() if "/clock" in may["publish"]} == {
        "bag_player"
    }
