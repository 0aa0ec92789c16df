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
"""ArduPilot's logs: every field as pymavlink reads it, instances, GPS time, and damaged files."""

from __future__ import annotations

import math
from collections import defaultdict
from datetime import datetime, timezone

import numpy as np
import pytest
from autopilot_logs import DataflashFile
from damaged_files import read_damaged
from foreign_logs import by_source

from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.core.types.measurements import FixStatus, Source
from tirgeo_ros.io.logs.dataflash import is_dataflash, read_dataflash
from tirgeo_ros.io.logs.log_contents import LogOptions

pytest.importorskip("pymavlink")
UNDULATION_M = 19.25
OPTIONS = LogOptions(geoid_undulation_m=UNDULATION_M)
IMU = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"
GPS = "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U"
GPA = "TimeUS,I,VDop,HAcc,VAcc,SAcc,YAcc,VV,SMS,Delta,Und"


def small_log():
    """A log of 0.5 s with two IMUs and two receivers in the columns of newer versions."""
    log = DataflashFile()
    log.message("IMU", "QBffffff", IMU)
    log.message("ATT", "QccccCC", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw")
    log.message("GPS", "QBBIHBcLLeffffB", GPS)
    log.message("GPA", "QBCCCCfBIHf", GPA)
    log.message("PARM", "QNf", "TimeUS,Name,Value")
    for k in range(101):
        at_us = 80_000_000 + 5_000 * k
        for instance in (0, 1):
            log.add("IMU", at_us, instance, 0.01, -0.02, 0.03, 0.1, 0.2 + instance, -9.8)
        if k % 20 == 0:
            log.add("ATT", at_us, 0, 5.0, 0, -10.0, 0, k)
    log.add("PARM", 0, "GPS_POS1_X", 0.5)
    return log


def fix(log, at_us, status, yaw_deg, instance=0, vertical=1, used=1, week=1973):
    log.add("GPS", at_us, instance, status, 6_448_000 + at_us // 1000 - 80_000, week, 20, 0.7,
            -35.3626277, 149.1653034, 588.82, 5.0, 30.0, -1.5, yaw_deg, used)  # fmt: skip
    log.add("GPA", at_us, instance, 1.2, 0.02, 0.03, 0.1, 0.5, vertical, at_us // 1000, 200, -19.2)


def test_every_field_is_the_source_readers(shared):
    """Against pymavlink, for each record and field of a flight controller's log."""
    from pymavlink.DFReader import DFReader_binary  # noqa: PLC0415  an extra

    path = shared / "foreign_logs" / "ardupilot" / "plane_1s.BIN"
    result, rows = by_source(read_dataflash(path, OPTIONS)), defaultdict(list)
    log = DFReader_binary(str(path))
    while message := log.recv_msg():
        rows[message.get_type()].append(message)
    week_utc_us = datetime(2017, 10, 29, tzinfo=timezone.utc).timestamp() * 1e6 - 18e6
    shifts = [week_utc_us + gps.GMS * 1000 - gps.TimeUS for gps in rows["GPS"]]
    shift_us = int(np.median(shifts))
    assert max(shifts) - min(shifts) < 10_000

    def same(samples, name):
        assert [s.stamp_ns // 1000 - shift_us for s in samples] == [m.TimeUS for m in rows[name]]
        return zip(samples, rows[name], strict=True)

    for sample, message in same(result[Source.IMU], "IMU"):
        assert sample.specific_force_b.tolist() == [message.AccX, message.AccY, message.AccZ]
        assert sample.angular_rate_b.tolist() == [message.GyrX, message.GyrY, message.GyrZ]
    accuracies = {message.TimeUS: message for message in rows["GPA"]}
    for sample, message in same(result[Source.GPS_POSITION], "GPS"):
        place = math.degrees(sample.latitude_rad), math.degrees(sample.longitude_rad)
        assert place == pytest.approx((message.Lat, message.Lng), abs=1e-13)
        assert sample.height_m == pytest.approx(message.Alt + UNDULATION_M, abs=1e-12)
        assert sample.status is FixStatus.SINGLE
        accuracy = accuracies[message.TimeUS]
        sigmas = np.sqrt(sample.covariance_n.diagonal())
        assert sigmas == pytest.approx((accuracy.HAcc, accuracy.HAcc, accuracy.VAcc))
    for sample, message in same(result[Source.GPS_VELOCITY], "GPS"):
        north, east, down = sample.velocity_n
        assert math.hypot(north, east) == pytest.approx(message.Spd)
        assert math.degrees(math.atan2(east, north)) % 360 == pytest.approx(message.GCrs)
        assert down == message.VZ
        sigma = accuracies[message.TimeUS].SAcc
        assert math.sqrt(sample.covariance_n[0, 0]) == pytest.approx(sigma)
    for sample, message in same(result[Source.BAROMETER], "BARO"):
        assert sample.pressure_pa == message.Press
    attitudes = sum(sample.autopilot_q_nb is not None for sample in result[Source.IMU])
    assert attitudes == len(rows["IMU"]) - 1  # the first is before the first attitude


def test_the_first_of_each_is_taken_with_rtk_and_yaw(tmp_path):
    log = small_log()
    fix(log, 80_100_000, 6, 123.0)
    fix(log, 80_100_000, 3, 9.0, instance=1)
    fix(log, 80_300_000, 5, 0.0)  # 0 where the receiver has no yaw
    fix(log, 80_400_000, 2, 0.0)
    contents = read_dataflash(log.write(tmp_path / "a.BIN"), OPTIONS)
    result = by_source(contents)
    first, second = result[Source.RTK_POSITION]
    assert (first.status, second.status) == (FixStatus.FIXED, FixStatus.FLOAT)
    utc = datetime(2017, 10, 29, 1, 47, 10, 100_000, tzinfo=timezone.utc)
    assert first.stamp_ns == round(utc.timestamp() * 1e6) * 1000
    assert first.height_m == pytest.approx(588.82 + UNDULATION_M)
    assert np.sqrt(first.covariance_n.diagonal()) == pytest.approx((0.02, 0.02, 0.03))
    (heading,) = result[Source.RTK_HEADING]
    assert math.degrees(heading.heading_rad) == pytest.approx(123.0)
    assert math.sqrt(heading.variance_rad2) == pytest.approx(math.radians(0.5))
    assert result[Source.RTK_VELOCITY][0].velocity_n == pytest.approx(
        (5 * math.cos(math.radians(30)), 2.5, -1.5)
    )
    assert {sample.specific_force_b[1] for sample in result[Source.IMU]} == {np.float32(0.2)}
    assert contents.refused == {
        ("IMU", "of another instance than the one taken"): 101,
        ("GPS", "of another instance than the one taken"): 1,
        ("GPS", "fix type 2: no position in three dimensions"): 1,
    }
    assert "GPS_POS1: the antenna is at [0.5, 0, 0] (forward, left, up)" in " ".join(
        contents.notes
    )


@pytest.mark.parametrize(
    ("fixes", "used", "taken"), [((1, 6), 0, 1), ((3, 6), 1, 1), ((3, 6), 0, 0), ((3, 6), 2, 0)]
)
def test_the_receiver_is_taken_that_the_autopilot_used(tmp_path, fixes, used, taken):
    """Not the first where that has no fix, and not a rover of a moving base, whatever its fix."""
    log = small_log()
    log.add("PARM", 0, "GPS_POS2_X", 0.25)
    for instance, status in enumerate(fixes):
        fix(log, 80_100_000, status, 0.0, instance, used=int(instance == used))
    contents = read_dataflash(log.write(tmp_path / "a.BIN"), OPTIONS)
    source = (Source.GPS_POSITION, Source.RTK_POSITION)[fixes[taken] == 6]
    assert len(by_source(contents)[source]) == 1
    assert contents.refused["GPS", "of another instance than the one taken"] == 1
    assert ("GPS: receiver 2 is taken" in contents.notes) == bool(taken)
    assert f"at [{(0.5, 0.25)[taken]}, 0, 0]" in " ".join(contents.notes)


def test_a_log_as_text_gives_the_same(tmp_path):
    """As a ground station writes it: each record's values, scaled, behind its name."""
    from pymavlink.DFReader import DFReader_binary  # noqa: PLC0415  an extra

    log = small_log()
    fix(log, 80_100_000, 6, 123.0)
    path = log.write(tmp_path / "a.BIN")
    reader, lines = DFReader_binary(str(path)), []
    while message := reader.recv_msg():
        values = (getattr(message, name) for name in message.get_fieldnames())
        lines.append(", ".join([message.get_type(), *map(str, values)]))
    text = tmp_path / "a.log"
    text.write_text("\n".join(lines) + "\n")
    assert is_dataflash(text.read_bytes()[:64])
    expected, result = (by_source(read_dataflash(one, OPTIONS)) for one in (path, text))
    assert result.keys() == expected.keys()
    for source, samples in expected.items():
        assert list(map(repr, result[source])) == list(map(repr, samples))


def test_heights_need_the_geoid_and_velocities_their_vertical_part(tmp_path):
    log = small_log()
    fix(log, 80_100_000, 3, 0.0, vertical=0)
    path = log.write(tmp_path / "a.BIN")
    result = by_source(read_dataflash(path, OPTIONS))
    assert len(result[Source.GPS_POSITION]) == 1
    assert Source.GPS_VELOCITY not in result
    with pytest.raises(TirgeoError, match=r"above mean sea level: .*--geoid-undulation$"):
        read_dataflash(path, LogOptions())


def test_the_attitude_is_roll_pitch_and_yaw(tmp_path):
    result = by_source(read_dataflash(small_log().write(tmp_path / "a.BIN"), OPTIONS))
    for k in (0, 20, 33):
        w, x, y, z = result[Source.IMU][k].autopilot_q_nb
        nose_n = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
        assert math.degrees(math.atan2(nose_n[1], nose_n[0])) == pytest.approx(k, abs=0.01)
        assert math.degrees(math.asin(-nose_n[2])) == pytest.approx(-10.0, abs=0.01)
        right_down, down_down = 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
        assert math.degrees(math.atan2(right_down, down_down)) == pytest.approx(5.0, abs=0.01)


def test_a_log_without_imu_is_refused(tmp_path):
    log = DataflashFile()
    log.message("PARM", "QNf", "TimeUS,Name,Value")
    log.add("PARM", 0, "GPS_POS1_X", 0.5)
    with pytest.raises(TirgeoError, match=r"no IMU in this log: .*LOG_BITMASK"):
        read_dataflash(log.write(tmp_path / "a.BIN"), OPTIONS)


def test_a_log_of_2014_is_named(tmp_path):
    log = DataflashFile()
    log.message("IMU", "Iffffff", "TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")
    log.add("IMU", 80_000, 0.01, -0.02, 0.03, 0.1, 0.2, -9.8)
    with pytest.raises(TirgeoError, match=r"a\.BIN: .*TimeMS, of ArduPilot .* not supported"):
        read_dataflash(log.write(tmp_path / "a.BIN"), OPTIONS)


def test_a_damaged_log_is_known_and_one_that_ends_within_a_record(tmp_path):
    """What fills the last block, 0xff, is no damage."""
    path = small_log().write(tmp_path / "a.BIN")
    whole, cut = path.read_bytes(), {("record", "cut off at the end of the log"): 1}
    middle = len(whole) // 2
    for data, damaged, is_cut in (
        (whole, False, False),
        (whole + b"\xff" * 249, False, False),
        (whole[:middle] + bytes(60) + whole[middle + 60 :], True, False),
        (whole[:-20], False, True),
    ):
        path.write_bytes(data)
        contents = read_dataflash(path, OPTIONS)
        assert contents.damaged is damaged
        assert (cut.items() <= contents.refused.items()) is is_cut


def test_damaged_logs_give_a_line_or_what_can_be_read(tmp_path, capfd):
    log = small_log()
    fix(log, 80_100_000, 6, 123.0)
    whole = log.write(tmp_path / "a.BIN").read_bytes()
    path = tmp_path / "b.BIN"
    result = read_damaged(lambda one: read_dataflash(one, OPTIONS).samples, whole, path, 80)
    assert 15 < result < 80
    assert capfd.readouterr() == ("", "")


def test_a_damaged_byte_costs_its_record_or_two(tmp_path):
    """Each byte of a record among others, by another value: the rest of the flight is there."""
    log = small_log()
    fix(log, 80_100_000, 6, 123.0)
    whole, path = log.write(tmp_path / "a.BIN").read_bytes(), tmp_path / "b.BIN"
    begun = whole.index(b"\xa3\x95\x01", 2000)  # an IMU's: head, number, fields
    count = len(read_dataflash(tmp_path / "a.BIN", OPTIONS).samples)
    for at in range(begun, begun + 36):
        for value in (0x06, 0xFF):
            path.write_bytes(whole[:at] + bytes([value]) + whole[at + 1 :])
            contents = read_dataflash(path, OPTIONS)
            assert len(contents.samples) >= count - 2
            reports = contents.damaged
            assert reports == (at < begun + 3)
