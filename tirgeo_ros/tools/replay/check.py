"""Check a recorded flight's set-up and sensors: the work of ``tirgeo check``."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.checks.input_checks import damage_findings, no_pose_findings
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.map.map_layers import MapLayer
from tirgeo_ros.core.types.finding import Finding, sorted_findings, stop_line
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.parameters.parameter_file import Files
from tirgeo_ros.io.pictures.camera_file import given_camera
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.finding_lines import finding_items, tally_line
from tirgeo_ros.tools.replay.flight_checks import FlightChecks, tried, tried_map
from tirgeo_ros.tools.replay.flight_poses import RecordedFlight
from tirgeo_ros.tools.replay.node_configs import node_configs
from tirgeo_ros.tools.replay.registration import SAMPLES, Registration, Sample


def check(
    bag: PathLike,
    *,
    params: Files = None,
    map: PathLike | None = None,  # noqa: A002 the option's name
    dem: PathLike | None = None,
    ground_height: float | None = None,
    camera: PathLike | None = None,
    namespace: str = "",
    progress: Report = silent,
) -> dict[str, object]:
    """Run a bag through filter, gimbal and all checks, and return findings and numbers.

    ``error`` is the verdict if it is NO GO, else None. A map, an elevation model or a calibration
    that cannot be read is a finding. Raise BagError and ConfigError.
    """
    configs = node_configs(params, namespace, dem=dem, ground_height=ground_height, camera=camera)
    reader = BagReader(bag)
    fitted, notes = configs.fitting(reader, namespace)
    overlay = fitted.overlay
    path = os.fspath(overlay.map if map is None else map)
    found: list[Finding] = []
    ground = tried(found, "dem", lambda: ground_of(overlay))
    known = tried(found, "camera", lambda: given_camera(overlay))
    layers = tried_map(found, overlay, path, used=True)
    of_flight = (fitted, reader, params, namespace)
    checks = FlightChecks(*of_flight, ground=ground, layers=layers, camera=known, pictures=True)
    wanted = {"pictures": True, "needs_camera": False, "all_pixels": True}
    recorded = RecordedFlight(reader, namespace, camera=known, checks=checks, **wanted)
    flight = _Flight(Registration(fitted.ekf, fitted.gimbal), checks, layers, ground)
    recorded.add(SAMPLES, flight.take)
    recorded.read_all(progress)
    found = flight.findings([*found, *damage_findings(reader.damage)])
    return {
        "input": os.fspath(bag),
        "verdict": tally_line(found),
        "findings": finding_items(found),
        "checked": flight.numbers(reader),
        "notes": notes,
        "error": stop_line(found),
    }


def _flow(arrivals_ns: Sequence[int]) -> dict[str, float | None]:
    """Return number, rate (Hz) and longest gap (s) of messages."""
    steps_s = np.diff(arrivals_ns) * 1e-9
    span_s = float(steps_s.sum())
    return {
        "messages": len(arrivals_ns),
        "rate_hz": len(steps_s) / span_s if span_s > 0 else None,
        "longest_gap_s": float(steps_s.max(initial=0.0)),
    }


class _Flight:
    """Run the samples through filter and gimbal."""

    def __init__(
        self,
        registration: Registration,
        checks: FlightChecks,
        layers: Sequence[MapLayer] | None,
        ground: Ground | None,
    ) -> None:
        self._registration = registration
        self._checks, self._layers = checks, layers
        self._ground = ground
        self._lowest_m, self._highest_m = math.inf, -math.inf  # ellipsoidal, of the body

    def take(self, sample: Sample) -> None:
        """Process a sample."""
        found = self._registration.take(sample)
        self._checks.registered(found, self._registration.navigation.plane)
        if found.solution is not None:
            self._lowest_m = min(self._lowest_m, found.solution.height_m)
            self._highest_m = max(self._highest_m, found.solution.height_m)

    def findings(self, found: list[Finding]) -> list[Finding]:
        """Return the flight's findings and those that were ``found`` before, the worst first."""
        found = [*found, *self._checks.findings()]
        if not math.isfinite(self._lowest_m) and stop_line(found) is None:
            found += no_pose_findings(self._registration.navigation.status())
        return sorted_findings(found)

    def numbers(self, reader: BagReader) -> dict[str, object]:
        """Return what the flight and its set-up were."""
        status, checks = self._registration.navigation.status(), self._checks
        first_ns, last_ns = reader.span_ns
        checked: dict[str, object] = {
            "duration_s": (last_ns - first_ns) * 1e-9,
            "topics": {t: _flow(times) for t, times in sorted(checks.arrivals_ns.items())},
            "method": status.method,
            "state": status.state.value,
            "heading_sigma_deg": math.degrees(status.heading_sigma_rad),
            "composition": self._registration.composer.composition,
            "picture_size": checks.picture_size,
        }
        if isinstance(self._ground, float) and math.isfinite(self._lowest_m):
            heights_m = (self._lowest_m, self._highest_m)
            checked["height_above_ground_m"] = [one - self._ground for one in heights_m]
        if self._layers:
            checked["map_layers"] = len(self._layers)
        return checked
