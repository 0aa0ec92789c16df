"""Judge the estimator's state from the latest records of the aids and the covariance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.aid_status import NEVER_NS, AidStatus
from tirgeo_ros.core.navigation.ins_error_model import POSITION
from tirgeo_ros.core.navigation.reported_accuracy import ReportedAccuracy
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source
from tirgeo_ros.core.types.verdicts import FilterState, Outcome, Verdict

#: In units of the autopilot's heading sigma. Its heading is used again from three sigmas on, so
#: a state is lost only beyond that, with a margin.
_HEADING_SIGMAS = 3.5
_PREFIXES = {
    Outcome.GATED: "refused: ",
    Outcome.INVALID: "refused: ",
    Outcome.TOO_OLD: "refused: ",
    Outcome.TOO_NEW: "refused: ",
    Outcome.TOO_MANY: "refused: ",
    Outcome.NOT_FIXED: "not used: ",
}


class Unused(NamedTuple):
    """Hold when and why a sample was not used."""

    stamp_ns: int
    why: str


_NOTHING = Unused(NEVER_NS, "")


def unused(verdict: Verdict, now_ns: int) -> Unused | None:
    """Return why an aid that arrives is not used; None for any other verdict."""
    lead = _PREFIXES.get(verdict.outcome)
    return None if lead is None else Unused(now_ns, lead + verdict.reason)


class FilterHealth:
    """Judge the filter by the records of its aids and by its covariance."""

    def __init__(self, config: EkfConfig) -> None:
        trust = config.trust
        self._timeout_ns = round(trust.aid_timeout_s * 1e9)
        self._reported = ReportedAccuracy(config)
        known_deg = _HEADING_SIGMAS * config.autopilot.attitude_sigma_deg[2]
        self._heading_rad2 = math.radians(max(trust.lost_heading_sigma_deg, known_deg)) ** 2
        self._patience_s = config.rtk.reset_after_s
        self._wanted = [Source.RTK_POSITION, Source.RTK_VELOCITY]
        if config.method == "ekf_heading":
            self._wanted.append(Source.RTK_HEADING)

    def hear(self, sample: PositionSample) -> None:
        """Take a position, for the accuracy that its receiver reports."""
        self._reported.hear(sample)

    def state(
        self, control: AidStatus, now_ns: int, unused: Mapping[Source, Unused] | None = None
    ) -> tuple[FilterState, str]:
        """Return RUNNING, DEGRADED or DEAD_RECKONING, and the aids that are missing.

        ``unused`` holds for each source when a sample was last not used, and why.
        """
        missing = [
            s for s in self._wanted if not control.track(s).recent(now_ns, self._timeout_ns)
        ]
        floating = control.status_at(now_ns, self._timeout_ns) is FixStatus.FLOAT
        if not missing and not floating:
            return FilterState.RUNNING, ""
        poor = told = ""
        if Source.RTK_POSITION in missing:
            poor = self._reported.text()
            if not control.track(Source.GPS_POSITION).recent(now_ns, self._timeout_ns):
                missing.append(Source.GPS_POSITION)
        elif floating:
            told = "rtk/fix is float"
        aids = ", ".join(filter(None, (told, self._reason(missing, now_ns, unused or {}))))
        blind = Source.GPS_POSITION in missing
        state = FilterState.DEAD_RECKONING if blind else FilterState.DEGRADED
        return state, aids if blind else "; ".join(filter(None, (aids, poor)))

    def _reason(
        self, missing: Sequence[Source], now_ns: int, unused: Mapping[Source, Unused]
    ) -> str:
        """Return what is refused and why, then what does not arrive at all."""
        told, absent = [], []
        for source in missing:
            stamp_ns, why = unused.get(source, _NOTHING)
            if now_ns - stamp_ns <= self._timeout_ns:
                told.append(f"{source.topic} {why}")
            else:
                absent.append(source.topic)
        return ", ".join([*told, *(["no " + ", ".join(absent)] if absent else [])])

    def lost(self, control: AidStatus, covariance: Array) -> str:
        """Return why the state is not to be trusted any more, or an empty string.

        ``covariance`` (n, n) is that of the error states.
        """
        variances = covariance.diagonal().tolist()
        if not math.isfinite(sum(variances)):
            return "not finite"
        largest = max(variances[POSITION])
        if largest > self._reported.least_m2:
            pairs = zip(variances[POSITION], self._reported.bounds_m2(), strict=True)
            beyond = [variance for variance, bound in pairs if variance > bound]
            if beyond:
                return f"position sigma {math.sqrt(max(beyond)):.1f} m"
        if variances[2] > self._heading_rad2:
            return f"heading sigma {math.degrees(math.sqrt(variances[2])):.1f} deg"
        return control.hopeless(self._patience_s)

    def spoiled(self, control: AidStatus, covariance: Array) -> bool:
        """Return whether the bias estimates of a lost state are not to be trusted either."""
        finite = math.isfinite(float(covariance.trace()))
        return not finite or bool(control.hopeless(self._patience_s))
