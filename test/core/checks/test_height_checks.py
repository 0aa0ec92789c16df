"""Flights from and to the ground, and in the air alone, over grounds that are right and wrong."""

import math

import numpy as np
import pytest
from scenes import graticule

from tirgeo_ros.core.checks.height_checks import HeightChecks
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.poses import CameraPose

HOME_M = 150.0  # ellipsoidal height of the place of take-off
GEOID_M = 47.0
PLANE = TangentPlane(math.radians(48.0), math.radians(11.0), HOME_M)


def poses(heights_m, speed_m_s=0.0, shake_m=0.002):
    """Poses at 10 Hz at heights above the place of take-off, shaken as by RTK at rest."""
    rng = np.random.default_rng(3)
    for k, height_m in enumerate(heights_m):
        position_n = np.array([0.1 * k * speed_m_s, 0.0, -height_m])
        position_n += rng.normal(0.0, shake_m, 3)
        q_nb = np.array([1.0, 0.0, 0.0, 0.0])
        yield CameraPose(k * 100_000_000, position_n, q_nb, np.eye(6) * 1e-4)


def resting(above_m=0.4, seconds=6):
    return [above_m] * (10 * seconds)


CLIMB = list(np.linspace(0.4, 40.0, 200))
FLIGHT = [*resting(), *CLIMB, *[40.0] * 100]


def found(ground, heights_m, **motion):
    checks = HeightChecks(ground)
    checks.plane = PLANE
    for pose in poses(heights_m, **motion):
        checks.pose(pose)
    return checks.findings()


def model(height_m):
    return Terrain(np.full((3, 3), height_m), graticule((47.9, 10.9), (0.1, 0.1), 3))


@pytest.mark.parametrize("flight", [FLIGHT, FLIGHT[::-1]], ids=["take-off", "landing"])
@pytest.mark.parametrize("ground", [HOME_M, model(HOME_M)], ids=["plane", "model"])
def test_right_ground_says_nothing(flight, ground):
    assert found(ground, flight) == []


@pytest.mark.parametrize("flight", [FLIGHT, FLIGHT[::-1]], ids=["take-off", "landing"])
def test_ground_above_sea_level_is_told_at_rest(flight):
    [finding] = found(HOME_M - GEOID_M, flight)
    assert finding.check == "height_at_rest"
    assert "47.4 m above ground" in finding.evidence
    assert finding.parameter == "overlay_node ground_height_m"
    assert "above sea level" in finding.mend


def test_a_rest_is_remembered_however_long_the_flight():
    [finding] = found(HOME_M - GEOID_M, [*FLIGHT, *[40.0] * 2000])
    assert finding.check == "height_at_rest"


def test_a_model_above_sea_level_is_told_at_rest():
    [finding] = found(model(HOME_M - GEOID_M), FLIGHT)
    assert finding.severity is Severity.STOP
    assert "dem_undulation_m" in finding.parameter


@pytest.mark.parametrize("ground", [HOME_M + GEOID_M, model(HOME_M + GEOID_M)])
def test_below_the_ground_stops_whatever(ground):
    findings = found(ground, [40.0] * 60)
    assert [(one.check, one.severity) for one in findings] == [("below_ground", Severity.STOP)]
    assert "7.0 m below" in findings[0].evidence


def test_a_hover_is_no_rest():
    """Nothing is said of a flight that starts and ends in the air, however still it hangs."""
    assert found(HOME_M - GEOID_M, [20.0] * 300) == []
    assert found(HOME_M - GEOID_M, [*[20.0] * 100, *CLIMB[::-1], *CLIMB]) == []


def test_without_ground_or_model_nothing_is_said():
    assert found(None, FLIGHT) == []
    far = Terrain(np.full((3, 3), 0.0), graticule((10.0, 10.0), (0.1, 0.1), 3))
    assert found(far, FLIGHT) == []
