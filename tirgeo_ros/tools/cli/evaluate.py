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
r"""Measure a flight's ground accuracy against surveyed points, by method.

Repeats the paper's experiment: locates every observed control point under the methods raw, rtk,
ekf and ekf_heading and, with --boresight, calibrated (ekf_heading with the boresight file). Prints
each point's error, their means and the paired t-test between the methods, and writes report.html
with the error vectors, observations.csv and result.json. A method is left out if the bag lacks its
topics. Without --dem and --ground-height the ground is that of the parameters, else the median of
the observed points' heights.

example:
  tirgeo evaluate bags/sample/flight.mcap --survey bags/sample/survey.geojson \
    --observations bags/sample/observations.csv --params bags/sample/params.yaml -o evaluation
"""

from __future__ import annotations

import argparse

from tirgeo_ros.tools.cli._verb import (
    ADJUST,
    FLIGHT,
    GROUND,
    NEEDED,
    PARAMETERS,
    SMOOTH,
    SURVEY,
    call,
)

OPTIONS = (
    *FLIGHT,
    *SURVEY,
    ("-o --output", "DIR", "folder for the report and its files", NEEDED),
    *PARAMETERS,
    ("--boresight", "YAML", "file that tirgeo calibrate boresight wrote"),
    *SMOOTH,
    *ADJUST,
    *GROUND,
    ("--truth", "BAG", "truth.mcap of a simulated flight: adds the errors of the aircraft's pose"),
)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Evaluate the flight and write the results; return a summary."""
    from tirgeo_ros.tools.evaluate.evaluate import evaluate  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.evaluate.report import summary, write_evaluation  # noqa: PLC0415  heavy

    evaluation = call(evaluate, args, "evaluating, s")
    return summary(evaluation) | {"output": write_evaluation(evaluation, args.output)}


def describe(result: dict[str, object]) -> str:
    """Return the tables for a person."""
    from tirgeo_ros.tools.evaluate.report import text_tables  # noqa: PLC0415  heavy

    return text_tables(result)
