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
"""u-blox UBX: the samples against pyubx2's own reader, and the headings that must be refused."""

from __future__ import annotations

import math
from datetime import datetime, timezone

import numpy as np
import pytest
from foreign_logs import OPTIONS, pvt, relposned

from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    PositionSample,
    VelocitySample,
)
from tirgeo_ros.io.logs.forms import NMEA, UBX, form_of
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.logs.ubx import is_ubx, read_ubx, ubx_frames

pyubx2 = pytest.importorskip("pyubx2")

LOGS = (
    *("walk_0827_pvt_nmea", "zed_f9p_rtk_pvt", "fixed_base_relposned_one_epoch"),
    *("neo_m8p_relposned_v0", "zed_x20p_relposned_invalid", "made_moving_base"),
)


def read(folder, *frames, options=OPTIONS):
    path = folder / "log.ubx"
    path.write_bytes(b"".join(frames))
    return read_ubx(path, options)


def of(contents, kind):
    return [sample for sample in contents.samples if isinstance(sample, kind)]


def hpposllh(i_tow, height):
    """Return a NAV-HPPOSLLH 3 mm above the solution, as bytes."""
    values = {"iTOW": i_tow, "lon": 11.5, "lat": 48.1, "height": height + 3}
    return pyubx2.UBXMessage("NAV", "NAV-HPPOSLLH", pyubx2.GET, **values).serialize()


def judged(path):
    """The messages of pyubx2's reader over the whole stream, by identity."""
    result = {}
    with path.open("rb") as stream:
        for _, message in pyubx2.UBXReader(stream, protfilter=2, quitonerror=0):
            if message is not None:
                result.setdefault(message.identity, []).append(message)
    return result


@pytest.mark.parametrize("name", LOGS)
def test_positions_and_velocities_are_those_of_pyubx2(shared, name):
    path = shared / "foreign_logs" / "ublox" / f"{name}.ubx"
    contents, messages = read_ubx(path, OPTIONS), judged(path)
    positions, velocities = of(contents, PositionSample), of(contents, VelocitySample)
    precise = {m.iTOW: m for m in messages.get("NAV-HPPOSLLH", [])}
    assert len(positions) == len(velocities) == len(messages["NAV-PVT"]) > 0
    for position, velocity, m in zip(positions, velocities, messages["NAV-PVT"], strict=True):
        utc = datetime(m.year, m.month, m.day, m.hour, m.min, m.second, tzinfo=timezone.utc)
        assert position.stamp_ns == velocity.stamp_ns == round(utc.timestamp()) * 10**9 + m.nano
        place = precise.get(m.iTOW, m)
        degrees = math.degrees(position.latitude_rad), math.degrees(position.longitude_rad)
        assert degrees == pytest.approx((place.lat, place.lon), abs=1e-12)
        assert position.height_m == pytest.approx(place.height / 1000, abs=1e-9)
        expected = {(2, 1): 2, (1, 1): 1, (0, 1): 1, (0, 0): 0}[m.carrSoln, m.diffSoln]
        assert position.status == expected
        np.testing.assert_allclose(velocity.velocity_n, np.array([m.velN, m.velE, m.velD]) / 1000)
        north, east, down = position.covariance_n.diagonal()
        assert math.sqrt(north + east) == pytest.approx(place.hAcc / 1000)
        assert math.sqrt(down) == pytest.approx(place.vAcc / 1000)
    assert contents.read["NAV-PVT"] == len(messages["NAV-PVT"])


