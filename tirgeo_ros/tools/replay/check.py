"""Check a recorded flight's set-up and sensors: the work of ``tirgeo check``."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

from tirgeo_ros.core.checks.recording_checks import damage_findings, no_pose_findings
from tirgeo_ros.core.config import OverlayConfig
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
from tirgeo_ros.tools.replay import CheckSetting, FlightChecks, finding_items, setting_of
from tirgeo_ros.tools.replay.finding_lines import tally_line
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
    files = _Files()
    ground = files.read("dem", lambda: ground_of(overlay))
    known = files.read("camera", lambda: given_camera(overlay))
    layers = files.read("map", lambda: _layers(map_path, overlay))
    setting = setting_of(
        fitted,
        reader,
        params,
        namespace,
        ground=ground,
        layers=layers,
        camera=known,
        pictures=True,
    )
    setting = replace(setting, found=(*setting.found, *files.found))
    flight = _Flight(reader, setting, namespace)
    flight.read(progress)
    found = flight.findings()
    return {
        "input": os.fspath(bag),
        "verdict": tally_line(found),
        "findings": finding_items(found),
        "checked": flight.numbers(ground) | ({"map_layers": len(layers)} if layers else {}),
        "notes": notes,
        "error": verdict_line(found) if tally_line(found).startswith("NO GO") else None,
    }


def _layers(path: str, overlay: OverlayConfig) -> list[MapLayer] | None:
    if not path:
        return None
    return load_layers(path, overlay.style, overlay.label_field, network=overlay.network)


class _Files:
    """Read the files that the parameters name; a file that cannot be read becomes a finding."""

    def __init__(self) -> None:
        self.found: list[Finding] = []

    def read(self, parameter: str, load: Callable[[], T]) -> T | None:
        """Return what ``load`` returns, or None and a finding if it raises TirgeoError."""
        try:
            return load()
        except TirgeoError as error:
            name, mend = f"overlay_node {parameter}", "give another file, or mend this one"
            check = f"{parameter}_unreadable"
            self.found.append(Finding(check, Severity.STOP, str(error), name, mend))
            return None


class _Flight:
    """Make one pass through a bag: no overlay is drawn, nothing is written; a Taker."""

    topics = tuple(SAMPLES)

    def __init__(self, reader: BagReader, setting: CheckSetting, namespace: str) -> None:
        self._reader = reader
        self._checks = FlightChecks(setting)
        self._recorded = RecordedFlight(
            reader,
            namespace,
            pictures=True,
            camera=setting.camera,
            checks=self._checks,
            needs_camera=False,
            all_pixels=True,
        )
        self._recorded.add(self)
        self._layers, self._ground = setting.layers, setting.ground
        self._plane: TangentPlane | None = None
        self._no_heights = ""  # why the map cannot be placed in the plane
        self._registration = Registration(setting.ekf, setting.gimbal)
        self._heights_m = (math.inf, -math.inf)  # lowest and highest, ellipsoidal

    def read(self, progress: Report) -> None:
        """Process every message; call ``progress`` with seconds of the flight."""
        self._recorded.read_all(progress)

    def take(self, sample: Sample) -> None:
        """Process a sample in filter and gimbal; lay the map in a new plane."""
        found = self._registration.take(sample)
        plane = self._registration.navigation.plane
        self._checks.registered(found, plane)
        if plane is not None and plane is not self._plane:
            self._plane = plane
            self._lay(plane)
        if found.solution is not None:
            low, high = self._heights_m
            height_m = found.solution.height_m
            self._heights_m = (min(low, height_m), max(high, height_m))

    def _lay(self, plane: TangentPlane) -> None:
        if self._layers is None:
            return
        ground = math.nan if self._ground is None else self._ground
        try:
            self._checks.map(lay_layers(self._layers, plane, ground))
        except ConfigError as error:
            self._no_heights = str(error)

    def findings(self) -> list[Finding]:
        """Return all findings, the worst first."""
        found = [*damage_findings(self._reader.damage), *self._checks.findings()]
        if self._no_heights:
            name, mend = "overlay_node ground_height_m", "give the ground's height, or a dem"
            found.append(Finding("no_ground", Severity.STOP, self._no_heights, name, mend))
        explained = any(one.severity is Severity.STOP for one in found)
        if not self._has_pose and not explained:
            found += no_pose_findings(self._registration.navigation.status())
        return sorted_findings(found)

    @property
    def _has_pose(self) -> bool:
        return math.isfinite(self._heights_m[0])

    def numbers(self, ground: Ground | None) -> dict[str, object]:
        """Return numbers of the flight: duration, topics, method, state, picture size, heights."""
        status = self._registration.navigation.status()
        first_ns, last_ns = self._reader.span_ns
        numbers: dict[str, object] = {
            "duration_s": (last_ns - first_ns) * 1e-9,
            "topics": self._checks.seen.topics,
            "method": status.method,
            "state": status.state.value,
            "heading_sigma_deg": math.degrees(status.heading_sigma_rad),
            "composition": self._registration.composer.composition,
            "picture_size": self._checks.seen.size,
        }
        if isinstance(ground, float) and self._has_pose:
            numbers["height_above_ground_m"] = [one - ground for one in self._heights_m]
        return numbers
