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
"""Plant faults in a flight, play it through the node graph, and tell who named them when."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dev.planted_faults.faults import Fault, FlightFiles, ShownFrom
from tirgeo_ros.core.ground.frame_geometry import camera_heading_rad
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.messages.cdr import header_stamp_ns
from tirgeo_ros.io.parameters.parameter_file import Value, parameters_yaml
from tirgeo_ros.tools.graph.node_graph import GraphSetup, free_domain, run_graph
from tirgeo_ros.tools.presentation.progress import Report as Progress, silent
from tirgeo_ros.tools.replay.graph_outputs import read_outputs

#: A fault is named so soon after the data can show it.
WITHIN_S = 10.0
_TURN_RAD = math.radians(40.0)
_HEAD = ("fault", "shown", "named", "by", "")
_JOBS = 2  # graphs at a time: each takes most of a core
#: What no fault is planted in: nothing may be said of it.
CLEAN = Fault("(none)", (), lambda good, _: good)


class Report(NamedTuple):
    """Hold a finding that a node reported, worse than a note."""

    at_s: float  # since the first sample of the IMU
    node: str
    finding: Finding


@dataclass(frozen=True)
class Outcome:
    """Hold what came of a fault on the graph; seconds count from the first sample of the IMU."""

    fault: Fault
    shown_s: float = math.nan  # from when on the data can show it; nan: never
    named: Report | None = None  # the first finding with its parameter
    others: tuple[str, ...] = ()  # checks with other findings
    refused: str = ""  # a node's last words, where the graph did not run

    @property
    def is_good(self) -> bool:
        """Return whether it was named in time; nothing may be said where no fault is."""
        if not self.fault.names:
            return not (self.named or self.others or self.refused)
        if self.refused:
            return any(name in self.refused for name in self.fault.names)
        return self.named is not None and self.named.at_s - self.shown_s <= WITHIN_S

    @property
    def row(self) -> Iterable[str]:
        """Return the cells of the table."""
        named, words = self.named, self.refused
        when = "yes" if self.is_good else "NO"
        if named is not None:
            when, words = f"{named.at_s:.1f} s", named.finding.line
        if self.others:
            words += f" (also {', '.join(self.others)})"
        shown = "" if math.isnan(self.shown_s) else f"{self.shown_s:.1f} s"
        return self.fault.name, shown, when, named.node if named else "", words


def play(
    fault: Fault, good: FlightFiles, folder: Path, domain: int, progress: Progress = silent
) -> Outcome:
    """Return the outcome of a fault in a graph of a DDS domain; ``folder`` takes its files."""
    (folder / "planted").mkdir(parents=True)
    planted = fault.plant(good, folder / "planted")
    params = list(planted.params)
    if planted.options:
        params.append(folder / "planted" / "options.yaml")
        named: dict[str, Value] = {"ground_height_m": math.nan}
        named |= {name: str(value) for name, value in planted.options.items()}
        params[-1].write_text(parameters_yaml({"overlay_node": named}, "planted"))
    setup = GraphSetup(
        planted.bag.absolute(),
        folder.absolute(),
        map=planted.map.absolute() if planted.map else None,
        params=[path.absolute() for path in params],
        environment={"ROS_DOMAIN_ID": str(domain)},
    )
    try:
        recording = run_graph(setup, _length_s(good), progress).recording
    except TirgeoError as error:
        return Outcome(fault, refused=str(error))
    return _judged(fault, good, recording)


def outcomes(
    good: FlightFiles, faults: Sequence[Fault], folder: Path, progress: Progress
) -> list[Outcome]:
    """Return the outcomes of faults, some graphs at a time; ``progress`` in s of flight."""
    length_s, done_s, domains = _length_s(good), [0.0] * len(faults), list[int]()
    for _ in faults:
        domains.append(free_domain(domains))

    def played(number: int) -> Outcome:
        def tell(done: float, _: float | None) -> None:
            done_s[number] = min(done, length_s)
            progress(sum(done_s), length_s * len(faults))

        outcome = play(faults[number], good, folder / str(number), domains[number], tell)
        tell(length_s, None)
        return outcome

    with ThreadPoolExecutor(_JOBS) as pool:
        return list(pool.map(played, range(len(faults))))


def _length_s(flight: FlightFiles) -> float:
    first_ns, last_ns = BagReader(flight.bag).span_ns
    return (last_ns - first_ns) * 1e-9


def _judged(fault: Fault, good: FlightFiles, recording: Path) -> Outcome:
    imu = BagReader(good.bag).messages(["/imu/data"])
    begin_ns = header_stamp_ns(next(iter(imu)).data)
    cdr, others = Cdr(), set[str]()
    named = None
    for item in BagReader(recording).messages(["/tirgeo/findings"]):
        node, stamp_ns, findings = convert.findings_of(cdr.deserialize(item.data, item.typename))
        for finding in findings:
            if finding.severity is Severity.NOTE:
                continue
            if not any(name in finding.parameter for name in fault.names):
                others.add(finding.check)
            elif named is None:
                named = Report((stamp_ns - begin_ns) * 1e-9, node.strip("/"), finding)
    shown_ns = _shown_ns(fault.shown, begin_ns, recording, good.bag.with_name("truth.mcap"))
    return Outcome(fault, (shown_ns - begin_ns) * 1e-9, named, tuple(sorted(others)))


def _shown_ns(shown: ShownFrom, begin_ns: int, recording: Path, truth: Path) -> float:
    """Return the stamp from which on data can show a fault; nan: never."""
    if shown is ShownFrom.AT_ONCE:
        return begin_ns
    if shown is ShownFrom.MOVING_PICTURES:
        cameras = read_outputs(recording).cameras
        return cameras[0].stamp_ns if cameras else math.nan
    cameras = read_outputs(truth).cameras
    headings = np.unwrap([camera_heading_rad(pose) for pose in cameras])
    enough = np.flatnonzero(np.abs(np.diff(headings)).cumsum() > _TURN_RAD)
    return cameras[enough[0] + 1].stamp_ns if enough.size else math.nan


def live_table(results: Sequence[Outcome]) -> str:
    """Return a row of Markdown for each outcome, and a line that sums them up."""
    rows = [_HEAD, ("---",) * len(_HEAD), *(outcome.row for outcome in results)]
    faulty = [outcome.is_good for outcome in results if outcome.fault.names]
    lines = [f"| {' | '.join(row)} |\n" for row in rows]
    summary = f"{sum(faulty)} of {len(faulty)} named within {WITHIN_S:g} s of when the data show"
    return "".join([*lines, f"\n{summary} them\n"])
