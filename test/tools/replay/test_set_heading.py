"""A heading that a person has set is in the bag, and process takes it as the node did."""

from __future__ import annotations

import math

from flights import flight
from hover_bags import write_hover
from process_bags import messages_of

from tirgeo_ros.core.frames.heading import heading_of, wrapped
from tirgeo_ros.core.types.measurements import SetHeading
from tirgeo_ros.io.messages import body_pose
from tirgeo_ros.tools.replay.process import process

SIGMA = math.radians(2.0)


def test_a_set_heading_in_a_bag_begins_the_filter(tmp_path):
    flown = flight(1, 6.0, "hover")
    begin_ns, true_rad = flown.truth.stamp_ns[0], heading_of(flown.truth.q_nb[0])
    told = SetHeading(begin_ns + 3_000_000_000, true_rad + SIGMA, SIGMA**2)
    poses = []
    for name, given in (("without", None), ("with", told)):
        bag = write_hover(tmp_path / f"{name}.mcap", flown, given)
        out = tmp_path / f"{name}_out.mcap"
        process(bag, out, method="ekf", images=False)
        poses.append([body_pose(one) for _, one in messages_of(out, "/tirgeo/odometry")])
    silent, flying = poses
    assert not silent
    assert flying[0].stamp_ns - told.stamp_ns < 1_500_000_000
    off_rad = wrapped(heading_of(flying[0].q_nb) - true_rad)
    assert abs(off_rad - SIGMA) < 0.5 * SIGMA  # it is what was said, turned with the aircraft
