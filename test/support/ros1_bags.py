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
"""ROS 1 bags of DJI's wrapper, written with rosbags, of a flight whose every value is known.

The aircraft flies straight and level at a constant speed while it turns about its vertical axis,
so that specific force and rate are constant. All is computed here from the axes that the wrapper
documents, with none of the product's conversions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr

GRAVITY = 9.80665
BEGUN_NS = 1_718_091_879_000_000_000
EARTH_M = 6_371_000.0


@dataclass
class State:
    """What is true at an instant."""

    stamp_ns: int
    latitude_deg: float
    longitude_deg: float
    height_msl_m: float
    heading_deg: float
    gimbal_rpy_deg: tuple[float, float, float]


@dataclass
class Flight:
    """The flight, and what the receivers' clocks and the recorder add to it."""

    duration_s: float = 6.0
    velocity_ned: tuple[float, float, float] = (4.0, -3.0, -0.5)
    turn_deg_s: float = 5.0
    baseline_deg: int = 90  # of the antennas, from the nose
    record_lag_ns: int = 2_000_000  # from a message's stamp to its record
    position_flag: int = 50
    yaw_flag: int = 50
    begun_ns: int = BEGUN_NS

    def at(self, t_s: float) -> State:
        north, east, down = (v * t_s for v in self.velocity_ned)
        latitude = 52.0116 + math.degrees(north / EARTH_M)
        longitude = 4.3575 + math.degrees(east / EARTH_M / math.cos(math.radians(52.0116)))
        heading = (75.0 + self.turn_deg_s * t_s) % 360.0
        stamp_ns = self.begun_ns + round(t_s * 1e9)
        gimbal = (1.5, -75.0 + t_s, math.remainder(heading + 3.0, 360.0))
        return State(stamp_ns, latitude, longitude, 28.25 - down, heading, gimbal)

    def times(self, rate_hz: float) -> list[float]:
        return [k / rate_hz for k in range(round(self.duration_s * rate_hz))]

    def yaw_deg(self, t_s: float) -> int:
        """The baseline's azimuth in whole degrees within a half turn, as an int16 has it."""
        return round(math.remainder(self.at(t_s).heading_deg + self.baseline_deg, 360.0))


@dataclass
class Bag:
    """Messages to be, each with its record time, topic and type."""

    store: object = field(default_factory=lambda: get_typestore(Stores.ROS1_NOETIC))
    messages: list[tuple[int, int, str, str, object]] = field(default_factory=list)
    seq: int = 0

    def new(self, typename: str, **fields):
        return self.store.types[typename](**fields)

    def header(self, stamp_ns: int, frame_id: str = ""):
        self.seq += 1
        stamp = self.new(
            "builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9
        )
        return self.new("std_msgs/msg/Header", seq=self.seq, stamp=stamp, frame_id=frame_id)

    def vector(self, x, y, z):
        return self.new("geometry_msgs/msg/Vector3", x=float(x), y=float(y), z=float(z))

    def stamped_vector(self, stamp_ns, xyz, frame_id=""):
        return self.new(
            "geometry_msgs/msg/Vector3Stamped",
            header=self.header(stamp_ns, frame_id),
            vector=self.vector(*xyz),
        )

    def fix(self, stamp_ns, latitude, longitude, altitude, frame_id=""):
        return self.new(
            "sensor_msgs/msg/NavSatFix",
            header=self.header(stamp_ns, frame_id),
            status=self.new("sensor_msgs/msg/NavSatStatus", status=0, service=0),
            latitude=latitude,
            longitude=longitude,
            altitude=altitude,
            position_covariance=np.zeros(9),
            position_covariance_type=0,
        )

    def imu(self, stamp_ns, q_wxyz, rate_flu, force_flu):
        return self.new(
            "sensor_msgs/msg/Imu",
            header=self.header(stamp_ns, "body_FLU"),
            orientation=self.quaternion(q_wxyz),
            orientation_covariance=np.zeros(9),
            angular_velocity=self.vector(*rate_flu),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=self.vector(*force_flu),
            linear_acceleration_covariance=np.zeros(9),
        )

    def quaternion(self, q_wxyz):
        w, x, y, z = map(float, q_wxyz)
        return self.new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def add(self, record_ns: int, topic: str, message) -> None:
        self.messages.append((record_ns, len(self.messages), topic, message.__msgtype__, message))

    def write(self, path, *, compression=None, chunk_bytes=1 << 16):
        writer = Writer(path)
        writer.chunk_threshold = chunk_bytes
        if compression is not None:
            writer.set_compression(compression)
        connections = {}
        with writer:
            for record_ns, _, topic, typename, message in sorted(
                self.messages, key=lambda m: m[:2]
            ):
                key = topic, typename
                if key not in connections:
                    connections[key] = writer.add_connection(topic, typename, typestore=self.store)
                data = self.store.serialize_ros1(message, typename)
                writer.write(connections[key], record_ns, data)
        return path


