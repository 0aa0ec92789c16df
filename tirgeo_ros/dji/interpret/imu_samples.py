"""Convert IMU readings to samples: select the stream, the unit and the attitude."""

from __future__ import annotations

from collections import Counter, deque

import numpy as np

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.dji.interpret.accelerometer_unit import StreamUnit
from tirgeo_ros.dji.interpret.autopilot_attitude import AutopilotAttitudes, unit_quaternion
from tirgeo_ros.dji.sources.readings import (
    AttitudeReading,
    ImuOrigin,
    ImuReading,
    Quaternion,
    Vector,
)

#: A stream counts as silent after this time: five samples of the slowest (50 Hz), half of the gap
#: that the filter bridges.
_SILENT_NS = 100_000_000
#: A better stream is selected once it has been there for this time without such a silence.
_STEADY_NS = 100_000_000
#: A stamp that goes back further comes from another clock: the earlier stamps are no longer valid.
#: Largest difference of readings of one instant from two sources; also covers their clocks'
#: jitter.
_SAME_NS = 20_000_000

_RANK = {origin: rank for rank, origin in enumerate(ImuOrigin)}


class DrivingStream:
    """Select one stream: the best that is present."""

    def __init__(self) -> None:
        self.driver: ImuOrigin | None = None
        self.handovers = 0
        self._newest_ns = 0
        self._better: ImuOrigin | None = None
        self._better_since_ns = self._better_newest_ns = 0

    def drives(self, origin: ImuOrigin, stamp_ns: int) -> bool:
        """Return whether a reading of this stream is to be used."""
        if origin is not self.driver and not self._takes_over(origin, stamp_ns):
            return False
        self._newest_ns = stamp_ns
        return True

    def _takes_over(self, origin: ImuOrigin, stamp_ns: int) -> bool:
        if self.driver is None:
            self.driver = origin
            return True
        silent = not -_CLOCK_NS < stamp_ns - self._newest_ns <= _SILENT_NS
        if not (silent or self._is_steadily_better(self.driver, origin, stamp_ns)):
            return False
        self.driver, self._better = origin, None
        self.handovers += 1
        return True

    def _is_steadily_better(self, driver: ImuOrigin, origin: ImuOrigin, stamp_ns: int) -> bool:
        if _RANK[origin] >= _RANK[driver]:
            return False
        newest_ns = self._better_newest_ns
        if origin is not self._better or not 0 <= stamp_ns - newest_ns <= _SILENT_NS:
            self._better, self._better_since_ns = origin, stamp_ns
        self._better_newest_ns = stamp_ns
        return stamp_ns - self._better_since_ns >= _STEADY_NS


class Sequence:
    """Make each stamp later than the one before, where the change is negligible.

    A stamp up to 20 ms behind is moved to 1 ns after the newest. One further behind comes from
    another clock and passes unchanged: the user of the samples judges it.
    """

    def __init__(self) -> None:
        self._newest_ns: int | None = None

    def after(self, stamp_ns: int) -> int:
        """Return the stamp to use for a sample of ``stamp_ns``."""
        newest_ns = self._newest_ns
        if newest_ns is not None and 0 <= newest_ns - stamp_ns <= _SAME_NS:
            stamp_ns = newest_ns + 1
        self._newest_ns = stamp_ns
        return stamp_ns


#: A stamp that goes back further comes from another clock and passes; the filter judges it.
_CLOCK_NS = 1_000_000_000

#: Larger numbers are invalid in any unit. The filter judges what an aircraft cannot do.
_LARGEST = 1e6
#: Most samples that are held back: 5 s at 100 Hz of readings too sparse or too wild to decide by.
_MOST_HELD = 500

_Held = tuple[int, Vector, Vector, "Array | None"]  # stamp, acceleration, rate, attitude


