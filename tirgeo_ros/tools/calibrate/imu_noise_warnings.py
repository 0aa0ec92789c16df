"""Refuse unusable records of an IMU, and warn of problems in others."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from tirgeo_ros.core.calibration.allan.flight_noise import MOTION_HZ, PIECE_S, Pieces
from tirgeo_ros.core.calibration.allan.noise_fit import NoiseFit
from tirgeo_ros.core.calibration.allan.spectral_lines import lines_at_rest
from tirgeo_ros.core.calibration.allan.stillness import (
    Interval,
    Seconds,
    largest_move,
    longest_stillness,
    movements,
    settlings,
)
from tirgeo_ros.core.types.arrays import BoolArray
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.tools.calibrate.imu_record import CHANNELS, UNITS, ReadImu, check_alive

#: A shorter piece of rest, or of flight, does not determine the noise.
LEAST_REST_S = 60.0
LEAST_FLIGHT_S = 20.0
_NAMED = 3  # intervals or lines that a warning lists
_MUCH = 0.01  # share of missing, repeated or equal samples that causes a warning
_MISFIT = 2.0
_LONG_S = 1.0  # averaging times that are not affected by a sensor's own filter
_SHAKY_AT_REST, _SHAKY_IN_FLIGHT = 0.2, 0.4  # jitter as a fraction of the step
_LEAST_HZ = 40.0  # in flight
_SLOPED = 3.0  # density of the band's lower half over that of its upper half


def rest_warnings(
    read: ReadImu,
    span_s: float,
    fits: Sequence[NoiseFit],
    seconds: Seconds,
    ramps: Sequence[float],
    from_s: float,
) -> list[str]:
    """Return the warnings of a record at rest whose longest piece lasts ``span_s``.

    ``ramps`` (6) are the slopes (unit/s) of axes with a steady drift, 0 for the others.
    """
    return [
        *filter(None, [movement(seconds, from_s)]),
        *_vibration(read),
        *_drift(seconds, ramps),
        *_length(span_s, fits),
        *_sample_warnings(read),
        *_stamps(read),
        *_fit(fits),
    ]


def movement(seconds: Seconds, from_s: float) -> str:
    """Return when and how much the IMU moved, and what to do; empty for a record at rest.

    Times are since the first message, as for ``--from`` and ``--to``.
    """
    found = movements(seconds)
    if not found:
        return ""
    moved = [Interval(*(from_s + edge for edge in one)) for one in found]
    named = ", ".join(f"{max(one.from_s, 0.0):.0f}-{one.to_s:.0f} s" for one in moved[:_NAMED])
    more = f" and {len(moved) - _NAMED} times more" if len(moved) > _NAMED else ""
    turned, pushed = largest_move(seconds, found)
    rest = longest_stillness(moved, from_s, from_s + float(seconds.starts_s[-1]) + 1)
    begin_s, finish_s = math.ceil(rest.from_s), math.floor(rest.to_s)
    advice = (
        f"take the longest rest, --from {begin_s} --to {finish_s}"
        if finish_s - begin_s >= LEAST_REST_S
        else "record it lying still; for a flight use tirgeo calibrate imu"
    )
    return (
        f"the IMU moved at {named}{more}, by up to {math.degrees(turned):.3g} deg/s and "
        f"{pushed:.3g} m/s2: noise measured across that is wrong; {advice}"
    )


def _channels(these: Iterable[object]) -> list[str]:
    """Return the names of the channels (6,) for which something is true."""
    return [name for name, it in zip(CHANNELS, these, strict=True) if it]


def _amount(channel: int, value: float) -> str:
    name = CHANNELS[channel]
    return f"{name} by {value:.2g} {UNITS[name.split()[0]]}"


def _vibration(read: ReadImu) -> Iterator[str]:
    strongest = {}
    for line in sorted(lines_at_rest(read.record), key=lambda line: line.amplitude):
        name = CHANNELS[line.channel]
        unit = UNITS[name.split()[0]]
        strongest[name] = f"{name} {line.frequency_hz:.1f} Hz ({line.amplitude:.2g} {unit})"
    if strongest:
        named = ", ".join(strongest[name] for name in CHANNELS if name in strongest)
        yield f"vibration: {named}: are motors or fans running? Record with everything off"


def _drift(seconds: Seconds, ramps: Sequence[float]) -> Iterator[str]:
    steady = [f"{_amount(k, 3600 * ramp)}/h" for k, ramp in enumerate(ramps) if ramp]
    if steady:
        yield (
            f"steady drift of {', '.join(steady)}, perhaps by temperature; it is removed before "
            "the fit; let the IMU warm up for half an hour first"
        )
    changes, settles = settlings(seconds)
    settled = [_amount(k, changes[k]) for k in range(6) if settles[k] and not ramps[k]]
    if settled:
        yield (
            f"{', '.join(settled)}: settled in the course of the record, perhaps warming up; it "
            "is in B, K and the bias; leave the start out (--from), or let the IMU warm up first"
        )


def _length(span_s: float, fits: Sequence[NoiseFit]) -> Iterator[str]:
    for what, name in (
        ("random walk", "white"),
        ("bias instability", "flicker"),
        ("rate random walk", "walk"),
    ):
        unseen = _channels(getattr(fit, name).value is None for fit in fits)
        if unseen:
            yield (
                f"{span_s / 3600:.2g} h show no {what} of {', '.join(unseen)}: upper bounds are "
                "given"
            )
    unseen = _channels(not fit.bias.seen for fit in fits)
    if unseen:
        yield (
            f"too short for the bias of {', '.join(unseen)}: the parameters hold an upper bound "
            "and the record's length; record longer"
        )


def _sample_warnings(read: ReadImu) -> Iterator[str]:
    """Yield what is wrong with the samples of any record, at rest or in flight."""
    faults, samples = read.record.irregular, max(read.record.samples, 1)
    lost = faults["missing"] + faults["not_finite"] + read.unreadable
    if lost > _MUCH * samples:
        yield f"{lost} samples beside {samples} are missing, unreadable or not finite"
    disordered = faults["repeated_stamps"] + faults["late_stamps"]
    if disordered > _MUCH * samples:
        yield f"{disordered} stamps repeat the previous one or go back: left out"
    if faults["same_as_before"] > _MUCH * samples:
        yield (
            f"{100 * faults['same_as_before'] / samples:.0f} % of the samples equal the one "
            "before: the topic is faster than the sensor, or the sensor is coarse"
        )


def _stamps(read: ReadImu) -> Iterator[str]:
    record = read.record
    if record.irregular["splits"]:
        yield f"the record is in {record.irregular['splits'] + 1} pieces: none is averaged over"
    if record.jitter_s > _SHAKY_AT_REST * record.step_s:
        yield (
            f"stamps jitter by {record.jitter_s * 1e3:.2g} ms, perhaps stamped on arrival; do not "
            "trust averaging times below ten samples"
        )


def _fit(fits: Sequence[NoiseFit]) -> Iterator[str]:
    poor = _channels(fit.misfit > _MISFIT for fit in fits)
    if poor:
        yield f"the curve of {', '.join(poor)} is none of these noises: look at the plot"
    late = _channels(fit.shortest_s > _LONG_S for fit in fits)
    if late:
        yield (
            f"{', '.join(late)}: no white noise at averaging times up to a second and more "
            "(vibration, or the sensor's filter): these are left out"
        )


def check_flight(read: ReadImu, pieces: Pieces) -> None:
    """Raise CalibrationError (one line) for a record that does not show noise in flight."""
    step_s, jitter_s = read.record.step_s, read.record.jitter_s
    recorded_s = sum(map(len, read.record.runs)) * step_s
    flying_s = PIECE_S * int((~pieces.at_rest).sum())
    resting_s = PIECE_S * int(pieces.at_rest.sum())
    reason = ""
    if read.rate_hz < _LEAST_HZ:
        reason = (
            f"{read.rate_hz:.3g} samples a second leave too little above {MOTION_HZ:.0f} Hz; "
            "record at 50 Hz or more"
        )
    elif jitter_s > _SHAKY_IN_FLIGHT * step_s:
        reason = (
            f"stamps jitter by {jitter_s * 1e3:.2g} ms where samples are {step_s * 1e3:.2g} ms "
            "apart; record with the sensor's own stamps"
        )
    elif recorded_s < LEAST_FLIGHT_S:
        reason = f"{recorded_s:.0f} s are too short; {LEAST_FLIGHT_S:.0f} s of flight are needed"
    elif flying_s < LEAST_FLIGHT_S and resting_s > recorded_s - 2 * LEAST_FLIGHT_S:
        reason = (
            f"the IMU lies still for {resting_s} of {recorded_s:.0f} s: no flight; use tirgeo "
            "calibrate allan for the noise at rest"
        )
    elif flying_s < LEAST_FLIGHT_S:
        reason = (
            f"only {flying_s} s of flight have their samples, {LEAST_FLIGHT_S:.0f} are needed; "
            "record again without loss"
        )
    if reason:
        raise CalibrationError(f"{read.where}: {reason}")
    check_alive(read.where, pieces.peaks)


def flight_warnings(read: ReadImu, flying: Pieces, clipped: Mapping[str, int]) -> list[str]:
    """Return the warnings of a record in flight."""
    named = ", ".join(f"{name} ({number} samples)" for name, number in clipped.items())
    clipping = f"{named}: clipped: the vibration exceeds the range, and is more than is seen"
    fallen = ", ".join(_channels(_falls(flying)))
    middle_hz = (MOTION_HZ + flying.frequencies_hz[-1]) / 2
    colour = (
        f"{fallen}: less noise above {middle_hz:.0f} Hz than below: perhaps the sensor's own "
        f"filter; below {MOTION_HZ:.0f} Hz there may be more noise than is written"
    )
    return [
        *([clipping] if named else []),
        *([colour] if fallen else []),
        *_sample_warnings(read),
    ]


def _falls(flying: Pieces) -> BoolArray:
    """Return (6,) whether the floor falls with frequency: a filter, or broad vibration."""
    spectra = np.median(flying.spectra[:, flying.above_motion()], axis=0)
    lower, upper = np.array_split(spectra, [len(spectra) // 2])
    return np.asarray(np.median(lower, axis=0) > _SLOPED * np.median(upper, axis=0))
