"""Estimate noise parameters of an IMU from hours at rest: ``tirgeo calibrate allan``."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.calibration.allan import (
    FLICKER_FLOOR,
    AllanCurve,
    NoiseFit,
    Term,
    allan_curve,
    deviation_band,
    fit_noise,
)
from tirgeo_ros.core.calibration.flight_noise import pieces_of
from tirgeo_ros.core.calibration.imu_record import (
    Interval,
    Seconds,
    drifts,
    longest_stillness,
    movements,
    seconds_of,
)
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, csv_text
from tirgeo_ros.io.parameters.parameter_file import Value, parameters_yaml
from tirgeo_ros.tools.calibrate.imu_bag import (
    CHANNELS,
    DENSITIES,
    UNITS,
    Axis,
    ReadImu,
    axes_table,
    axis_panels,
    channel_names,
    check_alive,
    read_imu,
    sample_warnings,
)
from tirgeo_ros.tools.calibrate.result import written
from tirgeo_ros.tools.presentation.plots import COLOURS, png
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.flight_topics import resolved

LEAST_REST_S = 60.0  # a shorter rest does not determine the noise
_NAMED = 3  # intervals that a warning lists
_MISFIT = 2.0
_LONG_S = 1.0  # averaging times that are not affected by a sensor's own filter
_SHAKY = 0.2  # jitter as a fraction of the step
_PIECES_AT_REST = 400  # of 3 s, looked at for vibration
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
    files = (
        (output, lambda: text),
        (picture, lambda: allan_png(curve, fits)),
        (csv, lambda: curves_csv(curve, fits)),
    )
    numbers = _summary(read, curve, fits, rest_warnings(read, fits, seconds, from_s))
    return {"input": os.fspath(bag)} | written(files, numbers, reader)


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
    parameters: dict[str, Value] = {}
    for walk, sensor, three in (
        ("angle_random_walk", "gyro", fits[:3]),
        ("velocity_random_walk", "accel", fits[3:]),
    ):
        parameters[f"imu.{walk}"] = [fit.white.value or fit.white.upper for fit in three]
        parameters[f"imu.{sensor}_bias_instability"] = [fit.bias.sigma for fit in three]
        parameters[f"imu.{sensor}_bias_time_s"] = [fit.bias.time_s for fit in three]
    return parameters


def rest_axes(fits: Sequence[NoiseFit]) -> list[dict[str, Any]]:
    """Return the result of each axis at rest, in SI units; None for a term that is not shown."""
    return [_rest_axis(name, fit) for name, fit in zip(CHANNELS, fits, strict=True)]


def _rest_axis(name: str, fit: NoiseFit) -> dict[str, Any]:
    bias = fit.bias
    return {
        "axis": name,
        **_term("random_walk", fit.white),
        **_term("bias_instability", fit.flicker),
        "minimum": fit.minimum,
        "minimum_sigma": fit.minimum_sigma,
        "minimum_over_0.664": fit.minimum / FLICKER_FLOOR,
        "minimum_at_s": fit.minimum_at_s,
        # Otherwise the curve is white noise up to the record's end.
        "minimum_reached": fit.flicker.value is not None or fit.walk.value is not None,
        **_term("rate_random_walk", fit.walk),
        "bias_sigma": bias.sigma,
        "bias_sigma_sigma": bias.sigma_of_sigma,
        "correlation_time_s": bias.time_s,
        "correlation_time_factor": bias.time_factor if math.isfinite(bias.time_factor) else None,
        "bias_seen": bias.seen,
        "shortest_time_s": fit.shortest_s,
        "misfit": fit.misfit,
    }


def _term(name: str, term: Term) -> dict[str, Any]:
    sigma = None if term.value is None else term.sigma
    return {name: term.value, f"{name}_sigma": sigma, f"{name}_upper": term.upper}


def rest_table(axes: Sequence[Axis]) -> str:
    """Return the axes at rest as a text table, the gyroscope's above the accelerometer's."""
    heads = {
        sensor: f"N in {DENSITIES[sensor]}; B, min, bias sigma in {unit}; K in {unit}/sqrt(s)"
        for sensor, unit in UNITS.items()
    }
    note = "B: flicker floor / 0.664. min: of the measured deviation. ~: one sigma; <: two."
    return f"{axes_table(heads, [_rest_row(axis) for axis in axes])}\n{note}"


def _rest_row(axis: Axis) -> dict[str, str]:
    factor = axis["correlation_time_factor"]
    reached = "" if axis["minimum_reached"] else "<"
    return {
        "axis": axis["axis"],
        "N": _with_sigma(axis, "random_walk"),
        "B": _with_sigma(axis, "bias_instability"),
        "min": reached + _with_sigma(axis, "minimum"),
        "min/0.664": f"{axis['minimum_over_0.664']:.3e}",
        "at [s]": f"{axis['minimum_at_s']:.0f}",
        "K": _with_sigma(axis, "rate_random_walk"),
        "bias sigma": _with_sigma(axis, "bias_sigma")
        if axis["bias_seen"]
        else f"<{axis['bias_sigma']:.3e}",
        "bias time [s]": f"{axis['correlation_time_s']:.0f}"
        + (f" (x/ {factor:.1f})" if factor else ""),
    }


def _with_sigma(axis: Axis, name: str) -> str:
    value = axis[name]
    if value is None:
        return f"<{axis[f'{name}_upper']:.3e}"
    return f"{value:.3e} ~{100 * axis[f'{name}_sigma'] / value:.1f}%"


def movement(seconds: Seconds, from_s: float) -> str:
    """Return when the IMU moved, and what to do; empty for a record at rest.

    Times are since the first message, as for ``--from`` and ``--to``.
    """
    moved = [Interval(*(from_s + edge for edge in interval)) for interval in movements(seconds)]
    if not moved:
        return ""
    named = ", ".join(
        f"{max(interval.from_s, 0.0):.0f}-{interval.to_s:.0f} s" for interval in moved[:_NAMED]
    )
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
        *sample_warnings(read),
        *_stamps(read),
        *_fit(fits),
    ]


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


def _stamps(read: ReadImu) -> Iterator[str]:
    record = read.record
    if record.jitter_s > _SHAKY * record.step_s:
        yield (
            f"stamps jitter by {record.jitter_s * 1e3:.2g} ms, perhaps stamped on arrival; do not "
            "trust averaging times below ten samples"
        )


def _fit(fits: Sequence[NoiseFit]) -> Iterator[str]:
    unseen = channel_names(not fit.bias.seen for fit in fits)
    if unseen:
        yield (
            f"too short for the bias of {unseen}: the parameters hold an upper bound and the "
            "record's length; record longer"
        )
    poor = channel_names(fit.misfit > _MISFIT for fit in fits)
    if poor:
        yield f"the curve of {poor} is not a sum of these noises: look at the plot"
    late = channel_names(fit.shortest_s > _LONG_S for fit in fits)
    if late:
        yield (
            f"{late}: no white noise at averaging times up to a second and more (vibration, or "
            "the sensor's filter): these are left out"
        )


def allan_png(curve: AllanCurve, fits: Sequence[NoiseFit]) -> bytes:
    """Return a PNG: deviations with 95 % bands, fit, its asymptotes and the filter's model."""
    made, panels = axis_panels("Allan deviation", UNITS, "averaging time [s]")
    for panel, fit in zip(panels.flat, fits, strict=True):
        _draw_deviation(panel, curve, fit)
    for row, three in zip(panels, (fits[:3], fits[3:]), strict=True):
        measured = np.sqrt(np.concatenate([fit.variances for fit in three]))
        row[0].set_ylim(0.5 * measured.min(), 2 * measured.max())
    panels.flat[0].legend(loc="upper right", fontsize=8)
    return png(made)


