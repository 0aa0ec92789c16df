"""Convert IMU readings to samples: select the stream, the unit and the attitude."""

from __future__ import annotations

import math
from collections import Counter, deque

import numpy as np

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.frames.rotations import quat_multiply, slerp
from tirgeo_ros.core.gimbal.pose_buffer import Miss, StampedBuffer
from tirgeo_ros.core.navigation.ins.strapdown import quaternion_of
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.dji.sources.readings import (
    AccelerationUnit,
    AttitudeReading,
    ImuOrigin,
    ImuReading,
    Quaternion,
    Vector,
)

#: The unit g of DJI's accelerometer is standard gravity by definition, not the local gravity. The
#: 9.801 and 9.8 of DJI's wrappers are rounded, by 0.06 and 0.07 % too small.
G_M_S2 = 9.80665

#: The first mean is over this time and this many readings, each later one over _LATER_NS.
_FIRST_NS, _FIRST_NUMBER = 400_000_000, 20
_LATER_NS = 2_000_000_000
#: Fewer readings than this give no mean.
_LEAST_NUMBER = 5
#: Means in a row that overturn a decision. A fused acceleration may look like 1 g in m/s2 for the
#: seconds in which an aircraft gains speed, but not for this many means.
_OVERTURN = 3
#: Share of the readings that is trimmed at either end, against outliers. A median would reject
#: them as well, but fails for a vibration that has two values only.
_TRIMMED = 0.1
#: Full scale of any IMU on an aircraft, in either unit.
_FULL_SCALE = 400.0
#: The mean of a flight stays between half and twice gravity for seconds.
_LEAST, _MOST = 0.5, 2.0

_NAMES = {None: "not known yet", 0.0: "fused, without gravity", 1.0: "m/s2", G_M_S2: "g"}
_FACTORS = {"g": G_M_S2, "m/s2": 1.0}


class StreamUnit:
    """Find the unit of one stream's accelerations, and whether they are specific force at all.

    The broadcast's acceleration is what DJI Assistant 2 is set to: raw (g) or fused, without
    gravity. Vibration is as large as gravity, so single readings prove nothing. Over half a second
    vibration averages out, and about 1 g remains, at rest and in any flight except for moments.

    ``factor`` converts to m/s2; 0: no specific force; None: not known yet.
    """

    def __init__(self, configured: str) -> None:
        """Take ``configured``: auto, g or m/s2, as the parameter ``acceleration_unit``."""
        self.factor = _FACTORS.get(configured)
        self._how = "by its size" if self.factor is None else "acceleration_unit"
        self.changes = 0
        self._mean: Vector | None = None  # the newest, in the stream's unit
        self._against: list[float] = []  # factors by the newest means that contradict ``factor``
        self._span_ns, self._number = _FIRST_NS, _FIRST_NUMBER
        self._begun_ns: int | None = None
        self._newest_ns = 0
        self._readings: list[Vector] = []

    def add(self, stamp_ns: int, acceleration: Vector, unit: AccelerationUnit) -> None:
        """Take a reading (b) of any size, whose source may state the unit."""
        if unit is not AccelerationUnit.UNKNOWN:
            self.factor, self._how = _FACTORS[unit.value], "told"
        x, y, z = acceleration
        if not (abs(x) < _FULL_SCALE and abs(y) < _FULL_SCALE and abs(z) < _FULL_SCALE):
            return
        begun_ns = self._begun_ns
        if begun_ns is None or not 0 <= stamp_ns - self._newest_ns <= _FIRST_NS:
            self._begun_ns = begun_ns = stamp_ns
            self._readings = []
        self._newest_ns = stamp_ns
        self._readings.append(acceleration)
        if stamp_ns - begun_ns >= self._span_ns and len(self._readings) >= self._number:
            self.settle()

    def settle(self) -> None:
        """Decide by the readings since the last mean, if they are enough."""
        if len(self._readings) < _LEAST_NUMBER:
            return
        out = int(_TRIMMED * len(self._readings))
        kept = [sorted(axis)[out : len(axis) - out] for axis in zip(*self._readings, strict=True)]
        x, y, z = (sum(values) / len(values) for values in kept)
        self._mean = (x, y, z)
        self._begun_ns, self._span_ns = None, _LATER_NS
        if self._how != "by its size":
            return
        size = math.hypot(x, y, z)
        fits = (f for f in (G_M_S2, 1.0) if _LEAST <= size * f / G_M_S2 <= _MOST)
        factor = next(fits, 0.0)
        if self.factor is None:
            self.factor = factor
        elif factor == self.factor or (self._against and self._against[-1] != factor):
            self._against = [factor] if factor != self.factor else []
        else:
            self._against.append(factor)
        if len(self._against) >= _OVERTURN:
            self.factor, self._against = factor, []
            self.changes += 1

    @property
    def warning(self) -> str:
        """Return what to set right, or an empty text; the graph checks size and sign."""
        if self._mean is None or self.factor != 0.0:
            return ""
        return (
            f"acceleration averages {math.hypot(*self._mean):.2f}, which is gravity neither in g "
            "nor in m/s2: no imu/data of it. Set raw acceleration data in DJI Assistant 2 (SDK), "
            "not fused"
        )

    @property
    def text(self) -> str:
        """Return the unit for people, and how it is known."""
        how = self._how
        if how == "by its size" and self._mean is not None:
            how = f"{how}, {math.hypot(*self._mean):.3f}"
        return _NAMES[self.factor] if self.factor is None else f"{_NAMES[self.factor]} ({how})"


