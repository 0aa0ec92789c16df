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
"""Record what each aid has done lately: whether it is used or refused, and since when.

The records are part of the filter's estimate and are kept at each epoch of the time line. So a
late measurement is judged by the same records as if it had arrived in time.
"""

from __future__ import annotations

import math
import operator
from typing import NamedTuple

from tirgeo_ros.core.navigation.aiding.rtk_consistency import Consistency
from tirgeo_ros.core.navigation.ins.error_states import (
    ANTENNA,
    BAROMETER_OFFSET,
    DELAY,
    GPS_ERROR,
    GPS_VELOCITY_ERROR,
)
from tirgeo_ros.core.navigation.ins.strapdown import Vector
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import FixStatus, Source

#: The sources of measurements, in the order in which those of one instant are used.
AID_SOURCES = tuple(s for s in Source if s is not Source.IMU)
PLACE: dict[Source, int] = {source: place for place, source in enumerate(AID_SOURCES)}
NEVER_NS = -(1 << 62)
#: An aid that returns after a silence corrects the drift since then in this many equal steps.
EASE_STEPS = 5
_LEAST_RUN = 5  # refusals that count as a run
#: A contradiction is a step if this share of it appeared between two measurements. The receiver
#: has stepped then, since a state propagated with the IMU drifts gradually.
_STEP_SHARE = 0.7
#: The state follows a receiver that has stepped after this time, if no other aid can decide.
STEPPED_S = 20.0
#: With this many resets of position or velocity in this time, the filter does not recover.
_HOPELESS_RESETS, _HOPELESS_NS = 3, 10_000_000_000


class RefusedRun(NamedTuple):
    """Hold a run of measurements that were refused one after another and agree with each other."""

    first_ns: int
    last_ns: int
    number: int
    innovation: tuple[float, ...]  # of the first, in a form that motion does not change

    def lasts(self, seconds: float) -> bool:
        """Return whether it has lasted ``seconds``, with at least five measurements."""
        return self.number >= _LEAST_RUN and self.last_ns - self.first_ns >= seconds * 1e9


class AidTrack(NamedTuple):
    """Hold one aid's record."""

    used_ns: int = NEVER_NS
    agreed_ns: int = 0  # time in use, without silences and refusals
    ease: int = 0  # remaining correction steps (see EASE_STEPS)
    run: RefusedRun | None = None
    mean_rad: float = 0.0  # running mean of the heading innovations
    newest: tuple[float, ...] = ()  # newest innovation, in the form of ``RefusedRun``
    step: tuple[float, ...] = ()  # from the last used to the refused innovation; empty: a drift
    # Refusals since the last use, whether they agree or not, without stale ones:
    denied_ns: int = 0  # stamp of the first
    denied_to_ns: int = 0  # stamp of the newest
    denied: int = 0  # their number
    # Of GPS positions: their mean difference from the state (NED, m), the largest over its sigma.
    against: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)

    def recent(self, now_ns: int, timeout_ns: int) -> bool:
        """Return whether it was used within the time-out."""
        return now_ns - self.used_ns <= timeout_ns

    @property
    def judged_ns(self) -> int:
        """Return the stamp of the newest measurement that was used or refused."""
        return max(self.used_ns, self.denied_to_ns if self.denied else NEVER_NS)

    def used(self, now_ns: int, timeout_ns: int, innovation: tuple[float, ...] = ()) -> AidTrack:
        """Return the record after a measurement was used."""
        agreed_ns = self.agreed_ns
        if self.run is None and self.recent(now_ns, timeout_ns):
            agreed_ns += now_ns - self.used_ns
        ease, mean_rad = max(self.ease - 1, 0), self.mean_rad
        return AidTrack(
            now_ns, agreed_ns, ease, mean_rad=mean_rad, newest=innovation, against=self.against
        )

    def followed(self, innovation: tuple[float, ...], expected: tuple[float, ...]) -> AidTrack:
        """Return the record after a possible step of a new innovation, which is not gated yet.

        ``expected`` is the innovation of zero, in the same form. A step back to it ends the
        recorded step. Another step is added to the recorded one; refusals are counted anew.
        """
        if not self.step:
            return self
        change = tuple(map(operator.sub, innovation, self.newest))
        if math.hypot(*change) < _STEP_SHARE * math.hypot(*self.step):
            return self
        if math.dist(innovation, expected) < 0.5 * math.dist(self.newest, expected):
            return self._replace(step=())
        return self._replace(step=tuple(map(operator.add, self.step, change)), denied=0)

    def stepped(
        self, innovation: tuple[float, ...], expected: tuple[float, ...]
    ) -> tuple[float, ...]:
        """Return the step from the last used innovation to this one; empty if it drifted."""
        if self.step or self.denied or not self.newest:
            return self.step
        step = tuple(map(operator.sub, innovation, self.newest))
        small = math.hypot(*step) < _STEP_SHARE * math.dist(innovation, expected)
        return () if small else step

    def refused(
        self,
        now_ns: int,
        innovation: tuple[float, ...],
        slack: float,
        *,
        stale: bool = False,
        step: tuple[float, ...] = (),
    ) -> AidTrack:
        """Return the record after a refusal; it joins the run if within ``slack`` of its first."""
        run = self.run
        if run is None or max(map(abs, map(operator.sub, run.innovation, innovation))) > slack:
            run = RefusedRun(now_ns, now_ns, 1, innovation)
        else:
            run = run._replace(last_ns=now_ns, number=run.number + 1)
        track = self._replace(run=run, newest=innovation, step=step)
        if stale:
            return track
        begun_ns = self.denied_ns if self.denied else now_ns
        return track._replace(denied_ns=begun_ns, denied_to_ns=now_ns, denied=self.denied + 1)


