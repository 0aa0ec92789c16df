"""Logs of autopilots to poses: the sample flight as PX4 would have logged it."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest
from autopilot_logs import MAGIC, UlogFile

from tirgeo_ros.core.frames.rotations import euler_from_quat, wrap_pi
from tirgeo_ros.core.types.measurements import FixStatus, Source
from tirgeo_ros.io.bags.bag import BagReader, BagWriter, Cdr
from tirgeo_ros.io.messages import NAVIGATION_INPUTS, TOPIC_TYPES, Messages, body_pose, sensed
from tirgeo_ros.tools.cli.main import main

CDR = Cdr()
SECONDS = 8.0
UNDULATION_M = 9.0
BOOT_US = 30_000_000  # since boot at the flight's beginning
#: MAVLink's fix types.
FIXES = {FixStatus.FIXED: 6, FixStatus.FLOAT: 5, FixStatus.SINGLE: 3}
RECEIVER = (
    "uint64_t timestamp;uint64_t time_utc_usec;double latitude_deg;double longitude_deg;"
    "double altitude_msl_m;double altitude_ellipsoid_m;float s_variance_m_s;float eph;float epv;"
    "float vel_n_m_s;float vel_e_m_s;float vel_d_m_s;float heading;float heading_offset;"
    "float heading_accuracy;uint8_t fix_type;bool vel_ned_valid"
)
#: Half of 1e-7 deg.
ROUNDING_M = 0.0056


@pytest.fixture(scope="module")
def flown(sample):
    """The first part of the sample flight: IMU samples, and RTK's by their stamps."""
    inputs = (Source.IMU, Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING)
    topics = {f"/{NAVIGATION_INPUTS[s][0]}": (s, NAVIGATION_INPUTS[s][1]) for s in inputs}
    reader = BagReader(sample / "flight.mcap")
    end_ns = reader.span_ns[0] + round(SECONDS * 1e9)
    found = {source: {} for source in inputs}
    for message in reader.messages(topics):
        if message.log_time_ns < end_ns:
            source, decode = topics[message.topic]
            one = decode(CDR.deserialize(message.data, message.typename))
            found[source][one.stamp_ns] = one
    return found


def boot_us(flown, stamp_ns):
    return BOOT_US + (stamp_ns - min(flown[Source.IMU])) // 1000


def epochs(flown):
    """Position, velocity and heading of one time, as a receiver logs them."""
    for stamp_ns, position in flown[Source.RTK_POSITION].items():
        yield (
            stamp_ns,
            position,
            flown[Source.RTK_VELOCITY].get(stamp_ns),
            flown[Source.RTK_HEADING].get(stamp_ns),
        )


def ulog(flown, path):
    log = UlogFile()
    log.topic(
        "sensor_combined", "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2"
    )
    log.topic("vehicle_attitude", "uint64_t timestamp;float[4] q")
    log.topic("vehicle_gps_position", RECEIVER)
    for stamp_ns, imu in flown[Source.IMU].items():
        at_us = boot_us(flown, stamp_ns)
        log.add("sensor_combined", at_us, *imu.angular_rate_b, *imu.specific_force_b)
        log.add("vehicle_attitude", at_us, *imu.autopilot_q_nb)
    for stamp_ns, position, velocity, heading in epochs(flown):
        place = math.degrees(position.latitude_rad), math.degrees(position.longitude_rad)
        heights = position.height_m - UNDULATION_M, position.height_m
        sigma_m = np.sqrt(position.covariance_n.diagonal())
        speed = math.sqrt(velocity.covariance_n[0, 0])
        yaw, sigma = math.nan, math.nan
        if heading is not None:
            yaw, sigma = heading.heading_rad, math.sqrt(heading.variance_rad2)
        values = (speed, sigma_m[0], sigma_m[2], *velocity.velocity_n, yaw, 0.0, sigma)
        ends = FIXES[position.status], True
        at_us = boot_us(flown, stamp_ns)
        utc_us = stamp_ns // 1000
        log.add("vehicle_gps_position", at_us, utc_us, *place, *heights, *values, *ends)
    return log.write(path)


