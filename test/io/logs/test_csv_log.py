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
"""Tables: real ones against pandas, odd layouts, and every quantity and fault of columns files."""

from __future__ import annotations

import math
from dataclasses import replace
from datetime import date, datetime, timezone

import numpy as np
import pandas as pd
import pytest
from foreign_logs import IMU, IMU_COLUMNS, OPTIONS, PRESSURE, by_topic, read_table
from project import PROJECT

from tirgeo_ros.core.frames.rotations import euler_from_quat
from tirgeo_ros.core.streams.sanity_checks import fault_of
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source
from tirgeo_ros.io.logs.csv_log import read_csv
from tirgeo_ros.io.logs.forms import CSV, form_of
from tirgeo_ros.io.logs.log_contents import LogOptions

COLUMNS = PROJECT / "config" / "columns"
FLU = np.array([1, -1, -1])


def forces(samples):
    return np.array([s.specific_force_b for s in samples])


def rates(samples):
    return np.array([s.angular_rate_b for s in samples])


def stamps(samples):
    return np.array([s.stamp_ns for s in samples])


def read_real(shared, name, columns, options=OPTIONS):
    path = shared / "foreign_logs" / name
    return path, read_csv(path, replace(options, columns=COLUMNS / f"{columns}.yaml"))


def test_seconds_of_gps_time_and_accelerations_in_g(shared):
    """To the decimals that the file has: 0.1 us in time."""
    path, contents = read_real(shared, "rtklib/walk_0827_imu_gpst_60s.csv", "imu_gpst")
    table = pd.read_csv(path, header=None)
    imu = by_topic(contents)["imu/data"]
    np.testing.assert_allclose(forces(imu), table[[1, 2, 3]] * 9.80665 * FLU, rtol=1e-12)
    np.testing.assert_allclose(rates(imu), table[[4, 5, 6]] * FLU, rtol=1e-12)
    text = pd.read_csv(path, header=None, dtype=str)[0]
    exact = [int(t.replace(".", "")) * 100 - 18 * 10**9 for t in text]
    assert stamps(imu).tolist() == exact


def test_broken_lines_repeats_and_a_clock_without_a_date(shared):
    path, contents = read_real(shared, "rtklib/walk_0827_imu_raw_120s.csv", "imu_since_start")
    rows = [line.split(",") for line in path.read_text().splitlines()]
    table = np.array([row for row in rows if len(row) == 7 and row[6]], float)
    imu = by_topic(contents)["imu/data"]
    np.testing.assert_allclose(forces(imu), table[:, :3] * 9.80665 * FLU, rtol=1e-12)
    np.testing.assert_allclose(rates(imu), np.radians(table[:, 3:6]) * FLU, rtol=1e-12)
    since = (table[:, 6] - table[0, 6]).astype(int) * 10**6
    assert (stamps(imu) - OPTIONS.start_ns).tolist() == since.tolist()
    assert contents.refused == {("row", "it has fewer columns than the others"): 2}


def test_vectornav_receiver_whose_heading_is_not_of_its_antennas(shared):
    path, contents = read_real(shared, "ins/vn310_gnss_16s.csv", "vectornav_gnss")
    table, result = pd.read_csv(path), by_topic(contents)
    assert {topic: len(s) for topic, s in result.items()} == {"rtk/fix": 80, "rtk/vel": 80}
    assert contents.refused == {("rtk_heading", "no row fits rtk_heading.where"): 80}
    places = np.degrees([(p.latitude_rad, p.longitude_rad) for p in result["rtk/fix"]])
    columns = ["GNSS1::PosLla::latitude [deg]", "GNSS1::PosLla::longitude [deg]"]
    np.testing.assert_allclose(places, table[columns], rtol=1e-15)
    np.testing.assert_array_equal(
        [p.height_m for p in result["rtk/fix"]], table["GNSS1::PosLla::altitude [m]"]
    )
    sigmas = np.sqrt([p.covariance_n.diagonal() for p in result["rtk/fix"]])
    np.testing.assert_allclose(sigmas, table[[f"GNSS1::PosU::{axis} [m]" for axis in "NED"]])
    assert {p.status for p in result["rtk/fix"]} == {FixStatus.FLOAT}  # with SBAS
    columns = [f"GNSS1::VelNed::{axis} [m/s]" for axis in "NED"]
    np.testing.assert_array_equal([v.velocity_n for v in result["rtk/vel"]], table[columns])