class Receivers(NamedTuple):
    """Hold the estimated slow errors of the receivers at ``stamp_ns``."""

    stamp_ns: int
    gps_error_n: Vector = (0.0, 0.0, 0.0)  # m
    barometer_offset_m: float = 0.0  # standard height less true height
    gps_velocity_error_n: Vector = (0.0, 0.0, 0.0)  # m/s
    antenna_b: Vector = (0.0, 0.0, 0.0)  # m, RTK antenna's position less the configured one, FRD
    imu_delay_s: float = 0.0  # delay of the IMU's stamps, beyond the configured one

    def at(self, stamp_ns: int, gps_time_s: float) -> Receivers:
        """Return the errors at another time: those of GPS decay with ``gps_time_s``."""
        fade = math.exp((self.stamp_ns - stamp_ns) * 1e-9 / gps_time_s)
        (north, east, down), (u, v, w) = self.gps_error_n, self.gps_velocity_error_n
        faded, slower = (north * fade, east * fade, down * fade), (u * fade, v * fade, w * fade)
        return self._replace(stamp_ns=stamp_ns, gps_error_n=faded, gps_velocity_error_n=slower)

    def changed(self, error: Array) -> Receivers:
        """Return the errors plus those in the error states (n,), with the antenna's or without."""
        e, add = error.tolist(), operator.add
        moved: Vector = tuple(map(add, self.gps_error_n, e[GPS_ERROR]))
        offset_m = self.barometer_offset_m + e[BAROMETER_OFFSET.start]
        faster: Vector = tuple(map(add, self.gps_velocity_error_n, e[GPS_VELOCITY_ERROR]))
        place: Vector = tuple(map(add, self.antenna_b, e[ANTENNA])) or self.antenna_b
        delay_s = self.imu_delay_s + e[DELAY]
        return Receivers(self.stamp_ns, moved, offset_m, faster, place, delay_s)


class Reset(NamedTuple):
    """Hold a reset of the state to a measurement."""

    source: Source
    stamp_ns: int
    text: str  # what was reset, and by how much

    def __str__(self) -> str:
        """Return the reset in words."""
        return self.text


class RtkStatus(NamedTuple):
    """Hold the RTK receiver's fix status, and its newest positions and velocities."""

    status: FixStatus | None = None  # of rtk/fix; None: no sample yet
    status_ns: int = NEVER_NS
    fixed_since_ns: int = NEVER_NS
    offsets_n: tuple[Vector, ...] = ()  # of the newest positions, for the median
    consistency: Consistency = Consistency()  # positions against velocities

    def at(self, now_ns: int, timeout_ns: int) -> FixStatus | None:
        """Return the newest fix status; None if it is older than the time-out."""
        return self.status if now_ns - self.status_ns <= timeout_ns else None


