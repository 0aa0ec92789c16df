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
"""Count the verdicts, and judge the estimator's state from them, the aids and the covariance."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.aid import lost_heading_rad
from tirgeo_ros.core.navigation.aiding.aid_status import NEVER_NS, AidStatus
from tirgeo_ros.core.navigation.aiding.fusion import AIDS, EXPECTED
from tirgeo_ros.core.navigation.ins.error_states import POSITION
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source
from tirgeo_ros.core.types.verdicts import FilterState, Outcome, Verdict

#: Ratio of the bound to a position's reported sigma: the state may drift by about that sigma.
_DRIFT_RATIO = 1.5
#: The fix status of a receiver that has been silent for longer is NONE.
_STATUS_AGE_NS = 2_000_000_000
_REFUSED = {Outcome.GATED, Outcome.INVALID, Outcome.TOO_OLD, Outcome.TOO_NEW, Outcome.TOO_MANY}
_NIS_NS = 30_000_000_000
#: Cap on the NIS of one measurement, so that a refused one does not dominate the mean.
_NIS_CAP = 25.0
#: A mean of fewer values is not reported.
_LEAST_VALUES = 20
#: A mean NIS above this gives a warning: innovations of twice their sigma.
_NIS_WARNING = 4.0
#: A mean difference of gps/fix from the state beyond so many sigmas is a contradiction.
MOST_GPS_SIGMAS = 3.0
#: When a sample was not used, and why.
Unused = tuple[int, str]


def covariance_fault(covariance: Array) -> str:
    """Return why a covariance (n, n) is impossible, or an empty string."""
    variances = covariance.diagonal().tolist()
    if not math.isfinite(sum(variances)):
        return "covariance not finite"
    return "covariance with a negative variance" if min(variances) < 0 else ""


class FilterHealth:
    """Judge the filter by the records of its aids and by its covariance."""

    def __init__(self, config: EkfConfig) -> None:
        self._variances: dict[Source, tuple[float, float, float]] = {}  # reported, NED, m2
        self.rtk = FixStatus.NONE, 0  # of the newest position, and its stamp
        self.configure(config)
        self._expected = EXPECTED.get(config.method, ())

    def configure(self, config: EkfConfig) -> None:
        """Take the parameters, at the start or in flight."""
        trust = config.trust
        self._timeout_ns = round(trust.aid_timeout_s * 1e9)
        self._bound_m = trust.lost_position_sigma_m
        self._heading_rad2 = lost_heading_rad(config) ** 2
        self._patience_s = config.rtk.reset_after_s

    def take_position(self, sample: PositionSample) -> None:
        """Record the fix status and the accuracy that a receiver reports with a position."""
        north, east, down = sample.covariance_n.diagonal().tolist()
        if sample.status >= FixStatus.SINGLE and min(north, east, down) > 0:
            self._variances[sample.source] = north, east, down
        if sample.source is Source.RTK_POSITION:
            self.rtk = sample.status, sample.stamp_ns

    def rtk_status(self, now_ns: int) -> FixStatus:
        """Return the RTK receiver's newest fix status; NONE once it is silent."""
        status, stamp_ns = self.rtk
        return status if now_ns - stamp_ns <= _STATUS_AGE_NS else FixStatus.NONE

    def state(
        self, aids: AidStatus, now_ns: int, unused: Mapping[Source, Unused] | None = None
    ) -> tuple[FilterState, str]:
        """Return RUNNING, DEGRADED or DEAD_RECKONING, and which aids are refused or missing.

        ``unused`` holds for each source when a sample was last not used, and why.
        """
        missing = [s for s in self._expected if not aids.track(s).recent(now_ns, self._timeout_ns)]
        floating = aids.rtk.at(now_ns, self._timeout_ns) is FixStatus.FLOAT
        if not missing and not floating:
            return FilterState.RUNNING, ""
        poor, present, absent = "", [], []
        if Source.RTK_POSITION in missing:
            poor = self.poor_gps()
            if not aids.track(Source.GPS_POSITION).recent(now_ns, self._timeout_ns):
                missing.append(Source.GPS_POSITION)
        elif floating:
            present.append("rtk/fix is float")
        for source in missing:
            stamp_ns, why = (unused or {}).get(source, (NEVER_NS, ""))
            if now_ns - stamp_ns <= self._timeout_ns:
                present.append(f"{source.topic} {why}")
            else:
                absent.append(source.topic)
        text = ", ".join([*present, *(["no " + ", ".join(absent)] if absent else [])])
        if Source.GPS_POSITION in missing:
            return FilterState.DEAD_RECKONING, text
        return FilterState.DEGRADED, "; ".join(filter(None, (text, poor)))

    def bounds_m2(self) -> list[float]:
        """Return the variances (3,) NED, m2, beyond which a state is lost."""
        reported = zip(*self._variances.values(), strict=True)
        most = [_DRIFT_RATIO**2 * max(axis) for axis in reported] or [0.0] * 3
        return [max(self._bound_m**2, axis) for axis in most]

    def poor_gps(self) -> str:
        """Return what is poor about the ordinary GPS, or an empty string."""
        *across, down = map(math.sqrt, self._variances.get(Source.GPS_POSITION, (0.0, 0.0, 0.0)))
        sizes = [f"{max(across):.0f} m"] if max(across) > self._bound_m else []
        sizes += [f"{down:.0f} m in height"] if down > self._bound_m else []
        return f"gps/fix has a sigma of {', '.join(sizes)}" if sizes else ""

    @staticmethod
    def refuted(aids: AidStatus) -> Iterator[str]:
        """Yield a warning if positions of the ordinary GPS contradict the state for long."""
        if aids.gps_sigmas > MOST_GPS_SIGMAS:
            off = f"{aids.gps_sigmas:.1f} times gps.position_sigma_m off the filter's position"
            yield f"gps/fix: was {off} for long: look at the receiver and at gps/vel"

    def lost(self, aids: AidStatus, covariance: Array) -> str:
        """Return why a state with this error covariance (n, n) cannot be trusted, or ""."""
        fault = covariance_fault(covariance)
        if fault:
            return fault
        variances = covariance.diagonal().tolist()
        pairs = zip(variances[POSITION], self.bounds_m2(), strict=True)
        beyond = [variance for variance, bound in pairs if variance > bound]
        if beyond:
            return f"position sigma {math.sqrt(max(beyond)):.1f} m"
        if variances[2] > self._heading_rad2:
            return f"heading sigma {math.degrees(math.sqrt(variances[2])):.1f} deg"
        return aids.hopeless(self._patience_s)

    def spoiled(self, aids: AidStatus, covariance: Array) -> bool:
        """Return whether the bias estimates of a lost state cannot be trusted either."""
        return bool(covariance_fault(covariance) or aids.hopeless(self._patience_s))


