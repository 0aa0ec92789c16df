"""Messages of an aircraft's clock over a link that delays them, and clocks to compare with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

HOST_NS = 1_750_000_000_000_000_000
LATENCY_S = 0.004


class Link(NamedTuple):
    """What was sent and came: arrays of one length, in the order of sending."""

    ticks: np.ndarray  # of the aircraft's counter, not wrapped
    extra_ns: np.ndarray  # after the tick
    truth_ns: np.ndarray  # when it would have come with the smallest latency
    arrival_ns: np.ndarray
    since_s: np.ndarray  # since the first, by the aircraft

    def part(self, keep):
        return Link(*(each[keep] for each in self))

    def messages(self, bits=32):
        for tick, extra, arrival in zip(
            self.ticks.tolist(), self.extra_ns.tolist(), self.arrival_ns.tolist(), strict=True
        ):
            yield tick % (1 << bits), arrival, extra


def exponential(mean_ms):
    return lambda rng, since_s: rng.exponential(mean_ms * 1e-3, len(since_s))


def bursts_of_8(rng, since_s):
    """Sent eight at a time: each waits for the last of its eight."""
    number = np.arange(len(since_s))
    last = np.minimum(number // 8 * 8 + 7, len(since_s) - 1)
    return since_s[last] - since_s + rng.exponential(5e-4, len(since_s))


def stalls(rng, since_s):
    """2 ms exponential; 20 ms for one in twenty, 100 ms for one in a hundred."""
    odd = rng.random((2, len(since_s)))
    late = np.where(odd[0] < 0.05, 0.02, 0) + np.where(odd[1] < 0.01, 0.1, 0)
    return rng.exponential(2e-3, len(since_s)) + late


def link(rate_hz, seconds, delays, *, drift_ppm=0.0, seed=0, start_s=12.3, steady=True):
    """A stream in order; ``drift_ppm`` a number or a function of seconds.

    The host's clock is faster than the aircraft's by that. ``steady`` messages are sent at
    multiples of the period, others at random times.
    """
    rng = np.random.default_rng(seed)
    number = int(rate_hz * seconds)
    if steady:
        since_s = np.arange(number) / rate_hz
    else:
        since_s = np.cumsum(rng.uniform(0.5, 1.5, number) / rate_hz)
        since_s -= since_s[0]
    rate = drift_ppm(since_s) if callable(drift_ppm) else np.full(number, drift_ppm)
    ahead_s = np.concatenate([[0.0], np.cumsum(np.diff(since_s) * rate[1:] * 1e-6)])
    earliest_s = since_s + ahead_s + LATENCY_S
    arrival_s = np.maximum.accumulate(earliest_s + delays(rng, since_s))
    sent_ns = np.round((start_s + since_s) * 1e9).astype(np.int64)
    ticks, extra_ns = np.divmod(sent_ns, 1_000_000)
    truth_ns = HOST_NS + np.round(earliest_s * 1e9).astype(np.int64)
    arrival_ns = HOST_NS + np.round(arrival_s * 1e9).astype(np.int64)
    return Link(ticks, extra_ns, truth_ns, arrival_ns, since_s)
