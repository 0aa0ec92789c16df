"""Describe the aids whose time stamps are out of the IMU's reach; most often two clocks differ."""

from __future__ import annotations

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.aid_status import PLACE
from tirgeo_ros.core.types.measurements import Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

#: Offsets observed longer ago than this are not reported.
_AGE_NS = 2_000_000_000
#: Offsets that differ by less than this are reported as one clock.
_SAME_NS = 500_000_000
#: A shorter lag is reported as a latency, a longer one as another clock.
_LONGEST_DELAY_NS = 5_000_000_000
#: GPS time minus UTC: the leap seconds since 1980 (unchanged since 2017).
_GPS_LESS_UTC_NS = 18_000_000_000

_OUT_OF_REACH = (Outcome.TOO_NEW, Outcome.TOO_OLD)


class ClockOffsets:
    """Record the aids that are refused for their time stamps, and describe them in ``text``."""

    def __init__(self, config: EkfConfig) -> None:
        self._max_delay_s = config.max_delay_s
        self._found: dict[Source, tuple[int, int]] = {}  # offset and IMU time

    def hear(self, verdict: Verdict, stamp_ns: int, imu_ns: int | None) -> None:
        """Take the verdict on an aiding sample of ``stamp_ns``.

        ``imu_ns`` is the newest IMU time stamp, or None before the first.
        """
        source = verdict.source
        if verdict.outcome not in _OUT_OF_REACH or imu_ns is None:
            if self._found:
                self._found.pop(source, None)
        elif stamp_ns > imu_ns or stamp_ns < imu_ns - self._max_delay_s * 1e9:
            self._found[source] = stamp_ns - imu_ns, imu_ns

    def text(self, imu_ns: int | None) -> str:
        """Return the topics out of reach at ``imu_ns``, with their offset and its likely cause.

        The string is empty where there are none. Topics with one offset share a phrase.
        """
        if not self._found or imu_ns is None:
            return ""
        recent = {s: off for s, (off, at) in self._found.items() if imu_ns - at <= _AGE_NS}
        phrases = []
        left = sorted(recent, key=PLACE.__getitem__)
        while left:
            offset_ns = recent[left[0]]
            alike = [s for s in left if abs(recent[s] - offset_ns) <= _SAME_NS]
            phrases.append(self._phrase([s.topic for s in alike], offset_ns))
            left = [s for s in left if s not in alike]
        return "; ".join(phrases)

    def _phrase(self, topics: list[str], offset_ns: int) -> str:
        off = f"{abs(offset_ns) * 1e-9:.1f} s {'ahead of' if offset_ns > 0 else 'behind'} imu/data"
        first, *others = topics
        too = f"; {', '.join(others)} too" if others else ""
        return f"{first} is {off}: {self._why(offset_ns)}{too}"

    def _why(self, offset_ns: int) -> str:
        if -_LONGEST_DELAY_NS < offset_ns < 0:
            return f"more than max_delay_s, {self._max_delay_s:g} s"
        if abs(abs(offset_ns) - _GPS_LESS_UTC_NS) <= 2 * _SAME_NS:
            return "same clock? (GPS time is 18 s ahead of UTC)"
        return "same clock?"
