"""Check that topics arrive, often enough and without gaps."""

from __future__ import annotations

from collections.abc import Mapping

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.types.finding import Finding, Severity

#: Waiting time after which a missing topic is reported.
_PATIENCE_NS = 8_000_000_000
#: The interface's rates, with a tolerance of a tenth for clocks and rounding.
_LEAST_IMU_HZ, _MOST_IMU_HZ = 45.0, 440.0
_LEAST_RTK_HZ = 1.8
_MOST_BACK = 0.01  # share of the samples
_LEAST_STEPS = 8  # from which a rate is computed
#: Topics whose gaps are reported: the check, its severity and the mend.
_GAPS = {
    "imu/data": (
        *("imu_gaps", Severity.CAUTION),
        "the filter starts again after each: look at link, load and recorder",
    ),
    "rtk/fix": (
        *("rtk_gaps", Severity.NOTE),
        "look at the receiver's sky, corrections and link",
    ),
}
_REMAP = "look at the driver, the topic's name and its namespace"


class Stream:
    """Track one topic; a sample costs less than 1 us."""

    def __init__(self, longest_step_s: float) -> None:
        self._longest_ns = round(longest_step_s * 1e9)
        # samples; samples with stamp 0; stamps that are not later than the one before
        self.count = self.unstamped = self.back = 0
        self.gaps = self.longest_ns = 0  # steps longer than longest_step_s
        self.newest_ns = self.arrived_ns = 0
        self.age_ns = 0  # arrival minus stamp of the newest sample
        self._flowing_ns = self._steps = 0  # over the steps that are not gaps

    def add(self, stamp_ns: int, arrival_ns: int) -> None:
        """Take the next sample to arrive; one with stamp 0 gets its arrival time."""
        if stamp_ns == 0:
            self.unstamped += 1
            stamp_ns = arrival_ns
        if self.count:
            self._step(stamp_ns - self.newest_ns)
        self.count += 1
        self.newest_ns, self.arrived_ns = stamp_ns, arrival_ns
        self.age_ns = arrival_ns - stamp_ns

    def _step(self, step_ns: int) -> None:
        if step_ns <= 0:
            self.back += 1
        elif step_ns > self._longest_ns:
            self.gaps += 1
            self.longest_ns = max(self.longest_ns, step_ns)
        else:
            self._flowing_ns += step_ns
            self._steps += 1

    @property
    def rate_hz(self) -> float | None:
        """Return the mean rate without gaps, Hz; None with too few samples."""
        return self._steps / (self._flowing_ns * 1e-9) if self._steps >= _LEAST_STEPS else None


def longest_step_s(topic: str, config: EkfConfig) -> float:
    """Return the longest step between samples of a topic, s; a longer one is a gap."""
    return config.max_imu_gap_s if topic == "imu/data" else config.trust.aid_timeout_s


def rate_findings(
    streams: Mapping[str, Stream], config: EkfConfig, waited_ns: int
) -> list[Finding]:
    """Return what is wrong with the streams ``waited_ns`` after the first sample of any."""
    found = [*_rates(streams), *_gaps(streams, config), *_order(streams)]
    if waited_ns > _PATIENCE_NS:
        found += _absent(streams, config.method, waited_ns * 1e-9)
    return found


def _absent(streams: Mapping[str, Stream], method: str, waited_s: float) -> list[Finding]:
    found = []

    def tell(severity: Severity, topic: str, what: str, mend: str = _REMAP) -> None:
        evidence = f"{topic}: nothing in {waited_s:.0f} s{what}"
        name = f"no_{topic.replace('/', '_')}"
        found.append(Finding(name, severity, evidence, topic, mend))

    if "imu/data" not in streams:
        tell(Severity.STOP, "imu/data", "")
    if method == "raw":
        if "gps/fix" not in streams:
            tell(Severity.STOP, "gps/fix", ": method raw has no position")
    elif "rtk/fix" not in streams:
        if "gps/fix" in streams and method != "rtk":
            tell(Severity.NOTE, "rtk/fix", ": the position is the ordinary GPS's")
        else:
            tell(Severity.STOP, "rtk/fix", ": nothing gives a position")
    elif method == "ekf_heading" and "rtk/heading" not in streams:
        mend = f"{_REMAP}; with one antenna set ekf_node method to ekf"
        tell(Severity.CAUTION, "rtk/heading", ": north comes from turns or the autopilot", mend)
    elif "rtk/vel" not in streams:
        tell(Severity.NOTE, "rtk/vel", ": attitude and heading are less sure")
    return found


def _rates(streams: Mapping[str, Stream]) -> list[Finding]:
    found = []
    imu_hz = streams["imu/data"].rate_hz if "imu/data" in streams else None
    if imu_hz is not None and not _LEAST_IMU_HZ <= imu_hz <= _MOST_IMU_HZ:
        evidence = f"imu/data comes at {imu_hz:.0f} Hz, not 50 to 400"
        mend = "set the driver's rate"
        found.append(Finding("imu_rate", Severity.CAUTION, evidence, "imu/data", mend))
    slow = {
        topic: stream.rate_hz
        for topic, stream in streams.items()
        if topic.startswith("rtk/") and (stream.rate_hz or _LEAST_RTK_HZ) < _LEAST_RTK_HZ
    }
    if slow:
        text = ", ".join(f"{topic} at {rate:.1f} Hz" for topic, rate in slow.items())
        evidence, mend = f"too few come: {text}, not 2 or more", "set the receiver's rate to 5 Hz"
        found.append(Finding("rtk_rate", Severity.CAUTION, evidence, next(iter(slow)), mend))
    return found


def _gaps(streams: Mapping[str, Stream], config: EkfConfig) -> list[Finding]:
    found = []
    for topic, (check, severity, mend) in _GAPS.items():
        stream = streams.get(topic)
        if stream is None or not stream.gaps:
            continue
        evidence = (
            f"{topic} has {stream.gaps} gaps of more than {longest_step_s(topic, config):g} s, "
            f"the longest {stream.longest_ns * 1e-9:.1f} s"
        )
        found.append(Finding(check, severity, evidence, topic, mend))
    return found


def _order(streams: Mapping[str, Stream]) -> list[Finding]:
    back = {t: s for t, s in streams.items() if s.back > max(2, _MOST_BACK * s.count)}
    if not back:
        return []
    text = ", ".join(f"{t} ({s.back} of {s.count})" for t, s in back.items())
    evidence = f"stamps are not later than the ones before: {text}"
    mend = "is there more than one publisher, or a clock of coarse steps?"
    return [Finding("stamp_order", Severity.CAUTION, evidence, next(iter(back)), mend)]
