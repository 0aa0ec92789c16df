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

_Entry = tuple[int, Vector, Vector, "Array | None"]  # stamp, acceleration, rate, attitude

# The unit of acceleration.

#: The unit g of DJI's accelerometer is standard gravity by definition, not the local gravity. The
#: values of DJI's wrappers, 9.801 and 9.8, are rounded: 0.06 and 0.07 % too small.
G_M_S2 = 9.80665
#: The first mean is over this time and this many readings, each later mean over _LATER_NS.
_FIRST_NS, _FIRST_NUMBER = 400_000_000, 20
_LATER_NS = 2_000_000_000
#: Fewer readings than this give no mean.
_LEAST_NUMBER = 5
#: Number of contradicting means in a row that change the decision. While an aircraft gains speed,
#: a fused acceleration may look like 1 g in m/s2 for seconds, but not for this many means.
_OVERTURN = 3
#: Share of the readings that is trimmed at either end, against outliers. A median would reject
#: them as well, but fails for a vibration that has only two values.
_TRIMMED = 0.1
#: Full scale of any IMU on an aircraft, in either unit.
_FULL_SCALE = 400.0
#: Over seconds, the mean acceleration of a flight is between half and twice gravity.
_LEAST, _MOST = 0.5, 2.0
_NAMES = {None: "not known yet", 0.0: "fused, without gravity", 1.0: "m/s2", G_M_S2: "g"}
_FACTORS = {"g": G_M_S2, "m/s2": 1.0}

# The autopilot's attitudes.

_SPAN_S = 2.0
#: No interpolation between two attitudes further apart than this, the limit of gimbal_node too.
_LONGEST_GAP_S = 0.25
#: An attitude is propagated by the rate for at most this time: five steps of the broadcast at 100
#: Hz. At 10 rad/s2, as fast as a large aircraft starts to turn, the change of the rate causes an
#: error of 0.7 deg.
_CARRIED_NS = 50_000_000
#: Largest difference of a quaternion's norm from one, as in the core.
_NORM_SLACK = 0.01

# The choice among several streams.

#: A stream counts as silent after this time: five samples of the slowest stream (50 Hz), half of
#: the gap that the filter bridges. Then attitudes of other streams are taken.
_SILENT_NS = 100_000_000
#: A stamp that goes back further belongs to another clock: it passes, and the filter judges it.
_CLOCK_NS = 1_000_000_000
#: A better stream is selected once it has been present for this time without a silence.
_STEADY_NS = 100_000_000
#: Largest difference between the stamps of one instant from two sources, including their clocks'
#: jitter.
_SAME_NS = 20_000_000
_RANK = {origin: rank for rank, origin in enumerate(ImuOrigin)}

# Samples.

#: Larger numbers are invalid in any unit. Smaller impossible values are judged by the filter.
_LARGEST = 1e6
#: Largest number of samples that wait for their unit: 5 s at 100 Hz of readings that are too few
#: or too large to decide.
_MOST_WAITING = 500


class StreamUnit:
    """Find the unit of one stream's accelerations, and whether they are specific force at all.

    The setting in DJI Assistant 2 determines the broadcast's acceleration: raw (g), or fused
    (without gravity). Vibration is as large as gravity, so single readings prove nothing. The mean
    over half a second removes the vibration: about 1 g remains, at rest and nearly always in
    flight.

    ``factor`` converts to m/s2; 0: no specific force; None: not known yet.
    """

    def __init__(self, configured: str, counts: Counter[str]) -> None:
        """Take ``configured``, the parameter ``acceleration_unit``: auto, g or m/s2."""
        self._counts = counts
        self.factor = _FACTORS.get(configured)
        self._how = "by its size" if self.factor is None else "acceleration_unit"
        self._mean: Vector | None = None  # the newest mean, in the stream's unit
        self._against: list[float] = []  # factors of the newest means, which contradict ``factor``
        self._span_ns, self._number = _FIRST_NS, _FIRST_NUMBER
        self._begun_ns: int | None = None
        self._newest_ns = 0
        self._readings: list[Vector] = []

    def add(self, stamp_ns: int, acceleration: Vector, unit: AccelerationUnit) -> None:
        """Take a reading (b) of any size; ``unit``: as stated by its source, or UNKNOWN."""
        if unit is not AccelerationUnit.UNKNOWN:
            self.factor, self._how = _FACTORS[unit.value], "stated"
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
        """Decide the unit from the readings since the last mean, if there are enough."""
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
            self._counts["acceleration_unit_changes"] += 1

    @property
    def warning(self) -> str:
        """Return a warning if the acceleration lacks gravity, else an empty text."""
        if self._mean is None or self.factor != 0.0:
            return ""
        return (
            f"acceleration averages {math.hypot(*self._mean):.2f}, which is gravity neither in g "
            "nor in m/s2: it is not published as imu/data. Set raw acceleration data in DJI "
            "Assistant 2 (SDK), not fused"
        )

    @property
    def text(self) -> str:
        """Return the unit for people, and how it was found."""
        how = self._how
        if how == "by its size" and self._mean is not None:
            how = f"{how}, {math.hypot(*self._mean):.3f}"
        return _NAMES[self.factor] if self.factor is None else f"{_NAMES[self.factor]} ({how})"


