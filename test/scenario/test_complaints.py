"""The table's judge sees what it must see: a good run that was tampered with."""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from flights import errors
from scenario.complaints import complaints
from scenario.runs import Run, calm, faulty, run
from scenario.table import DEGRADED, GOOD, RUNNING, Row
from scenario.time_faults import nothing

from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.core.types.verdicts import FilterState

ROW = Row("nothing", nothing, RUNNING, GOOD)


@functools.cache
def good() -> Run:
    return run(calm(), faulty(calm(), nothing, ROW.start_s, ROW.end_s))


def changed(start_s: float, end_s: float, change) -> Run:
    """The good run with its solutions of a part changed, or left out where that gives None."""
    first_ns = calm().truth.stamp_ns[0]
    published: list[NavSolution] = []
    for solution in good().published:
        inside = start_s <= (solution.stamp_ns - first_ns) * 1e-9 < end_s
        new = change(solution) if inside else solution
        if new is not None:
            published.append(new)
    return replace(good(), published=published, errors=errors(calm(), published))


def covariance_not_positive(covariance):
    covariance = covariance.copy()
    covariance[0, 1] = covariance[1, 0] = 2 * math.sqrt(covariance[0, 0] * covariance[1, 1])
    return covariance


@pytest.mark.parametrize(
    ("start_s", "change", "words"),
    [
        (26.0, lambda s: s._replace(height_m=s.height_m + 0.1), "meanwhile: position"),
        (40.0, lambda s: s._replace(height_m=s.height_m + 0.1), "afterwards: position"),
        (20.0, lambda s: s._replace(covariance=s.covariance / 100), "sigmas at"),
        (
            20.0,
            lambda s: s._replace(covariance=covariance_not_positive(s.covariance)),
            "not positive",
        ),
        (20.0, lambda s: s._replace(angular_rate_b=np.full(3, math.nan)), "not finite"),
        (40.0, lambda _: None, "solutions in 15.0 s"),
    ],
)
def test_each_tampering_is_seen(start_s, change, words):
    found = complaints(ROW, changed(start_s, start_s + 2.0, change))
    assert any(words in complaint for complaint in found), found


def test_states_and_resets_are_seen():
    assert complaints(ROW, good()) == []
    assert complaints(replace(ROW, states=RUNNING + DEGRADED), good()) == ["states running"]
    assert "0 resets" in complaints(replace(ROW, resets=1), good())[0]
    lost = replace(good(), changes=[*good().changes, (30.0, FilterState.LOST)])
    assert "lost" in complaints(ROW, lost)
