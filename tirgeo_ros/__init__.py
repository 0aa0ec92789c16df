# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""tirgeo: a map on a drone's thermal video, placed by sensors alone.

The public interface is what ``__all__`` lists; ``docs/library.md`` is its guide.

The charter. It holds in every module of this package unless a name says otherwise.

Frames:

- ``e``: earth-centred, earth-fixed (WGS84).
- ``n``: north, east, down. In the navigation filter: at the aircraft. Downstream of it (poses,
  maps, overlay): the tangent plane at the origin of the ROS frame ``map``.
- ``b``: body of the aircraft: forward, right, down (FRD), at the IMU.
- ``g``: camera body: forward (optical axis), right, down.
- ``c``: camera optical frame: x right, y down, z forward.

ROS's frames (``map`` in ENU, ``base_link`` in FLU, ``tir_optical_frame``) exist in messages alone;
``tirgeo_ros.io.messages`` converts at the rim.

Axes and names:

- ``R_nb`` takes body vectors to ``n``; vectors end in their frame (``v_n``, ``lever_arm_b``).
- Quaternions are Hamilton, ``w, x, y, z``; ``q_nb`` is the rotation of ``R_nb``.
- Euler angles are roll, pitch, yaw (radians), applied yaw, pitch, roll (z-y-x, intrinsic).
- An attitude error ``phi_n`` is the rotation that takes the estimate to the truth, resolved in
  ``n``: ``R_nb_true = exp([phi_n x]) R_nb``. All error states are truth minus estimate.

Units: SI and radians. Degrees only where a name ends in ``_deg``.

Heights: metres above the WGS84 ellipsoid.

Heading: 0 is true north, clockwise positive.

Time: integer nanoseconds, of the measurement (not of its arrival); float seconds for steps.
"""

__version__ = "1.0.0"

#: The public interface: each name and the module that it comes from, at its first use.
_HOMES = {
    "filter_flight": "library.filtering",
    "FilteredFlight": "library.filtering",
    "PicturePose": "library.projecting",
    "project": "library.projecting",
    "Projected": "library.projecting",
    "locate": "library.projecting",
    "Located": "core.ground.ground_point",
    "Refusal": "core.ground.ground_point",
    "Ellipse": "core.ground.ground_point",
    "save_located": "library.projecting",
    "read_bag": "library.bags",
    "read_camera": "library.bags",
    "read_pictures": "library.bags",
    "Picture": "library.bags",
    "write_bag": "library.bags",
    "process": "tools.replay.process",
    "load_config": "tools.replay.node_configs",
    "NodeConfigs": "tools.replay.node_configs",
    "load_camera": "io.pictures.camera_file",
    "load_terrain": "io.elevation.elevation_model",
    "load_survey": "io.surveys.survey",
    "load_observations": "io.surveys.survey",
    "SurveyPoint": "io.surveys.survey",
    "Observation": "io.surveys.survey",
    "Camera": "core.camera.camera_model",
    "CameraPose": "core.types.poses",
    "TangentPlane": "core.frames.tangent_plane",
    "Terrain": "core.ground.backprojection",
    "CameraRates": "core.camera.projection_covariance",
    "TirgeoError": "core.types.errors",
    "BagError": "core.types.errors",
    "CameraError": "core.types.errors",
    "ConfigError": "core.types.errors",
    "ElevationError": "core.types.errors",
    "MapError": "core.types.errors",
    "PictureError": "core.types.errors",
    "PoseError": "core.types.errors",
    "SurveyError": "core.types.errors",
    "TableError": "core.types.errors",
    "VideoError": "core.types.errors",
}
__all__ = list(_HOMES)


def __getattr__(name: str) -> object:
    """Import a name of the public interface (PEP 562): the commands' start stays quick."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module  # noqa: PLC0415  only for who uses the library

    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the names, those that are not imported yet too."""
    return sorted({*globals(), *__all__})
