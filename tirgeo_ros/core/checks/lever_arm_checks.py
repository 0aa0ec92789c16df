"""Check the RTK antenna's lever arm and the delays of its time stamps."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Container
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.checks.imu_blocks import ImuMean
from tirgeo_ros.core.checks.lever_arm_fit import (
    ImuPath,
    LeverArmEstimate,
    LeverArmWindow,
    equations,
    integrated,
    solved,
)
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.navigation.delays import Delays
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.measurements import Source
from tirgeo_ros.core.types.poses import NavSolution

#: Blocks of a window, 4 s. With 2 s the lever arm shows in half the time, but delays look like it.
_BLOCKS = 80
_STEP = 40  # blocks from one window's start to the next one's
_WAIT = 10  # blocks to wait for measurements of a window that arrive late
_KEPT = 60  # windows: two minutes
_PATHS = 15  # windows that can be computed again: half a minute
#: Measurements are kept for these windows and this much longer, at most as many as come at 40 Hz.
_LONGER_NS, _AIDS = 6_000_000_000, 1600
#: The equations are linear in the delay only within _LINEAR_S of the one for which they are made.
#: Larger delays are found by iteration, up to _LONGEST_S and in _STEPS.
_LINEAR_S, _LONGEST_S, _STEPS = 0.1, 1.0, 4
_SIGMAS, _LEAST_M = 5.0, 0.15
#: With few windows the sigmas vary: in 14 to 30 s of recorded flights, errors reach 7.4 sigmas.
_MANY, _SIGMAS_OF_FEW = 15, 8.0
#: Delays that give a note and a caution; 0.15 s are 45 cm at 3 m/s.
_LEAST_S, _WRONG_S = 0.05, 0.15
_NEAR_NS = 500_000_000
_LEVER = "aircraft.rtk_antenna_m"
_SECOND = "aircraft.second_antenna_m"


class _Stretch(NamedTuple):
    """Hold a window's path, integrated from the IMU."""

    start_ns: int
    end_ns: int
    path: ImuPath
    overlaps: bool  # whether it overlaps the previous one by half


