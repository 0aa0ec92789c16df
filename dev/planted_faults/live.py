"""Plants faults in a flight, plays it through the node graph, and tells who named them when."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dev.planted_faults.faults import Fault, FlightFiles, ShownFrom
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CHI2_95, CameraRates
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import Miss, PoseBuffer
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.ground.frame_geometry import camera_heading_rad
from tirgeo_ros.core.ground.ground_point import Located, place
from tirgeo_ros.core.streams.stamps import exposure_ns
from tirgeo_ros.core.types.errors import BagError, TirgeoError
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.bags.cdr import header_stamp_ns
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.parameters.parameter_file import Value, write_parameters
from tirgeo_ros.tools.graph.node_graph import GraphRun, GraphSetup, free_domain, run_graph
from tirgeo_ros.tools.presentation.progress import Report as Progress
from tirgeo_ros.tools.replay.graph_outputs import read_outputs
from tirgeo_ros.tools.replay.node_configs import node_configs

_WHOLE_FLIGHT_S = 1e9
_RATES_NS = 100_000_000
#: Of the picture's width and height: the middle, and a quarter from the edges.
_PLACES = ((0.5, 0.5), (0.25, 0.5), (0.75, 0.5), (0.5, 0.75))


@dataclass
class Eye:
    """What locates pixels: poses of a bag, a lens, a latency and a ground."""

    poses: PoseBuffer[CameraPose]
    plane: TangentPlane
    camera: Camera
    ground: Ground
    config: OverlayConfig

    def locate(self, stamp_ns: int, uv: tuple[float, float]) -> Located | None:
        """Return the place at a pixel of a picture; None where there is none."""
        exposed_ns = exposure_ns(stamp_ns, self.config.video_latency_s)
        pose, before = self.poses.at(exposed_ns), self.poses.at(exposed_ns - _RATES_NS)
        if isinstance(pose, Miss):
            return None
        rates = None if isinstance(before, Miss) else CameraRates.between(before, pose)
        located = place(
            self.camera, pose, uv, self.plane, self.ground, self.config.confidence, rates
        )
        return located if isinstance(located, Located) else None


def times_of_ellipse(
    assumed: Eye,
    true: Eye,
    stamp_ns: int,
    true_ns: int | None = None,
    flipped: Sequence[int] = (),
) -> float:
    """Return the largest error of a picture's pixels over its ellipse; nan: none is located.

    1 is on the ellipse of 95 %. A pixel that the truth has nowhere counts as infinitely wrong.
    ``true_ns``: the picture's stamp in the good flight; ``flipped``: its axes, 0 down, 1 across.
    """
    true_ns = stamp_ns if true_ns is None else true_ns
    size = true.camera.width - 1, true.camera.height - 1
    worst = math.nan
    for across, down in _PLACES:
        uv = across * size[0], down * size[1]
        located = assumed.locate(stamp_ns, uv)
        if located is None:
            continue
        was = (
            size[0] - uv[0] if 1 in flipped else uv[0],
            size[1] - uv[1] if 0 in flipped else uv[1],
        )
        actual = true.locate(true_ns, was)
        times = math.inf
        if actual is not None:
            place = actual.latitude_rad, actual.longitude_rad, actual.height_m
            off = (located.point_n - assumed.plane.ned_from_geodetic(*place))[:2]
            squared = float(off @ np.linalg.solve(located.covariance_n[:2, :2], off))
            times = math.sqrt(squared / CHI2_95)
        worst = times if math.isnan(worst) else max(worst, times)
    return worst


def eyes_of(good: FlightFiles, planted: FlightFiles, poses: Path) -> tuple[Eye, Eye] | None:
    """Return how poses of a planted flight locate pixels, and how they lie in truth; or None."""
    assumed, true = _eye(planted, poses), _eye(good, good.bag.with_name("truth.mcap"))
    return (assumed, true) if assumed and true else None


def _eye(flight: FlightFiles, poses_bag: Path) -> Eye | None:
    """Return the eye of a bag with camera poses; None without poses, a lens or a ground."""
    overlay = node_configs(flight.params, dem=flight.options.get("dem")).overlay
    info, outputs = "/thermal/camera_info", read_outputs(poses_bag)
    item = next(iter(BagReader(flight.bag).messages([info])), None)
    ground = ground_of(overlay)
    if item is None or ground is None or outputs.plane is None or not outputs.cameras:
        return None
    camera = convert.camera(Cdr().deserialize(item.data, item.typename))
    poses: PoseBuffer[CameraPose] = PoseBuffer(_WHOLE_FLIGHT_S)
    for pose in outputs.cameras:
        poses.add(pose)
    return Eye(poses, outputs.plane, camera, ground, overlay)


def flight_times(
    good: FlightFiles, planted: FlightFiles, poses: Path, flipped: Sequence[int]
) -> list[float]:
    """Return the times of the ellipse of all pictures that are located."""
    eyes = eyes_of(good, planted, poses)
    if eyes is None:
        return []
    stamps = zip(_picture_stamps_ns(planted.bag), _picture_stamps_ns(good.bag), strict=True)
    times = [times_of_ellipse(*eyes, *both_ns, flipped) for both_ns in stamps]
    return [size for size in times if not math.isnan(size)]


def _picture_stamps_ns(bag: Path) -> list[int]:
    items = BagReader(bag).messages(["/thermal/image_raw/compressed"])
    return [header_stamp_ns(item.data) for item in items]


@dataclass(frozen=True)
class Report:
    """A finding that a node reported, worse than a note."""

    at_s: float  # of the recording's clock
    node: str
    finding: Finding

    def names(self, parameters: Iterable[str]) -> bool:
        """Return whether one of these is in the parameter that it names."""
        return any(name in self.finding.parameter for name in parameters)


def read_reports(recording: Path, begin_ns: int) -> list[Report]:
    """Return what the nodes' checks found, in order; seconds count from ``begin_ns``."""
    cdr = Cdr()
    reports: list[Report] = []
    for item in BagReader(recording).messages(["/tirgeo/findings"]):
        node, stamp_ns, findings = convert.findings_of(cdr.deserialize(item.data, item.typename))
        at_s = (stamp_ns - begin_ns) * 1e-9
        worse = [each for each in findings if each.severity is not Severity.NOTE]
        reports += [Report(at_s, node.strip("/"), each) for each in worse]
    return reports


