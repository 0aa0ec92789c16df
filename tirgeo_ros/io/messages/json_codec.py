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
"""Encode answers to clicks, targets, states and findings as JSON for programs, and decode them.

Each text is one ``std_msgs/String``: an object whose ``schema`` names its topic and version.
docs/outputs.md lists the fields. Nanoseconds are texts of digits, since many readers of JSON
round large numbers. ``/diagnostics`` has states and findings for people; no program parses it.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, TypeVar

from tirgeo_ros.core.config.overlay_parameters import POINT_SIGMAS, ConfidenceConfig
from tirgeo_ros.core.ground.backprojection import Reason
from tirgeo_ros.core.ground.ground_point import Answer, Located, Refusal
from tirgeo_ros.core.targets.target import KINDS, MOST_TARGETS, Target, known_status
from tirgeo_ros.core.types.errors import MessageError, TargetError, cut, shown
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus, Outcome

T = TypeVar("T")
ANSWER_TOPIC, TARGETS_TOPIC = "tirgeo/locate/answer", "tirgeo/targets"
STATE_TOPIC, FINDINGS_TOPIC = "tirgeo/state", "tirgeo/findings"
ANSWER_SCHEMA, TARGETS_SCHEMA = f"{ANSWER_TOPIC}/1", f"{TARGETS_TOPIC}/1"
_STATE_SCHEMA, _FINDINGS_SCHEMA = f"{STATE_TOPIC}/1", f"{FINDINGS_TOPIC}/1"
#: Most characters of a text. A target with the longest name has some 2000, each letter escaped.
_LONGEST_ANSWER, _LONGEST_LIST, _LONGEST = 10_000, 2000 * MOST_TARGETS, 100_000
_MOST_TOPICS = 100  # of a node
#: Raised by the decoders for a document of another form.
WRONG_FORM = (KeyError, TypeError, ValueError, AttributeError, OverflowError)
#: Key of a finding in JSON -> its field.
_FINDING = {"subject": "check", "evidence": "evidence", "parameter": "parameter", "remedy": "mend"}
_TABLES = ("test_ratios", "resets", "nis", "clipped")  # by name, of the navigation's state


def document_of(message: Any, topic: str, schema: str, longest: int) -> Any:
    """Return the JSON object of a ``std_msgs/String``. Raises MessageError for another text."""
    text = getattr(message, "data", None)
    if not isinstance(text, str):
        raise MessageError(f"{topic}: not a std_msgs/String: it is of a version before {schema}")
    if len(text) > longest:
        raise MessageError(f"{topic}: {len(text)} characters; at most {longest} are read")
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise MessageError(f"{topic}: not JSON: {shown(error, 100)}") from None
    if not isinstance(document, dict) or document.get("schema") != schema:
        raise MessageError(f"{topic}: its schema is not {schema}")
    return document


def answer_text(answer: Answer) -> str:
    """Return the answer to a click as JSON; ``answer_of`` is the inverse."""
    head = {"schema": ANSWER_SCHEMA, "stamp_ns": str(answer.stamp_ns)}
    u, v = (float(x) if math.isfinite(x) else None for x in answer.uv)
    pixel: dict[str, Any] = head | {"u": u, "v": v}
    if isinstance(answer, Refusal):
        reason = {"refused": answer.reason.name.lower(), "words": answer.reason.value}
        return json.dumps(pixel | reason)
    temperature_c = answer.temperature_c if math.isfinite(answer.temperature_c) else None
    place = _place_row(answer) | {"temperature_c": temperature_c}
    return json.dumps(pixel | {"refused": None} | place)


def answer_of(message: Any) -> Answer:
    """Decode ``tirgeo/locate/answer``. Raises MessageError if it is not a valid answer."""
    row = document_of(message, ANSWER_TOPIC, ANSWER_SCHEMA, _LONGEST_ANSWER)
    try:
        u, v = (math.nan if row[key] is None else float(row[key]) for key in ("u", "v"))
        if row["refused"] is not None:
            return Refusal(int(row["stamp_ns"]), (u, v), Reason[row["refused"].upper()])
        point = _point(row, (u, v), _number(row.get("temperature_c")))
    except WRONG_FORM as error:
        why = f"not a valid answer to a click: {shown(error, 100)}"
        raise MessageError(f"{ANSWER_TOPIC}: {why}") from None
    if point.fault:
        raise MessageError(f"{ANSWER_TOPIC}: {point.fault}")
    return point


def targets_text(targets: Sequence[Target]) -> str:
    """Return targets as JSON, without their notes; ``targets_of`` is the inverse."""
    rows = ", ".join(map(_target_text, targets))
    return f'{{"schema": "{TARGETS_SCHEMA}", "targets": [{rows}]}}'


@functools.lru_cache(maxsize=2 * MOST_TARGETS)  # only a target that changed is encoded again
def _target_text(target: Target) -> str:
    return json.dumps(target_row(target))


def target_row(target: Target) -> dict[str, Any]:
    """Return a target's fields except its note; its place is the average of its clicks."""
    place = target.place
    return {
        "id": target.id,
        "number": target.number,
        "name": target.name,
        "kind": target.kind,
        "aircraft": target.aircraft,
        "created_ns": str(target.created_ns),
        "changed_ns": str(target.changed_ns),
        "clicks": len(target.clicks),
        "clicks_agree": target.clicks_agree,
        "status": target.status,
        "stamp_ns": str(place.stamp_ns),
    } | _place_row(place)


