"""Whether the RTK antenna is where the parameters say, and its stamps as late."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Container

import numpy as np

from tirgeo_ros.core.checks.finding import Finding, Severity
from tirgeo_ros.core.checks.imu_blocks import ImuBlock
from tirgeo_ros.core.checks.lever_fit import Normal, by_positions, by_velocities, integrated
from tirgeo_ros.core.checks.lever_solution import Lever, Windows, solved
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.delays import Delays
from tirgeo_ros.core.frames import flu_from_frd
from tirgeo_ros.core.samples import Array, NavSolution, Source
from tirgeo_ros.core.validity import usable_attitude

#: Blocks of a window, 4 s: in 2 s the antenna shows in half the time, but delays look like it.
_BLOCKS = 80
_WAIT = 10  # blocks, for what measures in a window and is still on its way
_KEPT = 150  # windows
_AIDS = 200  # measurements that are kept: of a window and the wait at 40 Hz
_SIGMAS, _LEAST_M = 5.0, 0.15
#: Delays: told; 0.15 s are 45 cm at 3 m/s.
_LEAST_S, _WRONG_S = 0.05, 0.15
_NEAR_NS = 500_000_000
_LEVER = "aircraft.rtk_antenna_m"
_SECOND = "aircraft.second_antenna_m"


class LeverChecks:
    """Hears blocks of the IMU, fixed positions and velocities; fits window by window."""

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
        self._blocks: list[ImuBlock] = []
        self._aids: tuple[deque[tuple[int, Array]], ...] = deque(maxlen=_AIDS), deque(maxlen=_AIDS)
        self._windows = Windows(_KEPT)
        self._solution: NavSolution | None = None
        self._found: Lever | None = None
        self._fresh = True

    def solution(self, solution: NavSolution) -> None:
        """Take the filter's: its attitude begins windows where the autopilot has none."""
        self._solution = solution

    def position(self, stamp_ns: int, position_n: Array) -> None:
        """Take a fixed position (3,) in any plane, m."""
        self._aids[0].append((stamp_ns - self._late_ns[0], position_n))

    def velocity(self, stamp_ns: int, velocity_n: Array) -> None:
        """Take a velocity (3,), m/s."""
        self._aids[1].append((stamp_ns - self._late_ns[1], velocity_n))

    def block(self, block: ImuBlock) -> None:
        """Take the next block of the IMU."""
        if not block.joined or (not self._blocks and self._begins_without(block)):
            self._blocks = []
            return
        self._blocks.append(block)
        if len(self._blocks) == 1 + _BLOCKS + _WAIT:
            self._fit(self._blocks[: 1 + _BLOCKS])
            self._blocks = self._blocks[_BLOCKS:]

    def _begins_without(self, block: ImuBlock) -> bool:
        return self._attitude(block) is None

    def _attitude(self, block: ImuBlock) -> Array | None:
        """(4,) at the end of a block: the autopilot's, or the filter's."""
        if usable_attitude(block.autopilot_q_nb):
            return block.autopilot_q_nb
        own = self._solution
        return own.q_nb if own and abs(own.stamp_ns - block.stamp_ns) < _NEAR_NS else None

    def _fit(self, blocks: list[ImuBlock]) -> None:
        """The first block's end is the start."""
        start, end_ns = blocks[0], blocks[-1].stamp_ns
        q_nb = self._attitude(start)
        if q_nb is None:
            return
        path = integrated(blocks[1:], q_nb, self._rotation_bi, self._lever_b)
        normals: list[Normal | None] = []
        for aids, fit in zip(self._aids, (by_positions, by_velocities), strict=True):
            inside = [aid for aid in aids if start.stamp_ns < aid[0] < end_ns]
            times_s = np.array([stamp_ns - start.stamp_ns for stamp_ns, _ in inside]) * 1e-9
            rising = len(inside) > 1 and bool((np.diff(times_s) > 0).all())
            normals.append(
                fit(path, times_s, np.array([v for _, v in inside])) if rising else None
            )
        self._windows.add(*normals)
        self._fresh = False

    @property
    def found(self) -> Lever | None:
        """What the flight tells so far; None while it is too short."""
        if not self._fresh:
            self._found, self._fresh = solved(self._windows), True
        return self._found

    def findings(self, topics: Container[str]) -> list[Finding]:
        """Return what differs from the parameters; ``topics`` are those that come."""
        unset = self._unset(topics)
        found = [] if self.found is None else [*self._lever(self.found), *self._delays(self.found)]
        return [unset, *(one for one in found if one.check != unset.check)] if unset else found

    def _unset(self, topics: Container[str]) -> Finding | None:
        """Of an aircraft with two antennas whose places nobody gave."""
        given, two = self._given, "rtk/heading" in topics
        if self._lever_b.any() or not two or (given is not None and _LEVER in given):
            return None
        told = "" if self.found is None else f"; this flight says about {_told(self.found)}"
        evidence = f"rtk/heading comes, and the antennas' places are still at zero{told}"
        severity = Severity.NOTE if given is None else Severity.CAUTION
        mend = "measure both from the IMU with a tape (forward, left, up)"
        return Finding("antenna_place", severity, evidence, f"{_LEVER}, {_SECOND}", mend)

    def _lever(self, found: Lever) -> list[Finding]:
        off = found.lever_b - self._lever_b
        sigma = np.hypot(found.lever_sigma_b, self._sigma_b)
        if not (np.abs(off) > np.maximum(_SIGMAS * sigma, _LEAST_M)).any():
            return []
        set_m = flu_from_frd(self._lever_b)
        told = ", ".join(f"{value:+.2f}" for value in set_m)
        evidence = f"the flight puts the RTK antenna at {_told(found)}, not at ({told})"
        names = [
            name
            for name, own, other in zip(
                ("forward", "left", "up"), set_m, flu_from_frd(found.lever_b), strict=True
            )
            if abs(own) > _LEAST_M and abs(own + other) < 0.5 * abs(own)
        ]
        mend = (
            f"is the sign of {' and '.join(names)} wrong?"
            if names
            else "measure it from the IMU, with a tape"
        )
        severity = Severity.CAUTION if self._lever_b.any() else Severity.NOTE
        if self._given is not None and _LEVER in self._given:
            severity = Severity.CAUTION
        return [Finding("antenna_place", severity, evidence, f"ekf_node {_LEVER}", mend)]

    def _delays(self, found: Lever) -> list[Finding]:
        delays_s, sigmas_s = found.delays_s.tolist(), found.delay_sigmas_s.tolist()
        told = [
            _delay("rtk/fix", "rtk.delay_s", delays_s[0], sigmas_s[0]),
            _delay("rtk/vel", "rtk.velocity_delay_s", delays_s[1], sigmas_s[1]),
        ]
        return [one for one in told if one]


def _delay(topic: str, name: str, delay_s: float, sigma_s: float) -> Finding | None:
    """Of stamps that are later than measurements by so much beyond what is set."""
    if abs(delay_s) < max(_LEAST_S, _SIGMAS * sigma_s):
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


def _told(found: Lever) -> str:
    place = ", ".join(f"{value:+.2f}" for value in flu_from_frd(found.lever_b))
    sigma = ", ".join(f"{value:.2f}" for value in found.lever_sigma_b)
    return f"({place}) m forward, left, up (sigma {sigma})"
