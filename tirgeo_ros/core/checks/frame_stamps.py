"""Check the frames' time stamps, their rate and their sizes."""

from __future__ import annotations

from collections import Counter

from tirgeo_ros.core.types.finding import Finding, Severity

NOTE, CAUTION, STOP = Severity
_TOPIC = "thermal/image_raw"
_FEWEST = 20  # frames before anything but changing sizes is reported
_SHARE = 0.1  # of the frames: a fault that is more frequent is reported
#: Limits of a stamp's differences: from its arrival, and from the newest pose's stamp.
_AHEAD_NS, _LATE_NS, _APART_NS = 100_000_000, 1_000_000_000, 2_000_000_000
_SLOWEST_HZ = 2.0
_SHOWN = 3
_CLOCK = "let camera and aircraft keep one clock"
#: For each fault: check, severity, evidence and mend.
_FAULTS = {
    "zero": (
        "picture_stamps_zero",
        CAUTION,
        "{count} of {frames} pictures have no stamp",
        "let the driver stamp them; as it is, video_latency_s counts to their arrival",
    ),
    "ahead": (
        "picture_stamps_ahead",
        CAUTION,
        "stamps of pictures are {mean} s ahead of their arrival",
        f"{_CLOCK}, and stamp at the exposure",
    ),
    "late": (
        "picture_stamps_late",
        CAUTION,
        "stamps of pictures are {mean} s behind their arrival",
        f"{_CLOCK}, and stamp at the exposure",
    ),
    "apart": (
        "picture_clock",
        STOP,
        "pictures are stamped {mean} s ahead of the camera's poses (negative: behind)",
        f"{_CLOCK}; no map is drawn on such pictures",
    ),
    "back": (
        "picture_stamps_back",
        CAUTION,
        "{count} of {frames} stamps of pictures do not grow",
        "see that one driver alone sends pictures, each once and in order",
    ),
}


class FrameStamps:
    """Check the stamps and sizes of frames."""

    def __init__(self) -> None:
        self._pose_ns: int | None = None  # stamp of the newest pose since the last frame
        self._counts: Counter[str] = Counter()
        self._sums: Counter[str] = Counter()  # ns
        self._sizes: Counter[tuple[int, int]] = Counter()
        self._newest_ns: int | None = None
        self._frames = self._steps = self._steps_ns = 0

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
            self._add("ahead", stamp_ns - arrival_ns, stamp_ns - arrival_ns > _AHEAD_NS)
            self._add("late", arrival_ns - stamp_ns, arrival_ns - stamp_ns > _LATE_NS)
        if self._pose_ns is not None:  # compare only with a pose that came since the last frame
            off_ns, self._pose_ns = stamp_ns - self._pose_ns, None
            self._add("apart", off_ns, abs(off_ns) > _APART_NS)
        if self._newest_ns is not None:
            step_ns = stamp_ns - self._newest_ns
            self._counts["back"] += step_ns <= 0
            self._steps += step_ns > 0
            self._steps_ns += max(step_ns, 0)
        self._newest_ns = stamp_ns

    def _add(self, name: str, off_ns: int, wrong: bool) -> None:
        self._counts[name] += wrong
        self._sums[name] += off_ns * wrong

    def findings(self) -> list[Finding]:
        """Return the findings so far."""
        found = []
        if len(self._sizes) > 1:
            most = ", ".join(f"{w}x{h} ({n})" for (w, h), n in self._sizes.most_common(_SHOWN))
            mend = "let the camera send one size: that of its calibration"
            evidence = f"pictures of {most} pixels"
            found.append(Finding("picture_sizes", STOP, evidence, _TOPIC, mend))
        if self._frames < _FEWEST:
            return found
        often = [name for name in _FAULTS if self._counts[name] > _SHARE * self._frames]
        if "ahead" in often and "late" in often:  # a clock that was set: one finding tells it
            often.remove("late")
        for name in often:
            check, severity, text, mend = _FAULTS[name]
            mean = f"{self._sums[name] * 1e-9 / self._counts[name]:.2f}"
            evidence = text.format(count=self._counts[name], frames=self._frames, mean=mean)
            found.append(Finding(check, severity, evidence, _TOPIC, mend))
        rate_hz = self._steps / max(self._steps_ns * 1e-9, 1e-9)
        if self._steps and rate_hz < _SLOWEST_HZ:
            evidence = f"{rate_hz:.1f} pictures a second"
            mend = "see what the camera's driver sends; 5 to 30 a second are usual"
            found.append(Finding("picture_rate", NOTE, evidence, _TOPIC, mend))
        return found