#: A fault is named so soon after the data can show it.
WITHIN_S = 10.0
#: A picture's pixels lie no farther from the truth, in units of their ellipses, where nothing is
#: reported.
MOST_TIMES = 3.0
_TURN_RAD = math.radians(40.0)
_HEAD = ("fault", "shown", "named", "by", "silent", "error", "")
#: What no fault is planted in: nothing may be said of it.
CLEAN = Fault("(none)", (), lambda good, _: good)


@dataclass(frozen=True)
class Outcome:
    """What came of a fault on the graph; seconds count from the first sample of the IMU."""

    fault: Fault
    shown_s: float = math.nan  # from when on the data can show it; nan: never
    named: Report | None = None  # the first finding with its parameter
    others: tuple[str, ...] = ()  # what else was found, by check
    silent: int = 0  # pictures WITHIN_S after it is shown, with nothing reported
    times: float = math.nan  # the largest error of these over their ellipses
    refused: str = ""  # a node's last words, where the graph did not run

    @property
    def in_time(self) -> bool:
        """Whether it was named so soon as it must."""
        if self.refused:
            return any(name in self.refused for name in self.fault.names)
        return self.named is not None and self.named.at_s - self.shown_s <= WITHIN_S

    @property
    def is_quiet(self) -> bool:
        """Whether nothing was said at all."""
        return not (self.named or self.others or self.refused)

    @property
    def is_good(self) -> bool:
        """Whether all is as it must be; nothing is said where no fault is."""
        return not self.lies and (self.in_time if self.fault.names else self.is_quiet)

    @property
    def lies(self) -> bool:
        """Whether a picture was silent and wrong by more than its ellipse can be."""
        return self.times > MOST_TIMES


class Live:
    """Plays flights through graphs, each in a DDS domain of its own."""

    def __init__(self, good: FlightFiles, folder: Path) -> None:
        self._good, self._folder = good, folder
        first_ns, last_ns = BagReader(good.bag).span_ns
        self.duration_s = (last_ns - first_ns) * 1e-9
        self._domains: set[int] = set()
        self._lock = threading.Lock()

    def outcome(self, fault: Fault, progress: Progress) -> Outcome:
        """Return what comes of a fault; what a run leaves is in a folder of its name."""
        folder = self._folder / fault.name.replace(" ", "_").replace("/", "_")
        (folder / "planted").mkdir(parents=True)
        planted = fault.plant(self._good, folder / "planted")
        setup = self._setup(planted, folder)
        try:
            run = run_graph(setup, self.duration_s, progress)
        except TirgeoError as error:
            return Outcome(fault, refused=str(error))
        return _judged(fault, self._good, planted, run)

    def _setup(self, planted: FlightFiles, folder: Path) -> GraphSetup:
        params = list(planted.params)
        if planted.options:
            params.append(folder / "planted" / "options.yaml")
            named: dict[str, Value] = {"ground_height_m": math.nan}
            named |= {name: str(value) for name, value in planted.options.items()}
            write_parameters(params[-1], {"overlay_node": named}, "planted")
        with self._lock:
            domain = free_domain(self._domains)
            self._domains.add(domain)
        return GraphSetup(
            planted.bag.absolute(),
            folder.absolute(),
            map=planted.map.absolute() if planted.map else None,
            more_params=[path.absolute() for path in params],
            environment={"ROS_DOMAIN_ID": str(domain)},
        )


