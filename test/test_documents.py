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
"""The documents: links lead somewhere, what they name exists."""

from __future__ import annotations

import pkgutil
import re
from pathlib import Path

import pytest
from project import NODES, PROJECT

from tirgeo_ros.core.config import EkfConfig, GimbalConfig, OverlayConfig
from tirgeo_ros.core.config.schema import parameters_of
from tirgeo_ros.io.messages import NAVIGATION_INPUTS, TOPIC_TYPES
from tirgeo_ros.tools.cli import calibrate
from tirgeo_ros.tools.cli.main import verbs

PAGES = [*sorted(PROJECT.glob("*.md")), *sorted(PROJECT.glob("docs/*.md"))]
LINK = re.compile(r"\]\((?!https?:)([^)\s]+)\)")
FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"`[^`]+`|^(?: {4,}|\t).*$", re.MULTILINE)


INPUTS = (PROJECT / "docs" / "inputs.md").read_text()
OTHER_INPUTS = {
    "gimbal/joint_states",
    "gimbal/attitude",
    "thermal/image_raw",
    "thermal/image_raw/compressed",
    "thermal/temperature/compressed",
    "thermal/camera_info",
    "tirgeo/locate/pixel",
}


def ids(path: Path) -> str:
    return str(path.relative_to(PROJECT))


def anchors(page: Path) -> set[str]:
    """Return the anchors that GitHub makes of a page's headings."""
    headings = re.findall(r"^#+ (.+)$", FENCE.sub("", page.read_text()), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def code(page: Path) -> str:
    """Return a page's code: what stands between backticks, in fences, or indented."""
    text = page.read_text()
    return "\n".join([*FENCE.findall(text), *CODE.findall(FENCE.sub("", text))])


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_links_lead_somewhere(page):
    for link in LINK.findall(FENCE.sub("", page.read_text())):
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_files_make_targets_and_verbs_exist(page):
    text = code(page)
    named = re.findall(r"(?<![/\w])((?:tirgeo_ros|dev|test|config|bags)/[\w./-]*\w)", text)
    assert [name for name in named if not (PROJECT / name).exists()] == []
    rules = (PROJECT / "Makefile").read_text()
    targets = set(re.findall(r"^([a-z0-9-]+):.*##", rules, re.MULTILINE))
    assert set(re.findall(r"\bmake ([a-z][a-z0-9-]*)", text)) <= targets
    all_verbs = {verb.__name__.rpartition(".")[2].rstrip("_") for verb in verbs()}
    calibrations = {module.name for module in pkgutil.iter_modules(calibrate.__path__)}
    command = re.compile(r"(?:^\s*|`|/)tirgeo ([a-z]+)(?: ([a-z]+)\b)?", re.MULTILINE)
    named = command.findall(text.replace("ros2 run tirgeo tirgeo", "tirgeo"))
    assert {verb for verb, _ in named} <= all_verbs
    assert {what for verb, what in named if verb == "calibrate" and what} <= calibrations


def test_every_feature_has_its_row_with_tests():
    """What a reader of REP-2004's points 3.i and 4.i looks for."""
    declaration = (PROJECT / "QUALITY_DECLARATION.md").read_text()
    _, _, table = declaration.partition("## Features and their tests")
    rows = re.findall(r"^\| (.+) \| (.+\.md.+) \| (`test/.+) \|$", table, re.MULTILINE)
    features = " ".join(feature for feature, _, _ in rows)
    all_verbs = {f"tirgeo {verb.__name__.rpartition('.')[2].rstrip('_')}" for verb in verbs()}
    assert all_verbs | NODES == set(re.findall(r"`(tirgeo \w+|\w+_node|bag_player)`", features))


def test_every_input_is_there_with_its_type():
    rows = dict(re.findall(r"^\| `([a-z_/]+)` \| ([a-z_]+/[A-Za-z]+) \|", INPUTS, re.MULTILINE))
    inputs = {topic for topic, _ in NAVIGATION_INPUTS.values()} | OTHER_INPUTS
    assert rows == {topic: TOPIC_TYPES[topic].replace("/msg/", "/") for topic in inputs}


def test_every_parameter_on_the_page_is_one():
    parameters = {
        parameter.name
        for config in (EkfConfig, GimbalConfig, OverlayConfig)
        for parameter in parameters_of(config)
    }
    named = re.findall(r"`((?:[a-z]+\.)?[a-z_]+_(?:s|m|m_s|deg))`", INPUTS)
    assert named
    assert set(named) <= parameters
