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
"""Check that topics arrive: often enough, without gaps, in order, with stamps and covariances.

Stamps are measurement times on one clock. A sample's age is its arrival time minus its stamp. The
ages of topics on one clock differ only by their transport times; a topic that is younger on
arrival than the IMU has stamps in the future.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

import numpy as np

from tirgeo_ros.core.checks.finding_table import finding
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.fusion import AIDS, Delays
from tirgeo_ros.core.types.finding import Finding
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    FixStatus,
    HeadingSample,
    JointSample,
    NavigationInput,
    PositionSample,
    VelocitySample,
)

IMU = "imu/data"
#: Waiting time after which a missing topic is reported.
_PATIENCE_NS = 8_000_000_000
#: The interface's rates, with a tolerance of a tenth for clocks and rounding.
_LEAST_IMU_HZ, _MOST_IMU_HZ, _LEAST_RTK_HZ = 45.0, 440.0, 1.8
_LEAST_STEPS = 8  # from which a rate is computed
_MOST_BACK = 0.01  # share of the samples
_LEAST_UNSTAMPED, _LEAST_UNKNOWN = 3, 10  # samples
_DELAYED = {s.topic: (s, aid.delay) for s, aid in AIDS.items() if aid.delay}
#: The parameter whose sigma is used where a topic's covariance is 0.
_FLOORS = {
    "rtk/fix": "rtk.position_sigma_floor_m",
    "rtk/vel": "rtk.velocity_sigma_floor_m_s",
    "rtk/heading": "heading.sigma_floor_deg",
    "gps/fix": "gps.position_sigma_m",
    "gps/vel": "gps.velocity_sigma_floor_m_s",
}

# Comparison of ages with the IMU's.
#: Number of one-second medians that must agree.
_WINDOWS = 3
#: Transport times differ by some hundredths of a second; at 3 m/s a tenth is 30 cm.
_AHEAD_S, _STEP_S = -0.1, 0.15
_SECOND_NS = 1_000_000_000
#: After a longer silence the IMU's age is not used.
_OLD_NS = 500_000_000


class Stream:
    """Track one topic; steps longer than ``longest_step_s`` are gaps."""

    def __init__(self, longest_step_s: float) -> None:
        self.limit_s = longest_step_s
        # samples; with stamp 0; not later than the one before; without a covariance
        self.count = self.unstamped = self.back = self.unknown = 0
        self.gaps = self.longest_ns = self.gap_ended_ns = 0
        self.newest_ns = self.arrived_ns = 0
        self.age_ns = 0  # arrival minus stamp of the newest sample
        self.alone = self.alone_ns = 0  # single stamps that jumped; the stamp after the newest one
        # newest stamp and gaps before a step that may be a single jump
        self._before: tuple[int, int, int, int] | None = None
        self._flowing_ns = self._steps = 0  # over the steps that are not gaps

    def add(
        self, sample: NavigationInput | JointSample | CameraAttitudeSample, arrival_ns: int
    ) -> None:
        """Take the next sample to arrive; one with stamp 0 gets its arrival time."""
        self.unstamped += sample.stamp_ns == 0
        self.unknown += _has_no_covariance(sample)
        stamp_ns = sample.stamp_ns or arrival_ns
        limit_ns = self.limit_s * 1e9
        if self._before and 0 < stamp_ns - self._before[0] <= limit_ns:
            self.newest_ns, self.gaps, self.longest_ns, self.gap_ended_ns = self._before
            self.alone, self.alone_ns = self.alone + 1, stamp_ns
        step_ns = stamp_ns - self.newest_ns
        before = self.newest_ns, self.gaps, self.longest_ns, self.gap_ended_ns
        self._before = before if self.count and abs(step_ns) > limit_ns else None
        if self.count and step_ns <= 0:
            self.back += 1
        elif self.count and step_ns > limit_ns:
            self.gaps += 1
            self.longest_ns, self.gap_ended_ns = max(self.longest_ns, step_ns), stamp_ns
        elif self.count:
            self._flowing_ns += step_ns
            self._steps += 1
        self.count += 1
        self.newest_ns, self.arrived_ns, self.age_ns = stamp_ns, arrival_ns, arrival_ns - stamp_ns

    @property
    def rate_hz(self) -> float | None:
        """Return the mean rate without gaps, Hz; None with too few samples."""
        return self._steps / (self._flowing_ns * 1e-9) if self._steps >= _LEAST_STEPS else None


def _has_no_covariance(sample: object) -> bool:
    if isinstance(sample, HeadingSample):
        return sample.variance_rad2 <= 0
    if not isinstance(sample, (PositionSample, VelocitySample)):
        return False
    if isinstance(sample, PositionSample) and sample.status is FixStatus.NONE:
        return False
    return bool(sample.covariance_n.diagonal().min() <= 0)


def longest_step_s(topic: str, config: EkfConfig) -> float:
    """Return the longest step between samples of a topic, s; a longer one is a gap."""
    return config.max_imu_gap_s if topic == IMU else config.trust.aid_timeout_s


def stream_findings(
    streams: Mapping[str, Stream],
    config: EkfConfig,
    waited_ns: int,
    gap_counts_s: float,
    *,
    inertial: bool = True,
) -> list[Finding]:
    """Return what is wrong with the streams ``waited_ns`` after the first sample of any.

    A topic's gaps become a note ``gap_counts_s`` after the last one. Without an ``inertial`` unit
    the samples are those of pictures, which may come at any rate.
    """
    findings = _shares(streams, config)
    if inertial:
        findings = [*_rates(streams), *_gaps(streams, gap_counts_s), *findings]
        findings += lone_findings(streams, gap_counts_s)
    if waited_ns > _PATIENCE_NS:
        absent = [] if IMU in streams else ["no_imu_data"]
        if config.method == "raw":
            absent += [] if "gps/fix" in streams else ["no_gps_fix"]
        elif "rtk/fix" not in streams:
            absent.append("no_rtk_fix")
        elif inertial and config.method == "ekf_heading" and "rtk/heading" not in streams:
            absent.append("no_rtk_heading")
        elif inertial and "rtk/vel" not in streams:
            absent.append("no_rtk_vel")
        case = "gps" if "gps/fix" in streams and config.method != "rtk" else ""
        findings += [finding(check, case, waited_s=waited_ns * 1e-9) for check in absent]
    return findings


def lone_findings(streams: Mapping[str, Stream], counts_s: float = math.inf) -> list[Finding]:
    """Return a finding on single stamps that jumped: a note ``counts_s`` after the last one."""
    alone = {topic: stream for topic, stream in streams.items() if stream.alone}
    if not alone:
        return []
    is_past = all(s.newest_ns - s.alone_ns > counts_s * 1e9 for s in alone.values())
    counts = ", ".join(f"{topic} ({s.alone} of {s.count})" for topic, s in alone.items())
    case = "past" if is_past else ""
    return [finding("stamp_alone", case, counts=counts, topic=next(iter(alone)))]


def _rates(streams: Mapping[str, Stream]) -> list[Finding]:
    findings = []
    imu_hz = streams[IMU].rate_hz if IMU in streams else None
    if imu_hz is not None and not _LEAST_IMU_HZ <= imu_hz <= _MOST_IMU_HZ:
        findings.append(finding("imu_rate", rate_hz=imu_hz))
    slow = {
        topic: stream.rate_hz
        for topic, stream in streams.items()
        if topic.startswith("rtk/") and (stream.rate_hz or _LEAST_RTK_HZ) < _LEAST_RTK_HZ
    }
    if slow:
        text = ", ".join(f"{topic} at {rate:.1f} Hz" for topic, rate in slow.items())
        findings.append(finding("rtk_rate", rates=text, topic=next(iter(slow))))
    return findings


def _gaps(streams: Mapping[str, Stream], counts_s: float) -> list[Finding]:
    findings = []
    for topic, check in ((IMU, "imu_gaps"), ("rtk/fix", "rtk_gaps")):
        stream = streams.get(topic)
        if stream is not None and stream.gaps:
            is_past = stream.newest_ns - stream.gap_ended_ns > counts_s * 1e9
            gaps = f"{stream.gaps} gaps of more than {stream.limit_s:g} s"
            gaps += f", the longest {stream.longest_ns * 1e-9:.1f} s"
            findings.append(finding(check, "past" if is_past else "", gaps=gaps))
    return findings


def _shares(streams: Mapping[str, Stream], config: EkfConfig) -> list[Finding]:
    """Return the faults that occur in more than a few of a topic's samples."""

    def counts(numbers: Mapping[str, int]) -> str:
        return ", ".join(f"{t} ({number} of {streams[t].count})" for t, number in numbers.items())

    findings = []
    back = {t: s.back for t, s in streams.items() if s.back >= max(3, _MOST_BACK * s.count)}
    unstamped = {t: s.unstamped for t, s in streams.items() if s.unstamped >= _LEAST_UNSTAMPED}
    unknown = {
        topic: stream.unknown
        for topic, stream in streams.items()
        if stream.unknown >= max(_LEAST_UNKNOWN, 0.5 * stream.count)
    }
    if back:
        findings.append(finding("stamp_order", counts=counts(back), topic=next(iter(back))))
    if unstamped:
        names = {IMU: "imu.delay_s"} | {topic: name for topic, (_, name) in _DELAYED.items()}
        of_topics = ", ".join(sorted({names[topic] for topic in unstamped if topic in names}))
        delays = Delays.from_config(config)
        delayed = {s.topic for s, ns in delays.aid_ns.items() if ns != delays.imu_ns}
        case = "delayed" if set(unstamped) <= delayed else ""
        findings.append(finding("stamp_zero", case, counts=counts(unstamped), delays=of_topics))
    if unknown:
        texts = {"counts": counts(unknown), "topic": next(iter(unknown))}
        floors = ", ".join(_FLOORS.get(topic, "") for topic in unknown)
        case = "gps" if all(topic.startswith("gps/") for topic in unknown) else ""
        findings.append(finding("covariance_zero", case, **texts, floors=floors))
    return findings


