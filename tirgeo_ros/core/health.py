"""From what the aids have done lately to the estimator's state, and since when it is in it."""

from __future__ import annotations

import math

from tirgeo_ros.core.aiding.control import Control
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.error_state import POSITION
from tirgeo_ros.core.samples import Array, FilterState, FixStatus, Source


class Health:
    """Judges the filter by its records and its covariance, as the parameters say."""

    def __init__(self, config: EkfConfig) -> None:
        trust = config.trust
        self._timeout_ns = round(trust.aid_timeout_s * 1e9)
        self._position_m2 = trust.lost_position_sigma_m**2
        self._heading_rad2 = math.radians(trust.lost_heading_sigma_deg) ** 2
        self._patience_s = config.rtk.reset_after_s
        self._with_heading = config.method == "ekf_heading"

    def state(self, control: Control, now_ns: int) -> tuple[FilterState, str]:
        """RUNNING, DEGRADED or DEAD_RECKONING, and the aids that are missing."""
        missing = self._missing(control, now_ns)
        measured = (Source.RTK_POSITION, Source.GPS_POSITION)
        if not any(control.track(s).recent(now_ns, self._timeout_ns) for s in measured):
            return FilterState.DEAD_RECKONING, f"no {', '.join(missing)}, no gps/fix"
        if missing:
            return FilterState.DEGRADED, f"no {', '.join(missing)}"
        return FilterState.RUNNING, ""

    def _missing(self, control: Control, now_ns: int) -> list[str]:
        aids = [(Source.RTK_POSITION, "rtk/fix"), (Source.RTK_VELOCITY, "rtk/vel")]
        if self._with_heading:
            aids.append((Source.RTK_HEADING, "rtk/heading"))
        missing = [
            name
            for source, name in aids
            if not control.track(source).recent(now_ns, self._timeout_ns)
        ]
        status = control.status_at(now_ns, self._timeout_ns)
        if "rtk/fix" not in missing and status is FixStatus.FLOAT:
            missing.insert(0, "fixed rtk/fix (float)")
        return missing

    def lost(self, control: Control, covariance: Array) -> str:
        """Why the state is not to be trusted any more, or empty.

        ``covariance`` (n, n) is that of the error states.
        """
        variances = covariance.diagonal().tolist()
        if not math.isfinite(sum(variances)):
            return "not finite"
        if max(variances[POSITION]) > self._position_m2:
            return f"position sigma {math.sqrt(max(variances[POSITION])):.1f} m"
        if variances[2] > self._heading_rad2:
            return f"heading sigma {math.degrees(math.sqrt(variances[2])):.1f} deg"
        return control.hopeless(self._patience_s)

    def spoiled(self, control: Control, covariance: Array) -> bool:
        """Whether what a lost state knows of the IMU is not to be trusted either."""
        finite = math.isfinite(float(covariance.trace()))
        return not finite or bool(control.hopeless(self._patience_s))
