"""Define the result of an evaluation: numbers for the tables, and series for the plots.

East and north are metres in one projected plane (``Evaluation.projection``), true to scale as its
name says. Attitudes are roll, pitch, yaw (rad) relative to north, east, down at the aircraft; yaw
is the heading, within -pi to pi. Stamps are int ns. Series are thinned to ``SERIES_HZ``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.accuracy.ground_errors import GroundErrors
from tirgeo_ros.core.camera.projection_covariance import CHI2_95
from tirgeo_ros.core.ground.ground_point import Ellipse
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.finding import Finding
from tirgeo_ros.tools.evaluate.methods import MethodSetup
from tirgeo_ros.tools.evaluate.projection import Projection
from tirgeo_ros.tools.evaluate.systematic import PixelMoves
from tirgeo_ros.tools.evaluate.t_test import PairedTest
from tirgeo_ros.tools.replay.recorded_flight import BodyErrors

#: Highest rate of the poses and attitudes that are kept for plots.
SERIES_HZ = 10.0


class ControlPoint(NamedTuple):
    """Hold a surveyed point in the projected plane."""

    id: str
    latitude_rad: float
    longitude_rad: float
    height_m: float  # ellipsoidal
    east_m: float
    north_m: float


@dataclass(frozen=True, slots=True)
class LocatedPoint:
    """Hold one observation of a control point, located on the ground by one method."""

    id: str
    stamp_ns: int  # of the picture
    uv: tuple[float, float]  # column, row, px
    east_m: float
    north_m: float
    height_m: float  # ellipsoidal height of the ground there
    error_en: Array  # (2,) located minus surveyed, m
    covariance_en: Array  # (2, 2) of the located point, as the method predicts it, m2
    ellipse: Ellipse  # 95 % ellipse; azimuth from the plane's north
    moves: PixelMoves | None = None  # pixel offset and the effect of possible causes

    @property
    def distance_m(self) -> float:
        """Return the horizontal error."""
        return float(np.hypot(*self.error_en))

    @property
    def is_inside(self) -> bool:
        """Return whether the surveyed position is inside the 95 % ellipse."""
        squared = self.error_en @ np.linalg.solve(self.covariance_en, self.error_en)
        return bool(squared <= CHI2_95)


def ground_errors(located: Sequence[LocatedPoint]) -> GroundErrors:
    """Return the horizontal errors of located points."""
    errors_en = np.array([one.error_en for one in located]).reshape(-1, 2)
    return GroundErrors([one.id for one in located], errors_en)


class RefusedPoint(NamedTuple):
    """Hold one observation that a method could not locate."""

    id: str
    stamp_ns: int
    uv: tuple[float, float]
    reason: str


@dataclass(frozen=True)
class AttitudeSeries:
    """Hold attitudes at N instants."""

    stamp_ns: IntArray  # (N,)
    rpy: Array  # (N, 3) roll, pitch, yaw, rad

    def __len__(self) -> int:
        """Return the number of instants."""
        return len(self.stamp_ns)


@dataclass(frozen=True)
class PoseTrack(AttitudeSeries):
    """Hold poses at N instants, with the standard deviations that the method predicts."""

    place_en: Array  # (N, 2) east, north, m
    height_m: Array  # (N,) ellipsoidal
    sigma_position_n: Array  # (N, 3) north, east, down, m
    sigma_attitude_n: Array  # (N, 3) of the rotation about north, east, down, rad


class FixTrack(NamedTuple):
    """Hold antenna positions of a receiver at N instants, as they came."""

    stamp_ns: IntArray  # (N,)
    place_en: Array  # (N, 2) east, north, m


class Innovations(NamedTuple):
    """Hold the filter's innovations for one source, of the samples that it compared."""

    source: str  # rtk_position, rtk_velocity, rtk_heading, gps_position, gps_velocity
    stamp_ns: IntArray  # (N,) of the sample; for one held back, of the next IMU sample
    #: (N, k) measured minus predicted or the reverse, as in the filter: m or m/s along north,
    #: east, down; rad.
    innovation: Array
    test_ratio: Array  # (N,) squared innovation over its gate; above 1 is refused
    used: npt.NDArray[np.bool_]  # (N,)


@dataclass(frozen=True)
class Sensors:
    """Hold the data of the flight's own instruments, independent of any method."""

    rtk: FixTrack
    gps: FixTrack
    autopilot: AttitudeSeries  # of the body
    gimbal: AttitudeSeries  # of the camera body, as the flight controller reports it


@dataclass(frozen=True)
class MethodResult:
    """Hold the experiment's result under one method."""

    setup: MethodSetup
    composition: str  # of the gimbal: paper or encoders
    state: str  # the filter's at the end
    located: Sequence[LocatedPoint]
    refused: Sequence[RefusedPoint]
    body: PoseTrack
    camera: PoseTrack  # attitude of the camera body: forward, right, down
    innovations: Sequence[Innovations]
    verdicts: Mapping[str, int]  # "source outcome" -> number
    #: Errors of the body's poses after the filter has settled; None without a truth.
    against_truth: BodyErrors | None

    @property
    def method(self) -> str:
        """Return the method's name."""
        return self.setup.method

    @cached_property
    def errors(self) -> GroundErrors:
        """Return the horizontal errors of the located points."""
        return ground_errors(self.located)


class Still(NamedTuple):
    """Hold a picture of the overlay."""

    caption: str
    jpeg: bytes


@dataclass(frozen=True)
class InputChecks:
    """Hold the comparison of observations, survey and pictures."""

    observations: int
    unknown_ids: Mapping[str, int]  # observed but not surveyed id -> number; never located
    unobserved_ids: Sequence[str]
    #: Number of observations whose stamp is no picture's, and the longest time (s) to the nearest
    #: picture; None if the bag has no pictures.
    off_pictures: int | None
    off_pictures_most_s: float | None


@dataclass(frozen=True)
class Evaluation:
    """Hold the whole experiment."""

    bag: str
    survey_path: str
    observations_path: str
    projection: Projection
    control: Mapping[str, ControlPoint]  # every surveyed point by its id
    checks: InputChecks
    sensors: Sensors
    methods: Sequence[MethodResult]  # those that could be run, in the order of the paper
    missing: Mapping[str, str]  # method -> the reason why it could not be run
    faults: Mapping[str, str]  # those of ``missing`` whose topics the bag has
    tests: Sequence[PairedTest]  # each pair of ``methods`` once
    stills: Sequence[Still]  # of the last method; empty if the bag has no pictures
    notes: Sequence[str]
    error: str | None  # what makes the run a failure although there is a result
    findings: Sequence[Finding]  # problems of set-up or sensors, the worst first

    def method(self, name: str) -> MethodResult | None:
        """Return a method by its name, or None if it is missing."""
        return next((one for one in self.methods if one.method == name), None)
