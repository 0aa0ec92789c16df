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
"""Read streams of MISB ST 0601: the aircraft's and the sensor's attitude, position, pictures.

The platform's heading, pitch and roll (tags 5, 6 or 90, 7 or 91) turn north, east, down to its
axes (forward, right, down), the sensor's relative azimuth, elevation and roll (18 to 20) these to
the sensor's: each time about z, then y, then x. The sensor's angles are therefore those of joints
in the order yaw, pitch, roll. Its position (13, 14) is that of the camera itself.

The line of sight to the frame's centre (23 to 25) is not used. The note says how far it is from
the composed one: a stream whose angles mean something else shows there.
"""

from __future__ import annotations

import bisect
import math
from array import array
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat, quat_from_euler, wrap_pi
from tirgeo_ros.core.frames.wgs84 import ecef_from_geodetic, rotation_ecef_from_ned
from tirgeo_ros.core.types.arrays import Array, BoolArray
from tirgeo_ros.core.types.errors import CameraError, LogError
from tirgeo_ros.core.types.measurements import (
    LAST_NS,
    FixStatus,
    ImuSample,
    JointSample,
    PositionSample,
    Source,
)
from tirgeo_ros.io.files.whole_files import first_bytes
from tirgeo_ros.io.logs.klv_packets import PACKET, PREFIX, LocalSet
from tirgeo_ros.io.logs.log_contents import MSL, LogContents, LogOptions
from tirgeo_ros.io.logs.misb_stream import Stream, bare_packets, is_stream
from tirgeo_ros.io.video.frame_metadata import ITEMS, TIME, extended

#: The sensor's ellipsoidal height, of a large range: not mapped as the other items.
_EXTENDED_HEIGHT = 104
_ELLIPSOIDAL, _ABOVE_SEA = 75, 15
_TAGS = (5, 6, 7, 13, 14, 15, 16, 17, 18, 19, 20, 23, 24, 25, 75, 78, 90, 91, _EXTENDED_HEIGHT)
_JOINT_ORDER = "yaw-pitch-roll"
#: Of a stream's field of view, which no calibration has measured.
_FOCAL_SIGMA = 0.01
_MOST_COMPARED = 1000  # packets, spread evenly: enough for the quantiles
_NOT_MEASURED = np.full(3, np.nan)
_UNKNOWN = np.zeros((3, 3))


def is_misb(head: bytes) -> bool:
    """Return whether a file's first bytes are a transport or programme stream, or KLV."""
    return is_stream(head) or head.startswith(PREFIX)


def read_misb(path: Path, options: LogOptions) -> LogContents:
    """Read a stream (.ts, .mpg) or its bare metadata (.klv). Raise LogError if it has none."""
    contents, table = LogContents(), _Table()
    head = first_bytes(path, 1 << 10, LogError)
    stream = Stream(path, contents) if is_stream(head) else None
    table.fill(stream.packets() if stream else bare_packets(path, contents), contents)
    if not contents.read:
        raise LogError(f"{path}: no metadata of MISB ST 0601 in it: give the video's log instead")
    values = table.columns()
    _add_positions(contents, table, values, options, path)
    _add_attitudes(contents, table, values)
    if stream and table.stamps_ns:
        stream.set_times(table.times_s, table.positions, table.stamps_ns)
        contents.parameters["confidence.focal_sigma"] = _FOCAL_SIGMA
        camera = _Optics(table.stamps_ns, values).camera
        contents.pictures = stream.pictures(camera, options.every_s)
    return contents


class _Table:
    """Hold the numbers of packets in little memory: an hour has some 100,000."""

    def __init__(self) -> None:
        self.stamps_ns, self.positions = array("q"), array("q")
        self.times_s, self._values = array("d"), array("d")

    def fill(self, packets: Iterable[LocalSet], contents: LogContents) -> None:
        """Take packets; refuse those without a time."""
        for packet in packets:
            stamp_ns = int.from_bytes(packet.items.get(TIME, b""), "big") * 1000
            if not 0 < stamp_ns < LAST_NS:
                contents.refused[PACKET, "no time, or none between 1970 and 2038"] += 1
                continue
            self.stamps_ns.append(stamp_ns)
            self.positions.append(packet.position)
            self.times_s.append(packet.time_s)
            self._values.extend(_value(tag, packet.items) for tag in _TAGS)

    def columns(self) -> dict[int, Array]:
        """Return the values (N,) by tag, in the items' units; nan where there is none."""
        rows = np.array(self._values).reshape(-1, len(_TAGS))
        return dict(zip(_TAGS, rows.T, strict=True))


def _value(tag: int, items: Mapping[int, bytes]) -> float:
    content = items.get(tag)
    if content is None:
        return math.nan
    if tag == _EXTENDED_HEIGHT:
        return extended(content, -900.0, 40000.0)
    return ITEMS[tag].decoded(content)


def _first(*choices: Array) -> Array:
    """Return in each place the first of the values (N,) that is finite."""
    result = choices[0]
    for other in choices[1:]:
        result = np.where(np.isfinite(result), result, other)
    return result


def _usable(contents: LogContents, reason: str, *columns: Array) -> BoolArray:
    """Return where all columns (N,) are finite; count the other packets."""
    usable = np.isfinite(columns).all(axis=0)
    if refused := int((~usable).sum()):
        contents.refused[PACKET, reason] += refused
    return np.asarray(usable)


