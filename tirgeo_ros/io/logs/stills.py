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
"""Read a folder of a drone's stills: position and attitudes of each, and the pictures themselves.

A file that gives none is refused by name, and the others are read. The pictures are passed on
byte by byte, with their temperatures beside them. There is no IMU: the aircraft's attitude that
stands in the stills, or a level one, is written as the autopilot's.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import groupby, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.frames.rotations import matrix_from_quat, quat_from_euler
from tirgeo_ros.core.frames.wgs84 import ecef_from_geodetic
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import LogError, MessageError
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    FixStatus,
    ImuSample,
    PositionSample,
    Source,
)
from tirgeo_ros.io.files.whole_files import reading
from tirgeo_ros.io.logs.log_contents import (
    NORTH_SIGMA_DEG,
    SECOND_NS,
    TAKEOFF,
    LogContents,
    LogOptions,
    Picture,
    classify_receiver,
    written_time,
)
from tirgeo_ros.io.pictures.embedded_metadata import JPEG, TIFFS, Unreadable
from tirgeo_ros.io.pictures.still_metadata import StillMetadata, still_metadata
from tirgeo_ros.io.pictures.temperatures import temperatures

_JPEGS, _TIFFS = {".jpg", ".jpeg"}, {".tif", ".tiff"}  # endings
_BAG_ENDINGS = {".yaml", ".mcap", ".db3", ".zstd"}
_FIXED, _FLOAT = 50, 32  # least RtkFlag
#: Between two flights: a landing, or a way that no drone flies (stamps may be whole seconds).
_PAUSE_NS, _MOST_M_S, _ROUNDED_S = 1800 * SECOND_NS, 30.0, 2.0
_LABELS: dict[str, Callable[[StillMetadata], str]] = {
    "camera": lambda x: f"{x.maker} {x.model} {'thermal' if x.thermal else x.source}",
    "size": lambda x: f"{x.size[0]}x{x.size[1]}",
}


class _Still(NamedTuple):
    """Hold a still with its name below the folder, and its ellipsoidal height and the origin."""

    file: Path
    name: str
    metadata: StillMetadata
    stamp_ns: int = 0
    height_m: float = math.nan
    height_of: str = ""
    tiff: Path | None = None  # the file of its temperatures


def is_still(head: bytes) -> bool:
    """Return whether a file's first bytes are those of a JPEG or TIFF."""
    return head.startswith((JPEG, *TIFFS))


def is_folder_of_stills(folder: Path) -> bool:
    """Return whether a folder holds pictures, and is no bag of ROS 2."""
    is_bag = any(path.suffix in _BAG_ENDINGS for path in folder.iterdir())
    return not is_bag and any(file.suffix.lower() in _JPEGS | _TIFFS for file in _files(folder))


def read_stills(path: Path, options: LogOptions) -> LogContents:
    """Read a folder of stills, or one. Raise LogError if a zone or a datum is missing."""
    contents = LogContents()
    read = _of_one_camera(list(_read(path, contents)), contents)
    stills = _spread([_placed(still, path, options) for still in read], contents)
    contents.read["still"] = len(stills)
    contents.samples = [sample for still in stills for sample in _samples(still)]
    if best := max((still.metadata.rtk_flag for still in stills), default=0):
        classify_receiver(contents, "the aircraft's receiver", is_rtk=best >= _FLOAT)
    if stills:
        contents.notes += [*_remarks(stills), *_flights(stills)]
        sigma = max(still.metadata.focal_sigma for still in stills)
        focal = {"confidence.focal_sigma": sigma} if sigma else {}
        contents.parameters = {**focal, "north.sigma_deg": NORTH_SIGMA_DEG}
    contents.pictures = _pictures(stills, contents)
    return contents


def _files(path: Path) -> Iterator[Path]:
    """Yield a folder's files, also those of folders in it, in the order of their names."""
    for folder, folders, names in os.walk(path):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        files = (Path(folder, name) for name in sorted(names) if not name.startswith("."))
        yield from (file for file in files if file.is_file())  # no pipes


