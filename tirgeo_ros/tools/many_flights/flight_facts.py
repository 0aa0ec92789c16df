"""Read from a processed flight what the page of many flights shows of it."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.verdicts import NavigationStatus
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagMessage, BagReader, Cdr
from tirgeo_ros.io.messages import STATE_TOPIC
from tirgeo_ros.tools.replay.flight_topics import resolved

_TRACK_POINTS = 200
_TRACK_STEP_NS = 1_000_000_000  # of the points whose distances are added up
_WIDTH_PX, _QUALITY = 320, 60  # of the small picture
_FIX, _PICTURE = "tirgeo/fix", "tirgeo/overlay/image/compressed"


class _Place(NamedTuple):
    stamp_ns: int
    latitude_deg: float
    longitude_deg: float
    horizontal_m: float  # sigma: root of the sum of the variances of east and north
    vertical_m: float  # sigma


def flight_facts(bag: Path, namespace: str, duration_s: float) -> tuple[dict[str, Any], bytes]:
    """Return the facts of an output bag of ``process``, and a small JPEG; b"" without pictures.

    The flight ends with the bag, and began ``duration_s`` before that. Sigmas are medians over
    the flight, ``nis`` the means over the filter's states by source, and ``test_ratios`` their
    largest. A bag without ``tirgeo/state``, of an older version, has None and nothing for these.
    The track has at most 200 points, degrees.
    """
    reader, cdr = BagReader(bag), Cdr()
    begin_ns, end_ns = reader.span_ns
    names = {resolved(topic, namespace): topic for topic in (_FIX, _PICTURE, STATE_TOPIC)}
    places: list[_Place] = []
    aids = _Aids()
    picture: BagMessage | None = None
    for message in reader.messages(names.keys() & reader.topics().keys()):
        topic = names[message.topic]
        if topic == _PICTURE:
            # The one in the middle; where video ends before, the last.
            late = picture is not None and picture.log_time_ns >= (begin_ns + end_ns) // 2
            picture = picture if late else message
        elif topic == _FIX:
            places.append(_place(cdr.deserialize(message.data, message.typename)))
        else:
            state = convert.node_state(cdr.deserialize(message.data, message.typename))
            aids.add(state.navigation)
    flown_ns = end_ns - round(duration_s * 1e9)
    facts = {"begin_utc": _utc(flown_ns), **_of_places(places), **aids.facts()}
    content = cdr.deserialize(picture.data, picture.typename) if picture else None
    return facts, _small(content)


class _Aids:
    """Collect from the filter's states the figures of the heading and of each source."""

    def __init__(self) -> None:
        self._heading_deg: list[float] = []
        self._nis: defaultdict[str, list[float]] = defaultdict(list)
        self._ratios: defaultdict[str, float] = defaultdict(float)

    def add(self, status: NavigationStatus | None) -> None:
        if status is None:  # of another node
            return
        self._heading_deg.append(math.degrees(status.heading_sigma_rad))
        for source, nis in status.nis.items():
            self._nis[source].append(nis)
        for source, ratio in status.test_ratios.items():
            self._ratios[source] = max(self._ratios[source], ratio)

    def facts(self) -> dict[str, Any]:
        return {
            "heading_sigma_deg": _median(self._heading_deg),
            "nis": {source: float(np.mean(values)) for source, values in self._nis.items()},
            "test_ratios": dict(self._ratios),
        }


def _place(msg: Any) -> _Place:
    east, north, up = np.reshape(msg.position_covariance, (3, 3)).diagonal().tolist()
    sigmas_m = math.sqrt(max(east + north, 0.0)), math.sqrt(max(up, 0.0))
    return _Place(convert.stamp_ns(msg), msg.latitude, msg.longitude, *sigmas_m)


def _of_places(places: list[_Place]) -> dict[str, Any]:
    """Return track, distance and sigmas; nothing of a flight without a position."""
    if not places:
        return {}
    step = math.ceil(len(places) / _TRACK_POINTS)
    track = [[round(p.latitude_deg, 7), round(p.longitude_deg, 7)] for p in places[::step]]
    return {
        "track_deg": track,
        "distance_m": _distance_m(list(_each_second(places))),
        "horizontal_sigma_m": _median([p.horizontal_m for p in places]),
        "vertical_sigma_m": _median([p.vertical_m for p in places]),
    }


def _each_second(places: list[_Place]) -> Iterator[_Place]:
    next_ns = places[0].stamp_ns
    for place in places:
        if place.stamp_ns >= next_ns:
            yield place
            next_ns = place.stamp_ns + _TRACK_STEP_NS


def _distance_m(places: list[_Place]) -> float:
    """Return the length of the way over the ground, m."""
    ned = positions_ned([[p.latitude_deg, p.longitude_deg] for p in places])
    return float(np.linalg.norm(np.diff(ned[:, :2], axis=0), axis=1).sum())


def positions_ned(track_deg: list[list[float]]) -> Array:
    """Return the points (n, 3), NED, m, of latitudes and longitudes, from the first of them."""
    latitudes, longitudes = np.radians(np.reshape(track_deg, (-1, 2))).T
    plane = TangentPlane(float(latitudes[0]), float(longitudes[0]), 0.0)
    return plane.ned_from_geodetic(latitudes, longitudes, np.zeros(len(latitudes)))


def _median(values: list[float]) -> float | None:
    finite = [value for value in values if math.isfinite(value)]
    return float(np.median(finite)) if finite else None


def _utc(stamp_ns: int) -> str:
    moment = datetime.fromtimestamp(stamp_ns // 1_000_000_000, timezone.utc)
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


def _small(message: Mapping[str, Any] | None) -> bytes:
    """Return a compressed picture as a small JPEG; b"" for none."""
    if message is None:
        return b""
    pixels = convert.compressed_pixels(message)
    scale = min(_WIDTH_PX / pixels.shape[1], 1.0)
    small = cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return bytes(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1])
