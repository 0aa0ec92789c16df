# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""The judge of recorded flights, on a simulated one and on what is made up."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flights import flight, navigation_samples
from process_bags import write_samples

from dev.flight_errors import fitting_config
from dev.real_flights import (
    ASKED,
    CUT_S,
    Flown,
    Judged,
    Miss,
    fly_bag,
    groups,
    hidden_fixes,
    main,
    report,
)
from tirgeo_ros.core.types.measurements import HeadingSample, ImuSample, Source

DURATION_S = 30.0


@pytest.fixture(scope="module")
def samples():
    return navigation_samples(flight(5, DURATION_S))


@pytest.fixture(scope="module")
def config():
    return fitting_config(flight(5, DURATION_S))


def test_a_simulated_flight_is_as_good_as_it_is(config, samples):
    flown = fly_bag(config, samples)
    # RTK at 5 Hz for 22 s, less what arrives (80 ms late) after the end of the judged time.
    assert flown.fixes == pytest.approx(5 * 22, abs=2)
    assert flown.fixes == flown.used
    assert flown.lost_s == flown.resets == 0
    assert flown.pose == pytest.approx(1.0)
    # A pose beside a fix of 1 cm an axis, 80 ms older, carried back at a constant velocity: by
    # 1.5 m/s2 that is another 5 mm. Five sigma.
    assert max(miss.error_m for miss in flown.misses) < 5 * math.hypot(0.01, 0.01) + 0.01
    for source, axes in ((Source.RTK_POSITION, 3), (Source.RTK_VELOCITY, 3)):
        square, degrees = flown.nis[source]
        assert degrees == pytest.approx(axes * 110, abs=6)
        # Chi square of 330 degrees over them: sigma 0.08; five.
        assert square / degrees == pytest.approx(1.0, abs=0.4)
    # The autopilot's own tilt errs by a few tenths of a degree.
    assert np.degrees(np.abs(flown.tilt)).max() < 3


@pytest.mark.slow
def test_hidden_rtk_is_not_seen(config, samples):
    """One cut at the first phase, 14 s to 19 s; what RTK says in it does not matter."""
    begin_ns = samples[0].stamp_ns
    spoiled = [
        s
        if not isinstance(s, HeadingSample) or not 14e9 <= s.stamp_ns - begin_ns < 19e9
        else HeadingSample(s.stamp_ns, s.heading_rad + 1.0, s.variance_rad2)
        for s in samples
    ]
    cuts = [misses[-1] for misses in hidden_fixes(config, samples)]
    # Ordinary GPS is there in the simulation, learned while RTK was: metres do not come.
    assert 0 < cuts[0].error_m < 1.0
    assert cuts[0].within(5)
    assert hidden_fixes(config, spoiled)[0][-1] == cuts[0]
    # A length of 30 s leaves cuts from 14, 18.3 and 22.7 s, of which each must end before 30.
    assert len(cuts) == sum(start < DURATION_S - CUT_S for start in (14, 18.33, 22.67))


def made(name="p4rtk_x", aids="positions", error_m=1.0, used=99, resets=0, tilt_deg=1.0):
    flown = Flown(
        100,
        used,
        0.0,
        resets,
        1.0,
        (Miss(0.01, 0.01),) * 100,
        np.radians(np.full((10, 2), tilt_deg)),
        {Source.RTK_POSITION: (300.0, 300)},
        (),
    )
    return Judged(name, aids, flown, (Miss(error_m, 1.0),) * 4, (0.1, 0.2))


def test_a_report_without_a_miss_has_no_mark():
    lines, missed = report([made(), made("p4rtk_y"), made("car_1", error_m=50.0)])
    assert missed == 0
    assert not any("!" in line for line in lines)
    # More is asked of the Phantom's bags alone, the car's cuts are only shown.
    assert list(groups([made(), made("car_1")])) == ["p4rtk, positions", "car, positions"]
    assert "car, positions" not in ASKED


@pytest.mark.parametrize(
    ("bag", "text"),
    [
        (made(used=93), "93.0!"),
        (made(resets=1), "1!"),
        (made(error_m=2.5), "2.50!"),
        (made(error_m=math.nan), "none!"),
        (made(tilt_deg=1.5), "1.50!"),
        (made("walk_1", "positions, velocities", error_m=0.5), "0.50!"),
    ],
)
def test_a_miss_is_marked(bag, text):
    lines, missed = report([bag, *(made(f"car_{k}") for k in range(9))])
    assert missed >= 1
    assert any(text in line for line in lines)


@pytest.mark.slow
def test_a_bag_of_ones_own_is_judged(tmp_path, samples, capsys):
    """With headings, without an autopilot's attitude: no tilt, and nothing asked of it."""
    bare = [
        ImuSample(s.stamp_ns, s.specific_force_b, s.angular_rate_b)
        if isinstance(s, ImuSample)
        else s
        for s in samples
    ]
    write_samples(tmp_path / "mine_1.mcap", bare)
    lever = "[-0.1, 0.32, 0.38]"
    options = ["--set", "aircraft.rtk_antenna_m", lever, "--workers", "1"]
    second = ["--set", "aircraft.second_antenna_m", "[0.9, 0.32, 0.38]"]
    assert main([str(tmp_path), *options, *second]) == 0
    out = capsys.readouterr().out
    assert "mine, positions, velocities, headings" in out
    (tilt, *_) = [line for line in out.split("NIS over")[1].splitlines() if "mean, mine" in line]
    assert tilt.split()[-5:-3] == ["-", "-"]
