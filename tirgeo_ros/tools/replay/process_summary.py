"""Write the summary of ``tirgeo process`` for a person: six lines, problems first."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from tirgeo_ros.core.types.verdicts import Outcome
from tirgeo_ros.tools.presentation.progress import three

#: Outcomes of a measurement that are not reported.
_QUIET = {
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
_PICTURES = ("thermal/image_raw", "thermal/image_raw/compressed")


class SummaryLine(NamedTuple):
    """Hold one line, and whether it reports a problem."""

    name: str
    text: str
    is_wrong: bool = False


def six_lines(result: Mapping[str, Any]) -> str:
    """Return six lines: read, state, poses, frames, refused, output."""
    lines = [make(result) for make in (_read, _state, _poses, _frames, _refused, _output)]
    lines.sort(key=lambda line: not line.is_wrong)  # stable
    return "\n".join(
        f"{'!' if line.is_wrong else ' '} {line.name:<9}{line.text}" for line in lines
    )


def _read(result: Mapping[str, Any]) -> SummaryLine:
    number = sum(result["read"].values())
    text = (
        f"{three(result['duration_s'])} s of {result['input']} in {three(result['elapsed_s'])} s"
    )
    return SummaryLine("read", f"{text}, {three(result['speed'])}x real time; {number} messages")


def _state(result: Mapping[str, Any]) -> SummaryLine:
    """Return the final state with its reason, and the seconds in each state from diagnostics."""
    times = sorted(result["states_s"].items(), key=lambda item: -item[1])
    said = ", ".join(f"{state} {seconds} s" for state, seconds in times)
    reason = f" ({result['reason']})" if result["reason"] else ""
    text = f"{result['state']} at the end{reason}, by {result['method']}; in all {said}"
    return SummaryLine("state", text, result["state"] not in _GOOD_STATES)


def _poses(result: Mapping[str, Any]) -> SummaryLine:
    body, camera = (_written(result, name) for name in ("odometry", "camera_pose"))
    sigma_deg = result["heading_sigma_deg"]
    heading = f", heading to {three(sigma_deg)} deg" if math.isfinite(sigma_deg) else ""
    text = f"{body} of the body, {camera} of the camera{heading}"
    return SummaryLine("poses", text, not body or (bool(result["overlay"]) and not camera))


def _written(result: Mapping[str, Any], name: str) -> int:
    found = (n for topic, n in result["written"].items() if topic.endswith(f"tirgeo/{name}"))
    return sum(found)


def _frames(result: Mapping[str, Any]) -> SummaryLine:
    """Return how many frames show the map, and how many show a notice instead."""
    counts = result["overlay"]
    if not counts:
        return SummaryLine("frames", "not drawn: no map was given, or no images asked for")
    drawn, notices = counts["drawn"], counts["notices"]
    read = sum(n for topic, n in result["read"].items() if topic.endswith(_PICTURES))
    lost = f", {read - drawn - notices} lost" if read > drawn + notices else ""
    text = f"{drawn} of {read} with the map, {notices} with a notice why not{lost}"
    return SummaryLine("frames", text, drawn < notices or bool(lost))


def _refused(result: Mapping[str, Any]) -> SummaryLine:
    """Return refused measurements by source and outcome, and messages by topic with a reason."""
    taken: Counter[str] = Counter()
    refused: dict[str, list[tuple[str, int]]] = {}
    for name, number in result["verdicts"].items():
        source, outcome = name.split(" ")
        taken[source] += number
        if Outcome(outcome) not in _QUIET:
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
    return SummaryLine("refused", "; ".join(parts) or "nothing", many or bool(unreadable))


def _output(result: Mapping[str, Any]) -> SummaryLine:
    size = f"{three(Path(result['output']).stat().st_size / 1e6)} MB"
    film = result["video"]
    video = f", and a video of {film['frames']} frames at {film['rate_hz']:.3g} Hz" if film else ""
    notes = result["notes"]
    more = f" (and {len(notes) - 1} more, with -v)" if len(notes) > 1 else ""
    noted = f"; {notes[0]}{more}" if notes else ""
    return SummaryLine("output", f"{result['output']}, {size}{video}{noted}")
