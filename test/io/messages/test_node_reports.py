"""What nodes report to programs: it comes back as it was given, and nothing else is taken."""

from __future__ import annotations

import dataclasses
import json
import math
from types import SimpleNamespace

import message_samples as given
import pytest

from tirgeo_ros.core.types.errors import MOST, MessageError
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.verdicts import FilterState
from tirgeo_ros.io.bags.cdr import Cdr
from tirgeo_ros.io.messages import (
    FINDINGS_TOPIC,
    STATE_TOPIC,
    Messages,
    answer_of,
    findings_of,
    node_state,
    targets_of,
)

MADE = Messages(Cdr().types)


def state_document(**changed) -> SimpleNamespace:
    return SimpleNamespace(data=json.dumps(json.loads(MADE.state(given.STATE).data) | changed))


def test_a_state_comes_back_with_all_that_it_has():
    read = node_state(MADE.state(given.STATE))
    sigma_rad = read.navigation.heading_sigma_rad
    assert sigma_rad == pytest.approx(given.STATUS.heading_sigma_rad, rel=1e-15)
    assert dataclasses.replace(read, navigation=given.STATUS) == given.STATE
    assert dataclasses.replace(read.navigation, heading_sigma_rad=0.0123) == given.STATUS
    assert read.name == "overlay_node"
    assert [*read.navigation.test_ratios] == ["rtk_heading", "rtk_position"]  # by name
    bare = dataclasses.replace(given.STATE, navigation=None, composition="", picture=None)
    assert node_state(MADE.state(bare)) == bare


@pytest.mark.parametrize("state", FilterState)
def test_every_state_of_the_filter_comes_back(state):
    status = dataclasses.replace(given.STATUS, state=state, began_again=None)
    read = node_state(MADE.state(dataclasses.replace(given.STATE, navigation=status)))
    assert (read.navigation.state, read.navigation.began_again) == (state, None)


def test_what_is_not_finite_is_null_and_comes_back_as_nan():
    """JSON has no nan, and a page's parser refuses it."""
    status = dataclasses.replace(given.STATUS, heading_sigma_rad=math.nan, nis={"imu": math.inf})
    message = MADE.state(dataclasses.replace(given.STATE, navigation=status))
    assert json.loads(message.data)["navigation"]["heading_sigma_deg"] is None
    read = node_state(message).navigation
    assert math.isnan(read.heading_sigma_rad)
    assert math.isnan(read.nis["imu"])


NAVIGATION = json.loads(MADE.state(given.STATE).data)["navigation"]
PICTURE = json.loads(MADE.state(given.STATE).data)["picture"]


@pytest.mark.parametrize(
    "changed",
    [
        {"navigation": NAVIGATION | {"state": "dreaming"}},
        {"navigation": NAVIGATION | {"heading_sigma_deg": "wide"}},
        {"navigation": NAVIGATION | {"rtk_status": 2}},
        {"navigation": NAVIGATION | {"counts": [1]}},
        {"picture": PICTURE | {"video_latency_s": math.nan}},
        {"topics": {"imu/data": {}}},
        {"started_ns": "yesterday"},
    ],
)
def test_another_document_is_no_state(changed):
    with pytest.raises(MessageError, match="tirgeo/state: no state of a node: "):
        node_state(state_document(**changed))


@pytest.mark.parametrize("text", ["", "{", "[]", "7", "[" * 5000, None])
@pytest.mark.parametrize(
    ("topic", "decode"),
    [
        (STATE_TOPIC, node_state),
        (FINDINGS_TOPIC, findings_of),
        ("tirgeo/locate/answer", answer_of),
        ("tirgeo/targets", targets_of),
    ],
)
def test_what_is_no_document_is_refused(topic, decode, text):
    with pytest.raises(MessageError, match=f"^{topic}: "):
        decode(SimpleNamespace(data=text))


def test_another_version_and_one_without_end_are_named():
    with pytest.raises(MessageError, match="tirgeo/state: 100001 characters; 100000 are read"):
        node_state(SimpleNamespace(data=" " * 100_001))
    with pytest.raises(MessageError, match="tirgeo/state: its schema is not tirgeo/state/1"):
        node_state(state_document(schema="tirgeo/state/2"))


def test_findings_come_back_and_texts_from_outside_are_cut():
    long = dataclasses.replace(given.FINDING, evidence="x" * 5000, severity=Severity.NOTE)
    node, stamp_ns, found = findings_of(MADE.findings("/uav1/ekf_node", 5, [given.FINDING, long]))
    assert (node, stamp_ns, found[0]) == ("/uav1/ekf_node", 5, given.FINDING)
    assert len(found[1].evidence) == MOST