def unit_quaternion(q: Quaternion) -> Array | None:
    """Return q normalised, (4,) wxyz, w >= 0; None if its norm is not about one."""
    w, x, y, z = q
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if not abs(norm - 1.0) < _NORM_SLACK:  # true for NaN and infinity as well
        return None
    scale = math.copysign(1.0 / norm, w)
    return np.array((w * scale, x * scale, y * scale, z * scale))


class AutopilotAttitudes:
    """Buffer the newest attitudes: of the selected IMU stream, else of the other streams."""

    def __init__(self, counts: Counter[str]) -> None:
        """Take ``counts``; its ``attitude_unused`` counts attitudes that are not buffered."""
        self._counts = counts
        self._history: StampedBuffer[Array] = StampedBuffer(_SPAN_S, _LONGEST_GAP_S)
        self._best_ns: int | None = None

    def put(self, stamp_ns: int, q_nb: Array) -> None:
        """Take an attitude (4,) from the selected IMU stream."""
        self._best_ns = stamp_ns
        self._add(stamp_ns, q_nb)

    def offer(self, stamp_ns: int, q_nb: Array) -> None:
        """Take an attitude (4,) of another stream; use it if the selected stream is silent.

        The delays of two streams differ by milliseconds: mixed attitudes would jitter while the
        aircraft turns.
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
        """Return the newest attitude (4,) propagated to an instant by the rate (b, rad/s).

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


class StreamSelection:
    """Select the best stream that is present."""

    def __init__(self, counts: Counter[str]) -> None:
        self.selected: ImuOrigin | None = None
        self._counts = counts
        self._newest_ns = 0
        self._better: ImuOrigin | None = None
        self._better_since_ns = self._better_newest_ns = 0

    def selects(self, origin: ImuOrigin, stamp_ns: int) -> bool:
        """Return whether a reading of this stream is to be used."""
        if self.selected is None:
            self.selected = origin
        elif origin is not self.selected:
            silent = not -_CLOCK_NS < stamp_ns - self._newest_ns <= _SILENT_NS
            if not (silent or self._is_steadily_better(self.selected, origin, stamp_ns)):
                return False
            self.selected, self._better = origin, None
            self._counts["imu_handovers"] += 1
        self._newest_ns = stamp_ns
        return True

    def _is_steadily_better(self, selected: ImuOrigin, origin: ImuOrigin, stamp_ns: int) -> bool:
        if _RANK[origin] >= _RANK[selected]:
            return False
        if origin is not self._better or not 0 <= stamp_ns - self._better_newest_ns <= _SILENT_NS:
            self._better, self._better_since_ns = origin, stamp_ns
        self._better_newest_ns = stamp_ns
        return stamp_ns - self._better_since_ns >= _STEADY_NS


