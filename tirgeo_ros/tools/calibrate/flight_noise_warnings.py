"""Refuse an unusable record of an IMU in flight, and warn of problems in others."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tirgeo_ros.core.calibration.allan.flight_noise import MOTION_HZ, PIECE_S, Pieces
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.tools.calibrate.allan_warnings import sample_doubts
from tirgeo_ros.tools.calibrate.imu_record import CHANNELS, FlightRecord

LEAST_S = 20.0
_LEAST_HZ = 40.0
_SHAKY = 0.4  # jitter as a fraction of the time between samples
_SLOPED = 3.0  # density of the band's lower half over that of its upper half


def check(record: FlightRecord, pieces: Pieces) -> None:
    """Raise CalibrationError (one line) for a record that does not show noise in flight."""
    grid, stream = record.grid, record.stream
    rate_hz = 1e9 / grid.mean_step_ns
    if rate_hz < _LEAST_HZ:
        raise CalibrationError(
            f"{rate_hz:.3g} samples a second leave too little above {MOTION_HZ:.0f} Hz; record at "
            "50 Hz or more"
        )
    if grid.jitter_ns > _SHAKY * grid.mean_step_ns:
        raise CalibrationError(
            f"stamps shake by {grid.jitter_ns * 1e-6:.2g} ms where samples are "
            f"{grid.mean_step_ns * 1e-6:.2g} ms apart; record with the sensor's own stamps"
        )
    skipped = stream.skipped if stream else 0
    whole_s = PIECE_S * (len(pieces.starts_s) + skipped)
    if whole_s < LEAST_S:
        raise CalibrationError(
            f"{record.grid.irregularities.samples / rate_hz:.0f} s are too short; "
            f"{LEAST_S:.0f} s of flight are needed"
        )
    flying_s = PIECE_S * int((~pieces.at_rest).sum())
    if flying_s < LEAST_S and skipped * PIECE_S > whole_s - LEAST_S:
        raise CalibrationError(
            f"{skipped} of {whole_s // PIECE_S} pieces of {PIECE_S} s lack samples; record again "
            "without loss"
        )
    if flying_s < LEAST_S:
        raise CalibrationError(
            f"the IMU lies still for {whole_s - flying_s} of {whole_s} s: no flight; tirgeo "
            "calibrate allan tells the noise at rest"
        )
    dead = [
        name for name, value in zip(CHANNELS, pieces.peaks.max(axis=0), strict=True) if not value
    ]
    if dead:
        raise CalibrationError(
            f"{', '.join(dead)}: never changes, so that no sensor speaks there; record what the "
            "IMU itself gives"
        )


def doubts(record: FlightRecord, flying: Pieces) -> list[str]:
    """Return the warnings, one line each."""
    return [
        *_clipped(record),
        *_colour(flying),
        *sample_doubts(record),
    ]


def _clipped(record: FlightRecord) -> Iterator[str]:
    named = ", ".join(f"{name} ({n} samples)" for name, n in record.clipping.counts.items())
    if named:
        yield f"{named}: clipped: the vibration is beyond its range, and more than is seen"


def _colour(flying: Pieces) -> Iterator[str]:
    """Yield a warning if the floor falls with frequency: a sensor's filter, or broad vibration."""
    spectra = np.median(flying.spectra[:, flying.above_motion()], axis=0)
    half = len(spectra) // 2
    middle_hz = (MOTION_HZ + flying.frequencies_hz[-1]) / 2
    lower, upper = np.median(spectra[:half], axis=0), np.median(spectra[half:], axis=0)
    fallen = [n for n, a, b in zip(CHANNELS, lower, upper, strict=True) if a > _SLOPED * b]
    if fallen:
        yield (
            f"{', '.join(fallen)}: less noise above {middle_hz:.0f} Hz than below: the sensor's "
            "own filter perhaps; what lies below 8 Hz may be more than is written"
        )
