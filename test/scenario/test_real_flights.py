"""Recorded flights at default parameters: what the table of ``make real-flights`` asks.

Bounds are those of that table, ``dev/real_flights_table.py``; each test says what it stands for.
The bags lie beside the project, and tests skip where they are not.
"""

from __future__ import annotations

import math

import pytest

from dev.real_flights_judged import (
    beyond,
    groups,
    judge_all,
    mean_nis,
    mean_tilt_deg,
    median,
    used_of,
)
from dev.real_flights_table import (
    ASKED,
    ASKED_BEYOND,
    ASKED_MOVED_M,
    ASKED_POSE,
    ASKED_USED,
    ASKED_USED_EACH,
    bags_in,
)
from tirgeo_ros.core.types.measurements import Source

pytestmark = pytest.mark.slow

P4, WALK = "p4rtk, positions", "walk, positions, velocities"
BAGS = (
    *(f"p4rtk_horizontal_{name}" for name in ("03", "06", "09", "15", "18", "24")),
    *(f"p4rtk_horizontal_{name}_differenced_velocity" for name in ("09", "24")),
    *(f"p4rtk_vertical_{name}" for name in ("03", "15", "24")),
    "walk_0827",
)


@pytest.fixture(scope="module")
def found(shared):
    folder = shared / "real_flights"
    if not folder.is_dir():
        pytest.skip(f"no {folder}: the recorded flights are absent")
    return {each.name: each for each in judge_all(bags_in(folder), {}, workers=2)}


@pytest.fixture(scope="module")
def by_group(found):
    return groups(list(found.values()))


def cuts_of_group(bags):
    return [cut for each in bags for cut in each.cuts]


@pytest.mark.parametrize("name", BAGS)
def test_a_flight_is_held(found, name):
    """Fixes used >= 94 % in each bag, never lost, no reset, a pose for >= 95 % of the time."""
    each = found[name]
    assert each.flown.fixes > 100  # 10 Hz, or 4 on the walk, for more than 10 s
    assert each.used >= ASKED_USED_EACH
    assert each.flown.lost_s == 0
    assert each.flown.resets == 0
    assert each.flown.pose >= ASKED_POSE


@pytest.mark.parametrize("name", BAGS)
def test_a_position_that_is_wrong_for_a_second_is_not_followed(found, name):
    """0.5 m for 1 s moves the pose by 0.5 m at the most; used, it would show at once."""
    each = found[name]
    assert max(each.moved_m) <= ASKED_MOVED_M
    assert min(each.moved_m) > 0  # each of them was heard


def test_fixes_are_used_and_errors_are_within_their_sigmas(found):
    """>= 97 % of all fixes; beyond 5 own sigma <= 1 % of the poses."""
    bags = list(found.values())
    assert used_of(bags) >= ASKED_USED
    assert beyond(bags) <= ASKED_BEYOND


def test_tilt_is_the_autopilots_by_positions_alone(by_group):
    """Roll 1.3, pitch 1.6 deg rms, mean over bags; the autopilot's own is good to about 1 deg."""
    roll_deg, pitch_deg = mean_tilt_deg(by_group[P4])
    asked_roll_deg, asked_pitch_deg = ASKED[P4].roll_pitch_deg
    assert roll_deg <= asked_roll_deg
    assert pitch_deg <= asked_pitch_deg


def test_innovations_are_as_large_as_expected(by_group):
    """NIS over its degrees of freedom 0.5 to 1.5, mean over bags with positions alone."""
    low, high = ASKED[P4].nis
    assert low <= mean_nis(by_group[P4], Source.RTK_POSITION) <= high


def test_the_p4_without_rtk_for_five_seconds(by_group):
    """Median <= 2.0 m, >= 95 % within 3 own sigma, own sigma (median) <= 3.2 m."""
    cuts, asked = cuts_of_group(by_group[P4]), ASKED[P4]
    assert len(cuts) == 44  # of nine flights at three phases
    assert not any(math.isnan(cut.error_m) for cut in cuts)
    assert median([cut.error_m for cut in cuts]) <= asked.cut_m
    assert sum(cut.within(3) for cut in cuts) >= asked.within * len(cuts)
    assert median([cut.sigma_m for cut in cuts]) <= asked.sigma_m


def test_the_walk_without_rtk_for_five_seconds(by_group):
    """Used >= 98 %, median <= 0.4 m: noise that is right in flight is wrong on foot."""
    (walk,) = by_group[WALK]
    assert walk.used >= ASKED[WALK].used
    assert len(walk.cuts) == 27
    assert median([cut.error_m for cut in walk.cuts]) <= ASKED[WALK].cut_m
