"""Check lever arm, delays, tilt and headings: compare the fit with the parameters."""

from __future__ import annotations

import math
from collections.abc import Collection, Container

import numpy as np

from tirgeo_ros.core.checks.finding_table import finding
from tirgeo_ros.core.checks.inertial_checks import rpy_text
from tirgeo_ros.core.checks.lever_arm_fit import LeverArmEstimate, LeverArmFit
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.frames.rotations import matrix_from_rotvec
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding

_SIGMAS, _LEAST_M, _LEAST_S = 5.0, 0.15, 0.05
#: With few windows the sigmas vary: in 14 to 30 s of recorded flights, errors reach 7.4 sigmas.
_MANY, _SIGMAS_OF_FEW = 15, 8.0
#: A larger tilt or offset moves the map by more than three ellipses; autopilots err by 1 to 2 deg.
_TILTED_RAD, _OFF_DEG, _OFF_SIGMAS = math.radians(3.0), 2.5, 4.0
_LEVER = "aircraft.rtk_antenna_m"


class LeverChecks:
    """Compare the estimates of ``fit`` with the parameters.

    ``explicit`` are the parameters that were set, None if not known.
    """

    def __init__(self, config: EkfConfig, explicit: Collection[str] | None) -> None:
        self.fit = LeverArmFit(config)
        self._explicit, aircraft = explicit, config.aircraft
        self._lever_b, self._sigma_b = aircraft.rtk_lever_b, aircraft.rtk_lever_sigma_b
        self._is_set = bool(self._lever_b.any()) or _LEVER in (explicit or ())
        self._rotation_bi = aircraft.rotation_bi
        self._attitude_sigma_rad = math.radians(max(config.autopilot.attitude_sigma_deg[:2]))

    def findings(self, topics: Container[str]) -> list[Finding]:
        """Return the differences from the parameters; ``topics`` are those that arrive."""
        estimate = self.fit.estimate
        unset = self._unset(topics, estimate)
        if estimate is None:
            return [*unset, finding("imu_tilt:unknown")] if self.fit.blind else unset
        # A tilt of the IMU's axes against the autopilot's attitude turns the lever arm too.
        tilt_rad = float(np.linalg.norm(estimate.tilt_b))
        sigma_rad = math.hypot(estimate.tilt_sigma, self._attitude_sigma_rad)
        if tilt_rad >= max(_TILTED_RAD, _SIGMAS * sigma_rad):
            angles = rpy_text(matrix_from_rotvec(estimate.tilt_b), self._rotation_bi)
            return [finding("imu_tilt", tilt_deg=math.degrees(tilt_rad), angles=angles)]
        findings = unset or self._lever(estimate)
        delays = _delays(estimate)
        off_deg = math.degrees(estimate.heading_off)
        sigma_deg = math.degrees(estimate.heading_sigma)
        if not delays and abs(off_deg) >= max(_OFF_DEG, _OFF_SIGMAS * sigma_deg):
            heading = finding("heading_offset:motion", off_deg=off_deg, sigma_deg=sigma_deg)
            findings = [heading, *findings]
        return [*findings, *delays]

    def _unset(self, topics: Container[str], estimate: LeverArmEstimate | None) -> list[Finding]:
        """Return a finding if there are two antennas and nobody set their places."""
        if self._is_set or "rtk/heading" not in topics:
            return []
        suggestion = f"; this flight suggests about {_place(estimate)}" if estimate else ""
        case = "unread" if self._explicit is None else ""
        return [finding("antenna_place:unset", case, suggestion=suggestion)]

    def _lever(self, estimate: LeverArmEstimate) -> list[Finding]:
        off = estimate.lever_b - self._lever_b
        sigma = np.hypot(estimate.lever_sigma_b, self._sigma_b)
        if not (np.abs(off) > np.maximum(_sigmas(estimate) * sigma, _LEAST_M)).any():
            return []
        set_m = flu_from_frd(self._lever_b)
        turned = np.abs(set_m + flu_from_frd(estimate.lever_b)) < 0.5 * np.abs(set_m)
        turned &= np.abs(set_m) > _LEAST_M
        texts = {
            "place": _place(estimate),
            "configured": _numbers(set_m),
            "axes": " and ".join(np.array(("forward", "left", "up"))[turned]),
        }
        case = f"{'set' if self._is_set else ''} {'sign' if turned.any() else ''}"
        return [finding("antenna_place", case, **texts)]


def _sigmas(estimate: LeverArmEstimate) -> float:
    """Return the number of sigmas at which a difference is significant."""
    return _SIGMAS if estimate.windows >= _MANY else _SIGMAS_OF_FEW


def _delays(estimate: LeverArmEstimate) -> list[Finding]:
    """Return findings on stamps that are later, or earlier, than the parameters say."""
    delays = zip(estimate.delays_s.tolist(), estimate.delay_sigmas_s.tolist(), strict=True)
    return [
        finding(
            f"{topic.replace('/', '_')}_delay",
            topic=topic,
            size_s=abs(delay_s),
            way="later" if delay_s > 0 else "earlier",
            sigma_s=sigma_s,
        )
        for topic, (delay_s, sigma_s) in zip(("rtk/fix", "rtk/vel"), delays, strict=True)
        if abs(delay_s) >= max(_LEAST_S, _sigmas(estimate) * sigma_s)
    ]


def _place(estimate: LeverArmEstimate) -> str:
    sigma = ", ".join(f"{value:.2f}" for value in estimate.lever_sigma_b)
    place = _numbers(flu_from_frd(estimate.lever_b))
    return f"({place}) m forward, left, up (sigma {sigma})"


def _numbers(values: Array) -> str:
    return ", ".join(f"{value:+.2f}" for value in values)
