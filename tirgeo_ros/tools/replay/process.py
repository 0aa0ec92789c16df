"""Process a recorded flight into its geo-registered flight: the work of ``tirgeo process``.

Messages go through the core objects of the nodes in the order of their log times, faster than real
time. The same input gives the same bytes.
"""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.map.map_layers import MapLayer
from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.core.types.errors import BagError, ConfigError
from tirgeo_ros.core.types.finding import Finding, stop_line
from tirgeo_ros.core.types.verdicts import QUIET, Outcome
from tirgeo_ros.io.bags.bag import BagReader, BagWriter
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs
from tirgeo_ros.io.maps import load_layers, map_files
from tirgeo_ros.io.parameters.parameter_file import Files, ParameterFile, paths_of
from tirgeo_ros.io.pictures.camera_file import given_camera
from tirgeo_ros.io.video.video_file import VideoFile
from tirgeo_ros.tools.presentation.progress import Report, silent, three
from tirgeo_ros.tools.presentation.results import finding_items, summary
from tirgeo_ros.tools.replay.flight import Flight, FlightPoses
from tirgeo_ros.tools.replay.flight_checks import FlightChecks, tried, tried_map
from tirgeo_ros.tools.replay.flight_topics import PICTURES, done_without, inputs_of, resolved
from tirgeo_ros.tools.replay.node_configs import NodeConfigs, node_configs
from tirgeo_ros.tools.replay.picture_stage import PictureStage, available_cores
from tirgeo_ros.tools.replay.process_outputs import OverlayFilm, ProcessOutputs

#: A larger refused share of one kind of measurement is not chance: gates are at 4 and 5 sigma.
_MOST_REFUSED = 0.01
_GOOD_STATES = ("running", "degraded")


class _Job(NamedTuple):
    """Hold what a run through a bag needs."""

    configs: NodeConfigs
    reader: BagReader
    namespace: str
    topics: dict[str, str]  # resolved name -> contract topic
    drawn: Overlay | None
    checks: FlightChecks
    notes: list[str]
    undulation_m: float  # of the geoid; nan if it is not known


def process(
    bag_in: PathLike,
    bag_out: PathLike,
    *,
    params: Files = None,
    map: PathLike | None = None,  # noqa: A002 the option's name
    method: str | None = None,
    dem: PathLike | None = None,
    ground_height: float | None = None,
    images: bool = True,
    raw_images: bool = False,
    video: PathLike | None = None,
    namespace: str = "",
    camera: PathLike | None = None,
    smooth: bool = False,
    progress: Report = silent,
    cores: int | None = None,
) -> dict[str, object]:
    """Process a bag and return a summary; a file gets its name only when it is complete.

    ``error`` in the summary is None, or what of the bag was lost, or a STOP of the checks.
    ``params`` are parameter files; ``map``, ``dem`` or ``ground_height`` (ellipsoidal m) and
    ``camera``, a calibration file, override them. ``images`` need the gimbal. They are drawn if
    there is a map, or ``raw_images`` or ``video`` are wanted, in another process unless ``cores``
    (None: those that this process may use) is 1: the bytes are the same. ``smooth``: each pose
    from all measurements, also later ones. Raise BagError (no bag, a needed topic absent, nothing
    readable), CameraError, ConfigError, MapError, ElevationError, PictureError, VideoError.
    """
    configs = node_configs(
        params, namespace, method=method, dem=dem, ground_height=ground_height, camera=camera
    )
    map_path = configs.overlay.map if map is None else os.fspath(map)
    wanted = raw_images or video is not None
    if wanted and not images:
        raise ConfigError("raw_images and video need images")
    draws = images and (wanted or bool(map_path))
    given = [bag_in, *paths_of(params), *configs.files, *map_files(map_path)]
    check_outputs(given, (bag_out, video), BagError)
    reader, cores = BagReader(bag_in), available_cores() if cores is None else cores
    with PictureStage(cores if draws else 1) as stage:
        job = _prepared(configs, reader, namespace, params, map_path, images=images, draws=draws)
        return {
            "input": os.fspath(bag_in),
            "output": os.fspath(bag_out),
            "smoothed": smooth,
            **_run(job, bag_out, video, progress, stage, raw_images=raw_images, smooth=smooth),
        }


