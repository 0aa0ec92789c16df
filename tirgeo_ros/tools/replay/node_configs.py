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
"""Read the nodes' parameters for a command, whose options override files, or for a program."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np

from tirgeo_ros.core.config import EkfConfig, GimbalConfig, OverlayConfig
from tirgeo_ros.core.config.schema import config_from, parameters_of, values_of
from tirgeo_ros.core.map.vector_map import MapLayer
from tirgeo_ros.core.types.errors import BagError, ConfigError, TirgeoError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, named_files
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.maps import load_layers, map_files
from tirgeo_ros.io.parameters.parameter_file import Files, ParameterFile, paths_of
from tirgeo_ros.tools.convert.direct_input import NO_OPTIONS, open_input
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.registration import fitting_method, without_rates

T = TypeVar("T", EkfConfig, GimbalConfig, OverlayConfig)


class NodeConfigs(NamedTuple):
    """Hold the parameters of the three nodes, and the names of the parameters that are set."""

    ekf: EkfConfig
    gimbal: GimbalConfig
    overlay: OverlayConfig
    given: frozenset[str]  # full dotted names, of all three nodes, from files or options

    @property
    def files(self) -> list[PathLike]:
        """Return the files that the parameters name: map, style, elevation model, calibration."""
        overlay = self.overlay
        return [*map_files(overlay.map, overlay.style), *named_files(overlay.dem), overlay.camera]

    def fitting(self, topics: Collection[str], namespace: str) -> tuple[NodeConfigs, list[str]]:
        """Return the parameters for a bag with these topics, and notes.

        If no method is set, the topics choose it; a note says why if it is not the default.
        """
        if "method" in self.given:
            return self, []
        method, why = fitting_method(topics, namespace)
        fitted = self._replace(ekf=replace(self.ekf, method=method))
        return fitted, [why] if why else []

    def for_bag(self, reader: BagReader, namespace: str) -> tuple[NodeConfigs, list[str]]:
        """Return the parameters for a bag, as ``fitting``, also for one without an IMU's rates."""
        values = without_rates(reader, namespace, self.given)
        if not values:
            return self.fitting(reader.topics(), namespace)

        def fit(config: T) -> T:
            own = {name: value for name, value in values.items() if hasattr(config, name)}
            return replace(config, **own)

        words = ", ".join(f"{name} {value}" for name, value in values.items())
        note = f"{words}: imu/data has attitudes alone, without rates"
        fitted = fit(self.ekf), fit(self.gimbal), fit(self.overlay)
        return NodeConfigs(*fitted, self.given), [note]


def node_configs(
    params: Files,
    namespace: str = "",
    *,
    method: str | None = None,
    map: PathLike | None = None,  # noqa: A002 the option's name
    dem: PathLike | None = None,
    ground_height: float | None = None,
    camera: PathLike | None = None,
) -> NodeConfigs:
    """Return the parameters of ekf_node, gimbal_node and overlay_node from files (None: defaults).

    Each option that is not None overrides the files: ``method``; ``map``; ``dem``, which also
    unsets the ground's height; ``ground_height`` (ellipsoidal m); ``camera``, a calibration file.
    Raise ConfigError.
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
    if map is not None:
        overlay = replace(overlay, map=os.fspath(map))
    if camera is not None:
        overlay = replace(overlay, camera=os.fspath(camera))
    if not ekf.frame_ids == gimbal.frame_ids == overlay.frame_ids:
        raise ConfigError(
            "the nodes have different names of frames: set map_frame, base_link_frame, "
            "camera_frame and frame_prefix only once, under /**"
        )
    return NodeConfigs(ekf, gimbal, overlay, frozenset(given))


def configured_layers(overlay: OverlayConfig) -> list[MapLayer] | None:
    """Return the layers of the map of the parameters; None without a map. Raise MapError."""
    style = overlay.style, overlay.label_field
    return load_layers(overlay.map, *style, network=overlay.network) if overlay.map else None


class OpenedFlight(NamedTuple):
    """Hold a recorded flight and the nodes' parameters for it."""

    reader: BagReader
    configs: NodeConfigs  # with the method that fits the bag
    params: Files
    namespace: str
    notes: list[str]  # of the import, and why the method is not the default
    refused: Sequence[tuple[str, str]] = ()  # records (stills) that the import refused, and why


def open_flight(
    bag: PathLike,
    outputs: Sequence[PathLike | None],
    params: Files,
    namespace: str,
    options: Mapping[str, Any],
    *,
    inputs: Sequence[PathLike | None] = (),
    error: type[TirgeoError] = BagError,
    logs: LogOptions = NO_OPTIONS,
    progress: Report = silent,
) -> OpenedFlight:
    """Open a flight, with the parameters and with options of ``node_configs``.

    What is no bag is imported first, with ``logs``; its parameters count as those of a file
    before ``params``. Raise ``error`` if one of the outputs would overwrite an input (the bag, the
    parameters' files, or one of ``inputs``) or has no folder; BagError, LogError, ConfigError.
    """
    configs = node_configs(params, namespace, **options)
    check_outputs((bag, *inputs, *paths_of(params), *configs.files), outputs, error)
    read = open_input(bag, params, namespace, logs, progress)
    if read.params != paths_of(params):
        configs = node_configs(read.params, namespace, **options)
    configs, notes = configs.for_bag(read.reader, namespace)
    files, notes = read.params, read.notes + notes
    return OpenedFlight(read.reader, configs, files, namespace, notes, read.refused)


def values_without_rates(bag: PathLike, params: Files, namespace: str = "") -> dict[str, Any]:
    """Return the parameters, beside those of files, for the graph on a bag without an IMU's rates.

    Empty for any other bag, on which the filter itself finds out what it has, and for a file that
    is no bag, which the player refuses. Raise ConfigError.
    """
    with suppress(BagError):
        return without_rates(BagReader(bag), namespace, node_configs(params, namespace).given)
    return {}


#: Parameters that are already read, parameter files (later ones override), dotted names, or None.
Config: TypeAlias = NodeConfigs | Files | Mapping[str, Any]


def load_config(config: Config = None) -> NodeConfigs:
    """Read the parameters of filter, gimbal and camera once, for any number of calls.

    ``config`` is a ROS 2 parameter file or several, of which later ones override earlier ones; or
    a mapping of dotted names (``{"aircraft.rtk_antenna_m": [0.1, 0.0, 0.4]}``), which apply to
    every node that has them, as under ``/**`` in a file; or None for the defaults. Parameters that
    are already read are returned as they are. Raise ConfigError naming file and key.
    """
    if isinstance(config, NodeConfigs):
        return config
    if not isinstance(config, Mapping):
        return node_configs(config)
    config = {name: _plain(value) for name, value in config.items()}
    kinds = (EkfConfig, GimbalConfig, OverlayConfig)
    names = [{parameter.name for parameter in parameters_of(kind)} for kind in kinds]
    for name in config.keys() - set().union(*names):
        config_from(EkfConfig, {name: config[name]}, "config")  # raises, with the nearest name
    ekf, gimbal, overlay = (
        {name: value for name, value in config.items() if name in own} for own in names
    )
    return NodeConfigs(
        config_from(EkfConfig, ekf, "config"),
        config_from(GimbalConfig, gimbal, "config"),
        config_from(OverlayConfig, overlay, "config"),
        frozenset(config),
    )


def _plain(value: Any) -> Any:
    """Return a value in Python's types, because parameters cannot be NumPy's numbers or arrays."""
    arrays = isinstance(value, np.ndarray | np.generic | list | tuple)
    return np.asarray(value).tolist() if arrays else value
