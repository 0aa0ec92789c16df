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
"""The container and the workflows agree with the rest, and pin what they use."""

from __future__ import annotations

import json
import re
import shlex

import pytest
import yaml
from project import PROJECT

from tirgeo_ros.tools.cli.main import parser_of, verbs

DOCKERFILE = (PROJECT / "Dockerfile").read_text()
WORKFLOWS = sorted(PROJECT.glob(".github/workflows/*.yml"))


def load(path):
    return yaml.safe_load(path.read_text())


def test_the_container_runs_the_line_of_the_systemd_unit():
    words = json.loads(re.search(r"^CMD (.+)$", DOCKERFILE, re.MULTILINE)[1])
    unit = (PROJECT / "config" / "systemd" / "tirgeo.service").read_text()
    line = re.search(r"exec \S+/(tirgeo .+)'$", unit, re.MULTILINE)[1]
    assert words == shlex.split(line)
    parser_of(verbs()).parse_args(words[1:])


def test_the_compose_file_mounts_what_the_container_reads_and_writes():
    service = load(PROJECT / "compose.yaml")["services"]["tirgeo"]
    targets = {volume["target"]: volume.get("read_only", False) for volume in service["volumes"]}
    assert targets == {"/etc/tirgeo": True, "/var/lib/tirgeo": False}
    assert "/etc/tirgeo/aircraft.yaml" in DOCKERFILE
    assert "ENV HOME=/var/lib/tirgeo" in DOCKERFILE
    assert (service["network_mode"], service["ipc"]) == ("host", "host")


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_a_workflow_pins_its_actions_and_may_only_read(path):
    workflow = load(path)
    assert workflow["permissions"] == {"contents": "read"}
    assert "group" in workflow["concurrency"]
    for job in workflow["jobs"].values():
        assert job["timeout-minutes"] <= 90
        assert "permissions" not in job
    used = re.findall(r"uses: (.+)$", path.read_text(), re.MULTILINE)
    assert used
    assert all(
        re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40}  # v\d+\.\d+\.\d+", each) for each in used
    )


def test_the_make_targets_of_the_workflows_exist():
    targets = re.findall(r"^([a-z0-9-]+):.*##", (PROJECT / "Makefile").read_text(), re.MULTILINE)
    lines = [
        line for path in WORKFLOWS for line in re.findall(r"run: make (.+)", path.read_text())
    ]
    called = {word for line in lines for word in line.split() if "=" not in word}
    assert {"test", "test-floor", "lint", "types", "release"} <= called <= {*targets}


@pytest.mark.parametrize(
    "path", sorted(PROJECT.glob(".github/ISSUE_TEMPLATE/[!c]*.yml")), ids=lambda path: path.name
)
def test_a_form_asks_for_something_that_is_required(path):
    form = load(path)
    fields = [field for field in form["body"] if field["type"] != "markdown"]
    assert {"name", "description", "body"} <= form.keys()
    assert len({field["id"] for field in fields}) == len(fields)
    assert any(field.get("validations", {}).get("required") for field in fields)