def outcomes(live: Live, faults: Sequence[Fault], jobs: int, progress: Progress) -> list[Outcome]:
    """Return the outcomes of faults, ``jobs`` graphs at a time; ``progress`` in s of flight."""
    done_s = dict.fromkeys((fault.name for fault in faults), 0.0)

    def play(fault: Fault) -> Outcome:
        def tell(done: float, _: float | None) -> None:
            done_s[fault.name] = min(done, live.duration_s)
            progress(sum(done_s.values()), live.duration_s * len(faults))

        outcome = live.outcome(fault, tell)
        tell(live.duration_s, None)
        return outcome

    with ThreadPoolExecutor(jobs) as pool:
        return list(pool.map(play, faults))


def _judged(fault: Fault, good: FlightFiles, planted: FlightFiles, run: GraphRun) -> Outcome:
    begin_ns = _first_imu_ns(good.bag)
    reports = read_reports(run.recording, begin_ns)
    named = next((report for report in reports if report.names(fault.names)), None)
    others = {report.finding.check for report in reports if not report.names(fault.names)}
    cameras = read_outputs(run.recording).cameras
    first_pose_s = (cameras[0].stamp_ns - begin_ns) * 1e-9 if cameras else math.nan
    shown_s = _shown_s(fault.shown, first_pose_s, good.bag.with_name("truth.mcap"), begin_ns)
    from_ns = begin_ns + round((WITHIN_S + (0.0 if math.isnan(shown_s) else shown_s)) * 1e9)
    reported_s = min((report.at_s for report in reports), default=math.inf)
    silent_ns = [
        stamp_ns
        for stamp_ns in _picture_stamps_ns(planted.bag)
        if from_ns <= stamp_ns and (stamp_ns - begin_ns) * 1e-9 < reported_s
    ]
    eyes = eyes_of(good, planted, run.recording)
    times = [times_of_ellipse(*eyes, stamp_ns) for stamp_ns in silent_ns] if eyes else []
    worst = max((size for size in times if not math.isnan(size)), default=math.nan)
    return Outcome(fault, shown_s, named, tuple(sorted(others)), len(silent_ns), worst)


def _first_imu_ns(bag: Path) -> int:
    """Return the stamp of the first sample of the IMU."""
    item = next(iter(BagReader(bag).messages(["/imu/data"])), None)
    if item is None:
        raise BagError(f"{bag}: no imu/data")
    return convert.stamp_ns(Cdr().deserialize(item.data, item.typename))


def _shown_s(shown: ShownFrom, first_pose_s: float, truth: Path, begin_ns: int) -> float:
    if shown is ShownFrom.AT_ONCE:
        return 0.0
    if shown is ShownFrom.MOVING_PICTURES:
        return first_pose_s
    cameras = read_outputs(truth).cameras
    headings = np.unwrap([camera_heading_rad(pose) for pose in cameras])
    turned = np.abs(np.diff(headings)).cumsum()
    enough = np.flatnonzero(turned > _TURN_RAD)
    return (cameras[enough[0] + 1].stamp_ns - begin_ns) * 1e-9 if enough.size else math.nan


def live_table(results: Sequence[Outcome]) -> str:
    """Return a row of Markdown for each outcome, and two lines that sum them up."""
    rows = [_HEAD, ("---",) * len(_HEAD), *map(_row, results)]
    faulty = [outcome for outcome in results if outcome.fault.names]
    named = sum(outcome.in_time for outcome in faulty)
    lying = ", ".join(outcome.fault.name for outcome in faulty if outcome.lies)
    lines = [
        *(f"| {' | '.join(row)} |" for row in rows),
        "",
        f"{named} of {len(faulty)} named within {WITHIN_S:g} s of when the data show them",
        f"silent later than that, and beyond {MOST_TIMES:g} ellipses: {lying or 'none'}",
    ]
    return "\n".join(lines) + "\n"


def _row(outcome: Outcome) -> Iterable[str]:
    named, words = outcome.named, outcome.refused
    when = "" if outcome.is_quiet and not outcome.fault.names else "NO"
    if outcome.refused and outcome.in_time:
        when = "yes"
    if named is not None:
        when, words = f"{named.at_s:.1f} s", named.finding.line
    if outcome.others:
        words += f" (also {', '.join(outcome.others)})"
    return (
        outcome.fault.name,
        "" if math.isnan(outcome.shown_s) else f"{outcome.shown_s:.1f} s",
        when,
        named.node if named else "",
        str(outcome.silent),
        "" if math.isnan(outcome.times) else f"{outcome.times:.1f}",
        words,
    )
