"""White noise of an IMU in flight, told between motion, lines and rest."""

from __future__ import annotations

import numpy as np
import pytest
from imu_noise import FLIGHT_DENSITY as DENSITY
from imu_noise import FLIGHT_HZ as RATE_HZ
from imu_noise import flown, record, white

from tirgeo_ros.core.calibration.allan.flight_noise import PIECE_S, pieces_of

STEP_S = 1 / RATE_HZ
DURATION_S = 120
T_S = np.arange(DURATION_S * RATE_HZ) * STEP_S


def noise(seed, density=DENSITY):
    return white(np.random.default_rng(seed), (len(T_S), 6), density, STEP_S)


def measured(values, lost=None):
    return pieces_of(record(values, STEP_S, lost))


@pytest.mark.parametrize("frequency_hz", [20.0, 61.3, 88.8])
def test_lines_are_found_with_frequency_and_amplitude(frequency_hz):
    values = flown(5, DURATION_S)
    values[:, 3] += 2.0 * np.sin(2 * np.pi * frequency_hz * T_S)
    found = measured(values)
    (line,) = found.lines(3)
    assert line.frequency_hz == pytest.approx(frequency_hz, abs=0.2)
    # The noise beneath is within 2 % of the line's power; the median takes it away but for its own
    # scatter.
    assert line.amplitude == pytest.approx(2.0, rel=0.02)
    assert found.lines(4) == []


def test_a_wandering_line_is_one():
    values = noise(6)
    hz = 50 + 4 * np.sin(2 * np.pi * T_S / 17)
    values[:, 5] += 8.0 * np.sin(2 * np.pi * np.cumsum(hz) * STEP_S)
    (line,) = measured(values).lines(5)
    assert line.frequency_hz == pytest.approx(50, abs=0.5)
    assert line.amplitude == pytest.approx(8.0, rel=0.03)


def test_what_motion_leaves_above_eight_hertz_is_no_line():
    values = noise(7)
    values[:, 0] += np.cumsum(np.random.default_rng(1).standard_normal(len(T_S))) * 0.02
    assert measured(values).lines(0) == []


def test_idling_rotors_and_slow_turns_are_no_rest():
    idling = noise(10, np.repeat([1.7e-4, 1.3e-2], 3))
    idling[:, 5] += 9.8 + 1.5 * np.sin(2 * np.pi * 42 * T_S)
    assert not measured(idling).at_rest.any()
    turning = noise(11, np.repeat([1.7e-4, 1.3e-2], 3))
    turning[:, 2] += 0.2
    assert not measured(turning).at_rest.any()


def test_a_few_lost_samples_are_bridged_and_gaps_passed_by():
    values = noise(13)
    lost = np.random.default_rng(2).random(len(values)) < 0.005
    lost[30 * RATE_HZ : 34 * RATE_HZ] = True
    found = measured(values, lost)
    assert len(found.floors) == DURATION_S // PIECE_S - 2
    # A sample on the line between its neighbours lacks part of the noise: 0.5 % of them do.
    np.testing.assert_allclose(np.median(found.floors, axis=0), DENSITY, rtol=0.045)


@pytest.mark.parametrize("rate_hz", [5, 10, 17, 18])
def test_a_record_too_slow_for_vibration_has_no_pieces(rate_hz):
    values = white(np.random.default_rng(0), (60 * rate_hz, 6), DENSITY, 1 / rate_hz)
    assert not len(pieces_of(record(values, 1 / rate_hz)).floors)
