"""Estimate noise parameters of an IMU from hours at rest: ``tirgeo calibrate allan``.

The axes x, y, z are those of the messages (forward, left, up). The filter's axes (forward, right,
down) differ only in sign, which does not change noise parameters.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path

from tirgeo_ros.core.calibration.allan.noise_fit import AllanAnalysis, NoiseFit
from tirgeo_ros.core.calibration.allan.stillness import Seconds, drifts
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, write_files
from tirgeo_ros.io.parameters.parameter_output import Value, parameters_yaml
from tirgeo_ros.tools.calibrate.allan_plots import curves_csv, curves_png
from tirgeo_ros.tools.calibrate.allan_table import axis_of, table
from tirgeo_ros.tools.calibrate.allan_warnings import LEAST_SPAN_S, doubts, movement
from tirgeo_ros.tools.calibrate.imu_record import CHANNELS, RestRecord, read_record
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
    record = read_record(reader, RestRecord(resolved(topic, namespace), from_s), to_s, progress)
    analysis = _analysis(reader, record)
    seconds = record.seconds.seconds() if record.seconds else Seconds.none()
    moving = "" if moved else movement(seconds, record.from_s)
    if moving:
        raise CalibrationError(f"{reader.path}: {moving}; --moved writes them all the same")
    slopes, steady = drifts(seconds)
    ramps = (slopes * steady).tolist()
    fits = [analysis.fit(channel, ramp) for channel, ramp in enumerate(ramps)]
    axes = [axis_of(name, fit) for name, fit in zip(CHANNELS, fits, strict=True)]
    numbers = _record_numbers(record, analysis)
    parameters = parameters_of(fits)
    head = _HEAD.format(
        name=Path(bag).name, hours=analysis.span_s / 3600, rate=numbers["rate_hz"]
    ) + table(axes)
    files: dict[PathLike, str | bytes] = {
        output: parameters_yaml({"ekf_node": parameters}, head),
        picture: curves_png(analysis, fits),
    }
    if csv is not None:
        files[csv] = curves_csv(analysis, fits)
    write_files(files, CalibrationError)
    warnings = doubts(record, analysis, fits, seconds, ramps)
    return {
        "input": os.fspath(bag),
        "output": [os.fspath(path) for path in files],
        **numbers,
        "axes": axes,
        "parameters": parameters,
        "warnings": warnings,
        "warning": "; ".join(warnings) or None,
        "error": _damage(reader),
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


def _analysis(reader: BagReader, record: RestRecord) -> AllanAnalysis:
    curve = record.allan.curve()
    still = [name for name, v in zip(CHANNELS, curve.variances.T, strict=True) if not v.any()]
    if still:
        raise CalibrationError(
            f"{reader.path}: {', '.join(still)}: never changes, so that no sensor speaks there; "
            "record what the IMU itself gives"
        )
    analysis = AllanAnalysis(curve, record.grid.mean_step_ns * 1e-9)
    if analysis.span_s < LEAST_SPAN_S:
        raise CalibrationError(
            f"{reader.path}: {analysis.span_s:.0f} s in one piece tell nothing of the noise; "
            "record hours at rest"
        )
    return analysis


def _record_numbers(record: RestRecord, analysis: AllanAnalysis) -> dict[str, object]:
    grid, counts = record.grid, record.grid.irregularities
    return {
        "topic": record.topic,
        "messages": record.messages,
        "samples": counts.samples,
        "rate_hz": 1e9 / grid.mean_step_ns,
        "span_s": analysis.span_s,
        "jitter_ms": grid.jitter_ns * 1e-6,
        "irregular": {
            "unreadable": record.unreadable,
            "not_finite": counts.not_finite,
            "repeated_stamps": counts.repeated,
            "late_stamps": counts.late,
            "gaps": counts.gaps,
            "missing": counts.missing,
            "splits": counts.splits,
            "same_as_before": counts.identical,
        },
    }


def _damage(reader: BagReader) -> str | None:
    if reader.damage is None:
        return None
    return f"{reader.path}: {reader.damage}; the noise is told from these"
