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
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, Source

#: Fixes no further apart in time than this are compared, one pair in each such interval.
_NEAR_NS = 500_000_000
_KEPT, _LEAST_NUMBER = 60, 12  # pairs
#: A constant difference beyond this many sigmas and metres is not a GPS error.
_SIGMAS, _LEAST_M = 3.0, 8.0
_LARGEST_UNDULATION_M = 110.0
_ELSEWHERE_M = 1e4
_SWAPPED_RAD = 0.01


class PositionChecks:
    """Compare the positions of both receivers."""

    def __init__(self, config: EkfConfig) -> None:
        self._sigma_m = np.array(config.gps.position_sigma_m)
        self._newest: dict[Source, PositionSample] = {}
        # GPS minus RTK, NED, m, and its sigma, m: (6,)
        self._apart: deque[Array] = deque(maxlen=_KEPT)
        self._compared_ns = -_NEAR_NS

    def position(self, sample: PositionSample) -> None:
        """Take a position as it arrived, also one with latitude and longitude swapped."""
        place = sample.latitude_rad, sample.longitude_rad, sample.height_m
        if sample.status is FixStatus.NONE or not all(map(math.isfinite, place)):
            return
        self._newest[sample.source] = sample
        rtk = self._newest.get(Source.RTK_POSITION)
        gps = self._newest.get(Source.GPS_POSITION)
        if rtk is None or gps is None or abs(rtk.stamp_ns - gps.stamp_ns) > _NEAR_NS:
            return
        if 0 <= sample.stamp_ns - self._compared_ns < _NEAR_NS:
            return
        self._compared_ns = sample.stamp_ns
        plane = TangentPlane(rtk.latitude_rad, rtk.longitude_rad, rtk.height_m)
        apart_n = plane.ned_from_geodetic(gps.latitude_rad, gps.longitude_rad, gps.height_m)
        variances = gps.covariance_n.diagonal()
        sigma = self._sigma_m
        if variances.min() > 0:
            sigma = np.sqrt(variances + np.maximum(rtk.covariance_n.diagonal(), 0.0))
        if np.isfinite(sigma).all():
            self._apart.append(np.append(apart_n, sigma))

    def findings(self) -> list[Finding]:
        """Return where they differ, during all the time, by more than the GPS errors."""
        if len(self._apart) < _LEAST_NUMBER:
            return []
        apart, sigma = np.hsplit(np.array(self._apart), 2)
        limit = np.maximum(_SIGMAS * sigma.mean(axis=0), _LEAST_M)
        north, east, down = np.median(apart, axis=0).tolist()
        if math.hypot(north, east) > _ELSEWHERE_M:
            return [self._elsewhere(math.hypot(north, east))]
        found = []
        if np.percentile(np.abs(apart[:, 2]), 10) > limit[2]:
            off = f"{-down:+.1f} m above rtk/fix"
            mend = "one height has a different unit or datum"
            if abs(down) < _LARGEST_UNDULATION_M:
                mend = (
                    "one is above sea level: all heights are ellipsoidal; switch the receiver, "
                    "or set the undulation of the place"
                )
            where = "rtk/fix, gps/fix altitude; dji_node geoid_undulation_m"
            found.append(_constant("height_datum", off, sigma[:, 2], where, mend))
        if np.percentile(np.linalg.norm(apart[:, :2], axis=1), 10) > math.hypot(*limit[:2]):
            off = f"{north:+.0f} m north and {east:+.0f} m east of rtk/fix"
            mend = "check the coordinates of the RTK base, and that both are in WGS84"
            found.append(_constant("position_datum", off, sigma[:, :2], "rtk/fix, gps/fix", mend))
        return found

    def _elsewhere(self, across_m: float) -> Finding:
        rtk, gps = self._newest[Source.RTK_POSITION], self._newest[Source.GPS_POSITION]
        evidence = f"rtk/fix and gps/fix are {across_m / 1e3:.0f} km apart"
        apart = rtk.latitude_rad - gps.longitude_rad, rtk.longitude_rad - gps.latitude_rad
        mend = "one is of another place: check its driver (degrees, signs) and its base"
        if max(map(abs, apart)) < _SWAPPED_RAD:
            mend = "latitude and longitude of one are swapped"
        where = "rtk/fix, gps/fix latitude, longitude"
        return Finding("position_elsewhere", Severity.STOP, evidence, where, mend)


def _constant(check: str, off: str, sigmas: Array, where: str, mend: str) -> Finding:
    evidence = f"gps/fix is {off} all along (its sigma is {sigmas.mean():.1f} m)"
    return Finding(check, Severity.CAUTION, evidence, where, mend)
