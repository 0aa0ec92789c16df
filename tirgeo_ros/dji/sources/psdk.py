"""Read the topics of psdk_ros2: values in with their times, readings out.

psdk_ros2 stamps a message when its node receives it. For streams of a steady rate the jitter is
removed from that stamp. A receiver's messages keep it: their delay is a parameter, and the jitter
does no harm.
"""

from __future__ import annotations

from collections import Counter

from tirgeo_ros.dji.clocks.steady_stamps import SteadyStamps
from tirgeo_ros.dji.sources import psdk_messages as psdk
from tirgeo_ros.dji.sources.readings import GpsReading, Quaternion, Reading, RtkReading, Vector
from tirgeo_ros.dji.sources.rtk_flag_pairing import EpochFlags

_SECOND_NS = 1_000_000_000
#: If the receiver's own topic is silent for longer, the fused values replace it.
_SILENT_NS = 2 * _SECOND_NS
#: They replace it at about the receiver's 5 Hz, not at their own 10 to 200 Hz: their errors are
#: correlated in time.
_STAND_IN_NS = 150_000_000
#: A gimbal that reports less often may have turned in between.
_SLOW_GIMBAL_NS = 400_000_000
_SLOW_GIMBAL = (
    "gimbal_angles come too seldom for a camera that turns: set data_frequency.gimbal_data to 50 "
    "in the parameters of psdk_ros2"
)