def targets_of(message: Any) -> list[Target]:
    """Decode ``tirgeo/targets``; each target gets one click, at its place, and no note.

    Raises MessageError for another text, and for more than MOST_TARGETS: drawing them would delay
    the video.
    """
    rows = document_of(message, TARGETS_TOPIC, TARGETS_SCHEMA, _LONGEST_LIST).get("targets")
    if not isinstance(rows, list):
        raise MessageError(f"{TARGETS_TOPIC}: targets is not a list")
    if len(rows) > MOST_TARGETS:
        most = f"at most {MOST_TARGETS} can be drawn"
        raise MessageError(f"{TARGETS_TOPIC}: {len(rows)} targets; {most}")
    try:
        return [_target(row) for row in rows]
    except (*WRONG_FORM, TargetError) as error:
        raise MessageError(f"{TARGETS_TOPIC}: {shown(error, 300)}") from None


def _target(row: Mapping[str, Any]) -> Target:
    name, aircraft = cut(str(row["name"])), cut(str(row["aircraft"]))
    kind = row["kind"] if row["kind"] in KINDS else "other"
    times = int(row["created_ns"]), int(row["changed_ns"])
    own = str(row["id"]), int(row["number"]), name, kind, "", aircraft
    status = known_status(row.get("status"))  # which older recordings lack
    return Target(*own, *times, (_point(row),), status)


def _place_row(point: Located) -> dict[str, Any]:
    names = ("latitude_deg", "longitude_deg", "height_m", "covariance_enu")
    return {name: getattr(point, name) for name in names}


def _point(
    row: Mapping[str, Any],
    uv: tuple[float, float] = (math.nan, math.nan),
    temperature_c: float = math.nan,
) -> Located:
    latitude, longitude = float(row["latitude_deg"]), float(row["longitude_deg"])
    covariance = tuple(map(float, row["covariance_enu"]))
    stamp_ns, height_m = int(row["stamp_ns"]), float(row["height_m"])
    own = stamp_ns, latitude, longitude, height_m, covariance, uv
    return Located(*own, temperature_c=temperature_c)


@dataclass(frozen=True, slots=True)
class TopicState:
    """Hold the rate, age and latency of a node's input or output topic; None: unknown."""

    rate_hz: float
    age_s: float | None = None  # of an input: since its newest message
    latency_ms: float | None = None  # of an output: since the stamp, or the time of computing
    latency_p95_ms: float | None = None  # 95 % of the latencies are not longer than this
    unreadable: int = 0  # messages that could not be decoded
    failed: int = 0  # messages in whose callback the program failed
    lost: int = 0  # messages lost in transport


