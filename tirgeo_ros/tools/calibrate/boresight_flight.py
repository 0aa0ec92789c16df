"""Read a recorded flight over surveyed points for a boresight calibration.

It runs through the nodes' core objects with the parameters as they are and, in the same pass, with
a step in each parameter that acts before the camera pose is computed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tirgeo_ros.core.calibration.boresight_model import (
    PARAMETERS,
    PointSighting,
    SightedFlight,
    Stepped,
    corrected_pose,
)
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.streams.stamps import exposure_ns
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.pictures.camera_file import given_camera
from tirgeo_ros.io.surveys.survey import Observation, SurveyPoint
from tirgeo_ros.tools.presentation.progress import Report
from tirgeo_ros.tools.replay.flight import Flight, FlightPoses
from tirgeo_ros.tools.replay.node_configs import NodeConfigs

_STEP_DEG = 1.0


@dataclass(frozen=True)
class ReadFlight:
    """Hold a flight that went through the filter, and the observations of its points."""

    flight: SightedFlight
    plane: TangentPlane
    sightings: list[PointSighting]
    unknown: int  # observations of points that the survey lacks
    lost: int  # observations of pictures without a pose
    ground_m: float  # median height of the points seen, ellipsoidal; nan without any
    by_encoders: bool
    follows_north: bool  # the composer used its own estimates of the gimbal's north

    @property
    def notes(self) -> list[str]:
        """Return notes on the observations that cannot be used."""
        faults = {
            "points that the survey does not have": self.unknown,
            "pictures without a pose": self.lost,
        }
        return [f"{number} observations of {what}" for what, number in faults.items() if number]


def read_flight(
    reader: BagReader,
    namespace: str,
    configs: NodeConfigs,
    wanted: Sequence[str],
    observed: Sequence[Observation],
    survey: Sequence[SurveyPoint],
    click_sigma_px: float,
    progress: Report,
    *,
    smooth: bool = False,
) -> ReadFlight:
    """Read a bag once. Raise BagError, or CalibrationError if the filter gives no pose."""
    recorded = Flight(reader, namespace, camera=given_camera(configs.overlay))
    passes = _passes(recorded, configs, wanted, observed, smooth=smooth)
    recorded.read_all(progress)
    usual = passes.pop("")
    if usual.plane is None:
        why = "the filter made no pose of this flight; 'tirgeo process' says why"
        raise CalibrationError(f"{reader.path}: {why}")
    composer = usual.registration.composer
    follows_north = not composer.sees_joints and composer.counts.get("north_used", 0) > 0
    # Joint angles, or the flight's own readings, give the north without this uncertainty.
    shown = composer.sees_joints or follows_north
    north = 0.0 if shown else math.radians(configs.gimbal.north.sigma_deg) ** 2
    flight = _sighted(recorded.camera, usual, passes, configs, click_sigma_px, north)
    points = {point.id: point for point in survey}
    surveyed = [observation for observation in observed if observation.id in points]
    present = np.zeros(len(PARAMETERS))
    posed = [
        observation
        for observation in surveyed
        if corrected_pose(flight, observation.stamp_ns, present) is not None
    ]
    heights = [points[name].height_m for name in {observation.id for observation in posed}]
    return ReadFlight(
        flight=flight,
        plane=usual.plane,
        sightings=[
            _sighting(observation, points[observation.id], usual.plane) for observation in posed
        ],
        unknown=len(observed) - len(surveyed),
        lost=len(surveyed) - len(posed),
        ground_m=float(np.median(heights)) if heights else math.nan,
        by_encoders=composer.sees_joints,
        follows_north=follows_north,
    )


def _sighted(
    camera: Camera,
    usual: FlightPoses,
    passes: Mapping[str, FlightPoses],
    configs: NodeConfigs,
    click_sigma_px: float,
    north_variance: float,
) -> SightedFlight:
    return SightedFlight(
        camera=camera,
        poses=usual.at,
        boresight_rpy_rad=np.radians(np.array(configs.gimbal.boresight_rpy_deg)),
        latency_s=configs.overlay.video_latency_s,
        camera_offset_g=configs.gimbal.aircraft.camera_from_pivot_g,
        click_sigma_px=click_sigma_px,
        stepped={
            name: Stepped(poses.at, math.radians(_STEP_DEG)) for name, poses in passes.items()
        },
        north_variance=north_variance,
    )


def _sighting(observation: Observation, point: SurveyPoint, plane: TangentPlane) -> PointSighting:
    place_n = plane.ned_from_geodetic(point.latitude_rad, point.longitude_rad, point.height_m)
    return PointSighting(
        observation.id, observation.stamp_ns, np.array([observation.u, observation.v]), place_n
    )


def _passes(
    recorded: Flight,
    configs: NodeConfigs,
    wanted: Sequence[str],
    observed: Sequence[Observation],
    *,
    smooth: bool,
) -> dict[str, FlightPoses]:
    """Return a run as it is (key ""), and one with a step of each wanted parameter."""
    ekf, gimbal = configs.ekf, configs.gimbal
    instants_ns = [
        exposure_ns(observation.stamp_ns, configs.overlay.video_latency_s)
        for observation in observed
    ]
    passes = {"": recorded.registered(ekf, gimbal, instants_ns, smooth=smooth)}
    if "gimbal_north" in wanted:
        # Only one of the two has an effect: that of the composition in use.
        north = replace(gimbal.north, bias_deg=gimbal.north.bias_deg + _STEP_DEG)
        stepped = replace(gimbal, north=north, yaw_zero_deg=gimbal.yaw_zero_deg + _STEP_DEG)
        passes["gimbal_north"] = recorded.registered(ekf, stepped, instants_ns, smooth=smooth)
    if "heading_offset" in wanted:
        step_rad = math.radians(_STEP_DEG)
        passes["heading_offset"] = recorded.registered(
            ekf, gimbal, instants_ns, baseline_step_rad=step_rad, smooth=smooth
        )
    return passes