def _read(path: Path, contents: LogContents) -> Iterator[_Still]:
    """Yield the stills that have all that is needed; count the other files as refused."""
    files = list(_files(path)) if path.is_dir() else [path]
    jpegs = {file.with_suffix("") for file in files if file.suffix.lower() in _JPEGS}
    tiffs = {file.with_suffix(""): file for file in files if file.suffix.lower() in _TIFFS}
    for file in files:
        name = file.relative_to(path).as_posix() if path.is_dir() else file.name
        try:
            tiff = tiffs.get(file.with_suffix("")) if file.suffix.lower() in _JPEGS else None
            yield _Still(file, name, _complete(still_metadata(file)), tiff=tiff)
        except Unreadable as reason:
            if file.suffix.lower() in _TIFFS and file.with_suffix("") in jpegs:
                contents.read["TIFF beside a still"] += 1
            else:
                contents.refused[name, str(reason)] += 1


def _complete(data: StillMetadata) -> StillMetadata:
    """Return the metadata if it has all that is needed. Raise Unreadable."""
    lacks = {
        "angles of the camera": data.camera_q_ng is None,
        "position": math.isnan(data.latitude_rad),
        "height": math.isnan(data.absolute_m),
        "time": written_time(data.time) is None,
    }
    if any(lacks.values()):
        raise Unreadable(f"no {', no '.join(what for what, lack in lacks.items() if lack)} in it")
    return data


def _placed(still: _Still, path: Path, options: LogOptions) -> _Still:
    """Return a still with its stamp and height. Raise LogError for an unknown zone or datum.

    RTK's height comes first. That above the take-off is the next best, if the take-off's is given.
    """
    data, datum = still.metadata, options.height or still.metadata.datum
    is_from_takeoff = options.takeoff_height_m is not None or datum == TAKEOFF
    if data.surveyed:
        height_m, datum, height_of = data.absolute_m, data.datum, "RTK's height"
    elif is_from_takeoff and math.isfinite(data.relative_m):
        height_m, datum = data.relative_m, TAKEOFF
        height_of = "RelativeAltitude above the take-off"
    elif datum in {"", TAKEOFF}:
        raise LogError(
            f"{path}: {data.model or 'its camera'} does not say what AbsoluteAltitude is above: "
            "give --height ellipsoid, --height sea or --takeoff-height"
        )
    else:
        height_m = data.absolute_m
        height_of = f"AbsoluteAltitude above the {datum}, metres off at times"
    height_m += options.to_ellipsoid_m(datum, path)
    written = written_time(data.time)
    assert written is not None  # by _complete
    stamp_ns = options.utc_ns(written, path)
    return still._replace(stamp_ns=stamp_ns, height_m=height_m, height_of=height_of)


def _of_one_camera(stills: list[_Still], contents: LogContents) -> list[_Still]:
    """Return the stills of the thermal camera, else of that with most; refuse the others."""
    for what, label in _LABELS.items():
        thermal = [still for still in stills if still.metadata.thermal]
        counts = Counter(label(still.metadata) for still in thermal or stills)
        kept = max(counts, key=counts.__getitem__, default="")
        for still in stills:
            if (other := label(still.metadata)) != kept:
                contents.refused[still.name, f"of another {what}, {other}, not {kept}"] += 1
        stills = [still for still in stills if label(still.metadata) == kept]
    return stills


