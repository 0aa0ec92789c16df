"""Judge by all that reaches the page whether one aircraft can be relied on: one verdict."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from tirgeo_ros.core.types.finding import Severity
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
_GO = Verdict("GO", "good")
_CHECKS = {
    None: Verdict("NO DATA", "caution", "checks", "No check has reported"),
    Severity.CAUTION: Verdict("CAUTION", "caution", "checks"),
    Severity.STOP: Verdict("NO GO", "bad", "checks"),
}


class Judge:
    """Make one aircraft's verdict, again and again, by a steady clock."""

    def __init__(self, heard: Heard) -> None:
        self._heard = heard
        self._now_s = math.inf  # of the last look
        self._came: dict[str, tuple[float | None, float]] = {}  # when it came, silence since, s
        self._no_map_s = self._good_s = 0.0
        self._shown = Verdict("NO DATA", "")

    def look(
        self,
        now_s: float,
        came_s: Callable[[str], float | None],
        worst: Severity | None,
        no_map: str,
    ) -> Verdict:
        """Return the verdict; ``came_s`` says when the newest of a topic came, None: not yet.

        ``worst`` is that of the checks' findings, None while they are silent; ``no_map`` is the
        notice in the picture.
        """
        step_s = min(max(now_s - self._now_s, 0.0), _STEP_S)
        self._now_s = now_s
        for stream in STREAMS:
            self._count(stream.topic, came_s(stream.topic), step_s)
        navigation = navigation_verdict(self._heard.navigation(now_s)[0])
        upstream = self._upstream(navigation)
        self._no_map_s = self._no_map_s + step_s if no_map and not upstream else 0.0
        verdict = upstream or self._downstream(_CHECKS.get(worst), no_map) or navigation or _GO
        self._good_s = self._good_s + step_s if verdict == _GO else 0.0
        if verdict != _GO or self._good_s >= _GOOD_S:
            self._shown = verdict
        return self._shown

    def _count(self, topic: str, at_s: float | None, step_s: float) -> None:
        """Add up the silence of a topic while this node listened; what is forgotten is silent."""
        before_s, silence_s = self._came.get(topic, (None, 0.0))
        if at_s is None or at_s == before_s:
            self._came[topic] = before_s, silence_s + step_s
        else:
            self._came[topic] = at_s, min(self._now_s - at_s, step_s)

    def _upstream(self, navigation: Verdict | None) -> Verdict | None:
        """Return the first fault on the way from the sensors to the picture."""
        odometry, pose, picture, _ = STREAMS
        no_position = navigation if navigation and navigation.word != "CAUTION" else None
        if no_position or self._came[odometry.topic][1] > _SILENT_S:
            self._came[pose.topic] = self._came[pose.topic][0], 0.0  # it cannot come yet
        ended = self._silent(pose, _SILENT_S) or self._silent(picture, _SILENT_S)
        # What ends together does not end at one instant: the first in the order is the cause.
        limit_s = _SILENT_S / 2 if ended else _SILENT_S
        return (
            self._silent(odometry, limit_s, no_position)
            or no_position
            or self._silent(pose, limit_s)
            or ended
        )

    def _downstream(self, checks: Verdict | None, no_map: str) -> Verdict | None:
        """Return what is wrong though all comes, the checks' caution last."""
        if checks and checks.word != "CAUTION":
            return checks
        if self._no_map_s > _SILENT_S:
            return Verdict("NO GO", "bad", "map", no_map, alarm=True)
        return (None if no_map else self._silent(STREAMS[-1], math.inf)) or checks

    def _silent(
        self, stream: Stream, limit_s: float, reason: Verdict | None = None
    ) -> Verdict | None:
        """Return the verdict on a stream that is silent, or has not begun; None on any other.

        ``reason`` counts where no cause of the silence shows.
        """
        at_s, silence_s = self._came[stream.topic]
        if at_s is not None and silence_s <= limit_s:
            return None
        cause = self._cause(stream, silence_s)
        if cause is None and reason is not None:
            return reason
        text, name, for_s = cause or (f"No {stream.kind}", stream.topic, silence_s)
        tone = "caution" if at_s is None else "bad"
        more = f"{name} silent for {for_s:.0f} s"
        return Verdict("NO DATA", tone, stream.kind, text, more, alarm=at_s is not None)

    def _cause(self, stream: Stream, silence_s: float) -> tuple[str, str, float] | None:
        """Return what is silent, in words and by its name, and how long; None if none is."""
        then_s, ages = self._heard.newest(f"{stream.node}: topics")
        ago_s = self._now_s - then_s
        if min(ago_s, silence_s) >= _ANSWER_S:
            return f"{stream.program} does not answer", stream.node, min(ago_s, silence_s)
        topic = next((one for one in stream.inputs if f"{one} age [s]" in ages), "")
        age_s = number(ages[f"{topic} age [s]"]) if topic else None
        spoke_s = silence_s - ago_s  # after the silence began
        if age_s is None or spoke_s < _EVIDENCE_S or age_s < spoke_s / 2:
            return None
        return f"{stream.inputs[topic]} is silent for {age_s + ago_s:.0f} s", topic, age_s + ago_s


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