def _draw_deviation(axis: Any, curve: AllanCurve, fit: NoiseFit) -> None:
    tau_s = curve.tau_s
    low, high = deviation_band(curve, fit.variances)
    axis.fill_between(tau_s, low, high, color=COLOURS[0], alpha=0.25, lw=0, label="95 %")
    axis.loglog(tau_s, np.sqrt(fit.variances), ".", color=COLOURS[0], ms=4, label="measured")
    axis.loglog(tau_s, np.sqrt(fit.model), color=COLOURS[6], lw=1.0, label="N, B, K fitted")
    axis.loglog(
        tau_s, np.sqrt(fit.bias_model), "--", color=COLOURS[1], label="model of the filter"
    )
    for name, term, shape, at in (
        ("N", fit.white, tau_s**-0.5, len(tau_s) // 4),
        ("B", fit.flicker, np.full(len(tau_s), FLICKER_FLOOR), 1),
        ("K", fit.walk, np.sqrt(tau_s / 3), len(tau_s) - 2),
    ):
        if term.value is not None:
            line = term.value * shape
            axis.loglog(tau_s, line, ":", color="#777777", lw=1.0)
            place = tau_s[at], line[at]
            axis.annotate(name, place, textcoords="offset points", xytext=(0, 4))
    axis.plot(fit.minimum_at_s, fit.minimum, "v", color=COLOURS[2], ms=6, label="minimum")


def curves_csv(curve: AllanCurve, fits: Sequence[NoiseFit]) -> str:
    """Return CSV, a line per averaging time: of each axis deviation, band, fit."""
    columns: list[Any] = [curve.tau_s]
    header = ["tau_s"]
    for name, fit in zip(CHANNELS, fits, strict=True):
        low, high = deviation_band(curve, fit.variances)
        columns += [np.sqrt(fit.variances), low, high, np.sqrt(fit.model)]
        stem = name.replace(" ", "_")
        header += [f"{stem}_{part}" for part in ("deviation", "low", "high", "fit")]
    rows = ([f"{x:.6g}" for x in row] for row in zip(*columns, strict=True))
    return csv_text([header, *rows])
