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
"""Start the filter: sort samples by stamp, align, and process the samples that came meanwhile.

The result of an alignment must not depend on the load of the computer. Until the filter runs no
solution is due, so samples are held until everything that may precede them has arrived.
"""

from __future__ import annotations

import bisect
import math
import operator
from collections import defaultdict
from collections.abc import Sequence

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.aid import Aiding
from tirgeo_ros.core.navigation.aiding.aid_status import PLACE
from tirgeo_ros.core.navigation.aiding.fusion import AIDS, longest_hold_s
from tirgeo_ros.core.navigation.alignment.aligner import Aligner, Alignment
from tirgeo_ros.core.navigation.alignment.batch_least_squares import Biases
from tirgeo_ros.core.navigation.ins.strapdown import NavState
from tirgeo_ros.core.navigation.timeline.ekf import Ekf
from tirgeo_ros.core.navigation.timeline.flight_record import FlightRecord
from tirgeo_ros.core.types.measurements import ImuSample, NavigationInput, SetHeading, Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

#: Bounds on the held samples of a source, per second of holding time.
_MOST_IMU_HZ, _MOST_OTHER_HZ = 1000, 100
_PLACE = {Source.IMU: -1} | PLACE  # within an instant: the IMU before the measurements
_Entry = tuple[int, int, int, NavigationInput]  # stamp, place in the instant, arrival


class StampOrder:
    """Hold each sample until the newest IMU sample is ``wait_s`` beyond its stamp.

    A measurement may be ``hold_s`` ahead of the IMU and ``keep_s`` behind it, once there is an IMU
    sample to compare with. If a source exceeds its bound, its oldest sample is dropped.
    """

    def __init__(self, wait_s: float, hold_s: float, keep_s: float) -> None:
        self._wait_ns, self._hold_ns, self._keep_ns = (
            round(s * 1e9) for s in (wait_s, hold_s, keep_s)
        )
        self._span_s = wait_s + hold_s
        self._queues: defaultdict[Source, list[_Entry]] = defaultdict(list)  # each sorted
        self._given_up: list[Verdict] = []
        self._number = 0
        self._imu_ns: int | None = None

    def out_of_reach(self, source: Source, stamp_ns: int) -> Verdict | None:
        """Return the verdict on a measurement that is too far from the IMU's time, else None."""
        if self._imu_ns is None:
            return None
        ahead_ns = stamp_ns - self._imu_ns
        if -self._keep_ns <= ahead_ns <= self._hold_ns:
            return None
        outcome = Outcome.TOO_NEW if ahead_ns > 0 else Outcome.TOO_OLD
        return Verdict(source, outcome, f"{ahead_ns * 1e-9:+.1f} s from imu/data")

    def given_up(self) -> list[Verdict]:
        """Return the verdicts on dropped samples since the last call."""
        dropped, self._given_up = self._given_up, []
        return dropped

    def add(self, sample: NavigationInput) -> list[NavigationInput]:
        """Take a sample; return those that are due, oldest first."""
        source = sample.source
        self._number += 1
        queue = self._queues[source]
        bisect.insort(queue, (sample.stamp_ns, _PLACE[source], self._number, sample))
        most_hz = _MOST_IMU_HZ if source is Source.IMU else _MOST_OTHER_HZ
        most = math.ceil(self._span_s * most_hz)
        if len(queue) > most:
            del queue[0]
            reason = f"{most} newer samples wait for imu/data"
            self._given_up.append(Verdict(source, Outcome.TOO_MANY, reason))
        if source is Source.IMU:
            begins, self._imu_ns = self._imu_ns is None, sample.stamp_ns
            for earlier, entries in self._queues.items() if begins else ():
                judged = [(entry, self.out_of_reach(earlier, entry[0])) for entry in entries]
                entries[:] = [entry for entry, far in judged if far is None]
                self._given_up += [far for _, far in judged if far is not None]
        return [] if self._imu_ns is None else self.pop_until(self._imu_ns - self._wait_ns)

    def pop_until(self, end_ns: float = math.inf) -> list[NavigationInput]:
        """Remove and return the samples up to a stamp, oldest first."""
        due_entries: list[_Entry] = []
        for queue in self._queues.values():
            due = bisect.bisect_right(queue, end_ns, key=operator.itemgetter(0))
            due_entries += queue[:due]
            del queue[:due]
        return [entry[3] for entry in sorted(due_entries)]


class StartUp:
    """Take samples until the filter ``ekf`` starts; ``prior`` is of the IMU's biases."""

    def __init__(self, config: EkfConfig, prior: Biases | None) -> None:
        self._config, self.prior = config, prior
        use_heading = config.method == "ekf_heading"
        self.aligner = Aligner(config, use_heading=use_heading, prior=prior)
        keep_s = self.aligner.keep_s
        self.order = StampOrder(config.max_delay_s, longest_hold_s(config), keep_s)
        self.ekf: Ekf | None = None
        self.first_state: NavState | None = None
        self.record: FlightRecord | None = None  # of the filter, for a smoother

    def refused(self, sample: Aiding) -> Verdict | None:
        """Return the verdict on a sample that the alignment cannot use, else None."""
        if isinstance(sample, SetHeading) and not self.aligner.lacks_heading:
            reason = f"the alignment does not need a heading now: {self.aligner.reason}"
            return Verdict(sample.source, Outcome.STANDBY, reason)
        useless = AIDS[sample.source].useless(sample, self._config)
        return useless or self.order.out_of_reach(sample.source, sample.stamp_ns)

    def add(self, sample: NavigationInput) -> list[Verdict]:
        """Take a sample; return verdicts on dropped samples and, at a start, on later ones."""
        due = iter(self.order.add(sample))
        verdicts = self.order.given_up()
        for earlier in due:
            alignment = self.aligner.add(earlier)
            if alignment is not None:
                return verdicts + self._started(alignment, [*due, *self.order.pop_until()])
        return verdicts

    def _started(self, alignment: Alignment, rest: Sequence[NavigationInput]) -> list[Verdict]:
        """Start the filter; ``rest`` are the samples that the alignment has not taken."""
        self.ekf = Ekf(self._config, alignment, record=self.record)
        self.first_state = alignment.state
        later = sorted((*alignment.imu[1:], *alignment.later), key=lambda s: s.stamp_ns)
        newer = (s for s in rest if s.stamp_ns > alignment.stamp_ns)
        verdicts = []
        if Source.SET_HEADING in alignment.sources:
            reason = "the filter starts with this heading"
            verdicts.append(Verdict(Source.SET_HEADING, Outcome.USED, reason))
        for sample in (*later, *newer):
            if isinstance(sample, ImuSample):
                verdicts += self.ekf.add_imu(sample)
            else:
                verdicts.append(self.ekf.add_aiding(sample))
        return verdicts
