"""Check the frames' time stamps, their rate and their sizes."""

from __future__ import annotations

from collections import Counter

from tirgeo_ros.core.types.finding import Finding, Severity

_TOPIC = "thermal/image_raw"
_FEWEST = 20  # frames before anything but changing sizes is reported
_SHARE = 0.1  # of the frames: a fault that is more frequent is reported
_AHEAD_NS = 100_000_000  # a stamp further ahead of the arrival is a fault
_LATE_NS = 1_000_000_000
_APART_NS = 2_000_000_000  # a stamp further from the newest pose's is a fault
_SLOWEST_HZ = 2.0
_SHOWN = 3


class FrameStamps:
    """Check the stamps and sizes of frames."""

    def __init__(self) -> None:
        self._pose_ns: int | None = None  # stamp of the newest pose since the last frame
        self._counts: Counter[str] = Counter()
        self._sums: Counter[str] = Counter()  # ns
        self._sizes: Counter[tuple[int, int]] = Counter()
        self._newest_ns: int | None = None
        self._frames = 0
        self._steps = self._steps_ns = 0

    def pose(self, stamp_ns: int) -> None:
        """Take the stamp of a camera pose."""
        self._pose_ns = stamp_ns

    def frame(self, stamp_ns: int, size: tuple[int, int] | None, arrival_ns: int) -> None:
        """Take a frame's stamp, its size (width, height) and its arrival time.

        The size is None if it is not known. An arrival time of 0 means unknown, because a clock
        that is played with a bag is 0 until its first message.
        """
        self._frames += 1
        if size is not None:
            self._sizes[size] += 1
        if stamp_ns == 0:
            self._counts["zero"] += 1
            return
        if arrival_ns:
            self._add("ahead", stamp_ns - arrival_ns, _AHEAD_NS)
            self._add("late", arrival_ns - stamp_ns, _LATE_NS)
        if self._pose_ns is not None:  # compare only with a pose that came since the last frame
            off_ns, self._pose_ns = stamp_ns - self._pose_ns, None
            self._add("apart", abs(off_ns), _APART_NS, off_ns)
        if self._newest_ns is not None:
            step_ns = stamp_ns - self._newest_ns
            self._counts["back"] += step_ns <= 0
            self._steps += step_ns > 0
            self._steps_ns += max(step_ns, 0)
        self._newest_ns = stamp_ns

    def _add(self, name: str, size_ns: int, limit_ns: int, value_ns: int | None = None) -> None:
        if size_ns > limit_ns:
            self._counts[name] += 1
            self._sums[name] += size_ns if value_ns is None else value_ns

    def _often(self, name: str) -> bool:
        return self._counts[name] > _SHARE * self._frames

    def _mean_s(self, name: str) -> float:
        return self._sums[name] * 1e-9 / self._counts[name]

    def findings(self) -> list[Finding]:
        """Return the findings so far."""
        found = []
        if len(self._sizes) > 1:
            found.append(self._changing())
        if self._frames < _FEWEST:
            return found
        if self._often("zero"):
            found.append(self._zero())
        if self._often("ahead"):
            found.append(self._off("ahead of", "ahead"))
        elif self._often("late"):
            found.append(self._off("behind", "late"))
        if self._often("apart"):
            found.append(self._apart())
        if self._often("back"):
            found.append(self._back())
        rate_hz = self._steps / max(self._steps_ns * 1e-9, 1e-9)
        if self._steps and rate_hz < _SLOWEST_HZ:
            evidence = f"{rate_hz:.1f} pictures a second"
            mend = "see what the camera's driver sends; 5 to 30 a second are usual"
            found.append(Finding("picture_rate", Severity.NOTE, evidence, _TOPIC, mend))
        return found

    def _changing(self) -> Finding:
        most = self._sizes.most_common(_SHOWN)
        text = ", ".join(f"{width}x{height} ({n})" for (width, height), n in most)
        mend = "let the camera send one size: that of its calibration"
        return Finding("picture_sizes", Severity.STOP, f"pictures of {text} pixels", _TOPIC, mend)

    def _zero(self) -> Finding:
        evidence = f"{self._counts['zero']} of {self._frames} pictures have no stamp"
        mend = "let the driver stamp them; as it is, video_latency_s counts to their arrival"
        return Finding("picture_stamps_zero", Severity.CAUTION, evidence, _TOPIC, mend)

    def _off(self, where: str, name: str) -> Finding:
        evidence = f"stamps of pictures are {self._mean_s(name):.2f} s {where} their arrival"
        mend = "let camera and aircraft keep one clock, and stamp at the exposure"
        return Finding(f"picture_stamps_{name}", Severity.CAUTION, evidence, _TOPIC, mend)

    def _apart(self) -> Finding:
        mean_s = self._mean_s("apart")
        side = "ahead of" if mean_s > 0 else "behind"
        evidence = f"pictures are stamped {abs(mean_s):.1f} s {side} the camera's poses"
        mend = "let camera and aircraft keep one clock; no map is drawn on such pictures"
        return Finding("picture_clock", Severity.STOP, evidence, _TOPIC, mend)

    def _back(self) -> Finding:
        evidence = f"{self._counts['back']} of {self._frames} stamps of pictures do not grow"
        mend = "see that one driver alone sends pictures, each once and in order"
        return Finding("picture_stamps_back", Severity.CAUTION, evidence, _TOPIC, mend)
