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
"""Import logs of other makers: merge those of one flight, by their stamps, into one bag."""

from __future__ import annotations

import bisect
import heapq
import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import compress, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.checks.inertial_checks import imu_findings
from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.frames.rotations import wrapped
from tirgeo_ros.core.streams.sanity_checks import (
    ATTITUDE_ALONE,
    fault_of,
    joints_fault,
    usable_attitude,
)
from tirgeo_ros.core.streams.stamps import lone_stamps
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import (
    LAST_NS,
    CameraAttitudeSample,
    ImuSample,
    JointSample,
    PositionSample,
    SetHeading,
    Source,
)
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.core.types.texts import utc
from tirgeo_ros.io.logs.dji_video import own_subtitles
from tirgeo_ros.io.logs.forms import CSV, STILLS, UBX, VIDEO, Form, form_of
from tirgeo_ros.io.logs.log_contents import SECOND_NS, LogContents, LogOptions, Picture
from tirgeo_ros.io.messages import SensedSample, topic_of
from tirgeo_ros.tools.convert.import_sink import ImportSink
from tirgeo_ros.tools.presentation.progress import Report

#: The given heading is set so long after the last topic has begun: by then (``alignment.wait_s``
#: and a window of data) a filter lacks only a heading.
_HEADING_AFTER_NS = 7_000_000_000
#: Finding on the IMU -> key of the columns file to correct.
_KEYS = {
    "force_unit": "imu.accel.unit",
    "gyro_unit": "imu.gyro.unit",
    **dict.fromkeys(("force_axes", "gyro_axes"), "imu.axes"),
}
#: A receiver with a moving base gives the position of its own antenna, the rover's.
_ROVER = (
    "rtk/fix is of the rover's antenna, and rtk/heading points to it from the moving base: take "
    "positions from the base's log (name it before this one; it must be RTK too), or make the "
    "rover's antenna the first with --rover-first"
)
_DAMAGED = "the file is cut off or damaged: what could be read is imported"
_IMU, _POSITIONS = "imu/data", ("rtk/fix", "gps/fix")


@dataclass
class Log:
    """Hold a log that was read; ``spans`` has first and last stamp (ns) of each topic."""

    path: Path
    form: str
    contents: LogContents
    spans: dict[str, tuple[int, int]]

    @property
    def span(self) -> tuple[int, int]:
        """Return first and last stamp (ns)."""
        return self.contents.samples[0].stamp_ns, self.contents.samples[-1].stamp_ns

    def leave_out(self, topic: str, reason: str) -> None:
        """Count a topic's samples as refused."""
        kept = [sample for sample in self.contents.samples if topic_of(sample) != topic]
        self.contents.refused[topic, reason] += len(self.contents.samples) - len(kept)
        self.contents.samples = kept
        del self.spans[topic]

    def result(self) -> dict[str, object]:
        """Return the row of the summary."""
        return {
            "file": str(self.path),
            "form": self.form,
            "read": dict(self.contents.read),
            "messages": dict(Counter(map(topic_of, self.contents.samples))),
            "refused": [
                {"record": name, "reason": reason, "count": number}
                for (name, reason), number in sorted(self.contents.refused.items())
            ],
            "notes": self.contents.notes,
        }


def forms_of(paths: Sequence[Path], columns: Sequence[Path]) -> list[Form | None]:
    """Return the form of each file; None if it is no log. Raise LogError for a None among several.

    The files of columns are for the CSV files, in order; a single one is for all of them.
    """
    forms = [form_of(path, columns=bool(columns)) for path in paths]
    if None in forms and len(paths) > 1:
        raise LogError(f"{paths[forms.index(None)]}: not a log to be merged: import it alone")
    tables = forms.count(CSV)
    if columns and not tables:
        raise LogError(f"{columns[0]}: --columns is for CSV files, and there is none")
    if len(columns) not in {0, 1, tables}:
        raise LogError(
            f"{len(columns)} --columns for {tables} CSV files: give one, or one for each"
        )
    return forms