def enu_flu(heading_deg: float) -> tuple[float, float, float, float]:
    """Attitude of a level body FLU in ENU: a turn about up from east."""
    half = math.radians(90.0 - heading_deg) / 2
    return math.cos(half), 0.0, 0.0, math.sin(half)


def wrapper_bag(
    flight: Flight,
    *,
    prefix: str = "/dji_sdk",
    broadcast: bool = False,
    force_scale: float = 1.0,
) -> Bag:
    """What the wrapper since 3.3 publishes; ``broadcast`` is its other mode's gimbal."""
    bag = Bag()
    lag, rate = flight.record_lag_ns, math.radians(flight.turn_deg_s)
    north, east, down = flight.velocity_ned
    for t_s in flight.times(100):
        s = flight.at(t_s)
        q = enu_flu(s.heading_deg)
        force = (0.0, 0.0, GRAVITY * force_scale)
        bag.add(s.stamp_ns + lag, f"{prefix}/imu", bag.imu(s.stamp_ns, q, (0, 0, -rate), force))
        turned = bag.new(
            "geometry_msgs/msg/QuaternionStamped",
            header=bag.header(s.stamp_ns, "body_FLU"),
            quaternion=bag.quaternion(q),
        )
        bag.add(s.stamp_ns + lag, f"{prefix}/attitude", turned)
    for t_s in flight.times(50):
        s = flight.at(t_s)
        fused = bag.fix(s.stamp_ns, s.latitude_deg, s.longitude_deg, 150.0, "/gps")
        bag.add(s.stamp_ns + lag, f"{prefix}/gps_position", fused)
        enu = bag.stamped_vector(s.stamp_ns, (east, north, -down), "ground_ENU")
        bag.add(s.stamp_ns + lag, f"{prefix}/velocity", enu)
        roll, pitch, yaw = s.gimbal_rpy_deg
        first, second, frame = (roll, pitch, "ground_ENU") if broadcast else (pitch, roll, "")
        angles = bag.stamped_vector(s.stamp_ns, (first, second, yaw), frame)
        bag.add(s.stamp_ns + lag, f"{prefix}/gimbal_angle", angles)
    for t_s in flight.times(5):
        add_rtk(bag, flight, t_s, prefix)
    return bag


def add_rtk(bag: Bag, flight: Flight, t_s: float, prefix: str = "/dji_sdk") -> None:
    """One epoch; yaw and flags come without a header, some milliseconds later."""
    s, lag = flight.at(t_s), flight.record_lag_ns
    position = bag.fix(s.stamp_ns, s.latitude_deg, s.longitude_deg, s.height_msl_m)
    bag.add(s.stamp_ns + lag, f"{prefix}/rtk_position", position)
    ned = bag.stamped_vector(s.stamp_ns, flight.velocity_ned)
    bag.add(s.stamp_ns + lag + 100_000, f"{prefix}/rtk_velocity", ned)
    yaw = bag.new("std_msgs/msg/Int16", data=flight.yaw_deg(t_s))
    bag.add(s.stamp_ns + lag + 3_000_000, f"{prefix}/rtk_yaw", yaw)
    for name, flag in (("position", flight.position_flag), ("yaw", flight.yaw_flag)):
        message = bag.new("std_msgs/msg/UInt8", data=flag)
        bag.add(s.stamp_ns + lag + 5_000_000, f"{prefix}/rtk_info_{name}", message)


PARAMETERS = SimpleNamespace(undulation_m=43.2, baseline_deg=90.0)


def parameters_file(path, **more):
    """A parameter file for dji_node."""
    values = {
        "geoid_undulation_m": PARAMETERS.undulation_m,
        "aircraft.rtk_antenna_m": [0.0, 0.5, 0.3],
        "aircraft.second_antenna_m": [0.0, -0.5, 0.3],
        **more,
    }
    lines = "".join(f"    {name}: {value}\n" for name, value in values.items())
    path.write_text(f"dji_node:\n  ros__parameters:\n{lines}")
    return path


CDR = Cdr()
FLIGHT = Flight()


def messages(path, topic):
    """The messages of an imported bag."""
    return [CDR.deserialize(m.data, m.typename) for m in BagReader(path).messages([topic])]


def by_time(path, topic):
    """Seconds of the flight and message."""
    return [((convert.stamp_ns(m) - FLIGHT.begun_ns) * 1e-9, m) for m in messages(path, topic)]