def test_headings_of_a_moving_base(shared):
    path = shared / "foreign_logs" / "ublox" / "made_moving_base.ubx"
    headings = of(read_ubx(path, OPTIONS), HeadingSample)
    messages = judged(path)
    stamps = {p.stamp_ns for p in of(read_ubx(path, OPTIONS), PositionSample)}
    assert len(headings) == len(messages["NAV-RELPOSNED"]) == 150
    for heading, m in zip(headings, messages["NAV-RELPOSNED"], strict=True):
        assert heading.stamp_ns in stamps
        assert heading.heading_rad == pytest.approx(math.radians(m.relPosHeading), abs=1e-12)
        assert heading.variance_rad2 == pytest.approx(math.radians(m.accHeading) ** 2)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        # 24.96 km from its base: all else of that message says that the heading is good
        ("fixed_base_relposned_one_epoch", "not of a moving base"),
        ("neo_m8p_relposned_v0", "version 0 of 40 bytes has no heading"),
        ("zed_x20p_relposned_invalid", "the receiver marks it as not valid"),
    ],
)
def test_real_relposned_that_are_no_heading(shared, name, reason):
    contents = read_ubx(shared / "foreign_logs" / "ublox" / f"{name}.ubx", OPTIONS)
    assert not of(contents, HeadingSample)
    refused = {why: n for (record, why), n in contents.refused.items() if record.endswith("NED")}
    assert [why.startswith(reason) for why in refused] == [True]
    assert sum(refused.values()) == contents.read["NAV-RELPOSNED"]


@pytest.mark.parametrize(
    ("solution", "vector", "reason"),
    [
        ({}, {"isMoving": 0}, "not of a moving base"),
        ({}, {"carrSoln": 1}, "ambiguities are not fixed"),
        ({}, {"relPosHeadingValid": 0}, "the receiver marks it as not valid"),
        ({}, {"relPosLength": 131}, "its length is more than 0.1 m from the baseline's"),
        ({}, {"relPosLength": 2496465}, "its length is more than 0.1 m from the baseline's"),
        ({}, {"iTOW": 5}, "no NAV-PVT with a date within a minute of it"),
        ({"validTime": 0}, None, "date or time is not valid"),
        ({"fullyResolved": 0}, None, "UTC is not resolved"),
        ({"month": 13}, None, "date or time is impossible"),
        ({"fixType": 2}, None, "no 3D fix"),
        ({"gnssFixOk": 0}, None, "no 3D fix"),
        ({"invalidLlh": 1}, None, "latitude, longitude and height are not valid"),
    ],
)
def test_headings_and_solutions_that_are_refused(tmp_path, solution, vector, reason):
    frames = [pvt(**solution)] + ([] if vector is None else [relposned(**vector)])
    contents = read(tmp_path, *frames)
    assert not of(contents, HeadingSample)
    assert bool(contents.samples) == (vector is not None)
    assert [why.startswith(reason) for _, why in contents.refused] == [True]


def test_a_heading_needs_the_length_of_the_baseline(tmp_path):
    contents = read(tmp_path, pvt(), relposned(), options=LogOptions())
    ((_, reason),) = contents.refused
    assert reason.startswith("the baseline's length is not known")


def test_headings_between_the_solutions(tmp_path):
    """Their epochs follow by the time of week, before the date is known and over a week's end."""
    vectors = [relposned(iTOW=i_tow) for i_tow in (604_799_600, 604_799_800, 0, 200)]
    saturday = {"day": 15, "hour": 23, "min": 59, "second": 41, "nano": 800_000_000}
    undated = pvt(iTOW=604_799_600, fullyResolved=0)
    dated = pvt(iTOW=604_799_800, **saturday)
    contents = read(tmp_path, undated, vectors[0], dated, *vectors[1:])
    last_ns = round(datetime(2024, 6, 15, 23, 59, 42, tzinfo=timezone.utc).timestamp()) * 10**9
    steps_ns = [heading.stamp_ns - last_ns for heading in of(contents, HeadingSample)]
    assert steps_ns == [-400_000_000, -200_000_000, 0, 200_000_000]


