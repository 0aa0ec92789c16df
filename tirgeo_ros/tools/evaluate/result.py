"""What an evaluation finds: numbers for the tables, and series for the plots.

East and north are metres of one projected plane (``Evaluation.projection``), true of scale to what
its name says. Attitudes are roll, pitch, yaw (rad) against north, east, down at the aircraft; yaw
is the heading, within -pi to pi. IntArray are int ns. Series are thinned to ``SERIES_HZ``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.accuracy.ground_errors import GroundErrors
from tirgeo_ros.core.camera.projection_covariance import CHI2_95
from tirgeo_ros.core.config.schema import Value
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.ground.ground_point import Ellipse
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.finding import Finding
from tirgeo_ros.tools.evaluate.projection import Projection
from tirgeo_ros.tools.evaluate.systematic import PixelMoves
from tirgeo_ros.tools.evaluate.t_test import PairedTest
from tirgeo_ros.tools.replay.recorded_flight import BodyErrors

#: The highest rate of the poses and attitudes that are kept for plots.
SERIES_HZ = 10.0


@dataclass(frozen=True, slots=True)
class ControlPoint:
    """A surveyed point in the projected plane."""

    id: str
    latitude_rad: float
    longitude_rad: float
    height_m: float  # ellipsoidal
    east_m: float
    north_m: float


@dataclass(frozen=True, slots=True)
class LocatedPoint:
    """One observation of a control point, located on the ground by one method."""

    id: str
    stamp_ns: int  # of the picture
    uv: tuple[float, float]  # column, row, px
    east_m: float
    north_m: float
    height_m: float  # of the ground there, ellipsoidal
    error_en: Array  # (2,) located less surveyed, m
    covariance_en: Array  # (2, 2) of the located point, as the method predicts it, m2
    ellipse: Ellipse  # of 95 %; its azimuth from the plane's north
    moves: PixelMoves | None = None  # the offset in the picture, with what may have made it

    @property
    def distance_m(self) -> float:
        """Horizontal error."""
        return float(np.hypot(*self.error_en))

    @property
    def is_inside(self) -> bool:
        """Whether the surveyed place lies in the ellipse of 95 %."""
        squared = self.error_en @ np.linalg.solve(self.covariance_en, self.error_en)
        return bool(squared <= CHI2_95)


def ground_errors(located: Sequence[LocatedPoint]) -> GroundErrors:
    """The horizontal errors of located points."""
    errors_en = np.array([one.error_en for one in located]).reshape(-1, 2)
    return GroundErrors([one.id for one in located], errors_en)


@dataclass(frozen=True, slots=True)
class RefusedPoint:
    """One observation that a method could not locate."""

    id: str
    stamp_ns: int
    uv: tuple[float, float]
    reason: str


@dataclass(frozen=True)
class Attitudes:
    """Attitudes at N instants."""

    stamp_ns: IntArray  # (N,)
    rpy: Array  # (N, 3) roll, pitch, yaw, rad

    def __len__(self) -> int:
        """Return the number of instants."""
        return len(self.stamp_ns)


@dataclass(frozen=True)
class PoseTrack(Attitudes):
    """Poses at N instants with what the method believes of them."""

    east_m: Array  # (N,)
    north_m: Array  # (N,)
    height_m: Array  # (N,) ellipsoidal
    sigma_position_n: Array  # (N, 3) north, east, down, m
    sigma_attitude_n: Array  # (N, 3) of the rotation about north, east, down, rad


@dataclass(frozen=True)
class FixTrack:
    """Antenna positions of a receiver at N instants, as they came."""

    stamp_ns: IntArray  # (N,)
    east_m: Array  # (N,)
    north_m: Array  # (N,)
    height_m: Array  # (N,) ellipsoidal
    status: npt.NDArray[np.int64]  # (N,) FixStatus: 2 fixed, 1 float, 0 single, -1 none


@dataclass(frozen=True)
class Innovations:
    """The filter's verdicts on one source's samples, of those that it compared with its state."""

    source: str  # rtk_position, rtk_velocity, rtk_heading, gps_position, gps_velocity
    stamp_ns: IntArray  # (N,) of the sample, or of the IMU's first after it where it was held
    #: (N, k) measured less predicted or the other way round, as the filter has it: m or m/s along
    #: north, east, down; rad.
    innovation: Array
    test_ratio: Array  # (N,) squared innovation over its gate; more than 1 is refused
    used: npt.NDArray[np.bool_]  # (N,)


@dataclass(frozen=True)
class Sensors:
    """What the flight's own instruments said, apart from any method."""

    rtk: FixTrack
    gps: FixTrack
    autopilot: Attitudes  # of the body
    gimbal: Attitudes  # of the camera body, as the flight controller reports it
    image_stamps_ns: IntArray  # (M,) of the bag's pictures, in order


@dataclass(frozen=True)
class MethodResult:
    """The experiment under one method."""

    method: str
    composition: str  # of the gimbal: paper or encoders
    state: str  # the filter's at the end
    ground: Ground
    ground_words: str
    located: Sequence[LocatedPoint]
    refused: Sequence[RefusedPoint]
    body: PoseTrack
    camera: PoseTrack  # attitude of the camera body: forward, right, down
    innovations: Sequence[Innovations]
    verdicts: Mapping[str, int]  # "source outcome" to number
    parameters: Mapping[str, Mapping[str, Value]]  # by node, by dotted name, as used
    #: The body's own errors once the filter has settled; None without a truth.
    against_truth: BodyErrors | None = None

    @cached_property
    def errors(self) -> GroundErrors:
        """The horizontal errors of what was located."""
        return ground_errors(self.located)


@dataclass(frozen=True, slots=True)
class Still:
    """A picture of the overlay."""

    caption: str
    jpeg: bytes


@dataclass(frozen=True)
class Checks:
    """What the observations and the survey say of each other and of the bag."""

    observations: int
    unknown_ids: Mapping[str, int]  # observed but not surveyed, to number; never located
    unobserved_ids: Sequence[str]
    #: Observations whose stamp is no picture's, and the largest distance to the nearest one;
    #: None where the bag has no pictures.
    off_pictures: int | None
    off_pictures_most_s: float | None


@dataclass(frozen=True)
class Evaluation:
    """The experiment."""

    bag: str
    survey_path: str
    observations_path: str
    projection: Projection
    control: Mapping[str, ControlPoint]  # every surveyed point by its id
    checks: Checks
    sensors: Sensors
    methods: Sequence[MethodResult]  # those that could be run, in the order of the paper
    missing: Mapping[str, str]  # method to the reason why it could not
    faults: Mapping[str, str]  # of these those whose topics the bag has
    tests: Sequence[PairedTest]  # each pair of ``methods`` once
    stills: Sequence[Still]  # of the last method; none where the bag has no pictures
    notes: Sequence[str]
    error: str | None  # what makes it a failure although there is a result
    findings: Sequence[Finding] = ()  # what is wrong with set-up or sensors, the worst first

    def method(self, name: str) -> MethodResult | None:
        """A method by its name, None where it is missing."""
        return next((one for one in self.methods if one.method == name), None)
