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
r"""Find the camera's mounting error and the video's latency from a flight.

Finds how the camera is mounted on its gimbal and how late the video is, from surveyed points and
their pixels in one flight, or with --ties from what its own pictures show twice, without surveyed
points or together with them; then the gimbal's north, focal length and the ground's height too.
What the flight cannot tell is refused, with --ties kept, and said. Give the file to --params and
to the nodes after the aircraft's own file.

example:
  tirgeo calibrate boresight bags/sample/flight.mcap --survey bags/sample/survey.geojson \
    --observations bags/sample/observations.csv --params bags/sample/params.yaml -o boresight.yaml
  tirgeo calibrate boresight DCIM/ --ties --ground-height 212 -o boresight.yaml
"""

from __future__ import annotations

import argparse
from typing import Any

from tirgeo_ros.tools.cli._verb import (
    FLIGHT,
    GROUND,
    NEEDED,
    PARAMETERS,
    SMOOTH,
    SURVEY,
    UsageError,
    call,
    names_of,
)

_POINTS = ("roll", "pitch", "yaw", "latency", "gimbal_north", "ground_height")
_NAMES = (*_POINTS, "focal", "k1")
_ESTIMATE_HELP = (
    f"parameters to estimate, of {', '.join(_POINTS)}, separated by commas; default: the first "
    "four, and gimbal_north if the flight separates it from them"
)
_HOLD_HELP = f"parameters that keep their values in --params, of {', '.join(_NAMES)}"
_LIST = {"type": names_of(_NAMES)}
OPTIONS = (
    *FLIGHT,
    ("--ties", None, "by what the pictures show twice; surveyed points are optional then"),
    *(option[:3] for option in SURVEY),
    *GROUND,
    ("-o --output", "YAML", "parameter file to write", NEEDED),
    *PARAMETERS,
    *SMOOTH,
    ("--estimate", "LIST", _ESTIMATE_HELP, {"type": names_of(_POINTS)}),
    ("--hold", "LIST", _HOLD_HELP, _LIST | {"default": []}),
)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Run the calibration; return its summary."""
    points = {"--survey": args.survey, "--observations": args.observations}
    missing = [name for name, value in points.items() if value is None]
    if args.ties:
        if args.estimate:
            raise UsageError("--estimate is not for --ties")
        if len(missing) == 1:
            raise UsageError(f"{missing[0]} is needed too")
        from tirgeo_ros.tools.calibrate.tie_calibration import (  # noqa: PLC0415 heavy
            calibrate_by_ties,
        )

        return call(calibrate_by_ties, args, "calibrating")
    for option in missing:
        raise UsageError(f"{option} is needed, or --ties")
    from tirgeo_ros.tools.calibrate.boresight import calibrate_boresight  # noqa: PLC0415 heavy

    both = sorted(set(args.estimate or ()) & set(args.hold))
    if both:
        raise UsageError(f"{', '.join(both)}: name it in --estimate or in --hold, not in both")
    if not set(_POINTS[:5] if args.estimate is None else args.estimate) - set(args.hold):
        raise UsageError("nothing to estimate: change --estimate or --hold")
    return call(calibrate_boresight, args, "calibrating, s")


def describe(result: dict[str, Any]) -> str:
    """Return the estimates as a table, and how well they fit."""
    from tirgeo_ros.tools.calibrate.result import described  # noqa: PLC0415 heavy

    if "disagreement_m" in result:
        from tirgeo_ros.tools.calibrate.tie_calibration import ties_lines  # noqa: PLC0415 heavy

        return described(ties_lines(result), result)
    from tirgeo_ros.tools.calibrate.boresight import boresight_lines  # noqa: PLC0415 heavy

    return described(boresight_lines(result), result)
