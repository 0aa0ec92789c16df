"""Real tables, with the columns files of config/columns, against pandas' reading of them."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timezone

import numpy as np
import pandas as pd
import pytest
from foreign_logs import OPTIONS, by_topic
from project import PROJECT

from tirgeo_ros.core.frames.rotations import euler_from_quat
from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.io.logs.csv_log import read_csv

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
    repeats = (np.diff(table[:, :6], axis=0) == 0).all(axis=1).sum()
    assert contents.notes[0].startswith(f"{repeats} of {len(table)} IMU rows repeat")


def test_vectornav_imu(shared):
    path, contents = read_real(shared, "ins/vn310_imu_16s.csv", "vectornav_imu")
    table = pd.read_csv(path)
    imu = by_topic(contents)["imu/data"]
    columns = [f"IMU::Accel::{axis} [m/s^2]" for axis in "XYZ"]
    np.testing.assert_array_equal(forces(imu), table[columns])
    columns = ["IMU::AngularRate::X", "IMU::AngularRate::Y [rad/s]", "IMU::AngularRate::Z [rad/s]"]
    np.testing.assert_array_equal(rates(imu), table[columns])
    week = datetime(1980, 1, 6, tzinfo=timezone.utc).timestamp() + 2303 * 7 * 86400
    exact = [(round(week) - 18) * 10**9 + tow for tow in table["Time::GpsTow [ns]"]]
    assert stamps(imu).tolist() == exact


def test_vectornav_receiver_whose_heading_is_not_of_its_antennas(shared):
    path, contents = read_real(shared, "ins/vn310_gnss_16s.csv", "vectornav_gnss")
    table, found = pd.read_csv(path), by_topic(contents)
    assert {topic: len(s) for topic, s in found.items()} == {"rtk/fix": 80, "rtk/vel": 80}
    assert contents.refused == {("rtk_heading", "no row fits rtk_heading.where"): 80}
    places = np.degrees([(p.latitude_rad, p.longitude_rad) for p in found["rtk/fix"]])
    columns = ["GNSS1::PosLla::latitude [deg]", "GNSS1::PosLla::longitude [deg]"]
    np.testing.assert_allclose(places, table[columns], rtol=1e-15)
    np.testing.assert_array_equal(
        [p.height_m for p in found["rtk/fix"]], table["GNSS1::PosLla::altitude [m]"]
    )
    sigmas = np.sqrt([p.covariance_n.diagonal() for p in found["rtk/fix"]])
    np.testing.assert_allclose(sigmas, table[[f"GNSS1::PosU::{axis} [m]" for axis in "NED"]])
    assert {p.status for p in found["rtk/fix"]} == {FixStatus.FLOAT}  # with SBAS
    columns = [f"GNSS1::VelNed::{axis} [m/s]" for axis in "NED"]
    np.testing.assert_array_equal([v.velocity_n for v in found["rtk/vel"]], table[columns])


def test_a_week_that_counts_to_1023_is_refused(shared, tmp_path):
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
    table, found = pd.read_csv(path, skipinitialspace=True), by_topic(contents)
    assert not contents.refused
    fixes, speeds = found["gps/fix"], found["gps/vel"]
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
    angles = np.degrees([euler_from_quat(s.q_ng) for s in found["gimbal/attitude"]])
    expected = table["gimbal_pitch(degrees)"]
    np.testing.assert_allclose(angles[:, 1], expected, atol=1e-9)


def test_rows_of_several_kinds(shared):
    """PX4's replay file: the second column tells the kind, longitude stands before latitude."""
    path, contents = read_real(shared, "px4/ecl_replay_iris_gps_20s.csv", "px4_replay")
    rows = [line.split(",") for line in path.read_text().splitlines()]
    found = by_topic(contents)
    imu = np.array([row[2:8] for row in rows if row[1] == "imu"], float)
    gps = np.array([row[2:8] for row in rows if row[1] == "gps"], float)
    np.testing.assert_array_equal(forces(found["imu/data"]), imu[:, :3])
    np.testing.assert_array_equal(rates(found["imu/data"]), imu[:, 3:])
    places = np.degrees([(p.longitude_rad, p.latitude_rad) for p in found["gps/fix"]])
    np.testing.assert_allclose(places, gps[:, 1:3] * 1e-7, rtol=1e-14)
    assert places.mean(axis=0) == pytest.approx([8.546, 47.398], abs=1e-3)  # Zurich
    heights = gps[:, 0] * 1e-3 + OPTIONS.geoid_undulation_m
    np.testing.assert_allclose([p.height_m for p in found["gps/fix"]], heights)
    np.testing.assert_array_equal([v.velocity_n for v in found["gps/vel"]], gps[:, 3:])
    assert not contents.refused