def _prepared(
    configs: NodeConfigs,
    reader: BagReader,
    namespace: str,
    params: Files,
    map_path: str,
    *,
    images: bool,
    draws: bool,
) -> _Job:
    """Choose the topics, load the map on its ground, and set up the checks."""
    fitted, notes = configs.fitting(reader, namespace)
    ekf, gimbal, overlay, _ = fitted
    known = given_camera(overlay)
    needed = {"pictures": draws, "camera": known is None, "gimbal": images}
    topics = inputs_of(reader, ekf.method, gimbal.composition, namespace, **needed)
    found: list[Finding] = []
    layers: Sequence[MapLayer] | None
    if draws:
        style = (overlay.style, overlay.label_field)
        layers = load_layers(map_path, *style, network=overlay.network) if map_path else None
        ground = ground_of(overlay)
    else:
        layers = tried_map(found, overlay, map_path, used=False)
        ground = tried(found, "dem", lambda: ground_of(overlay), used=False)
    terrain = ground if isinstance(ground, Terrain) else None
    drawn = Overlay(overlay, layers or (), terrain) if draws else None
    if drawn is not None and known is not None:
        drawn.set_camera(known)
    notes += [
        *(terrain.notes if terrain else ()),
        *(n for one in layers or () for n in one.left_out),
    ]
    # Of what is drawn, the checks get the map as it is laid for the pictures.
    to_lay = None if draws else layers
    checks = FlightChecks(
        fitted, reader, params, namespace, ground=ground, layers=to_lay, camera=known
    )
    checks.at_start += found
    dji = ParameterFile(params).config("dji_node", DjiConfig, namespace)
    undulation_m = dji.geoid_undulation_m
    return _Job(fitted, reader, namespace, topics, drawn, checks, notes, undulation_m)


def _run(
    job: _Job,
    bag_out: PathLike,
    video: PathLike | None,
    progress: Report,
    stage: PictureStage,
    *,
    raw_images: bool,
    smooth: bool,
) -> dict[str, object]:
    """Process all messages and write the outputs; return the summary."""
    begun_s = time.perf_counter()
    if job.drawn is not None:
        keeps_images = raw_images or video is not None
        stage.begin(job.configs.overlay, job.drawn.painter.ground, keeps_images=keeps_images)
    with contextlib.ExitStack() as stack:
        film = _film(job, stack.enter_context(VideoFile(video))) if video is not None else None
        writer = stack.enter_context(BagWriter(bag_out))
        flight = Flight(job.reader, job.namespace, checks=job.checks, needs_camera=False)
        given = job.configs.ekf, job.configs.gimbal, job.topics.values()
        poses = flight.add_poses(FlightPoses(*given), smooth=smooth)
        chain = (job.configs, job.drawn, writer, film, job.namespace, job.checks, stage)
        outputs = ProcessOutputs(flight, poses, job.topics, *chain, raw_images=raw_images)
        poses.watchers += [job.checks.watch, outputs.watch]
        flight.read_all(progress, outputs)
        if not flight.read:
            because = f": {job.reader.damage}" if job.reader.damage else ""
            raise BagError(f"{job.reader.path}: no message could be read{because}")
        outputs.finish(flight.now_ns)
    findings = job.checks.findings()  # damage is in the error
    result = _summary(job, flight, poses, outputs, time.perf_counter() - begun_s)
    return {
        **result,
        "findings": finding_items(findings),
        "video": None
        if film is None
        else {"frames": film.video.frames, "rate_hz": film.video.rate_hz},
        "error": _error(job.reader, result) or stop_line(findings),
    }


def _film(job: _Job, video: VideoFile) -> OverlayFilm:
    """Return what writes the overlay's pictures to a video file."""
    assert job.drawn is not None  # a video is always drawn
    return OverlayFilm(video, job.drawn, job.configs.overlay, job.undulation_m)


def _summary(
    job: _Job, flight: Flight, poses: FlightPoses, outputs: ProcessOutputs, elapsed_s: float
) -> dict[str, object]:
    """Return what was read, computed and written."""
    names = job.topics.values()
    absent = [resolved(one, job.namespace) for one in done_without(names, job.configs.ekf.method)]
    without = f"{job.reader.path} has no {', '.join(absent)}: continuing without it"
    blind = not any(name.startswith("gimbal/") for name in names)
    lost = ["the bag has no gimbal topic: no camera poses"] if blind else []
    status, composer = poses.registration.navigation.status(), poses.registration.composer
    return {
        "warning": without if absent else None,
        "method": status.method,
        "composition": composer.composition,
        "duration_s": flight.duration_s,
        "elapsed_s": elapsed_s,
        "speed": flight.duration_s / elapsed_s,
        "read": dict(flight.read),
        "undecodable": dict(flight.undecoded),
        "unreadable": dict(flight.unreadable),
        "unreadable_because": dict(flight.unreadable_because),
        "stamped_at_arrival": flight.arrivals.counts,
        "written": dict(outputs.written),
        "state": status.state.value,
        "reason": status.reason,
        "states_s": dict(outputs.states_s),
        "verdicts": {f"{a} {b}": number for (a, b), number in status.counts.items()},
        "heading_sigma_deg": math.degrees(status.heading_sigma_rad),
        "gimbal": composer.counts,
        "overlay": job.drawn.counts if job.drawn is not None else {},
        "notes": [*job.notes, *lost, *(job.drawn.notes if job.drawn is not None else ())],
    }


