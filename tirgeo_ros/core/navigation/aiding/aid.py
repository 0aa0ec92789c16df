"""Define what an aid of the filter declares; each aid is a subclass in a module of its own."""

from __future__ import annotations

import math
import operator
from typing import Any, ClassVar

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.aid_status import AidStatus, AidTrack
from tirgeo_ros.core.navigation.aiding.state_estimate import (
    AidMeasurement,
    Modelled,
    StateEstimate,
)
from tirgeo_ros.core.navigation.ins.ins_error_model import states_of
from tirgeo_ros.core.navigation.ins.kalman import Measurement
from tirgeo_ros.core.navigation.ins.strapdown import Vector
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import Source


class Aid:
    """Declare one aid: its source, its measurement with noise and gate, and what refusals do.

    ``aids.AIDS`` lists the subclasses. Whatever changes from sample to sample is in the estimate,
    so that late samples meet the same decisions as timely ones.
    """

    source: ClassVar[Source]
    #: The parameter that holds its delay: stamp minus time of measurement.
    delay: ClassVar[str] = ""
    #: The parameters that may be wrong where innovations are much larger than their sigma.
    look_at: ClassVar[str] = ""
    unit: ClassVar[str] = "m"
    #: Whether a step of its innovation counts as its own fault, unlike a drift.
    steps: ClassVar[bool] = False
    #: Whether it is eased in after a silence, since it would move the map in one step.
    eased: ClassVar[bool] = False
    #: The error states that are set to it once it has contradicted them for long.
    resets: ClassVar[slice | None] = None

    def __init__(self, config: EkfConfig) -> None:
        """Take the parameters. Raises ConfigError where they are of no use."""
        self.configure(config)

    def configure(self, config: EkfConfig) -> None:
        """Take the parameters, also others in flight."""
        self._config = config
        self._states = states_of(config)
        self._timeout_ns = round(config.trust.aid_timeout_s * 1e9)

    @classmethod
    def delay_s(cls, config: EkfConfig) -> float:
        """Return stamp minus time of measurement, s; 0 without a parameter."""
        return float(operator.attrgetter(cls.delay)(config)) if cls.delay else 0.0

    def spare(self, _sample: Any, _control: AidStatus) -> bool:
        """Return whether a sample changes nothing and can be skipped (verdict STANDBY)."""
        return False

    def measured(self, sample: Any, estimate: StateEstimate, angular_rate_b: Vector) -> Modelled:
        """Return the measurement, or the verdict on a sample that is not used, and the estimate.

        ``angular_rate_b`` (rad/s) has its bias removed. Only the aid's record in the estimate may
        change.
        """
        raise NotImplementedError

    def averaged(
        self, track: AidTrack, _measurement: Measurement, _predicted: Array, reason: str
    ) -> tuple[AidTrack, str]:
        """Return the record with one more innovation in it, and why it is refused, or "".

        ``_predicted`` (m, m) is the covariance of the prediction, ``reason`` the gate's.
        """
        return track, reason

    def off(self, aid: AidMeasurement, track: AidTrack) -> str:
        """Return in words how far a measurement is off; of a step, how large it was."""
        size = math.hypot(*track.step) or float(np.linalg.norm(aid.measurement.innovation))
        return f"{size:.1f} {self.unit} off"

    def after_refusal(self, _aid: AidMeasurement, _belief: StateEstimate) -> StateEstimate | None:
        """Return the estimate after a refusal that led to a reset of the aid's own; else None."""
        return None
