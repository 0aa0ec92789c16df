"""Define the tables that the library takes and gives, a form for each topic; read samples of them.

The axes are named in words: forward, right, down of the body; north, east, down at the place. The
units end the names. An angle may be given in degrees, a variance as the standard deviation.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import TableError, nearest
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    FixStatus,
    HeadingSample,
    ImuSample,
    JointSample,
    PositionSample,
    PressureSample,
    SetHeading,
    Source,
    VelocitySample,
)
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.messages import SensedSample
from tirgeo_ros.library.tables import Column, Numbers, Table, numbers_of

_BODY, _NED = ("forward", "right", "down"), ("north", "east", "down")
_PAIRS = (("north", "east"), ("north", "down"), ("east", "down"))
_PLACES = ((0, 1), (0, 2), (1, 2))  # of these pairs in a covariance


class Form(NamedTuple):
    """Hold the columns of a topic's table, and the conversions of a row to a sample and back."""

    columns: tuple[Column, ...]
    sample: Callable[[int, Sequence[float]], SensedSample]
    values: Callable[[Any], Sequence[float]]


def _angle(name: str, meaning: str, largest: float = math.tau) -> Column:
    return Column(f"{name}_rad", f"{meaning}, rad", None, {f"{name}_deg": np.radians}, largest)


def _rate(axis: str) -> Column:
    name, degrees = f"rate_{axis}_rad_s", f"rate_{axis}_deg_s"
    return Column(name, f"angular rate about {axis}, rad/s", None, {degrees: np.radians})


def _quaternion(name: str, meaning: str, default: float | None = None) -> tuple[Column, ...]:
    return tuple(Column(f"{name}_q{part}", meaning, default) for part in "wxyz")


def _variance(name: str, unit: str, squared: str, meaning: str) -> Column:
    """Return a variance's column, in whose place its root may stand; of angles also in degrees."""
    others: dict[str, Callable[[Any], Any]] = {f"sigma{name}_{unit}": np.square}
    if unit == "rad":
        others[f"sigma{name}_deg"] = lambda degrees: np.square(np.radians(degrees))
    return Column(f"variance{name}_{squared}", f"{meaning}, 0 = unknown", None, others)


def _covariance(unit: str, squared: str, what: str) -> tuple[Column, ...]:
    diagonal = [_variance(f"_{axis}", unit, squared, f"{what}'s variance {axis}") for axis in _NED]
    across = [
        Column(f"covariance_{a}_{b}_{squared}", f"covariance of {a} and {b}", 0.0)
        for a, b in _PAIRS
    ]
    return (*diagonal, *across)


def _matrix(row: Sequence[float]) -> Array:
    """Return the covariance (3, 3) of three variances and three covariances."""
    matrix = np.diag(np.array(row[:3]))
    for (i, j), value in zip(_PLACES, row[3:], strict=True):
        matrix[i, j] = matrix[j, i] = value
    return matrix


def _entries(matrix: Array) -> list[float]:
    return [*matrix.diagonal().tolist(), *(float(matrix[place]) for place in _PLACES)]


def _imu(stamp_ns: int, row: Sequence[float]) -> ImuSample:
    attitude = None if math.isnan(row[6]) else np.array(row[6:])
    return ImuSample(stamp_ns, np.array(row[:3]), np.array(row[3:6]), attitude)


def _imu_row(sample: ImuSample) -> list[float]:
    attitude = sample.autopilot_q_nb
    return [
        *sample.specific_force_b.tolist(),
        *sample.angular_rate_b.tolist(),
        *([math.nan] * 4 if attitude is None else attitude.tolist()),
    ]


def _position(source: Source, stamp_ns: int, row: Sequence[float]) -> PositionSample:
    known = row[0] in {status.value for status in FixStatus}
    status = FixStatus(int(row[0])) if known else FixStatus.NONE
    latitude_rad, longitude_rad, height_m = row[1:4]
    covariance_n = _matrix(row[4:])
    return PositionSample(
        stamp_ns, source, status, latitude_rad, longitude_rad, height_m, covariance_n
    )


def _position_row(sample: PositionSample) -> list[float]:
    place = sample.latitude_rad, sample.longitude_rad, sample.height_m
    return [float(sample.status), *place, *_entries(sample.covariance_n)]


def _velocity(source: Source, stamp_ns: int, row: Sequence[float]) -> VelocitySample:
    return VelocitySample(stamp_ns, source, np.array(row[:3]), _matrix(row[3:]))


def _velocity_row(sample: VelocitySample) -> list[float]:
    return [*sample.velocity_n.tolist(), *_entries(sample.covariance_n)]


_FIX = (
    Column("status", "2 RTK fixed, 1 float or differential, 0 single, -1 none"),
    _angle("latitude", "geodetic latitude of the antenna", math.pi / 2),
    _angle("longitude", "longitude of the antenna"),
    Column("height_m", "height of the antenna above the ellipsoid, m"),
    *_covariance("m", "m2", "the position"),
)
_SPEED = (
    *(Column(f"velocity_{a}_m_s", f"velocity {a} of the antenna, m/s") for a in _NED),
    *_covariance("m_s", "m2_s2", "the velocity"),
)
_HEADING = (
    _angle("heading", "heading, 0 = true north, clockwise"),
    _variance("", "rad", "rad2", "the heading's variance"),
)


def _heading_row(sample: HeadingSample | SetHeading) -> list[float]:
    return [sample.heading_rad, sample.variance_rad2]


