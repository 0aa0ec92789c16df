"""An alignment is not deceived by what is wrong for a while, nor held up by it for ever."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from alignments import WAIT_S, aligned, assert_right, duration_s, samples_from, spoilt
from flights import config_for, flight

from tirgeo_ros.core.frames.rotations import quat_from_euler, quat_multiply
from tirgeo_ros.core.types.measurements import HeadingSample, ImuSample, Source

pytestmark = pytest.mark.slow


def higher(metres):
    return lambda s: replace(s, height_m=s.height_m + metres)


def aside(metres):
    return lambda s: replace(s, latitude_rad=s.latitude_rad + metres / 6.37e6)


def faster(metres_s):
    return lambda s: replace(s, velocity_n=s.velocity_n + np.array([metres_s, 0.0, 0.0]))


def turned(deg):
    return lambda s: replace(s, heading_rad=s.heading_rad + math.radians(deg))


def swung(roll_deg=0.0, yaw_deg=0.0):
    """The autopilot's attitude with an error."""
    roll = quat_from_euler(math.radians(roll_deg), 0.0, 0.0)
    yaw = quat_from_euler(0.0, 0.0, math.radians(yaw_deg))
    return lambda s: replace(
        s, autopilot_q_nb=quat_multiply(yaw, quat_multiply(s.autopilot_q_nb, roll))
    )


@pytest.mark.parametrize("at_s", [0.2, 0.5, 0.7, 0.9])
@pytest.mark.parametrize(
    ("kind", "change"),
    [
        (Source.RTK_POSITION, aside(30.0)),
        (Source.RTK_POSITION, higher(0.5)),
        (Source.RTK_VELOCITY, faster(3.0)),
        (Source.RTK_VELOCITY, faster(-0.5)),
        (Source.RTK_HEADING, turned(180.0)),
        (Source.RTK_HEADING, turned(20.0)),
    ],
)
@pytest.mark.parametrize("shape", ["hover", "figure_eight"])
def test_one_wrong_measurement_does_no_harm(shape, kind, change, at_s):
    flown = flight(7, 50.0, shape)
    clean = samples_from(flown, 9.3)
    samples = spoilt(clean, kind, change, at_s, at_s + 0.19)
    assert sum(a is not b for a, b in zip(samples, clean, strict=True)) == 1
    found, _ = aligned(samples, config_for(flown))
    assert_right(flown, found)
    assert duration_s(samples, found) < 3.0  # once it has left the window of 1 s


def test_flipped_headings_wait_for_the_autopilot_to_agree():
    """Two seconds of headings turned round: longer than the window, so all in it agree."""
    flown = flight(7, 50.0, "hover")
    samples = spoilt(samples_from(flown, 5.3), Source.RTK_HEADING, turned(180.0), 0.0, 2.0)
    found, _ = aligned(samples, config_for(flown))
    assert_right(flown, found)
    assert 2.0 < duration_s(samples, found) < 4.0


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (swung(roll_deg=20.0), "the tilt found and the orientation in imu/data differ by"),
        (swung(yaw_deg=15.0), "rtk/heading and the orientation in imu/data differ by"),
    ],
)
def test_a_wrong_autopilot_delays_but_does_not_block(change, reason):
    flown = flight(7, 50.0, "figure_eight")
    samples = spoilt(samples_from(flown, 5.3), Source.IMU, change)
    early = [s for s in samples if s.stamp_ns < samples[0].stamp_ns + 3_000_000_000]
    found, aligner = aligned(early, config_for(flown))
    assert found is None
    assert reason in aligner.reason
    found, _ = aligned(samples, config_for(flown))
    assert_right(flown, found)
    assert WAIT_S < duration_s(samples, found) < WAIT_S + 1.6


@pytest.mark.parametrize("yaw_deg", [25.0, -90.0, 180.0])
def test_a_heading_far_from_the_autopilots_is_never_waited_out(yaw_deg):
    """It is the antennas as likely as the compass: a person must look."""
    flown = flight(7, 50.0, "figure_eight")
    samples = spoilt(samples_from(flown, 5.3), Source.IMU, swung(yaw_deg=yaw_deg))
    found, aligner = aligned(samples, config_for(flown))
    assert found is None
    assert "aircraft.second_antenna_m" in aligner.reason


