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
"""MISB streams: values by the standard's text, times of pictures, containers, hostile files."""

from __future__ import annotations

import math

import av
import numpy as np
import pytest
from damaged_files import read_damaged
from dji_videos import made_video
from klv_reader import by_klvdata, step_of

from tirgeo_ros.core.frames.rotations import euler_from_quat
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import ImuSample, JointSample, PositionSample
from tirgeo_ros.io.logs.forms import form_of
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.logs.misb import read_misb
from tirgeo_ros.io.logs.video_pictures import clock
from tirgeo_ros.io.video.frame_metadata import KEY, ber, packet

BEGIN_NS = 1_634_731_264_888_888_000
STAMPS_NS = [BEGIN_NS + round(k * 1e6 / 30) * 1000 for k in range(30)]
OPTIONS = LogOptions(geoid_undulation_m=-21.387)
VALUES = {
    5: 359.0,
    6: -3.5,
    7: 12.25,
    13: 48.137154,
    14: -11.576124,
    15: 540.0,
    16: 45.0,
    17: 36.0,
    18: 300.0,
    19: -45.0,
    20: 350.0,
}


def of_kind(contents, kind):
    return [sample for sample in contents.samples if isinstance(sample, kind)]


def read(folder, content, options=OPTIONS, name="flight.klv"):
    (folder / name).write_bytes(content)
    return read_misb(folder / name, options)


def raw(*items):
    """A packet of tags and bytes, without a checksum, at one second since 1970."""
    items = ((2, (10**6).to_bytes(8, "big")), *items)
    content = b"".join(bytes((tag, len(value))) + value for tag, value in items)
    return KEY + ber(len(content)) + content


def test_the_minimum_set_is_what_klvdata_reads(shared):
    path = shared / "foreign_logs" / "misb" / "st0902_dynamic_only.bin"
    values = {tag: value for tag, value in by_klvdata(path.read_bytes()).items() if tag > 2}
    contents = read_misb(path, LogOptions(geoid_undulation_m=0.0))
    (imu,), (joints,), (fix,) = (
        of_kind(contents, kind) for kind in (ImuSample, JointSample, PositionSample)
    )
    roll, pitch, heading = np.degrees(euler_from_quat(imu.autopilot_q_nb))
    ours = {
        5: heading % 360,
        6: pitch,
        7: roll,
        13: math.degrees(fix.latitude_rad),
        14: math.degrees(fix.longitude_rad),
        15: fix.height_m,
        18: math.degrees(joints.yaw_rad) % 360,
        19: math.degrees(joints.pitch_rad),
    }
    for tag, value in ours.items():
        assert value == pytest.approx(float(values[tag]), abs=step_of(tag)), tag


def test_out_of_range_is_absent_and_the_full_range_takes_its_place(tmp_path):
    error, heading, roll = (6, b"\x80\x00"), (5, b"\x40\x00"), (7, b"\x00\x00")
    contents = read(tmp_path, raw(heading, error, roll))
    assert not of_kind(contents, ImuSample)
    assert contents.refused["packet", "no heading, pitch and roll of the platform"] == 1
    steep = (90, b"\xc0\x00\x00\x00")  # -45 deg
    (imu,) = of_kind(read(tmp_path, raw(heading, error, roll, steep)), ImuSample)
    assert np.degrees(euler_from_quat(imu.autopilot_q_nb))[1] == pytest.approx(-45, abs=1e-6)
    short = (90, b"\xc0\x00")
    assert not of_kind(read(tmp_path, raw(heading, roll, short)), ImuSample)


def test_heights_have_a_datum(tmp_path):
    place = (13, b"\x40\x00\x00\x00"), (14, b"\x00\x00\x00\x00")
    at_sea, ellipsoidal = (15, b"\x00\x00"), (75, b"\xff\xff")

    def height_m(*items, options=OPTIONS):
        (fix,) = of_kind(read(tmp_path, raw(*place, *items), options), PositionSample)
        return fix.height_m

    assert height_m(at_sea) == pytest.approx(-900 - 21.387)
    assert height_m(at_sea, ellipsoidal, options=LogOptions()) == pytest.approx(19_000)
    with pytest.raises(LogError, match=r"^/.*flight.klv: .*--geoid-undulation"):
        height_m(at_sea, options=LogOptions())


def test_a_missing_roll_is_said_and_a_time_needed(tmp_path):
    contents = read(tmp_path, packet(BEGIN_NS, {18: 90.0, 19: -30.0}))
    assert of_kind(contents, JointSample)[0].roll_rad == 0
    assert any("roll is not recorded" in note for note in contents.notes)
    contents = read(tmp_path, packet(0, VALUES) + packet(1 << 61, VALUES))
    assert not contents.samples
    assert contents.refused["packet", "no time, or none between 1970 and 2038"] == 2


def packets_of(stamps_ns):
    return [packet(stamp_ns, VALUES) for stamp_ns in stamps_ns]


