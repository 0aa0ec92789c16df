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
"""tirgeo import of ROS 1 bags: all topics of the contract, namespaces, pictures, and bad input."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from ros1_bags import (
    BEGUN_NS,
    CDR,
    FLIGHT,
    GRAVITY,
    PARAMETERS,
    Bag,
    Flight,
    by_time,
    messages,
    parameters_file,
    wrapper_bag,
)
from scipy.spatial.transform import Rotation

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.convert.import_flight import import_flight
from tirgeo_ros.tools.convert.import_ros1 import Pictures

SENSED = dict.fromkeys(("rtk/fix", "rtk/vel", "rtk/heading"), 30) | {"imu/data": 600}
SENSED |= dict.fromkeys(("gps/fix", "gimbal/joint_states", "gimbal/attitude"), 300)
#: A double in radians and back, at 180 deg: 3e-14; what the contract's file must hold.
POSITION_DEG = 1e-9
ROUNDING = 1e-9


def rotation(q):
    """Matrix of a message's quaternion."""
    return Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()


def about(axis, degrees):
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


#: East, north, up from north, east, down.
ENU_NED = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
FLU_FRD = np.diag([1, -1, -1])


def camera_enu(rpy_deg):
    """Camera FLU in ENU: yaw, pitch, roll of level axes, in this order."""
    roll, pitch, yaw = rpy_deg
    ned = about("z", yaw) @ about("y", pitch) @ about("x", roll)
    return ENU_NED @ ned @ FLU_FRD


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ros1")
    parameters_file(folder / "params.yaml")
    return folder


@pytest.fixture(scope="module", params=["subscription", "broadcast"])
def imported(request, folder):
    """A flight as the wrapper records it in either mode, imported: path, summary."""
    bag = wrapper_bag(FLIGHT, broadcast=request.param == "broadcast")
    source = bag.write(folder / f"{request.param}.bag")
    target = folder / f"{request.param}.mcap"
    summary = import_flight(source, target, params=folder / "params.yaml")
    return target, summary


@pytest.mark.slow
def test_every_topic_with_its_type(imported):
    path, summary = imported
    outcome = BagReader(path).topics()
    assert outcome == {f"/{name}": convert.TOPIC_TYPES[name] for name in [*SENSED, "gps/vel"]}
    assert summary["kind"] == "ros1"
    counted = {name: observed["messages"] for name, observed in summary["written"].items()}
    counted.pop("/gps/vel")
    assert counted == {f"/{name}": number for name, number in SENSED.items()}


def test_imu(imported):
    path, _ = imported
    rate = -math.radians(FLIGHT.turn_deg_s)
    for t_s, message in by_time(path, "/imu/data"):
        force, turn = message.linear_acceleration, message.angular_velocity
        assert (force.x, force.y, force.z) == pytest.approx((0, 0, GRAVITY), abs=ROUNDING)
        assert (turn.x, turn.y, turn.z) == pytest.approx((0, 0, rate), abs=ROUNDING)
        expected = about("z", 90 - FLIGHT.at(t_s).heading_deg)
        np.testing.assert_allclose(rotation(message.orientation), expected, atol=ROUNDING)
        assert message.header.frame_id == "base_link"


def test_rtk_position_is_ellipsoidal_and_fixed(imported):
    path, _ = imported
    outcome = by_time(path, "/rtk/fix")
    assert [round(t_s, 3) for t_s, _ in outcome] == pytest.approx(FLIGHT.times(5), abs=1e-9)
    for t_s, message in outcome:
        state = FLIGHT.at(math.floor(t_s * 5) / 5)
        assert message.latitude == pytest.approx(state.latitude_deg, abs=POSITION_DEG)
        assert message.longitude == pytest.approx(state.longitude_deg, abs=POSITION_DEG)
        height_m = state.height_msl_m + PARAMETERS.undulation_m
        assert message.altitude == pytest.approx(height_m, abs=1e-9)
        assert message.status.status == 2
        assert message.position_covariance_type == 3
        assert message.position_covariance[0] > 0


