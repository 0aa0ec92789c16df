"""Read the nodes' parameters for a command: from files, overridden by its options."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from typing import NamedTuple

from tirgeo_ros.core.config import EkfConfig, GimbalConfig, OverlayConfig
from tirgeo_ros.core.config.schema import config_from, values_of
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.files.whole_files import PathLike, named_files
from tirgeo_ros.io.maps import map_files
from tirgeo_ros.io.parameters.parameter_file import Files, ParameterFile
from tirgeo_ros.tools.replay.flight_topics import Topics, fitting_method


class NodeConfigs(NamedTuple):
    """Hold the parameters of the three nodes and the names of those that are set."""

    ekf: EkfConfig
    gimbal: GimbalConfig
    overlay: OverlayConfig
    given: frozenset[str]  # full dotted names, of all three nodes, from files or options

    @property
    def files(self) -> list[PathLike]:
        """Return the files in the parameters: map, style sheet, elevation model, calibration."""
        one = self.overlay
        return [*map_files(one.map, one.style), *named_files(one.dem), one.camera]

    def fitting(self, reader: Topics, namespace: str) -> tuple[NodeConfigs, list[str]]:
        """Return the parameters for a bag, and a note if the method is not the default.

        Without a given method, the method is chosen by the topics of the bag.
        """
        if "method" in self.given:
            return self, []
        method, why = fitting_method(reader, namespace)
        fitted = self._replace(ekf=replace(self.ekf, method=method))
        return fitted, [why] if why else []


def node_configs(
    params: Files,
    namespace: str = "",
    *,
    method: str | None = None,
    dem: PathLike | None = None,
    ground_height: float | None = None,
    camera: PathLike | None = None,
) -> NodeConfigs:
    """Return the parameters of the three nodes from parameter files (None: the defaults).

    The nodes are ekf_node, gimbal_node and overlay_node. Each option that is not None overrides
    the files: ``method``; ``dem``, which also unsets the ground's height; ``ground_height``
    (ellipsoidal m); ``camera``, a calibration file. Raise ConfigError.
    """
    file = ParameterFile(params)
    options = {"method": method, "dem": dem, "ground_height_m": ground_height, "camera": camera}
    given = {name for name, value in options.items() if value is not None}
    for node in ("ekf_node", "gimbal_node", "overlay_node"):
        given |= file.values(node, namespace).keys()
    ekf = file.config("ekf_node", EkfConfig, namespace)
    gimbal = file.config("gimbal_node", GimbalConfig, namespace)
    overlay = file.config("overlay_node", OverlayConfig, namespace)
    if method is not None:
        ekf = config_from(EkfConfig, values_of(ekf) | {"method": method})
    if dem is not None:
        overlay = replace(overlay, dem=os.fspath(dem), ground_height_m=math.nan)
    if ground_height is not None:
        overlay = config_from(
            OverlayConfig, values_of(overlay) | {"ground_height_m": float(ground_height)}
        )
    if camera is not None:
        overlay = replace(overlay, camera=os.fspath(camera))
    if not ekf.frame_ids == gimbal.frame_ids == overlay.frame_ids:
        raise ConfigError(
            "the nodes name their frames differently: set map_frame, base_link_frame, "
            "camera_frame and frame_prefix once, under /**"
        )
    return NodeConfigs(ekf, gimbal, overlay, frozenset(given))
