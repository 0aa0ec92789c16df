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
from tirgeo_ros.tools.evaluate.checks import check_notes, checks_of, place_notes
from tirgeo_ros.tools.evaluate.ground import Experiment, load_experiment, locate_observations
from tirgeo_ros.tools.evaluate.result import Evaluation, MethodResult, Still
from tirgeo_ros.tools.evaluate.series import MethodSeries, SensorSeries
from tirgeo_ros.tools.evaluate.setups import MethodSetup, method_setups, setup_notes
from tirgeo_ros.tools.evaluate.stills import StillSource, overlay_stills
from tirgeo_ros.tools.evaluate.t_test import paired_tests
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay import CheckSetting, FlightChecks, setting_of
from tirgeo_ros.tools.replay.flight_poses import FlightPoses, RecordedFlight
from tirgeo_ros.tools.replay.flight_topics import done_without, resolved
from tirgeo_ros.tools.replay.node_configs import NodeConfigs, node_configs
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
    drawn = setups[-1].overlay
    map_text = drawn.map if map_path is None else os.fspath(map_path)
    layers = (
        load_layers(map_text, drawn.style, drawn.label_field, network=drawn.network)
        if map_text
        else []
    )
    reader = BagReader(bag)
    files = [*paths_of(params), *([] if boresight is None else [boresight])]
    options = node_configs(
        files, namespace, dem=dem, ground_height=ground_height, camera=camera
    ).given
    checks_setting = _check_setting(reader, setups[-1], options, files, namespace)
    flight = _Flight(reader, setups, given, namespace, truly, FlightChecks(checks_setting))
    flight.read(progress)
    methods = flight.results()
    sensors = flight.series.sensors(given.projection, flight.recorded.picture_stamps_ns)
    checks = checks_of(given, sensors.image_stamps_ns)
    stills = flight.stills(layers)
    notes = [
        *setup_notes(setups, given.heights_m),
        *flight.notes,
        *check_notes(checks),
        *place_notes(methods),
    ]
    return Evaluation(
        os.fspath(bag),
        os.fspath(survey),
        os.fspath(observations),
        given.projection,
        given.control,
        checks,
        sensors,
        methods,
        flight.missing | flight.faults,
        flight.faults,
        paired_tests({one.method: one.errors.point_rmse_m for one in methods}),
        stills,
        notes,
        flight.error(methods),
        flight.checks.findings(),
    )


def _check_setting(
    reader: BagReader,
    setup: MethodSetup,
    given: frozenset[str],
    files: Sequence[PathLike],
    namespace: str,
) -> CheckSetting:
    """Return the setting of the checks: that of the last method."""
    configs = NodeConfigs(setup.ekf, setup.gimbal, setup.overlay, given)
    known = given_camera(setup.overlay)
    return setting_of(configs, reader, files, namespace, ground=setup.ground, camera=known)


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
            self.poses.cameras, plane, camera, given, setup.ground, setup.overlay
        )
        status = self.poses.registration.navigation.status()
        return MethodResult(
            setup.method,
            self.poses.registration.composer.composition,
            status.state.value,
            setup.ground,
            setup.ground_words,
            located,
            refused,
            self.series.body(given.projection),
            self.series.camera(plane, given.projection),
            self.series.innovations(),
            {f"{source} {outcome}": number for (source, outcome), number in status.counts.items()},
            setup.parameters,
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
        checks: FlightChecks,
    ) -> None:
        self.checks = checks
        self.missing: dict[str, str] = {}  # method -> reason, for absent topics
        self.faults: dict[str, str] = {}
        self.notes: list[str] = []
        self.recorded = RecordedFlight(
            reader,
            namespace,
            pictures=True,
            camera=given_camera(setups[-1].overlay),
            checks=checks,
        )
        self.series = SensorSeries()
        self._reader = reader
        self._given = given
        self._namespace = namespace
        self._truth = truth
        self._runs = [run for setup in setups if (run := self._begun(setup)) is not None]
        if self._runs:
            self._runs[-1].poses.checks = checks
        self.recorded.add(self.series)
        self._check_any(self._runs)

    def _begun(self, setup: MethodSetup) -> _Run | None:
        """Return a method that takes part, or None and its reason in ``missing``."""
        series, method = MethodSeries(self._truth), setup.ekf.method
        instants_ns = [one.stamp_ns - setup.latency_ns for one in self._given.observations]
        try:
            self._check_essential(method)
            poses = self.recorded.registered(setup.ekf, setup.gimbal, instants_ns, series)
        except BagError as error:
            reason = str(error).removeprefix(f"{self._reader.path}: ")
            self.missing[setup.method] = reason
            self.notes.append(f"{setup.method} is left out: {reason}")
            return None
        absent = [self._name(topic) for topic in done_without(poses.topics, method)]
        if absent:
            self.notes.append(f"{setup.method}: {', '.join(absent)} absent: done without")
        return _Run(setup, poses, series)

    def _check_essential(self, method: str) -> None:
        topics = [name for name in _ESSENTIAL.get(method, ()) if not self.recorded.has(name)]
        if topics:
            raise BagError(f"needed topic absent: {', '.join(map(self._name, topics))}")

    def _name(self, topic: str) -> str:
        return resolved(topic, self._namespace)

    def read(self, progress: Report) -> None:
        """Pass the flight to all methods; call ``progress`` with seconds of the flight."""
        self.recorded.read_all(progress)

    def results(self) -> list[MethodResult]:
        """Return the results of the methods that have poses; put the others into ``faults``."""
        self.faults = {run.setup.method: run.fault for run in self._runs if run.fault}
        runs = [run for run in self._runs if not run.fault]
        self._check_any(runs)
        return [run.result(self.recorded.camera, self._given) for run in runs]

    def stills(self, layers: Sequence[MapLayer]) -> list[Still]:
        """Return pictures of the last method that has poses, with the map drawn."""
        run = [run for run in self._runs if not run.fault][-1]
        assert run.poses.plane is not None
        source = StillSource(
            self._reader,
            self._namespace,
            self.recorded.camera,
            run.poses.plane,
            run.poses.cameras,
            run.setup.overlay,
            run.setup.ground,
            layers,
            run.setup.method,
        )
        return overlay_stills(source, self._given.control.values(), self._given.observations)

    def _check_any(self, runs: Sequence[_Run]) -> None:
        if not runs:
            reasons: dict[str, list[str]] = {}
            for method, reason in (self.missing | self.faults).items():
                reasons.setdefault(reason, []).append(method)
            reasons_text = "; ".join(
                f"{', '.join(names)}: {why}" for why, names in reasons.items()
            )
            raise CalibrationError(f"{self._reader.path}: no method can be run: {reasons_text}")

    def error(self, methods: Sequence[MethodResult]) -> str | None:
        """Return what makes the run a failure although there is a result, or None."""
        if self._reader.damage is not None:
            return f"{self._reader.path}: {self._reader.damage}; the numbers are made from these"
        if not any(one.located for one in methods):
            reason = methods[-1].refused[0].reason
            return f"{self._reader.path}: no observation could be located: {reason}"
        return None
