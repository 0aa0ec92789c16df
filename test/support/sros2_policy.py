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
"""What an SROS 2 policy allows, by full names, as its permissions.xsl makes them."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections import defaultdict
from pathlib import Path

_NAME = re.compile(r"(/|~/)?[A-Za-z_*][A-Za-z0-9_*]*(/[A-Za-z_*][A-Za-z0-9_*]*)*")
_RULES = {
    "topics": {"publish", "subscribe"},
    "services": {"reply", "request"},
    "actions": {"call", "execute"},
}

#: By permission (publish, subscribe, reply, request): full names.
Permissions = dict[str, set[str]]


def allowed(path: Path, namespace: str = "/") -> dict[str, Permissions]:
    """What the policy allows each node, with ``namespace`` in place of every ``ns="/"``."""
    result: dict[str, Permissions] = {}
    for profile in ET.parse(path).getroot().iter("profile"):
        assert profile.get("ns") == "/"
        permissions = result.setdefault(profile.get("node", ""), defaultdict(set))
        for rule in profile:
            assert {*rule.attrib} <= _RULES[rule.tag]
            for permission, qualifier in rule.attrib.items():
                assert qualifier == "ALLOW"  # what is not allowed is denied anyway
                names = {_full(item.text or "", namespace, profile) for item in rule}
                permissions[permission] |= names
    return result


def _full(name: str, namespace: str, profile: ET.Element) -> str:
    # A blank within the element would be a part of the name.
    assert _NAME.fullmatch(name), name
    base = namespace.rstrip("/")
    if name.startswith("/"):
        return name
    if name.startswith("~"):
        return f"{base}/{profile.get('node')}{name[1:]}"
    return f"{base}/{name}"
