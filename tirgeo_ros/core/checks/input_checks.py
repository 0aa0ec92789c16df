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
"""Check a flight's topics, parameters and lens calibration before its samples are read.

Topics of a recording or of a running graph may be absent, or have another type or name.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.checks.finding_table import finding
from tirgeo_ros.core.types.finding import Finding, Severity

_PICTURES = ("thermal/image_raw", "thermal/image_raw/compressed")
GIMBAL = ("gimbal/joint_states", "gimbal/attitude")
_CAMERA_INFO = "thermal/camera_info"
_POSITIONS = ("rtk/fix", "gps/fix")
_UNREADABLE_SHARE = 0.01
#: Parameters that give the ground's height but do not describe the aircraft.
_GROUND = ("ground_height_m", "dem")
#: Largest offset of the principal point, in picture widths: no lens is mounted further off.
_ASIDE = 0.1
_NARROWEST_DEG, _WIDEST_DEG = 5.0, 120.0


@dataclass(frozen=True)
class RecordedTopics:
    """Hold the topics of a bag or a graph, and those that it should have."""

    topics: Mapping[str, str]  # name to type, of the bag or the graph
    contract: Mapping[str, str]  # topic to type, of the inputs, without a namespace
    namespace: str = ""
    has_camera: bool = False  # whether a calibration replaces thermal/camera_info
    wants_pictures: bool = True  # whether something may be drawn
    live: bool = False  # whether it is a graph, not a bag

    def name(self, topic: str) -> str:
        """Return the full name of an input topic."""
        space = self.namespace.strip("/")
        return f"/{space}/{topic}" if space else f"/{topic}"

    @property
    def present(self) -> set[str]:
        """Return the input topics that are present with the right type."""
        names = self.contract.items()
        return {topic for topic, kind in names if self.topics.get(self.name(topic)) == kind}

    def elsewhere(self, wanted: Sequence[str]) -> list[tuple[str, str]]:
        """Return ``wanted`` input topics with the names that they have in other namespaces."""
        return [
            (topic, name)
            for name, kind in self.topics.items()
            for topic in wanted
            if name.endswith(f"/{topic}") and kind == self.contract[topic]
            if name != self.name(topic)
        ]


def recording_findings(recording: RecordedTopics) -> list[Finding]:
    """Return what is wrong with a recording's or a graph's topics."""
    contract = list(recording.contract)
    others = recording.elsewhere(contract)
    if others and not any(recording.name(topic) in recording.topics for topic in contract):
        spaces = [name.rsplit("/", topic.count("/") + 1)[0] for topic, name in others]
        space = max(spaces, key=spaces.count).strip("/")
        texts = {"name": recording.name(""), "space": space, "option": space or "/"}
        return [finding("namespace", **texts, others=len(others))]  # all others follow from it
    needed: list[tuple[str, ...]] = [("imu/data",), _POSITIONS]
    if recording.present.intersection(_PICTURES):
        needed += [GIMBAL] if recording.has_camera else [GIMBAL, (_CAMERA_INFO,)]
    findings = needed_findings(recording, needed)
    if not recording.wants_pictures:  # poses of the body need neither gimbal nor lens
        return [
            each
            if {*GIMBAL, _CAMERA_INFO}.isdisjoint(each.parameter.split(" or "))
            else replace(each, severity=min(each.severity, Severity.CAUTION))
            for each in findings
        ]
    if {*recording.present, *(each.parameter for each in findings)}.isdisjoint(_PICTURES):
        # Recorded without pictures, or with pictures under another name.
        kinds = {recording.contract[topic] for topic in _PICTURES}
        near = [name for name, kind in recording.topics.items() if kind in kinds]
        names = " nor ".join(map(recording.name, _PICTURES))
        case = "near" if near else ""
        findings.append(finding("no_pictures", case, names=names, hint=_hint(near)))
    return findings


def _hint(near: Sequence[str]) -> str:
    return f" (there is {', '.join(near)})" if near else ""


def needed_findings(recording: RecordedTopics, needed: Sequence[Sequence[str]]) -> list[Finding]:
    """Return findings on topics of wrong type, and on ``needed`` groups without any topic."""
    missed = [topics for topics in needed if not recording.present.intersection(topics)]
    findings = []
    for topic, wanted in recording.contract.items():
        name = recording.name(topic)
        kind = recording.topics.get(name, wanted)
        if kind != wanted:
            case = "needed" if any(topic in topics for topics in missed) else ""
            texts = {"name": name, "kind": kind or "message of no type", "wanted": wanted}
            findings.append(finding("type_of_{topic}", case, topic=topic, **texts))
    wrong = {each.parameter for each in findings}
    absent = [_absent(recording, topics) for topics in missed if not wrong.intersection(topics)]
    return [*findings, *absent]


def _absent(recording: RecordedTopics, topics: Sequence[str]) -> Finding:
    near = [name for _, name in recording.elsewhere(topics)]
    names = f"{'neither' if len(topics) > 1 else 'no'} {' nor '.join(map(recording.name, topics))}"
    remap = ", or remap it" if recording.live else ", or give --namespace or a remapping"
    option = "the parameter camera" if recording.live else "--camera"
    has_file = _CAMERA_INFO in topics
    return finding(
        "no_{topic}",
        "graph" if recording.live else "",
        topic=topics[0],
        topics=" or ".join(topics),
        names=names,
        hint=_hint(near),
        remap=remap if near else "",
        calibration=f", or give its calibration with {option}" if has_file else "",
    )


def unreadable_findings(
    read: Mapping[str, int], refused: Mapping[str, int], reasons: Mapping[str, str]
) -> list[Finding]:
    """Return the topics with many unusable messages, with the newest reason.

    ``read`` and ``refused`` are numbers of messages by topic. A few may be damaged on a link.
    """
    findings = []
    for topic, number in refused.items():
        total = number + read.get(topic, 0)
        if number < max(_UNREADABLE_SHARE * total, 2) and number < total:
            continue
        numbers = {"refused": number, "messages": total}
        case, reason = "some" if read.get(topic) else "", reasons[topic]
        findings.append(finding("unreadable_{topic}", case, topic=topic, reason=reason, **numbers))
    return findings


def parameter_findings(
    explicit: Collection[str],
    unused: Sequence[str],
    namespace: str,
    *,
    pictures: bool,
    option: str = "--params",
) -> list[Finding]:
    """Return what is wrong with the parameters that were set explicitly.

    ``unused`` are sections for nodes that do not run. ``pictures`` is whether the flight has
    pictures or a gimbal. ``option`` is the option that names parameter files.
    """
    findings = []
    if unused:
        where = f"/{namespace.strip('/')}" if namespace.strip("/") else "no namespace"
        texts = {"where": where, "sections": ", ".join(unused), "option": option}
        findings.append(finding("parameters_elsewhere", **texts))
    if pictures and set(explicit) <= {"camera", "method", *_GROUND}:
        has_ground = any(name in explicit for name in _GROUND)
        ground = "" if has_ground else "; the ground's height is not set"
        findings.append(finding("no_parameters", ground=ground, option=option))
    return findings


def size_fault(camera: Camera, width: int, height: int) -> str:
    """Return why a calibration does not fit a picture's size; empty if the sizes are equal."""
    if (camera.width, camera.height) == (width, height):
        return ""
    size = f"{camera.width}x{camera.height}"
    return f"the calibration is of {size} pixels and the pictures have {width}x{height}"


def lens_findings(camera: Camera, lens: str, size: tuple[int, int] | None = None) -> list[Finding]:
    """Return what is wrong with a calibration for pictures of ``size`` (width, height), if known.

    ``lens`` names its source.
    """
    findings = []
    texts = {"lens_size": f"{camera.width}x{camera.height}", "lens": lens}
    if size is not None and size != (camera.width, camera.height):
        findings.append(finding("picture_size", size=f"{size[0]}x{size[1]}", **texts))
    right, down = camera.cx - (camera.width - 1) / 2, camera.cy - (camera.height - 1) / 2
    aside_px = math.hypot(right, down)
    if aside_px > _ASIDE * camera.width:
        share = aside_px / camera.width
        numbers = {"cx": camera.cx, "cy": camera.cy, "aside_px": aside_px, "share": share}
        findings.append(finding("principal_point", **numbers, **texts))
    view_deg = 2 * math.degrees(math.atan(camera.width / 2 / camera.fx))
    if not _NARROWEST_DEG <= view_deg <= _WIDEST_DEG:
        findings.append(finding("field_of_view", view_deg=view_deg, focal_px=camera.fx, lens=lens))
    return findings