def test_heading_is_the_baselines_azimuth_less_its_offset(imported):
    path, _ = imported
    outcome = by_time(path, "/rtk/heading")
    assert len(outcome) == 30
    for t_s, message in outcome:
        epoch_s = math.floor(t_s * 5 + 1e-6) / 5
        heading_deg = FLIGHT.yaw_deg(epoch_s) - PARAMETERS.baseline_deg
        attitude = rotation(message.orientation)
        np.testing.assert_allclose(attitude, about("z", 90 - heading_deg), atol=ROUNDING)
        off_deg = math.remainder(heading_deg - FLIGHT.at(epoch_s).heading_deg, 360)
        assert abs(off_deg) <= 0.5 + ROUNDING  # the aircraft's whole degrees
        assert message.orientation_covariance[8] > 0
        assert message.linear_acceleration_covariance[0] == -1


def test_gimbal_joints_are_the_rotation_from_body_to_camera(imported):
    path, _ = imported
    for t_s, message in by_time(path, "/gimbal/joint_states"):
        angles = dict(zip(message.name, np.degrees(message.position), strict=True))
        chain = (
            about("z", angles["gimbal_yaw_joint"])
            @ about("x", angles["gimbal_roll_joint"])
            @ about("y", angles["gimbal_pitch_joint"])
        )
        state = FLIGHT.at(t_s)
        body_enu = about("z", 90 - state.heading_deg)
        expected = body_enu.T @ camera_enu(state.gimbal_rpy_deg)
        # Attitudes between two at 100 Hz are interpolated; this one turns steadily.
        np.testing.assert_allclose(chain, expected, atol=1e-7)


def test_log_times_are_those_of_the_record_and_in_order(imported):
    """The last part of an epoch is recorded 5 ms after its first."""
    path, _ = imported
    times = {}
    for m in BagReader(path).messages():
        times.setdefault(m.topic, []).append(m.log_time_ns)
    assert all(outcome == sorted(outcome) for outcome in times.values())
    lag_ns = FLIGHT.record_lag_ns
    assert times["/imu/data"][-1] == FLIGHT.at(FLIGHT.duration_s - 0.01).stamp_ns + lag_ns
    assert times["/rtk/fix"][3] == FLIGHT.at(0.6).stamp_ns + lag_ns + 5_000_000


