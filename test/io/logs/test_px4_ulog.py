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
"""PX4's logs: every field as pyulog reads it, units and times by version, and damaged files."""

from __future__ import annotations

import math

import numpy as np
import pytest
from autopilot_logs import UlogFile
from damaged_files import read_damaged
from foreign_logs import by_source

from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.core.types.measurements import FixStatus, Source
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.logs.px4_ulog import read_px4_ulog

pytest.importorskip("pyulog")
NAMES = ("cubeorange_airframe", "fmu_v6c", "sitl_epoch_clock", "made_heading")
#: A double in degrees and back: 180 deg at 2^-53.
ANGLE_RAD = 1e-15
UTC_US = 1_700_000_000_000_000
OLD = (
    "uint64_t timestamp;uint64_t time_utc_usec;int32_t lat;int32_t lon;int32_t alt;"
    "int32_t alt_ellipsoid;float s_variance_m_s;float eph;float epv;float vel_n_m_s;"
    "float vel_e_m_s;float vel_d_m_s;float heading;float heading_offset;float heading_accuracy;"
    "uint8_t fix_type;bool vel_ned_valid"
)
NEW = (
    OLD.replace("int32_t lat;int32_t lon", "double latitude_deg;double longitude_deg")
    .replace("int32_t alt;", "double altitude_msl_m;")
    .replace("int32_t alt_ellipsoid", "double altitude_ellipsoid_m")
)
FIX = (0.2, 0.5, 0.8, 1.0, -2.0, 0.5, math.nan, math.nan, math.nan, 3, True)


def small_log(fixes=True):
    """A log of 0.5 s with the IMU and an attitude at 10 Hz, and a fix of the older fields."""
    log = UlogFile()
    log.topic(
        "sensor_combined", "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2"
    )
    log.topic("vehicle_attitude", "uint64_t timestamp;float[4] q")
    log.topic("vehicle_gps_position", OLD)
    for k in range(101):
        at_us = 20_000_000 + 5_000 * k
        log.add("sensor_combined", at_us, 0.01, -0.02, 0.03, 0.1, 0.2, -9.8)
        if k % 20 == 0:
            half = math.radians(0.5 * k)
            log.add("vehicle_attitude", at_us, math.cos(half), 0.0, 0.0, math.sin(half))
    if fixes:
        at_us = 20_300_000
        place = (520_116_000, 43_575_000, 1_000, 44_000)
        log.add("vehicle_gps_position", at_us, UTC_US + at_us, *place, *FIX)
    return log


@pytest.mark.parametrize("name", NAMES)
def test_every_field_is_the_source_readers(shared, name):
    """Against pyulog, for each record and field of the log."""
    from pyulog import ULog  # noqa: PLC0415  an extra

    path = shared / "foreign_logs" / "px4" / f"{name}.ulg"
    contents = read_px4_ulog(path, LogOptions())
    samples, log = by_source(contents), ULog(str(path))
    data = {d.name: d.data for d in log.data_list if d.multi_id == 0}
    gps = data["vehicle_gps_position"]
    utc, boot = gps["time_utc_usec"].astype(np.int64), gps["timestamp"].astype(np.int64)
    shift_us = int(np.median(utc - boot))

    def stamps(samples):
        return np.array([sample.stamp_ns for sample in samples]) // 1000 - shift_us

    imu = data["sensor_combined"]
    np.testing.assert_array_equal(stamps(samples[Source.IMU]), imu["timestamp"].astype(np.int64))
    for k in range(3):
        force = [sample.specific_force_b[k] for sample in samples[Source.IMU]]
        rate = [sample.angular_rate_b[k] for sample in samples[Source.IMU]]
        np.testing.assert_array_equal(force, imu[f"accelerometer_m_s2[{k}]"])
        np.testing.assert_array_equal(rate, imu[f"gyro_rad[{k}]"])
    check_fixes(samples, gps, stamps)
    check_attitudes(samples[Source.IMU], data["vehicle_attitude"], shift_us)
    pressures = [sample.pressure_pa for sample in samples[Source.BAROMETER]]
    np.testing.assert_array_equal(pressures, data["vehicle_air_data"]["baro_pressure_pa"])
    assert not any("damaged" in note for note in contents.notes)


