"""Write the summary of ``tirgeo process`` for a person: six lines, problems first."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tirgeo_ros.core.types.verdicts import Outcome
from tirgeo_ros.tools.presentation.progress import three
from tirgeo_ros.tools.presentation.results import summary
from tirgeo_ros.tools.replay.flight_topics import PICTURES

#: Outcomes of a measurement that are not reported.
QUIET = {
    Outcome.USED,
    Outcome.WAITING,
    Outcome.REPEATED,
    Outcome.STANDBY,
    Outcome.UNUSED,
    Outcome.NOT_FIXED,
}
#: A larger refused share of one kind of measurement is not chance: gates are at 4 and 5 sigma.
_MOST_REFUSED = 0.01
_GOOD_STATES = ("running", "degraded")


Line = tuple[str, str, bool]  # name, text, whether it reports a problem


def six_lines(result: Mapping[str, Any]) -> str:
    """Return six lines, those that report a problem first: read, state, poses and so on."""
    makers = (_read, _state, _poses, _frames, refused_line, _output)
    return summary(make(result) for make in makers)


def _read(result: Mapping[str, Any]) -> Line:
    duration, elapsed, speed = (three(result[one]) for one in ("duration_s", "elapsed_s", "speed"))
    number = sum(result["read"].values())
    text = (
        f"{duration} s of {result['input']} in {elapsed} s, {speed}x real time; {number} messages"
    )
    return "read", text, False


def _state(result: Mapping[str, Any]) -> Line:
    """Return the final state with its reason, and the seconds in each state from diagnostics."""
    times = Counter(result["states_s"]).most_common()
    said = ", ".join(f"{state} {seconds} s" for state, seconds in times)
    reason = f" ({result['reason']})" if result["reason"] else ""
    method = f"{result['method']}{', smoothed' if result['smoothed'] else ''}"
    text = f"{result['state']} at the end{reason}, by {method}; in all {said}"
    return "state", text, result["state"] not in _GOOD_STATES


def _poses(result: Mapping[str, Any]) -> Line:
    body, camera = (
        sum(n for topic, n in result["written"].items() if topic.endswith(f"tirgeo/{name}"))
        for name in ("odometry", "camera_pose")
    )
    sigma_deg = result["heading_sigma_deg"]
    heading = f", heading to {three(sigma_deg)} deg" if math.isfinite(sigma_deg) else ""
    is_wrong = not body or (bool(result["overlay"]) and not camera)
    return "poses", f"{body} of the body, {camera} of the camera{heading}", is_wrong


def _frames(result: Mapping[str, Any]) -> Line:
    """Return how many frames have a trusted pose, and how many show a notice instead."""
    counts = result["overlay"]
    if not counts:
        return "frames", "not drawn: give --map or --video, and no --no-images", False
    drawn, notices = counts["drawn"], counts["notices"]
    read = sum(n for topic, n in result["read"].items() if topic.endswith(PICTURES))
    lost = f", {read - drawn - notices} lost" if read > drawn + notices else ""
    text = f"{drawn} of {read} with a trusted pose, {notices} with a notice why not{lost}"
    return "frames", text, drawn < notices or bool(lost)


def refused_line(result: Mapping[str, Any]) -> Line:
    """Return refused measurements by source and outcome, and messages by topic with a reason."""
    taken: Counter[str] = Counter()
    refused: dict[str, list[tuple[str, int]]] = {}
    for name, number in result["verdicts"].items():
        source, outcome = name.split(" ")
        taken[source] += number
        if Outcome(outcome) not in QUIET:
            refused.setdefault(source, []).append((outcome, number))
    parts = [
        f"{source} {number} of {taken[source]} {outcome.replace('_', ' ')}"
        for source, found in refused.items()
        for outcome, number in found
    ]
    unreadable = Counter(result["undecodable"]) + Counter(result["unreadable"])
    because = result["unreadable_because"]
    parts += [
        f"{topic} {number} unreadable{f' ({because[topic]})' if topic in because else ''}"
        for topic, number in unreadable.items()
    ]
    many = any(
        sum(n for _, n in found) > _MOST_REFUSED * taken[source]
        for source, found in refused.items()
    )
    return "refused", "; ".join(parts) or "nothing", many or bool(unreadable)


def _output(result: Mapping[str, Any]) -> Line:
    size = f"{three(Path(result['output']).stat().st_size / 1e6)} MB"
    film = result["video"]
    video = f", and a video of {film['frames']} frames at {film['rate_hz']:.3g} Hz" if film else ""
    notes = result["notes"]
    more = f" (and {len(notes) - 1} more, with -v)" if len(notes) > 1 else ""
    noted = f"; {notes[0]}{more}" if notes else ""
    return "output", f"{result['output']}, {size}{video}{noted}", False
