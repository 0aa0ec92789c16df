"""Check the frames' time stamps."""

from __future__ import annotations

from collections import deque

import numpy as np

from tirgeo_ros.core.types.finding import Finding, Severity

_, CAUTION, STOP = Severity
_TOPIC = "thermal/image_raw"
_KEPT = 3000  # the newest frames
_FEWEST = 20  # frames before anything is reported
_SHARE = 0.1  # of the frames: a fault that is more frequent is reported
#: Limits of a stamp's differences: from its arrival, and from the newest pose's stamp.
_AHEAD_S, _LATE_S, _APART_S = 0.1, 1.0, 2.0
_CLOCK = "use one clock for camera and aircraft"
#: For each fault: severity, evidence and mend.
_FAULTS = {
    "picture_stamps_zero": (
        CAUTION,
        "{count} of {frames} pictures have no stamp",
        "let the driver stamp them; until then video_latency_s must include the time to arrival",
    ),
    "picture_stamps_ahead": (
        CAUTION,
        "stamps of pictures are {mean} s ahead of their arrival",
        f"{_CLOCK}, and stamp at the exposure",
    ),
    "picture_stamps_late": (
        CAUTION,
        "stamps of pictures are {mean} s behind their arrival",
        f"{_CLOCK}, and stamp at the exposure",
    ),
    "picture_clock": (
        STOP,
        "pictures are stamped {mean} s ahead of the camera's poses (negative: behind)",
        f"{_CLOCK}; no map is drawn on such pictures",
    ),
    "picture_stamps_back": (
        CAUTION,
        "{count} of {frames} stamps of pictures do not grow",
        "check that only one driver sends pictures, each once and in order",
    ),
}


class FrameStamps:
    """Check the stamps of frames."""

    def __init__(self) -> None:
        self._pose_ns = 0  # stamp of the newest pose since the last frame, or 0
        # of each frame: its stamp, its arrival and that pose, ns; 0 where unknown
        self._frames: deque[tuple[int, int, int]] = deque(maxlen=_KEPT)

    def pose(self, stamp_ns: int) -> None:
        """Take the stamp of a camera pose."""
        self._pose_ns = stamp_ns

    def frame(self, stamp_ns: int, arrival_ns: int) -> None:
        """Take a frame's stamp and its arrival time.

        An arrival time of 0 means unknown, because a clock that is played with a bag is 0 until
        its first message.
        """
        self._frames.append((stamp_ns, arrival_ns, self._pose_ns))
        self._pose_ns = 0  # compare only with a pose that came since the last frame

    def findings(self) -> list[Finding]:
        """Return the findings so far."""
        found = []
        if len(self._frames) < _FEWEST:
            return []
        stamps, arrivals, poses = np.array(self._frames, np.int64).T
        known = stamps != 0
        early = (stamps - arrivals) * 1e-9 * (known & (arrivals != 0))
        apart = (stamps - poses) * 1e-9 * (known & (poses != 0))
        steps = np.diff(stamps[known]) * 1e-9
        for check, off_s, wrong in (
            ("picture_stamps_zero", stamps * 1e-9, ~known),
            ("picture_stamps_ahead", early, early > _AHEAD_S),
            ("picture_stamps_late", -early, -early > _LATE_S),
            ("picture_clock", apart, np.abs(apart) > _APART_S),
            ("picture_stamps_back", steps, steps <= 0),
        ):
            if wrong.any() and wrong.mean() > _SHARE:
                severity, text, mend = _FAULTS[check]
                mean = f"{off_s[wrong].mean():.2f}"
                evidence = text.format(count=wrong.sum(), frames=len(stamps), mean=mean)
                found.append(Finding(check, severity, evidence, _TOPIC, mend))
        return found
