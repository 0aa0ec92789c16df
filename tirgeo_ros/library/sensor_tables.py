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
from tirgeo_ros.core.types.poses import BodyPose, CameraPose
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
    fields: tuple[str, ...]  # of the sample, in the order of the columns

    def values(self, sample: Any) -> list[float]:
        """Return a sample's row."""
        return [value for name in self.fields for value in _flat(getattr(sample, name))]


def _flat(value: Any) -> list[float]:
    """Return numbers of a field; of a covariance (3, 3) the variances, then the covariances."""
    if value is None:  # an attitude that is absent
        return [math.nan] * 4
    if np.ndim(value) == 2:
        return [*value.diagonal().tolist(), *(float(value[place]) for place in _PLACES)]
    numbers: list[float] = np.atleast_1d(np.asarray(value, float)).tolist()
    return numbers


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


def _imu(stamp_ns: int, row: Sequence[float]) -> ImuSample:
    attitude = None if math.isnan(row[6]) else np.array(row[6:])
    return ImuSample(stamp_ns, np.array(row[:3]), np.array(row[3:6]), attitude)


def _position(source: Source, stamp_ns: int, row: Sequence[float]) -> PositionSample:
    known = row[0] in {status.value for status in FixStatus}
    status = FixStatus(int(row[0])) if known else FixStatus.NONE
    place = row[1], row[2], row[3]
    return PositionSample(stamp_ns, source, status, *place, _matrix(row[4:]))


def _velocity(source: Source, stamp_ns: int, row: Sequence[float]) -> VelocitySample:
    return VelocitySample(stamp_ns, source, np.array(row[:3]), _matrix(row[3:]))


def _fixes(source: Source) -> Form:
    columns = (
        Column("status", "2 RTK fixed, 1 float or differential, 0 single, -1 none"),
        _angle("latitude", "geodetic latitude of the antenna", math.pi / 2),
        _angle("longitude", "longitude of the antenna"),
        Column("height_m", "height of the antenna above the ellipsoid, m"),
        *_covariance("m", "m2", "the position"),
    )
    fields = ("status", "latitude_rad", "longitude_rad", "height_m", "covariance_n")
    return Form(columns, partial(_position, source), fields)


def _velocities(source: Source) -> Form:
    columns = (
        *(Column(f"velocity_{a}_m_s", f"velocity {a} of the antenna, m/s") for a in _NED),
        *_covariance("m_s", "m2_s2", "the velocity"),
    )
    return Form(columns, partial(_velocity, source), ("velocity_n", "covariance_n"))


def _headings(kind: Callable[..., SensedSample]) -> Form:
    columns = (
        _angle("heading", "heading, 0 = true north, clockwise"),
        _variance("", "rad", "rad2", "the heading's variance"),
    )
    fields = ("heading_rad", "variance_rad2")
    return Form(columns, lambda stamp_ns, row: kind(stamp_ns, *row), fields)


#: Topic of a sensor -> the form of its table.
SENSORS: Mapping[str, Form] = {
    "imu/data": Form(
        (
            *(Column(f"force_{a}_m_s2", f"specific force {a}, m/s2") for a in _BODY),
            *(_rate(a) for a in _BODY),
            *_quaternion("autopilot", "the autopilot's q_nb, FRD to NED; nan = absent", math.nan),
        ),
        _imu,
        ("specific_force_b", "angular_rate_b", "autopilot_q_nb"),
    ),
    "rtk/fix": _fixes(Source.RTK_POSITION),
    "rtk/vel": _velocities(Source.RTK_VELOCITY),
    "rtk/heading": _headings(HeadingSample),
    "gps/fix": _fixes(Source.GPS_POSITION),
    "gps/vel": _velocities(Source.GPS_VELOCITY),
    "baro/pressure": Form(
        (
            Column("pressure_pa", "air pressure, Pa"),
            _variance("", "pa", "pa2", "the pressure's variance"),
        ),
        lambda stamp_ns, row: PressureSample(stamp_ns, *row),
        ("pressure_pa", "variance_pa2"),
    ),
    "ekf_node/set_heading": _headings(SetHeading),
    "gimbal/joint_states": Form(
        (
            _angle("yaw", "gimbal yaw, clockwise from above"),
            _angle("roll", "gimbal roll, right side down"),
            _angle("pitch", "gimbal pitch, camera up"),
            Column("computed", "1: of reported attitudes, not of encoders", 0.0),
        ),
        lambda stamp_ns, row: JointSample(stamp_ns, row[0], row[1], row[2], computed=bool(row[3])),
        ("yaw_rad", "roll_rad", "pitch_rad", "computed"),
    ),
    "gimbal/attitude": Form(
        _quaternion("camera", "the camera body's q_ng, FRD to NED"),
        lambda stamp_ns, row: CameraAttitudeSample(stamp_ns, np.array(row)),
        ("q_ng",),
    ),
}

