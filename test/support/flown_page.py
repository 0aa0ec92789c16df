"""The real nodes on the sample flight, and the page that they serve."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
from project import wait_until

from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.surveys.survey import load_survey
from tirgeo_ros.tools.graph.node_graph import free_domain
from tirgeo_ros.tools.replay.graph_outputs import read_outputs

LATENCY_NS = 50_000_000
START_S = 120.0


class FlownPage:
    """A command that serves the page of the real nodes, in a DDS domain of its own."""

    def __init__(self, folder: Path, *words: str | Path) -> None:
        self._log = folder / "log"
        with self._log.open("w") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tirgeo_ros.tools.cli.main", *map(str, words)],
                cwd=folder,
                env={**os.environ, "ROS_DOMAIN_ID": str(free_domain())},
                stdout=log,
                stderr=log,
            )

    @classmethod
    def of_bag(cls, sample: Path, folder: Path) -> FlownPage:
        """``tirgeo run --bag --page`` on the sample flight, at half speed for busy machines."""
        (folder / "slow.yaml").write_text("bag_player: {ros__parameters: {rate: 0.5}}\n")
        words = ["--bag", sample / "flight.mcap", "--map", sample / "map.geojson"]
        words += ["--params", sample / "params.yaml", "--params", folder / "slow.yaml"]
        return cls(folder, "run", *words, "--page", "127.0.0.1:0")

    @property
    def log(self) -> str:
        return self._log.read_text()

    @property
    def url(self) -> str:
        """Where the page is, as soon as the node says so."""
        return wait_until(
            lambda: re.search(r"the page is at (\S+)", self.log),
            START_S,
            running=self._process,
            tell=self._log.read_text,
        )[1]

    @property
    def pid(self) -> int:
        """The process that has started the nodes."""
        return self._process.pid

    def close(self) -> None:
        self._process.terminate()
        self._process.wait(60)


class TrueSight:
    """Where surveyed points truly are in the pictures of the sample flight."""

    def __init__(self, sample: Path) -> None:
        truth = read_outputs(sample / "truth.mcap")
        self._poses: PoseBuffer[CameraPose] = PoseBuffer(1e9)
        for pose in truth.cameras:
            self._poses.add(pose)
        self.plane = truth.plane
        self.points = [
            self.plane.ned_from_geodetic(one.latitude_rad, one.longitude_rad, one.height_m)
            for one in load_survey(sample / "survey.geojson")
        ]

    def in_view(self, stamp_ns: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return (north east down of a point, its pixel) of each one well inside a picture."""
        pose = self._poses.at(stamp_ns - LATENCY_NS)
        assert isinstance(pose, CameraPose)
        points = np.array(self.points)
        points_c = (points - pose.position_n) @ matrix_from_quat(pose.q_nc)
        pixels, valid = XT2.project(points_c)
        size = np.array([XT2.width, XT2.height])
        inside = (
            valid & (points_c[:, 2] > 1) & np.all((pixels > 60) & (pixels < size - 60), axis=1)
        )
        return [(points[k], pixels[k]) for k in np.flatnonzero(inside)]
