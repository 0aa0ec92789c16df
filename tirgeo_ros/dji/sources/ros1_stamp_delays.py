"""Compare the stamps in a ROS 1 bag with the recorder's clock.

The wrapper stamps a message when it receives it or, with ``align_time``, by the aircraft's clock.
It finds that clock's offset at the start and then keeps it, so the two clocks drift apart. The
gimbal's angles are stamped on reception in either case. The smallest lag between stamp and record
shows the difference.
"""

from __future__ import annotations

from statistics import median

#: Length of the stretches in which the smallest lag is found.
_STRETCH_NS = 10_000_000_000
#: More than the recorder's own delays; also a degree of a gimbal or an aircraft that turns.
_NOTABLE_NS = 20_000_000
#: No recorder is that late: the stamps are of another clock.
_OTHER_CLOCK_NS = 1_000_000_000


def clock_shift_ns(lags_ns: list[int]) -> int:
    """Return the recorder's time minus the stamps' time; 0 if both are of one clock.

    The clocks differ in a bag that was recorded again while an older one was played.
    """
    lag_ns = round(median(lags_ns)) if lags_ns else 0
    return lag_ns if abs(lag_ns) > _OTHER_CLOCK_NS else 0


class StampLags:
    """Track the smallest lag of each topic in each stretch of a flight."""

    def __init__(self) -> None:
        self._least_ns: dict[str, list[int]] = {}
        self._begun_ns: dict[str, int] = {}

    def add(self, topic: str, stamp_ns: int, arrival_ns: int) -> None:
        """Take a message's stamp and the time when it was recorded."""
        least_ns, lag_ns = self._least_ns.setdefault(topic, []), arrival_ns - stamp_ns
        if not least_ns or not 0 <= arrival_ns - self._begun_ns[topic] < _STRETCH_NS:
            least_ns.append(lag_ns)
            self._begun_ns[topic] = arrival_ns
        least_ns[-1] = min(least_ns[-1], lag_ns)

    def warnings(self, imu: str, gimbal: str) -> list[str]:
        """Return the inconsistencies between the stamps of these two topics."""
        found, inertial, turning = [], self._least_ns.get(imu), self._least_ns.get(gimbal)
        whole = inertial[:-1] if inertial else []  # without the stretch that has not ended
        drift_ns = whole[-1] - whole[0] if whole else 0
        if abs(drift_ns) > _NOTABLE_NS:
            found.append(
                f"the stamps of {imu} drift by {drift_ns * 1e-6:+.0f} ms against the "
                "recorder's clock: the wrapper's align_time does not follow the aircraft's clock; "
                "gimbal and pictures come to be off by as much"
            )
        if inertial and turning:
            apart_ns = min(turning) - min(inertial)
            if abs(apart_ns) > _NOTABLE_NS:
                found.append(
                    f"the stamps of {gimbal} are {apart_ns * 1e-6:+.0f} ms later by the "
                    f"recorder's clock than those of {imu}: set delay.gimbal_s or delay.imu_s"
                )
        return found