class LeverChecks:
    """Fit lever arm and delays to IMU blocks, fixed positions and velocities, by windows."""

    def __init__(self, config: EkfConfig, given: Collection[str] | None) -> None:
        self._given = given
        aircraft = config.aircraft
        self._rotation_bi = aircraft.rotation_bi
        self._lever_b, self._sigma_b = aircraft.rtk_lever_b, aircraft.rtk_lever_sigma_b
        delays = Delays.from_config(config)
        self._late_ns = [
            delays.aid_ns[source] - delays.imu_ns
            for source in (Source.RTK_POSITION, Source.RTK_VELOCITY)
        ]
        self._blocks: list[ImuMean] = []
        self._aids: tuple[deque[tuple[int, Array]], ...] = deque(maxlen=_AIDS), deque(maxlen=_AIDS)
        self._stretches: deque[_Stretch] = deque(maxlen=_PATHS)
        self._windows: deque[LeverArmWindow] = deque(maxlen=_KEPT)
        self._delay_s = 0.0  # the delay for which the windows' equations are made
        self._solution: NavSolution | None = None
        self._found: LeverArmEstimate | None = None
        self._fresh = True
        self._overlaps = False  # whether the next window overlaps the previous one

    def solution(self, solution: NavSolution) -> None:
        """Take the filter's solution; its attitude starts windows if the autopilot has none."""
        self._solution = solution

    def position(self, stamp_ns: int, position_n: Array) -> None:
        """Take a fixed position (3,) in any NED plane, m."""
        self._aids[0].append((stamp_ns - self._late_ns[0], position_n))

    def velocity(self, stamp_ns: int, velocity_n: Array) -> None:
        """Take a velocity (3,), NED, m/s."""
        self._aids[1].append((stamp_ns - self._late_ns[1], velocity_n))

    def block(self, block: ImuMean) -> None:
        """Take the next block of the IMU."""
        block = block._replace(autopilot_q_nb=self._attitude(block))
        if not block.joined or (not self._blocks and block.autopilot_q_nb is None):
            self._blocks, self._overlaps = [], False
            return
        self._blocks.append(block)
        if len(self._blocks) == 1 + _BLOCKS + _WAIT:
            self._fit(self._blocks[: 1 + _BLOCKS])
            self._blocks = self._blocks[_STEP:]

    def _attitude(self, block: ImuMean) -> Array | None:
        """Return the attitude (4,) at a new block's end: the autopilot's, else the filter's."""
        if usable_attitude(block.autopilot_q_nb):
            return block.autopilot_q_nb
        own = self._solution
        return own.q_nb if own and abs(own.stamp_ns - block.stamp_ns) < _NEAR_NS else None

    def _fit(self, blocks: list[ImuMean]) -> None:
        """Add a window; it starts at the end of the first block."""
        start = blocks[0]
        overlaps, self._overlaps = self._overlaps, start.autopilot_q_nb is not None
        if start.autopilot_q_nb is None:
            return
        path = integrated(blocks[1:], start.autopilot_q_nb, self._rotation_bi, self._lever_b)
        stretch = _Stretch(start.stamp_ns, blocks[-1].stamp_ns, path, overlaps)
        self._stretches.append(stretch)
        # The smallest: after a clock that jumped back, the first one is not the oldest.
        needed_ns = min(kept.start_ns for kept in self._stretches) - _LONGER_NS
        for aids in self._aids:
            while aids and aids[0][0] < needed_ns:
                aids.popleft()
        self._windows.append(self._window(stretch, self._delay_s))
        self._fresh = False

    def _window(self, stretch: _Stretch, delay_s: float) -> LeverArmWindow:
        """Return a window's equations, made for stamps that are late by ``delay_s``."""
        begin_ns = stretch.start_ns + round(delay_s * 1e9)
        end_ns = stretch.end_ns + round(delay_s * 1e9)
        normals = []
        for aids, velocities in zip(self._aids, (False, True), strict=True):
            inside = [aid for aid in aids if begin_ns < aid[0] < end_ns]
            times_s = np.array([stamp_ns - begin_ns for stamp_ns, _ in inside]) * 1e-9
            values = np.array([value for _, value in inside])
            normals.append(equations(stretch.path, times_s, values, velocities=velocities))
        return LeverArmWindow(normals[0], normals[1], stretch.overlaps)

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
            windows = [self._window(stretch, delay_s) for stretch in self._stretches]
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
        unset = self._unset(topics)
        found = []
        if self.found is not None:
            names = (("rtk/fix", "rtk.delay_s"), ("rtk/vel", "rtk.velocity_delay_s"))
            delays = (_delay(*name, self.found, kind) for kind, name in enumerate(names))
            found = [*self._lever(self.found), *(one for one in delays if one)]
        return [unset, *(one for one in found if one.check != unset.check)] if unset else found

    def _unset(self, topics: Container[str]) -> Finding | None:
        """Return a finding if there are two antennas and nobody set their places."""
        given, two = self._given, "rtk/heading" in topics
        if self._lever_b.any() or not two or (given is not None and _LEVER in given):
            return None
        evidence = "rtk/heading comes, and the antennas' places are still at zero"
        if self.found is not None:
            evidence += f"; this flight says about {_place_text(self.found)}"
        severity = Severity.NOTE if given is None else Severity.CAUTION
        mend = "measure both from the IMU with a tape (forward, left, up)"
        return Finding("antenna_place", severity, evidence, f"{_LEVER}, {_SECOND}", mend)

    def _lever(self, found: LeverArmEstimate) -> list[Finding]:
        off = found.lever_b - self._lever_b
        sigma = np.hypot(found.lever_sigma_b, self._sigma_b)
        if not (np.abs(off) > np.maximum(_sigmas(found) * sigma, _LEAST_M)).any():
            return []
        set_m = flu_from_frd(self._lever_b)
        configured = ", ".join(f"{value:+.2f}" for value in set_m)
        place = _place_text(found)
        evidence = f"the flight puts the RTK antenna at {place}, not at ({configured})"
        turned = np.abs(set_m + flu_from_frd(found.lever_b)) < 0.5 * np.abs(set_m)
        turned &= np.abs(set_m) > _LEAST_M
        names = " and ".join(np.array(("forward", "left", "up"))[turned])
        mend = (
            f"is the sign of {names} wrong?" if names else "measure it from the IMU, with a tape"
        )
        severity = Severity.CAUTION if self._lever_b.any() else Severity.NOTE
        if self._given is not None and _LEVER in self._given:
            severity = Severity.CAUTION
        return [Finding("antenna_place", severity, evidence, f"ekf_node {_LEVER}", mend)]


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
    mend = "mend the stamps, or find the delay with tirgeo calibrate aircraft"
    check = f"{topic.replace('/', '_')}_delay"
    return Finding(check, severity, evidence, f"ekf_node {name}", mend)


def _place_text(found: LeverArmEstimate) -> str:
    place = ", ".join(f"{value:+.2f}" for value in flu_from_frd(found.lever_b))
    sigma = ", ".join(f"{value:.2f}" for value in found.lever_sigma_b)
    return f"({place}) m forward, left, up (sigma {sigma})"
