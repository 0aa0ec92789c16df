"""Filter a flight given as tables: the work of ``tirgeo process`` without a bag."""

from __future__ import annotations

import warnings
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from tirgeo_ros.core.checks.imu_checks import imu_findings
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.navigation.smoothing.smoothed_run import SmoothedRun
from tirgeo_ros.core.streams.arrivals import Arrivals
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.core.types.verdicts import Outcome
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.library.filtered_flight import FilteredFlight, Solutions
from tirgeo_ros.library.parameters import Config, load_config
from tirgeo_ros.library.samples import arrived
from tirgeo_ros.library.tables import Table, is_frame
from tirgeo_ros.tools.replay.flight_poses import WHOLE_FLIGHT_S
from tirgeo_ros.tools.replay.flight_topics import GIMBAL_TOPICS, METHOD_TOPICS
from tirgeo_ros.tools.replay.node_configs import NodeConfigs
from tirgeo_ros.tools.replay.process_summary import QUIET
from tirgeo_ros.tools.replay.registration import Registration, Sample
from tirgeo_ros.tools.replay.smoothed_flight import FilterRecording, FlightFilter

#: Topic -> the argument of its table, in the order of the arguments.
_ARGUMENTS = {
    "imu/data": "imu",
    "rtk/fix": "rtk_fix",
    "rtk/vel": "rtk_velocity",
    "rtk/heading": "heading",
    "gps/fix": "gps_fix",
    "gps/vel": "gps_velocity",
    "baro/pressure": "pressure",
    "ekf_node/set_heading": "set_heading",
    "gimbal/joint_states": "joints",
    "gimbal/attitude": "camera_attitude",
}


def filter_flight(
    imu: Table,
    *,
    rtk_fix: Table | None = None,
    rtk_velocity: Table | None = None,
    heading: Table | None = None,
    gps_fix: Table | None = None,
    gps_velocity: Table | None = None,
    pressure: Table | None = None,
    set_heading: Table | None = None,
    joints: Table | None = None,
    camera_attitude: Table | None = None,
    smooth: bool = False,
    config: Config = None,
) -> FilteredFlight:
    """Filter a flight: estimate the aircraft's poses, and with the gimbal's angles the camera's.

    Each table is a dict of arrays, a structured array or a data frame, with ``stamp_ns`` and the
    columns of its sensor: ``docs/library.md`` lists them with units and axes. Without the columns
    ``arrival_ns`` and ``arrival_order`` of ``read_bag`` each sample counts as arrived at its
    stamp. ``heading`` is that of two antennas, ``set_heading`` one that a person sets. ``joints``
    or ``camera_attitude``, of the gimbal, are needed for the camera's poses alone. ``config`` is
    as for ``load_config``; unless it gives a method, this is ``ekf_heading``, or ``ekf`` without
    ``heading``.

    With ``smooth`` each pose is made of the whole flight, of what was measured later too; only a
    method with a filter can be smoothed. The numbers are those of ``tirgeo process``, with or
    without ``--smooth``. A flight without a single solution gives an empty result, with a warning
    that says why. Raises TableError naming a column that is missing or wrong, and ConfigError.
    """
    given = (imu, rtk_fix, rtk_velocity, heading, gps_fix, gps_velocity, pressure, set_heading)
    gimbal = (joints, camera_attitude)
    pairs = zip(_ARGUMENTS, (*given, *gimbal), strict=True)
    tables = {topic: table for topic, table in pairs if table is not None}
    configs, _ = load_config(config).fitting(_Given(tables), "")
    runs = _smoothed(_stream(tables, configs), configs) if smooth else None
    registration = Registration(configs.ekf, configs.gimbal, smoothed=runs)
    made = type(imu) if is_frame(imu) else dict
    flight = _filtered(_stream(tables, configs), registration, configs, made)
    if not len(flight):
        warnings.warn(f"filter_flight: no solution: {_why(flight, tables, configs)}", stacklevel=2)
    return flight


class _Given:
    """Say which topics are given, as a bag's reader does."""

    def __init__(self, topics: Iterable[str]) -> None:
        self._topics = tuple(topics)

    def topics(self) -> dict[str, str]:
        """Return the given topics, resolved, with their types."""
        return {f"/{topic}": TOPIC_TYPES[topic] for topic in self._topics}


def _stream(tables: Mapping[str, Table], configs: NodeConfigs) -> Iterator[Sample]:
    """Yield the samples that method and composition use, in the order of their arrival."""
    wanted = {*METHOD_TOPICS[configs.ekf.method], *GIMBAL_TOPICS[configs.gimbal.composition]}
    arrivals = Arrivals()
    for topic, arrival_ns, sample in arrived(tables, _ARGUMENTS):
        if topic in wanted:
            yield arrivals.stamped(topic, sample, arrival_ns)


def _smoothed(stream: Iterable[Sample], configs: NodeConfigs) -> list[SmoothedRun]:
    """Run the filter over samples, then backwards. Raises ConfigError for a method without one."""
    recording = FilterRecording(FlightFilter(configs.ekf))
    for sample in stream:
        recording.take(sample)
    return recording.smoothed()


def _filtered(
    stream: Iterable[Sample],
    registration: Registration,
    configs: NodeConfigs,
    made: Callable[[dict[str, Any]], Any],
) -> FilteredFlight:
    """Run filter and gimbal over samples as ``tirgeo process`` does."""
    found, cameras = Solutions(), PoseBuffer[CameraPose](WHOLE_FLIGHT_S)
    for sample in stream:
        one = registration.take(sample)
        if one.solution is not None and one.body is not None:
            found.add(one.solution, one.body)
        for pose in one.cameras:
            cameras.add(pose)
    status = registration.navigation.status()
    return found.flight(
        made,
        method=status.method,
        state=status.state.value,
        reason=status.reason,
        verdicts=_by_source(status.counts),
        warnings=status.warnings,
        plane=registration.navigation.plane,
        video_latency_s=configs.overlay.video_latency_s,
        _cameras=cameras,
    )


def _why(flight: FilteredFlight, tables: Mapping[str, Table], configs: NodeConfigs) -> str:
    """Return what is not given, else what gravity says of the IMU, else what the filter says."""
    if not {"rtk/fix", "gps/fix"} & tables.keys():
        return "there is no position: give rtk_fix or gps_fix"
    own = {topic: table for topic, table in tables.items() if topic == "imu/data"}
    rotation_bi = configs.ekf.aircraft.rotation_bi
    for finding in imu_findings((one.sample for one in arrived(own, _ARGUMENTS)), rotation_bi):
        return finding.line
    bad = [
        f"{number} {source} {outcome}"
        for source, counts in flight.verdicts.items()
        for outcome, number in counts.items()
        if Outcome(outcome) not in QUIET
    ]
    refused = f" (refused: {', '.join(bad)})" if bad else ""
    return f"{flight.reason or flight.state}{refused}"


def _by_source(counts: Mapping[tuple[str, str], int]) -> dict[str, dict[str, int]]:
    """Return source -> outcome -> number."""
    found: defaultdict[str, dict[str, int]] = defaultdict(dict)
    for (source, outcome), number in counts.items():
        found[source][outcome] = number
    return dict(found)
