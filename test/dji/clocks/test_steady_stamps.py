from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from link_delays import HOST_NS, bursts_of_8, exponential, link

from tirgeo_ros.dji.clocks.steady_stamps import SteadyStamps

MS = 1_000_000
SECOND = 1_000_000_000


def stamps_of(arrivals_ns, steady=None):
    steady = SteadyStamps() if steady is None else steady
    return np.array([steady.stamp_ns(int(arrival)) for arrival in arrivals_ns])


def errors_ms(stamps, link_, after_s=5.0):
    return (stamps - link_.truth_ns)[link_.since_s >= after_s] / MS


def rms(values):
    return math.sqrt(np.mean(np.square(values)))


def checked_stamps(flown, steady=None):
    """Stamps, which always increase and are no later than the arrival by more than roundings."""
    stamps = stamps_of(flown.arrival_ns, steady)
    assert np.all(np.diff(stamps) > 0)
    assert np.max(stamps - np.maximum.accumulate(flown.arrival_ns)) < 1000  # 1 ns a message
    return stamps


@pytest.mark.parametrize("rate_hz", [50, 97.3, 100, 200])
@pytest.mark.parametrize("drift_ppm", [0, 50, -50])
def test_exponential_delays(rate_hz, drift_ppm):
    flown = link(rate_hz, 60, exponential(2), drift_ppm=drift_ppm, seed=1)
    steady = SteadyStamps()
    errors = errors_ms(checked_stamps(flown, steady), flown)
    # Asked for: rms below 0.5 ms, never 2 ms. The lowest of 10 s has 2 ms / 500 at 50 Hz.
    assert rms(errors) < 0.1
    assert np.abs(errors).max() < 0.5
    assert SECOND / steady.period_ns == pytest.approx(rate_hz, rel=1e-4)


def test_bursts():
    flown = link(400, 60, bursts_of_8, seed=2)
    steady = SteadyStamps()
    errors = errors_ms(checked_stamps(flown, steady), flown)
    # A burst comes with the slowest of eight exponential delays of 0.5 ms, which is some 0.3 ms
    # for the fastest burst of 10 s, and 0.5 ms 2.7 = 1.4 ms in the mean; arrivals are 11 ms off.
    assert rms(errors) < 0.5
    assert np.abs(errors).max() < 1.4
    assert rms(errors_ms(flown.arrival_ns, flown)) > 20 * rms(errors)


@pytest.mark.parametrize("rate_hz", [1, 5, 10])
def test_slow_streams(rate_hz):
    flown = link(rate_hz, 400, exponential(2), seed=4)
    steady = SteadyStamps()
    errors = errors_ms(checked_stamps(flown, steady), flown, after_s=20)
    # The lowest of ten has 0.2 ms in the mean, and 1 ms once in exp(-5) = 150.
    assert rms(errors) < 0.4
    assert np.abs(errors).max() < 2


@pytest.mark.parametrize(("rate_hz", "number"), [(100, 1), (100, 3), (50, 10), (5, 1), (1, 1)])
def test_lost_messages(rate_hz, number):
    # Counted within 0.2 s; at 5 Hz and less at once.
    flown = link(rate_hz, 60, exponential(1), seed=5)
    lost_s = 40.0
    flown = flown.part((flown.since_s < lost_s) | (flown.since_s >= lost_s + number / rate_hz))
    steady = SteadyStamps()
    errors = errors_ms(checked_stamps(flown, steady), flown, after_s=0)
    shows = flown.since_s >= lost_s + number / rate_hz + (0.22 if rate_hz > 5 else 0)
    right = (flown.since_s > 20) & (flown.since_s < lost_s) | shows
    assert np.abs(errors[right]).max() < 1
    assert errors.min() >= -number / rate_hz * 1e3 - 1  # early by what was lost, no more


@pytest.mark.parametrize(("before_hz", "after_hz"), [(100, 50), (50, 100), (400, 200), (10, 50)])
def test_the_rate_changes(before_hz, after_hz):
    first = link(before_hz, 40, exponential(1), seed=7)
    second = link(after_hz, 40, exponential(1), seed=8)
    apart_ns = 40 * SECOND
    arrivals = np.concatenate([first.arrival_ns, second.arrival_ns + apart_ns])
    truth = np.concatenate([first.truth_ns, second.truth_ns + apart_ns])
    steady = SteadyStamps()
    stamps = stamps_of(arrivals, steady)
    assert np.all(np.diff(stamps) > 0)
    errors = (stamps - truth) / MS
    assert errors.min() > -250  # ms before the arrival: the bound for any stream
    assert np.abs(errors[truth > truth[0] + 50 * SECOND]).max() < 0.5
    assert SECOND / steady.period_ns == pytest.approx(after_hz, rel=1e-3)


@pytest.mark.parametrize("pause_s", [0.7, 5.0, 600.0])
def test_a_pause(pause_s):
    flown = link(100, 40, exponential(2), seed=9)
    later = np.where(flown.since_s > 20, round((pause_s + 0.0037) * SECOND), 0)
    flown = flown._replace(arrival_ns=flown.arrival_ns + later, truth_ns=flown.truth_ns + later)
    steady = SteadyStamps()
    errors = errors_ms(checked_stamps(flown, steady), flown, after_s=0)
    # Again from the arrival: late by a delay at first, then by the lowest of 100.
    assert np.abs(errors[(flown.since_s > 5) & (flown.since_s < 20)]).max() < 0.2
    assert errors[flown.since_s > 20].min() > -0.1
    assert np.abs(errors[flown.since_s > 21]).max() < 0.2


@pytest.mark.parametrize("step_s", [-3.0, 3.0])
def test_the_hosts_clock_is_set(step_s):
    flown = link(100, 40, exponential(2), seed=10)
    later = np.where(flown.since_s > 20, round(step_s * SECOND), 0)
    flown = flown._replace(arrival_ns=flown.arrival_ns + later, truth_ns=flown.truth_ns + later)
    steady = SteadyStamps()
    stamps = stamps_of(flown.arrival_ns, steady)
    errors = errors_ms(stamps, flown, after_s=0)
    assert np.sum(np.diff(stamps) < 0) == (step_s < 0)
    assert np.abs(errors[flown.since_s > 21]).max() < 0.2


@pytest.mark.parametrize("kind", ["exponential", "uniform"])
def test_a_stream_without_a_period_keeps_to_its_arrivals(kind):
    rng = np.random.default_rng(11)
    mean_s = 0.01
    gaps = rng.exponential(mean_s, 6000) if kind == "exponential" else rng.uniform(0, 0.02, 6000)
    arrivals = HOST_NS + np.cumsum(gaps * 1e9).astype(np.int64)
    steady = SteadyStamps()
    stamps = stamps_of(arrivals, steady)
    assert np.all(np.diff(stamps) > 0)
    early_ms = (arrivals - stamps) / MS
    assert early_ms.max() <= 250
    assert np.mean(early_ms > 0.001) < 0.2  # now and then a hundred look periodic
    assert np.mean(early_ms) < mean_s * 1e3


@given(
    st.lists(
        st.one_of(st.integers(-(10**12), 10**12), st.integers(0, 2 * 10**7), st.just(10**7)),
        max_size=300,
    )
)
def test_whatever_comes(gaps_ns):
    steady = SteadyStamps()
    arrival_ns = HOST_NS
    for gap_ns in gaps_ns:
        arrival_ns += gap_ns
        stamp = steady.stamp_ns(arrival_ns)
        assert isinstance(stamp, int)
        if gap_ns >= 0:
            assert stamp >= arrival_ns - 250 * MS