def test_one_glitch_of_the_autopilot_is_no_heading():
    """Method ekf: the last attitude before the window's end is 90 deg off."""
    flown = flight(7, 50.0, "hover")
    samples = spoilt(samples_from(flown, 5.3), Source.IMU, swung(yaw_deg=90.0), 0.995, 1.005)
    found, _ = aligned(samples, config_for(flown), use_heading=False)
    assert_right(flown, found)


@pytest.mark.parametrize(
    ("change", "use_heading", "reason"),
    [
        # Its attitude stays the same while the aircraft turns at 35 deg/s.
        (lambda first: {"autopilot_q_nb": first.autopilot_q_nb}, False, "follows the gyroscopes"),
        # Force in g: it cannot be gravity, neither by RTK nor by ordinary GPS.
        (None, True, "imu/data: a mean force of 1.0 m/s2 is not gravity"),
    ],
)
def test_an_imu_message_that_cannot_be_is_refused(change, use_heading, reason):
    flown = flight(7, 50.0, "figure_eight")
    samples = samples_from(flown, 9.3, length_s=20.0)

    def spoil(s):
        force = {"specific_force_b": s.specific_force_b / 9.8}
        return replace(s, **(change(samples[0]) if change else force))

    found, aligner = aligned(
        spoilt(samples, Source.IMU, spoil), config_for(flown), use_heading=use_heading
    )
    assert found is None
    assert reason in aligner.reason


def test_a_velocity_that_never_fits_gives_way_to_positions():
    """The velocity's sign is wrong, all the time."""
    flown = flight(7, 50.0, "figure_eight")
    samples = spoilt(
        samples_from(flown, 5.3),
        Source.RTK_VELOCITY,
        lambda s: replace(s, velocity_n=-s.velocity_n),
    )
    found, _ = aligned(samples, config_for(flown))
    assert_right(flown, found)
    assert WAIT_S < duration_s(samples, found) < WAIT_S + 3.0  # doubted from the first window on


def test_a_frozen_imu_does_not_align():
    flown = flight(7, 50.0, "hover")
    samples = samples_from(flown, 0.0)
    first = samples[0]
    same = {"specific_force_b": first.specific_force_b, "angular_rate_b": first.angular_rate_b}
    # It has lived for a moment: the same from the first sample on is a bench without noise.
    frozen = spoilt(samples, Source.IMU, lambda s: replace(s, **same), 0.05, 4.0)
    early = [s for s in frozen if s.stamp_ns < first.stamp_ns + 4_000_000_000]
    found, aligner = aligned(early, config_for(flown))
    assert found is None
    assert "frozen" in aligner.reason
    found, aligner = aligned(frozen, config_for(flown))
    assert_right(flown, found)
    assert 4.0 + 1.0 < duration_s(samples, found) < 4.0 + 1.0 + 0.5
    assert found.imu[0].stamp_ns > first.stamp_ns + 4_000_000_000


@pytest.mark.parametrize(("end_s", "begins_s"), [(0.95, 0.95), (0.85, 0.0)])
def test_no_window_spans_a_gap_of_the_imu(end_s, begins_s):
    """One of 0.25 s; 0.15 s are bridged."""
    flown = flight(7, 50.0, "hover")
    samples = samples_from(flown, 0.0)
    first = samples[0].stamp_ns
    holed = [
        s
        for s in samples
        if not (isinstance(s, ImuSample) and 0.7 < (s.stamp_ns - first) * 1e-9 < end_s)
    ]
    found, _ = aligned(holed, config_for(flown))
    assert_right(flown, found)
    assert begins_s + 1.0 <= duration_s(samples, found) < begins_s + 1.0 + 0.5


def test_headings_that_disagree_wait():
    """Half of them turned round: neither half is right by its number."""
    flown = flight(7, 50.0, "hover")
    samples = samples_from(flown, 5.3, length_s=4.0)
    count = 0

    def every_other(sample):
        nonlocal count
        count += 1
        return turned(180.0)(sample) if count % 2 else sample

    samples = [every_other(s) if isinstance(s, HeadingSample) else s for s in samples]
    found, aligner = aligned(samples, config_for(flown))
    assert found is None
    assert "rtk/heading disagree" in aligner.reason