def test_the_result_can_be_processed(imported, folder, capsys):
    """Heading within the aircraft's whole degrees of the truth, position within RTK's sigma."""
    path, _ = imported
    assert main(["process", str(path), "-o", str(folder / "out.mcap"), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["state"] == "running"
    assert result["heading_sigma_deg"] < 0.6
    last = messages(folder / "out.mcap", "/tirgeo/odometry")[-1]
    t_s = (convert.stamp_ns(last) - FLIGHT.begun_ns) * 1e-9
    q = last.pose.pose.orientation
    east, north, _ = rotation(q)[:, 0]
    heading_deg = math.degrees(math.atan2(east, north))
    assert abs(math.remainder(heading_deg - FLIGHT.at(t_s).heading_deg, 360)) < 0.6
    assert messages(folder / "out.mcap", "/tirgeo/camera_pose")


def test_delays_are_taken_off(folder):
    params = parameters_file(
        folder / "delays.yaml",
        **{"rtk.delay_s": 0.08, "delay.gimbal_s": 0.02, "delay.imu_s": 0.005, "delay.gps_s": 0.1},
    )
    path = wrapper_bag(Flight(duration_s=1.0)).write(folder / "delays.bag")
    import_flight(path, folder / "delays.mcap", params=params)
    first = {
        m.topic: convert.stamp_ns(CDR.deserialize(m.data, m.typename)) - BEGUN_NS
        for m in reversed(list(BagReader(folder / "delays.mcap").messages()))
    }
    late_ms = {"imu/data": 5, "rtk/fix": 80, "rtk/heading": 80, "gps/fix": 100}
    for topic, late in (late_ms | {"gimbal/attitude": 20}).items():
        assert first[f"/{topic}"] == -late * 1_000_000


def test_gps(imported):
    """The fused position's height is a barometer's: its variance in the message is large."""
    path, _ = imported
    for t_s, message in by_time(path, "/gps/fix"):
        state = FLIGHT.at(t_s)
        assert message.latitude == pytest.approx(state.latitude_deg, abs=POSITION_DEG)
        assert message.longitude == pytest.approx(state.longitude_deg, abs=POSITION_DEG)
        assert message.altitude == pytest.approx(150.0 + PARAMETERS.undulation_m, abs=1e-3)
        assert message.status.status == 0
        assert message.position_covariance[8] == pytest.approx(100.0**2)


@pytest.fixture
def empty_folder(tmp_path):
    parameters_file(tmp_path / "params.yaml")
    return tmp_path


def test_renamed_prefix_and_namespace(empty_folder):
    source = wrapper_bag(Flight(duration_s=1.0), prefix="/uav1/dji_osdk_ros")
    bag = source.write(empty_folder / "uav1.bag")
    params = empty_folder / "params.yaml"
    import_flight(bag, empty_folder / "plain.mcap", params=params)
    assert "/imu/data" in BagReader(empty_folder / "plain.mcap").topics()
    import_flight(bag, empty_folder / "uav1.mcap", params=params, namespace="/uav1/")
    topics = BagReader(empty_folder / "uav1.mcap").topics()
    assert topics
    assert all(topic.startswith("/uav1/") for topic in topics)
    with pytest.raises(BagError, match=r"no topic of DJI's wrapper .* in namespace uav2; it has"):
        import_flight(bag, empty_folder / "uav2.mcap", namespace="uav2")
    assert not (empty_folder / "uav2.mcap").exists()


def test_errors_are_warnings_and_the_rest_is_imported(empty_folder, capsys):
    flight = Flight(duration_s=1.0)
    bag = wrapper_bag(flight)
    kept = [m for m in bag.messages if m[2] not in {"/dji_sdk/rtk_yaw", "/dji_sdk/gimbal_angle"}]
    bag.messages = kept
    for k in range(7):
        at_ns = BEGUN_NS + k
        bag.add(at_ns, "/dji_sdk/rtk_yaw", bag.new("std_msgs/msg/Float32", data=90.0))
        bag.add(at_ns, "/dji_sdk/rtk_position", bag.fix(at_ns, 0.0, 0.0, 0.0))
        bag.add(at_ns, "/dji_sdk/battery_state", bag.new("std_msgs/msg/UInt8", data=1))
    path = bag.write(empty_folder / "wrong.bag")
    assert main(["import", str(path), "-o", str(empty_folder / "wrong.mcap"), "--json"]) == 0
    out, err = capsys.readouterr()
    result = json.loads(out)
    rows = {row["topic"]: row for row in result["topics"]}
    yaw, position = rows["/dji_sdk/rtk_yaw"], rows["/dji_sdk/rtk_position"]
    assert (yaw["type"], yaw["expected"]) == ("std_msgs/msg/Float32", "std_msgs/msg/Int16")
    assert (yaw["messages"], yaw["refused"]) == (7, 7)
    assert (position["messages"], position["refused"]) == (12, 7)
    assert result["not_read"] == {"/dji_sdk/battery_state": "std_msgs/msg/UInt8"}
    assert set(result["written"]) == {
        *("/imu/data", "/gps/fix", "/gps/vel", "/rtk/fix", "/rtk/vel"),
    }
    assert err.count("\n") == 1
    for reports in (
        "no usable messages of rtk_yaw, of gimbal_angle",
        "/dji_sdk/rtk_yaw: 7 of type std_msgs/msg/Float32, not std_msgs/msg/Int16",
        "/dji_sdk/rtk_position: 7 of 12 refused (no position yet: 0, 0 deg)",
        "geoid_undulation_m is not set",
    ):
        assert reports in err


def test_pictures_are_copied_unchanged(empty_folder):
    bag = wrapper_bag(Flight(duration_s=1.0))
    pixels = np.arange(12, dtype=np.uint8)
    form = {"height": 3, "width": 4, "encoding": "mono8", "is_bigendian": 0, "step": 4}
    for k in range(3):
        at_ns = BEGUN_NS + k * 100_000_000
        head = {"header": bag.header(at_ns, "camera")}
        image = bag.new("sensor_msgs/msg/Image", **form, data=pixels + k, **head)
        bag.add(at_ns + 5, "/flir/image", image)
        jpeg = bag.new("sensor_msgs/msg/CompressedImage", format="jpeg", data=pixels, **head)
        bag.add(at_ns + 6, "/flir/image/compressed", jpeg)
    path = bag.write(empty_folder / "pictures.bag")
    target = empty_folder / "pictures.mcap"
    result = import_flight(path, target, pictures=Pictures("flir/image"))
    outcome = by_time(target, "/thermal/image_raw")
    assert [round(t_s, 9) for t_s, _ in outcome] == [0.0, 0.1, 0.2]
    assert [m.data.tolist() for _, m in outcome] == [(pixels + k).tolist() for k in range(3)]
    logged = [m.log_time_ns for m in BagReader(target).messages(["/thermal/image_raw"])]
    assert logged == [BEGUN_NS + k * 100_000_000 + 5 for k in range(3)]
    assert result["not_read"] == {"/flir/image/compressed": "sensor_msgs/msg/CompressedImage"}
    import_flight(path, target, pictures=Pictures("/flir/image/compressed"))
    assert messages(target, "/thermal/image_raw/compressed")[0].format == "jpeg"


@pytest.mark.parametrize(
    ("pictures", "message"),
    [
        (
            Pictures("/none"),
            r"/none is not in the bag; thermal/image_raw takes .*, the type of no topic of",
        ),
        (Pictures("/dji_sdk/imu"), r"/dji_sdk/imu is of type sensor_msgs/msg/Imu; th"),
        (Pictures(camera_info="/x"), r"/x is not in the bag; thermal/camera_info takes"),
    ],
)
def test_absent_pictures(empty_folder, pictures, message):
    path = empty_folder / "no_pictures.bag"
    if not path.exists():
        wrapper_bag(Flight(duration_s=0.2)).write(path)
    with pytest.raises(BagError, match=message):
        import_flight(path, empty_folder / "no.mcap", pictures=pictures)


def test_a_bag_that_was_cut_off_is_read_up_to_the_cut(empty_folder, capsys):
    path = wrapper_bag(Flight(duration_s=1.0)).write(empty_folder / "cut.bag", chunk_bytes=20_000)
    path.write_bytes(path.read_bytes()[:50_000])
    params = ["--params", str(empty_folder / "params.yaml")]
    assert main(["import", str(path), "-o", str(empty_folder / "cut.mcap"), *params]) == 1
    assert (
        "cut.bag: no usable index: the file was cut off or not closed; " in capsys.readouterr().err
    )
    assert len(messages(empty_folder / "cut.mcap", "/imu/data")) > 20
    path.write_bytes(path.read_bytes()[:5_000])
    assert main(["import", str(path), "-o", str(empty_folder / "none.mcap"), *params]) == 1
    assert "cut.bag: cannot be read: " in capsys.readouterr().err
    assert not (empty_folder / "none.mcap").exists()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b"stamp,latitude\n1,2\n", "text in columns: say what they mean"),
        (b"Dear diary\n", "a text, but no known log: docs/import.md lists"),
        (b"#ROSBAG V1.2\nxyz", "a ROS 1 bag of an older version"),
        (b"#ROSBAG V2.0\n", "cannot be read: Header could not be read"),
        (b"\x89MCAP0\r\n" + bytes(99), "no message can be read; 99 bytes"),
        (b"SQLite format 3\0" + bytes(100), "the database is cut off or damaged"),
        (b"\x1f\x8b\x08" + bytes(99), "packed with gzip"),
        ("folder", "a directory; give a ROS 1 bag"),
        ("nothing", "cannot be read: No such file"),
        ("bag", "the bag has no message"),
    ],
)
def test_files_that_cannot_be_imported(tmp_path, content, message, capsys):
    """By its content, not its name; one line, and no file is left."""
    path = tmp_path / "flight.bag"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content != "nothing":
        path.mkdir() if content == "folder" else Bag().write(path)
    assert main(["import", str(path), "-o", str(tmp_path / "out.mcap")]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"tirgeo import: {path}: {message}")
    assert err.count("\n") == 1
    assert [p for p in tmp_path.iterdir() if p != path] == []
