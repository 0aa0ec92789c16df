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
"""Parameters set in flight: what they make of an object equals one that began with them."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from enum import Enum
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
from flights import RTK, config_for, flight, navigation_samples

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.checks.navigation_checks import NavigationChecks
from tirgeo_ros.core.config import DjiConfig, EkfConfig, GimbalConfig, NorthConfig, OverlayConfig
from tirgeo_ros.core.config.filter_parameters import AlignmentConfig
from tirgeo_ros.core.config.schema import (
    Parameter,
    changed_in_flight,
    changes,
    parameters_of,
    values_of,
)
from tirgeo_ros.core.gimbal.composer import GimbalComposer
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.timeline.ekf import Ekf
from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.core.types.errors import CameraError, ConfigError
from tirgeo_ros.core.types.measurements import Source
from tirgeo_ros.core.types.verdicts import Outcome
from tirgeo_ros.dji.interpret.interpreter import Interpreter

FLIGHT_S = 4.0


def outline(thing: Any, above: tuple[int, ...] = ()) -> Any:
    """All that an object holds, by values: equal outlines behave alike."""
    if (
        isinstance(thing, bool | int | float | str | bytes | Enum | type(None))
        or id(thing) in above
    ):
        return "above" if id(thing) in above else repr(thing)
    inner = partial(outline, above=(*above, id(thing)))
    if isinstance(thing, np.ndarray):
        return repr(thing.tolist())
    if isinstance(thing, Mapping):
        return sorted((repr(key), repr(inner(value))) for key, value in thing.items())
    if isinstance(thing, Sequence | deque | set | frozenset):
        return [inner(one) for one in thing]
    own = [("clip", thing.getClipLimit())] if hasattr(thing, "getClipLimit") else held(thing)
    return type(thing).__name__, [(name, inner(value)) for name, value in own]


def held(thing: Any) -> Iterator[tuple[str, Any]]:
    slots = (name for kind in type(thing).__mro__ for name in getattr(kind, "__slots__", ()))
    for name in sorted({*getattr(thing, "__dict__", ()), *slots}):
        if not name.startswith("__") and hasattr(thing, name):
            yield name, getattr(thing, name)


def changed(config: Any, parameter: Parameter) -> Any:
    """The parameters with another value of one, within its range."""
    value, low, high = values_of(config)[parameter.name], parameter.low, parameter.high
    if isinstance(value, bool):
        value = not value
    elif isinstance(value, str):
        value = next(choice for choice in parameter.choices if choice != value)
    elif isinstance(value, tuple):
        value = tuple(moved(one, low, high) for one in value)
    elif isinstance(value, int):
        value += 1
    else:
        value = moved(value, low, high)
    return changed_in_flight(config, {parameter.name: value})


def moved(value: float, low: float, high: float) -> float:
    return 0.5 * (high + value) if not math.isnan(value) and value < high else 0.5 * (low + high)


@cache
def running() -> Navigation:
    """A filter that runs, whose state the tests leave alone."""
    flown = flight(duration_s=FLIGHT_S)
    navigation = Navigation(EkfConfig())
    for sample in navigation_samples(flown):
        navigation.process(sample)
    assert navigation._ekf is not None
    return navigation


def overlay(config: OverlayConfig) -> Overlay:
    made = Overlay(config, None)
    made.set_camera(Camera(64, 48, 60.0, 60.0, 32.0, 24.0, (0.1, 0.0, 0.0, 0.0, 0.0)))
    return made


BUILDERS: dict[type, Callable[[Any], Any]] = {
    EkfConfig: Navigation,
    GimbalConfig: GimbalComposer,
    OverlayConfig: overlay,
    DjiConfig: Interpreter,
}
LIVE = [(kind, one) for kind in BUILDERS for one in parameters_of(kind) if one.live]
#: Where a default leaves others unused.
BASES: dict[type, Callable[[], Any]] = {
    GimbalConfig: lambda: GimbalConfig(north=NorthConfig(centred=True))
}
#: What only the node uses.
BY_NODE = {"compressed_rate_hz", "jpeg_quality"}


@pytest.mark.parametrize(("kind", "one"), LIVE, ids=[f"{k.__name__}-{p.name}" for k, p in LIVE])
def test_what_is_set_in_flight_is_used_as_if_from_the_start(kind, one):
    build, before = BUILDERS[kind], BASES.get(kind, kind)()
    after = changed(before, one)
    assert list(changes(before, after)) == [one.name]
    used, wanted = build(before), outline(build(after))
    assert (outline(used) == wanted) is (one.name in BY_NODE)
    used.configure(after)
    assert outline(used) == wanted


def kept_by(navigation: Navigation) -> Any:
    """The filter's estimate, with the whole delay of the IMU: a set part is estimated no more."""
    estimate = navigation._ekf.estimate()
    receivers = estimate.aids.receivers
    whole_s = round(receivers.imu_delay_s + navigation._config.imu.delay_s, 12)
    aids = estimate.aids._replace(receivers=receivers._replace(imu_delay_s=whole_s))
    return outline(estimate._replace(aids=aids))


