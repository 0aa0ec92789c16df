"""Refuse unusable records of an IMU, and warn of problems in others."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from tirgeo_ros.core.calibration.allan import NoiseFit
from tirgeo_ros.core.calibration.flight_noise import MOTION_HZ, PIECE_S, Pieces, pieces_of
from tirgeo_ros.core.calibration.imu_record import (
    Interval,
    Seconds,
    drifts,
    longest_stillness,
    movements,
)
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.tools.calibrate.imu_record import CHANNELS, UNITS, ReadImu

#: A shorter piece of rest, or of flight, does not determine the noise.
LEAST_REST_S = 60.0
LEAST_FLIGHT_S = 20.0
_NAMED = 3  # intervals that a warning lists
_MUCH = 0.01  # share of missing, repeated or equal samples that causes a warning
_MISFIT = 2.0
_LONG_S = 1.0  # averaging times that are not affected by a sensor's own filter
_SHAKY_AT_REST, _SHAKY_IN_FLIGHT = 0.2, 0.4  # jitter as a fraction of the step
_LEAST_HZ = 40.0  # in flight
_SLOPED = 3.0  # density of the band's lower half over that of its upper half
_PIECES_AT_REST = 400  # of 3 s, looked at for vibration


def movement(seconds: Seconds, from_s: float) -> str:
    """Return when the IMU moved, and what to do; empty for a record at rest.

    Times are since the first message, as for ``--from`` and ``--to``.
    """
    moved = [Interval(*(from_s + edge for edge in one)) for one in movements(seconds)]
    if not moved:
        return ""
    named = ", ".join(f"{max(one.from_s, 0.0):.0f}-{one.to_s:.0f} s" for one in moved[:_NAMED])
    more = f" and {len(moved) - _NAMED} times more" if len(moved) > _NAMED else ""
    rest = longest_stillness(moved, from_s, from_s + float(seconds.starts_s[-1]) + 1)
    begin_s, finish_s = math.ceil(rest.from_s), math.floor(rest.to_s)
    advice = (
        f"take the longest rest, --from {begin_s} --to {finish_s}"
        if finish_s - begin_s >= LEAST_REST_S
        else "record it lying still; for a flight use tirgeo calibrate imu"
    )
    return f"the IMU moved at {named}{more}: noise measured across this is wrong; {advice}"


def rest_warnings(
    read: ReadImu, fits: Sequence[NoiseFit], seconds: Seconds, from_s: float
) -> list[str]:
    """Return the warnings of a record at rest."""
    return [
        *filter(None, [movement(seconds, from_s)]),
        *_vibration(read),
        *_drift(seconds),
        *_sample_warnings(read),
        *_stamps(read),
        *_fit(fits),
    ]


def _channels(these: Iterable[object]) -> str:
    """Return the names of the channels (6,) for which something is true."""
    return ", ".join(name for name, it in zip(CHANNELS, these, strict=True) if it)


def _unit(name: str) -> str:
    return UNITS[name.partition(" ")[0]]


def _vibration(read: ReadImu) -> Iterator[str]:
    pieces = pieces_of(read.record, _PIECES_AT_REST)
    strongest = {
        name: lines[0]
        for k, name in enumerate(CHANNELS)
        if len(pieces.floors) and (lines := pieces.lines(k))
    }
    if strongest:
        named = ", ".join(
            f"{name} {line.frequency_hz:.1f} Hz ({line.amplitude:.2g} {_unit(name)})"
            for name, line in strongest.items()
        )
        yield f"vibration: {named}: are motors or fans running? Record with everything off"


_STEADY = (
    "drifts steadily, perhaps by temperature; it is removed before the fit; let the IMU warm up "
    "for half an hour first"
)
_SETTLES = (
    "settles in the course of the record, perhaps warming up; it is in B, K and the bias; leave "
    "the start out (--from), or let the IMU warm up first"
)


def _drift(seconds: Seconds) -> Iterator[str]:
    changes, steady, settles = drifts(seconds)
    for these, what in ((steady, _STEADY), (settles, _SETTLES)):
        named = [
            f"{name} by {changes[k]:.2g} {_unit(name)}"
            for k, name in enumerate(CHANNELS)
            if these[k]
        ]
        if named:
            yield f"{', '.join(named)}: {what}"


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
    if record.jitter_s > _SHAKY_AT_REST * record.step_s:
        yield (
            f"stamps jitter by {record.jitter_s * 1e3:.2g} ms, perhaps stamped on arrival; do not "
            "trust averaging times below ten samples"
        )


def _fit(fits: Sequence[NoiseFit]) -> Iterator[str]:
    unseen = _channels(not fit.bias.seen for fit in fits)
    if unseen:
        yield (
            f"too short for the bias of {unseen}: the parameters hold an upper bound and the "
            "record's length; record longer"
        )
    poor = _channels(fit.misfit > _MISFIT for fit in fits)
    if poor:
        yield f"the curve of {poor} is not a sum of these noises: look at the plot"
    late = _channels(fit.shortest_s > _LONG_S for fit in fits)
    if late:
        yield (
            f"{late}: no white noise at averaging times up to a second and more (vibration, or "
            "the sensor's filter): these are left out"
        )


def check_alive(where: str, sizes: Array) -> None:
    """Raise CalibrationError for axes whose sizes of change (n, 6) are all zero."""
    dead = _channels((sizes == 0).all(axis=0).tolist())
    if dead:
        raise CalibrationError(f"{where}: {dead}: never changes; record what the IMU measures")


def check_flight(read: ReadImu, pieces: Pieces) -> None:
    """Raise CalibrationError (one line) for a record that does not show noise in flight."""
    step_s, jitter_s = read.record.step_s, read.record.jitter_s
    recorded_s = sum(map(len, read.record.runs)) * step_s
    flying_s = PIECE_S * int((~pieces.at_rest).sum())
    resting_s = PIECE_S * int(pieces.at_rest.sum())
    few = flying_s < LEAST_FLIGHT_S
    at_rest = few and resting_s > recorded_s - 2 * LEAST_FLIGHT_S
    needed = f"{LEAST_FLIGHT_S:.0f} s of flight are needed"
    faults = {
        f"{read.rate_hz:.3g} samples a second are too few above {MOTION_HZ:.0f} Hz; record "
        "at 50 Hz or more": read.rate_hz < _LEAST_HZ,
        f"stamps jitter by {jitter_s * 1e3:.2g} ms where samples are {step_s * 1e3:.2g} ms apart; "
        "record with the sensor's own stamps": jitter_s > _SHAKY_IN_FLIGHT * step_s,
        f"{recorded_s:.0f} s are too short; {needed}": recorded_s < LEAST_FLIGHT_S,
        f"the IMU lies still for {resting_s} of {recorded_s:.0f} s: no flight; use tirgeo "
        "calibrate allan for the noise at rest": at_rest,
        f"only {flying_s} s of flight have their samples; {needed}, without loss": few,
    }
    for reason, is_so in faults.items():
        if is_so:
            raise CalibrationError(f"{read.where}: {reason}")
    check_alive(read.where, pieces.differences)


def flight_warnings(read: ReadImu, flying: Pieces, clipped: Mapping[str, int]) -> Iterator[str]:
    """Yield the warnings of a record in flight."""
    if clipped:
        named = ", ".join(f"{name} ({number} samples)" for name, number in clipped.items())
        yield f"{named}: clipped: the vibration exceeds the range and is larger than measured"
    spectra = np.median(flying.spectra[:, flying.above_motion()], axis=0)
    lower, upper = np.array_split(spectra, [len(spectra) // 2])
    fallen = _channels(np.median(lower, axis=0) > _SLOPED * np.median(upper, axis=0))
    if fallen:  # a filter, or broad vibration
        middle_hz = (MOTION_HZ + flying.frequencies_hz[-1]) / 2
        yield (
            f"{fallen}: less noise above {middle_hz:.0f} Hz than below: perhaps the sensor's own "
            f"filter; below {MOTION_HZ:.0f} Hz there may be more noise than reported"
        )
    yield from _sample_warnings(read)