class AidStatus(NamedTuple):
    """Hold the records of all aids."""

    receivers: Receivers
    tracks: tuple[AidTrack, ...] = (AidTrack(),) * len(AID_SOURCES)
    rtk: RtkStatus = RtkStatus()
    resets: tuple[int, ...] = (0,) * len(AID_SOURCES)
    rtk_resets: tuple[Reset, ...] = ()  # the newest resets to RTK positions and velocities
    last_reset: Reset | None = None

    def track(self, source: Source) -> AidTrack:
        """Return the record of a source."""
        return self.tracks[PLACE[source]]

    def with_imu_delay(self, change_s: float) -> AidStatus:
        """Return the records with the IMU's delay changed."""
        receivers = self.receivers
        delay_s = receivers.imu_delay_s + change_s
        return self._replace(receivers=receivers._replace(imu_delay_s=delay_s))

    @property
    def gps_sigmas(self) -> float:
        """Return the largest slow difference of gps/fix from the state, over its sigma."""
        return self.track(Source.GPS_POSITION).against[3]

    @property
    def pending_step(self) -> tuple[float, ...]:
        """Return the step of RTK's position (m, NED) that is not accepted yet, or ()."""
        return self.track(Source.RTK_POSITION).step

    def with_track(self, source: Source, track: AidTrack) -> AidStatus:
        """Return a copy with one record changed."""
        place = PLACE[source]
        return self._replace(tracks=(*self.tracks[:place], track, *self.tracks[place + 1 :]))

    def with_status(self, status: FixStatus, now_ns: int, timeout_ns: int) -> AidStatus:
        """Return a copy with RTK's newest fix status; positions fixed again are eased in."""
        fixed = status is FixStatus.FIXED
        was_fixed = self.rtk.at(now_ns, timeout_ns) is FixStatus.FIXED
        begun_ns = self.rtk.fixed_since_ns if fixed and was_fixed else now_ns
        rtk = self.rtk._replace(status=status, status_ns=now_ns, fixed_since_ns=begun_ns)
        after = self._replace(rtk=rtk)
        if not fixed or was_fixed or self.rtk.status is None:
            return after
        # State and positions have drifted apart while the solution was float.
        track = self.track(Source.RTK_POSITION)._replace(ease=EASE_STEPS)
        return after.with_track(Source.RTK_POSITION, track)

    def with_reset(self, source: Source, now_ns: int, text: str) -> AidStatus:
        """Return a copy after a reset, described by ``text``: counted, with a new record."""
        counts = list(self.resets)
        counts[PLACE[source]] += 1
        newest, rtk = Reset(source, now_ns, text), self.rtk_resets
        if source in {Source.RTK_POSITION, Source.RTK_VELOCITY}:
            rtk = (*rtk, newest)[-_HOPELESS_RESETS:]
        track = AidTrack(now_ns, against=self.track(source).against)
        return self.with_track(source, track)._replace(
            resets=tuple(counts), rtk_resets=rtk, last_reset=newest
        )

    def hopeless(self, patience_s: float) -> str:
        """Return why only a restart of the filter helps, or an empty string."""
        rtk = self.rtk_resets
        if len(rtk) == _HOPELESS_RESETS and rtk[-1].stamp_ns - rtk[0].stamp_ns <= _HOPELESS_NS:
            return f"reset repeatedly: {rtk[-1]}"
        # Positions and velocities do not fail together. If the state diverges, their refused
        # innovations do not agree with each other, so all refusals are counted, not only runs.
        both = [self.track(source) for source in (Source.RTK_POSITION, Source.RTK_VELOCITY)]
        if any(track.step for track in both):  # the receiver has stepped, not the state
            patience_s = max(patience_s, STEPPED_S)
        for_long = all(t.denied_to_ns - t.denied_ns >= patience_s * 1e9 for t in both)
        if for_long and all(track.denied >= _LEAST_RUN for track in both):
            return "rtk/fix and rtk/vel both contradict the state"
        return ""
