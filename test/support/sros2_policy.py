"""An SROS 2 policy as its tools read it: the rules of policy.xsd 0.2.0, and names in full.

The rules are those of sros2/policy/schemas/policy.xsd, the names those of its permissions.xsl.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

#: Of each element: its attributes (True: required) and the elements within it.
_RULES: dict[str, tuple[dict[str, bool], set[str]]] = {
    "policy": ({"version": True}, {"enclaves"}),
    "enclaves": ({}, {"enclave"}),
    "enclave": ({"path": True}, {"profiles"}),
    "profiles": ({"type": False}, {"profile"}),
    "profile": ({"ns": True, "node": True}, {"topics", "services", "actions"}),
    "topics": ({"publish": False, "subscribe": False}, {"topic"}),
    "services": ({"reply": False, "request": False}, {"service"}),
    "actions": ({"call": False, "execute": False}, {"action"}),
    "topic": ({}, set()),
    "service": ({}, set()),
    "action": ({}, set()),
}
_MAY_BE_EMPTY = {"profile", "topic", "service", "action"}
_NAME = re.compile(r"(/|~/)?[A-Za-z_*][A-Za-z0-9_*]*(/[A-Za-z_*][A-Za-z0-9_*]*)*")

#: By permission (publish, subscribe, reply, request): full names.
Permissions = dict[str, set[str]]


def breaches(path: Path) -> list[str]:
    """What of the file its schema refuses, or its tools read otherwise than it looks."""
    parser = ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))
    root = ET.parse(path, parser).getroot()
    found = [] if (root.tag, root.get("version")) == ("policy", "0.2.0") else ["no policy 0.2.0"]
    found += [text for element in root.iter() for text in _breaches_of(element)]
    # `ros2 security generate_artifacts` takes each child of <enclaves> for an enclave.
    found += ["enclaves: a comment" for e in root.iter("enclaves") for c in e if _is_comment(c)]
    paths = [enclave.get("path") or "" for enclave in root.iter("enclave")]
    found += [f"{p}: no enclave's path" for p in paths if not re.fullmatch(r"(/[a-z_0-9]+)+", p)]
    # The tools take the first enclave of a path and pass over the others.
    return found + [f"{p}: more than once" for p in sorted(set(paths)) if paths.count(p) > 1]


def _breaches_of(element: ET.Element) -> Iterator[str]:
    if _is_comment(element):
        return
    if element.tag not in _RULES:
        yield f"{element.tag}: unknown element"
        return
    attributes, children = _RULES[element.tag]
    tags = [child.tag for child in element if not _is_comment(child)]
    wrong = {tag for tag in tags if tag not in children}
    wrong |= {name for name in element.attrib if name not in attributes}
    wrong |= {name for name, needed in attributes.items() if needed and name not in element.attrib}
    if wrong or (not tags and element.tag not in _MAY_BE_EMPTY):
        yield f"{element.tag} {element.attrib}: {sorted(wrong) or 'empty'}"
    qualifiers = set(element.attrib.values()) if element.tag.endswith("s") else set()
    if element.tag in {"topics", "services", "actions"} and not (
        qualifiers and qualifiers <= {"ALLOW", "DENY"}
    ):
        yield f"{element.tag}: {element.attrib}"
    text = element.text or ""
    # A blank within the element would be a part of the name.
    if not children and not _NAME.fullmatch(text):
        yield f"{element.tag}: {text!r} is no name"
    if children and text.strip():
        yield f"{element.tag}: text {text.strip()!r}"


def _is_comment(element: ET.Element) -> bool:
    return element.tag is ET.Comment


def allowed(path: Path, namespace: str = "/") -> dict[str, Permissions]:
    """What the policy allows each node, with ``namespace`` in place of every ``ns="/"``."""
    found: dict[str, Permissions] = {}
    for profile in ET.parse(path).getroot().iter("profile"):
        assert profile.get("ns") == "/"
        permissions = found.setdefault(profile.get("node", ""), defaultdict(set))
        for rule in profile:
            for permission, qualifier in rule.attrib.items():
                assert qualifier == "ALLOW"  # what is not allowed is denied anyway
                names = {_full(item.text or "", namespace, profile) for item in rule}
                permissions[permission] |= names
    return found


def _full(name: str, namespace: str, profile: ET.Element) -> str:
    base = namespace.rstrip("/")
    if name.startswith("/"):
        return name
    if name.startswith("~"):
        return f"{base}/{profile.get('node')}{name[1:]}"
    return f"{base}/{name}"
