"""Check that RTK and ordinary GPS give the same place: height, datum, swapped coordinates.

The two differ by the GPS errors: some metres that change over minutes. Heights above sea level and
above the ellipsoid differ by the geoid's undulation, up to 110 m.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.streams.sanity_checks import place_fault
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source

#: Fixes no further apart in time than this are compared.
_NEAR_NS = 500_000_000
_STEP_NS = 500_000_000
_KEPT, _LEAST_NUMBER = 60, 12  # half seconds
#: A constant difference beyond this many sigmas and metres is not a GPS error.
_SIGMAS, _LEAST_M = 3.0, 8.0
_LARGEST_UNDULATION_M = 110.0
_ELSEWHERE_M = 1e4


class PositionChecks:
    """Compare the positions of both receivers."""

    def __init__(self, config: EkfConfig) -> None:
        self._sigma_m = config.gps.position_sigma_m
        self._newest: dict[Source, PositionSample] = {}
        # GPS minus RTK (3,), NED, m, and its sigma (3,), m
        self._apart: deque[tuple[Array, Array]] = deque(maxlen=_KEPT)
        self._compared_ns: int | None = None

    def position(self, sample: PositionSample) -> None:
        """Take a position as it arrived."""
        place = sample.latitude_rad, sample.longitude_rad, sample.height_m
        finite = math.isfinite(place[1]) and math.isfinite(place[2])  # swapped ones are kept
        if sample.status is FixStatus.NONE or (place_fault(*place) and not finite):
            return
        self._newest[sample.source] = sample
        rtk = self._newest.get(Source.RTK_POSITION)
        gps = self._newest.get(Source.GPS_POSITION)
        if rtk is None or gps is None or abs(rtk.stamp_ns - gps.stamp_ns) > _NEAR_NS:
            return
        before_ns, now_ns = self._compared_ns, sample.stamp_ns
        if before_ns is None or not 0 <= now_ns - before_ns < _STEP_NS:
            self._compared_ns = now_ns
            self._compare(rtk, gps)

    def _compare(self, rtk: PositionSample, gps: PositionSample) -> None:
        plane = TangentPlane(rtk.latitude_rad, rtk.longitude_rad, rtk.height_m)
        apart_n = plane.ned_from_geodetic(gps.latitude_rad, gps.longitude_rad, gps.height_m)
        variances = gps.covariance_n.diagonal() + np.maximum(rtk.covariance_n.diagonal(), 0.0)
        admitted = gps.covariance_n.diagonal().min() > 0
        sigma = np.sqrt(variances) if admitted else np.array(self._sigma_m)
        if np.isfinite(sigma).all():
            self._apart.append((apart_n, sigma))

    def findings(self) -> list[Finding]:
        """Return where they differ, during all the time, by more than the GPS errors."""
        if len(self._apart) < _LEAST_NUMBER:
            return []
        apart, sigma = (np.array(column) for column in zip(*self._apart, strict=True))
        limit = np.maximum(_SIGMAS * sigma.mean(axis=0), _LEAST_M)
        across_m = float(np.linalg.norm(np.median(apart[:, :2], axis=0)))
        if across_m > _ELSEWHERE_M:
            return [self._elsewhere(across_m)]
        found = []
        down = apart[:, 2]
        if np.percentile(np.abs(down), 10) > limit[2] and abs(np.sign(down).sum()) == len(down):
            found.append(_height(-float(np.median(down)), float(sigma[:, 2].mean())))
        if np.percentile(np.linalg.norm(apart[:, :2], axis=1), 10) > math.hypot(*limit[:2]):
            found.append(_horizontal(np.median(apart, axis=0), float(sigma[:, :2].mean())))
        return found

    def _elsewhere(self, across_m: float) -> Finding:
        rtk, gps = self._newest[Source.RTK_POSITION], self._newest[Source.GPS_POSITION]
        evidence = f"rtk/fix and gps/fix are {across_m / 1e3:.0f} km apart"
        apart = rtk.latitude_rad - gps.longitude_rad, rtk.longitude_rad - gps.latitude_rad
        mend = "one is of another place: look at its driver (degrees, signs) and its base"
        if max(map(abs, apart)) < 0.01:
            mend = "latitude and longitude of one are swapped"
        where = "rtk/fix, gps/fix latitude, longitude"
        return Finding("position_elsewhere", Severity.STOP, evidence, where, mend)


def _height(up_m: float, sigma_m: float) -> Finding:
    """Return the finding on GPS height minus RTK height, m."""
    evidence = f"gps/fix is {up_m:+.1f} m above rtk/fix all along (its sigma is {sigma_m:.1f} m)"
    where = "rtk/fix, gps/fix altitude; dji_node geoid_undulation_m"
    mend = "one height has another unit or datum"
    if abs(up_m) < _LARGEST_UNDULATION_M:
        sea = "one is above sea level: all heights are ellipsoidal"
        mend = f"{sea}; switch the receiver, or set the undulation of the place"
    return Finding("height_datum", Severity.CAUTION, evidence, where, mend)


def _horizontal(apart_n: Array, sigma_m: float) -> Finding:
    north, east = apart_n[:2].tolist()
    evidence = (
        f"gps/fix is {math.hypot(north, east):.0f} m from rtk/fix all along ({north:+.0f} m "
        f"north, {east:+.0f} m east; its sigma is {sigma_m:.1f} m)"
    )
    mend = "check the coordinates of the RTK base, and that both are in WGS84"
    return Finding("position_datum", Severity.CAUTION, evidence, "rtk/fix, gps/fix", mend)
