"""Warn of problems in a record at rest: movement, vibration, drift, its stamps, its length."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence

from tirgeo_ros.core.calibration.allan.noise_fit import AllanAnalysis, NoiseFit
from tirgeo_ros.core.calibration.allan.spectral_lines import SpectralLine
from tirgeo_ros.core.calibration.allan.stillness import (
    Interval,
    Seconds,
    largest_move,
    longest_stillness,
    movements,
    settlings,
)
from tirgeo_ros.tools.calibrate.allan_table import UNITS
from tirgeo_ros.tools.calibrate.imu_record import CHANNELS, ImuRecord, RestRecord

#: A shorter piece of rest does not determine the noise.
LEAST_SPAN_S = 60.0
_NAMED = 3  # intervals or lines that a warning lists
_MUCH = 0.01  # share of missing, repeated or equal samples that causes a warning
_SHAKY = 0.2  # jitter as a fraction of the time between samples
_MISFIT = 2.0
_LONG_S = 1.0  # averaging times that are not affected by a sensor's own filter


def doubts(
    record: RestRecord,
    analysis: AllanAnalysis,
    fits: Sequence[NoiseFit],
    seconds: Seconds,
    ramps: Sequence[float],
) -> list[str]:
    """Return the warnings, one line each.

    ``ramps`` (6) are the slopes (unit/s) of axes with a steady drift, 0 for the others.
    """
    lines = record.spectrum.lines() if record.spectrum else []
    return [
        *filter(None, [movement(seconds, record.from_s)]),
        *_vibration(lines),
        *_drift(ramps),
        *_settling(seconds, ramps),
        *_length(analysis, fits),
        *_stamps(record),
        *_fit(fits),
    ]


def movement(seconds: Seconds, record_from_s: float) -> str:
    """Return when and how much the IMU moved, and what to do; empty for a record at rest.

    Times are since the first message, as for ``--from`` and ``--to``.
    """
    found = movements(seconds)
    if not found:
        return ""
    moved = [Interval(*(record_from_s + edge for edge in one)) for one in found]
    named = ", ".join(f"{max(one.from_s, 0.0):.0f}-{one.to_s:.0f} s" for one in moved[:_NAMED])
    more = f" and {len(moved) - _NAMED} times more" if len(moved) > _NAMED else ""
    turned, pushed = largest_move(seconds, found)
    end_s = record_from_s + float(seconds.starts_s[-1]) + 1
    rest = longest_stillness(moved, record_from_s, end_s)
    begin_s, finish_s = math.ceil(rest.from_s), math.floor(rest.to_s)
    advice = (
        f"take the longest rest, --from {begin_s} --to {finish_s}"
        if finish_s - begin_s >= LEAST_SPAN_S
        else "record it lying still; of a flight, tirgeo calibrate imu tells the noise"
    )
    return (
        f"the IMU moved at {named}{more}, by up to {math.degrees(turned):.3g} deg/s and "
        f"{pushed:.3g} m/s2: figures across that mean nothing; {advice}"
    )


def _vibration(lines: Sequence[SpectralLine]) -> Iterator[str]:
    by_place: dict[str, list[SpectralLine]] = defaultdict(list)
    for line in lines:
        by_place[CHANNELS[line.channel]].append(line)
    if not by_place:
        return
    strongest = ", ".join(
        f"{name} {line.frequency_hz:.1f} Hz ({line.amplitude:.2g} {UNITS[name.split()[0]]})"
        for name, line in (
            (name, max(found, key=lambda one: one.amplitude)) for name, found in by_place.items()
        )
    )
    yield f"vibration: {strongest}: are motors or fans running? Record with everything off"


def _drift(ramps: Sequence[float]) -> Iterator[str]:
    named = [
        f"{name} by {ramp * 3600:.2g} {UNITS[name.split()[0]]}/h"
        for name, ramp in zip(CHANNELS, ramps, strict=True)
        if ramp
    ]
    if named:
        yield (
            f"steady drift of {', '.join(named)}, by temperature perhaps: it is taken out of the "
            "fit; warm the IMU up for half an hour first"
        )


def _settling(seconds: Seconds, ramps: Sequence[float]) -> Iterator[str]:
    changes, settles = settlings(seconds)
    named = [
        f"{name} by {change:.2g} {UNITS[name.split()[0]]}"
        for name, change, found, ramp in zip(CHANNELS, changes, settles, ramps, strict=True)
        if found and not ramp
    ]
    if named:
        yield (
            f"{', '.join(named)}: settled in the course of the record, warming up perhaps: it is "
            "in B, K and the bias; leave the start out (--from), or warm the IMU up first"
        )


def _length(analysis: AllanAnalysis, fits: Sequence[NoiseFit]) -> Iterator[str]:
    hours = analysis.span_s / 3600
    for what, terms in (
        ("random walk", [fit.white for fit in fits]),
        ("bias instability", [fit.flicker for fit in fits]),
        ("rate random walk", [fit.walk for fit in fits]),
    ):
        unseen = [n for n, term in zip(CHANNELS, terms, strict=True) if term.value is None]
        if unseen:
            yield f"{hours:.2g} h show no {what} of {', '.join(unseen)}: upper bounds are given"
    unseen = [n for n, fit in zip(CHANNELS, fits, strict=True) if not fit.bias.seen]
    if unseen:
        yield (
            f"too short for the bias of {', '.join(unseen)}: the parameters hold an upper bound "
            "and the record's length; record longer"
        )


def sample_doubts(record: ImuRecord) -> Iterator[str]:
    """Yield what is wrong with the samples of any record, at rest or in flight."""
    counts = record.grid.irregularities
    samples = max(counts.samples, 1)
    lost = counts.missing + counts.not_finite + record.unreadable
    if lost > _MUCH * samples:
        yield f"{lost} samples beside {samples} are missing, unreadable or not finite"
    if counts.repeated + counts.late > _MUCH * samples:
        yield f"{counts.repeated + counts.late} stamps repeat the one before or go back: left out"
    if counts.identical > _MUCH * samples:
        yield (
            f"{100 * counts.identical / samples:.0f} % of the samples equal the one before: the "
            "topic is faster than the sensor, or the sensor is coarse"
        )


def _stamps(record: RestRecord) -> Iterator[str]:
    grid = record.grid
    yield from sample_doubts(record)
    if grid.irregularities.splits:
        yield (
            f"the record is in {grid.irregularities.splits + 1} pieces: none is longer than its "
            "part"
        )
    if grid.jitter_ns > _SHAKY * grid.mean_step_ns:
        yield (
            f"stamps shake by {grid.jitter_ns * 1e-6:.2g} ms: they are those of arrival; times "
            "below ten samples are not to be trusted"
        )


def _fit(fits: Sequence[NoiseFit]) -> Iterator[str]:
    poor = [n for n, fit in zip(CHANNELS, fits, strict=True) if fit.misfit > _MISFIT]
    if poor:
        yield f"the curve of {', '.join(poor)} is none of these noises: look at the plot"
    late = [n for n, fit in zip(CHANNELS, fits, strict=True) if fit.shortest_s > _LONG_S]
    if late:
        yield (
            f"{', '.join(late)}: times up to a second and more are no white noise (vibration, or "
            "a filter of the sensor) and were left out"
        )