def test_logs_of_two_weeks_in_one_file(tmp_path):
    """The times of week are the same: what belongs together stands together."""
    epochs = [
        pvt(day=day, iTOW=i_tow, height=height) + relposned(iTOW=i_tow) + hpposllh(i_tow, height)
        for day, height in ((11, 560_100), (18, 580_200))
        for i_tow in (200_697_000, 200_698_000)
    ]
    contents = read(tmp_path, *epochs)
    positions = of(contents, PositionSample)
    assert positions[2].stamp_ns - positions[0].stamp_ns == 7 * 86400 * 10**9
    heights_m = [560.103, 560.103, 580.203, 580.203]
    assert [p.height_m for p in positions] == pytest.approx(heights_m, abs=1e-5)
    stamps_ns = [position.stamp_ns for position in positions]
    assert [heading.stamp_ns for heading in of(contents, HeadingSample)] == stamps_ns


def test_a_receiver_that_was_set_to_ubx_later(tmp_path):
    path = tmp_path / "log.ubx"
    path.write_bytes(b"$GNGGA,074439.00,,,,,0,,,,,,,,*4F\r\n" * 2000)
    assert form_of(path) is NMEA
    path.write_bytes(path.read_bytes() + pvt())
    assert form_of(path) is UBX


@pytest.mark.parametrize(
    ("options", "expected_deg"),
    [
        (LogOptions(baseline_m=1.2), 200.0),
        (LogOptions(baseline_m=1.2, baseline_rad=math.radians(90)), 110.0),
        (LogOptions(baseline_m=1.2, baseline_rad=math.radians(90), rover_first=True), 290.0),
    ],
)
def test_the_nose_by_the_direction_of_the_baseline(tmp_path, options, expected_deg):
    contents = read(tmp_path, relposned(), pvt(), options=options)  # in any order
    (heading,) = of(contents, HeadingSample)
    assert math.degrees(heading.heading_rad) == pytest.approx(expected_deg)


def test_the_fraction_of_a_second_has_a_sign(tmp_path):
    early, late = of(read(tmp_path, pvt(nano=-456_994), pvt(nano=749_574_993)), PositionSample)
    whole_ns = round(datetime(2024, 6, 11, 7, 44, 39, tzinfo=timezone.utc).timestamp()) * 10**9
    assert early.stamp_ns == whole_ns - 456_994
    assert late.stamp_ns == whole_ns + 749_574_993
    assert early.status is FixStatus.FIXED


def test_a_damaged_length_costs_its_own_frame_alone(tmp_path):
    """What stands between frames is passed over; the frames after a damaged one are found."""
    damaged = bytearray(pvt())
    damaged[5] = 0xFF  # a length of 65 kB
    noise = b"# comment\n$GNGGA,074439.00,,,,,0,,,,,,,,*4F\r\n"
    contents = read(tmp_path, noise, pvt(), noise, bytes(damaged), pvt(second=40), pvt()[:50])
    assert len(of(contents, PositionSample)) == 2
    assert contents.refused == {("frame", "cut off, or its checksum is wrong"): 2}


@pytest.mark.parametrize(("length", "expected"), [(84, 1), (92, 1), (0, 0), (91, 0), (100, 0)])
def test_solutions_of_other_lengths(tmp_path, length, expected):
    """84 bytes are those of older receivers; what follows them is not used."""
    payload = (pvt()[6:-2] + bytes(8))[:length]
    frame = pyubx2.UBXMessage("NAV", "NAV-PVT", pyubx2.GET, payload=payload).serialize()
    contents = read(tmp_path, frame)
    assert len(of(contents, PositionSample)) == expected
    assert contents.refused.total() == 1 - expected


def test_frames_are_those_of_pyubx2(shared):
    path = shared / "foreign_logs" / "ublox" / "walk_0827_pvt_nmea.ubx"
    data = path.read_bytes()
    with path.open("rb") as stream:
        raw = [raw for raw, _ in pyubx2.UBXReader(stream, protfilter=2, parsing=False)]
    assert list(ubx_frames(data)) == raw
    assert is_ubx(data[:4096])
    assert not is_ubx(b"\xb5\x62 text that begins like a frame")
