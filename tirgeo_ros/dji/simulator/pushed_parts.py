"""Build the parts of a broadcast and the topics of a push from the aircraft's state."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any, NamedTuple

from tirgeo_ros.core.frames.rotations import matrix_from_quat, slerp
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.dji.interpret.accelerometer_unit import G_M_S2
from tirgeo_ros.dji.protocol.broadcast import Broadcast, Layout
from tirgeo_ros.dji.protocol.broadcast_parts import (
    SYNC_TICK_NS,
    Battery,
    Device,
    Gimbal,
    GimbalAngles,
    Gps,
    GpsFused,
    GpsPosition,
    HardSync,
    Rc,
    RelativePosition,
    RtkPosition,
    Status,
    Time,
)
from tirgeo_ros.dji.simulator.satellites import Satellites

#: Values that no flight records: in the air, position mode; sticks at rest; a lasting battery.
_STATUS = Status(2, 6, 0, 0)
_RC = Rc(0, 0, 0, 0, 8000, -4545)
_BATTERY = Battery(5700, 24_600, -28_000, 80)
_DEVICE = Device(6, 0)
_MAG = (210, -480, 1310)
_NOTHING_NEAR = RelativePosition(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)
_LEVEL_FIVE = 5
_GIMBAL_WELL = 0x7801  # mounted; escs, drone data


class AircraftTime(NamedTuple):
    """Hold a time of the aircraft's clock, since power-up."""

    total_ns: int

    @property
    def ms(self) -> int:
        """Return it in ms as 32 bits, which wrap after 49.7 days."""
        return self.total_ns // 1_000_000 & 0xFFFFFFFF

    @property
    def rest_ns(self) -> int:
        """Return the nanoseconds since that millisecond."""
        return self.total_ns % 1_000_000

    @property
    def ticks(self) -> int:
        """Return it in ticks of 2.5 ms, as 32 bits."""
        return self.total_ns // SYNC_TICK_NS & 0xFFFFFFFF


class Instant(NamedTuple):
    """Hold the aircraft's state at one instant."""

    time: AircraftTime
    since_start: AircraftTime  # since it was switched on here
    imu: ImuSample
    gimbal: Gimbal | None
    satellites: Satellites

    @property
    def now_ns(self) -> int:
        """Return the flight's time."""
        return self.imu.stamp_ns


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


_Make = Callable[[Instant], Any]


def broadcast_of(instant: Instant, layout: Layout, due: Collection[int]) -> Broadcast:
    """Return the broadcast of an instant with the parts whose bits of the mask are due."""
    modern = layout is Layout.MODERN
    found = {
        name: make(instant)
        for bit, name, make in _PARTS
        if bit in due and (modern or name not in {"relative_position", "compass"})
    }
    if not modern:
        found = {name: _old(part) for name, part in found.items()}
    return Broadcast(layout, **found)


def _old(part: Any) -> Any:
    """Return a part in the form of the old layout."""
    if isinstance(part, Time):
        return Time(part.time_ms, part.time_ns, None, None, part.sync_flag)
    if isinstance(part, Status):
        return Status(part.flight)
    if isinstance(part, Battery):
        return Battery(None, None, None, part.percentage)
    return part._replace(detail=None) if isinstance(part, Gps) else part


def topic_values(instant: Instant, names: tuple[str, ...]) -> dict[str, Any] | None:
    """Return the values of a package's topics; None where one of them is not known yet."""
    found = {name: _TOPICS[name](instant) for name in names}
    return None if any(value is None for value in found.values()) else found


def _numbers(v: Array | None) -> Any:
    """Return a vector or quaternion as a tuple."""
    return None if v is None else tuple(v.tolist())


def _quaternion(i: Instant) -> Any:
    return _numbers(i.imu.autopilot_q_nb)


def _force_g(i: Instant) -> Any:
    return _numbers(i.imu.specific_force_b / G_M_S2)


def _rate(i: Instant) -> Any:
    return _numbers(i.imu.angular_rate_b)


def _over_ground(i: Instant, v_b: Array, up: int) -> Any:
    """Return a vector over ground, its third axis down (``up`` = 1) or up (-1)."""
    q = i.imu.autopilot_q_nb
    return None if q is None else _numbers(matrix_from_quat(q) @ v_b * (1, 1, up))


def _hard_sync(i: Instant) -> HardSync | None:
    q = _quaternion(i)
    if q is None:
        return None
    rest_ns = i.time.total_ns % SYNC_TICK_NS
    ticks = i.since_start.ticks
    return HardSync(i.time.ticks, rest_ns, ticks, 0, 0, q, _force_g(i), _rate(i))