_SPAN_S = 2.0
#: No interpolation between two attitudes further apart than this, the limit of gimbal_node too.
_LONGEST_GAP_S = 0.25
#: An attitude is propagated by the rate for no longer than this: five steps of the broadcast at
#: 100 Hz. At 10 rad/s2, as fast as a large aircraft starts to turn, the rate's change leaves 0.7
#: deg.
_CARRIED_NS = 50_000_000
#: A stream counts as silent after this time: five samples of the slowest (50 Hz), half of the gap
#: that the filter bridges. Then attitudes of others are taken.
_SILENT_NS = 100_000_000
#: A stamp that goes back further comes from another clock and passes; the filter judges it.
_CLOCK_NS = 1_000_000_000
#: Largest difference of a quaternion's norm from one, as in the core.
_NORM_SLACK = 0.01


def unit_quaternion(q: Quaternion) -> Array | None:
    """Return q as (4,) wxyz of unit norm, w >= 0; None if it is not finite or not of unit norm."""
    w, x, y, z = q
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if not abs(norm - 1.0) < _NORM_SLACK:  # true for NaN and infinity as well
        return None
    scale = math.copysign(1.0 / norm, w)
    return np.array((w * scale, x * scale, y * scale, z * scale))


class AutopilotAttitudes:
    """Buffer the newest attitudes: of the IMU stream in use, else of all other streams."""

    def __init__(self, counts: Counter[str]) -> None:
        """Take ``counts``, where ``attitude_unused`` counts attitudes beside a better stream."""
        self._counts = counts
        self._history: StampedBuffer[Array] = StampedBuffer(_SPAN_S, _LONGEST_GAP_S)
        self._best_ns: int | None = None

    def put(self, stamp_ns: int, q_nb: Array) -> None:
        """Take an attitude (4,) from the IMU stream in use."""
        self._best_ns = stamp_ns
        self._add(stamp_ns, q_nb)

    def offer(self, stamp_ns: int, q_nb: Array) -> None:
        """Take an attitude (4,) of another stream; it is used while the better one is silent.

        Two streams differ by milliseconds of delay: mixed, they would jitter while the aircraft
        turns.
        """
        best_ns = self._best_ns
        if best_ns is not None and -_CLOCK_NS < stamp_ns - best_ns <= _SILENT_NS:
            self._counts["attitude_unused"] += 1
            return
        self._add(stamp_ns, q_nb)

    def _add(self, stamp_ns: int, q_nb: Array) -> None:
        newest_ns = self._history.newest_ns
        if newest_ns is not None and 0 <= newest_ns - stamp_ns < _CLOCK_NS:
            self._counts["attitude_unused"] += 1
            return
        self._history.put(stamp_ns, q_nb)

    def at(self, stamp_ns: int) -> Array | Miss:
        """Return the interpolated attitude (4,) at an instant, or the reason why there is none."""
        pair = self._history.around(stamp_ns)
        if isinstance(pair, Miss):
            return pair
        return pair[0] if pair[2] == 0.0 else slerp(*pair)

    def carried(self, stamp_ns: int, angular_rate_b: Vector) -> Array | None:
        """Return the newest attitude (4,) propagated by the rate (b, rad/s).

        Returns None if the newest attitude is too far from the instant.
        """
        newest_ns = self._history.newest_ns
        if newest_ns is None or abs(stamp_ns - newest_ns) > _CARRIED_NS:
            return None
        newest = self.at(newest_ns)
        assert not isinstance(newest, Miss)
        step_s = (stamp_ns - newest_ns) * 1e-9
        x, y, z = angular_rate_b
        turn = quaternion_of(x * step_s, y * step_s, z * step_s)
        return unit_quaternion(quat_multiply(tuple(newest.tolist()), turn))


#: A better stream is selected once it has been there for this time without such a silence.
_STEADY_NS = 100_000_000
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
        if self.driver is None:
            self.driver = origin
        elif origin is not self.driver:
            silent = not -_CLOCK_NS < stamp_ns - self._newest_ns <= _SILENT_NS
            if not (silent or self._is_steadily_better(self.driver, origin, stamp_ns)):
                return False
            self.driver, self._better = origin, None
            self.handovers += 1
        self._newest_ns = stamp_ns
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