@dataclass(frozen=True, slots=True)
class PictureState:
    """Hold the state of overlay_node's newest picture."""

    notice: str  # why no map is drawn on it; empty if a map is drawn
    video_latency_s: float  # from the exposure to the stamp
    confidence: ConfidenceConfig  # ``POINT_SIGMAS`` of located points; all else is default
    newest_frame_ns: int = 0  # stamp of the newest frame received; 0 before the first


@dataclass(frozen=True, slots=True)
class NodeState:
    """Hold the state that a node reports."""

    node: str  # its full name
    stamp_ns: int
    started_ns: int  # on the clock of its computer
    topics: Mapping[str, TopicState] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)  # since its start
    navigation: NavigationStatus | None = None  # of ekf_node
    composition: str = ""  # of gimbal_node
    picture: PictureState | None = None  # of overlay_node

    @property
    def name(self) -> str:
        """Return the node's name without its namespace."""
        return self.node.rpartition("/")[2]


def state_text(state: NodeState) -> str:
    """Return a node's state as JSON for ``tirgeo/state``."""
    document: dict[str, Any] = {
        "schema": _STATE_SCHEMA,
        "node": state.node,
        "stamp_ns": str(state.stamp_ns),
        "started_ns": str(state.started_ns),
        "topics": {topic: asdict(topic_state) for topic, topic_state in state.topics.items()},
        "counts": dict(state.counts),
    }
    if state.navigation is not None:
        document["navigation"] = _navigation_row(state.navigation)
    if state.composition:
        document["composition"] = state.composition
    if state.picture is not None:
        sigmas = {name: getattr(state.picture.confidence, name) for name in POINT_SIGMAS}
        document["picture"] = {
            "notice": state.picture.notice,
            "newest_frame_ns": str(state.picture.newest_frame_ns),
            "video_latency_s": state.picture.video_latency_s,
            **sigmas,
        }
    return json.dumps(_finite(document), allow_nan=False)


def node_state(msg: Any) -> NodeState:
    """Decode ``tirgeo/state`` and cut its texts to size. Raises MessageError."""
    row = document_of(msg, STATE_TOPIC, _STATE_SCHEMA, _LONGEST)
    try:
        topics = list(row["topics"].items())[:_MOST_TOPICS]
        navigation, picture = row.get("navigation"), row.get("picture")
        return NodeState(
            node=cut(str(row["node"])),
            stamp_ns=int(row["stamp_ns"]),
            started_ns=int(row["started_ns"]),
            topics={cut(topic): _topic_state(state) for topic, state in topics},
            counts=_table(row["counts"], int),
            navigation=None if navigation is None else _navigation(navigation),
            composition=cut(str(row.get("composition", ""))),
            picture=None if picture is None else _picture(picture),
        )
    except WRONG_FORM as error:
        raise MessageError(f"{STATE_TOPIC}: not a node's state: {shown(error, 100)}") from None


def findings_text(node: str, stamp_ns: int, findings: Iterable[Finding]) -> str:
    """Return the findings of a node's checks as JSON for ``tirgeo/findings``."""
    rows = [finding_row(finding) for finding in findings]
    head = {"schema": _FINDINGS_SCHEMA, "node": node, "stamp_ns": str(stamp_ns)}
    return json.dumps(head | {"findings": rows})


def finding_row(finding: Finding) -> dict[str, str]:
    """Return the fields of a finding by their keys in JSON."""
    texts = {key: getattr(finding, name) for key, name in _FINDING.items()}
    return texts | {"severity": finding.severity.name}