class StampChecks:
    """Compare the age of every aid with that of the IMU's newest sample, second by second."""

    def __init__(self, config: EkfConfig) -> None:
        self._max_delay_s = config.max_delay_s
        delays = Delays.from_config(config)
        self._delay_ns = {
            topic: delays.aid_ns[source] - delays.imu_ns for topic, (source, _) in _DELAYED.items()
        }
        # for each topic: the start of its present second, and its relative ages since then (ns)
        self._second: dict[str, tuple[int, list[int]]] = {}
        self._medians_s: dict[str, deque[float]] = {}  # of the newest seconds
        self._jumped_s: dict[str, float] = {}

    def take(self, topic: str, stream: Stream, imu: Stream) -> None:
        """Take the newest sample of an aid, already counted by ``stream``."""
        if topic not in _DELAYED or stream.arrived_ns - imu.arrived_ns > _OLD_NS:
            return
        begin_ns, ages_ns = self._second.setdefault(topic, (stream.arrived_ns, []))
        if not 0 <= stream.arrived_ns - begin_ns < _SECOND_NS:
            self._ended(topic, (float(np.median(ages_ns)) + self._delay_ns[topic]) * 1e-9)
            ages_ns = []
            self._second[topic] = stream.arrived_ns, ages_ns
        ages_ns.append(stream.age_ns - imu.age_ns)

    def _ended(self, topic: str, median_s: float) -> None:
        kept = self._medians_s.setdefault(topic, deque(maxlen=2 * _WINDOWS))
        kept.append(median_s)
        before, after = list(kept)[:_WINDOWS], list(kept)[_WINDOWS:]
        if len(after) == _WINDOWS:
            apart_s = float(np.median(after) - np.median(before))
            spread_s = max(max(ages) - min(ages) for ages in (before, after))
            if abs(apart_s) > _STEP_S and spread_s < 0.3 * abs(apart_s):
                self._jumped_s[topic] = apart_s

    def findings(self) -> list[Finding]:
        """Return one finding for each fault: on the topic that is farthest off."""
        recent = {t: list(a)[-_WINDOWS:] for t, a in self._medians_s.items() if len(a) >= _WINDOWS}
        faults = {
            "stamp_ahead": {t: -max(a) for t, a in recent.items() if max(a) < _AHEAD_S},
            "stamp_late": {t: min(a) for t, a in recent.items() if min(a) > self._max_delay_s},
            "stamp_jump": self._jumped_s,
        }
        findings = []
        for check, off_s in faults.items():
            worst = max(off_s, key=lambda topic: abs(off_s[topic]), default=None)
            if worst is not None:
                others = ", ".join(topic for topic in off_s if topic != worst)
                texts = {
                    "topic": worst,
                    "others": f"{IMU} ({others} too)" if others else IMU,
                    "delay": _DELAYED[worst][1],
                }
                numbers = {"off_s": off_s[worst], "limit_s": self._max_delay_s}
                findings.append(finding(check, **texts, **numbers))
        return findings
