"""Locate observed control points on the ground and compare them with their survey, in a plane."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CameraRates, pixel_jacobian
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.ground.backprojection import Ground, Reason
from tirgeo_ros.core.ground.ground_point import Refusal, ellipse_of, place
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import SurveyError
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.surveys.survey import Observation, SurveyPoint, load_observations, load_survey
from tirgeo_ros.tools.evaluate.projection import Projection, projection_of
from tirgeo_ros.tools.evaluate.result import (
    LocatedPoint,
    PixelMoves,
    RefusedPoint,
)
from tirgeo_ros.tools.replay.flight_poses import pose_at

_NAMED = 5  # most ids in a note


@dataclass(frozen=True)
class Experiment:
    """Hold the surveyed points and their observations."""

    projection: Projection
    control: Mapping[str, SurveyPoint]  # every surveyed point by its id
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
    if not seen:
        raise SurveyError(f"{os.fspath(observations)}: has no observations")
    if not {point.id for point in points} & {one.id for one in seen}:
        raise SurveyError(
            f"{os.fspath(observations)}: none of its {len(seen)} observations is of a point in "
            f"{os.fspath(survey)}: the ids must be the same"
        )
    return experiment_of(points, seen, projection)


def experiment_of(
    points: Sequence[SurveyPoint], seen: Sequence[Observation], projection: str
) -> Experiment:
    """Return the experiment with the surveyed points in a plane (``projection_of``)."""
    latitude, longitude = np.array([(one.latitude_rad, one.longitude_rad) for one in points]).T
    plane = projection_of(projection, latitude, longitude)
    return Experiment(plane, {one.id: one for one in points}, seen)


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
        point, uv = given.control.get(seen.id), (seen.u, seen.v)
        if point is None:
            continue
        motion = pose_at(poses, seen.stamp_ns - latency_ns)
        if motion is None:
            refused.append(RefusedPoint(seen.id, seen.stamp_ns, uv, Reason.NO_POSE.value))
            continue
        pose, rates = motion
        found = place(camera, pose, uv, plane, ground, overlay.confidence, rates)
        if isinstance(found, Refusal):
            refused.append(RefusedPoint(seen.id, seen.stamp_ns, uv, found.reason.value))
            continue
        here = found.latitude_rad, found.longitude_rad
        place_en, axes = given.projection.project(*here), given.projection.local_axes(*here)
        covariance_en = axes @ found.covariance_n[:2, :2] @ axes.T
        there = point.latitude_rad, point.longitude_rad
        surveyed_n = plane.ned_from_geodetic(*there, found.height_m)
        located.append(
            LocatedPoint(
                seen.id,
                seen.stamp_ns,
                uv,
                place_en,
                found.height_m,
                place_en - given.projection.project(*there),
                covariance_en,
                ellipse_of(covariance_en[::-1, ::-1]),
                pixel_moves(camera, pose, rates, uv, surveyed_n),
            )
        )
    return located, refused


def pixel_moves(
    camera: Camera,
    pose: CameraPose,
    rates: CameraRates | None,
    uv: tuple[float, float],
    surveyed_n: Array,
) -> PixelMoves | None:
    """Return one observation's moves; None if the camera cannot see the surveyed point.

    ``surveyed_n`` (3,) is the surveyed point at the height of the assumed ground, NED in the
    pose's plane. Without ``rates`` latency is not considered.
    """
    rotation_nc = matrix_from_quat(pose.q_nc)
    predicted, _ = camera.project((surveyed_n - pose.position_n)[None] @ rotation_nc)
    by_pose, by_point = (both[0] for both in pixel_jacobian(camera, pose, surveyed_n))
    if not (np.isfinite(predicted).all() and np.isfinite(by_pose).all()):
        return None
    by = {
        "boresight": by_pose[:, 3:] @ rotation_nc,
        "datum": by_point[:, [1, 0]],
        "height": by_point[:, 2:],
    }
    if rates is not None:
        by["latency"] = -(by_pose @ np.concatenate(rates))[:, None]
    return PixelMoves(np.array(uv) - predicted[0], by)


def input_notes(given: Experiment, image_stamps_ns: Sequence[int]) -> list[str]:
    """Compare observations, survey and pictures, whose stamps (M,) may be empty."""
    names, total = Counter(one.id for one in given.observations), len(given.observations)
    unknown = [name for name in names if name not in given.control]
    unobserved = [name for name in given.control if name not in names]
    notes = []
    if unknown:
        notes.append(
            f"{sum(names[name] for name in unknown)} of {total} observations are of points that "
            f"are not in the survey, and left out: {_some(unknown)}"
        )
    if unobserved:
        notes.append(f"{len(unobserved)} surveyed points were never observed: {_some(unobserved)}")
    images = np.array(sorted(image_stamps_ns), np.int64)
    apart_ns = [
        int(np.abs(images - one.stamp_ns).min()) for one in given.observations if len(images)
    ]
    if any(apart_ns):
        notes.append(
            f"{np.count_nonzero(apart_ns)} of {total} observations have no picture's "
            f"stamp: they are up to {max(apart_ns) * 1e-9:.3g} s from the nearest one"
        )
    return notes


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more
