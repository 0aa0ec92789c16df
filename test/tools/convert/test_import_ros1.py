"""tirgeo import of ROS 1 bags: all topics of the contract with the right values, and bad input."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from ros1_bags import (
    BEGUN_NS,
    GRAVITY,
    PARAMETERS,
    Bag,
    Flight,
    older_bag,
    parameters_file,
    wrapper_bag,
)

from tirgeo_ros.core.types.errors import BagError, ConfigError
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.convert.import_capture import CaptureOptions
from tirgeo_ros.tools.convert.import_flight import import_flight
from tirgeo_ros.tools.convert.import_ros1 import Pictures

CDR = Cdr()
FLIGHT = Flight()
SENSED = dict.fromkeys(("rtk/fix", "rtk/vel", "rtk/heading"), 30) | {"imu/data": 600}
SENSED |= dict.fromkeys(("gps/fix", "gimbal/joint_states", "gimbal/attitude"), 300)
#: A double in radians and back, at 180 deg: 3e-14; what the contract's file must hold.
POSITION_DEG = 1e-9
ROUNDING = 1e-9


def messages(path, topic):
    return [CDR.deserialize(m.data, m.typename) for m in BagReader(path).messages([topic])]


def by_time(path, topic, flight=FLIGHT):
    """Seconds of the flight and message."""
    return [((convert.stamp_ns(m) - flight.begun_ns) * 1e-9, m) for m in messages(path, topic)]


def rotation(q):
    """Matrix of a message's quaternion."""
    w, x, y, z = q.w, q.x, q.y, q.z
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def about(axis, degrees):
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array(
        {
            "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
            "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
            "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        }[axis]
    )


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


@pytest.fixture(scope="module", params=["subscription", "broadcast", "older"])
def imported(request, folder):
    """A flight as each wrapper records it, imported: path, summary, its name."""
    bags = {
        "subscription": lambda: wrapper_bag(FLIGHT),
        "broadcast": lambda: wrapper_bag(FLIGHT, broadcast=True),
        "older": lambda: older_bag(FLIGHT),
    }
    source = bags[request.param]().write(folder / f"{request.param}.bag")
    target = folder / f"{request.param}.mcap"
    summary = import_flight(source, target, params=folder / "params.yaml")
    return target, summary, request.param


@pytest.mark.slow
def test_every_topic_with_its_type(imported):
    path, summary, kind = imported
    found = BagReader(path).topics()
    assert found == {f"/{name}": convert.TOPIC_TYPES[name] for name in [*SENSED, "gps/vel"]}
    assert summary["error"] is None
    assert summary["kind"] == "ros1"
    # The older wrapper's attitudes come with each packet, and its GPS is the receiver's, 5 Hz.
    other = {"gps/fix": 30, "gimbal/joint_states": 600, "gimbal/attitude": 600}
    expected = SENSED | (other if kind == "older" else {})
    counted = {name: seen["messages"] for name, seen in summary["written"].items()}
    counted.pop("/gps/vel")
    assert counted == {f"/{name}": number for name, number in expected.items()}


def test_imu(imported):
    path, _, kind = imported
    rate = -math.radians(FLIGHT.turn_deg_s)
    # float32 of the older wrapper: 2^-24 of 9.8 m/s2, of 0.09 rad/s, of a quaternion.
    close = 1e-6 if kind == "older" else ROUNDING
    for t_s, message in by_time(path, "/imu/data"):
        force, turn = message.linear_acceleration, message.angular_velocity
        assert (force.x, force.y, force.z) == pytest.approx((0, 0, GRAVITY), abs=close)
        assert (turn.x, turn.y, turn.z) == pytest.approx((0, 0, rate), abs=close)
        expected = about("z", 90 - FLIGHT.at(t_s).heading_deg)
        np.testing.assert_allclose(rotation(message.orientation), expected, atol=close)
        assert message.header.frame_id == "base_link"


def test_rtk_position_is_ellipsoidal_and_fixed(imported):
    path, _, kind = imported
    found = by_time(path, "/rtk/fix")
    assert [round(t_s, 3) for t_s, _ in found] == pytest.approx(
        [t_s + (0.002 if kind == "older" else 0.0) for t_s in FLIGHT.times(5)], abs=1e-9
    )
    for t_s, message in found:
        state = FLIGHT.at(math.floor(t_s * 5) / 5)
        assert message.latitude == pytest.approx(state.latitude_deg, abs=POSITION_DEG)
        assert message.longitude == pytest.approx(state.longitude_deg, abs=POSITION_DEG)
        height_m = state.height_msl_m + PARAMETERS.undulation_m
        # float32 of the older wrapper at 28 m: 2e-6.
        assert message.altitude == pytest.approx(height_m, abs=3e-6 if kind == "older" else 1e-9)
        assert message.status.status == 2
        assert message.position_covariance_type == 3
        assert message.position_covariance[0] > 0


def test_rtk_velocity_is_east_north_up(imported):
    path, _, _ = imported
    north, east, down = FLIGHT.velocity_ned
    for message in messages(path, "/rtk/vel"):
        linear = message.twist.twist.linear
        # float32 in cm/s at 400: 1.5e-5 cm/s.
        assert (linear.x, linear.y, linear.z) == pytest.approx((east, north, -down), abs=3e-7)


def test_heading_is_the_baselines_less_its_offset(imported):
    path, _, _ = imported
    found = by_time(path, "/rtk/heading")
    assert len(found) == 30
    for t_s, message in found:
        epoch_s = math.floor(t_s * 5 + 1e-6) / 5
        heading_deg = FLIGHT.yaw_deg(epoch_s) - PARAMETERS.baseline_deg
        made = rotation(message.orientation)
        np.testing.assert_allclose(made, about("z", 90 - heading_deg), atol=ROUNDING)
        off_deg = math.remainder(heading_deg - FLIGHT.at(epoch_s).heading_deg, 360)
        assert abs(off_deg) <= 0.5 + ROUNDING  # the aircraft's whole degrees
        assert message.orientation_covariance[8] > 0
        assert message.linear_acceleration_covariance[0] == -1


def test_gimbal_attitude_in_either_order(imported):
    path, _, kind = imported
    close = 3e-7 if kind == "older" else ROUNDING  # float32 of 75 deg is 4e-6 deg
    for t_s, message in by_time(path, "/gimbal/attitude"):
        expected = camera_enu(FLIGHT.at(t_s).gimbal_rpy_deg)
        np.testing.assert_allclose(rotation(message.quaternion), expected, atol=close)


def test_gimbal_joints_are_the_rotation_from_body_to_camera(imported):
    path, _, kind = imported
    # Attitudes between two at 100 Hz are interpolated; this one turns steadily.
    close = 1e-6 if kind == "older" else 1e-7
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
        np.testing.assert_allclose(chain, expected, atol=close)


def test_gps(imported):
    """The fused position's height is a barometer's: it goes out as hardly known."""
    path, _, kind = imported
    for t_s, message in by_time(path, "/gps/fix"):
        older = kind == "older"
        state = FLIGHT.at(math.floor(t_s * 5) / 5 if older else t_s)
        # The older wrapper has the receiver's 1e-7 deg and mm.
        assert message.latitude == pytest.approx(state.latitude_deg, abs=5e-8 if older else 1e-9)
        assert message.longitude == pytest.approx(state.longitude_deg, abs=5e-8 if older else 1e-9)
        height_m = state.height_msl_m if older else 150.0
        assert message.altitude == pytest.approx(height_m + PARAMETERS.undulation_m, abs=1e-3)
        assert message.status.status == 0
        assert older or message.position_covariance[8] == pytest.approx(100.0**2)


def test_log_times_are_those_of_the_record_and_in_order(imported):
    """The last part of an epoch is recorded 5 ms after its first."""
    path, _, kind = imported
    times = {}
    for m in BagReader(path).messages():
        times.setdefault(m.topic, []).append(m.log_time_ns)
    assert all(found == sorted(found) for found in times.values())
    lag_ns = FLIGHT.record_lag_ns
    assert times["/imu/data"][-1] == FLIGHT.at(FLIGHT.duration_s - 0.01).stamp_ns + lag_ns
    last_part_ns = 0 if kind == "older" else 5_000_000
    assert times["/rtk/fix"][3] == FLIGHT.at(0.6).stamp_ns + lag_ns + last_part_ns


def test_the_result_can_be_processed(imported, folder, capsys):
    """Heading within the aircraft's whole degrees of the truth, position within RTK's sigma."""
    path, _, _ = imported
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


@pytest.mark.slow
@pytest.mark.parametrize("broadcast", [False, True])
def test_a_bag_without_rtk_stays_on_its_gps(folder, capsys, broadcast):
    """DJI's own fused position: its height is next to unknown, which is no cause to be lost."""
    source = wrapper_bag(Flight(duration_s=25.0), broadcast=broadcast)
    source.messages = [one for one in source.messages if "/rtk_" not in one[2]]
    bag, target = source.write(folder / f"gps_{broadcast}.bag"), folder / f"gps_{broadcast}.mcap"
    import_flight(bag, target, params=folder / "params.yaml")
    out = ["-o", str(folder / "out.mcap"), "--no-images", "--json"]
    assert main(["process", str(target), *out]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["method"], result["state"]) == ("ekf", "degraded")
    assert result["reason"].endswith("gps/fix has a sigma of 100 m in height")
    assert set(result["states_s"]) <= {"waiting", "aligning", "degraded"}
    assert result["states_s"]["degraded"] >= 17


def test_renamed_prefix_and_namespace(folder):
    source = wrapper_bag(Flight(duration_s=1.0), prefix="/uav1/dji_osdk_ros")
    bag = source.write(folder / "uav1.bag")
    params = folder / "params.yaml"
    import_flight(bag, folder / "plain.mcap", params=params)
    assert "/imu/data" in BagReader(folder / "plain.mcap").topics()
    import_flight(bag, folder / "uav1.mcap", params=params, namespace="/uav1/")
    topics = BagReader(folder / "uav1.mcap").topics()
    assert topics
    assert all(topic.startswith("/uav1/") for topic in topics)
    with pytest.raises(BagError, match=r"no topic of DJI's wrapper .* in namespace uav2; it has"):
        import_flight(bag, folder / "uav2.mcap", namespace="uav2")
    assert not (folder / "uav2.mcap").exists()


def test_two_aircraft_want_a_namespace(folder):
    one, flight = Bag(), Flight(duration_s=1.0)
    for name in ("a", "b"):
        for message in wrapper_bag(flight, prefix=f"/{name}/dji_sdk").messages:
            one.add(message[0], message[2], message[4])
    path = one.write(folder / "two.bag")
    with pytest.raises(BagError, match=r"/a/dji_sdk, /b/dji_sdk; choose with --namespace"):
        import_flight(path, folder / "two.mcap")
    import_flight(path, folder / "two.mcap", namespace="b", params=folder / "params.yaml")
    assert "/b/imu/data" in BagReader(folder / "two.mcap").topics()


def test_what_is_wrong_is_told_and_the_rest_imported(folder, capsys):
    flight = Flight(duration_s=1.0)
    bag = wrapper_bag(flight)
    kept = [m for m in bag.messages if m[2] not in {"/dji_sdk/rtk_yaw", "/dji_sdk/gimbal_angle"}]
    bag.messages = kept
    for k in range(7):
        at_ns = BEGUN_NS + k
        bag.add(at_ns, "/dji_sdk/rtk_yaw", bag.new("std_msgs/msg/Float32", data=90.0))
        bag.add(at_ns, "/dji_sdk/rtk_position", bag.fix(at_ns, 0.0, 0.0, 0.0))
        bag.add(at_ns, "/dji_sdk/battery_state", bag.new("std_msgs/msg/UInt8", data=1))
    path = bag.write(folder / "wrong.bag")
    assert main(["import", str(path), "-o", str(folder / "wrong.mcap"), "--json"]) == 0
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
    for told in (
        "no usable messages of rtk_yaw or A3_RTK, of gimbal_angle or gimbal",
        "/dji_sdk/rtk_yaw: 7 of type std_msgs/msg/Float32, not std_msgs/msg/Int16",
        "/dji_sdk/rtk_position: 7 of 12 refused (no position yet: 0, 0 deg)",
        "geoid_undulation_m is not set",
    ):
        assert told in err


def test_nothing_that_can_be_used_leaves_no_file(folder):
    bag = Bag()
    for k in range(3):
        bag.add(BEGUN_NS + k, "/dji_sdk/imu", bag.new("std_msgs/msg/UInt8", data=k))
    path = bag.write(folder / "none.bag")
    before = set(folder.iterdir())
    with pytest.raises(BagError, match=r"none\.mcap: nothing to write"):
        import_flight(path, folder / "none.mcap")
    assert set(folder.iterdir()) == before


def test_a_flag_that_is_no_fix(folder):
    flight = Flight(duration_s=1.0, position_flag=34, yaw_flag=16)
    path = wrapper_bag(flight).write(folder / "float.bag")
    result = import_flight(path, folder / "float.mcap", params=folder / "params.yaml")
    statuses = {m.status.status for m in messages(folder / "float.mcap", "/rtk/fix")}
    assert statuses == {1}
    assert "/rtk/heading" not in result["written"]
    assert result["counts"]["rtk_yaw_not_fixed"] == 5


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


def test_pictures_go_on_as_they_are(folder):
    bag = wrapper_bag(Flight(duration_s=1.0))
    pixels = np.arange(12, dtype=np.uint8)
    for k in range(3):
        at_ns = BEGUN_NS + k * 100_000_000
        head = {"header": bag.header(at_ns, "camera")}
        image = bag.new(
            "sensor_msgs/msg/Image",
            height=3,
            width=4,
            encoding="mono8",
            is_bigendian=0,
            step=4,
            data=pixels + k,
            **head,
        )
        bag.add(at_ns + 5, "/flir/image", image)
        jpeg = bag.new("sensor_msgs/msg/CompressedImage", format="jpeg", data=pixels, **head)
        bag.add(at_ns + 6, "/flir/image/compressed", jpeg)
        bag.add(at_ns + 7, "/flir/camera_info", camera_info(bag, head))
    path = bag.write(folder / "pictures.bag")
    target = folder / "pictures.mcap"
    result = import_flight(path, target, pictures=Pictures("/flir/image", "flir/camera_info"))
    found = by_time(target, "/thermal/image_raw")
    assert [round(t_s, 9) for t_s, _ in found] == [0.0, 0.1, 0.2]
    assert [m.data.tolist() for _, m in found] == [(pixels + k).tolist() for k in range(3)]
    logged = [m.log_time_ns for m in BagReader(target).messages(["/thermal/image_raw"])]
    assert logged == [BEGUN_NS + k * 100_000_000 + 5 for k in range(3)]
    info = messages(target, "/thermal/camera_info")[0]
    camera = convert.camera(info)
    assert (camera.width, camera.fx, camera.cy) == (640, 760.0, 256.0)
    assert result["not_read"] == {"/flir/image/compressed": "sensor_msgs/msg/CompressedImage"}
    import_flight(path, target, pictures=Pictures("/flir/image/compressed"))
    assert messages(target, "/thermal/image_raw/compressed")[0].format == "jpeg"


def camera_info(bag, head):
    roi = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
    return bag.new(
        "sensor_msgs/msg/CameraInfo",
        height=512,
        width=640,
        distortion_model="plumb_bob",
        D=np.zeros(5),
        K=np.array([760.0, 0, 320, 0, 760, 256, 0, 0, 1]),
        R=np.eye(3).ravel(),
        P=np.zeros(12),
        binning_x=0,
        binning_y=0,
        roi=bag.new("sensor_msgs/msg/RegionOfInterest", **roi),
        **head,
    )


@pytest.mark.parametrize(
    ("pictures", "message"),
    [
        (Pictures("/none"), r"/none is not there; of type sensor_msgs/msg/Image or .* are: none"),
        (Pictures("/dji_sdk/imu"), r"/dji_sdk/imu is sensor_msgs/msg/Imu; of type"),
        (Pictures(camera_info="/x"), r"/x is not there; of type sensor_msgs/msg/CameraInfo are"),
    ],
)
def test_pictures_that_are_not_there(folder, pictures, message):
    path = folder / "no_pictures.bag"
    if not path.exists():
        wrapper_bag(Flight(duration_s=0.2)).write(path)
    with pytest.raises(BagError, match=message):
        import_flight(path, folder / "no.mcap", pictures=pictures)


def test_a_bag_that_was_cut_off_is_imported_as_far_as_it_goes(folder, capsys):
    path = wrapper_bag(Flight(duration_s=4.0)).write(folder / "cut.bag", chunk_bytes=20_000)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    params = ["--params", str(folder / "params.yaml"), "--json"]
    assert main(["import", str(path), "-o", str(folder / "cut.mcap"), *params]) == 1
    out, err = capsys.readouterr()
    result = json.loads(out)
    assert 100 < result["written"]["/imu/data"]["messages"] < 300
    assert err.startswith(f"tirgeo import: {path}: ")
    assert "no index at the end" in err
    assert "messages were read; the output is made from these" in err
    assert messages(folder / "cut.mcap", "/rtk/fix")


def head_of_sqlite(path):
    path.write_bytes(b"SQLite format 3\0" + bytes(100))


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda p: p.write_bytes(b""), "the file is empty"),
        (lambda p: p.write_text("stamp,latitude\n1,2\n"), "text; give a ROS 1 bag or a capture"),
        (lambda p: p.write_bytes(b"#ROSBAG V1.2\nxyz"), "a ROS 1 bag of an older version"),
        (lambda p: p.write_bytes(b"#ROSBAG V2.0\n"), "no message can be read"),
        (lambda p: p.write_bytes(b"\x89MCAP0\r\n" + bytes(99)), "an MCAP bag already; give it to"),
        (head_of_sqlite, "a ROS 2 bag in SQLite"),
        (lambda p: p.write_bytes(b"\x1f\x8b\x08" + bytes(99)), "packed with gzip"),
        (lambda p: p.mkdir(), "a directory; give a ROS 1 bag"),
        (lambda _: None, "cannot be read: No such file"),
        (lambda p: Bag().write(p), "no message can be read; it has none"),
    ],
)
def test_what_cannot_be_imported(tmp_path, write, message, capsys):
    """By its content, whatever its name says; one line, and nothing is left behind."""
    path = tmp_path / "flight.bag"
    write(path)
    assert main(["import", str(path), "-o", str(tmp_path / "out.mcap")]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"tirgeo import: {path}: {message}")
    assert err.count("\n") == 1
    assert [p for p in tmp_path.iterdir() if p != path] == []


def test_options_of_the_other_kind(folder):
    path = wrapper_bag(Flight(duration_s=0.2)).write(folder / "options.bag")
    with pytest.raises(ConfigError, match=r"a ROS 1 bag; --packages, --key and --start-time"):
        import_flight(path, folder / "o.mcap", capture=CaptureOptions(key="00"))
    with pytest.raises(BagError, match="would take the place of the input"):
        import_flight(path, path)
    assert path.exists()