def test_a_week_that_counts_to_1023_is_refused(shared, tmp_path):
    imu = by_topic(read_real(shared, "ins/vn310_imu_16s.csv", "vectornav_imu")[1])["imu/data"]
    assert [datetime.fromtimestamp(s // 10**9, timezone.utc).date() for s in stamps(imu)[:1]] == [
        date(2024, 2, 29)
    ]
    text = (COLUMNS / "vectornav_imu.yaml").read_text().replace("Time::GpsWeek", "GpsWeek")
    (tmp_path / "columns.yaml").write_text(text)
    path = shared / "foreign_logs" / "ins" / "vn310_imu_16s.csv"
    contents = read_csv(path, replace(OPTIONS, columns=tmp_path / "columns.yaml"))
    assert contents.refused == {
        ("imu", "time.week is below 1024: name the column of full weeks"): 800
    }


@pytest.mark.parametrize("name", ["airdata_2023-12-22_with_DJI_0031", "airdata_2024-01-04_120s"])
def test_airdata_in_feet_and_miles_per_hour(shared, name):
    path, contents = read_real(shared, f"dji/{name}.csv", "airdata")
    table, result = pd.read_csv(path, skipinitialspace=True), by_topic(contents)
    assert not contents.refused
    fixes, speeds = result["gps/fix"], result["gps/vel"]
    places = np.degrees([(p.latitude_rad, p.longitude_rad) for p in fixes])
    np.testing.assert_allclose(places, table[["latitude", "longitude"]], rtol=1e-15)
    heights = table["height_above_takeoff(feet)"] * 0.3048 + OPTIONS.takeoff_height_m
    np.testing.assert_allclose([p.height_m for p in fixes], heights, rtol=1e-12)
    columns = ["xSpeed(mph)", "ySpeed(mph)", "zSpeed(mph)"]
    flown = table[columns] * 0.44704
    np.testing.assert_allclose([v.velocity_n for v in speeds], flown, rtol=1e-12)
    # The velocity is the change of the position, north and east, where it moves.
    north = np.diff([p.latitude_rad for p in fixes]) * 6.37e6 / 0.1
    assert np.corrcoef(north, flown["xSpeed(mph)"][1:])[0, 1] > 0.9
    # Steps are those of the log's clock; every written second is the right one.
    since = table["time(millisecond)"] - table["time(millisecond)"][0]
    assert ((stamps(fixes) - fixes[0].stamp_ns) == since * 10**6).all()
    written = pd.to_datetime(table["datetime(utc)"], utc=True).astype("datetime64[ns, UTC]")
    off_s = (stamps(fixes) - written.astype("int64")) * 1e-9
    assert -0.5 < off_s.min() < off_s.max() < 1.5  # whole seconds, of a clock of its own
    angles = np.degrees([euler_from_quat(s.q_ng) for s in result["gimbal/attitude"]])
    expected = table["gimbal_pitch(degrees)"]
    np.testing.assert_allclose(angles[:, 1], expected, atol=1e-9)


def test_rows_of_several_kinds(shared):
    """PX4's replay file: the second column tells the kind, longitude stands before latitude."""
    path, contents = read_real(shared, "px4/ecl_replay_iris_gps_20s.csv", "px4_replay")
    rows = [line.split(",") for line in path.read_text().splitlines()]
    result = by_topic(contents)
    imu = np.array([row[2:8] for row in rows if row[1] == "imu"], float)
    gps = np.array([row[2:8] for row in rows if row[1] == "gps"], float)
    np.testing.assert_array_equal(forces(result["imu/data"]), imu[:, :3])
    np.testing.assert_array_equal(rates(result["imu/data"]), imu[:, 3:])
    places = np.degrees([(p.longitude_rad, p.latitude_rad) for p in result["gps/fix"]])
    np.testing.assert_allclose(places, gps[:, 1:3] * 1e-7, rtol=1e-14)
    assert places.mean(axis=0) == pytest.approx([8.546, 47.398], abs=1e-3)  # Zurich
    heights = gps[:, 0] * 1e-3 + OPTIONS.geoid_undulation_m
    np.testing.assert_allclose([p.height_m for p in result["gps/fix"]], heights)
    np.testing.assert_array_equal([v.velocity_n for v in result["gps/vel"]], gps[:, 3:])
    assert not contents.refused


#: 07:44:39.125 UTC.
STAMP_NS = 1_718_091_879_125_000_000


@pytest.mark.parametrize("day", ["2024-06-11", "2024/6/11", "2024-06-11 00:00:00"])
def test_a_date_beside_a_time_of_day(tmp_path, day):
    columns = "time: {counts: written_utc, date: d, column: t}\npressure: {column: p, unit: Pa}\n"
    (sample,) = read_table(tmp_path, f"d,t,p\n{day},07:44:39.125,1e5\n", columns).samples
    assert sample.stamp_ns == STAMP_NS


@pytest.mark.parametrize("cell", ["1e999999", "-1e99999", "inf", "nan", "1718091879,125"])
def test_what_is_no_time_costs_its_row(tmp_path, cell):
    contents = read_table(tmp_path, f't,p\n"{cell}",1e5\n1,1e5\n', PRESSURE)
    assert len(contents.samples) == 1
    ((_, reason),) = contents.refused
    assert reason.startswith("time.column is not a number")
    assert ("decimal comma" in reason) == ("," in cell)


@pytest.mark.parametrize(
    ("encoding", "separator"),
    [("utf-8", ";"), ("utf-16", "\t"), ("utf-16-le", ";"), ("cp1252", ";")],
)
def test_a_table_of_a_german_excel(tmp_path, encoding, separator):
    """It writes a decimal comma, and degrees and squares in Windows-1252 or UTF-16."""
    rows = ["Zeit", "Höhe²", "Druck [°]"], ["1718091879,125", "9,5", "1013,25"]
    text = "\ufeff" * (encoding == "utf-16-le") + "\n".join(map(separator.join, rows))
    (tmp_path / "log.csv").write_bytes(text.encode(encoding))
    (tmp_path / "columns.yaml").write_text(
        f"table: {{separator: {'tab' if separator != ';' else 'semicolon'}, decimal: comma}}\n"
        "time: {counts: utc, column: Zeit, unit: s}\n"
        "pressure: {column: 'Druck [°]', unit: hPa}\n",
        encoding="utf-8",
    )
    path = tmp_path / "log.csv"
    assert form_of(path, columns=True) is CSV
    (sample,) = read_csv(path, LogOptions(columns=tmp_path / "columns.yaml")).samples
    assert (sample.stamp_ns, sample.pressure_pa) == (STAMP_NS, pytest.approx(101325))


def test_a_half_line_does_not_tell_the_begin(tmp_path):
    """A recording that began in the middle of a line has another number in the first column."""
    columns = "time: {counts: start, column: 1, unit: s}\npressure: {column: 3, unit: Pa}\n"
    contents = read_table(
        tmp_path, "1013,2\n5123.5,7,2\n5124.5,7,2\n", "table: {header: false}\n" + columns
    )
    begun_ns = OPTIONS.start_ns
    assert [sample.stamp_ns for sample in contents.samples] == [begun_ns, begun_ns + 10**9]


def test_zero_bytes_cost_their_row(tmp_path):
    """A memory card has them where the power went."""
    rows = "".join(f"{k},1e5\n" for k in range(1, 200))
    contents = read_table(tmp_path, f"t,p\n{rows}".replace("\n7,1e5", "\n7,1\0e5"), PRESSURE)
    assert form_of(tmp_path / "log.csv", columns=True) is CSV
    assert len(contents.samples) == 198
    assert contents.refused == {("pressure", "pressure.column is not a number"): 1}


HELD = "1,0,0,1,0,0,0\n" * 3 + "2,0,0,1,0,0,0\n"


@pytest.mark.parametrize(
    ("table", "columns", "count", "refused"),
    [
        ("t,p\n1,2\n2, \n", PRESSURE, 1, ("pressure", "pressure.column is empty")),
        (IMU, IMU_COLUMNS, 19, ("imu", "imu.gyro.columns.3 is not a number")),
        (HELD, IMU_COLUMNS, 2, ("imu", "it has the time of the row before")),
    ],
)
def test_what_costs_its_row(tmp_path, table, columns, count, refused):
    contents = read_table(tmp_path, table, columns)
    assert len(contents.samples) == count
    assert contents.refused == {refused: 2 if table is HELD else 1}


def test_a_quote_that_is_not_closed_costs_its_row(tmp_path):
    columns = 'time: {counts: utc, column: t, unit: s}\npressure: {column: "p\\n(Pa)", unit: Pa}\n'
    table = 't,"p\n(Pa)",note\n1,1e5,"a, b"\n2,"1e5,\n3,1e5,5" lens\n4,1e5,\n'
    contents = read_table(tmp_path, table, columns)
    assert [sample.stamp_ns // 10**9 for sample in contents.samples] == [1, 3, 4]
    assert contents.refused.total() == 1


ALL_TITLES = (
    "time,ax,ay,az,gx,gy,gz,roll,pitch,yaw,lat,lon,height,fix,sn,se,su,valid,vn,ve,vu,heading,"
    "sheading,baro,joint_yaw,joint_roll,joint_pitch,cam_roll,cam_pitch,cam_yaw"
)
ALL_VALUES = (
    "1718091879.125,0.1,0.2,9.7,0.01,0.02,0.03,1,2,3,48,11,500,4,0.1,0.2,0.3,1,1,2,3,90,"
    "0.5,1013.25,3,4,5,6,7,8"
)


def test_the_template_takes_every_quantity(tmp_path):
    table = f"# a comment\n{ALL_TITLES}\n{ALL_VALUES}\n"
    result = by_topic(read_table(tmp_path, table, (COLUMNS / "template.yaml").read_text()))
    assert all(len(samples) == 1 for samples in result.values())
    assert set(result) == {
        *("imu/data", "rtk/fix", "rtk/vel", "rtk/heading", "baro/pressure"),
        *("gimbal/joint_states", "gimbal/attitude"),
    }
    first = {topic: samples[0] for topic, samples in result.items()}
    assert {sample.stamp_ns for sample in first.values()} == {STAMP_NS}
    imu, fix = first["imu/data"], first["rtk/fix"]
    np.testing.assert_allclose(imu.specific_force_b, [0.1, -0.2, -9.7])
    np.testing.assert_allclose(imu.angular_rate_b, [0.01, -0.02, -0.03])
    assert np.degrees(euler_from_quat(imu.autopilot_q_nb)) == pytest.approx([1, 2, 3])
    assert (math.degrees(fix.latitude_rad), fix.height_m) == pytest.approx((48.0, 500.0))
    assert (fix.status, fix.source) == (FixStatus.FIXED, Source.RTK_POSITION)
    np.testing.assert_allclose(fix.covariance_n, np.diag([0.01, 0.04, 0.09]))
    np.testing.assert_allclose(first["rtk/vel"].velocity_n, [1, 2, -3])
    np.testing.assert_allclose(first["rtk/vel"].covariance_n, np.eye(3) * 0.05**2)
    assert math.degrees(first["rtk/heading"].heading_rad) == pytest.approx(90)
    assert first["rtk/heading"].variance_rad2 == pytest.approx(math.radians(0.5) ** 2)
    assert first["baro/pressure"].pressure_pa == pytest.approx(101325)
    joints = first["gimbal/joint_states"]
    angles = np.degrees([joints.yaw_rad, joints.roll_rad, joints.pitch_rad])
    assert angles == pytest.approx([-3, 4, -5])
    camera = np.degrees(euler_from_quat(first["gimbal/attitude"].q_ng))
    assert camera == pytest.approx([6, 7, 8])


@pytest.mark.parametrize(
    ("attitude", "rpy_deg"),
    [
        ("{roll: 1, pitch: 2, yaw: 3, unit: deg, frame: ned}", (10, 20, 30)),
        # FLU in ENU: pitch and yaw have the other sign, and yaw counts from the east
        ("{roll: 1, pitch: 2, yaw: 3, unit: deg, frame: enu}", (10, -20, 60)),
        ("{wxyz: [4, 5, 6, 7], frame: ned}", (0, 0, 90)),
        ("{wxyz: [4, 5, 6, 7], frame: enu}", (0, 0, 0)),
    ],
)
def test_attitudes_in_both_worlds(tmp_path, attitude, rpy_deg):
    columns = (
        "table: {header: false, separator: space}\ntime: {counts: utc, column: 8, unit: s}\n"
        f"gimbal_attitude: {{attitude: {attitude}}}\n"
    )
    half = math.sqrt(0.5)
    (sample,) = read_table(tmp_path, f"10  20 30 {half} 0 0 {half} 5\n", columns).samples
    assert np.degrees(euler_from_quat(sample.q_ng)) == pytest.approx(rpy_deg, abs=1e-9)


def test_axes_by_the_directions_in_which_they_point(tmp_path):
    """An IMU on its side: x forward, y up."""
    columns = IMU_COLUMNS.replace("axes: flu", "axes: [front, up, right]")
    imu = read_table(tmp_path, "5,1,9.8,2,3,4,5\n", columns).samples[0]
    np.testing.assert_allclose(imu.specific_force_b / 9.80665, [1, 2, -9.8])
    np.testing.assert_allclose(np.degrees(imu.angular_rate_b), [3, 5, -4])


def test_headings_of_a_baseline_need_its_direction(tmp_path):
    columns = (
        "time: {counts: utc, column: t, unit: s}\nrtk_heading:\n"
        "  {column: a, unit: deg, of: baseline, sigma: {value: 1, unit: deg}}\n"
    )
    options = replace(OPTIONS, baseline_rad=math.radians(90))
    (sample,) = read_table(tmp_path, "t,a\n1,10\n", columns, options).samples
    assert math.degrees(sample.heading_rad) == pytest.approx(280)
    with pytest.raises(LogError, match="headings of a baseline: set aircraft"):
        read_table(tmp_path, "t,a\n1,10\n", columns, LogOptions())


@pytest.mark.parametrize(
    ("time", "cell", "expected_ns"),
    [
        ("{counts: utc, column: t, unit: us}", "1718091879125000", STAMP_NS),
        ("{counts: gps, column: t, unit: s}", "1402127097.125", STAMP_NS),
        ("{counts: written_utc, column: t}", "2024-06-11 07:44:39.125", STAMP_NS),
        ("{counts: written_gpst, column: t}", "2024-06-11 07:44:57.125", STAMP_NS),
        ("{counts: written_local, column: t}", "2024-06-11 09:44:39", STAMP_NS - 125_000_000),
        ("{counts: written_utc, column: t}", "2024-06-11T10:44:39.125+03:00", STAMP_NS),
        ("{counts: start, column: t, unit: ms}", "77", OPTIONS.start_ns),
        ("{counts: gps, column: t, unit: 0.1ms}", "14021270971250", STAMP_NS),
    ],
)
def test_times(tmp_path, time, cell, expected_ns):
    columns = f"time: {time}\npressure: {{column: p, unit: Pa}}\n"
    (sample,) = read_table(tmp_path, f"t,p\n{cell},1e5\n", columns).samples
    assert sample.stamp_ns == expected_ns


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("accel:", "acel:"), r"imu\.accel is missing"),
        ((", unit: g", ""), r"imu\.accel\.unit is missing: one of m/s2, g"),
        (("unit: g", "unit: deg"), r"imu\.accel\.unit: 'deg' is not one of m/s2, g"),
        (("[2, 3, 4]", "[2, 3]"), r"imu\.accel\.columns: must be a list of 3 columns"),
        (("[2, 3, 4]", "[2, 3, 0]"), r"imu\.accel\.columns\.3: 0 is not a column's name"),
        (("[2, 3, 4]", "[2, 3, y]"), r"imu\.accel\.columns\.3: True is not .* in quotes"),
        (("axes: flu", "axes: [front, left, down]"), r"imu\.axes: .* not right-handed"),
        (("header: false", "header: false, skip: -1"), r"table\.skip: -1 is not a number"),
        (("time:", "tim:"), r"time is missing: give time for all, or imu\.time"),
        (("header: false", "header: true"), "time.column: 1: a number is for tables without a"),
        (("[2, 3, 4]", "[2, 3, az]"), r"imu\.accel\.columns\.3: 'az': .* a name for those with"),
        ((IMU_COLUMNS, "[]"), "must be keys with values"),
        ((IMU_COLUMNS, "time: {counts: utc, column: t, unit: s}"), "none of imu, rtk_position"),
    ],
)
def test_a_wrong_columns_file_names_file_and_key(tmp_path, change, message):
    with pytest.raises(LogError, match=rf"columns\.yaml: .*{message}"):
        read_table(tmp_path, IMU, IMU_COLUMNS.replace(*change))


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("t,q\n1,2\n", r"log\.csv: no column 'p' \(.*columns\.yaml: pressure\.column\); it has t"),
        ("t,p,p\n1,2,2\n", r"log\.csv: 2 columns 'p' "),
        ("", r"no column 't'"),
        ('t,p\n1,"' + "x" * 200_000 + '"\n', r"log\.csv: not a table: field larger"),
    ],
)
def test_a_wrong_table_names_the_file(tmp_path, table, message):
    with pytest.raises(LogError, match=message):
        read_table(tmp_path, table, PRESSURE)