def _gimbal_angles(i: Instant) -> GimbalAngles | None:
    if i.gimbal is None:
        return None
    return GimbalAngles(i.gimbal.pitch_deg, i.gimbal.roll_deg, i.gimbal.yaw_deg)


def _gps_fused(i: Instant) -> GpsFused:
    place = i.satellites.position(i.now_ns)
    detail = i.satellites.gps(i.now_ns).detail
    return GpsFused(place.lon_rad, place.lat_rad, place.altitude_m, detail.nsv if detail else 0)


def _always(value: Any) -> Callable[[Instant], Any]:
    return lambda _: value


def _received(part: str, *names: str, make: Callable[..., Any] | None = None) -> _Make:
    """Return what reads a receiver's part: the whole, a field, or what ``make`` makes of some."""

    def read(i: Instant) -> Any:
        whole = getattr(i.satellites, part)(i.now_ns)
        fields = [getattr(whole, name) for name in names]
        return make(*fields) if make else fields[0] if fields else whole

    return read


#: Bit of the mask, name in ``Broadcast``, and how the part is made.
_PARTS: tuple[tuple[int, str, _Make], ...] = (
    (0, "time", lambda i: Time(i.time.ms, i.time.rest_ns, i.time.ticks, 0, 0)),
    (1, "quaternion_wxyz", _quaternion),
    (2, "acceleration_as_packed", _force_g),
    (3, "velocity", _received("velocity")),
    (4, "angular_rate_radps", _rate),
    (5, "position", _received("position")),
    (5, "relative_position", _always(_NOTHING_NEAR)),
    (6, "gps", _received("gps")),
    (7, "rtk", _received("rtk")),
    (8, "mag", _always(_MAG)),
    (9, "rc", _always(_RC)),
    (10, "gimbal", lambda i: i.gimbal),
    (11, "status", _always(_STATUS)),
    (12, "battery", _always(_BATTERY)),
    (13, "device", _always(_DEVICE)),
    (14, "compass", _always(0)),
)

_TOPICS: dict[str, _Make] = {
    "QUATERNION": _quaternion,
    "ACCELERATION_GROUND": lambda i: _over_ground(i, i.imu.specific_force_b, -1),
    "ACCELERATION_BODY": lambda i: _numbers(i.imu.specific_force_b * (1, 1, -1)),
    "ACCELERATION_RAW": lambda i: _numbers(i.imu.specific_force_b),
    "VELOCITY": _received("velocity"),
    "ANGULAR_RATE_FUSIONED": lambda i: _over_ground(i, i.imu.angular_rate_b, 1),
    "ANGULAR_RATE_RAW": _rate,
    "ALTITUDE_FUSIONED": _received("position", "altitude_m"),
    "ALTITUDE_BAROMETER": _received("position", "altitude_m"),
    "HEIGHT_FUSION": _received("position", "height_m"),
    "GPS_FUSED": _gps_fused,
    "GPS_DATE": _received("gps", "date"),
    "GPS_TIME": _received("gps", "time"),
    "GPS_POSITION": _received("gps", "lon_1e7", "lat_1e7", "hfsl_mm", make=GpsPosition),
    "GPS_VELOCITY": _received("gps", "vel_ned_cmps"),
    "GPS_DETAILS": _received("gps", "detail"),
    "RTK_POSITION": _received("rtk", "lon_deg", "lat_deg", "hfsl_m", make=RtkPosition),
    "RTK_VELOCITY": _received("rtk", "vel_cmps"),
    "RTK_YAW": _received("rtk", "yaw_deg"),
    "RTK_POSITION_INFO": _received("rtk", "pos_flag"),
    "RTK_YAW_INFO": _received("rtk", "yaw_flag"),
    "COMPASS": _always(_MAG),
    "RC": _always(_RC),
    "GIMBAL_ANGLES": _gimbal_angles,
    "GIMBAL_STATUS": _always(_GIMBAL_WELL),
    "STATUS_FLIGHT": _always(_STATUS.flight),
    "STATUS_DISPLAYMODE": _always(_STATUS.mode),
    "BATTERY_INFO": _always(_BATTERY),
    "HARD_SYNC": _hard_sync,
    "GPS_CONTROL_LEVEL": _always(_LEVEL_FIVE),
    "GPS_SIGNAL_LEVEL": _always(_LEVEL_FIVE),
}

#: Topics that can be subscribed to; firmware 3.2.41 lacks some that others have.
TOLD_TOPICS = frozenset(_TOPICS)
