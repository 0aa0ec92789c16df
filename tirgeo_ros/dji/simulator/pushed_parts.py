"""Build the parts of a broadcast and the topics of a push from the aircraft's state."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import cached_property
from typing import Any

from tirgeo_ros.core.frames.rotations import matrix_from_quat, slerp
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.dji.clocks.running_counter import LONG_TICK_NS
from tirgeo_ros.dji.interpret.accelerometer_unit import G_M_S2
from tirgeo_ros.dji.protocol import broadcast_parts as parts
from tirgeo_ros.dji.protocol.broadcast import Broadcast, Layout
from tirgeo_ros.dji.simulator.satellites import Satellites

#: Values that no flight records: in the air, position mode; sticks at rest; a lasting battery.
_STATUS = parts.Status(2, 6, 0, 0)
_RC = parts.Rc(0, 0, 0, 0, 8000, -4545)
_BATTERY = parts.Battery(5700, 24_600, -28_000, 80)
_DEVICE = parts.Device(6, 0)
_MAG = (210, -480, 1310)
_NOTHING_NEAR = parts.RelativePosition(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)
_LEVEL_FIVE = 5
_GIMBAL_WELL = 0x7801  # mounted; escs, drone data
_U32 = 0xFFFFFFFF


class Instant:
    """Hold the aircraft's state at one instant, in the units of its messages.

    ``time_ns``: of its clock; ``since_ns``: since it was switched on here.
    """

    def __init__(
        self,
        time_ns: int,
        since_ns: int,
        imu: ImuSample,
        gimbal: parts.Gimbal | None,
        satellites: Satellites,
    ) -> None:
        self.ms, self.rest_ns = time_ns // 1_000_000 & _U32, time_ns % 1_000_000
        self.ticks, self.tick_rest_ns = (
            time_ns // LONG_TICK_NS & _U32,
            time_ns % LONG_TICK_NS,
        )
        self.ticks_here = since_ns // LONG_TICK_NS & _U32
        self.q_nb = imu.autopilot_q_nb
        self.force_b, self.rate_b = imu.specific_force_b, imu.angular_rate_b
        self.gimbal = gimbal
        self._now_ns, self._satellites = imu.stamp_ns, satellites

    @cached_property
    def rtk(self) -> parts.Rtk:
        """Return the RTK receiver's data."""
        return self._satellites.rtk(self._now_ns)

    @cached_property
    def gps(self) -> parts.Gps:
        """Return the ordinary receiver's data."""
        return self._satellites.gps(self._now_ns)

    @cached_property
    def position(self) -> parts.Position:
        """Return the fused position."""
        return self._satellites.position(self._now_ns)

    @cached_property
    def velocity(self) -> parts.Velocity:
        """Return the fused velocity."""
        return self._satellites.velocity(self._now_ns)

    @property
    def quaternion(self) -> Any:
        """Return the attitude as wxyz, None if it is not known."""
        return None if self.q_nb is None else _numbers(self.q_nb)

    def over_ground(self, v_b: Array, up: int) -> Any:
        """Return a vector over ground, its third axis down (``up`` = 1) or up (-1)."""
        q = self.q_nb
        return None if q is None else _numbers(matrix_from_quat(q) @ v_b * (1, 1, up))


def between(before: ImuSample, after: ImuSample, stamp_ns: int) -> ImuSample:
    """Interpolate the inertial values linearly between two samples."""
    if stamp_ns == after.stamp_ns:
        return after
    fraction = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
    q, p = before.autopilot_q_nb, after.autopilot_q_nb
    return ImuSample(
        stamp_ns,
        before.specific_force_b + fraction * (after.specific_force_b - before.specific_force_b),
        before.angular_rate_b + fraction * (after.angular_rate_b - before.angular_rate_b),
        None if q is None or p is None else slerp(q, p, fraction),
    )


def broadcast_of(instant: Instant, layout: Layout, due: Collection[int]) -> Broadcast:
    """Return the broadcast of an instant with the parts whose bits of the mask are due."""
    modern = layout is Layout.MODERN
    found = {
        name: make(instant)
        for bit, name, make in _PARTS
        if bit in due and (modern or name not in {"relative_position", "compass"})
    }
    return Broadcast(layout, **(found if modern else {n: _old(part) for n, part in found.items()}))


def _old(part: Any) -> Any:
    """Return a part in the form of the old layout."""
    if isinstance(part, parts.Time):
        return parts.Time(part.time_ms, part.time_ns, None, None, part.sync_flag)
    if isinstance(part, parts.Status):
        return parts.Status(part.flight)
    if isinstance(part, parts.Battery):
        return parts.Battery(None, None, None, part.percentage)
    return part._replace(detail=None) if isinstance(part, parts.Gps) else part


