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
in the order yaw, pitch, roll. They are of the line of sight through the picture's middle, which
is the optical axis of the pinhole camera of the fields of view. The position (13, 14) is that of
the camera itself. The frame's centre (23 to 25) is only compared: a stream whose angles mean
something else shows there.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import matrix_from_euler, quat_from_euler, wrapped
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.arrays import Array, IntArray
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
from tirgeo_ros.io.logs.log_contents import MSL, LogContents, LogOptions
from tirgeo_ros.io.logs.misb_stream import (
    PACKET,
    PREFIX,
    Timed,
    bare_packets,
    is_stream,
    stream_packets,
)
from tirgeo_ros.io.logs.video_pictures import Optics, clock, pictures
from tirgeo_ros.io.video.frame_metadata import ITEMS, TIME

#: Values (N,) of packets by tag, in the items' units, angles in rad; nan where there is none.
_Values: TypeAlias = Mapping[int, Array]

_IN_STREAM = 0  # no tag: the packet's time in the stream, s
_TAGS = (TIME, 5, 6, 7, *range(13, 21), 23, 24, 25, 75, 78, 90, 91)
#: Neighbouring packets whose times in the stream give one median: some seconds.
_NEIGHBOURS = 50
_FOCAL_SIGMA = 0.01  # of a stream's field of view, which no calibration has measured
_MIDDLE = (
    "the sensor's angles are of the picture's middle: keep to the camera of its fields of view, "
    "for a calibrated one has another axis, which would need its boresight_rpy_deg"
)
_MOST_COMPARED = 1000  # packets, spread evenly: enough for the quantiles
_UNKNOWN = np.zeros((3, 3))


def is_misb(head: bytes) -> bool:
    """Return whether a file's first bytes are a transport or programme stream, or KLV."""
    return is_stream(head) or head.startswith(PREFIX)


def read_misb(path: Path, options: LogOptions) -> LogContents:
    """Read a stream (.ts, .mpg) or its bare metadata (.klv). Raise LogError if it has none."""
    contents, head = LogContents(), first_bytes(path, 1 << 10, LogError)
    in_stream = is_stream(head)
    packets = stream_packets(path, contents) if in_stream else bare_packets(path, contents)
    values = _values(packets, contents)
    if not contents.read:
        raise LogError(f"{path}: no metadata of MISB ST 0601 in it: give the video's log instead")
    stamps_ns = values[TIME].astype(np.int64) * 1000
    _add_positions(contents, stamps_ns.tolist(), values, options, path)
    _add_attitudes(contents, stamps_ns.tolist(), values)
    if in_stream and stamps_ns.size:
        contents.parameters["confidence.focal_sigma"] = _FOCAL_SIGMA
        contents.notes.append(_MIDDLE)
        utc_ns, optics = (
            clock(values[_IN_STREAM], stamps_ns, _NEIGHBOURS),
            _optics(stamps_ns, values),
        )
        contents.pictures = pictures(path, contents, utc_ns, optics, options.every_s)
    return contents


def _values(packets: Iterable[Timed], contents: LogContents) -> _Values:
    """Return the values of packets in order of time; refuse packets without a time."""
    numbers = array("d")  # in little memory
    for items, time_s in packets:
        row = [ITEMS[tag].decoded(items.get(tag, b"")) for tag in _TAGS]
        if 0 < row[0] * 1000 < LAST_NS:
            numbers.extend((time_s, *row))
        else:
            contents.refused[PACKET, "no time, or none between 1970 and 2038"] += 1
    columns = np.array(numbers).reshape(-1, 1 + len(_TAGS)).T
    columns = columns[:, np.argsort(columns[1], kind="stable")]
    angles = [tag for tag in _TAGS if ITEMS[tag].unit == "deg"]
    values = dict(zip((_IN_STREAM, *_TAGS), columns, strict=True))
    return values | {tag: np.radians(values[tag]) for tag in angles}


def _or(choice: Array, other: Array) -> Array:
    """Return the first of two values (N,) that is finite, in each place."""
    return np.where(np.isfinite(choice), choice, other)


def _complete(contents: LogContents, lack: str, columns: Array) -> list[int]:
    """Return the rows in which all columns (3, N) are finite; count the others."""
    complete = np.isfinite(columns).all(axis=0)
    if refused := int((~complete).sum()):
        contents.refused[PACKET, f"no {lack}"] += refused
    return np.flatnonzero(complete).tolist()