@pytest.mark.parametrize(
    "one", [one for kind, one in LIVE if kind is EkfConfig], ids=lambda one: one.name
)
def test_a_filter_that_runs_takes_it_and_keeps_its_state(one):
    navigation, after = running(), changed(EkfConfig(), one)
    ekf = navigation._ekf
    kept = kept_by(navigation)
    navigation.configure(after)
    bare = Ekf.__new__(Ekf)
    bare.configure(after)
    fresh = Navigation(after)
    for ours, wanted in (
        *((getattr(ekf, name), part) for name, part in vars(bare).items()),
        *((getattr(navigation, name), getattr(fresh, name)) for name in ("_delays",)),
        (navigation._rate._period_ns, fresh._rate._period_ns),
        (navigation._in_imu[0]._variance_rad2, fresh._in_imu[0]._variance_rad2),
    ):
        assert outline(ours) == outline(wanted)
    assert kept_by(navigation) == kept


def flown(change: Callable[[Navigation, float], None]) -> tuple[list[str], list[Any]]:
    """The verdicts on RTK positions and the solutions; ``change`` is called before each sample."""
    simulated = flight(duration_s=FLIGHT_S)
    begin_ns = simulated.truth.stamp_ns[0]
    navigation, verdicts, solutions = Navigation(config_for(simulated)), [], []
    for sample in navigation_samples(simulated):
        change(navigation, (sample.stamp_ns - begin_ns) * 1e-9)
        step = navigation.process(sample)
        solutions.append(outline(step.solution))
        if sample.source is Source.RTK_POSITION:
            verdicts.append(step.verdict.outcome)
    return verdicts, solutions


def test_the_next_sample_meets_the_new_value_and_the_same_values_change_nothing():
    plain = flown(lambda _navigation, _t_s: None)
    again = flown(
        lambda navigation, _t_s: navigation._ekf and navigation.configure(navigation._config)
    )
    assert again == plain
    assert Outcome.USED in plain[0]

    def late(navigation: Navigation, t_s: float) -> None:
        if t_s >= 3.0 and navigation._config.rtk.delay_s != 1.0:
            navigation.configure(changed_in_flight(navigation._config, {"rtk.delay_s": 1.0}))

    verdicts, _ = flown(late)
    number = verdicts.index(Outcome.TOO_OLD)  # 1 s behind, more than max_delay_s
    assert verdicts[:number] == plain[0][:number]
    assert set(verdicts[number:]) == {Outcome.TOO_OLD}


def test_an_alignment_begins_again_with_the_new_values():
    navigation = Navigation(EkfConfig(alignment=AlignmentConfig(wait_s=3600.0)))
    samples = [s for s in navigation_samples(flight(duration_s=FLIGHT_S)) if s.source not in RTK]
    begin_ns, begun = samples[0].stamp_ns, False
    for sample in samples:
        if not begun and sample.stamp_ns - begin_ns > 1e9:
            assert navigation._ekf is None
            after = changed_in_flight(navigation._config, {"alignment.wait_s": 0.0})
            navigation.configure(after)
            begun = True
        navigation.process(sample)
    assert navigation._ekf is not None


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        (
            "method",
            "ekf",
            "method is read only at start: set it in the parameter file and restart",
        ),
        ("aircraft.imu_m", (0.0, 0.0, 1.0), "aircraft.imu_m is measured before flight, and must"),
        ("rtk.gate_sigma", 0.0, "rtk.gate_sigma: 0 is outside 1 to 1e"),
        ("rtk.gate", 5.0, "unknown parameter rtk.gate .did you mean rtk.gate_sigma"),
    ],
)
def test_what_cannot_be_set_says_why(name, value, reason):
    with pytest.raises(ConfigError, match=reason):
        changed_in_flight(EkfConfig(), {"publish_rate_hz": 50.0, name: value})
    same = {"method": "ekf_heading", "heading.delay_s": math.nan, "aircraft.second_antenna_m": []}
    assert not changes(EkfConfig(), changed_in_flight(EkfConfig(), same))


def test_the_checks_forget_the_evidence_against_former_parameters():
    checks = NavigationChecks(EkfConfig(), None)
    for sample in navigation_samples(flight(duration_s=FLIGHT_S)):
        checks.take(sample.source.topic, sample, sample.stamp_ns)
    after = changed_in_flight(EkfConfig(), {"rtk.delay_s": 0.1})
    checks.configure(after)
    assert outline(checks) == outline(NavigationChecks(after, None))


def test_what_cannot_be_rectified_is_refused_and_changes_nothing():
    made = Overlay(OverlayConfig(), None)
    made.set_camera(Camera(6000, 4000, 3000.0, 3000.0, 3000.0, 2000.0))
    before = outline(made)
    after = changed_in_flight(OverlayConfig(), {"rectify": True, "palette": "iron"})
    with pytest.raises(CameraError, match="set rectify to false"):
        made.configure(after)
    assert outline(made) == before
