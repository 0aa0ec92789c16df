"""Samples in the order of their stamps, however late each of them arrives.

What an alignment decides must not depend on how busy the computer is. Until the filter runs nobody
waits for a pose, so samples are held until all that may still come before them has come.
"""

from __future__ import annotations

import bisect
import math
from collections import defaultdict

from tirgeo_ros.core.navigation.aiding.aid_status import PLACE
from tirgeo_ros.core.navigation.aiding.filter_state import source_of
from tirgeo_ros.core.types.measurements import ImuSample, NavigationInput, Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

#: Samples of a source that are held for each second, by which a flood of them is bounded.
_MOST_HZ = {Source.IMU: 1000}
_MOST_OTHER_HZ = 100
_PLACE = {Source.IMU: -1, **PLACE}  # within an instant: the IMU before the measurements
_Entry = tuple[int, int, int, NavigationInput]  # stamp, place within the instant, number


class StampOrder:
    """Holds each sample until the IMU is ``wait_s`` beyond its stamp.

    A measurement may be ``hold_s`` ahead of the IMU and ``keep_s`` behind it, once there is an
    IMU to judge by. Where more samples of a source come than are kept, its oldest are given up.
    """

    def __init__(self, wait_s: float, hold_s: float, keep_s: float) -> None:
        self._wait_ns = round(wait_s * 1e9)
        self._hold_ns = round(hold_s * 1e9)
        self._keep_ns = round(keep_s * 1e9)
        self._span_s = wait_s + hold_s
        self._held: defaultdict[Source, list[_Entry]] = defaultdict(list)  # each in order
        self._given_up: list[Verdict] = []
        self._number = 0
        self._imu_ns: int | None = None

    def out_of_reach(self, stamp_ns: int) -> tuple[Outcome, str] | None:
        """Why a measurement of that time cannot be taken, and by how much; None if it can."""
        if self._imu_ns is None:
            return None
        ahead_ns = stamp_ns - self._imu_ns
        if -self._keep_ns <= ahead_ns <= self._hold_ns:
            return None
        outcome = Outcome.TOO_NEW if ahead_ns > 0 else Outcome.TOO_OLD
        return outcome, f"{ahead_ns * 1e-9:+.1f} s from imu/data"

    def given_up(self) -> list[Verdict]:
        """The verdicts on samples that were held and will not come out, each once."""
        found, self._given_up = self._given_up, []
        return found

    def add(self, sample: NavigationInput) -> list[NavigationInput]:
        """Take a sample; gives those that are due, oldest first."""
        source = Source.IMU if isinstance(sample, ImuSample) else source_of(sample)
        self._number += 1
        held = self._held[source]
        bisect.insort(held, (sample.stamp_ns, _PLACE[source], self._number, sample))
        most = math.ceil(self._span_s * _MOST_HZ.get(source, _MOST_OTHER_HZ))
        if len(held) > most:
            del held[0]
            reason = f"{most} newer ones wait for imu/data"
            self._given_up.append(Verdict(source, Outcome.TOO_MANY, reason))
        if source is Source.IMU:
            begins, self._imu_ns = self._imu_ns is None, sample.stamp_ns
            if begins:
                self._judge()
        return [] if self._imu_ns is None else self._taken(self._imu_ns - self._wait_ns)

    def rest(self) -> list[NavigationInput]:
        """All that is held, oldest first; nothing is held after it."""
        return self._taken(math.inf)

    def _judge(self) -> None:
        """Give up what came before there was an IMU to judge by, and is out of its reach."""
        for source, held in self._held.items():
            judged = [(entry, self.out_of_reach(entry[0])) for entry in held]
            held[:] = [entry for entry, far in judged if far is None]
            self._given_up += [Verdict(source, *far) for _, far in judged if far is not None]

    def _taken(self, end_ns: float) -> list[NavigationInput]:
        """What is held up to a stamp."""
        found: list[_Entry] = []
        for held in self._held.values():
            if held and held[0][0] <= end_ns:
                due = bisect.bisect_right(held, end_ns, key=_stamp_of)
                found += held[:due]
                del held[:due]
        return [entry[3] for entry in sorted(found)]


def _stamp_of(entry: _Entry) -> int:
    return entry[0]