def import_logs(
    files: Sequence[tuple[Path, Form]],
    columns: Sequence[Path],
    sink: ImportSink,
    config: DjiConfig,
    options: LogOptions,
    progress: Report,
) -> dict[str, Any]:
    """Import logs; return what to report of them. Raise LogError, ConfigError."""
    for path, form in files:
        if form.module:
            needed(form.module, f"reading {path}", LogError)
    options = _completed(options, config)
    files = _without_own_subtitles(files)
    rest = iter(columns if len(columns) > 1 else [*columns] * len(files))
    logs: list[Log] = []
    for number, (path, form) in enumerate(files):
        progress(number, len(files))
        own = replace(options, columns=next(rest)) if form is CSV else options
        logs.append(_read(path, form, own))
    _leave_out_repeated_topics(logs)
    _check_common_time(logs)
    samples = [sample for log in logs for sample in log.contents.samples]
    if not samples:
        raise LogError(f"{logs[0].path}: nothing in it can be used: {_refusals(logs[0])}")
    if options.set_heading_rad is not None:
        last_begin_ns = max(span[0] for log in logs for span in log.spans.values())
        samples.append(SetHeading(last_begin_ns + _HEADING_AFTER_NS, options.set_heading_rad, 0.0))
    # Of one instant, positions come before the attitude that is used with them.
    samples = sorted(_positions_of_attitudes(samples) + samples, key=_stamp_ns)
    first_ns, last_ns = samples[0].stamp_ns, samples[-1].stamp_ns
    pictures = [log.contents.pictures for log in logs]
    # Of one instant, samples come before pictures: each pose before what is drawn with it.
    for item in heapq.merge(samples, *pictures, key=_stamp_ns):
        if isinstance(item, Picture):
            sink.picture(item)
        else:
            sink.write(item)
        progress((item.stamp_ns - first_ns) / SECOND_NS, (last_ns - first_ns) / SECOND_NS)
    warnings = list(_doubts(logs, rover_first=options.rover_first))
    is_table = any(log.form == CSV.name and _IMU in log.spans for log in logs)
    for finding in imu_findings(samples, config.aircraft.rotation_bi):
        key = _KEYS.get(finding.check) if is_table else None
        warnings.append(f"{finding.line} (in --columns: {key})" if key else finding.line)
    return {
        "kind": "logs",
        "files": [log.result() for log in logs],
        "parameters": {k: v for log in logs for k, v in log.contents.parameters.items()},
        "error": "; ".join(f"{x.path}: {_DAMAGED}" for x in logs if x.contents.damaged) or None,
        "warnings": warnings,
    }


def _stamp_ns(item: SensedSample | Picture) -> int:
    return item.stamp_ns


def _without_own_subtitles(files: Sequence[tuple[Path, Form]]) -> list[tuple[Path, Form]]:
    """Return the files without the subtitles that are read with a video of their name."""
    own = [own_subtitles(path) for path, form in files if form is VIDEO]
    return [file for file in files if not any(s and s.samefile(file[0]) for s in own)]


def _completed(options: LogOptions, config: DjiConfig) -> LogOptions:
    """Return the options, completed with undulation and baseline from the parameters."""
    if options.geoid_undulation_m is None and not math.isnan(config.geoid_undulation_m):
        options = replace(options, geoid_undulation_m=config.geoid_undulation_m)
    baseline_b, degrees = config.aircraft.baseline_b, config.aircraft.baseline_deg
    if baseline_b is None or degrees is None:
        return options
    length_m = math.hypot(*baseline_b) if options.baseline_m is None else options.baseline_m
    return replace(options, baseline_m=length_m, baseline_rad=math.radians(degrees))


def _read(path: Path, form: Form, options: LogOptions) -> Log:
    """Read a log; refuse impossible samples and those with outlying stamps; sort the others.

    A sample with an outlying stamp would be sorted to a wrong place.
    """
    contents = form.read(path, options)
    by_topic: defaultdict[str, list[tuple[int, SensedSample]]] = defaultdict(list)
    for number, sample in enumerate(contents.samples):
        fault, topic = _fault(sample), topic_of(sample)
        if fault:
            contents.refused[topic, fault] += 1
        else:
            by_topic[topic].append((number, sample))
    good: list[tuple[int, SensedSample]] = []
    spans = {}
    for topic, samples in by_topic.items():
        stamps_ns = np.array([sample.stamp_ns for _, sample in samples])
        # Each still has its own time, and may be taken long after the others.
        alone = lone_stamps(stamps_ns) & (form is not STILLS)
        good += compress(samples, ~alone)
        stamps_ns = stamps_ns[~alone]
        spans[topic] = int(stamps_ns.min()), int(stamps_ns.max())
        if alone.any():
            contents.refused[topic, "its stamp is an outlier"] += int(alone.sum())
        if back := int((np.diff(stamps_ns) < 0).sum()):
            contents.notes.append(
                f"{topic}: its time goes back {back} times; it is sorted by time"
            )
    good.sort(key=lambda pair: (pair[1].stamp_ns, pair[0]))
    contents.samples = [sample for _, sample in good]
    return Log(path, form.name, contents, spans)


def _fault(sample: SensedSample) -> str:
    if not 0 <= sample.stamp_ns < LAST_NS:
        return "its time is not between 1970 and 2038"
    if isinstance(sample, JointSample):
        return joints_fault((sample.yaw_rad, sample.roll_rad, sample.pitch_rad))
    if isinstance(sample, CameraAttitudeSample):
        return "" if usable_attitude(sample.q_ng) else "attitude is not a unit quaternion"
    fault = fault_of(sample)
    return "" if fault is ATTITUDE_ALONE else fault


