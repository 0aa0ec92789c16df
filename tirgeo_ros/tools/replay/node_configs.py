"""The nodes' parameters as a command takes them: from files, with its options before them."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from typing import NamedTuple

from tirgeo_ros.core.config import EkfConfig, GimbalConfig, OverlayConfig
from tirgeo_ros.core.config.schema import config_from, values_of
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.file_list import named_files
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.maps import map_files
from tirgeo_ros.io.parameters.parameter_file import Files, ParameterFile
from tirgeo_ros.tools.replay.flight_topics import fitting_method


class NodeConfigs(NamedTuple):
    """Of the nodes that make the overlay, and the names of the parameters that somebody set."""

    ekf: EkfConfig
    gimbal: GimbalConfig
    overlay: OverlayConfig
    given: frozenset[str]  # dotted, of all three nodes, in files or as options

    @property
    def files(self) -> list[PathLike]:
        """What the parameters name: map, style sheet, elevation model, camera's calibration."""
        one = self.overlay
        return [*map_files(one.map, one.style), *named_files(one.dem), one.camera]

    def fitting(self, reader: BagReader, namespace: str) -> tuple[NodeConfigs, list[str]]:
        """The same for a bag: where nobody said a method, that of what it holds; and a note."""
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
    """Of ekf_node, gimbal_node and overlay_node, from parameter files (None: the defaults).

    What is not None stands before the files: ``method``; ``dem``, which unsets the ground's
    height; ``ground_height`` (ellipsoidal m); ``camera``, its calibration. Raises ConfigError.
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
    return NodeConfigs(ekf, gimbal, overlay, frozenset(given))
