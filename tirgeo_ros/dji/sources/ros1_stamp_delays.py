"""Estimate the delays of the stamps in a ROS 1 bag against the recorder's clock.

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
#: Number of lags that decides whether stamps are of another clock than the recorder's.
_SURVEYED = 400
#: No recorder is that late: the stamps are of another clock.
_OTHER_CLOCK_NS = 1_000_000_000
_FOR_EVER_NS = 1 << 62


class StampSurvey:
    """Find the shift of a bag's stamps from its first messages."""

    def __init__(self) -> None:
        self._lags_ns: list[int] = []

    @property
    def is_full(self) -> bool:
        """Return whether it has seen enough."""
        return len(self._lags_ns) >= _SURVEYED

    def add(self, stamp_ns: int, record_ns: int) -> None:
        """Take a message's stamp and the time when it was recorded."""
        if stamp_ns:
            self._lags_ns.append(record_ns - stamp_ns)

    @property
    def shift_ns(self) -> int:
        """Return the recorder's time minus the stamps' time; 0 if both are of one clock.

        The clocks differ in a bag that was recorded again while an older one was played.
        """
        lag_ns = round(median(self._lags_ns)) if self._lags_ns else 0
        return lag_ns if abs(lag_ns) > _OTHER_CLOCK_NS else 0


class StampLags:
    """Track the smallest lag of each topic over a flight."""

    def __init__(self) -> None:
        self._lines: dict[str, _Line] = {}

    def add(self, topic: str, stamp_ns: int, arrival_ns: int) -> None:
        """Take a message's stamp and the time when it was recorded."""
        line = self._lines.get(topic)
        if line is None:
            line = self._lines[topic] = _Line(arrival_ns)
        line.add(arrival_ns - stamp_ns, arrival_ns)

    def warnings(self, imu: str, gimbal: str) -> list[str]:
        """Return the inconsistencies between the stamps of these two topics."""
        found, inertial, turning = [], self._lines.get(imu), self._lines.get(gimbal)
        if inertial is not None and abs(inertial.drift_ns) > _NOTABLE_NS:
            found.append(
                f"the stamps of {imu} drift by {inertial.drift_ns * 1e-6:+.0f} ms against the "
                "recorder's clock: the wrapper's align_time does not follow the aircraft's clock; "
                "gimbal and pictures come to be off by as much"
            )
        if inertial is not None and turning is not None:
            apart_ns = turning.least_ns - inertial.least_ns
            if abs(apart_ns) > _NOTABLE_NS:
                found.append(
                    f"the stamps of {gimbal} are {apart_ns * 1e-6:+.0f} ms later by the "
                    f"recorder's clock than those of {imu}: set delay.gimbal_s or delay.imu_s"
                )
        return found


class _Line:
    """Track the smallest lag of a topic: in all, in the first and in the newest whole stretch."""

    def __init__(self, begun_ns: int) -> None:
        self._begun_ns = begun_ns
        self._stretch_ns: int | None = None
        self._first_ns: int | None = None
        self._newest_ns = 0
        self.least_ns = _FOR_EVER_NS

    def add(self, lag_ns: int, arrival_ns: int) -> None:
        if not 0 <= arrival_ns - self._begun_ns < _STRETCH_NS:
            self._close()
            self._begun_ns = arrival_ns
        self._stretch_ns = lag_ns if self._stretch_ns is None else min(self._stretch_ns, lag_ns)
        self.least_ns = min(self.least_ns, lag_ns)

    def _close(self) -> None:
        if self._stretch_ns is not None:
            self._first_ns = self._stretch_ns if self._first_ns is None else self._first_ns
            self._newest_ns = self._stretch_ns
        self._stretch_ns = None

    @property
    def drift_ns(self) -> int:
        """Return by how much the lag has grown; 0 in short flights."""
        return 0 if self._first_ns is None else self._newest_ns - self._first_ns
