"""Check the gimbal's set-up with joint angles and reported camera attitudes."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection

import numpy as np

from tirgeo_ros.core.checks.gimbal_joint_findings import joint_findings
from tirgeo_ros.core.config import GimbalConfig
from tirgeo_ros.core.frames.rotations import (
    matrix_from_quat,
    quat_conjugate,
    quat_multiply,
    slerp,
)
from tirgeo_ros.core.gimbal.joint_geometry import camera_turn
from tirgeo_ros.core.gimbal.pose_buffer import Miss, StampedBuffer
from tirgeo_ros.core.streams.sanity_checks import joints_fault, usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, JointSample
from tirgeo_ros.core.types.poses import BodyPose

_EVERY_NS = 200_000_000  # interval between the compared instants
_ATTITUDES_NS = 15_000_000  # body attitudes are taken at most this often
_HISTORY_S = 1.0
_KEPT = 300  # instants: one minute
_FEWEST = 25  # instants: five seconds
_MOST = 0.9  # share of the instants at which a fault is reported
_SKY_RAD = math.radians(5.0)  # above the horizon
_TILT_RAD = math.radians(15.0)  # largest tilt of a picture that should be level
_JOINTS, _REPORTED = "gimbal/joint_states", "gimbal/attitude"
_NEVER_CALIBRATED = Finding(
    "boresight_default",
    Severity.CAUTION,
    "the boresight was never calibrated: the ellipses do not hold its error",
    "gimbal_node boresight_rpy_deg",
    "run tirgeo calibrate boresight, or set it to zeros where the camera is known to be true",
)


class GimbalChecks:
    """Take samples in order of arrival; return findings at any time.

    ``given`` are the parameters of gimbal_node that were set explicitly, None if not known.
    ``overlaid`` is whether a map is drawn with these poses.
    """

    def __init__(
        self,
        config: GimbalConfig,
        given: Collection[str] | None = None,
        *,
        overlaid: bool = True,
    ) -> None:
        untouched = given is not None and "boresight_rpy_deg" not in given
        self._askew = overlaid and untouched and not np.any(config.boresight_rpy_deg)
        self._used = config.composition != "paper"
        self._yaw_zero_rad = config.yaw_zero_rad
        self._order = config.joint_order
        self._joints: StampedBuffer[Array] = StampedBuffer(_HISTORY_S)
        self._autopilot: StampedBuffer[Array] = StampedBuffer(_HISTORY_S)
        self._bodies: StampedBuffer[Array] = StampedBuffer(_HISTORY_S)
        self._waiting: dict[str, tuple[int, Array]] = {}  # by topic: the next sample to check
        self._pairs: deque[tuple[Array, Array]] = deque(maxlen=_KEPT)  # joints, reported R_bg
        self._looks: dict[str, deque[tuple[float, float]]] = {}  # elevation, tilt, rad
        self._sizes: deque[float] = deque(maxlen=_KEPT)  # larger of |roll| and |pitch|, rad

    def joints(self, sample: JointSample) -> None:
        """Take joint angles; computed ones, which no encoder measured, are ignored."""
        angles = (sample.yaw_rad, sample.roll_rad, sample.pitch_rad)
        if sample.computed or joints_fault(angles):
            return
        found = np.array(angles)
        found[0] -= self._yaw_zero_rad
        self._joints.put(sample.stamp_ns, found)
        self._look(_JOINTS, sample.stamp_ns, found)

    def reported(self, sample: CameraAttitudeSample) -> None:
        """Take the camera attitude that the flight controller reports."""
        if usable_attitude(sample.q_ng):
            self._look(_REPORTED, sample.stamp_ns, sample.q_ng)

    def autopilot(self, stamp_ns: int, q_nb: Array) -> None:
        """Take the autopilot's attitude (4,)."""
        if _due(self._autopilot, stamp_ns) and usable_attitude(q_nb):
            self._autopilot.put(stamp_ns, q_nb)

    def body(self, pose: BodyPose) -> None:
        """Take a body pose, which is used where the autopilot's attitude is missing."""
        heard_ns = self._autopilot.newest_ns
        if heard_ns is not None and abs(pose.stamp_ns - heard_ns) < _HISTORY_S * 1e9:
            return
        if _due(self._bodies, pose.stamp_ns) and usable_attitude(pose.q_nb):
            self._bodies.put(pose.stamp_ns, pose.q_nb)

    def _look(self, topic: str, stamp_ns: int, entry: Array) -> None:
        """Check the waiting sample once later data have arrived; a few times a second."""
        before = self._waiting.get(topic)
        if before is not None and 0 <= stamp_ns - before[0] < _EVERY_NS:
            return
        self._waiting[topic] = stamp_ns, entry
        if before is None:
            return
        if topic == _REPORTED:
            self._compare(*before)
            self._add_look(topic, before[1])
            return
        yaw, roll, pitch = before[1].tolist()
        self._sizes.append(max(abs(roll), abs(pitch)))
        q_nb = self._attitude(before[0])
        if q_nb is not None:
            q_bg = camera_turn(JointSample(0, yaw, roll, pitch), self._order)
            self._add_look(topic, quat_multiply(q_nb, q_bg))

    def _attitude(self, stamp_ns: int) -> Array | None:
        for history in (self._autopilot, self._bodies):
            around = history.around(stamp_ns)
            if not isinstance(around, Miss):
                return slerp(*around)
        return None

    def _compare(self, stamp_ns: int, q_ng: Array) -> None:
        around, q_nb = self._joints.around(stamp_ns), self._attitude(stamp_ns)
        if isinstance(around, Miss) or q_nb is None:
            return
        start, end, share = around
        q_bg = quat_multiply(quat_conjugate(q_nb), q_ng)
        seen = start if share < 0.5 else end
        self._pairs.append((seen, matrix_from_quat(q_bg)))

    def _add_look(self, topic: str, q_ng: Array) -> None:
        axes_n = matrix_from_quat(q_ng)
        up, tilt = math.asin(-axes_n[2, 0].clip(-1, 1)), math.asin(axes_n[2, 1].clip(-1, 1))
        self._looks.setdefault(topic, deque(maxlen=_KEPT)).append((up, tilt))

    def findings(self) -> list[Finding]:
        """Return the findings so far."""
        found = []
        if len(self._pairs) >= _FEWEST:
            joints, reported = map(np.array, zip(*self._pairs, strict=True))
            found = joint_findings(joints, reported, self._order, used=self._used)
        if not found and len(self._sizes) >= _FEWEST and np.median(self._sizes) > math.tau:
            size = np.median(self._sizes)
            evidence = f"roll or pitch of the gimbal is {size:.1f} rad, more than a turn"
            severity = Severity.STOP if self._used else Severity.NOTE
            mend = "send radians; these look like degrees"
            found = [Finding("joint_angles", severity, evidence, _JOINTS, mend)]
        if not found:
            found = [one for topic in self._looks for one in self._look_findings(topic)]
        return [*found, _NEVER_CALIBRATED] if self._askew and self._waiting else found

    def _look_findings(self, topic: str) -> list[Finding]:
        if len(self._looks[topic]) < _FEWEST:
            return []
        up, tilt = np.array(self._looks[topic]).T
        found = []
        if (up > _SKY_RAD).mean() > _MOST:
            evidence = f"the camera looks {_deg(up)} above the horizon all the time"
            mend = "see that its pitch is negative downwards in the core, positive in the topic"
            found.append(Finding("camera_up", Severity.STOP, evidence, topic, mend))
        if (np.abs(tilt) > _TILT_RAD).mean() > _MOST:
            evidence = (
                f"the picture is tilted by {_deg(np.abs(tilt))} all the time, with the camera "
                f"{_deg(up)} up"
            )
            mend = "see that gimbal_roll_joint and gimbal_pitch_joint are not exchanged"
            found.append(Finding("camera_tilt", Severity.CAUTION, evidence, topic, mend))
        return found


def _due(history: StampedBuffer[Array], stamp_ns: int) -> bool:
    newest_ns = history.newest_ns
    return newest_ns is None or not 0 <= stamp_ns - newest_ns < _ATTITUDES_NS


def _deg(angles_rad: Array) -> str:
    return f"{math.degrees(float(np.median(angles_rad))):.0f} deg"
