"""Aid the filter with the velocity of the ordinary GPS, where RTK's is missing."""

from __future__ import annotations

from tirgeo_ros.core.navigation.aiding.aid_status import AidStatus
from tirgeo_ros.core.navigation.aiding.rtk_velocity import VelocityAid
from tirgeo_ros.core.types.measurements import Source, VelocitySample


class GpsVelocityAid(VelocityAid):
    """Use velocities of the ordinary GPS where those of RTK are missing."""

    source = Source.GPS_VELOCITY
    delay = look_at = "gps.delay_s"

    def spare(self, sample: VelocitySample, aids: AidStatus) -> bool:
        """Return whether RTK's velocity was used within the time-out."""
        return aids.track(Source.RTK_VELOCITY).recent(sample.stamp_ns, self._timeout_ns)
