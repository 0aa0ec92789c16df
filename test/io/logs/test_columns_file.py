"""Columns files: every quantity, times, axes and attitudes; and wrong files."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from foreign_logs import IMU, IMU_COLUMNS, OPTIONS, PRESSURE, by_topic, read_table

from tirgeo_ros.core.frames.rotations import euler_from_quat
from tirgeo_ros.core.streams.sanity_checks import fault_of
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source
from tirgeo_ros.io.logs.csv_log import EXAMPLE
from tirgeo_ros.io.logs.log_contents import LogOptions

#: 07:44:39.125 UTC.
STAMP_NS = 1_718_091_879_125_000_000


ALL_TITLES = (
    "time,ax,ay,az,gx,gy,gz,roll,pitch,yaw,lat,lon,height,fix,sn,se,su,valid,vn,ve,vu,heading,"
    "sheading,baro,joint_yaw,joint_roll,joint_pitch,cam_roll,cam_pitch,cam_yaw"
)
ALL_VALUES = (
    "1718091879.125,0.1,0.2,9.7,0.01,0.02,0.03,1,2,3,48,11,500,4,0.1,0.2,0.3,1,1,2,3,90,"
    "0.5,1013.25,3,4,5,6,7,8"
)


def test_the_template_takes_every_quantity(tmp_path):
    found = by_topic(read_table(tmp_path, f"# a comment\n{ALL_TITLES}\n{ALL_VALUES}\n", EXAMPLE))
    assert all(len(samples) == 1 for samples in found.values())
    assert set(found) == {
        *("imu/data", "rtk/fix", "rtk/vel", "rtk/heading", "baro/pressure"),
        *("gimbal/joint_states", "gimbal/attitude"),
    }
    first = {topic: samples[0] for topic, samples in found.items()}
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


def test_a_value_that_is_no_number_costs_its_row(tmp_path):
    contents = read_table(tmp_path, IMU, IMU_COLUMNS)
    assert len(contents.samples) == 19
    assert contents.refused == {("imu", "imu.gyro.columns.3 is not a number"): 1}


def test_a_fix_that_is_held_in_many_rows_is_one(tmp_path):
    contents = read_table(tmp_path, "1,0,0,1,0,0,0\n" * 3 + "2,0,0,1,0,0,0\n", IMU_COLUMNS)
    assert len(contents.samples) == 2
    assert contents.refused == {("imu", "it has the time of the row before"): 2}


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
        (
            "{counts: written_gpst, column: t}",
            "2024-06-11 07:44:57.125",
            1_718_091_879_125_000_000,
        ),
        ("{counts: written_local, column: t}", "2024-06-11 09:44:39", STAMP_NS - 125_000_000),
        (
            "{counts: written_utc, column: t}",
            "2024-06-11T10:44:39+03:00",
            1_718_091_879_000_000_000,
        ),
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
        (("axes: flu", "axes: flu\n  ratio: 1"), r"imu\.ratio: unknown key \(known: "),
        (("axes: flu", "axes: flu\n  attitud: 1"), r"imu\.attitud: unknown key .*mean attitude"),
        (("imu:", "imuu:"), r"imuu: unknown key \(did you mean imu"),
        ((", unit: g", ""), r"imu\.accel\.unit is missing: one of m/s2, g"),
        (("unit: g", "unit: deg"), r"imu\.accel\.unit: 'deg' is not one of m/s2, g"),
        (("[2, 3, 4]", "[2, 3]"), r"imu\.accel\.columns: must be a list of 3 columns"),
        (("[2, 3, 4]", "[2, 3, 0]"), r"imu\.accel\.columns\.3: 0 is not a column's name"),
        (("[2, 3, 4]", "[2, 3, y]"), r"imu\.accel\.columns\.3: True is not .* in quotes"),
        (("axes: flu", "axes: [front, left, down]"), r"imu\.axes: .* not right-handed"),
        (("axes: flu", "axes: north"), r"imu\.axes: 'north' are not"),
        (("counts: utc", "counts: boot"), r"time\.counts: 'boot' is not one of utc"),
        (
            ("header: false", "header: false, skip: -1"),
            r"table\.skip: -1 is not a number",
        ),
        (("time:", "tim:"), r"time is missing: for all, or imu\.time"),
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
  {latitude: a, longitude: b, unit: deg, height: {column: c, unit: m, above: ellipsoidal},
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
  height: {column: h, unit: km, above: msl}
  status: {column: s, float: [DGPS, 5], single: 1}
"""
    rows = "t,lat,lon,h,s\n1,1,2,0.3,DGPS\n2,1,2,0.3,1.000\n3,1,2,0.3,0\n4,1,2,0.3,\n"
    contents = read_table(tmp_path, rows, columns)
    assert [s.status for s in contents.samples] == [FixStatus.FLOAT, FixStatus.SINGLE]
    assert contents.refused == {("gps_position", "status is none of those that are a fix"): 2}
    assert isinstance(contents.samples[0], PositionSample)
    assert contents.samples[0].height_m == pytest.approx(300 - 21.387)
    with pytest.raises(LogError, match=r"status\.fixd: unknown key \(did you mean fixed"):
        read_table(tmp_path, rows, columns.replace("float:", "fixd:"))