#: Topic of a sensor -> the form of its table.
SENSORS: Mapping[str, Form] = {
    "imu/data": Form(
        (
            *(Column(f"force_{a}_m_s2", f"specific force {a}, m/s2") for a in _BODY),
            *(_rate(a) for a in _BODY),
            *_quaternion("autopilot", "the autopilot's q_nb, FRD to NED; nan = absent", math.nan),
        ),
        _imu,
        _imu_row,
    ),
    "rtk/fix": Form(_FIX, partial(_position, Source.RTK_POSITION), _position_row),
    "rtk/vel": Form(_SPEED, partial(_velocity, Source.RTK_VELOCITY), _velocity_row),
    "rtk/heading": Form(
        _HEADING, lambda stamp_ns, row: HeadingSample(stamp_ns, *row), _heading_row
    ),
    "gps/fix": Form(_FIX, partial(_position, Source.GPS_POSITION), _position_row),
    "gps/vel": Form(_SPEED, partial(_velocity, Source.GPS_VELOCITY), _velocity_row),
    "baro/pressure": Form(
        (
            Column("pressure_pa", "air pressure, Pa"),
            _variance("", "pa", "pa2", "the pressure's variance"),
        ),
        lambda stamp_ns, row: PressureSample(stamp_ns, *row),
        lambda sample: [sample.pressure_pa, sample.variance_pa2],
    ),
    "ekf_node/set_heading": Form(
        _HEADING, lambda stamp_ns, row: SetHeading(stamp_ns, *row), _heading_row
    ),
    "gimbal/joint_states": Form(
        (
            _angle("yaw", "gimbal yaw, clockwise from above"),
            _angle("roll", "gimbal roll, right side down"),
            _angle("pitch", "gimbal pitch, camera up"),
            Column("computed", "1: of reported attitudes, not of encoders", 0.0),
        ),
        lambda stamp_ns, row: JointSample(stamp_ns, row[0], row[1], row[2], computed=bool(row[3])),
        lambda one: [one.yaw_rad, one.roll_rad, one.pitch_rad, float(one.computed)],
    ),
    "gimbal/attitude": Form(
        _quaternion("camera", "the camera body's q_ng, FRD to NED"),
        lambda stamp_ns, row: CameraAttitudeSample(stamp_ns, np.array(row)),
        lambda sample: sample.q_ng.tolist(),
    ),
}

_STATES = ("north_m", "east_m", "down_m", "phi_north_rad", "phi_east_rad", "phi_down_rad")
_UPPER = np.triu_indices(6)


class Output(NamedTuple):
    """Hold the columns of an output's table, and the conversion of its messages to rows."""

    columns: tuple[str, ...]
    values: Callable[[Any], tuple[int, Sequence[float]]]


def _pose_columns(frame: str) -> tuple[str, ...]:
    pairs = itertools.combinations_with_replacement(_STATES, 2)
    quaternion = [f"{frame}_q{part}" for part in "wxyz"]
    return (*_STATES[:3], *quaternion, *(f"covariance_{a}_{b}" for a, b in pairs))


def _body_row(message: Any) -> tuple[int, list[float]]:
    pose = convert.body_pose(message)
    return pose.stamp_ns, [*pose.position_n, *pose.q_nb, *pose.covariance[_UPPER]]


def _camera_row(message: Any) -> tuple[int, list[float]]:
    pose = convert.camera_pose(message)
    return pose.stamp_ns, [*pose.position_n, *pose.q_nc, *pose.covariance[_UPPER]]


#: Topic of an output -> the form of its table. The poses are in the plane of ``map``, NED.
OUTPUTS: Mapping[str, Output] = {
    "tirgeo/odometry": Output(_pose_columns("body"), _body_row),
    "tirgeo/camera_pose": Output(_pose_columns("camera"), _camera_row),
}


class Arrived(NamedTuple):
    """Hold a sample, its topic and the time at which it arrived, ns."""

    topic: str
    arrival_ns: int
    sample: SensedSample


def form_of(topic: str) -> Form:
    """Return the form of a topic's table. Raises TableError for a topic that is no sensor's."""
    if topic not in SENSORS:
        raise TableError(f"{topic}: no topic of a sensor{nearest(topic, SENSORS)}")
    return SENSORS[topic]


def arrived(
    tables: Mapping[str, Table], names: Mapping[str, str] | None = None
) -> Iterator[Arrived]:
    """Yield the samples of tables (by topic) in the order of arrival.

    That is by ``arrival_ns``, then ``arrival_order``, then the order of the tables. ``names`` are
    what errors call the tables, by default the topics. Raises TableError.
    """
    topics, names = list(tables), names or {}
    forms = [form_of(topic) for topic in topics]
    read = [
        numbers_of(names.get(topic, topic), tables[topic], form.columns)
        for topic, form in zip(topics, forms, strict=True)
    ]
    for place, row in _in_order(read):
        numbers, form = read[place], forms[place]
        sample = form.sample(int(numbers.stamps_ns[row]), numbers.rows[row].tolist())
        yield Arrived(topics[place], int(numbers.arrivals_ns[row]), sample)


def _in_order(read: Sequence[Numbers]) -> Iterator[tuple[int, int]]:
    """Yield the place of the table and the row in it, of one sample after the other."""
    if not read:
        return
    lengths = [len(one.stamps_ns) for one in read]
    place = np.repeat(np.arange(len(read)), lengths)
    row = np.concatenate([np.arange(length) for length in lengths])
    arrival_ns = np.concatenate([one.arrivals_ns for one in read])
    order = np.lexsort((np.concatenate([one.order for one in read]), arrival_ns))
    yield from zip(place[order].tolist(), row[order].tolist(), strict=True)