def _add_positions(
    contents: LogContents,
    table: _Table,
    values: Mapping[int, Array],
    options: LogOptions,
    path: Path,
) -> None:
    height_m = _first(values[_EXTENDED_HEIGHT], values[_ELLIPSOIDAL])
    from_sea = ~np.isfinite(height_m) & np.isfinite(values[_ABOVE_SEA])
    if from_sea.any():
        offset_m = options.to_ellipsoid_m(MSL, path)
        height_m = np.where(from_sea, values[_ABOVE_SEA] + offset_m, height_m)
    columns = np.radians(values[13]), np.radians(values[14]), height_m
    usable = _usable(contents, "no position of the sensor", *columns)
    for k, place in zip(np.flatnonzero(usable), np.stack(columns, 1)[usable], strict=True):
        fix = Source.GPS_POSITION, FixStatus.SINGLE, *place.tolist()
        contents.samples.append(PositionSample(table.stamps_ns[k], *fix, _UNKNOWN))


def _add_attitudes(contents: LogContents, table: _Table, values: Mapping[int, Array]) -> None:
    """Add the platform's attitudes and the sensor's angles; compare with the frame's centre."""
    platform = (_first(values[7], values[91]), _first(values[6], values[90]), values[5])
    roll = values[20]
    if not np.isfinite(roll).any() and np.isfinite(values[18]).any():
        roll = np.zeros_like(roll)
        contents.notes.append("the sensor's relative roll is not recorded: 0 is assumed")
    sensor = (roll, values[19], values[18])
    level = _usable(contents, "no heading, pitch and roll of the platform", *platform)
    turned = _usable(contents, "no azimuth, elevation and roll of the sensor", *sensor)
    q_nb = quat_from_euler(*(np.radians(column[level]) for column in platform))
    joints_rad = wrap_pi(np.radians(sensor).T)
    for k, q in zip(np.flatnonzero(level), q_nb, strict=True):
        contents.samples.append(ImuSample(table.stamps_ns[k], _NOT_MEASURED, _NOT_MEASURED, q))
    for k in np.flatnonzero(turned):
        roll_rad, pitch_rad, yaw_rad = joints_rad[k].tolist()
        contents.samples.append(JointSample(table.stamps_ns[k], yaw_rad, roll_rad, pitch_rad))
    if turned.any():
        contents.parameters["joint_order"] = _JOINT_ORDER
    angles_deg = _to_centre_deg(np.radians([*platform, *sensor]), values)
    if len(angles_deg):
        median, p90 = np.percentile(angles_deg, [50, 90])
        contents.notes.append(
            f"frame centre of the stream against ours: median {median:.3f} deg, p90 {p90:.3f} deg"
        )


def _to_centre_deg(angles_rad: Array, values: Mapping[int, Array]) -> Array:
    """Return the angles between composed line of sight and that to the frame's centre, deg.

    ``angles_rad`` (6, N): platform's roll, pitch, heading, sensor's roll, elevation, azimuth.
    Heights of both places are of one datum: ellipsoidal (75, 78) or above the sea (15, 25).
    """
    ellipsoidal = np.isfinite(values[75]) & np.isfinite(values[78])
    places = [
        (values[lat], values[lon], np.where(ellipsoidal, values[height], values[other]))
        for lat, lon, height, other in ((13, 14, 75, 15), (23, 24, 78, 25))
    ]
    rows = np.flatnonzero(np.isfinite([*angles_rad, *places[0], *places[1]]).all(axis=0))
    rows = rows[:: -(-len(rows) // _MOST_COMPARED) or 1]
    (lat, lon, height_m), there = (np.array(place)[:, rows] for place in places)
    lat_rad, lon_rad = np.radians([lat, lon])
    away_e = ecef_from_geodetic(*np.radians(there[:2]), there[2])
    away_e = away_e - ecef_from_geodetic(lat_rad, lon_rad, height_m)
    turns = zip(lat_rad.tolist(), lon_rad.tolist(), away_e, strict=True)
    away_n = np.array([rotation_ecef_from_ned(*at).T @ e for *at, e in turns]).reshape(-1, 3)
    rotations = [matrix_from_quat(quat_from_euler(*x[:, rows])) for x in np.split(angles_rad, 2)]
    ahead_n = (rotations[0] @ rotations[1])[:, :, 0]
    sines = np.linalg.norm(np.cross(ahead_n, away_n), axis=1)
    return np.asarray(np.degrees(np.arctan2(sines, (ahead_n * away_n).sum(axis=1))))


class _Optics:
    """Give the camera of a picture, from the fields of view that were recorded last before it."""

    def __init__(self, stamps_ns: Iterable[int], values: Mapping[int, Array]) -> None:
        rows = zip(stamps_ns, values[16].tolist(), values[17].tolist(), strict=True)
        self._fields = sorted(row for row in rows if 0 < row[1] < 180)
        self._begins = [row[0] for row in self._fields]

    def camera(self, stamp_ns: int, width: int, height: int) -> Camera | None:
        """Return a pinhole camera of the picture's size, or None if no field is recorded."""
        if not self._fields:
            return None
        place = max(bisect.bisect_right(self._begins, stamp_ns) - 1, 0)
        _, across_deg, down_deg = self._fields[place]
        fx = width / 2 / math.tan(math.radians(across_deg) / 2)
        fy = height / 2 / math.tan(math.radians(down_deg) / 2) if 0 < down_deg < 180 else fx
        try:
            return Camera(width, height, fx, fy, (width - 1) / 2, (height - 1) / 2)
        except CameraError:
            return None