def check_fixes(samples, gps, stamps):
    rtk = bool(np.isin(gps["fix_type"], (5, 6)).any())
    positions = samples[Source.RTK_POSITION if rtk else Source.GPS_POSITION]
    velocities = samples[Source.RTK_VELOCITY if rtk else Source.GPS_VELOCITY]
    good = gps["fix_type"] >= 3
    degrees = "latitude_deg" in gps
    latitude = gps["latitude_deg"] if degrees else gps["lat"] * 1e-7
    longitude = gps["longitude_deg"] if degrees else gps["lon"] * 1e-7
    height = gps["altitude_ellipsoid_m"] if degrees else gps["alt_ellipsoid"] * 1e-3
    np.testing.assert_array_equal(stamps(positions), gps["timestamp"].astype(np.int64)[good])
    place = np.array([(s.latitude_rad, s.longitude_rad, s.height_m) for s in positions])
    np.testing.assert_allclose(place[:, 0], np.radians(latitude)[good], atol=ANGLE_RAD)
    np.testing.assert_allclose(place[:, 1], np.radians(longitude)[good], atol=ANGLE_RAD)
    np.testing.assert_allclose(place[:, 2], height[good], rtol=1e-15)
    statuses = {3: FixStatus.SINGLE, 6: FixStatus.FIXED}
    assert [s.status for s in positions] == [statuses[int(kind)] for kind in gps["fix_type"][good]]
    sigmas = np.sqrt([s.covariance_n.diagonal() for s in positions])
    expected = np.stack([gps["eph"], gps["eph"], gps["epv"]], axis=-1)[good]
    np.testing.assert_allclose(sigmas, expected, rtol=1e-7)  # of single precision
    velocity = np.stack([gps[f"vel_{axis}_m_s"] for axis in "ned"], axis=-1)[good]
    np.testing.assert_array_equal([s.velocity_n for s in velocities], velocity)
    speeds = np.sqrt([s.covariance_n[1, 1] for s in velocities])
    np.testing.assert_allclose(speeds, gps["s_variance_m_s"][good], rtol=1e-7)
    headings = [math.remainder(s.heading_rad, math.tau) for s in samples[Source.RTK_HEADING]]
    logged = gps["heading"][~np.isnan(gps["heading"])]
    np.testing.assert_allclose(headings, logged, atol=1e-15)


def check_attitudes(samples, attitude, shift_us):
    """At the attitude's own times exactly; between them it is between its neighbours."""
    sampled = attitude.get("timestamp_sample", attitude["timestamp"]).astype(np.int64)
    rows = {int(t): row for row, t in enumerate(sampled)}
    q = np.stack([attitude[f"q[{k}]"] for k in range(4)], axis=-1).astype(float)
    met = 0
    for sample in samples:
        at_us = sample.stamp_ns // 1000 - shift_us
        if at_us in rows:
            met += 1
            np.testing.assert_array_equal(sample.autopilot_q_nb, q[rows[at_us]])
            continue
        after = int(np.searchsorted(sampled, at_us))
        if 0 < after < len(sampled) and sampled[after] - sampled[after - 1] < 250_000:
            here, ends = sample.autopilot_q_nb, q[after - 1 : after + 1]
            between = abs(ends[0] @ ends[1])
            # Three quaternions whose norms have single precision.
            assert np.abs(ends @ here).min() >= between - 3 * 2**-23
        else:
            assert sample.autopilot_q_nb is None
    assert met > 100


def test_the_newer_units_rtk_and_the_heading_of_the_nose(tmp_path):
    log = small_log(fixes=False)
    log.topic("vehicle_gps_position", NEW)
    place = (52.0116, 4.3575, 1.0, 44.0)
    two = [*FIX[:6], -0.5, math.radians(90), 0.01, 6, True]
    log.add("vehicle_gps_position", 20_100_000, UTC_US, *place, *two)
    two[-2:] = 5, False
    log.add("vehicle_gps_position", 20_300_000, UTC_US + 200_000, *place, *two)
    log.parameter("EKF2_GPS_POS_Y", 0.25)
    log.parameter("EKF2_GPS_DELAY", 110)
    contents = read_px4_ulog(log.write(tmp_path / "new.ulg"), LogOptions())
    samples = by_source(contents)
    statuses = [sample.status for sample in samples[Source.RTK_POSITION]]
    assert statuses == [FixStatus.FIXED, FixStatus.FLOAT]
    assert samples[Source.RTK_POSITION][0].height_m == 44.0
    assert len(samples[Source.RTK_VELOCITY]) == 1  # the other is marked as invalid
    heading = samples[Source.RTK_HEADING][0]
    assert heading.heading_rad == pytest.approx(math.tau - 0.5)
    assert heading.variance_rad2 == pytest.approx(1e-4)
    notes = " ".join(contents.notes)
    for words in (
        *("heading_offset, 90.0 deg", "[0, -0.25, 0] (forward, left, up)", "delay_s, to 0.11"),
        *("was RTK float or fixed", "spread over 0 ms"),
    ):
        assert words in notes


def test_the_first_receiver_with_a_fix_is_taken(tmp_path):
    log = small_log(fixes=False)
    log.topic("sensor_gps", NEW)
    place = (52.0116, 4.3575, 1.0, 44.0)
    for instance, kind in enumerate((0, 6, 3)):
        row = (20_300_000, UTC_US, *place, *FIX[:9], kind, True)
        log.add("sensor_gps", *row, instance=instance)
    contents = read_px4_ulog(log.write(tmp_path / "two.ulg"), LogOptions())
    (position,) = by_source(contents)[Source.RTK_POSITION]
    assert position.status is FixStatus.FIXED
    assert contents.read["sensor_gps"] == 3
    assert contents.refused == {("sensor_gps", "of another instance than the one taken"): 2}