def _is_attitude_alone(sample: SensedSample) -> bool:
    """Return whether a sample is the attitude of a picture, without forces and rates."""
    return isinstance(sample, ImuSample) and sample.is_attitude_alone


def _has_attitudes_alone(log: Log) -> bool:
    return any(map(_is_attitude_alone, log.contents.samples))


def _positions_of_attitudes(samples: Sequence[SensedSample]) -> list[SensedSample]:
    """Return a position of each receiver at the attitudes of pictures, where it has epochs near.

    Without an IMU nothing else carries a position to the time of a picture. It lies on the line
    between two epochs that are at most a second apart, and has the worse status and covariance.
    """
    moments = sorted({sample.stamp_ns for sample in samples if _is_attitude_alone(sample)})
    made: list[SensedSample] = []
    for source in (Source.RTK_POSITION, Source.GPS_POSITION):
        epochs = [s for s in samples if isinstance(s, PositionSample) and s.source is source]
        epochs.sort(key=_stamp_ns)
        for before, after in pairwise(epochs):
            if after.stamp_ns - before.stamp_ns <= SECOND_NS:
                first = bisect.bisect_right(moments, before.stamp_ns)
                end = bisect.bisect_left(moments, after.stamp_ns)
                made += [_between(before, after, stamp_ns) for stamp_ns in moments[first:end]]
    return made


def _between(before: PositionSample, after: PositionSample, stamp_ns: int) -> PositionSample:
    share = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
    worse = min(before, after, key=lambda s: (s.status, -np.trace(s.covariance_n)))
    north_rad, up_m = after.latitude_rad - before.latitude_rad, after.height_m - before.height_m
    east_rad = float(wrapped(after.longitude_rad - before.longitude_rad))
    return replace(
        worse,
        stamp_ns=stamp_ns,
        latitude_rad=before.latitude_rad + share * north_rad,
        longitude_rad=float(wrapped(before.longitude_rad + share * east_rad)),
        height_m=before.height_m + share * up_m,
    )


def _meet(span: tuple[int, int], other: tuple[int, int]) -> bool:
    return span[0] <= other[1] and other[0] <= span[1]


def _leave_out_repeated_topics(logs: Sequence[Log]) -> None:
    """Leave out a topic that an earlier log has for the same time.

    Two receivers on one topic would look like one that jumps between two places. A log that has
    attitudes of pictures on ``imu/data`` gives way to any with an IMU.
    """
    for topic in sorted({topic for log in logs for topic in log.spans}):
        same = [log for log in logs if topic in log.spans]
        kept: list[Log] = []
        for log in sorted(same, key=_has_attitudes_alone) if topic == _IMU else same:
            meeting = (x for x in kept if _meet(log.spans[topic], x.spans[topic]))
            if before := next(meeting, None):
                log.leave_out(topic, f"{before.path}, named earlier, has it")
            else:
                kept.append(log)


def _check_common_time(logs: Sequence[Log]) -> None:
    """Raise LogError for a log that has no time in common with any other.

    Parts of one recording, which have a topic in common, may follow each other.
    """
    used = [log for log in logs if log.contents.samples]
    for log in used if len(used) > 1 else ():
        others = [other for other in used if other is not log]
        if not any(_meet(log.span, o.span) or log.spans.keys() & o.spans for o in others):
            times = [[utc(stamp_ns)[:19].replace("T", " ") for stamp_ns in x.span] for x in used]
            spans = ", ".join(
                f"{each.path} is of {begun} to {ended[11:]}"
                for each, (begun, ended) in zip(used, times, strict=True)
            )
            raise LogError(
                f"no time in common: {spans}; is one in another time scale or zone "
                "(--utc-offset), or of another flight?"
            )


def _refusals(log: Log) -> str:
    refused = [f"{n} {name}: {why}" for (name, why), n in log.contents.refused.most_common()]
    read = ", ".join(log.contents.read) or "no record"
    return "; ".join(refused) or f"it has {read}"


def _doubts(logs: Sequence[Log], *, rover_first: bool) -> Iterator[str]:
    """Yield warnings of refused samples, missing topics and positions of the wrong antenna."""
    for log in logs:
        if log.contents.refused:
            yield f"{log.path}: refused {_refusals(log)}"
        if log.form == UBX.name and {"rtk/fix", "rtk/heading"} <= log.spans.keys():
            yield from () if rover_first else (f"{log.path}: {_ROVER}",)
    topics = {topic for log in logs for topic in log.spans}
    if _IMU not in topics:
        yield "no imu/data: the filter needs it; give a log with an IMU too"
    if not topics & {*_POSITIONS}:
        yield f"neither {' nor '.join(_POSITIONS)}: give a log with positions too"
