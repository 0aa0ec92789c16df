"""The track: spacing, bound, a new beginning."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.navigation.track import MOST_POINTS, Track
from tirgeo_ros.core.types.poses import BodyPose


def pose(stamp_ns: int, north_m: float) -> BodyPose:
    return BodyPose(stamp_ns, np.array([north_m, 0.0, -20.0]), np.eye(4)[0], np.eye(6))


def norths(track: Track) -> list[float]:
    return track.points()


def track_of_norths() -> Track:
    return Track(lambda body: float(body.position_n[0]))


def test_points_are_a_metre_apart_and_the_last_is_the_aircraft():
    track = track_of_norths()
    assert norths(track) == []
    for k in range(45):
        track.add(pose(k, 0.1 * k))
    np.testing.assert_allclose(norths(track), [0.0, 1.0, 2.0, 3.0, 4.0, 4.4], atol=1e-9)
    for k in range(45, 1000):
        track.add(pose(k, 4.4))  # a hover adds nothing
    assert len(norths(track)) == 6


def test_a_long_flight_stays_whole_in_few_points():
    track = track_of_norths()
    longest = 0
    for k in range(5000):
        track.add(pose(k, float(k)))
        longest = max(longest, len(norths(track)))
    found = norths(track)
    assert longest <= MOST_POINTS + 1
    assert (found[0], found[-1]) == (0.0, 4999.0)
    assert set(np.diff(found[:-1])) == {8.0}
    assert len(found) > MOST_POINTS / 2


def test_a_stamp_that_goes_back_begins_a_new_track():
    track = track_of_norths()
    for k in range(5):
        track.add(pose(k, float(k)))
    track.add(pose(1, 50.0))
    assert norths(track) == [50.0]
    track.clear()
    assert norths(track) == []
