"""Judge by all that reaches the page whether one aircraft can be relied on: one verdict."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus
from tirgeo_ros.nodes.aircraft_topics import Reports

#: Silence (s) of what is needed, or time without a map, that ends GO; good time that restores it.
_SILENT_S, _GOOD_S = 1.0, 2.0
#: Silence of what may be the cause, an earlier stream or an input, beside a stream that has ended.
_ALSO_SILENT_S = 0.5
#: A node whose reports, one a second, end for so long does not answer.
_ANSWER_S = 1.6
#: The longest step of time that counts: in a longer one this node did not run and heard nothing.
_STEP_S = 0.4


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
_GO = Verdict("GO", "good")
_CHECKS = {
    None: Verdict("NO DATA", "caution", "checks", "No check has reported"),
    Severity.CAUTION: Verdict("CAUTION", "caution", "checks"),
    Severity.STOP: Verdict("NO GO", "bad", "checks"),
}


class Judge:
    """Make one aircraft's verdict, again and again, by a steady clock.

    ``came_s`` says when the newest message of a topic came; None: none has come.
    """

    def __init__(self, reports: Reports, came_s: Callable[[str], float | None]) -> None:
        self._reports, self._newest_s = reports, came_s
        self._now_s = math.inf  # of the last look
        self._came_s: dict[str, float] = {}  # when the newest of a topic came, if one has
        self._silence_s = dict.fromkeys((stream.topic for stream in STREAMS), 0.0)
        self._no_map_s = self._good_s = 0.0
        self._shown = Verdict("NO DATA", "")

    def look(self, now_s: float, worst: Severity | None, no_map: str) -> Verdict:
        """Return the verdict.

        ``worst`` is that of the checks' findings, None while they are silent; ``no_map`` is the
        notice in the picture.
        """
        step_s = min(max(now_s - self._now_s, 0.0), _STEP_S)
        self._now_s = now_s
        for topic in self._silence_s:
            self._count(topic, self._newest_s(topic), step_s)
        navigation = navigation_verdict(self._reports.navigation(now_s)[0])
        upstream = self._upstream(navigation)
        self._no_map_s = self._no_map_s + step_s if no_map and not upstream else 0.0
        verdict = upstream or self._downstream(_CHECKS.get(worst), no_map) or navigation or _GO
        self._good_s = self._good_s + step_s if verdict == _GO else 0.0
        if verdict != _GO or self._good_s >= _GOOD_S:
            self._shown = verdict
        return self._shown

    def _count(self, topic: str, at_s: float | None, step_s: float) -> None:
        """Add up the silence of a topic while this node listened; what is forgotten is silent."""
        if at_s is None or at_s == self._came_s.get(topic):
            self._silence_s[topic] += step_s
        else:
            self._came_s[topic], self._silence_s[topic] = at_s, min(self._now_s - at_s, step_s)

    def _silent(self, stream: Stream, limit_s: float) -> bool:
        """Return whether a stream is silent for so long, or has not begun."""
        return stream.topic not in self._came_s or self._silence_s[stream.topic] > limit_s

    def _upstream(self, navigation: Verdict | None) -> Verdict | None:
        """Return the first fault on the way from the sensors to the picture."""
        odometry, pose, picture, _ = STREAMS
        no_position = navigation if navigation and navigation.word != "CAUTION" else None
        if no_position or self._silent(odometry, _SILENT_S):
            self._silence_s[pose.topic] = 0.0  # it cannot come yet
        # What ends together does not end at one instant: the first in the order is the cause.
        ended = any(self._silent(stream, _SILENT_S) for stream in (odometry, pose, picture))
        limit_s = _ALSO_SILENT_S if ended else _SILENT_S
        if self._silent(odometry, limit_s):
            return self._no_data(odometry, no_position)
        silent = [stream for stream in (pose, picture) if self._silent(stream, limit_s)]
        return no_position or (self._no_data(silent[0]) if silent else None)

    def _downstream(self, checks: Verdict | None, no_map: str) -> Verdict | None:
        """Return what is wrong though all comes, the checks' caution last."""
        if checks and checks.word != "CAUTION":
            return checks
        if self._no_map_s > _SILENT_S:
            return Verdict("NO GO", "bad", "map", no_map, alarm=True)
        calibration = STREAMS[-1]  # it need not come again
        if not no_map and self._silent(calibration, math.inf):
            return self._no_data(calibration)
        return checks

    def _no_data(self, stream: Stream, otherwise: Verdict | None = None) -> Verdict:
        """Return the verdict on a silent stream: its cause; ``otherwise`` where none shows."""
        silence_s, began = self._silence_s[stream.topic], stream.topic in self._came_s
        cause = self._cause(stream, silence_s)
        if cause is None and otherwise is not None:
            return otherwise
        text, name, for_s = cause or (f"No {stream.kind}", stream.topic, silence_s)
        more = f"{name} silent for {for_s:.0f} s"
        return Verdict("NO DATA", "bad" if began else "caution", stream.kind, text, more, began)

    def _cause(self, stream: Stream, silence_s: float) -> tuple[str, str, float] | None:
        """Return what is silent, in words and by its name, and how long; None if none is."""
        then_s, state = self._reports.state(stream.node)
        ago_s = self._now_s - then_s
        if min(ago_s, silence_s) >= _ANSWER_S:
            return f"{stream.program} does not answer", stream.node, min(ago_s, silence_s)
        ages = {topic: one.age_s for topic, one in state.topics.items()} if state else {}
        topic = next((one for one in stream.inputs if ages.get(one) is not None), "")
        age_s = ages.get(topic)
        if age_s is None or age_s <= _ALSO_SILENT_S:
            return None
        return f"{stream.inputs[topic]} is silent for {age_s + ago_s:.0f} s", topic, age_s + ago_s


def navigation_verdict(status: NavigationStatus | None) -> Verdict | None:
    """Return the verdict on the filter by its own status; None while it runs well."""
    if status is None:
        return Verdict("NO DATA", "caution", "position", "The filter has not reported", "ekf_node")
    if status.state is FilterState.RUNNING:
        return None
    if status.state is FilterState.LOST or status.began_again:
        return Verdict("LOST", "bad", "position", status.for_operator, status.reason, alarm=True)
    word = "CAUTION" if status.state.navigating else "WAIT"
    return Verdict(word, "caution", "position", status.for_operator, status.reason)