def test_utc_is_that_of_records_with_a_fix(tmp_path):
    """Before it, a receiver's own clock may be hours away, for most of a log."""
    log = small_log()
    place = (0, 0, 0, 0)
    for k in range(3):
        wrong_us = UTC_US - 3 * 3600 * 10**6
        log.add("vehicle_gps_position", 20_000_000 + k, wrong_us, *place, *FIX[:9], 1, True)
    contents = read_px4_ulog(log.write(tmp_path / "utc.ulg"), LogOptions())
    samples = by_source(contents)
    (position,) = samples[Source.GPS_POSITION]
    assert len(samples[Source.GPS_VELOCITY]) == 1
    assert "was never RTK float or fixed" in " ".join(contents.notes)
    assert position.stamp_ns == (UTC_US + 20_300_000) * 1000


def test_velocities_count_where_the_log_does_not_judge_them(tmp_path):
    log = small_log(fixes=False)
    log.topic("vehicle_gps_position", OLD.removesuffix(";bool vel_ned_valid"))
    place = (520_116_000, 43_575_000, 1_000, 44_000)
    log.add("vehicle_gps_position", 20_300_000, UTC_US, *place, *FIX[:10])
    samples = by_source(read_px4_ulog(log.write(tmp_path / "old.ulg"), LogOptions()))
    assert [s.velocity_n.tolist() for s in samples[Source.GPS_VELOCITY]] == [[1.0, -2.0, 0.5]]


@pytest.mark.parametrize(("boot_us", "words"), [(20_000_000, "in 1970"), (UTC_US, "a date")])
def test_without_utc_the_autopilots_clock_is_taken(tmp_path, boot_us, words):
    log = UlogFile()
    log.topic("vehicle_imu", "uint64_t timestamp;float[3] delta_angle;float[3] delta_velocity;"
              "uint32_t delta_angle_dt;uint32_t delta_velocity_dt")  # fmt: skip
    log.add("vehicle_imu", boot_us, 0.01, 0.0, 0.0, 0.0, 0.0, -0.049, 5000, 5000)
    log.add("vehicle_imu", boot_us + 1, 0.0, 0.0, 0.0, 0.0, 0.0, -9.0, 5000, 0)
    log.add("vehicle_imu", boot_us, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0, 5000, 5000, instance=1)
    contents = read_px4_ulog(log.write(tmp_path / "imu.ulg"), LogOptions())
    sample = contents.samples[0]
    assert sample.stamp_ns == boot_us * 1000
    assert sample.specific_force_b[2] == pytest.approx(-9.8)
    assert sample.angular_rate_b[0] == pytest.approx(2.0)
    assert sample.autopilot_q_nb is None
    assert words in contents.notes[0]
    assert contents.read["vehicle_imu"] == 3
    assert contents.refused["vehicle_imu", "of another instance than the one taken"] == 1


def test_heights_above_the_sea_alone_need_the_geoid(tmp_path):
    log = small_log(fixes=False)
    place = (520_116_000, 43_575_000, 1_000, 0)
    log.add("vehicle_gps_position", 20_300_000, UTC_US, *place, *FIX)
    path = log.write(tmp_path / "msl.ulg")
    with pytest.raises(TirgeoError, match=r"msl\.ulg: .*above mean sea level.*--geoid-undulation"):
        read_px4_ulog(path, LogOptions())
    samples = by_source(read_px4_ulog(path, LogOptions(geoid_undulation_m=43.0)))
    assert samples[Source.GPS_POSITION][0].height_m == 44.0


def test_a_log_without_imu_is_refused(tmp_path):
    log = UlogFile()
    log.topic("vehicle_attitude", "uint64_t timestamp;float[4] q")
    log.add("vehicle_attitude", 20_000_000, 1.0, 0.0, 0.0, 0.0)
    with pytest.raises(TirgeoError, match=r"no IMU in this log: none of sensor_combined"):
        read_px4_ulog(log.write(tmp_path / "none.ulg"), LogOptions())


def test_a_log_that_is_cut_off_or_damaged_is_known(tmp_path):
    """Also where a damaged length reaches beyond the end, and nothing of it is skipped."""
    whole = small_log().write(tmp_path / "a.ulg").read_bytes()
    middle = len(whole) // 2
    for place, other, damaged in (
        (slice(0, 0), b"", False),
        (slice(-30, None), b"", True),
        (slice(-1, None), b"", True),
        (slice(middle, middle + 200), bytes(200), True),
        (slice(whole.rindex(b"D") - 1, whole.rindex(b"D")), b"\x20", True),
    ):
        data = bytearray(whole)
        data[place] = other
        (tmp_path / "b.ulg").write_bytes(data)
        contents = read_px4_ulog(tmp_path / "b.ulg", LogOptions(geoid_undulation_m=40.0))
        assert contents.damaged is damaged, place


def test_damaged_logs_give_a_line_or_what_can_be_read(tmp_path, capfd):
    """Cut, with flipped bits, zeros and noise: nothing is raised but one line."""
    whole = small_log().write(tmp_path / "a.ulg").read_bytes()

    def read(path):
        return read_px4_ulog(path, LogOptions(geoid_undulation_m=40.0)).samples

    readable = read_damaged(read, whole, tmp_path / "b.ulg", 150)
    assert 30 < readable < 150
    assert capfd.readouterr() == ("", "")