class PsdkDecoder:
    """Provide a method for each topic: its values, its header's stamp (0: none), its arrival.

    Each returns the readings that are complete; ``due`` must be called for those that wait. Stamps
    and arrivals are of one clock.
    """

    def __init__(self) -> None:
        self._imu, self._attitude, self._gimbal = SteadyStamps(), SteadyStamps(), SteadyStamps()
        self._positions, self._yaws = EpochFlags("position_flag"), EpochFlags("yaw_flag")
        self._fused_place, self._fused_velocity = _StandIn(), _StandIn()
        self._gimbal_ns: int | None = None  # the newest stamp
        self._gimbal_step_ns = 0.0  # interval between two stamps, smoothed
        self._counts: Counter[str] = Counter()

    @property
    def counts(self) -> dict[str, int]:
        """Return counts that are worth knowing.

        ``unstamped``: messages without a stamp; ``fused``: fused values in place of the GPS's;
        ``rtk_..._alone``: values of RTK whose own flag did not come.
        """
        alone = self._positions.alone + self._yaws.alone
        return dict(self._counts) | {f"{topic}_alone": number for topic, number in alone.items()}

    @property
    def warnings(self) -> list[str]:
        """Return what a person should set right."""
        return [_SLOW_GIMBAL] if self._gimbal_step_ns > _SLOW_GIMBAL_NS else []

    def due(self, now_ns: int) -> list[Reading]:
        """Return the readings that have waited long enough; to be called every 10 ms."""
        return [*self._positions.due(now_ns), *self._yaws.due(now_ns)]

    def on_attitude(self, q_wxyz: Quaternion, stamp_ns: int, arrival_ns: int) -> list[Reading]:
        """Take ``attitude``: FLU to ENU."""
        stamp_ns = self._attitude.stamp_ns(self._stamp(stamp_ns, arrival_ns))
        return [psdk.attitude(stamp_ns, q_wxyz)]

    def on_imu(
        self, values: tuple[Quaternion, Vector, Vector], stamp_ns: int, arrival_ns: int
    ) -> list[Reading]:
        """Take ``imu``: attitude, rate (rad/s), specific force."""
        stamp_ns = self._imu.stamp_ns(self._stamp(stamp_ns, arrival_ns))
        return [psdk.imu(stamp_ns, *values)]

    def on_gimbal_angles(self, xyz_rad: Vector, stamp_ns: int, arrival_ns: int) -> list[Reading]:
        """Take ``gimbal_angles`` (rad)."""
        stamp_ns = self._stamp(stamp_ns, arrival_ns)
        self._note_gimbal(stamp_ns)
        return [psdk.gimbal(self._gimbal.stamp_ns(stamp_ns), xyz_rad)]

    def on_gps_position(self, values: Vector, stamp_ns: int, arrival_ns: int) -> list[Reading]:
        """Take ``gps_position``: latitude, longitude (deg), height above the sea (m)."""
        self._fused_place.own_came(arrival_ns)
        return [GpsReading(self._stamp(stamp_ns, arrival_ns), psdk.place(values))]

    def on_gps_velocity(self, ned_m_s: Vector, stamp_ns: int, arrival_ns: int) -> list[Reading]:
        """Take ``gps_velocity`` (NED, m/s)."""
        self._fused_velocity.own_came(arrival_ns)
        return [GpsReading(self._stamp(stamp_ns, arrival_ns), velocity_n=ned_m_s)]

    def on_gps_details(
        self, values: tuple[float, Vector], stamp_ns: int, arrival_ns: int
    ) -> list[Reading]:
        """Take ``gps_details``: fix; horizontal and vertical (mm) and speed accuracy (cm/s)."""
        return [psdk.gps_details(self._stamp(stamp_ns, arrival_ns), *values)]

    def on_gps_position_fused(
        self, values: Vector, stamp_ns: int, arrival_ns: int
    ) -> list[Reading]:
        """Take ``gps_position_fused``, the replacement of ``gps_position``."""
        if not self._fused_place.is_wanted(arrival_ns):
            return []
        self._counts["fused"] += 1
        return [psdk.fused_position(self._stamp(stamp_ns, arrival_ns), values)]

    def on_velocity_ground_fused(
        self, enu_m_s: Vector, stamp_ns: int, arrival_ns: int
    ) -> list[Reading]:
        """Take ``velocity_ground_fused``, the replacement of ``gps_velocity``."""
        if not self._fused_velocity.is_wanted(arrival_ns):
            return []
        self._counts["fused"] += 1
        stamp_ns = self._stamp(stamp_ns, arrival_ns)
        return [GpsReading(stamp_ns, velocity_n=psdk.velocity_enu(enu_m_s))]

    def on_rtk_position(self, values: Vector, stamp_ns: int, arrival_ns: int) -> list[Reading]:
        """Take ``rtk_position`` as ``gps_position``; it waits for its flag."""
        reading = RtkReading(self._stamp(stamp_ns, arrival_ns), place=psdk.place(values))
        return [*self._positions.value("rtk_position", reading, arrival_ns)]

    def on_rtk_velocity(self, ned_m_s: Vector, stamp_ns: int, arrival_ns: int) -> list[Reading]:
        """Take ``rtk_velocity``; it waits for its flag, which is the position's."""
        reading = RtkReading(self._stamp(stamp_ns, arrival_ns), velocity_n=ned_m_s)
        return [*self._positions.value("rtk_velocity", reading, arrival_ns)]

    def on_rtk_yaw(self, yaw: int, stamp_ns: int, arrival_ns: int) -> list[Reading]:
        """Take ``rtk_yaw``: the uint16; it waits for its flag."""
        yaw_deg = psdk.baseline_yaw_deg(yaw)
        reading = RtkReading(self._stamp(stamp_ns, arrival_ns), yaw_deg=yaw_deg)
        return [*self._yaws.value("rtk_yaw", reading, arrival_ns)]

    def on_rtk_position_info(self, flag: int, arrival_ns: int) -> list[Reading]:
        """Take ``rtk_position_info``, which has no header."""
        return [*self._positions.flag(flag, arrival_ns)]

    def on_rtk_yaw_info(self, flag: int, arrival_ns: int) -> list[Reading]:
        """Take ``rtk_yaw_info``, which has no header."""
        return [*self._yaws.flag(flag, arrival_ns)]

    def _stamp(self, stamp_ns: int, arrival_ns: int) -> int:
        if stamp_ns:
            return stamp_ns
        self._counts["unstamped"] += 1
        return arrival_ns

    def _note_gimbal(self, stamp_ns: int) -> None:
        if self._gimbal_ns is not None and stamp_ns > self._gimbal_ns:
            step_ns = stamp_ns - self._gimbal_ns
            smooth_ns = self._gimbal_step_ns or step_ns
            self._gimbal_step_ns = smooth_ns + 0.25 * (step_ns - smooth_ns)
        self._gimbal_ns = stamp_ns


class _StandIn:
    """Decide whether a fused value is needed in place of the receiver's own."""

    def __init__(self) -> None:
        self._own_ns: int | None = None
        self._last_ns = 0

    def own_came(self, arrival_ns: int) -> None:
        self._own_ns = arrival_ns

    def is_wanted(self, arrival_ns: int) -> bool:
        if self._own_ns is None:
            self._own_ns = arrival_ns  # the own topic gets the full time-out from here
        if abs(arrival_ns - self._own_ns) < _SILENT_NS:
            return False
        if abs(arrival_ns - self._last_ns) < _STAND_IN_NS:
            return False
        self._last_ns = arrival_ns
        return True