@pytest.mark.parametrize("value", ["-1", "0", ".nan", ".inf"])
def test_a_sigma_is_above_zero(tmp_path, value):
    columns = (
        "time: {counts: utc, column: t, unit: s}\n"
        f"pressure: {{column: p, unit: Pa, sigma: {{value: {value}, unit: Pa}}}}\n"
    )
    with pytest.raises(LogError, match=r"pressure\.sigma\.value: .* not above zero"):
        read_table(tmp_path, "t,p\n1,2\n", columns)


@pytest.mark.parametrize(("longitude", "expected_deg"), [(350.25, -9.75), (-9.75, -9.75)])
def test_longitudes_to_360_deg(tmp_path, longitude, expected_deg):
    columns = """
time: {counts: utc, column: t, unit: s}
gps_position:
  {latitude: a, longitude: b, unit: deg, height: {column: c, unit: m, above: ellipsoid},
   status: {always: single}}
"""
    table = f"t,a,b,c\n1,48,{longitude},500\n2,48,361,500\n"
    sample, impossible = read_table(tmp_path, table, columns).samples
    assert fault_of(impossible) == "latitude or longitude is out of range"
    assert math.degrees(sample.longitude_rad) == pytest.approx(expected_deg)


def test_fixes_with_another_status_are_refused(tmp_path):
    columns = """
time: {counts: utc, column: t, unit: s}
gps_position:
  latitude: lat
  longitude: lon
  unit: rad
  height: {column: h, unit: km, above: sea}
  status: {column: s, float: [DGPS, 5], single: 1}
"""
    rows = "t,lat,lon,h,s\n1,1,2,0.3,DGPS\n2,1,2,0.3,1.000\n3,1,2,0.3,0\n4,1,2,0.3,\n"
    contents = read_table(tmp_path, rows, columns)
    assert [s.status for s in contents.samples] == [FixStatus.FLOAT, FixStatus.SINGLE]
    assert contents.refused == {("gps_position", "status is not one of the values for a fix"): 2}
    assert isinstance(contents.samples[0], PositionSample)
    assert contents.samples[0].height_m == pytest.approx(300 - 21.387)
    with pytest.raises(LogError, match=r"status\.fixd: unknown key \(did you mean fixed"):
        read_table(tmp_path, rows, columns.replace("float:", "fixd:"))
