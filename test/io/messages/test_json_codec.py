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
"""What programs read comes back as it was given; what another program wrote is refused."""

from __future__ import annotations

import dataclasses
import json
import math
from types import SimpleNamespace

import message_samples as samples
import numpy as np
import pytest
from message_samples import LOCATED, STAMP_NS, TARGET

from tirgeo_ros.core.ground.backprojection import Reason
from tirgeo_ros.core.ground.ground_point import Refusal
from tirgeo_ros.core.targets.target import MOST_TARGETS
from tirgeo_ros.core.types.errors import MOST, MessageError
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.verdicts import FilterState
from tirgeo_ros.io.bags.bag import Cdr
from tirgeo_ros.io.messages import (
    FINDINGS_TOPIC,
    STATE_TOPIC,
    Messages,
    answer_of,
    findings_of,
    node_state,
    targets_of,
)
from tirgeo_ros.io.messages.json_codec import answer_text, findings_text, state_text, targets_text

MESSAGES = Messages()


def text_of(document):
    return Cdr.types("std_msgs/msg/String")(data=json.dumps(document))


def test_a_located_click_comes_back_to_the_last_digit():
    result = answer_of(MESSAGES.text(answer_text(LOCATED)))
    assert (result, result.uv) == (LOCATED, (12.25, 200.5))
    assert (
        json.loads(MESSAGES.text(answer_text(LOCATED)).data).items()
        >= {
            "schema": "tirgeo/locate/answer/1",
            "stamp_ns": str(STAMP_NS),
            "u": 12.25,
            "refused": None,
            "height_m": 99.5,
            "covariance_enu": list(LOCATED.covariance_enu),
        }.items()
    )


@pytest.mark.parametrize(("celsius", "written"), [(21.5, 21.5), (math.nan, None)])
def test_a_click_may_have_a_temperature(celsius, written):
    text = answer_text(dataclasses.replace(LOCATED, temperature_c=celsius))
    document = json.loads(text)
    assert document.pop("temperature_c") == written
    np.testing.assert_equal(answer_of(MESSAGES.text(text)).temperature_c, celsius)
    assert math.isnan(answer_of(text_of(document)).temperature_c)  # of an earlier version


@pytest.mark.parametrize("reason", Reason)
def test_a_refused_click_comes_back_with_its_reason(reason):
    refusal = Refusal(STAMP_NS, (-5.0, 3.0), reason)
    message = MESSAGES.text(answer_text(refusal))
    assert answer_of(message) == refusal
    assert json.loads(message.data)["words"] == reason.value
    nowhere = MESSAGES.text(answer_text(Refusal(7, (math.nan, math.inf), reason)))
    assert np.isnan(answer_of(nowhere).uv).all()


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"latitude_deg": math.nan}, "not a located point"),
        ({"latitude_deg": 91.0}, "not a located point"),
        ({"covariance_enu": [1.0, 2.0]}, "not a located point"),
        ({"covariance_enu": [math.inf] * 9}, "not a located point"),
        ({"u": "left"}, "not a valid answer to a click"),
        ({"refused": "weather"}, "not a valid answer to a click"),
        ({"stamp_ns": None}, "not a valid answer to a click"),
        ({"schema": "tirgeo/locate/answer/2"}, "its schema is not tirgeo/locate/answer/1"),
        ({"words": "x" * 10_000}, "10000 are read"),
    ],
)
def test_an_answer_that_cannot_be_is_refused(changed, reason):
    document = json.loads(MESSAGES.text(answer_text(LOCATED)).data) | changed
    with pytest.raises(MessageError, match=f"tirgeo/locate/answer: .*{reason}"):
        answer_of(text_of(document))


def test_a_message_of_an_earlier_version_is_named():
    """It was a DiagnosticArray, and a MarkerArray."""
    with pytest.raises(MessageError, match="it is of a version before tirgeo/locate/answer/1"):
        answer_of(MESSAGES.diagnostics(STAMP_NS, []))
    with pytest.raises(MessageError, match="it is of a version before tirgeo/targets/1"):
        targets_of(Cdr.types("visualization_msgs/msg/MarkerArray")(markers=[]))


