"""Locate every observed control point of a flight under every method (section 5.1)."""

from __future__ import annotations

import os
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.map.map_layers import GeoFeature, LayerStyle, MapLayer
from tirgeo_ros.core.overlay.picture_painter import PicturePainter
from tirgeo_ros.core.overlay.tone_mapping import ToneMapper
from tirgeo_ros.core.types.arrays import RawPixels
from tirgeo_ros.core.types.errors import BagError, CalibrationError, TirgeoError
from tirgeo_ros.core.types.finding import stop_line
from tirgeo_ros.core.types.measurements import PositionSample
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.bags.cdr import header_stamp_ns
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.maps import load_layers, map_files
from tirgeo_ros.io.parameters.parameter_file import Files, paths_of
from tirgeo_ros.io.pictures.camera_file import given_camera
from tirgeo_ros.tools.evaluate.experiment import (
    Experiment,
    MethodSetup,
    input_notes,
    load_experiment,
    method_setups,
    setup_notes,
)
from tirgeo_ros.tools.evaluate.result import (
    Evaluation,
    MethodResult,
    locate_observations,
    paired_tests,
)
from tirgeo_ros.tools.evaluate.series import MethodSeries, Track, TruePoses, load_truth
from tirgeo_ros.tools.evaluate.summary import check_folder
from tirgeo_ros.tools.evaluate.verdict import place_note
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.flight import Flight, FlightPoses
from tirgeo_ros.tools.replay.flight_checks import FlightChecks
from tirgeo_ros.tools.replay.flight_topics import PICTURES, done_without, resolved
from tirgeo_ros.tools.replay.node_configs import node_configs
from tirgeo_ros.tools.replay.registration import Sample, can_smooth

_STILLS = 4  # spread over the flight
_QUALITY = 85
_CLICK_BGR, _CLICK_PX = (0, 140, 255), 13
_CONTROL = LayerStyle(line_bgr=(120, 255, 120), width_px=2)
_CAPTION = (
    "{names} at {time_s:.3f} s. Orange crosses: where it was clicked. Green diamonds: "
    "the surveyed points by {method}. Yellow, or as its style says: the map by {method}"
)


def overlay_stills(
    reader: BagReader,
    namespace: str,
    camera: Camera,
    poses: FlightPoses,
    setup: MethodSetup,
    layers: Sequence[MapLayer],
    given: Experiment,
) -> list[tuple[str, bytes]]:
    """Return captions and JPEG of a method with clicks drawn; empty without pictures."""
    overlay, plane = setup.configs.overlay, poses.plane
    assert plane is not None
    points = [
        GeoFeature(p.id, False, np.array([[p.latitude_rad, p.longitude_rad, p.height_m]]))
        for p in given.control.values()
    ]
    terrain = setup.ground if isinstance(setup.ground, Terrain) else None
    layers = [*layers, MapLayer("control points", points, _CONTROL)]
    drawing = PicturePainter(overlay, layers, terrain)
    drawing.set_plane(plane)
    drawing.set_lens(camera, rectify=False)
    toner = ToneMapper(overlay.picture, overlay.palette)
    stills = []
    for stamp_ns, pixels in _pictures(reader, namespace, _chosen(given)):
        found = poses.at(setup.exposure_ns(stamp_ns))
        if found is None or pixels.shape[:2] != (camera.height, camera.width):
            continue
        image = toner.tone(pixels, stamp_ns)
        drawing.draw(image, *found, ())
        clicks = [one for one in given.observations if one.stamp_ns == stamp_ns]
        for one in clicks:
            at = round(one.u), round(one.v)
            cv2.drawMarker(image, at, _CLICK_BGR, cv2.MARKER_TILTED_CROSS, _CLICK_PX, 2)
        _, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
        names = ", ".join(one.id for one in clicks)
        caption = _CAPTION.format(names=names, time_s=stamp_ns * 1e-9, method=setup.method)
        stills.append((caption, jpeg.tobytes()))
    return stills


def _chosen(given: Experiment) -> set[int]:
    """Return stamps of pictures: from each part of the flight the one with most clicks."""
    clicks = Counter(one.stamp_ns for one in given.observations)
    parts = np.array_split(np.array(sorted(clicks), np.int64), min(_STILLS, len(clicks)))
    return {max(part.tolist(), key=clicks.__getitem__) for part in parts}


