"""dji_node on a port with an aircraft that hovers: values, times, a cable that is pulled."""

from __future__ import annotations

import math
import time

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")
pytest.importorskip("serial", reason="needs pyserial")

from aircraft_on_port import HEADING_RAD, HEIGHT_M, LATITUDE_RAD, PITCH_RAD, AircraftOnPort
from geometry_msgs.msg import QuaternionStamped
from graph_helpers import await_words
from sensor_msgs.msg import Imu, JointState, NavSatFix

from tirgeo_ros.core.frames.rotations import euler_from_quat
from tirgeo_ros.io.messages import camera_attitude, decode, imu_sample, joint_sample
from tirgeo_ros.io.messages import stamp_ns as stamp_of

pytestmark = pytest.mark.graph


def test_an_aircraft_on_a_port_becomes_topics_and_comes_back_after_a_pull(spawn, meet, tmp_path):
    stranger = meet(
        imu__data=Imu,
        rtk__fix=NavSatFix,
        rtk__heading=Imu,
        gimbal__attitude=QuaternionStamped,
        gimbal__joint_states=JointState,
    )
    received = stranger.received
    with AircraftOnPort(tmp_path / "aircraft") as aircraft:
        node = spawn(
            "dji_node", "-p", f"port:={tmp_path / 'aircraft'}", "-p", "geoid_undulation_m:=0.0"
        )
        stranger.spin_until(
            lambda: len(received["rtk/fix"]) >= 5 and len(received["imu/data"]) > 50
        )
        age_s = time.time() - stamp_of(received["imu/data"][-1]) * 1e-9
        assert -0.1 < age_s < 5.0  # of now, in the host's clock; the machine may be busy

        assert imu_sample(received["imu/data"][-1]).specific_force_b[2] == pytest.approx(-9.81)
        fix = received["rtk/fix"][-1]
        assert fix.latitude == pytest.approx(math.degrees(LATITUDE_RAD), abs=1e-9)
        assert fix.altitude == pytest.approx(HEIGHT_M, abs=0.1)
        assert fix.status.status == 2
        # The baseline in whole degrees: half of one.
        heading = decode.heading_sample(received["rtk/heading"][-1]).heading_rad
        assert heading == pytest.approx(HEADING_RAD, abs=math.radians(0.5))
        joints = joint_sample(received["gimbal/joint_states"][-1])
        assert joints.pitch_rad == pytest.approx(PITCH_RAD, abs=1e-5)
        camera = euler_from_quat(camera_attitude(received["gimbal/attitude"][-1]).q_ng)
        # Angles of single precision, and the quaternion of the message.
        assert camera == pytest.approx([0.0, PITCH_RAD, HEADING_RAD], abs=1e-6)

        aircraft.pull()
        await_words(node, "the port is gone")
        aircraft.plug()
        count = len(received["imu/data"])
        stranger.spin_until(lambda: len(received["imu/data"]) > count + 100)
        assert node.poll() is None
