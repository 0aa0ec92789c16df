"""Check the RTK antenna's lever arm, the delays of its stamps, the IMU's tilt and headings."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Container

import numpy as np

from tirgeo_ros.core.checks.imu_blocks import ImuMean
from tirgeo_ros.core.checks.imu_checks import IMU_RPY, rpy_text
from tirgeo_ros.core.checks.lever_arm_fit import (
    ImuPath,
    LeverArmEstimate,
    Normal,
    integrated,
    solved,
)
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.frames.rotations import matrix_from_rotvec
from tirgeo_ros.core.navigation.aiding.aids import Delays
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.measurements import Source

#: Blocks of a window, 4 s. With 2 s the lever arm shows in half the time, but delays look like it.
_BLOCKS = 80
_STEP = 40  # blocks from one window's start to the next one's
_WAIT = 10  # blocks to wait for measurements of a window that arrive late
_KEPT = 60  # windows: two minutes
_PATHS = 15  # windows that can be computed again: half a minute
_AIDS = 800  # measurements that are kept: 40 s at 20 Hz
#: The equations are linear in the delay only within _LINEAR_S of the one for which they are made.
#: Larger delays are found by iteration, up to _LONGEST_S and in _STEPS.
_LINEAR_S, _LONGEST_S, _STEPS = 0.1, 1.0, 4
_SIGMAS, _LEAST_M = 5.0, 0.15
#: With few windows the sigmas vary: in 14 to 30 s of recorded flights, errors reach 7.4 sigmas.
_MANY, _SIGMAS_OF_FEW = 15, 8.0
#: Delays that give a note and a caution; 0.15 s are 45 cm at 3 m/s.
_LEAST_S, _WRONG_S = 0.05, 0.15
#: A larger tilt or offset moves the map by more than three ellipses; autopilots err by 1 to 2 deg.
_TILTED_RAD, _OFF_DEG, _OFF_SIGMAS = math.radians(3.0), 2.5, 4.0
_LEVER = "aircraft.rtk_antenna_m"
_SECOND = "aircraft.second_antenna_m"
_UNKNOWN_TILT = Finding(
    "imu_tilt",
    Severity.NOTE,
    "imu/data has no orientation: whether the IMU is tilted in its mount is not known",
    IMU_RPY,
    "level it within 1 deg, or send the autopilot's attitude in imu/data",
)


_AIDED = (Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING)
_Aids = deque[tuple[int, Array]]  # stamps without the configured delays, values (3,) or ()


class LeverChecks:
    """Fit lever arm and delays to IMU blocks, fixed positions and velocities, by windows."""

    def __init__(self, config: EkfConfig, given: Collection[str] | None) -> None:
        self._given = given
        aircraft, delays = config.aircraft, Delays.from_config(config)
        self._lever_b, self._sigma_b = aircraft.rtk_lever_b, aircraft.rtk_lever_sigma_b
        self._rotation_bi = aircraft.rotation_bi
        self._attitude_sigma_rad = math.radians(max(config.autopilot.attitude_sigma_deg[:2]))
        self._late_ns = [delays.aid_ns[source] - delays.imu_ns for source in _AIDED]
        self._blocks: list[ImuMean] = []
        self._aids: list[_Aids] = [deque(maxlen=_AIDS) for _ in _AIDED]
        self._stretches: deque[tuple[int, int, ImuPath]] = deque(maxlen=_PATHS)  # from, to (ns)
        self._windows: deque[Normal] = deque(maxlen=_KEPT)
        self._blind: bool | None = None  # whether blocks came, all without an attitude
        self._delay_s = 0.0  # the delay for which the windows' equations are made
        self._found: LeverArmEstimate | None = None
        self._fresh = True

    def position(self, stamp_ns: int, position_n: Array) -> None:
        """Take a fixed position (3,) in any NED plane, m."""
        self._aids[0].append((stamp_ns - self._late_ns[0], position_n))

    def velocity(self, stamp_ns: int, velocity_n: Array) -> None:
        """Take a velocity (3,), NED, m/s."""
        self._aids[1].append((stamp_ns - self._late_ns[1], velocity_n))

    def heading(self, stamp_ns: int, heading_rad: float) -> None:
        """Take a heading, rad."""
        self._aids[2].append((stamp_ns - self._late_ns[2], np.array(heading_rad)))

    def block(self, block: ImuMean) -> None:
        """Take the next block of the IMU; windows begin with the autopilot's attitude."""
        self._blind = self._blind is not False and block.autopilot_q_nb is None
        if not block.joined or (not self._blocks and block.autopilot_q_nb is None):
            self._blocks = []
            return
        self._blocks.append(block)
        if len(self._blocks) == 1 + _BLOCKS + _WAIT:
            self._add_window(self._blocks[: 1 + _BLOCKS])
            self._blocks = self._blocks[_STEP:]

    def _add_window(self, blocks: list[ImuMean]) -> None:
        """Add a window, which begins at the end of the first block."""
        start = blocks[0]
        if start.autopilot_q_nb is None:
            return
        path = integrated(blocks[1:], start.autopilot_q_nb, self._lever_b)
        self._stretches.append((start.stamp_ns, blocks[-1].stamp_ns, path))
        self._windows.append(self._window(*self._stretches[-1], self._delay_s))
        self._fresh = False

    def _window(self, start_ns: int, end_ns: int, path: ImuPath, delay_s: float) -> Normal:
        """Return a window's equations, made for stamps that are late by ``delay_s``."""
        late_ns = round(delay_s * 1e9)
        inputs = []
        for aids in self._aids:
            inside = [aid for aid in aids if start_ns < aid[0] - late_ns < end_ns]
            times_s = np.array([stamp_ns - late_ns - start_ns for stamp_ns, _ in inside]) * 1e-9
            inputs.append((times_s, np.array([value for _, value in inside])))
        return Normal.of(path, *inputs)

    @property
    def found(self) -> LeverArmEstimate | None:
        """Return the present estimate; None while the flight is too short."""
        if not self._fresh:
            self._found, self._fresh = self._solved(), True
        return self._found

    def _solved(self) -> LeverArmEstimate | None:
        """Solve the windows; make them anew for the delay found while that fits better."""
        found = solved(self._windows)
        for _ in range(_STEPS):
            if found is None or abs(found.delays_s[0]) < _LINEAR_S:
                break
            delay_s = self._delay_s + float(found.delays_s[0])
            windows = [self._window(*stretch, delay_s) for stretch in self._stretches]
            before, after = solved(list(self._windows)[-len(windows) :]), solved(windows)
            if before is None or after is None or abs(delay_s) > _LONGEST_S:
                break
            if after.misfit >= before.misfit:
                break
            self._delay_s, found = delay_s, after
            self._windows = deque(windows, maxlen=_KEPT)
        known_s = np.array((self._delay_s, 0.0))  # the second is relative: velocities' extra delay
        return found and found._replace(delays_s=found.delays_s + known_s)

    def findings(self, topics: Container[str]) -> list[Finding]:
        """Return the differences from the parameters; ``topics`` are those that arrive."""
        unset, found = self._unset(topics), self.found
        if found is None:
            return [one for one in (unset, _UNKNOWN_TILT if self._blind else None) if one]
        tilt = self._tilt(found)
        if tilt is not None:  # it turns the lever arm too
            return [tilt]
        names = (("rtk/fix", "rtk.delay_s"), ("rtk/vel", "rtk.velocity_delay_s"))
        delays = [_delay(*name, found, kind) for kind, name in enumerate(names)]
        heading = None if any(delays) else _heading(found)
        return [one for one in (heading, unset or self._lever(found), *delays) if one]

    def _tilt(self, found: LeverArmEstimate) -> Finding | None:
        """Return a finding if the IMU's axes are tilted against the autopilot's attitude."""
        size_rad = float(np.linalg.norm(found.tilt_b))
        sigma_rad = math.hypot(found.tilt_sigma, self._attitude_sigma_rad)
        if size_rad < max(_TILTED_RAD, _SIGMAS * sigma_rad):
            return None
        angles = rpy_text(matrix_from_rotvec(found.tilt_b), self._rotation_bi)
        evidence = (
            f"the IMU is tilted by {math.degrees(size_rad):.1f} deg in its mount, against the "
            "autopilot's attitude in imu/data"
        )
        mend = f"set it to {angles}; or if the IMU is level, calibrate its accelerometers"
        return Finding("imu_tilt", Severity.STOP, evidence, IMU_RPY, mend)

    def _unset(self, topics: Container[str]) -> Finding | None:
        """Return a finding if there are two antennas and nobody set their places."""
        given, two = self._given, "rtk/heading" in topics
        if self._lever_b.any() or not two or (given is not None and _LEVER in given):
            return None
        evidence = "rtk/heading is received, but the antennas' positions are still zero"
        if self.found is not None:
            evidence += f"; this flight suggests about {_place_text(self.found)}"
        severity = Severity.NOTE if given is None else Severity.CAUTION
        mend = "measure both from the IMU with a tape (forward, left, up)"
        return Finding("antenna_place", severity, evidence, f"{_LEVER}, {_SECOND}", mend)

    def _lever(self, found: LeverArmEstimate) -> Finding | None:
        off = found.lever_b - self._lever_b
        sigma = np.hypot(found.lever_sigma_b, self._sigma_b)
        if not (np.abs(off) > np.maximum(_sigmas(found) * sigma, _LEAST_M)).any():
            return None
        set_m = flu_from_frd(self._lever_b)
        configured = ", ".join(f"{value:+.2f}" for value in set_m)
        evidence = (
            f"by this flight the RTK antenna is at {_place_text(found)}, not at ({configured})"
        )
        turned = np.abs(set_m + flu_from_frd(found.lever_b)) < 0.5 * np.abs(set_m)
        turned &= np.abs(set_m) > _LEAST_M
        names = " and ".join(np.array(("forward", "left", "up"))[turned])
        mend = "measure it from the IMU, with a tape"
        if names:
            mend = f"is the sign of {names} wrong?"
        is_set = self._lever_b.any() or (self._given is not None and _LEVER in self._given)
        severity = Severity.CAUTION if is_set else Severity.NOTE
        return Finding("antenna_place", severity, evidence, f"ekf_node {_LEVER}", mend)


