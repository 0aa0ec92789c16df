"""Set up the methods that are compared, each with its parameters and its ground."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import median

from tirgeo_ros.core.config import METHODS
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.parameters.parameter_file import Files, paths_of
from tirgeo_ros.tools.replay.node_configs import NodeConfigs, node_configs

#: Name of the paper's own method, ``ekf_heading``, with a boresight calibration.
CALIBRATED = "calibrated"


@dataclass(frozen=True)
class MethodSetup:
    """Hold a method with its parameters."""

    method: str
    configs: NodeConfigs
    ground: Ground
    ground_words: str

    @property
    def latency_ns(self) -> int:
        """Return the time from an exposure to its picture's stamp (ns)."""
        return round(self.configs.overlay.video_latency_s * 1e9)


def method_setups(
    params: Files,
    boresight: PathLike | None,
    dem: PathLike | None,
    ground_height: float | None,
    namespace: str,
    survey_heights_m: Sequence[float],
    camera: PathLike | None = None,
) -> list[MethodSetup]:
    """Return the four methods of the paper, and ``calibrated`` with a boresight file.

    ``boresight`` overrides ``params``; ``dem`` or ``ground_height``, and ``camera``, override
    both. Without any ground it is level at the median of the survey's heights. Raise ConfigError,
    ElevationError.
    """
    asked = [(name, name, paths_of(params)) for name in METHODS]
    if boresight is not None:
        asked.append((CALIBRATED, "ekf_heading", [*paths_of(params), boresight]))
    grounds: dict[str, Ground | None] = {}
    setups = []
    for name, method, files in asked:
        configs = node_configs(
            files, namespace, method=method, dem=dem, ground_height=ground_height, camera=camera
        )
        key = repr(configs.overlay)
        if key not in grounds:  # an elevation model is large, so each is read once
            grounds[key] = ground_of(configs.overlay)
        ground, words = grounds[key], "level at {:.3f} m"
        if ground is None:
            ground, words = float(median(survey_heights_m)), f"{words}, the survey's median"
            configs = configs._replace(overlay=replace(configs.overlay, ground_height_m=ground))
        if isinstance(ground, Terrain):
            words = f"elevation model {os.fspath(configs.overlay.dem)}"
        else:
            words = words.format(ground)
        setups.append(MethodSetup(name, configs, ground, words))
    return setups


def setup_notes(setups: Sequence[MethodSetup], survey_heights_m: Sequence[float]) -> list[str]:
    """Return notes on grounds and methods, such as the survey's heights above level ground."""
    notes: list[str] = []
    for setup in setups:
        if isinstance(setup.ground, Terrain):
            notes += setup.ground.notes
        elif math.isfinite(setup.ground):
            off = [height - setup.ground for height in survey_heights_m]
            notes.append(
                f"ground {setup.ground_words}; the observed points' heights are "
                f"{min(off):+.2f} to {max(off):+.2f} m from it"
            )
    if setups[-1].method == CALIBRATED:
        notes.append(
            f"{CALIBRATED}: the accuracy is meaningful only on points that were not used for its "
            "boresight"
        )
    return list(dict.fromkeys(notes))
