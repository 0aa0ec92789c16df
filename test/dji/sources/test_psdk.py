"""The topics of psdk_ros2 as a road: times, flags of the same epoch, and what stands in."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.types.measurements import FixStatus, HeadingSample, ImuSample, PositionSample
from tirgeo_ros.dji.interpret import Interpreter
from tirgeo_ros.dji.sources.psdk import PsdkDecoder
from tirgeo_ros.dji.sources.readings import GpsReading
from tirgeo_ros.dji.sources.rtk_flag_pairing import HOLD_NS

MS = 1_000_000
SECOND = 1000 * MS
START = 1_700_000_000 * SECOND
EPOCH = 200 * MS
HOME = (52.0, 13.0, 80.0)
LEVEL_EAST = (1.0, 0.0, 0.0, 0.0)
IMU = (LEVEL_EAST, (0.0, 0.0, 0.0), (0.0, 0.0, 9.8))


@pytest.fixture
def road():
    return PsdkDecoder()


def near(metres: float) -> tuple[float, float, float]:
    """So much to the north of home."""
    return HOME[0] + metres / 111e3, HOME[1], HOME[2]


def test_receivers_keep_the_stamps_of_their_headers(road):
    """Their delay is a parameter, which is taken off later."""
    (position,) = road.take("gps_position", HOME, START, START + 3 * MS)
    (velocity,) = road.take("gps_velocity", (1.0, 2.0, 3.0), START + 1, START + 3 * MS)
    (details,) = road.take("gps_details", (3.0, (1e3, 2e3, 10.0)), START + 2, START + 3 * MS)
    assert [r.stamp_ns - START for r in (position, velocity, details)] == [0, 1, 2]
    # North, east, down, as it comes.
    assert velocity.velocity_n == (1.0, 2.0, 3.0)
    road.take("rtk_position", HOME, START, START + 3 * MS)
    (fixed,) = road.take("rtk_position_info", 50, 0, START + 4 * MS)
    assert fixed.stamp_ns == START
    assert fixed.position_flag == 50
    (moving,) = road.take("rtk_velocity", (1.0, 2.0, 3.0), START + 1, START + 5 * MS)
    assert moving.position_flag == 50
    assert (moving.stamp_ns, moving.velocity_n) == (START + 1, (1.0, 2.0, 3.0))


def test_streams_of_a_steady_rate_lose_their_jitter(road):
    """At 100 Hz, with the delays of a callback: up to 8 ms, none of it negative."""
    late = np.random.default_rng(3).exponential(1.5 * MS, 3000).clip(0, 8 * MS).astype(int)
    sent = START + np.arange(3000) * 10 * MS
    for take in (
        lambda at: road.take("imu", IMU, at, at),
        lambda at: road.take("attitude", LEVEL_EAST, at, at),
        lambda at: road.take("gimbal_angles", (0.0, 0.0, 0.0), at, at),
    ):
        stamps = [take(int(at))[0].stamp_ns for at in np.maximum.accumulate(sent + late)]
        assert all(b > a for a, b in pairwise(stamps))
        # The second half, as the first may learn; 0.1 ms is what the clock calls settled.
        off = (np.array(stamps) - sent)[1500:]
        assert late[1500:].std() > 1 * MS
        assert off.std() < 0.1 * MS


def test_what_waits_in_vain_goes_when_it_is_due(road):
    road.take("rtk_position", HOME, START, START)
    road.take("rtk_velocity", (1.0, 2.0, 3.0), START, START)
    road.take("rtk_yaw", 90, START, START)
    assert road.due(START + HOLD_NS - 1) == []
    place, velocity, yaw = road.due(START + HOLD_NS)
    assert (place.place is None, velocity.velocity_n, yaw.yaw_deg) == (False, (1.0, 2.0, 3.0), 90)
    assert [r.position_flag or r.yaw_flag for r in (place, velocity, yaw)] == [None, None, None]
    assert road.counts == {
        "rtk_position_alone": 1,
        "rtk_velocity_alone": 1,
        "rtk_yaw_alone": 1,
    }


@pytest.mark.parametrize("flag_after_ns", [-5 * MS, 5 * MS])
def test_a_fix_that_is_lost_is_lost_at_once(road, flag_after_ns):
    """Not an epoch later, whether the flag comes before the position or after it."""
    meaning, given = Interpreter(DjiConfig(geoid_undulation_m=40.0)), {}
    for number, flag in enumerate([50, 50, 34, 34, 50]):
        at = START + number * EPOCH
        events = [
            (at, lambda at=at, n=number: road.take("rtk_position", near(n), at, at)),
            (at + flag_after_ns, lambda at=at, f=flag: road.take("rtk_position_info", f, 0, at)),
        ]
        readings = [r for _, event in sorted(events, key=lambda e: e[0]) for r in event()]
        samples = [sample for r in readings for sample in meaning.take(r)]
        (given[number],) = (s for s in samples if isinstance(s, PositionSample))
        assert given[number].latitude_rad == pytest.approx(math.radians(near(number)[0]))
        assert given[number].height_m == pytest.approx(HOME[2] + 40.0)
    fixed, floating = FixStatus.FIXED, FixStatus.FLOAT
    assert [s.status for s in given.values()] == [fixed, fixed, floating, floating, fixed]


def test_heading_and_force_as_they_go_on(road):
    """Antennas 90 deg to the right of a nose to the south: 270, sent as 65446."""
    meaning = Interpreter(DjiConfig(geoid_undulation_m=40.0))
    readings = road.take("imu", IMU, START, START)
    readings += road.take("rtk_yaw", 65446, START, START)
    readings += road.take("rtk_yaw_info", 50, 0, START + MS)
    samples = [sample for r in readings for sample in meaning.take(r)]
    (force,) = (s.specific_force_b for s in samples if isinstance(s, ImuSample))
    # 9.8 is one g, and that is the standard's.
    assert force == pytest.approx([0.0, 0.0, -9.80665], abs=1e-12)
    (heading,) = (s.heading_rad for s in samples if isinstance(s, HeadingSample))
    assert heading == pytest.approx(math.pi)


def test_fused_values_stand_in_for_a_silent_receiver_alone(road):
    fused, came = HOME, {}
    for tick in range(100):  # 10 s at 10 Hz; the receiver's own come in the first three
        at = START + tick * 100 * MS
        if tick < 30 and tick % 2 == 0:
            (own,) = road.take("gps_position", HOME, at, at)
            assert own.vertical_sigma_m is None
            road.take("gps_velocity", (1.0, 2.0, 3.0), at, at)
        readings = road.take("gps_position_fused", fused, at, at)
        readings += road.take("velocity_ground_fused", (2.0, 1.0, -3.0), at, at)
        if readings:
            came[tick] = readings
    # The last own ones are at 2.8 s: from 4.8 s on, each second one, as 0.1 s is too early.
    assert list(came) == list(range(48, 100, 2))
    for place, velocity in came.values():
        assert place.place.height_msl_m == HOME[2]
        assert place.vertical_sigma_m == 200.0
        assert velocity == GpsReading(velocity.stamp_ns, velocity_n=(1.0, 2.0, 3.0))
    assert road.counts["fused"] == 2 * len(came)


@pytest.mark.parametrize(("rate_hz", "warnings"), [(1, 1), (50, 0)])
def test_a_gimbal_at_the_default_rate_is_told(road, rate_hz, warnings):
    for number in range(10):
        at = START + number * SECOND // rate_hz
        road.take("gimbal_angles", (0.0, 0.0, 0.0), at, at)
    assert len(road.warnings) == warnings
    assert all("gimbal_data to 50" in warning for warning in road.warnings)
