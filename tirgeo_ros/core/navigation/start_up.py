"""Start the filter: sort samples by their stamps, align, and catch up with what came meanwhile."""

from __future__ import annotations

from collections.abc import Sequence

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.alignment.aligner import Aligner, Alignment, Biases
from tirgeo_ros.core.navigation.delays import longest_hold_s
from tirgeo_ros.core.navigation.ekf import Ekf
from tirgeo_ros.core.navigation.measurement_order import StampOrder
from tirgeo_ros.core.navigation.strapdown import NavState
from tirgeo_ros.core.types.measurements import ImuSample, NavigationInput
from tirgeo_ros.core.types.verdicts import Verdict


class StartUp:
    """Take samples until ``ekf`` is there; ``prior`` is what is known of the IMU's biases."""

    def __init__(self, config: EkfConfig, prior: Biases | None) -> None:
        self._config = config
        use_heading = config.method == "ekf_heading"
        self.aligner = Aligner(config, use_heading=use_heading, prior=prior)
        keep_s = self.aligner.keep_s
        self.order = StampOrder(config.max_delay_s, longest_hold_s(config), keep_s)
        self.ekf: Ekf | None = None
        self.first_state: NavState | None = None

    def add(self, sample: NavigationInput) -> list[Verdict]:
        """Take a sample; return the verdicts on samples dropped, and on those of a start."""
        due = iter(self.order.add(sample))
        verdicts = self.order.given_up()
        for earlier in due:
            alignment = self.aligner.add(earlier)
            if alignment is not None:
                return verdicts + self._started(alignment, [*due, *self.order.rest()])
        return verdicts

    def _started(self, alignment: Alignment, rest: Sequence[NavigationInput]) -> list[Verdict]:
        """Start the filter; ``rest`` are samples that the alignment has not seen."""
        self.ekf, self.first_state = Ekf(self._config, alignment), alignment.state
        later = sorted((*alignment.imu[1:], *alignment.later), key=lambda s: s.stamp_ns)
        unseen = (s for s in rest if s.stamp_ns > alignment.stamp_ns)
        verdicts = []
        for sample in (*later, *unseen):
            if isinstance(sample, ImuSample):
                verdicts += self.ekf.add_imu(sample)
            else:
                verdicts.append(self.ekf.add_aiding(sample))
        return verdicts
