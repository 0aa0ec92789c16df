"""Sort samples by their time stamps, however late each of them arrives.

The result of an alignment must not depend on the load of the computer. Until the filter runs no
solution is due, so samples are held until everything that may precede them has arrived.
"""

from __future__ import annotations

import bisect
import math
import operator
from collections import defaultdict

from tirgeo_ros.core.navigation.aiding.aid_status import PLACE
from tirgeo_ros.core.navigation.aiding.state_estimate import source_of
from tirgeo_ros.core.types.measurements import ImuSample, NavigationInput, Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

#: Bounds on the held samples of a source, per second of holding time.
_MOST_HZ = {Source.IMU: 1000}
_MOST_OTHER_HZ = 100
_PLACE = {Source.IMU: -1, **PLACE}  # within an instant: the IMU before the measurements
_Entry = tuple[int, int, int, NavigationInput]  # stamp, place in the instant, arrival


class StampOrder:
    """Hold each sample until the newest IMU sample is ``wait_s`` beyond its stamp.

    A measurement may be ``hold_s`` ahead of the IMU and ``keep_s`` behind it, once there is an IMU
    sample to compare with. Where a source exceeds its bound, its oldest samples are dropped.
    """

    def __init__(self, wait_s: float, hold_s: float, keep_s: float) -> None:
        self._wait_ns = round(wait_s * 1e9)
        self._hold_ns = round(hold_s * 1e9)
        self._keep_ns = round(keep_s * 1e9)
        self._span_s = wait_s + hold_s
        self._held: defaultdict[Source, list[_Entry]] = defaultdict(list)  # each sorted
        self._given_up: list[Verdict] = []
        self._number = 0
        self._imu_ns: int | None = None

    def out_of_reach(self, stamp_ns: int) -> tuple[Outcome, str] | None:
        """Return why a measurement of that time cannot be used, and its offset; None if it can."""
        if self._imu_ns is None:
            return None
        ahead_ns = stamp_ns - self._imu_ns
        if -self._keep_ns <= ahead_ns <= self._hold_ns:
            return None
        outcome = Outcome.TOO_NEW if ahead_ns > 0 else Outcome.TOO_OLD
        return outcome, f"{ahead_ns * 1e-9:+.1f} s from imu/data"

    def given_up(self) -> list[Verdict]:
        """Return the verdicts on held samples that were dropped, each once."""
        found, self._given_up = self._given_up, []
        return found

    def add(self, sample: NavigationInput) -> list[NavigationInput]:
        """Take a sample; return those that are due, oldest first."""
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
                self._drop_unreachable()
        return [] if self._imu_ns is None else self._pop_until(self._imu_ns - self._wait_ns)

    def rest(self) -> list[NavigationInput]:
        """Return all held samples, oldest first, and hold nothing any more."""
        return self._pop_until(math.inf)

    def _drop_unreachable(self) -> None:
        """Drop the samples from before the first IMU sample that are out of its reach."""
        for source, held in self._held.items():
            judged = [(entry, self.out_of_reach(entry[0])) for entry in held]
            held[:] = [entry for entry, far in judged if far is None]
            self._given_up += [Verdict(source, *far) for _, far in judged if far is not None]

    def _pop_until(self, end_ns: float) -> list[NavigationInput]:
        """Remove and return the samples up to a stamp, oldest first."""
        found: list[_Entry] = []
        for held in self._held.values():
            if held and held[0][0] <= end_ns:
                due = bisect.bisect_right(held, end_ns, key=operator.itemgetter(0))
                found += held[:due]
                del held[:due]
        return [entry[3] for entry in sorted(found)]
