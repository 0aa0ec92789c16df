"""What an acceleration counts in, told by its size: fast, and never in a wrong unit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from aircraft_readings import KIT, imu, t_ms, taken
from hypothesis import given, settings
from hypothesis import strategies as st

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.dji.interpret import Interpreter
from tirgeo_ros.dji.interpret.accelerometer_unit import G_M_S2
from tirgeo_ros.dji.sources.readings import AccelerationUnit

UNKNOWN = AccelerationUnit.UNKNOWN


def interpreter(unit="auto"):
    return Interpreter(DjiConfig(geoid_undulation_m=40.0, acceleration_unit=unit, aircraft=KIT))


def readings(seconds, mean, rate_hz=100.0, shake=0.0, seed=1, start_s=0.0):
    """Readings of no told unit about a mean, with vibration of ``shake`` rms an axis."""
    rng = np.random.default_rng(seed)
    for k in range(round(seconds * rate_hz)):
        acceleration = tuple((np.array(mean) + shake * rng.standard_normal(3)).tolist())
        yield imu(1e3 * (start_s + k / rate_hz), acceleration, UNKNOWN)


def sizes(samples):
    return [float(np.linalg.norm(sample.specific_force_b)) for sample in samples]


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 200.0, 400.0])
@pytest.mark.parametrize(("size", "unit"), [(1.0, "g"), (G_M_S2, "m/s2")])
def test_the_unit_is_told_in_half_a_second(rate_hz, size, unit):
    meant = interpreter()
    samples = taken(meant, readings(0.5, (0.0, 0.0, -size), rate_hz))
    # Nothing is lost: what was held back comes out with the decision.
    assert len(samples) == 0.5 * rate_hz
    assert [t_ms(s) for s in samples] == pytest.approx(
        [1e3 * k / rate_hz for k in range(len(samples))]
    )
    np.testing.assert_allclose(sizes(samples), G_M_S2, rtol=1e-12)
    assert meant.counts == {}
    assert meant.diagnostics["acceleration_unit"].startswith(f"{unit} (by its size")


@settings(max_examples=60)
@given(
    st.sampled_from([1.0, G_M_S2]),
    st.floats(0.6, 1.6),
    st.floats(0, 1.0),
    st.floats(0, 0.6),
    st.floats(-math.pi, math.pi),
    st.integers(0, 100),
)
def test_the_unit_is_told_in_flight_with_vibration(unit, load, shake, tilt, azimuth, seed):
    """Between 0.6 and 1.6 g, at any tilt of a turn, with vibration of up to 1 g rms on each axis.

    The mean of 41 readings has a scatter of 0.16 of it (a hundredth more for what is trimmed):
    no more vibration than keeps 4.5 sigma inside the bounds, which are half and twice gravity.
    """
    across = load * math.sin(tilt)
    mean = (across * math.cos(azimuth), across * math.sin(azimuth), -load * math.cos(tilt))
    shake = min(shake, min(load - 0.5, 2.0 - load) / (4.5 * 0.16))
    meant = interpreter()
    samples = taken(meant, readings(0.5, unit * np.array(mean), shake=unit * shake, seed=seed))
    assert len(samples) == 50
    average = np.mean([sample.specific_force_b for sample in samples], 0)
    np.testing.assert_allclose(average, G_M_S2 * np.array(mean), atol=6 * G_M_S2 * shake / 50**0.5)


@pytest.mark.parametrize("wild", [30.0, 399.0, 1e30, 3.4e38])
def test_wild_readings_do_not_decide(wild):
    meant = interpreter()
    given_readings = list(readings(0.6, (0.0, 0.0, -1.0)))
    for k in (3, 17, 30):
        given_readings[k] = given_readings[k]._replace(acceleration_b=(wild, 0.0, wild))
    samples = taken(meant, given_readings)
    assert len(samples) + meant.counts.get("imu_refused", 0) == 60
    assert meant.diagnostics["acceleration_unit"].startswith("g ")


@pytest.mark.parametrize("size", [0.0, 0.3, 3.0, 30.0])
def test_without_gravity_there_is_no_imu(size):
    meant = interpreter()
    assert taken(meant, readings(3.0, (0.0, 0.0, -size))) == []
    assert meant.counts == {"imu_without_gravity": 300}
    (warning,) = meant.warnings
    assert "gravity neither in g nor in m/s2" in warning
    assert "Set raw acceleration data in DJI Assistant 2 (SDK)" in warning
    assert meant.diagnostics["acceleration_unit"].startswith("fused, without gravity")


def test_set_right_in_flight_it_recovers():
    meant = interpreter()
    assert taken(meant, readings(5.0, (0.1, 0.0, 0.0))) == []
    samples = taken(meant, readings(9.0, (0.0, 0.0, -1.0), start_s=5.0))
    # Three looks of 2 s, the first of which begins up to 2 s before.
    assert len(samples) > 100
    np.testing.assert_allclose(sizes(samples), G_M_S2, rtol=1e-12)
    assert meant.counts["acceleration_unit_changes"] == 1
    assert meant.warnings == []


# What waits


def test_at_the_end_what_waits_comes_out_in_its_unit():
    meant = interpreter()
    assert taken(meant, readings(0.1, (0.0, 0.0, -1.0))) == []
    np.testing.assert_allclose(sizes(meant.flush()), [G_M_S2] * 10, rtol=1e-12)
    assert meant.flush() == []
    assert meant.counts == {}


# The parts