def _pictures(
    reader: BagReader, namespace: str, stamps_ns: set[int]
) -> Iterator[tuple[int, RawPixels]]:
    """Yield stamp and pixels of those pictures, as far as the bag has them."""
    names = {resolved(name, namespace): name for name in PICTURES}
    topics = [topic for topic in names if topic in reader.topics()]
    cdr = Cdr()
    for message in reader.messages(topics[:1]) if topics else ():
        with suppress(TirgeoError):  # errors are counted where the flight is read
            stamp_ns = header_stamp_ns(message.data)
            if stamp_ns in stamps_ns:
                decoded = cdr.deserialize(message.data, message.typename)
                yield stamp_ns, convert.pixels(names[message.topic], decoded)


#: Topics that define a method. Without them the filter would still run, on ordinary GPS.
_UNSMOOTHED = "raw and rtk are as they are: without a filter there is nothing to smooth"
_ESSENTIAL = {"ekf": ("rtk/fix",), "ekf_heading": ("rtk/fix", "rtk/heading")}


@dataclass(frozen=True)
class _Run:
    """Run one method over the flight."""

    setup: MethodSetup
    poses: FlightPoses
    series: MethodSeries

    @property
    def smoothed(self) -> bool:
        """Return whether the method has poses that can be smoothed."""
        return can_smooth(self.setup.configs.ekf.method)


class _Job(NamedTuple):
    """Hold what all methods share."""

    paths: tuple[str, str, str]  # of bag, survey and observations
    reader: BagReader
    namespace: str
    given: Experiment
    setups: Sequence[MethodSetup]
    layers: Sequence[MapLayer]
    flight: Flight
    checks: FlightChecks
    smooth: bool


def evaluate(
    bag: PathLike,
    survey: PathLike,
    observations: PathLike,
    *,
    output: PathLike | None = None,
    params: Files = None,
    boresight: PathLike | None = None,
    dem: PathLike | None = None,
    ground_height: float | None = None,
    namespace: str = "",
    projection: str = "gauss-krueger",
    truth: PathLike | None = None,
    map_path: PathLike | None = None,
    camera: PathLike | None = None,
    smooth: bool = False,
    progress: Report = silent,
) -> Evaluation:
    """Locate the observations of a bag under every method, in one pass through it.

    ``output`` is the folder that ``write_evaluation`` will write: it is checked first.
    ``boresight``, one more parameter file, adds the method ``calibrated``. ``dem`` or
    ``ground_height`` (ellipsoidal m), ``camera`` and ``map_path``, the map on the stills, override
    the parameters; without any ground it is level at the median of the observed points' heights.
    ``projection`` is ``gauss-krueger`` or ``utm``. A method whose topics the bag lacks is reported
    as missing. ``smooth``: poses of the filters from all measurements, also later ones. Raise
    BagError, CameraError, ConfigError, SurveyError, ElevationError, MapError, and CalibrationError
    if no method can be run.
    """
    files = [*paths_of(params), *paths_of(boresight)]
    if output is not None:
        configs = node_configs(files, namespace, dem=dem, camera=camera)
        read = (bag, survey, observations, truth, *files, *configs.files)
        check_folder(output, (*read, *map_files(os.fspath(map_path or ""))))
    given = load_experiment(survey, observations, projection)
    of_all = (namespace, given.heights_m, camera)
    setups = method_setups(params, boresight, dem, ground_height, *of_all)
    last = setups[-1]  # whose parameters are checked and whose map is drawn
    layers = _layers(last.configs.overlay, map_path)
    reader, lens = BagReader(bag), given_camera(last.configs.overlay)
    of_last = (last.configs, reader, files, namespace)
    checks = FlightChecks(*of_last, ground=last.ground, layers=layers or None, camera=lens)
    flight = Flight(reader, namespace, pictures=True, camera=lens, checks=checks)
    paths = (os.fspath(bag), os.fspath(survey), os.fspath(observations))
    job = _Job(paths, reader, namespace, given, setups, layers, flight, checks, smooth)
    true_poses = None if truth is None else load_truth(Path(truth))
    return _evaluation(job, *_flown(job, true_poses, progress))


def _flown(
    job: _Job, truth: TruePoses | None, progress: Report
) -> tuple[list[_Run], dict[str, str], dict[str, Track]]:
    """Read the flight; return the methods with poses, why others have none, and the receivers."""
    missing: dict[str, str] = {}
    begun = [_begun(one, job, truth, missing) for one in job.setups]
    missing = {name: why.removeprefix(f"{job.reader.path}: ") for name, why in missing.items()}
    runs = _left([run for run in begun if run is not None], missing, job.reader)
    runs[-1].poses.watchers.append(job.checks.watch)
    receivers: defaultdict[str, Track] = defaultdict(Track)

    def take(sample: Sample) -> None:
        if isinstance(sample, PositionSample):
            place = sample.latitude_rad, sample.longitude_rad
            receivers[sample.source.value].add(sample.stamp_ns, *place)

    job.flight.add(("rtk/fix", "gps/fix"), take)
    job.flight.read_all(progress)
    for run in runs:
        if run.poses.plane is None or not run.series.has_poses:
            reason = run.poses.registration.navigation.status().reason
            missing[run.setup.method] = f"no camera pose could be made: {reason}"
    return _left(runs, missing, job.reader), missing, receivers


