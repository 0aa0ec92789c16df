"""Take a heading that a person sets, where nothing else gives one.

It begins an alignment that lacks a heading, and corrects a filter whose own heading is worse. It
is believed as far as its standard deviation says, and never replaces a better one.
"""

from __future__ import annotations

import math

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.aid import Aid, lost_heading_rad
from tirgeo_ros.core.navigation.aiding.aid_status import AidTrack
from tirgeo_ros.core.navigation.aiding.autopilot_heading import vertical_turn
from tirgeo_ros.core.navigation.aiding.state_estimate import (
    AidMeasurement,
    Modelled,
    StateEstimate,
)
from tirgeo_ros.core.navigation.ins.strapdown import Vector
from tirgeo_ros.core.types.measurements import SetHeading, Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict

#: Least ratio of the filter's variance to that of the heading, for the heading to be of use.
_WORTH = 1.01


def set_variance_rad2(sample: SetHeading, config: EkfConfig) -> float:
    """Return the variance of a heading that was set; that of the parameter where it has none."""
    if sample.variance_rad2 > 0:
        return sample.variance_rad2
    return math.radians(config.heading.set_sigma_deg) ** 2


class SetHeadingAid(Aid):
    """Measure the heading of the nose, as it was set."""

    source = Source.SET_HEADING

    @classmethod
    def useless(cls, sample: SetHeading, config: EkfConfig) -> Verdict | None:
        """Return the verdict on a heading with which a state would be lost at once, else None."""
        sigma_rad = math.sqrt(set_variance_rad2(sample, config))
        limit_rad = lost_heading_rad(config)
        if sigma_rad < limit_rad:
            return None
        reason = (
            f"a sigma of {math.degrees(sigma_rad):.1f} deg is too large: give a variance below "
            f"{limit_rad**2:.3g} rad2, the {math.degrees(limit_rad):.0f} deg at which a state is "
            "lost"
        )
        return Verdict(cls.source, Outcome.INVALID, reason)

    def measured(self, sample: SetHeading, estimate: StateEstimate, _rate_b: Vector) -> Modelled:
        """Return the measurement; STANDBY where the filter's own heading is better."""
        useless = self.useless(sample, self._config)
        if useless is not None:
            return useless, estimate
        variance = set_variance_rad2(sample, self._config)
        own = max(float(estimate.covariance[2, 2]), 0.0)
        if own <= _WORTH * variance:
            reason = (
                f"the filter's own heading is better, {math.degrees(math.sqrt(own)):.1f} deg: "
                "call ~/reset first if it is wrong"
            )
            return Verdict(self.source, Outcome.STANDBY, reason), estimate
        # With this noise the heading becomes as certain as the person is, and no more: who says it
        # twice knows it no better.
        noise = 1 / (1 / variance - 1 / own)
        return vertical_turn(sample, noise, estimate), estimate

    def off(self, aid: AidMeasurement, _track: AidTrack) -> str:
        """Return in words how far a heading is off."""
        return f"{math.degrees(abs(float(aid.measurement.innovation[0]))):.0f} deg off"
