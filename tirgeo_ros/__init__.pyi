# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0

# Types of the public interface; __init__.py imports each name when it is first used.

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Terrain
from tirgeo_ros.core.ground.ground_point import Ellipse, Located, Refusal
from tirgeo_ros.core.types.errors import (
    BagError,
    CameraError,
    ConfigError,
    ElevationError,
    MapError,
    PictureError,
    PoseError,
    SurveyError,
    TableError,
    TirgeoError,
    VideoError,
)
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.elevation.elevation_model import load_terrain
from tirgeo_ros.io.pictures.camera_file import load_camera
from tirgeo_ros.io.surveys.survey import Observation, SurveyPoint, load_observations, load_survey
from tirgeo_ros.library.bags import Picture, read_bag, read_camera, read_pictures, write_bag
from tirgeo_ros.library.filtering import FilteredFlight, filter_flight
from tirgeo_ros.library.projecting import PicturePose, Projected, locate, project, save_located
from tirgeo_ros.tools.replay.node_configs import NodeConfigs, load_config
from tirgeo_ros.tools.replay.process import process

__version__: str
__all__ = [
    "BagError",
    "Camera",
    "CameraError",
    "CameraPose",
    "CameraRates",
    "ConfigError",
    "ElevationError",
    "Ellipse",
    "FilteredFlight",
    "Located",
    "MapError",
    "NodeConfigs",
    "Observation",
    "Picture",
    "PictureError",
    "PicturePose",
    "PoseError",
    "Projected",
    "Refusal",
    "SurveyError",
    "SurveyPoint",
    "TableError",
    "TangentPlane",
    "Terrain",
    "TirgeoError",
    "VideoError",
    "filter_flight",
    "load_camera",
    "load_config",
    "load_observations",
    "load_survey",
    "load_terrain",
    "locate",
    "process",
    "project",
    "read_bag",
    "read_camera",
    "read_pictures",
    "save_located",
    "write_bag",
]