def _heading(found: LeverArmEstimate) -> Finding | None:
    """Return a finding if headings are off from north as the motion gives it."""
    off_deg, sigma_deg = math.degrees(found.heading_off), math.degrees(found.heading_sigma)
    if abs(off_deg) < max(_OFF_DEG, _OFF_SIGMAS * sigma_deg):
        return None
    evidence = (
        f"rtk/heading is {off_deg:+.1f} deg (sigma {sigma_deg:.1f}) from the heading that the "
        "motion of IMU and receiver gives"
    )
    mend = "measure both antennas; or is the IMU turned about its vertical?"
    return Finding("heading_offset", Severity.STOP, evidence, f"ekf_node {_SECOND}", mend)


def _sigmas(found: LeverArmEstimate) -> float:
    """Return the number of sigmas at which a difference is significant."""
    return _SIGMAS if found.windows >= _MANY else _SIGMAS_OF_FEW


def _delay(topic: str, name: str, found: LeverArmEstimate, kind: int) -> Finding | None:
    """Return a finding if stamps are later, or earlier, than the parameters say."""
    delay_s, sigma_s = float(found.delays_s[kind]), float(found.delay_sigmas_s[kind])
    if abs(delay_s) < max(_LEAST_S, _sigmas(found) * sigma_s):
        return None
    way = "later" if delay_s > 0 else "earlier"
    evidence = (
        f"the IMU's motion says that stamps of {topic} are {abs(delay_s):.2f} s {way} than the "
        f"parameters have it (sigma {sigma_s:.2f} s)"
    )
    severity = Severity.CAUTION if abs(delay_s) > _WRONG_S else Severity.NOTE
    mend = "correct the stamps, or find the delay with tirgeo calibrate aircraft"
    check = f"{topic.replace('/', '_')}_delay"
    return Finding(check, severity, evidence, f"ekf_node {name}", mend)


def _place_text(found: LeverArmEstimate) -> str:
    place = ", ".join(f"{value:+.2f}" for value in flu_from_frd(found.lever_b))
    sigma = ", ".join(f"{value:.2f}" for value in found.lever_sigma_b)
    return f"({place}) m forward, left, up (sigma {sigma})"