class Sequence:
    """Make each stamp later than the previous one, if the necessary change is small.

    A stamp up to 20 ms before the newest is moved to 1 ns after it. A stamp further back comes
    from another clock and is not changed: the user of the samples judges it.
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


class ImuInterpreter:
    """Convert IMU readings to samples, and put every attitude into the buffer.

    Samples wait until the unit of acceleration is known (0.4 s, at least twenty samples). If the
    acceleration has no gravity, they are dropped. Counted: ``imu_refused`` (not finite or too
    large), ``imu_unused_`` with the name of a stream that is not selected, ``imu_out_of_order``,
    ``imu_went_back`` (stamps of another clock, which pass), ``imu_without_gravity``,
    ``imu_unit_not_known``, ``imu_without_attitude``, ``imu_attitude_carried`` (from another
    message), ``attitude_not_unit``, ``imu_handovers`` and ``acceleration_unit_changes``.
    """

    def __init__(
        self, config: DjiConfig, attitudes: AutopilotAttitudes, counts: Counter[str]
    ) -> None:
        self.configure(config)
        self._attitudes = attitudes
        self._counts = counts
        self._streams = StreamSelection(counts)
        unit = config.acceleration_unit
        self._units = {origin: StreamUnit(unit, counts) for origin in ImuOrigin}
        self._waiting: deque[_Entry] = deque()
        self._waiting_origin: ImuOrigin | None = None
        self._newest_ns: int | None = None

    def configure(self, config: DjiConfig) -> None:
        """Take the delay, at the start or changed in flight."""
        self._delay_ns = round(config.delay.imu_s * 1e9)

    def take(self, reading: ImuReading) -> list[ImuSample]:
        """Return the sample of a reading, after those that waited for the unit; or none."""
        stamp_ns, origin, (x, y, z), unit, (p, q, r), q_nb = reading
        stamp_ns -= self._delay_ns
        # false for NaN as well
        is_valid = abs(x) + abs(y) + abs(z) + abs(p) + abs(q) + abs(r) < _LARGEST
        is_selected = is_valid and self._streams.selects(origin, stamp_ns)
        attitude = None if q_nb is None else self._attitude(q_nb)
        if attitude is not None:
            (self._attitudes.put if is_selected else self._attitudes.offer)(stamp_ns, attitude)
        if not is_valid:
            self._counts["imu_refused"] += 1
            return []
        stream = self._units[origin]
        stream.add(stamp_ns, reading.acceleration_b, unit)
        factor = stream.factor
        if not is_selected:
            self._counts[f"imu_unused_{origin.value}"] += 1
            return []
        if attitude is None:
            attitude = self._attitudes.carried(stamp_ns, reading.angular_rate_b)
            reason = "without_attitude" if attitude is None else "attitude_carried"
            self._counts[f"imu_{reason}"] += 1
        entry = (stamp_ns, reading.acceleration_b, reading.angular_rate_b, attitude)
        if factor is None:
            if origin is not self._waiting_origin:
                self._drop_waiting(0)
            self._waiting_origin = origin
            self._waiting.append(entry)
            self._drop_waiting(_MOST_WAITING)
            return []
        if self._waiting:
            return [*self._release(origin, factor), *self._sample(entry, factor)]
        return self._sample(entry, factor)

    def take_attitude(self, reading: AttitudeReading) -> list[ImuSample]:
        """Take an attitude that came in a message of its own; return no sample."""
        attitude = self._attitude(reading.q_nb)
        if attitude is not None:
            self._attitudes.offer(reading.stamp_ns - self._delay_ns, attitude)
        return []

    def flush(self) -> list[ImuSample]:
        """Return the waiting samples, if they suffice to find their unit."""
        if self._waiting_origin is None:
            return []
        stream = self._units[self._waiting_origin]
        if stream.factor is None:
            stream.settle()
        if stream.factor is None:
            self._drop_waiting(0)
            return []
        return self._release(self._waiting_origin, stream.factor)

    def _attitude(self, q_nb: Quaternion) -> Array | None:
        attitude = unit_quaternion(q_nb)
        if attitude is None:
            self._counts["attitude_not_unit"] += 1
        return attitude

    def _drop_waiting(self, keep: int) -> None:
        while len(self._waiting) > keep:
            self._waiting.popleft()
            self._counts["imu_unit_not_known"] += 1

    def _release(self, origin: ImuOrigin, factor: float) -> list[ImuSample]:
        """Return the waiting samples, converted by ``factor``; drop those of another stream."""
        if origin is not self._waiting_origin:
            self._drop_waiting(0)
        entries, self._waiting = self._waiting, deque()
        return [sample for entry in entries for sample in self._sample(entry, factor)]

    def _sample(self, entry: _Entry, factor: float) -> list[ImuSample]:
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
    def diagnostics(self) -> dict[str, str]:
        """Return the selected stream and the unit of its accelerations."""
        origin = self._streams.selected
        if origin is None:
            return {"imu_source": "none"}
        return {"imu_source": origin.value, "acceleration_unit": self._units[origin].text}

    @property
    def warnings(self) -> list[str]:
        """Return the warning of each stream, empty where its accelerations are right."""
        return [unit.warning for unit in self._units.values()]
