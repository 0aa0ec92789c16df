"""Read the topics of psdk_ros2: values in with their times, readings out.

psdk_ros2 stamps a message when its node receives it. For streams of a steady rate the jitter is
removed from that stamp. A receiver's messages keep it: their delay is a parameter, and the jitter
does no harm.
"""

from __future__ import annotations

from collections import Counter
from typing import Any

from tirgeo_ros.dji.clocks.steady_stamps import SteadyStamps
from tirgeo_ros.dji.sources.psdk_messages import READERS
from tirgeo_ros.dji.sources.readings import Reading, RtkReading
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


#: Topics of a fused value -> the receiver's own, in whose place it stands.
_FUSED = {"gps_position_fused": "gps_position", "velocity_ground_fused": "gps_velocity"}
_FLAGS = {"rtk_position_info": "position_flag", "rtk_yaw_info": "yaw_flag"}
#: The flag that each of RTK's values waits for; the velocity's is the position's.
_FLAG_OF = {
    "rtk_position": "position_flag",
    "rtk_velocity": "position_flag",
    "rtk_yaw": "yaw_flag",
}


class PsdkDecoder:
    """Convert the topics' values to readings, which have the stamp of the header.

    ``take`` and ``due`` return the readings that are complete; ``due`` must be called for those
    that wait. Stamps and arrivals are of one clock.
    """

    def __init__(self) -> None:
        self._steady = {topic: SteadyStamps() for topic in ("imu", "attitude", "gimbal_angles")}
        self._pairs = {name: EpochFlags(name) for name in ("position_flag", "yaw_flag")}
        self._stand_ins = {own: _StandIn() for own in _FUSED.values()}
        self._gimbal_ns: int | None = None  # the newest stamp
        self._gimbal_step_ns = 0.0  # interval between two stamps, smoothed
        self._counts: Counter[str] = Counter()

    def take(self, topic: str, values: Any, stamp_ns: int, arrival_ns: int) -> list[Reading]:
        """Take a message: its values, its header's stamp (0: none) and its arrival.

        ``values`` by ``topic``: ``attitude`` a quaternion wxyz; ``imu`` that, rate (rad/s) and
        specific force; ``gimbal_angles`` rad; positions latitude, longitude (deg), height above
        the sea (m); velocities m/s; ``gps_details`` fix and (horizontal, vertical (mm), speed
        (cm/s)) accuracy; ``rtk_yaw`` the uint16; ``rtk_..._info`` the flag, without a header.
        """
        if topic in _FLAGS:
            return [*self._pairs[_FLAGS[topic]].flag(values, arrival_ns)]
        if topic in self._stand_ins:
            self._stand_ins[topic].own_came(arrival_ns)
        if topic in _FUSED:
            if not self._stand_ins[_FUSED[topic]].is_wanted(arrival_ns):
                return []
            self._counts["fused"] += 1
        if not stamp_ns:
            self._counts["unstamped"] += 1
            stamp_ns = arrival_ns
        if topic == "gimbal_angles":
            self._note_gimbal(stamp_ns)
        if topic in self._steady:
            stamp_ns = self._steady[topic].stamp_ns(stamp_ns)
        reading = READERS[topic](stamp_ns, values)
        if isinstance(reading, RtkReading):
            return [*self._pairs[_FLAG_OF[topic]].value(topic, reading, arrival_ns)]
        return [reading]

    @property
    def counts(self) -> dict[str, int]:
        """Return counts that are worth knowing.

        ``unstamped``: messages without a stamp; ``fused``: fused values in place of the GPS's;
        ``rtk_..._alone``: values of RTK whose own flag did not come.
        """
        alone = sum((pairs.alone for pairs in self._pairs.values()), Counter())
        return dict(self._counts) | {f"{topic}_alone": number for topic, number in alone.items()}

    @property
    def warnings(self) -> list[str]:
        """Return what a person should set right."""
        return [_SLOW_GIMBAL] if self._gimbal_step_ns > _SLOW_GIMBAL_NS else []

    def due(self, now_ns: int) -> list[Reading]:
        """Return the readings that have waited long enough; to be called every 10 ms."""
        return [reading for pairs in self._pairs.values() for reading in pairs.due(now_ns)]

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