class ImuInterpreter:
    """Convert IMU readings to samples, and put every attitude into the buffer.

    While the unit of acceleration is not known, samples are held back (0.4 s, at least twenty) and
    released when it is. If it has no gravity they are dropped. Counted: ``imu_refused`` (not
    finite or too large), ``imu_unused_`` with the name of a stream that is not selected,
    ``imu_out_of_order``, ``imu_went_back`` (another clock; passes), ``imu_without_gravity``,
    ``imu_unit_not_known``, ``imu_without_attitude``, ``imu_attitude_carried`` (from another
    message), ``attitude_not_unit``, ``imu_handovers`` and ``acceleration_unit_changes``.
    """

    def __init__(
        self, config: DjiConfig, attitudes: AutopilotAttitudes, counts: Counter[str]
    ) -> None:
        self.configure(config)
        self._attitudes = attitudes
        self._counts = counts
        self._streams = DrivingStream()
        self._units = {origin: StreamUnit(config.acceleration_unit) for origin in ImuOrigin}
        self._held: deque[_Held] = deque()
        self._held_origin: ImuOrigin | None = None
        self._newest_ns: int | None = None

    def configure(self, config: DjiConfig) -> None:
        """Take the delay, also another one in flight."""
        self._delay_ns = round(config.delay.imu_s * 1e9)

    def take(self, reading: ImuReading) -> list[ImuSample]:
        """Return the sample of a reading and those held back until it; or none."""
        stamp_ns, origin, (x, y, z), unit, (p, q, r), q_nb = reading
        stamp_ns -= self._delay_ns
        # false for NaN as well
        sound = abs(x) + abs(y) + abs(z) + abs(p) + abs(q) + abs(r) < _LARGEST
        drives = sound and self._streams.drives(origin, stamp_ns)
        attitude = None if q_nb is None else self._attitude(q_nb)
        if attitude is not None:
            (self._attitudes.put if drives else self._attitudes.offer)(stamp_ns, attitude)
        if not sound:
            self._counts["imu_refused"] += 1
            return []
        stream = self._units[origin]
        stream.add(stamp_ns, reading.acceleration_b, unit)
        factor = stream.factor
        if not drives:
            self._counts[f"imu_unused_{origin.value}"] += 1
            return []
        if attitude is None:
            attitude = self._attitudes.carried(stamp_ns, reading.angular_rate_b)
            is_carried = "without_attitude" if attitude is None else "attitude_carried"
            self._counts[f"imu_{is_carried}"] += 1
        entry = (stamp_ns, reading.acceleration_b, reading.angular_rate_b, attitude)
        if factor is None:
            if origin is not self._held_origin:
                self._forget_held(0)
            self._held_origin = origin
            self._held.append(entry)
            self._forget_held(_MOST_HELD)
            return []
        if self._held:
            return [*self._release(origin, factor), *self._sample(entry, factor)]
        return self._sample(entry, factor)

    def take_attitude(self, reading: AttitudeReading) -> list[ImuSample]:
        """Take an attitude that came in a message of its own; return no sample."""
        attitude = self._attitude(reading.q_nb)
        if attitude is not None:
            self._attitudes.offer(reading.stamp_ns - self._delay_ns, attitude)
        return []

    def flush(self) -> list[ImuSample]:
        """Return the samples that were held back, if they suffice to find their unit."""
        if self._held_origin is None:
            return []
        stream = self._units[self._held_origin]
        if stream.factor is None:
            stream.settle()
        if stream.factor is None:
            self._forget_held(0)
            return []
        return self._release(self._held_origin, stream.factor)

    def _attitude(self, q_nb: Quaternion) -> Array | None:
        attitude = unit_quaternion(q_nb)
        if attitude is None:
            self._counts["attitude_not_unit"] += 1
        return attitude

    def _forget_held(self, keep: int) -> None:
        while len(self._held) > keep:
            self._held.popleft()
            self._counts["imu_unit_not_known"] += 1

    def _release(self, origin: ImuOrigin, factor: float) -> list[ImuSample]:
        """Return the samples held back in the unit now known; drop those of another stream."""
        if origin is not self._held_origin:
            self._forget_held(0)
        held, self._held = self._held, deque()
        return [sample for entry in held for sample in self._sample(entry, factor)]

    def _sample(self, entry: _Held, factor: float) -> list[ImuSample]:
        stamp_ns, (x, y, z), rate_b, attitude = entry
        if factor == 0.0:
            self._counts["imu_without_gravity"] += 1
            return []
        if self._newest_ns is not None and stamp_ns <= self._newest_ns:
            if self._newest_ns - stamp_ns < _CLOCK_NS:
                self._counts["imu_out_of_order"] += 1
                return []
            self._counts["imu_went_back"] += 1
        self._newest_ns = stamp_ns
        force_b = np.array((x * factor, y * factor, z * factor))
        return [ImuSample(stamp_ns, force_b, np.array(rate_b), attitude)]

    @property
    def counts(self) -> dict[str, int]:
        """Return the counts kept by the parts."""
        changes = sum(unit.changes for unit in self._units.values())
        return {"imu_handovers": self._streams.handovers, "acceleration_unit_changes": changes}

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return the selected stream and the unit of its accelerations."""
        driver = self._streams.driver
        if driver is None:
            return {"imu_source": "none"}
        return {"imu_source": driver.value, "acceleration_unit": self._units[driver].text}

    @property
    def warnings(self) -> list[str]:
        """Return what to set right about accelerations."""
        return [unit.warning for unit in self._units.values()]