_STATES = ("north_m", "east_m", "down_m", "phi_north_rad", "phi_east_rad", "phi_down_rad")
_UPPER = np.triu_indices(6)


class Output(NamedTuple):
    """Hold the columns of an output's table, and the conversion of its messages to rows."""

    columns: tuple[str, ...]
    pose: Callable[[Any], BodyPose | CameraPose]

    def values(self, message: Any) -> tuple[int, list[float]]:
        """Return the stamp, ns, and the row of a message."""
        pose = self.pose(message)
        q = pose.q_nb if isinstance(pose, BodyPose) else pose.q_nc
        return pose.stamp_ns, [*pose.position_n, *q, *pose.covariance[_UPPER]]


def _pose_columns(frame: str) -> tuple[str, ...]:
    pairs = itertools.combinations_with_replacement(_STATES, 2)
    quaternion = [f"{frame}_q{part}" for part in "wxyz"]
    return (*_STATES[:3], *quaternion, *(f"covariance_{a}_{b}" for a, b in pairs))


#: Topic of an output -> the form of its table. The poses are in the plane of ``map``, NED.
OUTPUTS: Mapping[str, Output] = {
    "tirgeo/odometry": Output(_pose_columns("body"), convert.body_pose),
    "tirgeo/camera_pose": Output(_pose_columns("camera"), convert.camera_pose),
}


class Arrived(NamedTuple):
    """Hold a sample, its topic and the time at which it arrived, ns."""

    topic: str
    arrival_ns: int
    sample: SensedSample


def arrived(
    tables: Mapping[str, Table], names: Mapping[str, str] | None = None
) -> Iterator[Arrived]:
    """Yield the samples of tables (by topic) in the order of arrival.

    That is by ``arrival_ns``, then ``arrival_order``, then the order of the tables. ``names`` are
    what errors call the tables, by default the topics. Raises TableError.
    """
    read: list[tuple[str, Form, Numbers]] = []
    for topic, table in tables.items():
        if topic not in SENSORS:
            raise TableError(f"{topic}: no topic of a sensor{nearest(topic, SENSORS)}")
        form = SENSORS[topic]
        numbers = numbers_of((names or {}).get(topic, topic), table, form.columns)
        read.append((topic, form, numbers))
    if not read:
        return
    lengths = [len(numbers.stamps_ns) for _, _, numbers in read]
    place = np.repeat(np.arange(len(read)), lengths)
    row = np.concatenate([np.arange(length) for length in lengths])
    arrivals_ns = np.concatenate([numbers.arrivals_ns for _, _, numbers in read])
    order = np.lexsort((np.concatenate([numbers.order for _, _, numbers in read]), arrivals_ns))
    for which, k in zip(place[order].tolist(), row[order].tolist(), strict=True):
        topic, form, numbers = read[which]
        sample = form.sample(int(numbers.stamps_ns[k]), numbers.rows[k].tolist())
        yield Arrived(topic, int(numbers.arrivals_ns[k]), sample)