def test_pictures_have_the_time_of_their_packets(tmp_path):
    stream = made_video(tmp_path / "a.ts", 30, beside=packets_of(STAMPS_NS)).read_bytes()
    contents = read_misb(tmp_path / "a.ts", OPTIONS)
    pictures = [*contents.pictures]
    assert [picture.stamp_ns for picture in pictures] == STAMPS_NS
    assert contents.read == {"packet": 30, "picture": 30}
    assert not contents.refused
    camera = pictures[0].camera
    assert (camera.width, camera.height, camera.cx) == (64, 48, 31.5)
    assert camera.fx == pytest.approx(32 / math.tan(math.radians(22.5)), rel=1e-3)
    assert camera.fy == pytest.approx(24 / math.tan(math.radians(18)), rel=1e-3)
    assert contents.parameters["confidence.focal_sigma"] == 0.01
    # The same stream with a time before each of its packets of 188 bytes, as cameras write it.
    blocks = [stream[k : k + 188] for k in range(0, len(stream), 188)]
    long = b"".join(k.to_bytes(4, "big") + block for k, block in enumerate(blocks))
    again = read(tmp_path, long, name="a.m2ts")
    assert form_of(tmp_path / "a.m2ts").name == "MISB ST 0601"
    assert [p.stamp_ns for p in again.pictures] == [p.stamp_ns for p in pictures]
    third = read_misb(tmp_path / "a.ts", LogOptions(geoid_undulation_m=0.0, every_s=0.1))
    assert [p.stamp_ns for p in third.pictures] == [p.stamp_ns for p in pictures[::3]]


def test_the_clock_follows_drift_without_jitter():
    """UTC gains 1 s in an hour; a packet each second, late by 0 to 20 ms."""
    times_s, drifting = np.arange(3600.0), 1 + 1 / 3600
    late_s = np.random.default_rng(5).uniform(0, 0.02, 3600)
    stamps_ns = BEGIN_NS + (times_s * drifting * 1e9).astype(np.int64)
    utc_ns = clock(times_s + late_s, stamps_ns, 50)
    errors_s = [(utc_ns(t) - BEGIN_NS) * 1e-9 - t * drifting + 0.01 for t in times_s[::7].tolist()]
    assert np.abs(errors_s).max() < 0.012  # half a group of packets at the ends
    assert np.median(np.abs(errors_s)) < 0.002
    assert not clock(np.full(3, math.nan), stamps_ns[:3])(1.0)


def test_a_programme_stream_has_its_metadata_without_times(tmp_path):
    with av.open(str(tmp_path / "a.mpg"), "w", format="mpeg") as container:
        video = container.add_stream("mpeg2video", rate=30)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        for pixels in np.random.default_rng(2).integers(0, 255, (30, 48, 64, 3), np.uint8):
            container.mux(video.encode(av.VideoFrame.from_ndarray(pixels, format="bgr24")))
        container.mux(video.encode())
    packs = (tmp_path / "a.mpg").read_bytes().split(b"\0\0\1\xba")[1:]
    body = b"\x80\0\0" + packet(BEGIN_NS, VALUES)
    beside = b"\0\0\1\xfc" + len(body).to_bytes(2, "big") + body
    unset = packet(0, VALUES)  # the clock was not set yet
    stream = b"".join(b"\0\0\1\xba" + pack + beside for pack in [packs[0] + unset, *packs[1:]])
    contents = read(tmp_path, stream, name="b.mpg")
    assert len(of_kind(contents, JointSample)) == len(packs)
    stamps_s = np.array([picture.stamp_ns - BEGIN_NS for picture in contents.pictures]) * 1e-9
    assert 28 <= len(stamps_s) <= 30  # few have a time: FFmpeg may give two of them one
    assert np.abs(stamps_s - np.arange(len(stamps_s)) / 30).max() < 0.1
    assert any("no times in the stream" in note for note in contents.notes)


def test_a_picture_has_its_own_time_stamp_where_there_is_one(shared):
    """The stream's packets have no times; each picture's own is that of the packet beside it."""
    path = shared / "foreign_logs" / "misb" / "h264_klv.ts"
    contents = read_misb(path, LogOptions())
    stamps = [sample.stamp_ns for sample in of_kind(contents, JointSample)]
    assert [picture.stamp_ns for picture in contents.pictures] == stamps
    assert len(stamps) == 30


def test_damaged_streams_are_read_as_far_as_they_go(tmp_path):
    whole = made_video(tmp_path / "a.ts", 30, beside=packets_of(STAMPS_NS)).read_bytes()

    def number(path):
        contents = read_misb(path, OPTIONS)
        return [*contents.samples, *contents.pictures]

    assert read_damaged(number, whole, tmp_path / "b.ts", 40) > 30


def test_what_has_no_metadata_is_refused(tmp_path):
    made_video(tmp_path / "a.ts", 5)
    with pytest.raises(LogError, match=r"a.ts: no metadata of MISB ST 0601"):
        read_misb(tmp_path / "a.ts", OPTIONS)
    hollow = (b"\x47" + bytes(187)) * 50
    with pytest.raises(LogError, match=r"^/.*b.ts: "):
        read(tmp_path, hollow, name="b.ts")
