"""The gimbal's north over simulated flights: the camera's heading against its truth."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
import pytest

from tirgeo_ros.core.config import GimbalConfig
from tirgeo_ros.core.config.schema import config_from, values_of
from tirgeo_ros.core.frames.axes import BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import (
    matrix_from_quat,
    wrap_pi,
)
from tirgeo_ros.core.gimbal.composer import GimbalComposer
from tirgeo_ros.core.types.measurements import ImuSample, JointSample
from tirgeo_ros.core.types.poses import BodyPose
from tirgeo_ros.tools.replay.registration import composed
from tirgeo_ros.tools.simulate.flight import SimulatedFlight, fly
from tirgeo_ros.tools.simulate.scenario import scenario_from

DURATION_S = 60.0
SETTLED_S = 20.0
BODY_SIGMA = math.radians(0.1)
#: The encoder's noise of 0.02 deg, which the reported heading has too, at 4.5 sigma: three
#: thousand samples have none beyond; tan(30 deg) of it more by the camera's wander.
SAMPLE_DEG = 0.02 * 4.5 * 1.2
#: Of a reading in a still second: the nose may turn by 2 deg in the 3 s before it, and the
#: camera is 0.35 s behind.
READING_DEG = 0.35 * 2.0 / 3.0
#: The prior of 3 deg and a centred reading of hypot(0.2, 0.3) deg: so much of 3 deg stays.
PULL_DEG = 3.0 * (0.2**2 + 0.3**2) / (3.0**2 + 0.2**2 + 0.3**2)
BOUND_DEG = SAMPLE_DEG + READING_DEG + PULL_DEG


@functools.lru_cache(maxsize=8)
def flown(seed=1, shape="lawnmower", **north) -> SimulatedFlight:
    values = {f"gimbal.north_{name}": value for name, value in north.items()}
    return fly(
        scenario_from({"duration_s": DURATION_S, "route.shape": shape, "seed": seed, **values})
    )


def gimbal_config(flight, composition="paper", **north) -> GimbalConfig:
    values = {"composition": composition} | values_of(flight.scenario.aircraft, "aircraft.")
    values |= {f"north.{name}": value for name, value in north.items()}
    return config_from(GimbalConfig, values)


def bodies(flight) -> dict[int, BodyPose]:
    q_nb, truth = flight.truth.q_nb, flight.truth
    covariance = np.diag(np.array([0.01] * 3 + [BODY_SIGMA] * 3) ** 2)
    return {
        stamp: BodyPose(stamp, truth.position_p[k], q_nb[k], covariance)
        for k, stamp in enumerate(truth.stamp_ns)
    }


def camera_poses(flight, config, samples=None):
    """Every camera pose, by true poses of the body."""
    composer, known, poses = GimbalComposer(config), bodies(flight), []
    for sample in samples or [sample for _, sample in flight.samples]:
        body = known[sample.stamp_ns] if isinstance(sample, ImuSample) else None
        poses += composed(composer, sample, body)
    return composer, poses


def heading_rad(q_nc):
    forward = matrix_from_quat(q_nc) @ BODY_OPTICAL.T
    return np.arctan2(forward[..., 1, 0], forward[..., 0, 0])


class Headings(NamedTuple):
    t_s: np.ndarray
    error_deg: np.ndarray
    sigma_deg: np.ndarray

    def after(self, t_s, until_s=DURATION_S):
        keep = (self.t_s > t_s) & (self.t_s <= until_s)
        return Headings(*(column[keep] for column in self))


def headings(flight, poses) -> Headings:
    t_s = np.array([(p.stamp_ns - flight.scenario.start_ns) * 1e-9 for p in poses])
    _, q_pc = flight.gimbal.camera(t_s)
    error = wrap_pi(heading_rad(q_pc) - heading_rad(np.array([p.q_nc for p in poses])))
    sigma = np.sqrt([p.covariance[5, 5] for p in poses])
    return Headings(t_s, np.degrees(error), np.degrees(sigma))


def counts_and_headings(flight, **config):
    composer, poses = camera_poses(flight, gimbal_config(flight, **config))
    return composer.counts, headings(flight, poses)


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["lawnmower", "figure_eight"])
def test_a_bias_of_three_degrees_is_found_by_a_centred_gimbal(shape):
    counts, found = counts_and_headings(flown(shape=shape, bias_deg=3.0), centred=True)
    found = found.after(SETTLED_S)
    assert counts["north_used"] >= 1
    assert len(found.t_s) == pytest.approx(50 * (DURATION_S - SETTLED_S), abs=1)
    assert np.abs(found.error_deg).max() < BOUND_DEG
    assert np.all(np.abs(found.error_deg) < 3 * found.sigma_deg)
    assert found.sigma_deg.max() < 0.5  # of the 3 it began with


@pytest.mark.slow
def test_a_bias_that_nothing_shows_is_in_the_covariance():
    counts, found = counts_and_headings(flown(bias_deg=3.0))
    assert "north_used" not in counts
    np.testing.assert_allclose(found.error_deg, -3.0, atol=SAMPLE_DEG)
    assert np.all(np.abs(found.error_deg) < 3 * found.sigma_deg)
    assert found.sigma_deg[-1] > found.sigma_deg[0] > 3.0  # and it grows


@pytest.mark.slow
def test_a_step_in_flight_is_followed():
    """As when RTK is switched on: 4 deg at 30 s, on a leg on which the nose keeps still."""
    counts, found = counts_and_headings(flown(step_deg=4.0, step_s=30.0), centred=True)
    assert counts["north_reset"] == 1
    # two seconds until a mean is of the new bias alone, five of refused ones, one mean more
    after = found.after(30.0 + 2.0 + 5.0 + 1.0)
    assert np.abs(after.error_deg).max() < BOUND_DEG
    # nothing can tell of it before the first mean that has it in it is full
    for part in (found.after(0.0, 30.0), found.after(31.1)):
        assert np.all(np.abs(part.error_deg) < 3 * part.sigma_deg)


def test_heading_does_not_jump_when_joints_fall_silent():
    flight = flown(bias_deg=3.0)
    end_ns = flight.scenario.start_ns + 30_000_000_000
    samples = [
        sample
        for _, sample in flight.samples
        if not (isinstance(sample, JointSample) and sample.stamp_ns > end_ns)
    ]
    composer, poses = camera_poses(flight, gimbal_config(flight, "auto"), samples)
    counts = composer.counts
    assert (counts["joints_steady"], counts["joints_silent"]) == (1, 1)
    late = headings(flight, poses).after(32.0)
    assert composer.composition == "paper"
    assert len(late.t_s) == pytest.approx(50 * (DURATION_S - 32.0), abs=1)
    # the reading of the first two seconds: the reported roll's wander of 0.27 deg has 0.135 about
    # the vertical, slower than the mean over a second, taken at 3 sigma
    assert np.abs(late.error_deg).max() < SAMPLE_DEG + 3 * 0.135 + PULL_DEG
    assert np.all(np.abs(late.error_deg) < 3 * late.sigma_deg)