def test_targets_come_back_without_notes_each_with_one_click():
    other = dataclasses.replace(
        TARGET, id="2" * 32, name='"\n\u00e4', note="secret", clicks=(LOCATED, LOCATED)
    )
    other = dataclasses.replace(other, status="found")
    message = MESSAGES.text(targets_text([TARGET, other]))
    assert "secret" not in message.data
    assert targets_of(message) == [
        TARGET,
        dataclasses.replace(other, note="", clicks=(other.place,)),
    ]
    assert json.loads(message.data)["targets"][1]["clicks"] == 2
    assert targets_of(MESSAGES.text(targets_text([]))) == []
    moved = dataclasses.replace(TARGET, clicks=(dataclasses.replace(LOCATED, height_m=1.0),))
    # Of the same id, written anew.
    assert targets_of(MESSAGES.text(targets_text([moved]))) == [moved]


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"height_m": math.inf}, "not a located point"),
        ({"covariance_enu": [1.0] * 8}, "not a located point"),
        ({"number": "one"}, "tirgeo/targets"),
        ({"name": None, "kind": "cow"}, ""),
    ],
)
def test_targets_that_cannot_be_or_are_too_many_are_refused(changed, reason):
    document = json.loads(MESSAGES.text(targets_text([TARGET])).data)
    many = document["targets"] * (MOST_TARGETS + 1)
    with pytest.raises(MessageError, match=f"{MOST_TARGETS} can be drawn"):
        targets_of(text_of(document | {"targets": many}))
    with pytest.raises(MessageError, match="targets is not a list"):
        targets_of(text_of(document | {"targets": 7}))
    document["targets"][0] |= changed
    if not reason:  # of a later version: drawn all the same
        assert targets_of(text_of(document))[0].kind == "other"
        return
    with pytest.raises(MessageError, match=reason):
        targets_of(text_of(document))


def state_document(**changed) -> SimpleNamespace:
    return SimpleNamespace(
        data=json.dumps(json.loads(MESSAGES.text(state_text(samples.STATE)).data) | changed)
    )


def test_a_state_comes_back_with_all_that_it_has():
    read = node_state(MESSAGES.text(state_text(samples.STATE)))
    sigma_rad = read.navigation.heading_sigma_rad
    assert sigma_rad == pytest.approx(samples.STATUS.heading_sigma_rad, rel=1e-15)
    assert dataclasses.replace(read, navigation=samples.STATUS) == samples.STATE
    assert dataclasses.replace(read.navigation, heading_sigma_rad=0.0123) == samples.STATUS
    assert read.name == "overlay_node"
    assert [*read.navigation.test_ratios] == ["rtk_heading", "rtk_position"]  # by name
    bare = dataclasses.replace(samples.STATE, navigation=None, composition="", picture=None)
    assert node_state(MESSAGES.text(state_text(bare))) == bare


@pytest.mark.parametrize("state", FilterState)
def test_every_state_of_the_filter_comes_back(state):
    status = dataclasses.replace(samples.STATUS, state=state, began_again=None)
    read = node_state(
        MESSAGES.text(state_text(dataclasses.replace(samples.STATE, navigation=status)))
    )
    assert (read.navigation.state, read.navigation.began_again) == (state, None)


def test_what_is_not_finite_is_null_and_comes_back_as_nan():
    """JSON has no nan, and a page's parser refuses it."""
    status = dataclasses.replace(samples.STATUS, heading_sigma_rad=math.nan, nis={"imu": math.inf})
    message = MESSAGES.text(state_text(dataclasses.replace(samples.STATE, navigation=status)))
    assert json.loads(message.data)["navigation"]["heading_sigma_deg"] is None
    read = node_state(message).navigation
    assert math.isnan(read.heading_sigma_rad)
    assert math.isnan(read.nis["imu"])


NAVIGATION = json.loads(MESSAGES.text(state_text(samples.STATE)).data)["navigation"]
PICTURE = json.loads(MESSAGES.text(state_text(samples.STATE)).data)["picture"]


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
    with pytest.raises(MessageError, match="tirgeo/state: not a node's state: "):
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
    with pytest.raises(
        MessageError, match="tirgeo/state: 100001 characters; at most 100000 are read"
    ):
        node_state(SimpleNamespace(data=" " * 100_001))
    with pytest.raises(MessageError, match="tirgeo/state: its schema is not tirgeo/state/1"):
        node_state(state_document(schema="tirgeo/state/2"))


def test_findings_come_back_and_texts_from_outside_are_cut():
    long = dataclasses.replace(samples.FINDING, evidence="x" * 5000, severity=Severity.NOTE)
    node, stamp_ns, result = findings_of(
        MESSAGES.text(findings_text("/uav1/ekf_node", 5, [samples.FINDING, long]))
    )
    assert (node, stamp_ns, result[0]) == ("/uav1/ekf_node", 5, samples.FINDING)
    assert len(result[1].evidence) == MOST
