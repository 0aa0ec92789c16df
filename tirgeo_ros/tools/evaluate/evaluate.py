"""Locate every observed control point of a flight under every method (section 5.1)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.map.layers import MapLayer
from tirgeo_ros.core.types.errors import BagError, CalibrationError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.maps import load_layers
from tirgeo_ros.io.parameters.parameter_file import Files, paths_of
from tirgeo_ros.io.pictures.camera_file import given_camera
from tirgeo_ros.tools.evaluate.ground import (
    Experiment,
    check_notes,
    checks_of,
    load_experiment,
    locate_observations,
)
from tirgeo_ros.tools.evaluate.methods import MethodSetup, method_setups, setup_notes
from tirgeo_ros.tools.evaluate.result import Evaluation, MethodResult, Still
from tirgeo_ros.tools.evaluate.series import MethodSeries, SensorSeries
from tirgeo_ros.tools.evaluate.stills import overlay_stills
from tirgeo_ros.tools.evaluate.t_test import paired_tests
from tirgeo_ros.tools.evaluate.verdict import place_notes
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.flight_checks import FlightChecks
from tirgeo_ros.tools.replay.flight_poses import FlightPoses, RecordedFlight
from tirgeo_ros.tools.replay.flight_topics import done_without, resolved
from tirgeo_ros.tools.replay.recorded_flight import TruePoses, load_truth

#: Topics that define a method. Without them the filter would still run, on ordinary GPS.
_ESSENTIAL = {"ekf": ("rtk/fix",), "ekf_heading": ("rtk/fix", "rtk/heading")}


def evaluate(
    bag: PathLike,
    survey: PathLike,
    observations: PathLike,
    *,
    params: Files = None,
    boresight: PathLike | None = None,
    dem: PathLike | None = None,
    ground_height: float | None = None,
    namespace: str = "",
    projection: str = "gauss-krueger",
    truth: PathLike | None = None,
    map_path: PathLike | None = None,
    camera: PathLike | None = None,
    progress: Report = silent,
) -> Evaluation:
    """Locate the observations of a bag under every method, in one pass through it.

    ``params`` are parameter files, of which later ones override earlier ones; ``boresight``, one
    more, adds the method ``calibrated``. ``dem`` or ``ground_height`` (ellipsoidal m) overrides
    them; without any ground it is level at the median of the observed points' heights.
    ``projection`` is ``gauss-krueger`` or ``utm``; ``truth`` is the truth of a simulated flight;
    ``map_path`` overrides the parameters' map, which is drawn on the stills; ``camera``, a
    calibration file, overrides the bag's. A method whose topics the bag lacks is reported as
    missing. Raise BagError, CameraError, ConfigError, SurveyError, ElevationError, MapError, and
    CalibrationError if no method can be run.
    """
    given = load_experiment(survey, observations, projection)
    setups = method_setups(
        params, boresight, dem, ground_height, namespace, given.heights_m, camera
    )
    truly = None if truth is None else load_truth(Path(truth))
    drawn = setups[-1].configs.overlay
    map_text = drawn.map if map_path is None else os.fspath(map_path)
    layers: list[MapLayer] = []
    if map_text:
        layers = load_layers(map_text, drawn.style, drawn.label_field, network=drawn.network)
    files = [*paths_of(params), *paths_of(boresight)]
    flight = _Flight(BagReader(bag), setups, given, namespace, truly, files)
    flight.recorded.read_all(progress)
    methods = flight.results()
    checks = checks_of(given, flight.recorded.picture_stamps_ns)
    return Evaluation(
        os.fspath(bag),
        os.fspath(survey),
        os.fspath(observations),
        given.projection,
        given.control,
        checks,
        flight.series.sensors(given.projection),
        methods,
        flight.missing | flight.faults,
        flight.faults,
        paired_tests({one.method: one.errors.point_rmse_m for one in methods}),
        flight.stills(layers),
        [
            *setup_notes(setups, given.heights_m),
            *flight.notes,
            *check_notes(checks),
            *place_notes(methods),
        ],
        flight.error(methods),
        flight.checks.findings(),
    )


@dataclass(frozen=True)
class _Run:
    """Run one method over the flight."""

    setup: MethodSetup
    poses: FlightPoses
    series: MethodSeries

    @property
    def fault(self) -> str:
        """Return why the method has no poses; empty if it has."""
        if self.poses.plane is not None and self.series.has_poses:
            return ""
        reason = self.poses.registration.navigation.status().reason
        return f"no camera pose could be made{': ' if reason else ''}{reason}"

    def result(self, camera: Camera, given: Experiment) -> MethodResult:
        """Return the method's results."""
        plane, setup = self.poses.plane, self.setup
        assert plane is not None
        located, refused = locate_observations(
            self.poses.cameras, plane, camera, given, setup.ground, setup.configs.overlay
        )
        status = self.poses.registration.navigation.status()
        return MethodResult(
            setup,
            self.poses.registration.composer.composition,
            status.state.value,
            located,
            refused,
            self.series.body(given.projection),
            self.series.camera(plane, given.projection),
            self.series.innovations(),
            {f"{source} {outcome}": number for (source, outcome), number in status.counts.items()},
            self.series.body_errors(),
        )


