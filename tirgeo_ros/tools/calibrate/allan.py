"""Estimate noise parameters of an IMU from hours at rest: ``tirgeo calibrate allan``."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tirgeo_ros.core.calibration.allan import (
    AllanCurve,
    NoiseFit,
    allan_curve,
    fit_noise,
)
from tirgeo_ros.core.calibration.imu_record import Seconds, drifts, seconds_of
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, write_files
from tirgeo_ros.io.parameters.parameter_file import Value, parameters_yaml
from tirgeo_ros.tools.calibrate.imu_noise_plots import allan_png, curves_csv
from tirgeo_ros.tools.calibrate.imu_noise_result import rest_axes, rest_table
from tirgeo_ros.tools.calibrate.imu_noise_warnings import (
    LEAST_REST_S,
    check_alive,
    movement,
    rest_warnings,
)
from tirgeo_ros.tools.calibrate.imu_record import ReadImu, read_imu
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.flight_topics import resolved

_HEAD = """\
Noise of the IMU in {name}: {hours:.2f} h at {rate:.2f} Hz, by tirgeo calibrate allan.

The random walks are N. The filter models each bias as a first-order Gauss-Markov process:
*_bias_instability is its standard deviation and *_bias_time_s its correlation time. The first is
B, the floor of the Allan deviation over 0.664, with the time that comes nearest to the measured
curve; where no process of B is near it (a bias that walks), it is that of the nearest process.
B, the plain minimum and all else that was found:

"""


def calibrate_allan(
    bag: PathLike,
    output: PathLike,
    *,
    topic: str = "imu/data",
    namespace: str = "",
    from_s: float = 0.0,
    to_s: float = math.inf,
    plot: PathLike | None = None,
    csv: PathLike | None = None,
    moved: bool = False,
    progress: Report = silent,
) -> dict[str, object]:
    """Estimate the noise of an IMU at rest between two times (s) since its first message.

    Write parameters for ekf_node, a plot (beside ``output`` as ``.png`` unless named) and, if
    asked, the curves as CSV: all of them or none. A record with movement is refused unless
    ``moved`` is true. Raise BagError, CalibrationError.
    """
    picture = Path(output).with_suffix(".png") if plot is None else Path(plot)
    check_outputs([bag], (output, picture, csv), CalibrationError)
    reader = BagReader(bag)
    read = read_imu(reader, resolved(topic, namespace), from_s, to_s, progress)
    seconds = seconds_of(read.record)
    curve = _curve(read, seconds)
    moving = "" if moved else movement(seconds, from_s)
    if moving:
        raise CalibrationError(f"{reader.path}: {moving}; --moved writes them anyway")
    fits = [fit_noise(curve, channel) for channel in range(6)]
    head = _HEAD.format(name=Path(bag).name, hours=curve.span_s / 3600, rate=read.rate_hz)
    text = parameters_yaml({"ekf_node": parameters_of(fits)}, head + rest_table(rest_axes(fits)))
    files: dict[PathLike, str | bytes] = {output: text, picture: allan_png(curve, fits)}
    if csv is not None:
        files[csv] = curves_csv(curve, fits)
    write_files(files, CalibrationError)
    return {
        "input": os.fspath(bag),
        "output": [os.fspath(path) for path in files],
        **_summary(read, curve, fits, rest_warnings(read, fits, seconds, from_s)),
        "error": None if reader.damage is None else f"{reader.path}: {reader.damage}",
    }


def _curve(read: ReadImu, seconds: Seconds) -> AllanCurve:
    """Return the curve without steady drifts; raise CalibrationError for an unusable record."""
    changes, steady, _ = drifts(seconds)
    ramps = changes * steady / max(np.ptp(seconds.starts_s), 1.0) if steady.any() else None
    curve = allan_curve(read.record.runs, read.record.step_s, ramps)
    check_alive(read.where, curve.variances)
    if curve.span_s < LEAST_REST_S:
        raise CalibrationError(
            f"{read.where}: {curve.span_s:.0f} s without a gap are too short for the "
            "noise; record hours at rest"
        )
    return curve


def _summary(
    read: ReadImu, curve: AllanCurve, fits: Sequence[NoiseFit], warnings: Sequence[str]
) -> dict[str, object]:
    """Return the numbers of the record and of its noise."""
    return {
        **read.numbers(),
        "span_s": curve.span_s,
        "irregular": {"unreadable": read.unreadable, **read.record.irregular},
        "axes": rest_axes(fits),
        "parameters": parameters_of(fits),
        "warnings": warnings,
        "warning": "; ".join(warnings) or None,
    }


def parameters_of(fits: Sequence[NoiseFit]) -> dict[str, Value]:
    """Return the parameters of ekf_node for gyroscope and accelerometer (6 axes).

    A term that the record does not show is written with its upper bound.
    """
    found: dict[str, Value] = {}
    for walk, sensor, three in (
        ("angle_random_walk", "gyro", fits[:3]),
        ("velocity_random_walk", "accel", fits[3:]),
    ):
        found[f"imu.{walk}"] = [fit.white.value or fit.white.upper for fit in three]
        found[f"imu.{sensor}_bias_instability"] = [fit.bias.sigma for fit in three]
        found[f"imu.{sensor}_bias_time_s"] = [fit.bias.time_s for fit in three]
    return found
