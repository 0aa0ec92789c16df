"""Read parameters from files or from a mapping, for the functions of the library."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np

from tirgeo_ros.core.config import EkfConfig, GimbalConfig, OverlayConfig
from tirgeo_ros.core.config.schema import config_from, parameters_of
from tirgeo_ros.io.parameters.parameter_file import Files
from tirgeo_ros.tools.replay.node_configs import NodeConfigs, node_configs

#: Parameters: read ones, parameter files (the later take precedence), dotted names, or None.
Config: TypeAlias = NodeConfigs | Files | Mapping[str, Any]


def load_config(config: Config = None) -> NodeConfigs:
    """Read the parameters of filter, gimbal and camera once, for any number of calls.

    ``config`` is a ROS 2 parameter file or several, of which the later take precedence; or a
    mapping of dotted names (``{"aircraft.rtk_antenna_m": [0.1, 0.0, 0.4]}``), which apply to every
    node that has them, as under ``/**`` in a file; or None for the defaults. Parameters that were
    read before are returned as they are. Raises ConfigError naming file and key.
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
        {name: value for name, value in config.items() if name in known} for known in names
    )
    return NodeConfigs(
        config_from(EkfConfig, ekf, "config"),
        config_from(GimbalConfig, gimbal, "config"),
        config_from(OverlayConfig, overlay, "config"),
        frozenset(config),
    )


def _plain(value: Any) -> Any:
    """Return a value as Python has it: NumPy's numbers and arrays are no types of a parameter."""
    arrays = isinstance(value, np.ndarray | np.generic | list | tuple)
    return np.asarray(value).tolist() if arrays else value