class _Flight:
    """Run all methods over one bag. Raise CalibrationError if none can be run."""

    def __init__(
        self,
        reader: BagReader,
        setups: Sequence[MethodSetup],
        given: Experiment,
        namespace: str,
        truth: TruePoses | None,
        files: Sequence[PathLike],
    ) -> None:
        self.missing: dict[str, str] = {}  # method -> reason, for absent topics
        self.faults: dict[str, str] = {}
        self.notes: list[str] = []
        self._reader, self._given, self._namespace = reader, given, namespace
        last = setups[-1]  # whose parameters are checked
        camera = given_camera(last.configs.overlay)
        self.checks = FlightChecks(
            last.configs, reader, files, namespace, ground=last.ground, camera=camera
        )
        self.recorded = RecordedFlight(
            reader, namespace, pictures=True, camera=camera, checks=self.checks
        )
        self.series = SensorSeries()
        self._runs = [run for setup in setups if (run := self._begun(setup, truth)) is not None]
        if self._runs:
            self._runs[-1].poses.checks = self.checks
        self.recorded.add(self.series.topics, self.series.take)
        self._check_any(self._runs)

    def _begun(self, setup: MethodSetup, truth: TruePoses | None) -> _Run | None:
        """Return a method that takes part, or None and its reason in ``missing``."""
        ekf, gimbal, *_ = setup.configs
        series = MethodSeries(truth)
        instants_ns = [one.stamp_ns - setup.latency_ns for one in self._given.observations]
        lacking = [t for t in _ESSENTIAL.get(ekf.method, ()) if not self.recorded.has(t)]
        if lacking:
            self._leave_out(setup, f"needed topic absent: {self._names(lacking)}")
            return None
        try:
            poses = self.recorded.registered(ekf, gimbal, instants_ns, series)
        except BagError as error:
            self._leave_out(setup, str(error).removeprefix(f"{self._reader.path}: "))
            return None
        absent = self._names(done_without(poses.topics, ekf.method))
        if absent:
            self.notes.append(f"{setup.method}: {absent} absent: done without")
        return _Run(setup, poses, series)

    def _leave_out(self, setup: MethodSetup, reason: str) -> None:
        self.missing[setup.method] = reason
        self.notes.append(f"{setup.method} is left out: {reason}")

    def _names(self, topics: Sequence[str]) -> str:
        return ", ".join(resolved(topic, self._namespace) for topic in topics)

    def results(self) -> list[MethodResult]:
        """Return the results of the methods that have poses; put the others into ``faults``."""
        self.faults = {run.setup.method: run.fault for run in self._runs if run.fault}
        self._runs = [run for run in self._runs if not run.fault]
        self._check_any(self._runs)
        return [run.result(self.recorded.camera, self._given) for run in self._runs]

    def stills(self, layers: Sequence[MapLayer]) -> list[Still]:
        """Return pictures of the last method that has poses, with the map drawn."""
        run = self._runs[-1]
        return overlay_stills(
            self._reader,
            self._namespace,
            self.recorded.camera,
            run.poses,
            run.setup,
            layers,
            self._given,
        )

    def _check_any(self, runs: Sequence[_Run]) -> None:
        if runs:
            return
        reasons: dict[str, list[str]] = {}
        for method, reason in (self.missing | self.faults).items():
            reasons.setdefault(reason, []).append(method)
        text = "; ".join(f"{', '.join(names)}: {why}" for why, names in reasons.items())
        raise CalibrationError(f"{self._reader.path}: no method can be run: {text}")

    def error(self, methods: Sequence[MethodResult]) -> str | None:
        """Return what makes the run a failure although there is a result, or None."""
        if self._reader.damage is not None:
            return f"{self._reader.path}: {self._reader.damage}; the numbers are made from these"
        if not any(one.located for one in methods):
            reason = methods[-1].refused[0].reason
            return f"{self._reader.path}: no observation could be located: {reason}"
        return None