def findings_of(msg: Any) -> tuple[str, int, list[Finding]]:
    """Decode ``tirgeo/findings``: node, stamp (ns), findings, texts cut. Raises MessageError."""
    row = document_of(msg, FINDINGS_TOPIC, _FINDINGS_SCHEMA, _LONGEST)
    try:
        findings = [
            Finding(
                severity=Severity[texts["severity"]],
                **{name: cut(str(texts[key])) for key, name in _FINDING.items()},
            )
            for texts in row["findings"]
        ]
        return cut(str(row["node"])), int(row["stamp_ns"]), findings
    except WRONG_FORM as error:
        raise MessageError(f"{FINDINGS_TOPIC}: not findings: {shown(error, 100)}") from None


def _topic_state(row: dict[str, Any]) -> TopicState:
    times = (row[name] for name in ("age_s", "latency_ms", "latency_p95_ms"))
    age_s, latency_ms, p95_ms = (None if value is None else float(value) for value in times)
    counts = (int(row[name]) for name in ("unreadable", "failed", "lost"))
    return TopicState(_number(row["rate_hz"]), age_s, latency_ms, p95_ms, *counts)


def _picture(row: dict[str, Any]) -> PictureState:
    row = {"focal_sigma": 0.0, **row}  # which older recordings lack
    sigmas: dict[str, Any] = {name: float(row[name]) for name in POINT_SIGMAS}
    latency_s = float(row["video_latency_s"])
    if not math.isfinite(latency_s + sum(sigmas.values())):
        raise ValueError("a number of the picture is not finite")
    notice, newest_ns = cut(str(row["notice"])), int(row["newest_frame_ns"])
    return PictureState(notice, latency_s, ConfidenceConfig(**sigmas), newest_ns)


def _navigation_row(status: NavigationStatus) -> dict[str, Any]:
    row = asdict(status)
    row["state"] = status.state.value
    row["began_again"] = status.began_again.value if status.began_again else None
    row["rtk_status"] = status.rtk_status.name.lower()
    row["heading_sigma_deg"] = math.degrees(row.pop("heading_sigma_rad"))
    row |= {key: dict(sorted(row[key].items())) for key in _TABLES}
    counts: dict[str, dict[str, int]] = {}
    for (source, outcome), number in sorted(status.counts.items()):
        counts.setdefault(source, {})[outcome] = number
    return row | {"counts": counts}


def _navigation(row: dict[str, Any]) -> NavigationStatus:
    again = row["began_again"]
    return NavigationStatus(
        method=cut(str(row["method"])),
        state=FilterState(row["state"]),
        reason=cut(str(row["reason"])),
        rtk_status=FixStatus[row["rtk_status"].upper()],
        heading_sigma_rad=math.radians(_number(row["heading_sigma_deg"])),
        counts={
            (cut(source), outcome): number
            for source, outcomes in row["counts"].items()
            for outcome, number in _table(outcomes, int).items()
        },
        test_ratios=_table(row["test_ratios"], _number),
        state_s=_number(row["state_s"]),
        resets=_table(row["resets"], int),
        last_reset=cut(str(row["last_reset"])),
        clipped=_table(row["clipped"], int),
        warnings=tuple(cut(str(text)) for text in row["warnings"]),
        nis=_table(row["nis"], _number),
        process_noise=cut(str(row["process_noise"])),
        vibration=tuple(_number(density) for density in row["vibration"]),
        began_again=Outcome(again) if again else None,
        gps_sigmas=float(row.get("gps_sigmas", 0.0)),
        imu_delay_s=_number(row.get("imu_delay_s")),  # older recordings lack it
        imu_delay_sigma_s=_number(row.get("imu_delay_sigma_s")),
    )


def _table(row: dict[str, Any], value: Callable[[Any], T]) -> dict[str, T]:
    return {cut(key): value(entry) for key, entry in row.items()}


def _number(value: Any) -> float:
    """Return a number of a document; null stands for a number that is not finite."""
    return math.nan if value is None else float(value)


def _finite(part: Any) -> Any:
    """Return a part of a document with null for each number that is not finite."""
    if isinstance(part, dict):
        return {key: _finite(value) for key, value in part.items()}
    if isinstance(part, list | tuple):
        return [_finite(value) for value in part]
    return None if isinstance(part, float) and not math.isfinite(part) else part
