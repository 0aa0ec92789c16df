"""Judge by all that reaches the page whether one aircraft can be relied on: one verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus, Outcome
from tirgeo_ros.nodes.aircraft_state import Heard, number

#: Silence (s) of what is needed, or time without a map, that ends GO; good time that restores it.
_SILENT_S, _GOOD_S = 1.0, 2.0
#: The longest step of time that counts: in a longer one this node did not run and heard nothing.
_STEP_S = 0.4
#: What a node reports of its inputs counts so long after its output ended. A node whose reports,
#: one a second, end for so long does not answer.
_EVIDENCE_S, _ANSWER_S = 0.3, 1.6


class Verdict(NamedTuple):
    """Hold what the page shows: ``text`` is for the operator, ``more`` for the engineer.

    ``kind`` says what it is about, and stays the same while the text counts seconds.
    """

    word: str
    tone: str  # good, caution, bad, or empty
    kind: str = ""
    text: str = ""
    more: str = ""
    alarm: bool = False


class Stream(NamedTuple):
    """Name a topic that is needed, the node that makes it, and of what; with words for people."""

    topic: str
    kind: str
    node: str
    program: str
    inputs: dict[str, str]  # by topic; the first one that the node has heard counts


_CAMERA = {"thermal/image_raw": "The camera", "thermal/image_raw/compressed": "The camera"}
_GIMBAL = {"gimbal/joint_states": "The gimbal", "gimbal/attitude": "The gimbal"}
_INFO = {"thermal/camera_info": "The camera's calibration"}
_OVERLAY = "overlay_node", "The overlay program"
#: In the order in which each depends on the ones before.
STREAMS = (
    Stream("tirgeo/odometry", "position", "ekf_node", "The filter", {"imu/data": "The IMU"}),
    Stream("tirgeo/camera_pose", "camera pose", "gimbal_node", "The gimbal program", _GIMBAL),
    Stream("tirgeo/overlay/image/compressed", "picture", *_OVERLAY, _CAMERA),
    Stream("tirgeo/overlay/camera_info", "calibration", *_OVERLAY, _INFO),
)
_LOST = "No position: the filter's errors grew too large"
_AGAIN = {
    Outcome.TIME_JUMP: "No position: the IMU's time went back",
    Outcome.GAP: "No position: the IMU was silent for too long",
}
_STATES = {
    FilterState.DEGRADED: "Less accurate: a receiver is not fixed or not heard",
    FilterState.DEAD_RECKONING: "Nothing measures the position: it drifts",
    FilterState.ALIGNING: "No position yet: the filter aligns itself",
    FilterState.WAITING: "No position: sensor data are missing",
}
_GO, _UNHEARD = (
    Verdict("GO", "good"),
    Verdict("NO DATA", "caution", "checks", "No check has reported"),
)
_BY_SEVERITY = {
    Severity.CAUTION: Verdict("CAUTION", "caution", "checks"),
    Severity.STOP: Verdict("NO GO", "bad", "checks"),
}


class Judge:
    """Make one aircraft's verdict, again and again, by a steady clock."""

    def __init__(self, heard: Heard) -> None:
        self._heard = heard
        self._last_s = math.inf  # of the last look
        self._came: dict[str, tuple[float | None, float]] = {}  # when it came, silence since, s
        self._no_map_s = self._good_s = 0.0
        self._shown = Verdict("NO DATA", "")

    def look(
        self,
        now_s: float,
        came_s: Mapping[str, float | None],
        findings: Sequence[Finding] | None = None,
        no_map: str | None = "",
        picture_s: float = 0.0,
    ) -> Verdict:
        """Return the verdict; ``came_s``: when the newest of each stream came, None: not yet.

        ``findings`` are the checks', None while they are silent; ``no_map`` is the notice in the
        picture; pictures are silent after ``picture_s``.
        """
        step_s = min(max(now_s - self._last_s, 0.0), _STEP_S)
        self._last_s = now_s
        for topic, at_s in came_s.items():
            self._count(topic, at_s, now_s, step_s)
        verdict = self._upstream(now_s, max(_SILENT_S, picture_s))
        self._no_map_s = self._no_map_s + step_s if no_map and not verdict else 0.0
        verdict = verdict or self._downstream(now_s, findings_verdict(findings), no_map or "")
        self._good_s = self._good_s + step_s if verdict == _GO else 0.0
        if verdict != _GO or self._good_s >= _GOOD_S:
            self._shown = verdict
        return self._shown

    def _count(self, topic: str, at_s: float | None, now_s: float, step_s: float) -> None:
        """Add up the silence of a topic while this node listened; what is forgotten is silent."""
        before_s, silence_s = self._came.get(topic, (None, 0.0))
        new = at_s is not None and at_s != before_s
        silence_s = min(now_s - at_s, step_s) if new and at_s else silence_s + step_s
        self._came[topic] = at_s if new else before_s, silence_s

    def _upstream(self, now_s: float, picture_s: float) -> Verdict | None:
        """Return the first fault on the way from the sensors to the picture."""
        odometry, pose, picture, _ = STREAMS
        navigation = navigation_verdict(self._heard.navigation(now_s)[0])
        no_position = navigation if navigation and navigation.word != "CAUTION" else None
        if no_position or self._came[odometry.topic][1] > _SILENT_S:
            self._came[pose.topic] = self._came[pose.topic][0], 0.0  # it cannot come yet
        ended = self._silent(pose, now_s, _SILENT_S) or self._silent(picture, now_s, picture_s)
        # What ends together does not end at one instant: the first in the order is the cause.
        limit_s = _SILENT_S / 2 if ended else _SILENT_S
        return (
            self._silent(odometry, now_s, limit_s, no_position)
            or no_position
            or self._silent(pose, now_s, limit_s)
            or ended
        )

    def _downstream(self, now_s: float, checks: Verdict | None, no_map: str) -> Verdict:
        """Return what is wrong though all comes; cautions last."""
        stops = checks if checks and checks.word != "CAUTION" else None
        if self._no_map_s > _SILENT_S:
            stops = stops or Verdict("NO GO", "bad", "map", no_map, alarm=True)
        info = None if no_map else self._silent(STREAMS[-1], now_s, math.inf)
        navigation = navigation_verdict(self._heard.navigation(now_s)[0])
        return stops or info or navigation or checks or _GO

    def _silent(
        self, stream: Stream, now_s: float, limit_s: float, reason: Verdict | None = None
    ) -> Verdict | None:
        """Return the verdict on a stream that is silent, or has not begun; None on any other.

        ``reason`` counts where no cause of the silence shows.
        """
        at_s, silence_s = self._came[stream.topic]
        if at_s is not None and silence_s <= limit_s:
            return None
        cause = self._cause(stream, now_s, silence_s)
        if cause is None and reason is not None:
            return reason
        text, name, for_s = cause or (f"No {stream.kind}", stream.topic, silence_s)
        begun = at_s is not None
        more = f"{name} silent for {for_s:.0f} s"
        return Verdict(
            "NO DATA", "bad" if begun else "caution", stream.kind, text, more, alarm=begun
        )

    def _cause(
        self, stream: Stream, now_s: float, silence_s: float
    ) -> tuple[str, str, float] | None:
        """Return what is silent, in words and by its name, and how long; None if none is."""
        then_s, ages = self._heard.newest(f"{stream.node}: topics")
        since_s = min(now_s - then_s, silence_s)
        if since_s >= _ANSWER_S:
            return f"{stream.program} does not answer", stream.node, since_s
        spoke_s = then_s - (now_s - silence_s)
        known = [topic for topic in stream.inputs if f"{topic} age [s]" in ages]
        if not known and spoke_s > _ANSWER_S:
            names = " and ".join(stream.inputs)
            return f"{next(iter(stream.inputs.values()))} sends nothing", names, silence_s
        age_s = number(ages[f"{known[0]} age [s]"]) if known else None
        if age_s is None or spoke_s < _EVIDENCE_S or age_s < spoke_s / 2:
            return None
        for_s = age_s + now_s - then_s
        return f"{stream.inputs[known[0]]} is silent for {for_s:.0f} s", known[0], for_s


def navigation_verdict(status: NavigationStatus | None) -> Verdict | None:
    """Return the verdict on the filter by its own status; None while it runs well."""
    if status is None:
        return Verdict("NO DATA", "caution", "position", "The filter has not reported", "ekf_node")
    if status.state is FilterState.RUNNING:
        return None
    if status.state is FilterState.LOST or status.began_again:
        text = _AGAIN.get(status.began_again or Outcome.RESTART, _LOST)
        return Verdict("LOST", "bad", "position", text, status.reason, alarm=True)
    word = "CAUTION" if status.state.navigating else "WAIT"
    return Verdict(word, "caution", "position", _STATES[status.state], status.reason)


def findings_verdict(findings: Sequence[Finding] | None) -> Verdict | None:
    """Return the verdict on what the nodes' checks have found; None if that is nothing."""
    if findings is None:
        return _UNHEARD
    return _BY_SEVERITY.get(max((one.severity for one in findings), default=Severity.NOTE))
