r"""Find what is wrong with a flight's set-up and sensors.

Looks for signs, units, axes, stamps, lever arms, lens, ground and map that are wrong. Prints each
fault with its evidence, the parameter or topic to look at and how to mend it, the worst first,
then what was checked (-v: each topic). Exit code 1 if a flight must not begin with this set-up.

example:
  tirgeo check bags/sample/flight.mcap --params bags/sample/params.yaml \
    --map bags/sample/map.geojson
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from typing import Any

from tirgeo_ros.tools.cli._verb import FLIGHT, GROUND, PARAMETERS, call

OPTIONS = (*FLIGHT, *PARAMETERS, *GROUND, ("--map", "MAP", "map that will be drawn"))
VERBOSE = "what was checked, topic by topic"


def run(args: argparse.Namespace) -> dict[str, object]:
    """Check the flight; return findings and numbers."""
    from tirgeo_ros.tools.replay.check import check  # noqa: PLC0415 heavy

    names = "params map dem ground_height camera namespace"
    return call(check, args, "checking, s", "bag", names)


def finding_lines(_result: Mapping[str, object]) -> list[str]:
    """Return nothing: ``describe`` has printed the findings."""
    return []


def describe(result: Mapping[str, Any]) -> str:
    """Return the findings, three lines each, then one line on what was checked."""
    checked = result["checked"]
    summary = (
        f"checked over {checked['duration_s']:.1f} s: {len(checked['topics'])} topics, filter "
        f"{checked['method']} {checked['state']}; -v has each"
    )
    return _report(result, [summary])


def describe_all(result: Mapping[str, Any]) -> str:
    """Return the findings, three lines each, then everything that was checked."""
    return _report(result, _checked(result["checked"]))


def _report(result: Mapping[str, Any], checked: Iterator[str] | list[str]) -> str:
    from tirgeo_ros.tools.presentation.results import report  # noqa: PLC0415 heavy

    last = "\n".join([*checked, *(f"  note: {note}" for note in result["notes"])])
    parts = [result["verdict"], report(result["findings"]), last]
    return "\n\n".join(part for part in parts if part)


def _checked(checked: Mapping[str, Any]) -> Iterator[str]:
    """Yield a line for each thing that was checked."""
    yield f"checked over {checked['duration_s']:.1f} s:"
    for topic, stream in checked["topics"].items():
        rate = (
            f"{stream['rate_hz']:.1f} Hz" if stream["rate_hz"] else f"{stream['messages']} message"
        )
        yield f"  {topic:<30} {rate}, longest gap {stream['longest_gap_s']:.2f} s"
    sigma = f", heading to {checked['heading_sigma_deg']:.2f} deg"
    has_sigma = checked["heading_sigma_deg"] == checked["heading_sigma_deg"]  # not nan
    yield f"  {'filter':<30} {checked['method']}: {checked['state']}{sigma if has_sigma else ''}"
    if checked["picture_size"]:
        yield f"  {'pictures':<30} {'x'.join(map(str, checked['picture_size']))} pixels"
    if "height_above_ground_m" in checked:
        low, high = checked["height_above_ground_m"]
        yield f"  {'height above ground':<30} {low:.1f} to {high:.1f} m"
    if "map_layers" in checked:
        yield f"  {'map':<30} {checked['map_layers']} layers"
