"""Check that topics arrive, often enough and without gaps."""

from __future__ import annotations

from collections.abc import Mapping

from tirgeo_ros.core.checks.streams import Stream
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.measurements import Source

#: Waiting time after which a missing topic is reported.
_PATIENCE_NS = 8_000_000_000
#: The interface's rates, with a tolerance of a tenth for clocks and rounding.
_LEAST_IMU_HZ, _MOST_IMU_HZ = 45.0, 440.0
_LEAST_RTK_HZ = 1.8
_MOST_BACK = 0.01  # share of the samples


def longest_step_s(topic: str, config: EkfConfig) -> float:
    """Return the longest step between samples of a topic, s; a longer one is a gap."""
    return config.max_imu_gap_s if topic == "imu/data" else config.trust.aid_timeout_s


class RateChecks:
    """Check the streams that the filter's method needs."""

    def __init__(self, config: EkfConfig) -> None:
        self._config = config
        self._first_ns: int | None = None

    def begin(self, arrival_ns: int) -> None:
        """Set the first arrival of any topic."""
        self._first_ns = arrival_ns

    def findings(self, streams: Mapping[str, Stream], now_ns: int) -> list[Finding]:
        """Return what is wrong with the streams at ``now_ns``, an arrival time."""
        found = [*_rates(streams), *_gaps(streams, self._config), *_order(streams)]
        if self._first_ns is not None and now_ns - self._first_ns > _PATIENCE_NS:
            found += _absent(streams, self._config.method, (now_ns - self._first_ns) * 1e-9)
        return found


def _absent(streams: Mapping[str, Stream], method: str, waited_s: float) -> list[Finding]:
    rtk, velocity, heading, gps = (
        source.topic
        for source in (
            Source.RTK_POSITION,
            Source.RTK_VELOCITY,
            Source.RTK_HEADING,
            Source.GPS_POSITION,
        )
    )
    found = []

    def tell(severity: Severity, topic: str, what: str, mend: str) -> None:
        evidence = f"{topic}: nothing in {waited_s:.0f} s{what}"
        name = f"no_{topic.replace('/', '_')}"
        found.append(Finding(name, severity, evidence, topic, mend))

    remap = "look at the driver, the topic's name and its namespace"
    if "imu/data" not in streams:
        tell(Severity.STOP, "imu/data", "", remap)
    if method == "raw":
        if gps not in streams:
            tell(Severity.STOP, gps, ": method raw has no position", remap)
        return found
    if rtk not in streams:
        if gps in streams and method != "rtk":
            tell(Severity.NOTE, rtk, ": the position is the ordinary GPS's", remap)
        else:
            tell(Severity.STOP, rtk, ": nothing gives a position", remap)
    elif method == "ekf_heading" and heading not in streams:
        mend = f"{remap}; with one antenna set ekf_node method to ekf"
        tell(Severity.CAUTION, heading, ": north comes from turns or the autopilot", mend)
    elif velocity not in streams:
        tell(Severity.NOTE, velocity, ": attitude and heading are less sure", remap)
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
    for topic, severity, check in (
        ("imu/data", Severity.CAUTION, "imu_gaps"),
        ("rtk/fix", Severity.NOTE, "rtk_gaps"),
    ):
        stream = streams.get(topic)
        if stream is None or not stream.gaps:
            continue
        evidence = (
            f"{topic} has {stream.gaps} gaps of more than {longest_step_s(topic, config):g} s, "
            f"the longest {stream.longest_ns * 1e-9:.1f} s"
        )
        mend = {
            "imu/data": "the filter starts again after each: look at link, load and recorder",
            "rtk/fix": "look at the receiver's sky, corrections and link",
        }[topic]
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
