"""Check that topics arrive: often enough, without gaps, in order, with stamps and covariances."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.aids import AIDS, Delays
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    FixStatus,
    HeadingSample,
    JointSample,
    NavigationInput,
    PositionSample,
    VelocitySample,
)

NOTE, CAUTION, STOP = Severity
IMU = "imu/data"
#: Waiting time after which a missing topic is reported.
_PATIENCE_NS = 8_000_000_000
#: The interface's rates, with a tolerance of a tenth for clocks and rounding.
_LEAST_IMU_HZ, _MOST_IMU_HZ, _LEAST_RTK_HZ = 45.0, 440.0, 1.8
_LEAST_STEPS = 8  # from which a rate is computed
_MOST_BACK = 0.01  # share of the samples
_LEAST_UNSTAMPED, _LEAST_UNKNOWN = 3, 10  # samples
#: Topics whose gaps are reported: the check, its severity and the mend.
_GAPS = {
    IMU: ("imu_gaps", CAUTION, "the filter starts again after each: look at link and recorder"),
    "rtk/fix": (
        "rtk_gaps",
        NOTE,
        "check the receiver's view of the sky, its corrections and its link",
    ),
}
_REMAP = "check the driver, the topic's name and its namespace"
#: What is taken where a topic's covariance is 0.
_TAKEN = {
    "rtk/fix": "rtk.position_sigma_floor_m",
    "rtk/vel": "rtk.velocity_sigma_floor_m_s",
    "rtk/heading": "heading.sigma_floor_deg",
    "gps/fix": "gps.position_sigma_m",
    "gps/vel": "gps.velocity_sigma_floor_m_s",
}


class Stream:
    """Track one topic; steps longer than ``longest_step_s`` are gaps."""

    def __init__(self, longest_step_s: float) -> None:
        self.limit_s = longest_step_s
        # samples; with stamp 0; not later than the one before; without a covariance
        self.count = self.unstamped = self.back = self.unknown = 0
        self.gaps = self.longest_ns = self.gap_ended_ns = 0
        self.newest_ns = self.arrived_ns = 0
        self.age_ns = 0  # arrival minus stamp of the newest sample
        self.alone = self.alone_ns = 0  # stamps that jumped alone, the newest's successor
        # newest stamp and gaps before a step that may be one
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
    streams: Mapping[str, Stream], config: EkfConfig, waited_ns: int, gap_counts_s: float
) -> list[Finding]:
    """Return what is wrong with the streams ``waited_ns`` after the first sample of any.

    ``gap_counts_s`` after the last gap of a topic its gaps are a note.
    """
    found = [*_rates(streams), *_gaps(streams, gap_counts_s), *_shares(streams, config)]
    found += lone_findings(streams, gap_counts_s)
    if waited_ns > _PATIENCE_NS:
        found += _absent(streams, config.method, waited_ns * 1e-9)
    return found


def lone_findings(streams: Mapping[str, Stream], counts_s: float = math.inf) -> list[Finding]:
    """Return the topics of which single stamps jumped, as a note ``counts_s`` after the last."""
    alone = {topic: stream for topic, stream in streams.items() if stream.alone}
    if not alone:
        return []
    past = all(one.newest_ns - one.alone_ns > counts_s * 1e9 for one in alone.values())
    counts = ", ".join(f"{topic} ({one.alone} of {one.count})" for topic, one in alone.items())
    evidence = f"stamps jump and return with the next sample: {counts}"
    mend = "the filter leaves such samples out: look at the clock of the driver, and at the file"
    severity = NOTE if past else CAUTION
    return [Finding("stamp_alone", severity, evidence, next(iter(alone)), mend)]


def _absent(streams: Mapping[str, Stream], method: str, waited_s: float) -> list[Finding]:
    missed = []
    if IMU not in streams:
        missed.append((STOP, IMU, "", _REMAP))
    if method == "raw":
        if "gps/fix" not in streams:
            missed.append((STOP, "gps/fix", ": method raw has no position", _REMAP))
    elif "rtk/fix" not in streams:
        fallback = "gps/fix" in streams and method != "rtk"
        what = "the position is the ordinary GPS's" if fallback else "nothing gives a position"
        missed.append((NOTE if fallback else STOP, "rtk/fix", f": {what}", _REMAP))
    elif method == "ekf_heading" and "rtk/heading" not in streams:
        mend = f"{_REMAP}; with one antenna set ekf_node method to ekf"
        what = ": the heading comes from turns or the autopilot"
        missed.append((CAUTION, "rtk/heading", what, mend))
    elif "rtk/vel" not in streams:
        missed.append((NOTE, "rtk/vel", ": attitude and heading are less certain", _REMAP))
    return [
        Finding(
            f"no_{topic.replace('/', '_')}",
            severity,
            f"{topic}: nothing in {waited_s:.0f} s{what}",
            topic,
            mend,
        )
        for severity, topic, what, mend in missed
    ]


def _rates(streams: Mapping[str, Stream]) -> list[Finding]:
    found = []
    imu_hz = streams[IMU].rate_hz if IMU in streams else None
    if imu_hz is not None and not _LEAST_IMU_HZ <= imu_hz <= _MOST_IMU_HZ:
        evidence = f"imu/data comes at {imu_hz:.0f} Hz, not 50 to 400"
        found.append(Finding("imu_rate", CAUTION, evidence, IMU, "set the driver's rate"))
    slow = {
        topic: stream.rate_hz
        for topic, stream in streams.items()
        if topic.startswith("rtk/") and (stream.rate_hz or _LEAST_RTK_HZ) < _LEAST_RTK_HZ
    }
    if slow:
        text = ", ".join(f"{topic} at {rate:.1f} Hz" for topic, rate in slow.items())
        evidence, mend = f"too few: {text}, not 2 or more", "set the receiver's rate to 5 Hz"
        found.append(Finding("rtk_rate", CAUTION, evidence, next(iter(slow)), mend))
    return found


def _gaps(streams: Mapping[str, Stream], counts_s: float) -> list[Finding]:
    found = []
    for topic, (check, severity, mend) in _GAPS.items():
        stream = streams.get(topic)
        if stream is not None and stream.gaps:
            past = stream.newest_ns - stream.gap_ended_ns > counts_s * 1e9
            evidence = (
                f"{topic} has {stream.gaps} gaps of more than {stream.limit_s:g} s, the longest "
                f"{stream.longest_ns * 1e-9:.1f} s"
            )
            found.append(Finding(check, NOTE if past else severity, evidence, topic, mend))
    return found


def _shares(streams: Mapping[str, Stream], config: EkfConfig) -> list[Finding]:
    """Return the faults that a share of a topic's samples has."""
    found = []

    def listed(
        number: Callable[[Stream], int], least: Callable[[Stream], float]
    ) -> dict[str, str]:
        return {
            topic: f"{topic} ({number(stream)} of {stream.count})"
            for topic, stream in streams.items()
            if number(stream) >= least(stream)
        }

    back = listed(lambda s: s.back, lambda s: max(3, _MOST_BACK * s.count))
    if back:
        evidence = f"stamps are not later than the previous ones: {', '.join(back.values())}"
        mend = "is there more than one publisher, or a clock with coarse steps?"
        found.append(Finding("stamp_order", CAUTION, evidence, next(iter(back)), mend))
    unstamped = listed(lambda s: s.unstamped, lambda _: _LEAST_UNSTAMPED)
    if unstamped:
        evidence = f"stamps are 0: {', '.join(unstamped.values())}; the time of arrival is used"
        mend = "let the driver stamp with the time of measurement, or set the delay to arrival"
        names = {IMU: "imu.delay_s"} | {s.topic: aid.delay for s, aid in AIDS.items() if aid.delay}
        where = f"ekf_node {', '.join(sorted({names[t] for t in unstamped if t in names}))}"
        delays = Delays.from_config(config)
        known = {s.topic for s, ns in delays.aid_ns.items() if ns != delays.imu_ns}
        severity = NOTE if set(unstamped) <= known else CAUTION  # such a driver needs a delay
        found.append(Finding("stamp_zero", severity, evidence, where, mend))
    unknown = listed(lambda s: s.unknown, lambda s: max(_LEAST_UNKNOWN, 0.5 * s.count))
    if unknown:
        taken = ", ".join(_TAKEN.get(topic, "") for topic in unknown)
        evidence = f"covariances are zero: {', '.join(unknown.values())}; {taken} is taken"
        severity = NOTE if all(topic.startswith("gps/") for topic in unknown) else CAUTION
        mend = "let the driver fill it with the receiver's own accuracy (m2, (m/s)2, rad2)"
        where = f"{next(iter(unknown))} covariance"
        found.append(Finding("covariance_zero", severity, evidence, where, mend))
    return found
