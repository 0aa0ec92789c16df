"""Check a recorded flight's set-up and sensors: the work of ``tirgeo check``."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from tirgeo_ros.core.checks.recording_checks import damage_findings, no_pose_findings
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.map.draping import Ground
from tirgeo_ros.core.map.layers import MapLayer
from tirgeo_ros.core.overlay.map_renderer import lay_layers
from tirgeo_ros.core.types.errors import ConfigError, TirgeoError
from tirgeo_ros.core.types.finding import Finding, Severity, sorted_findings, verdict_line
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.maps import load_layers
from tirgeo_ros.io.parameters.parameter_file import Files
from tirgeo_ros.io.pictures.camera_file import given_camera
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.finding_lines import finding_items, tally_line
from tirgeo_ros.tools.replay.flight_checks import FlightChecks
from tirgeo_ros.tools.replay.flight_poses import RecordedFlight
from tirgeo_ros.tools.replay.node_configs import node_configs
from tirgeo_ros.tools.replay.registration import SAMPLES, Registration, Sample

T = TypeVar("T")


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

    ``error`` is the verdict if it is NO GO, else None. ``map``, ``dem`` or ``ground_height``
    (ellipsoidal m) and ``camera`` override those in ``params``. A map, an elevation model or a
    calibration that cannot be read is a finding. Raise BagError and ConfigError.
    """
    configs = node_configs(params, namespace, dem=dem, ground_height=ground_height, camera=camera)
    reader = BagReader(bag)
    fitted, notes = configs.fitting(reader, namespace)
    overlay = fitted.overlay
    map_path = overlay.map if map is None else os.fspath(map)
    found: list[Finding] = []

    def read(parameter: str, load: Callable[[], T]) -> T | None:
        """Read a file that the parameters name; one that cannot be read becomes a finding."""
        try:
            return load()
        except TirgeoError as error:
            name, mend = f"overlay_node {parameter}", "correct this file, or give another"
            check = f"{parameter}_unreadable"
            found.append(Finding(check, Severity.STOP, str(error), name, mend))
            return None

    def load_map() -> list[MapLayer] | None:
        if not map_path:
            return None
        return load_layers(map_path, overlay.style, overlay.label_field, network=overlay.network)

    ground = read("dem", lambda: ground_of(overlay))
    known = read("camera", lambda: given_camera(overlay))
    layers = read("map", load_map)
    checks = FlightChecks(
        fitted,
        reader,
        params,
        namespace,
        ground=ground,
        layers=layers,
        camera=known,
        pictures=True,
    )
    recorded = RecordedFlight(
        reader,
        namespace,
        pictures=True,
        camera=known,
        checks=checks,
        needs_camera=False,
        all_pixels=True,
    )
    flight = _Flight(Registration(fitted.ekf, fitted.gimbal), checks, layers, ground)
    recorded.add(SAMPLES, flight.take)
    recorded.read_all(progress)
    found += [*damage_findings(reader.damage), *checks.findings(), *flight.no_ground]
    status = flight.registration.navigation.status()
    has_pose = math.isfinite(flight.lowest_m)
    if not has_pose and not any(one.severity is Severity.STOP for one in found):
        found += no_pose_findings(status)
    found = sorted_findings(found)
    first_ns, last_ns = reader.span_ns
    checked: dict[str, object] = {
        "duration_s": (last_ns - first_ns) * 1e-9,
        "topics": {t: _flow(times) for t, times in sorted(checks.arrivals_ns.items())},
        "method": status.method,
        "state": status.state.value,
        "heading_sigma_deg": math.degrees(status.heading_sigma_rad),
        "composition": flight.registration.composer.composition,
        "picture_size": checks.picture_size,
    }
    if isinstance(ground, float) and has_pose:
        heights_m = (flight.lowest_m, flight.highest_m)
        checked["height_above_ground_m"] = [one - ground for one in heights_m]
    if layers:
        checked["map_layers"] = len(layers)
    return {
        "input": os.fspath(bag),
        "verdict": tally_line(found),
        "findings": finding_items(found),
        "checked": checked,
        "notes": notes,
        "error": verdict_line(found) if found and found[0].severity is Severity.STOP else None,
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
    """Run the samples through filter and gimbal, and lay the map in each new plane."""

    def __init__(
        self,
        registration: Registration,
        checks: FlightChecks,
        layers: Sequence[MapLayer] | None,
        ground: Ground | None,
    ) -> None:
        self.registration = registration
        self._checks, self._layers = checks, layers
        self._ground = math.nan if ground is None else ground
        self._plane: TangentPlane | None = None
        self.no_ground: list[Finding] = []  # why the map cannot be placed in the plane
        self.lowest_m, self.highest_m = math.inf, -math.inf  # ellipsoidal, of the body

    def take(self, sample: Sample) -> None:
        """Process a sample."""
        found = self.registration.take(sample)
        plane = self.registration.navigation.plane
        self._checks.registered(found, plane)
        if plane is not None and plane is not self._plane:
            self._plane = plane
            self._lay(plane)
        if found.solution is not None:
            self.lowest_m = min(self.lowest_m, found.solution.height_m)
            self.highest_m = max(self.highest_m, found.solution.height_m)

    def _lay(self, plane: TangentPlane) -> None:
        if self._layers is None:
            return
        try:
            self._checks.map(lay_layers(self._layers, plane, self._ground))
        except ConfigError as error:
            name, mend = "overlay_node ground_height_m", "give the ground's height, or a dem"
            self.no_ground = [Finding("no_ground", Severity.STOP, str(error), name, mend)]