def _evaluation(
    job: _Job, runs: list[_Run], missing: dict[str, str], receivers: dict[str, Track]
) -> Evaluation:
    """Return the results of the methods that were run."""
    given, camera, best = job.given, job.flight.camera, runs[-1]
    findings = job.checks.findings()
    methods = [_result(run, camera, given) for run in runs]
    drawn = (camera, best.poses, best.setup, job.layers, given)
    return Evaluation(
        *job.paths,
        given.projection,
        given.control,
        receivers,
        methods,
        missing,
        paired_tests({one.method: one.errors.point_rmse_m for one in methods}),
        overlay_stills(job.reader, job.namespace, *drawn),
        [
            *setup_notes(job.setups, given.heights_m),
            *(
                f"{run.setup.method}: {_names(absent, job.namespace)} absent: continuing without "
                "it"
                for run in runs
                if (absent := done_without(run.poses.topics, run.setup.configs.ekf.method))
            ),
            *(_UNSMOOTHED for run in runs[:1] if job.smooth and not run.smoothed),
            *(f"{method} is left out: {why}" for method, why in missing.items()),
            *input_notes(given, job.flight.picture_stamps_ns),
            *filter(None, [place_note(methods)]),
        ],
        _error(job.reader, methods) or stop_line(findings),
        findings,
        job.smooth,
    )


def _layers(overlay: OverlayConfig, map_path: PathLike | None) -> Sequence[MapLayer]:
    """Return the map that is drawn, if there is one."""
    text, style = os.fspath(map_path or overlay.map), (overlay.style, overlay.label_field)
    return load_layers(text, *style, network=overlay.network) if text else []


def _begun(
    setup: MethodSetup, job: _Job, truth: TruePoses | None, missing: dict[str, str]
) -> _Run | None:
    """Let a method take part; put it into ``missing`` if the bag lacks a topic of it."""
    flight, (ekf, gimbal, *_) = job.flight, setup.configs
    lacking = [topic for topic in _ESSENTIAL.get(ekf.method, ()) if not flight.has(topic)]
    if lacking:
        missing[setup.method] = f"needed topic absent: {_names(lacking, job.namespace)}"
        return None
    series = MethodSeries(truth)
    instants_ns = [setup.exposure_ns(one.stamp_ns) for one in job.given.observations]
    try:
        smooth = job.smooth and can_smooth(ekf.method)
        poses = flight.registered(ekf, gimbal, instants_ns, series.watch, smooth=smooth)
        return _Run(setup, poses, series)
    except BagError as error:
        missing[setup.method] = str(error)
        return None


def _names(topics: Sequence[str], namespace: str) -> str:
    return ", ".join(resolved(topic, namespace) for topic in topics)


def _left(runs: Sequence[_Run], missing: Mapping[str, str], reader: BagReader) -> list[_Run]:
    """Return the runs that are not missing. Raise CalibrationError with all reasons if none is."""
    left = [run for run in runs if run.setup.method not in missing]
    if left:
        return left
    by_reason: dict[str, list[str]] = {}
    for method, reason in missing.items():
        by_reason.setdefault(reason, []).append(method)
    text = "; ".join(f"{', '.join(names)}: {why}" for why, names in by_reason.items())
    raise CalibrationError(f"{reader.path}: no method can be run: {text}")


def _result(run: _Run, camera: Camera, given: Experiment) -> MethodResult:
    """Return a method's results."""
    plane, setup, registration = run.poses.plane, run.setup, run.poses.registration
    assert plane is not None
    located, refused = locate_observations(
        run.poses.cameras, plane, camera, given, setup.ground, setup.configs.overlay
    )
    status = registration.navigation.status()
    return MethodResult(
        setup,
        registration.composer.composition,
        status.state.value,
        located,
        refused,
        run.series.track,
        run.series.body_errors(),
    )


def _error(reader: BagReader, methods: Sequence[MethodResult]) -> str | None:
    """Return what makes the run a failure although there is a result, or None."""
    if reader.damage is not None:
        return f"{reader.path}: {reader.damage}; the numbers come from the rest"
    if not any(one.located for one in methods):
        reason = methods[-1].refused[0].reason
        return f"{reader.path}: no observation could be located: {reason}"
    return None