def _spread(stills: list[_Still], contents: LogContents) -> list[_Still]:
    """Return the stills by time; spread those of one stamp evenly over the second that follows."""
    spread, crowded = [], 0
    by_time = sorted(stills, key=lambda still: (still.stamp_ns, still.name))
    for begin_ns, group in groupby(by_time, key=lambda still: still.stamp_ns):
        same = list(group)
        for k, still in enumerate(same):
            spread.append(still._replace(stamp_ns=begin_ns + k * SECOND_NS // len(same)))
        crowded += len(same) if len(same) > 1 else 0
    if crowded:
        contents.notes.append(
            f"{crowded} stills share their second with others: spread evenly in it, in the order "
            "of their names"
        )
    return sorted(spread, key=lambda still: still.stamp_ns)


def _samples(still: _Still) -> list[PositionSample | CameraAttitudeSample | ImuSample]:
    """Return position, camera's attitude and aircraft's attitude, all of the still's stamp."""
    data, stamp_ns, flag = still.metadata, still.stamp_ns, still.metadata.rtk_flag
    variances_m2 = np.square(data.rtk_std_m)
    covariance = np.diag(variances_m2) if (variances_m2 > 0).all() else np.zeros((3, 3))
    source = Source.RTK_POSITION if flag else Source.GPS_POSITION
    status = FixStatus.FLOAT if flag >= _FLOAT else FixStatus.SINGLE
    status = FixStatus.FIXED if flag >= _FIXED else status
    place = data.latitude_rad, data.longitude_rad, still.height_m
    q_ng = np.asarray(data.camera_q_ng)
    q_nb = _level(q_ng) if data.body_q_nb is None else data.body_q_nb
    return [
        PositionSample(stamp_ns, source, status, *place, covariance),
        CameraAttitudeSample(stamp_ns, q_ng),
        ImuSample.of_attitude(stamp_ns, q_nb),
    ]


def _level(q_ng: Array) -> Array:
    """Return a level attitude (4,) that heads where the camera's picture has its top.

    A level camera's heading is that of its axis; straight down it is that of the top. The sum of
    both has this heading at every pitch between.
    """
    rotation = matrix_from_quat(q_ng)
    north, east, _ = rotation[:, 0] - rotation[:, 2]
    return quat_from_euler(0.0, 0.0, math.atan2(east, north))


def _remarks(stills: Sequence[_Still]) -> Iterator[str]:
    """Yield what the stills leave open and what is assumed."""
    yield f"heights: {', '.join(dict.fromkeys(still.height_of for still in stills))}"
    if up_m := sorted(map(_laser_height_m, filter(_has_laser, stills))):
        yield (
            f"the laser met the ground, or what stands on it, at {up_m[0]:.1f} to {up_m[-1]:.1f} "
            f"m ({up_m[len(up_m) // 2]:.1f} in the median): a --ground-height for the middles of "
            "the pictures alone"
        )
    if level := sum(still.metadata.body_q_nb is None for still in stills):
        yield (
            f"the aircraft's attitude is not recorded in {level} stills: taken as level, looking "
            "where the camera looks; only lever arms depend on it"
        )
    cameras = [still.metadata.camera for still in stills]
    lengths = sorted({f"{camera.fx:.0f} px" for camera in cameras if camera})
    if None in cameras:
        yield "the lens is not known: give its calibration with --camera"
    elif any(still.metadata.focal_sigma for still in stills):
        yield f"the lens is not calibrated: focal length {', '.join(lengths)} as published"
    yield f"the gimbal's north is not calibrated: {NORTH_SIGMA_DEG:g} deg are assumed"


def _has_laser(still: _Still) -> bool:
    return still.metadata.laser is not None


def _laser_height_m(still: _Still) -> float:
    """Return the ellipsoidal height of the laser's target, whose datum is AbsoluteAltitude's."""
    assert still.metadata.laser is not None
    return still.height_m - still.metadata.absolute_m + still.metadata.laser.height_m


def _flights(stills: Sequence[_Still]) -> Iterator[str]:
    """Yield a note that names the flights, if there are several."""
    geodetic = [(s.metadata.latitude_rad, s.metadata.longitude_rad, s.height_m) for s in stills]
    ways_m = np.linalg.norm(np.diff(ecef_from_geodetic(*np.array(geodetic).T), axis=0), axis=1)
    spans = [[stills[0].name, stills[0].name]]
    for (before, after), way_m in zip(pairwise(stills), ways_m, strict=True):
        pause_ns = after.stamp_ns - before.stamp_ns
        if pause_ns > _PAUSE_NS or way_m > _MOST_M_S * (pause_ns / SECOND_NS + _ROUNDED_S):
            spans.append([after.name, after.name])
        spans[-1][1] = after.name
    if len(spans) > 1:
        yield f"{len(spans)} flights, all imported: {'; '.join(map(' to '.join, spans))}"


def _pictures(stills: Sequence[_Still], contents: LogContents) -> Iterator[Picture]:
    """Yield the pictures; note once each reason why temperatures cannot be read."""
    for still in stills:
        with reading(still.file, LogError):
            data = still.file.read_bytes()
        try:
            warm = temperatures(still.file, data, still.tiff)
        except MessageError as error:
            warm, note = b"", f"temperatures: {error}"
            if note not in contents.notes:
                contents.notes.append(note)
        yield Picture(still.stamp_ns, data, still.metadata.camera, still.name, warm)