def topic_values(instant: Instant, names: tuple[str, ...]) -> dict[str, Any] | None:
    """Return the values of a package's topics; None where one of them is not known yet."""
    found = {name: _TOPICS[name](instant) for name in names}
    return None if any(value is None for value in found.values()) else found


def _numbers(v: Array) -> Any:
    """Return a vector or quaternion as a tuple."""
    return tuple(v.tolist())


def _hard_sync(i: Instant) -> parts.HardSync | None:
    if i.q_nb is None:
        return None
    force_g, rate = _numbers(i.force_b / G_M_S2), _numbers(i.rate_b)
    return parts.HardSync(i.ticks, i.tick_rest_ns, i.ticks_here, 0, 0, i.quaternion, force_g, rate)


def _gps_fused(i: Instant) -> parts.GpsFused:
    satellites = i.gps.detail.nsv if i.gps.detail else 0
    return parts.GpsFused(
        i.position.lon_rad, i.position.lat_rad, i.position.altitude_m, satellites
    )


_Make = Callable[[Instant], Any]

#: Bit of the mask, name in ``Broadcast``, and how the part is made.
_PARTS: tuple[tuple[int, str, _Make], ...] = (
    (0, "time", lambda i: parts.Time(i.ms, i.rest_ns, i.ticks, 0, 0)),
    (1, "quaternion_wxyz", lambda i: i.quaternion),
    (2, "acceleration_as_packed", lambda i: _numbers(i.force_b / G_M_S2)),
    (3, "velocity", lambda i: i.velocity),
    (4, "angular_rate_radps", lambda i: _numbers(i.rate_b)),
    (5, "position", lambda i: i.position),
    (5, "relative_position", lambda _: _NOTHING_NEAR),
    (6, "gps", lambda i: i.gps),
    (7, "rtk", lambda i: i.rtk),
    (8, "mag", lambda _: _MAG),
    (9, "rc", lambda _: _RC),
    (10, "gimbal", lambda i: i.gimbal),
    (11, "status", lambda _: _STATUS),
    (12, "battery", lambda _: _BATTERY),
    (13, "device", lambda _: _DEVICE),
    (14, "compass", lambda _: 0),
)

_TOPICS: dict[str, _Make] = {
    "QUATERNION": lambda i: i.quaternion,
    "ACCELERATION_GROUND": lambda i: i.over_ground(i.force_b, -1),
    "ACCELERATION_BODY": lambda i: _numbers(i.force_b * (1, 1, -1)),
    "ACCELERATION_RAW": lambda i: _numbers(i.force_b),
    "VELOCITY": lambda i: i.velocity,
    "ANGULAR_RATE_FUSIONED": lambda i: i.over_ground(i.rate_b, 1),
    "ANGULAR_RATE_RAW": lambda i: _numbers(i.rate_b),
    "ALTITUDE_FUSIONED": lambda i: i.position.altitude_m,
    "HEIGHT_FUSION": lambda i: i.position.height_m,
    "GPS_FUSED": _gps_fused,
    "GPS_DATE": lambda i: i.gps.date,
    "GPS_TIME": lambda i: i.gps.time,
    "GPS_POSITION": lambda i: parts.GpsPosition(i.gps.lon_1e7, i.gps.lat_1e7, i.gps.hfsl_mm),
    "GPS_VELOCITY": lambda i: i.gps.vel_ned_cmps,
    "GPS_DETAILS": lambda i: i.gps.detail,
    "RTK_POSITION": lambda i: parts.RtkPosition(i.rtk.lon_deg, i.rtk.lat_deg, i.rtk.hfsl_m),
    "RTK_VELOCITY": lambda i: i.rtk.vel_cmps,
    "RTK_YAW": lambda i: i.rtk.yaw_deg,
    "RTK_POSITION_INFO": lambda i: i.rtk.pos_flag,
    "RTK_YAW_INFO": lambda i: i.rtk.yaw_flag,
    "RC": lambda _: _RC,
    "GIMBAL_ANGLES": lambda i: i.gimbal and parts.GimbalAngles(*(i.gimbal[k] for k in (1, 0, 2))),
    "GIMBAL_STATUS": lambda _: _GIMBAL_WELL,
    "STATUS_FLIGHT": lambda _: _STATUS.flight,
    "STATUS_DISPLAYMODE": lambda _: _STATUS.mode,
    "BATTERY_INFO": lambda _: _BATTERY,
    "HARD_SYNC": _hard_sync,
    "GPS_CONTROL_LEVEL": lambda _: _LEVEL_FIVE,
}

#: Topics that can be subscribed to; firmware 3.2.41 lacks some that others have.
TOLD_TOPICS = frozenset(_TOPICS)
