"""Surveyed points located through the camera, and how far off they come out (section 5.1).

``python -m tirgeo_ros.tools.ground_points DIR`` prints, for a simulated flight, every method and
composition against the survey and against the flight's truth.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

import numpy as np

from tirgeo_ros.core.camera import Camera
from tirgeo_ros.core.config import METHODS, EkfConfig, GimbalConfig, OverlayConfig
from tirgeo_ros.core.errors import TirgeoError
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.locating import locate
from tirgeo_ros.core.pose_history import Miss, PoseHistory
from tirgeo_ros.core.samples import Array, CameraPose
from tirgeo_ros.io.parameter_file import ParameterFile
from tirgeo_ros.io.survey import Observation, SurveyPoint, load_observations, load_survey
from tirgeo_ros.tools.recording import (
    BodyErrors,
    body_errors,
    load_recording,
    load_truth,
    track_of,
)

#: The filter has settled after this; the paper's flight is judged from here on.
SETTLED_S = 20.0


@dataclass(frozen=True, slots=True)
class Located:
    """One observation of a surveyed point, located on the ground."""

    id: str
    stamp_ns: int
    error_n: Array  # (2,) north, east, located less surveyed, m

    @property
    def distance_m(self) -> float:
        """Horizontal error."""
        return float(np.hypot(*self.error_n))


@dataclass(frozen=True)
class GroundErrors:
    """The errors of all observations that could be located, and how many could not."""

    located: list[Located]
    missed: int

    @property
    def rmse_m(self) -> float:
        """Root mean square of all horizontal errors; nan without any."""
        return _rms([one.distance_m for one in self.located])

    @property
    def point_rmse_m(self) -> dict[str, float]:
        """Equation 24 for each point: over its observations."""
        by_point = defaultdict(list)
        for one in self.located:
            by_point[one.id].append(one.distance_m)
        return {name: _rms(distances) for name, distances in by_point.items()}

    @property
    def mean_point_rmse_m(self) -> float:
        """Mean of Equation 24 over the points, Table 6's last row; nan without any."""
        return fmean(self.point_rmse_m.values()) if self.located else math.nan


def _rms(errors: Iterable[float]) -> float:
    squares = [error * error for error in errors]
    return math.sqrt(fmean(squares)) if squares else math.nan


def locate_observations(
    poses: PoseHistory[CameraPose],
    plane: TangentPlane,
    camera: Camera,
    observations: Sequence[Observation],
    survey: Sequence[SurveyPoint],
    *,
    ground_height_m: float,
    video_latency_s: float,
) -> GroundErrors:
    """Locate every observation on the ground, level at ``ground_height_m`` (ellipsoidal).

    ``poses`` are in ``plane`` and must reach over the flight; an observation's pose is that of
    its image's exposure, stamp less ``video_latency_s``.
    """
    surveyed = {
        point.id: plane.ned_from_geodetic(point.latitude_rad, point.longitude_rad, point.height_m)
        for point in survey
    }
    latency_ns = round(video_latency_s * 1e9)
    located = []
    for seen in observations:
        pose = poses.at(seen.stamp_ns - latency_ns)
        if isinstance(pose, Miss) or seen.id not in surveyed:
            continue
        uv = np.array([[seen.u, seen.v]])
        points_n, reasons = locate(camera, pose, uv, plane, ground_height_m)
        if reasons[0] is None:
            error_n = (points_n[0] - surveyed[seen.id])[:2]
            located.append(Located(seen.id, seen.stamp_ns, error_n))
    return GroundErrors(located, len(observations) - len(located))


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table."""

    method: str
    composition: str
    ground: GroundErrors
    body: BodyErrors


def compare(folder: Path, methods: Sequence[str] = METHODS) -> list[Row]:
    """Every method and composition over the simulated flight in ``folder``."""
    truth, recording = load_truth(folder / "truth.mcap"), load_recording(folder / "flight.mcap")
    params = ParameterFile(folder / "params.yaml")
    ekf = dataclasses.replace(
        params.config("ekf_node", EkfConfig), origin_lat_lon_h=_origin(truth.plane)
    )
    gimbal = params.config("gimbal_node", GimbalConfig)
    overlay = params.config("overlay_node", OverlayConfig)
    survey = load_survey(folder / "survey.geojson")
    observations = load_observations(folder / "observations.csv")
    rows = []
    for method in methods:
        track = track_of(recording.samples, dataclasses.replace(ekf, method=method), gimbal)
        errors = body_errors(track.bodies, truth, SETTLED_S)
        for composition, poses in track.cameras.items():
            ground = locate_observations(
                poses,
                track.plane,
                recording.camera,
                observations,
                survey,
                ground_height_m=_ground_height_m(overlay, survey),
                video_latency_s=overlay.video_latency_s,
            )
            rows.append(Row(method, composition, ground, errors))
    return rows


def _origin(plane: TangentPlane) -> tuple[float, ...]:
    return math.degrees(plane.latitude_rad), math.degrees(plane.longitude_rad), plane.height_m


def _ground_height_m(overlay: OverlayConfig, survey: Sequence[SurveyPoint]) -> float:
    """As the parameters say, else the middle of the survey's heights."""
    if not math.isnan(overlay.ground_height_m):
        return overlay.ground_height_m
    return float(np.median([point.height_m for point in survey]))


_HEAD = ("method", "composition", "rmse", "points", "worst", "roll", "pitch", "heading", "pos.")
_UNITS = ("", "", "m", "m", "m", "deg", "deg", "deg", "m")


def table(rows: Sequence[Row]) -> str:
    """The rows as text; ``points`` is the mean of Equation 24, ``worst`` the largest."""
    lines = [_line(_HEAD), _line(_UNITS), *(_line(_cells(row)) for row in rows)]
    seen = [len(row.ground.located) + row.ground.missed for row in rows]
    located = min((len(row.ground.located) for row in rows), default=0)
    return "\n".join([*lines, f"located {located} of {max(seen, default=0)} observations"])


def _cells(row: Row) -> tuple[str, ...]:
    ground, body = row.ground, row.body
    worst = max(ground.point_rmse_m.values(), default=math.nan)
    angles = np.degrees([body.roll_rad, body.pitch_rad, body.heading_rad])
    return (
        row.method,
        row.composition,
        *(f"{m:.3f}" for m in (ground.rmse_m, ground.mean_point_rmse_m, worst)),
        *(f"{angle:.3f}" for angle in angles),
        f"{body.position_m:.3f}",
    )


def _line(cells: Sequence[str]) -> str:
    return f"{cells[0]:<12}{cells[1]:<12}" + "".join(f"{cell:>9}" for cell in cells[2:])


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table of a simulated flight's folder."""
    parser = argparse.ArgumentParser(prog="python -m tirgeo_ros.tools.ground_points")
    parser.add_argument("folder", type=Path, metavar="DIR", help="what tirgeo simulate wrote")
    try:
        sys.stdout.write(table(compare(parser.parse_args(argv).folder)) + "\n")
    except (TirgeoError, OSError) as error:
        sys.stderr.write(f"ground_points: {error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