def _error(reader: BagReader, result: Mapping[str, Any]) -> str | None:
    """Return what of the bag was lost, or None."""
    if reader.damage is not None:
        return f"{reader.path}: {reader.damage}; the output is made from the rest"
    if not any(name.endswith("tirgeo/odometry") for name in result["written"]):
        return f"{reader.path}: no pose could be made: {result['reason'] or 'see verdicts'}"
    return None


#: Name, text, whether it reports a problem.
Line = tuple[str, str, bool]


def six_lines(result: Mapping[str, Any]) -> str:
    """Return six lines, those that report a problem first: read, state, poses and so on."""
    makers = (_read_line, _state_line, _poses_line, _frames_line, refused_line, _output_line)
    return summary(make(result) for make in makers)


def _read_line(result: Mapping[str, Any]) -> Line:
    duration, elapsed, speed = (three(result[one]) for one in ("duration_s", "elapsed_s", "speed"))
    number = sum(result["read"].values())
    text = (
        f"{duration} s of {result['input']} in {elapsed} s, {speed}x real time; {number} messages"
    )
    return "read", text, False


def _state_line(result: Mapping[str, Any]) -> Line:
    """Return the final state with its reason, and the seconds in each state from diagnostics."""
    times = Counter(result["states_s"]).most_common()
    said = ", ".join(f"{state} {seconds} s" for state, seconds in times)
    reason = f" ({result['reason']})" if result["reason"] else ""
    method = f"{result['method']}{', smoothed' if result['smoothed'] else ''}"
    text = f"{result['state']} at the end{reason}, by {method}; in all {said}"
    return "state", text, result["state"] not in _GOOD_STATES


def _poses_line(result: Mapping[str, Any]) -> Line:
    body, camera = (
        sum(n for topic, n in result["written"].items() if topic.endswith(f"tirgeo/{name}"))
        for name in ("odometry", "camera_pose")
    )
    sigma_deg = result["heading_sigma_deg"]
    heading = f", heading to {three(sigma_deg)} deg" if math.isfinite(sigma_deg) else ""
    is_wrong = not body or (bool(result["overlay"]) and not camera)
    return "poses", f"{body} of the body, {camera} of the camera{heading}", is_wrong


def _frames_line(result: Mapping[str, Any]) -> Line:
    """Return how many frames have a trusted pose, and how many show a notice instead."""
    counts = result["overlay"]
    if not counts:
        return "frames", "not drawn: give --map or --video, and no --no-images", False
    drawn, notices = counts["drawn"], counts["notices"]
    read = sum(n for topic, n in result["read"].items() if topic.endswith(PICTURES))
    lost = f", {read - drawn - notices} lost" if read > drawn + notices else ""
    text = f"{drawn} of {read} with a trusted pose, {notices} with a notice why not{lost}"
    return "frames", text, drawn < notices or bool(lost)


def refused_line(result: Mapping[str, Any]) -> Line:
    """Return refused measurements by source and outcome, and messages by topic with a reason."""
    taken: Counter[str] = Counter()
    refused: dict[str, list[tuple[str, int]]] = {}
    for name, number in result["verdicts"].items():
        source, outcome = name.split(" ")
        taken[source] += number
        if Outcome(outcome) not in QUIET:
            refused.setdefault(source, []).append((outcome, number))
    parts = [
        f"{source} {number} of {taken[source]} {outcome.replace('_', ' ')}"
        for source, found in refused.items()
        for outcome, number in found
    ]
    unreadable = Counter(result["undecodable"]) + Counter(result["unreadable"])
    because = result["unreadable_because"]
    parts += [
        f"{topic} {number} unreadable{f' ({because[topic]})' if topic in because else ''}"
        for topic, number in unreadable.items()
    ]
    many = any(
        sum(n for _, n in found) > _MOST_REFUSED * taken[source]
        for source, found in refused.items()
    )
    return "refused", "; ".join(parts) or "nothing", many or bool(unreadable)


def _output_line(result: Mapping[str, Any]) -> Line:
    size = f"{three(Path(result['output']).stat().st_size / 1e6)} MB"
    film = result["video"]
    video = f", and a video of {film['frames']} frames at {film['rate_hz']:.3g} Hz" if film else ""
    notes = result["notes"]
    more = f" (and {len(notes) - 1} more, with -v)" if len(notes) > 1 else ""
    noted = f"; {notes[0]}{more}" if notes else ""
    return "output", f"{result['output']}, {size}{video}{noted}", False
