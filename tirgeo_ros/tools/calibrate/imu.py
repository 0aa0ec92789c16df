"""Estimate the white noise of an IMU in flight: the work of ``tirgeo calibrate imu``."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.calibration.flight_noise import PIECE_S, Pieces, pieces_of
from tirgeo_ros.core.calibration.imu_record import ImuRecord
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.filter import ImuConfig
from tirgeo_ros.core.navigation.timeline.imu_clipping import Clipping
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, write_files
from tirgeo_ros.io.parameters.parameter_file import (
    Files,
    ParameterFile,
    Value,
    parameters_yaml,
    paths_of,
)
from tirgeo_ros.tools.calibrate.imu_noise_plots import spectra_png
from tirgeo_ros.tools.calibrate.imu_noise_result import LOW, flight_axes, flight_table
from tirgeo_ros.tools.calibrate.imu_noise_warnings import check_flight, flight_warnings
from tirgeo_ros.tools.calibrate.imu_record import ReadImu, read_imu
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.flight_topics import resolved
from tirgeo_ros.tools.replay.node_configs import node_configs

_ENOUGH_REST = 3  # pieces at rest needed for a density that is accurate to 3 %
_HEAD = """\
Noise of the IMU in flight, {name}: {flying_s} s at {rate_hz:.2f} Hz, by tirgeo calibrate imu.

A floor for the filter's process noise: that of the calmest tenth of the flight, and not less
than was configured or than there is at rest. Noise above it the filter follows by itself
(imu.*_vibration_share). The columns 10 %, median, 90 % are densities between the lines of
vibration above 8 Hz, over 3 s each.

"""


def calibrate_imu(
    bag: PathLike,
    output: PathLike | None = None,
    *,
    params: Files = None,
    namespace: str = "",
    from_s: float = 0.0,
    to_s: float = math.inf,
    plot: PathLike | None = None,
    progress: Report = silent,
) -> dict[str, object]:
    """Estimate the noise of an IMU in a flight between two times (s) since its first message.

    Write parameters for ekf_node and a plot (beside ``output`` as ``.png`` unless named), both or
    none. Raise BagError, ConfigError, CalibrationError.
    """
    picture = Path(output).with_suffix(".png") if output and plot is None else plot
    given = [bag, *paths_of(params), *node_configs(params, namespace).files]
    check_outputs(given, (output, picture), CalibrationError)
    imu = ParameterFile(params).config("ekf_node", EkfConfig, namespace).imu
    reader = BagReader(bag)
    read = read_imu(reader, resolved("imu/data", namespace), from_s, to_s, progress)
    pieces = pieces_of(read.record)
    check_flight(read, pieces)
    flying, resting = pieces.where(~pieces.at_rest), pieces.where(pieces.at_rest)
    result = _result(read, flying, resting, imu)
    files: dict[PathLike, str | bytes] = {}
    if output is not None:
        head = _HEAD.format(name=Path(bag).name, **result) + flight_table(result["axes"])
        files[output] = parameters_yaml({"ekf_node": result["parameters"]}, head)
    if picture is not None:
        name = os.fsencode(Path(bag).name).decode(errors="replace")  # fonts take valid UTF-8 only
        what = f"{name}: {result['flying_s']} s in flight"
        files[picture] = spectra_png(flying, resting, result["axes"], what)
    write_files(files, CalibrationError)
    return {
        "input": os.fspath(bag),
        "output": [os.fspath(path) for path in files],
        **result,
        "error": None if reader.damage is None else f"{reader.path}: {reader.damage}",
    }


def _result(read: ReadImu, flying: Pieces, resting: Pieces, imu: ImuConfig) -> dict[str, Any]:
    """Return numbers and noise of the record, and the warnings."""
    clipped = _clipped(read.record)
    densities = floor_of(flying, resting, imu).tolist()
    recorded_s = sum(map(len, read.record.runs)) * read.record.step_s
    used = len(flying.floors) + len(resting.floors)
    warnings = list(flight_warnings(read, flying, clipped))
    return {
        **read.numbers(),
        "flying_s": PIECE_S * len(flying.floors),
        "resting_s": PIECE_S * len(resting.floors),
        "skipped_s": PIECE_S * (int(recorded_s // PIECE_S) - used),
        "missing": read.record.irregular["missing"],
        "axes": flight_axes(flying, resting, clipped, imu, densities),
        "parameters": parameters_of(densities),
        "warnings": warnings,
        "warning": "; ".join(warnings) or None,
    }


def parameters_of(densities: Sequence[float]) -> dict[str, Value]:
    """Return the parameters of ekf_node for gyroscope and accelerometer (6 axes)."""
    return {
        "imu.angle_random_walk": list(densities[:3]),
        "imu.velocity_random_walk": list(densities[3:]),
    }


def floor_of(flying: Pieces, resting: Pieces, imu: ImuConfig) -> Array:
    """Return the densities (6,) below the noise that the filter follows by itself.

    They come from the calmest tenth of the flight: the floor between the spectral lines, or what
    the filter derives there from its second differences if that is less. They are never less than
    configured, nor than the sensor's noise at rest.
    """
    floors, differences = np.percentile((flying.floors, flying.differences), LOW, axis=1)
    shares = np.repeat([imu.gyro_vibration_share, imu.accel_vibration_share], 3)
    followed = np.where(shares > 0, shares * differences, np.inf)
    least = np.array([*imu.angle_random_walk, *imu.velocity_random_walk])
    if len(resting.floors) >= _ENOUGH_REST:
        least = np.maximum(least, np.median(resting.floors, axis=0))
    return np.asarray(np.maximum(least, np.minimum(floors, followed)))


def _clipped(record: ImuRecord) -> dict[str, int]:
    """Return the number of samples at the end of the range, by axis."""
    clipping = Clipping()
    for start_s, run in zip(record.starts_s, record.runs, strict=True):
        for k in np.flatnonzero(np.isfinite(run[:, 0])).tolist():
            stamp_ns = round((start_s + k * record.step_s) * 1e9)
            clipping.add(ImuSample(stamp_ns, run[k, 3:], run[k, :3]))
    return dict(clipping.counts)
