"""Locate observed control points on the ground and compare them with their survey, in a plane."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.ground.backprojection import Ground, Reason
from tirgeo_ros.core.ground.ground_point import Located, Refusal, ellipse_of, place
from tirgeo_ros.core.types.errors import SurveyError
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.surveys.survey import Observation, SurveyPoint, load_observations, load_survey
from tirgeo_ros.tools.evaluate.projection import Projection, projection_of
from tirgeo_ros.tools.evaluate.result import ControlPoint, InputChecks, LocatedPoint, RefusedPoint
from tirgeo_ros.tools.evaluate.systematic import PixelMoves, pixel_moves
from tirgeo_ros.tools.replay.flight_poses import pose_at

_NAMED = 5  # most ids in a note


@dataclass(frozen=True)
class Experiment:
    """Hold the surveyed points and their observations."""

    projection: Projection
    control: Mapping[str, ControlPoint]  # every surveyed point by its id
    observations: Sequence[Observation]  # also of points that were not surveyed

    @property
    def heights_m(self) -> list[float]:
        """Return the ellipsoidal heights of the observed surveyed points, one for each point."""
        seen = {one.id for one in self.observations}
        return [point.height_m for name, point in self.control.items() if name in seen]


def load_experiment(survey: PathLike, observations: PathLike, projection: str) -> Experiment:
    """Load survey and observations from files, in a projected plane (``projection_of``).

    Raise SurveyError, also if no surveyed point was observed.
    """
    points, seen = load_survey(survey), load_observations(observations)
    names = {point.id for point in points}
    if not seen:
        raise SurveyError(f"{os.fspath(observations)}: has no observations")
    if not any(one.id in names for one in seen):
        raise SurveyError(
            f"{os.fspath(observations)}: none of its {len(seen)} observations is of a point of "
            f"{os.fspath(survey)}: the ids must be the same"
        )
    places = np.array([(point.latitude_rad, point.longitude_rad) for point in points])
    plane = projection_of(projection, places[:, 0], places[:, 1])
    return Experiment(plane, control_points(points, plane), seen)


def control_points(
    survey: Iterable[SurveyPoint], projection: Projection
) -> dict[str, ControlPoint]:
    """Return the surveyed points in the plane, by their ids."""
    found = {}
    for point in survey:
        east_m, north_m = projection.project(point.latitude_rad, point.longitude_rad).tolist()
        geodetic = point.latitude_rad, point.longitude_rad, point.height_m
        found[point.id] = ControlPoint(point.id, *geodetic, east_m, north_m)
    return found


def locate_observations(
    poses: PoseBuffer[CameraPose],
    plane: TangentPlane,
    camera: Camera,
    given: Experiment,
    ground: Ground,
    overlay: OverlayConfig,
) -> tuple[list[LocatedPoint], list[RefusedPoint]]:
    """Locate every observation of a control point (Eq. 23); other observations are left out.

    ``poses`` are in ``plane`` and cover the observations. The pose of an observation is that of
    its picture's exposure: the stamp minus ``overlay.video_latency_s``.
    """
    located, refused = [], []
    latency_ns = round(overlay.video_latency_s * 1e9)
    for seen in given.observations:
        if seen.id not in given.control:
            continue
        found = pose_at(poses, seen.stamp_ns - latency_ns)
        uv = (seen.u, seen.v)
        answer: Located | Refusal = Refusal(seen.stamp_ns, uv, Reason.NO_POSE)
        if found is not None:
            pose, rates = found
            answer = place(camera, pose, uv, plane, ground, overlay.confidence, rates)
        if isinstance(answer, Located) and found is not None:
            point = given.control[seen.id]
            surveyed_n = plane.ned_from_geodetic(
                point.latitude_rad, point.longitude_rad, answer.height_m
            )
            moves = pixel_moves(camera, *found, uv, surveyed_n)
            located.append(_compared(seen, answer, given, moves))
        else:
            assert isinstance(answer, Refusal)
            refused.append(RefusedPoint(seen.id, seen.stamp_ns, uv, answer.reason.value))
    return located, refused


def _compared(
    seen: Observation, found: Located, given: Experiment, moves: PixelMoves | None
) -> LocatedPoint:
    """Return a located point and its covariance in the projected plane."""
    point, projection = given.control[seen.id], given.projection
    place_en = projection.project(found.latitude_rad, found.longitude_rad)
    axes = projection.local_axes(found.latitude_rad, found.longitude_rad)
    covariance_en = axes @ found.covariance_n[:2, :2] @ axes.T
    east_m, north_m = place_en.tolist()
    return LocatedPoint(
        seen.id,
        seen.stamp_ns,
        (seen.u, seen.v),
        east_m,
        north_m,
        found.height_m,
        place_en - np.array([point.east_m, point.north_m]),
        covariance_en,
        ellipse_of(covariance_en[::-1, ::-1]),
        moves,
    )


def checks_of(given: Experiment, image_stamps_ns: Sequence[int]) -> InputChecks:
    """Compare observations, survey and pictures; ``image_stamps_ns`` (M,) may be empty."""
    names = Counter(one.id for one in given.observations)
    unknown = {name: number for name, number in names.items() if name not in given.control}
    unobserved = [name for name in given.control if name not in names]
    if not image_stamps_ns:
        return InputChecks(len(given.observations), unknown, unobserved, None, None)
    images = np.array(sorted(image_stamps_ns), np.int64)
    stamps = np.array([one.stamp_ns for one in given.observations], np.int64)
    after = np.searchsorted(images, stamps)
    near = [np.clip(after - step, 0, len(images) - 1) for step in (0, 1)]
    apart_ns = np.min([np.abs(images[one] - stamps) for one in near], axis=0)
    off, most_s = int(np.count_nonzero(apart_ns)), int(apart_ns.max()) * 1e-9
    return InputChecks(len(stamps), unknown, unobserved, off, most_s)


def check_notes(checks: InputChecks) -> list[str]:
    """Return the checks as lines for a person."""
    notes, total = [], checks.observations
    if checks.unknown_ids:
        notes.append(
            f"{sum(checks.unknown_ids.values())} of {total} observations are of points that the "
            f"survey has not, and left out: {_some(list(checks.unknown_ids))}"
        )
    if checks.unobserved_ids:
        notes.append(
            f"{len(checks.unobserved_ids)} surveyed points were never observed: "
            f"{_some(checks.unobserved_ids)}"
        )
    if checks.off_pictures:
        notes.append(
            f"{checks.off_pictures} of {total} observations have a stamp that is no picture's: "
            f"up to {checks.off_pictures_most_s:.3g} s from the nearest one"
        )
    return notes


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more