class VerdictLog:
    """Record every verdict except those on used IMU samples, and pass it to ``on_verdict``.

    Besides counts it holds, by source, the newest test ratio, why samples are not used, and the
    normalised innovations squared (NIS) of 30 s. Their mean per degree of freedom is 1 if the
    noise, lever arm and delay of measurements are as configured and reported (Bar-Shalom, Li and
    Kirubarajan, Estimation with Applications to Tracking and Navigation, section 5.4).
    """

    def __init__(self, on_verdict: Callable[[Verdict], None] | None = None) -> None:
        self.counts: Counter[tuple[Source, Outcome]] = Counter()
        self.test_ratios: dict[Source, float] = {}
        self._on_verdict = on_verdict
        self.begin()

    def begin(self) -> None:
        """Forget the records of the former state."""
        self.unused: dict[Source, Unused] = {}
        self._nis: dict[Source, deque[tuple[int, float]]] = {}  # stamp and value, over 30 s
        self._means: dict[Source, float] = {}  # of ``_nis``, until its next value
        self._sums: dict[Source, tuple[float, int]] = {}  # of all NIS, and their number

    def add(self, verdict: Verdict, now_ns: int) -> None:
        """Take a verdict that was given at ``now_ns``."""
        source = verdict.source
        self.counts[source, verdict.outcome] += 1
        if not math.isnan(verdict.test_ratio):
            self.test_ratios[source] = verdict.test_ratio
        if not math.isnan(verdict.nis):
            values = self._nis.setdefault(source, deque())
            if values and now_ns < values[-1][0]:  # the clock went back
                values.clear()
            values.append((now_ns, min(verdict.nis, _NIS_CAP)))
            total, number = self._sums.get(source, (0.0, 0))
            self._sums[source] = total + values[-1][1], number + 1
            while values[0][0] < now_ns - _NIS_NS:
                values.popleft()
            self._means.pop(source, None)
        if verdict.outcome in _REFUSED:
            self.unused[source] = now_ns, f"refused: {verdict.reason}"
        elif verdict.outcome is Outcome.NOT_FIXED:
            self.unused[source] = now_ns, f"not used: {verdict.reason}"
        if self._on_verdict is not None:
            self._on_verdict(verdict)

    def nis(self, now_ns: int) -> dict[str, float]:
        """Return the mean NIS per degree of freedom, by source, if there are enough values."""
        return {
            source.value: self._mean(source, values)
            for source, values in self._nis.items()
            if len(values) >= _LEAST_VALUES and now_ns - values[-1][0] <= _NIS_NS
        }

    @property
    def largest_nis(self) -> float:
        """Return the largest mean NIS of a source since the state began, at least 1."""
        sums = [each for each in self._sums.values() if each[1] >= _LEAST_VALUES]
        return max([1.0, *(total / number for total, number in sums)])

    def _mean(self, source: Source, values: deque[tuple[int, float]]) -> float:
        # Callers may ask at each IMU sample: the values of 30 s are not added up each time.
        if source not in self._means:
            self._means[source] = sum(nis for _, nis in values) / len(values)
        return self._means[source]

    def warnings(self, now_ns: int) -> Iterator[str]:
        """Yield a warning for each source whose NIS is too high, with the parameters to check."""
        means = self.nis(now_ns)
        for source, aid in AIDS.items():
            mean = means.get(source.value, 0.0)
            if mean > _NIS_WARNING and aid.look_at:
                times = f"{math.sqrt(mean):.1f} times their sigma over 30 s"
                yield (
                    f"{source.topic}: innovations are {times}: "
                    f"look at {aid.look_at} and at its covariances (tirgeo calibrate aircraft)"
                )
