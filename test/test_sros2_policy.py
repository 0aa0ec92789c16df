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
"""The SROS 2 policy as a file: its schema's rules, and that its parts fit each other."""

from __future__ import annotations

import fnmatch
import re
import xml.etree.ElementTree as ET

from project import NODES, PROJECT
from sros2_policy import allowed

POLICY = PROJECT / "config" / "sros2_policy.xml"


def test_the_policy_is_read_by_its_tools_as_it_looks_and_has_every_executable():
    root = ET.parse(POLICY).getroot()
    assert (root.tag, root.get("version")) == ("policy", "0.2.0")
    # `ros2 security generate_artifacts` takes each child of <enclaves>, a comment too, for an
    # enclave, and the first of two with one path.
    commented = ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))
    (enclaves,) = ET.parse(POLICY, commented).getroot().iter("enclaves")
    paths = [enclave.get("path") for enclave in enclaves if enclave.tag == "enclave"]
    assert len({*paths}) == len(enclaves)
    assert all(re.fullmatch(r"(/[a-z_0-9]+)+", path) for path in paths)
    nodes = allowed(POLICY)
    assert not NODES - nodes.keys()
    # Whoever sets the time can hold a graph in sim time still.
    assert {name for name, may in nodes.items() if "/clock" in may["publish"]} == {"bag_player"}


def test_whoever_listens_is_spoken_to_and_whoever_asks_is_answered():
    """But for psdk_ros2, whose own policy is its own."""
    nodes = allowed(POLICY, "/uav1").values()
    for there, here in (("publish", "subscribe"), ("reply", "request")):
        offered = set().union(*(node[there] for node in nodes))
        for name in set().union(*(node[here] for node in nodes)):
            if "/psdk_ros2/" not in name:
                assert fnmatch.filter(offered, name), name