@pytest.fixture(scope="module")
def recorded(flown, sample, tmp_path_factory):
    """The poses of the same samples without a log between, by their stamps."""
    folder, build = tmp_path_factory.mktemp("recorded"), Messages(CDR.types)
    samples = [one for found in flown.values() for one in found.values()]
    with BagWriter(folder / "flight.mcap") as writer:
        for one in sorted(samples, key=lambda sample: sample.stamp_ns):
            topic, message = sensed(build, one)
            writer.write(f"/{topic}", TOPIC_TYPES[topic], message, one.stamp_ns)
    return processed(folder / "flight.mcap", sample, folder)


def processed(bag, sample, folder):
    params = ["--params", str(sample / "params.yaml"), "--no-images"]
    assert main(["process", str(bag), "-o", str(folder / "out.mcap"), *params]) == 0
    read = BagReader(folder / "out.mcap").messages(["/tirgeo/odometry"])
    found = (body_pose(CDR.deserialize(one.data, one.typename)) for one in read)
    return {pose.stamp_ns: pose for pose in found}


def test_a_flight_in_an_autopilots_log_gives_its_poses(flown, recorded, sample, tmp_path):
    pytest.importorskip("pyulog")
    log, bag = ulog(flown, tmp_path / "log"), tmp_path / "a.mcap"
    assert main(["import", str(log), "-o", str(bag)]) == 0
    found = processed(bag, sample, tmp_path)
    stamps = [one for one in recorded if one in found]
    assert len(stamps) > 0.9 * len(recorded)
    off_m = [found[one].position_n - recorded[one].position_n for one in stamps]
    q_nb = np.array([[poses[one].q_nb for one in stamps] for poses in (found, recorded)])
    headings = euler_from_quat(q_nb)[..., 2]
    # The origin of map is the first position, and rounded too.
    assert np.abs(off_m).max() < 2 * ROUNDING_M
    # Rounding has a third of RTK's sigma of 1 cm, and takes as little of the heading's.
    sigma_rad = [math.sqrt(recorded[one].covariance[5, 5]) for one in stamps]
    assert (np.abs(wrap_pi(np.subtract(*headings))) < np.divide(sigma_rad, 3)).all()


@pytest.mark.parametrize(
    ("head", "package"), [(MAGIC + bytes(9), "pyulog"), (b"\xa3\x95\x80" + bytes(86), "pymavlink")]
)
def test_a_reader_that_is_not_installed_is_named(tmp_path, capsys, monkeypatch, head, package):
    for name in [one for one in sys.modules if one.partition(".")[0] == package] + [package]:
        monkeypatch.setitem(sys.modules, name, None)
    (tmp_path / "a.log").write_bytes(head)
    assert main(["import", str(tmp_path / "a.log"), "-o", str(tmp_path / "a.mcap")]) == 1
    assert f"{package} is missing: pip install {package}\n" in capsys.readouterr().err
    assert not (tmp_path / "a.mcap").exists()


def test_a_cut_log_ends_as_a_cut_bag_does(shared, tmp_path, capsys):
    """With exit code 1 and a line on stderr, and what could be read."""
    pytest.importorskip("pyulog")
    data = (shared / "foreign_logs" / "px4" / "fmu_v6c.ulg").read_bytes()
    (tmp_path / "a.ulg").write_bytes(data[: len(data) * 9 // 10])
    assert main(["import", str(tmp_path / "a.ulg"), "-o", str(tmp_path / "a.mcap")]) == 1
    assert "a.ulg: the file is cut off or damaged: what could be" in capsys.readouterr().err
    assert len(list(BagReader(tmp_path / "a.mcap").messages(["/imu/data"]))) > 500
