"""tirgeo import of ROS 1 bags: all topics of the contract with the right values, and bad input."""

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
    Flight,
    by_time,
    messages,
    parameters_file,
    wrapper_bag,
)

from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.convert.import_flight import import_flight

SENSED = dict.fromkeys(("rtk/fix", "rtk/vel", "rtk/heading"), 30) | {"imu/data": 600}


SENSED |= dict.fromkeys(("gps/fix", "gimbal/joint_states", "gimbal/attitude"), 300)


#: A double in radians and back, at 180 deg: 3e-14; what the contract's file must hold.
POSITION_DEG = 1e-9


ROUNDING = 1e-9


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


@pytest.fixture(scope="module", params=["subscription", "broadcast"])
def imported(request, folder):
    """A flight as the wrapper records it in either mode, imported: path, summary."""
    made = wrapper_bag(FLIGHT, broadcast=request.param == "broadcast")
    source = made.write(folder / f"{request.param}.bag")
    target = folder / f"{request.param}.mcap"
    summary = import_flight(source, target, params=folder / "params.yaml")
    return target, summary


@pytest.mark.slow
def test_every_topic_with_its_type(imported):
    path, summary = imported
    found = BagReader(path).topics()
    assert found == {f"/{name}": convert.TOPIC_TYPES[name] for name in [*SENSED, "gps/vel"]}
    assert summary["kind"] == "ros1"
    counted = {name: seen["messages"] for name, seen in summary["written"].items()}
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
    found = by_time(path, "/rtk/fix")
    assert [round(t_s, 3) for t_s, _ in found] == pytest.approx(FLIGHT.times(5), abs=1e-9)
    for t_s, message in found:
        state = FLIGHT.at(math.floor(t_s * 5) / 5)
        assert message.latitude == pytest.approx(state.latitude_deg, abs=POSITION_DEG)
        assert message.longitude == pytest.approx(state.longitude_deg, abs=POSITION_DEG)
        height_m = state.height_msl_m + PARAMETERS.undulation_m
        assert message.altitude == pytest.approx(height_m, abs=1e-9)
        assert message.status.status == 2
        assert message.position_covariance_type == 3
        assert message.position_covariance[0] > 0


def test_heading_is_the_baselines_less_its_offset(imported):
    path, _ = imported
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
    assert all(found == sorted(found) for found in times.values())
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
    """The fused position's height is a barometer's: it goes out as hardly known."""
    path, _ = imported
    for t_s, message in by_time(path, "/gps/fix"):
        state = FLIGHT.at(t_s)
        assert message.latitude == pytest.approx(state.latitude_deg, abs=POSITION_DEG)
        assert message.longitude == pytest.approx(state.longitude_deg, abs=POSITION_DEG)
        assert message.altitude == pytest.approx(150.0 + PARAMETERS.undulation_m, abs=1e-3)
        assert message.status.status == 0
        assert message.position_covariance[8] == pytest.approx(100.0**2)