def _add_positions(
    contents: LogContents, stamps_ns: list[int], values: _Values, options: LogOptions, path: Path
) -> None:
    height_m = values[75]
    if (np.isnan(height_m) & np.isfinite(values[15])).any():
        height_m = _or(height_m, values[15] + options.to_ellipsoid_m(MSL, path))
    places = np.array([values[13], values[14], height_m])
    for k in _complete(contents, "position of the sensor", places):
        fix = Source.GPS_POSITION, FixStatus.SINGLE, *places[:, k].tolist(), _UNKNOWN
        contents.samples.append(PositionSample(stamps_ns[k], *fix))


def _add_attitudes(contents: LogContents, stamps_ns: list[int], values: _Values) -> None:
    """Add the platform's attitudes and the sensor's angles; compare with the frame's centre."""
    platform = np.array([_or(values[7], values[91]), _or(values[6], values[90]), values[5]])
    sensor = np.array([values[20], values[19], values[18]])
    if np.isnan(sensor[0]).all() and np.isfinite(sensor[2]).any():
        sensor[0] = 0.0
        contents.notes.append("the sensor's relative roll is not recorded: 0 is assumed")
    q_nb = quat_from_euler(*np.nan_to_num(platform))
    for k in _complete(contents, "heading, pitch and roll of the platform", platform):
        contents.samples.append(ImuSample.of_attitude(stamps_ns[k], q_nb[k]))
    for k in _complete(contents, "azimuth, elevation and roll of the sensor", sensor):
        roll_rad, pitch_rad, yaw_rad = map(wrapped, sensor[:, k].tolist())
        contents.samples.append(JointSample(stamps_ns[k], yaw_rad, roll_rad, pitch_rad))
        contents.parameters["joint_order"] = "yaw-pitch-roll"
    if angles_deg := _to_centre_deg(platform, sensor, values):
        median, p90 = np.percentile(angles_deg, [50, 90])
        contents.notes.append(
            f"frame centre of the stream against ours: median {median:.3f} deg, p90 {p90:.3f} deg"
        )


def _to_centre_deg(platform: Array, sensor: Array, values: _Values) -> list[float]:
    """Return the angles between composed line of sight and that to the frame's centre, deg.

    Both attitudes (3, N) are roll, pitch, yaw, rad. The heights of both places are of one datum:
    ellipsoidal (75, 78) or above the sea (15, 25).
    """
    sea = np.isnan(values[75] + values[78])
    here = np.array([values[13], values[14], np.where(sea, values[15], values[75])])
    there = np.array([values[23], values[24], np.where(sea, values[25], values[78])])
    rows = np.flatnonzero(np.isfinite([*platform, *sensor, *here, *there]).all(axis=0))
    angles_deg = []
    for k in rows[:: len(rows) // _MOST_COMPARED + 1].tolist():
        away_n = TangentPlane(*here[:, k].tolist()).ned_from_geodetic(*there[:, k].tolist())
        turned = matrix_from_euler(*platform[:, k]) @ matrix_from_euler(*sensor[:, k])
        ahead, right, down = turned.T @ away_n
        angles_deg.append(math.degrees(math.atan2(math.hypot(right, down), ahead)))
    return angles_deg


def _optics(stamps_ns: IntArray, values: _Values) -> Optics:
    """Return what gives a picture's camera, from the field of view recorded last before it."""
    rows = np.flatnonzero((values[16] > 0) & (values[16] < math.pi))

    def camera(stamp_ns: int, width: int, height: int) -> Camera | None:
        with suppress(CameraError, IndexError):  # an impossible lens, or none at all
            place = int(np.searchsorted(stamps_ns[rows], stamp_ns, "right"))
            row = rows[max(place - 1, 0)]
            across_rad, down_rad = float(values[16][row]), float(values[17][row])
            fx = width / 2 / math.tan(across_rad / 2)
            fy = height / 2 / math.tan(down_rad / 2) if 0 < down_rad < math.pi else fx
            return Camera(width, height, fx, fy, (width - 1) / 2, (height - 1) / 2)
        return None

    return camera
