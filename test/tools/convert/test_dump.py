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
"""``tirgeo dump``: a record for each frame, with any bytes between the frames."""

from __future__ import annotations

import json
import math
import random

import pytest
from hypothesis import given, strategies as st

from tirgeo_ros.dji.link.framing import encode_frame
from tirgeo_ros.dji.protocol.rtk_gps_imu_broadcast import (
    Broadcast,
    Rtk,
    Velocity,
    encode_broadcast,
)
from tirgeo_ros.dji.protocol.subscription import Package, Push, encode_push
from tirgeo_ros.tools.cli import main as command
from tirgeo_ros.tools.convert.dump import CaptureDump


def broadcast(**parts):
    return encode_frame(b"\x02\x00" + encode_broadcast(Broadcast(**parts)), sequence=56)


def push(package, **values):
    value = encode_push(Push(package, 123856, 378900, values))
    return encode_frame(b"\x02\x05" + value)


@pytest.fixture
def dump(tmp_path):
    def read(*frames, **options):
        path = tmp_path / "capture.bin"
        path.write_bytes(b"".join(frames))
        return list(CaptureDump(path, **options).records())

    return read


@pytest.fixture
def tirgeo_dump(tmp_path, capsys):
    """Exit code, lines of stdout read as JSON, and stderr of the command."""

    def run(data, *options):
        path = tmp_path / "capture.bin"
        path.write_bytes(data)
        code = command.main(["dump", str(path), *options])
        out, err = capsys.readouterr()
        return (
            code,
            [json.loads(line, parse_constant=pytest.fail) for line in out.splitlines()],
            err,
        )

    return run


def test_the_example_frames_print_as_documented(shared, tirgeo_dump):
    reports = (shared / "dji" / "frames.jsonl").read_text().splitlines()
    code, records, err = tirgeo_dump((shared / "dji" / "frames.bin").read_bytes())
    assert records == [json.loads(line) for line in reports]
    assert [list(record) for record in records] == [list(json.loads(line)) for line in reports]
    assert (code, err) == (0, "tirgeo dump: 32 frames (26 broadcast, 6 subscription)\n")


def test_bytes_between_the_frames_are_counted(tirgeo_dump):
    noise = random.Random(7).randbytes(100).replace(b"\xaa", b"\x55")
    whole = broadcast(mag=(1, -2, 3))
    damaged = bytearray(whole)
    damaged[-6] ^= 1
    cut = whole[:20]
    code, records, err = tirgeo_dump(noise + whole + bytes(damaged) + whole + cut)
    assert [record["offset"] for record in records] == [100, 152]
    assert code == 0
    assert err == ("tirgeo dump: 2 frames (2 broadcast); 146 bytes skipped; 2 damaged or cut\n")


def test_nan_is_null(tirgeo_dump):
    rtk = Rtk(20240611, 74439, math.nan, 52.0, math.inf, (1.0, -math.inf, 0.0), 90, 50, 50)
    velocity = Velocity((math.nan, 0.5, 0.0), 1)
    _, (record,), _ = tirgeo_dump(broadcast(rtk=rtk, velocity=velocity))
    assert record["fields"]["velocity"] == {"xyz_mps": [None, 0.5, 0.0], "health": 1}
    result = record["fields"]["rtk"]
    assert (result["lon_deg"], result["lon_rad"], result["hfsl_m"]) == (None, None, None)
    assert (result["vel_cmps"], result["vel_mps"]) == ([1.0, None, 0.0], [0.01, None, 0.0])
    assert result["lat_deg"] == 52.0


def test_a_broadcast_of_no_layout_has_its_mask(dump, tirgeo_dump):
    frame = encode_frame(b"\x02\x00\x03\x00" + bytes(5))
    (record,) = dump(frame)
    assert (record["kind"], record["layout"], record["mask"]) == ("broadcast", None, 3)
    assert record["fields"] == {}
    (record,) = dump(encode_frame(b"\x02\x00\x03"))
    assert record["mask"] is None
    assert "; 1 unreadable\n" in tirgeo_dump(frame)[2]


def test_packages_from_a_file(dump, tmp_path):
    file = tmp_path / "packages.yaml"
    file.write_text(
        "packages: {1: {rate_hz: 20, with_timestamp: true, topics: [RTK_YAW, RTK_POSITION]}}"
    )
    package = Package.of(1, 20, with_timestamp=True, names=("RTK_YAW", "RTK_POSITION"))
    frame = push(package, RTK_YAW=-90, RTK_POSITION=(7.5, 46.5, 540.25))
    (record,) = dump(frame, packages=file)
    assert (record["pkg_id"], record["freq_hz"], record["with_timestamp"]) == (1, 20, True)
    assert record["topics"] == [
        {"name": "RTK_YAW", "uid": "0xf45d73fd"},
        {"name": "RTK_POSITION", "uid": "0x1df9a6b6"},
    ]
    assert record["fields"]["RTK_YAW"]["deg"] == -90
    assert record["fields"]["RTK_POSITION"] == {"lon_deg": 7.5, "lat_deg": 46.5, "hfsl_m": 540.25}
    assert dump(frame)[0]["topics"] == []  # not in the default packages


def test_other_frames_show_their_bytes(dump):
    asked, answer = dump(
        encode_frame(b"\x00\x00\x05", session=2, sequence=1),
        encode_frame(b"\x01\x02", session=2, sequence=1, is_ack=True),
    )
    assert (asked["kind"], asked["cmd_id"], asked["fields"]) == ("unknown", 0, {"hex": "05"})
    assert (answer["kind"], answer["cmd_set"]) == ("ack", None)
    assert answer["fields"] == {"hex": "0102"}


COMMANDS = [b"\x02\x00", b"\x02\x05", b"\x02\x01", b"\x00\x00", b"\x00\x01", b"\x00\x10"]
COMMANDS += [bytes((0x0B, number)) for number in range(8)]
FRAMES = st.builds(
    lambda command, value, session, is_ack: encode_frame(
        value if is_ack else command + value, session=session, is_ack=is_ack
    ),
    st.sampled_from(COMMANDS) | st.binary(max_size=2),
    st.binary(max_size=300) | st.sampled_from([bytes(64), b"\x03" + b"\xff" * 63, b"\xff" * 37]),
    st.integers(0, 2),  # few, so that answers meet requests
    st.booleans(),
)


@given(st.lists(FRAMES, min_size=1, max_size=20))
def test_any_frames_print_as_json(tmp_path_factory, frames):
    path = tmp_path_factory.getbasetemp() / "any.bin"
    path.write_bytes(b"".join(frames))
    records = list(CaptureDump(path).records())
    assert len(records) == len(frames)
    for record in records:
        json.dumps(command.plain(record), allow_nan=False)


@pytest.mark.parametrize("text", [b"", b"no frame in here", bytes(range(256)) * 10])
def test_a_file_without_a_frame_is_an_error(tirgeo_dump, tmp_path, text):
    code, records, err = tirgeo_dump(text)
    what = f"no frame in {len(text)} bytes" if text else "the file is empty"
    assert (code, records) == (1, [])
    assert err.startswith(f"tirgeo dump: {tmp_path}/capture.bin: {what}")
    assert err.count("\n") == 1
