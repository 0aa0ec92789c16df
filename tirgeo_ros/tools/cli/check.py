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
r"""Find what is wrong with a flight's set-up and sensors.

Looks for wrong signs, units, axes, stamps, lever arms, lens, ground and map. Prints each fault
with its evidence, the parameter or topic to look at and how to mend it, the worst first, then
what was checked. The exit code is 1 if a flight must not begin with this set-up.

example:
  tirgeo check bags/sample/flight.mcap --params bags/sample/params.yaml \
    --map bags/sample/map.geojson
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from tirgeo_ros.tools.cli._verb import FLIGHT, GROUND, PARAMETERS, call

SAYS_FINDINGS = False  # ``describe`` prints them
OPTIONS = (*FLIGHT, *PARAMETERS, *GROUND, ("--map", "MAP", "map that will be drawn"))


def run(args: argparse.Namespace) -> dict[str, object]:
    """Check the flight; return findings and numbers."""
    from tirgeo_ros.tools.replay.check import check  # noqa: PLC0415 heavy

    return call(check, args, "checking, s")


def describe(result: Mapping[str, Any]) -> str:
    """Return the findings, three lines each, then one line on what was checked."""
    from tirgeo_ros.tools.presentation.results import report  # noqa: PLC0415 heavy

    checked = result["checked"]
    summary = (
        f"checked over {checked['duration_s']:.1f} s: {len(checked['topics'])} topics, filter "
        f"{checked['method']} {checked['state']}; --json has each"
    )
    last = "\n".join([summary, *(f"  note: {note}" for note in result["notes"])])
    return "\n\n".join(filter(None, [result["verdict"], report(result["findings"]), last]))
