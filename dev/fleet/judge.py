"""Judge a fleet's recording: what was lost, what was crossed, how far from the truth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dev.fleet.flights import FleetFlight
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.frames.wgs84 import ecef_from_geodetic
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.bags.cdr import header_stamp_ns

_OUTPUTS = ("tirgeo/odometry", "tirgeo/camera_pose")
#: Farther from its own truth than this, an aircraft is not where it flies.
OFF_M = 1.0


@dataclass
class Heard:
    """Hold what one aircraft's graph gave: stamps (ns) by topic, places, counts of messages."""

    stamps_ns: dict[str, list[int]] = field(default_factory=lambda: {t: [] for t in _OUTPUTS})
    place_n: list[Array] = field(default_factory=list)  # of odometry, in its own ``map``
    plane: TangentPlane | None = None
    lost_in_transport: int = 0


@dataclass(frozen=True)
class Judged:
    """Hold the verdict on one aircraft."""

    name: str
    imu_sent: int
    aligned_s: float  # from the first sample of the IMU to the first odometry; nan: never
    odometry: int
    odometry_lost: int  # samples of the IMU since then without odometry
    poses: int  # of the camera
    poses_lost: int  # joint samples between the first odometry and the last one without a pose
    crossed: int  # messages that stem from another aircraft's sample, or lie off the own truth
    error_m: float  # the largest distance from the truth; nan: no odometry


def read_heard(recording: Path, names: Sequence[str]) -> dict[str, Heard]:
    """Return what each aircraft's graph gave, from the witness's bag."""
    cdr, found = Cdr(), {name: Heard() for name in names}
    for item in BagReader(recording).messages():
        name, _, topic = item.topic.lstrip("/").partition("/")
        if topic in _OUTPUTS:
            found[name].stamps_ns[topic].append(header_stamp_ns(item.data))
        message = cdr.deserialize(item.data, item.typename)
        if topic == "tirgeo/odometry":
            found[name].place_n.append(convert.body_pose(message).position_n)
        elif topic == "tirgeo/origin":
            found[name].plane = convert.tangent_plane(message)
        elif item.topic == "/diagnostics":
            _note_losses(found, message)
    return found


def _note_losses(found: Mapping[str, Heard], message: object) -> None:
    for status in message.status:  # type: ignore[attr-defined]
        heard = found.get(status.name.split("/")[1])
        lost = [int(pair.value) for pair in status.values if pair.key.endswith(" lost")]
        if heard is not None:
            heard.lost_in_transport = max(heard.lost_in_transport, sum(lost))


def judge(flight: FleetFlight, shift_ns: int, heard: Heard) -> Judged:
    """Compare what an aircraft's graph gave with what was played to it."""
    sent = _sent(flight, shift_ns)
    imu, joints = sent["/imu/data"], sent["/gimbal/joint_states"]
    odometry, cameras = (heard.stamps_ns[topic] for topic in _OUTPUTS)
    first_ns = min(odometry, default=0)
    errors = _errors_m(flight, shift_ns, heard)
    # A camera's pose needs the body's before and after it.
    due = {one for one in joints if first_ns <= one <= max(odometry, default=0)}
    foreign = len(set(odometry) - imu) + len(set(cameras) - joints)
    return Judged(
        flight.name,
        len(imu),
        (first_ns - min(imu)) * 1e-9 if odometry else math.nan,
        len(odometry),
        len({one for one in imu if one >= first_ns} - set(odometry)),
        len(cameras),
        len(due - set(cameras)),
        foreign + int((errors > OFF_M).sum()),
        float(errors.max(initial=0.0)) if odometry else math.nan,
    )


def _sent(flight: FleetFlight, shift_ns: int) -> dict[str, set[int]]:
    """Return the stamps (ns) of all that was played, by topic."""
    sent: dict[str, set[int]] = {}
    for item in BagReader(flight.bag).messages():
        sent.setdefault(item.topic, set()).add(header_stamp_ns(item.data) + shift_ns)
    return sent


def _errors_m(flight: FleetFlight, shift_ns: int, heard: Heard) -> Array:
    """Return how far each odometry lies from the truth at its stamp, m; 0 for another's."""
    if heard.plane is None or not heard.place_n:
        return np.zeros(0)
    at = {stamp_ns + shift_ns: row for row, stamp_ns in enumerate(flight.stamp_ns)}
    rows = [at.get(one, -1) for one in heard.stamps_ns["tirgeo/odometry"]]
    place_e = ecef_from_geodetic(*heard.plane.geodetic_from_ned(np.array(heard.place_n)))
    off_m = np.linalg.norm(np.asarray(place_e) - flight.place_e[rows], axis=1)
    return np.where(np.array(rows) < 0, 0.0, off_m)
