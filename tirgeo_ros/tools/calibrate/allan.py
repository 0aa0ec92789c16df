# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
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
    fit_noise,
)
from tirgeo_ros.core.calibration.imu_record import (
    Interval,
    Seconds,
    drifts,
    longest_stillness,
    movements,
    seconds_of,
)
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs
from tirgeo_ros.io.messages.topics import resolved
from tirgeo_ros.io.parameters.parameter_file import Value, parameters_yaml
from tirgeo_ros.tools.calibrate.imu import (
    CHANNELS,
    UNITS,
    Axis,
    ReadImu,
    axes_table,
    axis_panels,
    channel_names,
    check_alive,
    read_imu,
)
from tirgeo_ros.tools.calibrate.result import written
from tirgeo_ros.tools.presentation.plots import COLOURS, png
from tirgeo_ros.tools.presentation.progress import Report, silent

LEAST_REST_S = 60.0  # a shorter rest does not determine the noise
_NAMED = 3  # intervals that a refusal lists
_MISFIT = 2.0  # a larger misfit causes a warning
_LONG_S = 1.0  # from this averaging time on, a sensor's own filter has no effect
_HEAD = """\
Noise of the IMU in {name}: {hours:.2f} h at {rate:.2f} Hz, by tirgeo calibrate allan.

The random walks are N. The filter models each bias as a first-order Gauss-Markov process:
*_bias_instability is its standard deviation and *_bias_time_s its correlation time. The first is
B, the floor of the Allan deviation over 0.664, with the time that comes nearest to the measured
curve; where no process of B is near it (a bias that walks), it is that of the nearest process.

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
    progress: Report = silent,
) -> dict[str, object]:
    """Estimate the noise of an IMU at rest between two times (s) since its first message.

    Write parameters for ekf_node and a plot (beside ``output`` as ``.png`` unless named), both or
    none. Raise BagError, and CalibrationError, for example if the IMU moved in the record.
    """
    picture = Path(output).with_suffix(".png") if plot is None else Path(plot)
    check_outputs([bag], (output, picture), CalibrationError)
    needed("scipy", "estimating the noise", CalibrationError)
    needed("matplotlib", f"drawing {picture}", CalibrationError)
    reader = BagReader(bag)
    read = read_imu(reader, resolved(topic, namespace), from_s, to_s, progress)
    seconds = seconds_of(read.record)
    curve = _curve(read, seconds)
    _check_rest(reader, seconds, from_s)
    fits = [fit_noise(curve, channel) for channel in range(6)]
    axes = [_axis(name, fit) for name, fit in zip(CHANNELS, fits, strict=True)]
    warnings = [*_drift_warnings(seconds), *read.warnings(), *_fit_warnings(fits)]
    result: dict[str, Any] = {
        **read.numbers(),
        "span_s": curve.span_s,
        "axes": axes,
        "parameters": _parameters(fits),
        "warning": "; ".join(warnings) or None,
    }
    hours, rate = curve.span_s / 3600, result["rate_hz"]
    head = _HEAD.format(name=Path(bag).name, hours=hours, rate=rate) + rest_table(axes)
    files = (
        (output, lambda: parameters_yaml({"ekf_node": result["parameters"]}, head)),
        (picture, lambda: allan_png(curve, fits)),
    )
    return {"input": os.fspath(bag)} | written(files, result, reader)


def _curve(read: ReadImu, seconds: Seconds) -> AllanCurve:
    """Return the curve without steady drifts; raise CalibrationError for an unusable record."""
    changes, steady = drifts(seconds)
    ramps = changes * steady / max(np.ptp(seconds.starts_s), 1.0) if steady.any() else None
    curve = allan_curve(read.record.runs, read.record.step_s, ramps)
    check_alive(read.where, curve.variances)
    if curve.span_s < LEAST_REST_S:
        raise CalibrationError(
            f"{read.where}: {curve.span_s:.0f} s without a gap are too short to determine the "
            "noise; record hours at rest"
        )
    return curve


def _check_rest(reader: BagReader, seconds: Seconds, from_s: float) -> None:
    """Raise CalibrationError if the IMU moved; the message names the longest rest.

    Its times are since the first message, as for ``--from`` and ``--to``.
    """
    moved = [Interval(*(from_s + edge for edge in interval)) for interval in movements(seconds)]
    if not moved:
        return
    named = ", ".join(f"{max(begin, 0.0):.0f}-{end:.0f} s" for begin, end in moved[:_NAMED])
    more = f" and {len(moved) - _NAMED} times more" if len(moved) > _NAMED else ""
    rest = longest_stillness(moved, from_s, from_s + float(seconds.starts_s[-1]) + 1)
    begin_s, end_s = math.ceil(rest.from_s), math.floor(rest.to_s)
    advice = "record it lying still; for a flight use tirgeo calibrate imu"
    if end_s - begin_s >= LEAST_REST_S:
        advice = f"take the longest rest, --from {begin_s} --to {end_s}"
    raise CalibrationError(
        f"{reader.path}: the IMU moved at {named}{more}: the noise cannot be measured across "
        f"these times; {advice}"
    )


def _parameters(fits: Sequence[NoiseFit]) -> dict[str, Value]:
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


def _axis(name: str, fit: NoiseFit) -> dict[str, Any]:
    """Return the result of an axis in SI units; None for a term that is not significant."""

    def numbers(key: str, term: Term) -> dict[str, float | None]:
        sigma = None if term.value is None else term.sigma
        return {key: term.value, f"{key}_sigma": sigma, f"{key}_upper": term.upper}

    return {
        "axis": name,
        **numbers("random_walk", fit.white),
        **numbers("bias_instability", fit.flicker),
        "minimum": fit.minimum,
        "minimum_at_s": fit.minimum_at_s,
        **numbers("rate_random_walk", fit.walk),
        "bias_sigma": fit.bias.sigma,
        "correlation_time_s": fit.bias.time_s,
        "bias_observed": fit.bias.observed,
        "shortest_time_s": fit.shortest_s,
        "misfit": fit.misfit,
    }


def rest_table(axes: Sequence[Axis]) -> str:
    """Return the axes at rest as a text table, the gyroscope's above the accelerometer's."""

    def term(axis: Axis, name: str) -> str:
        value = axis[name]
        if value is None:
            return f"<{axis[f'{name}_upper']:.3e}"
        return f"{value:.3e} ~{100 * axis[f'{name}_sigma'] / value:.1f}%"

    head = "N in {density}; B, min, bias sigma in {unit}; K in {unit}/sqrt(s)"
    columns = {
        "N": lambda axis: term(axis, "random_walk"),
        "B": lambda axis: term(axis, "bias_instability"),
        "min": lambda axis: f"{axis['minimum']:.3e}",
        "at [s]": lambda axis: f"{axis['minimum_at_s']:.0f}",
        "K": lambda axis: term(axis, "rate_random_walk"),
        "bias sigma": lambda axis: (
            f"{'' if axis['bias_observed'] else '<'}{axis['bias_sigma']:.3e}"
        ),
        "bias time [s]": lambda axis: f"{axis['correlation_time_s']:.0f}",
    }
    note = "B: flicker floor / 0.664. min: of the measured deviation. ~: one sigma; <: two."
    return f"{axes_table(axes, head, columns)}\n{note}"


def _drift_warnings(seconds: Seconds) -> Iterator[str]:
    changes, steady = drifts(seconds)
    named = [
        f"{name} by {changes[k]:.2g} {UNITS[name.partition(' ')[0]]}"
        for k, name in enumerate(CHANNELS)
        if steady[k]
    ]
    if named:
        yield (
            f"{', '.join(named)}: drifts steadily, perhaps with temperature; the drift is removed "
            "before the fit; let the IMU warm up for half an hour first"
        )


def _fit_warnings(fits: Sequence[NoiseFit]) -> Iterator[str]:
    short = channel_names(not fit.bias.observed for fit in fits)
    if short:
        yield (
            f"the record is too short for the bias of {short}: the parameters hold an upper bound "
            "and the record's length; record longer"
        )
    poor = channel_names(fit.misfit > _MISFIT or fit.shortest_s > _LONG_S for fit in fits)
    if poor:
        yield (
            f"the curve of {poor} does not fit the noise model, perhaps because of vibration or "
            "the sensor's own filter: look at the plot"
        )


def allan_png(curve: AllanCurve, fits: Sequence[NoiseFit]) -> bytes:
    """Return a PNG: deviations with 95 % bands, fit, its asymptotes and the filter's model."""
    chart, panels = axis_panels("Allan deviation", UNITS, "averaging time [s]")
    for panel, fit in zip(panels.flat, fits, strict=True):
        _draw_deviation(panel, curve, fit)
    for row, three in zip(panels, (fits[:3], fits[3:]), strict=True):
        measured = np.sqrt(np.concatenate([fit.variances for fit in three]))
        row[0].set_ylim(0.5 * measured.min(), 2 * measured.max())
    panels.flat[0].legend(loc="upper right", fontsize=8)
    return png(chart)


def _draw_deviation(axis: Any, curve: AllanCurve, fit: NoiseFit) -> None:
    from scipy.special import chdtri  # noqa: PLC0415  slow to import

    tau_s, deviations = curve.tau_s, np.sqrt(fit.variances)
    low, high = (
        deviations * np.sqrt(curve.degrees / chdtri(curve.degrees, tail))
        for tail in (0.025, 0.975)
    )
    axis.fill_between(tau_s, low, high, color=COLOURS[0], alpha=0.25, lw=0, label="95 %")
    axis.loglog(tau_s, deviations, ".", color=COLOURS[0], ms=4, label="measured")
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
            axis.annotate(name, (tau_s[at], line[at]), textcoords="offset points", xytext=(0, 4))
