"""Estimate the white noise of an IMU in flight: the work of ``tirgeo calibrate imu``."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.calibration.flight_noise import MOTION_HZ, PIECE_S, Pieces, pieces_of
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.filter_parameters import ImuConfig
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs
from tirgeo_ros.io.parameters.parameter_file import (
    Files,
    ParameterFile,
    parameters_yaml,
    paths_of,
)
from tirgeo_ros.tools.calibrate.imu_bag import (
    CHANNELS,
    DENSITIES,
    Axis,
    ReadImu,
    axes_table,
    axis_panels,
    check_alive,
    read_imu,
)
from tirgeo_ros.tools.calibrate.result import written
from tirgeo_ros.tools.presentation.plots import COLOURS, png
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.flight_topics import resolved
from tirgeo_ros.tools.replay.node_configs import node_configs

_ENOUGH_REST = 3  # pieces at rest needed for a density that is accurate to 3 %
_LOW, _HIGH = 10, 90  # percentiles
_LINES = 3  # of each axis that are shown, at most
LEAST_FLIGHT_S = 20.0  # a shorter flight does not determine the noise
_SHAKY = 0.4  # jitter as a fraction of the step
_LEAST_HZ = 40.0  # in flight
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
    inputs = [bag, *paths_of(params), *node_configs(params, namespace).files]
    check_outputs(inputs, (output, picture), CalibrationError)
    imu = ParameterFile(params).config("ekf_node", EkfConfig, namespace).imu
    reader = BagReader(bag)
    read = read_imu(reader, resolved("imu/data", namespace), from_s, to_s, progress)
    pieces = pieces_of(read.record)
    _check_flight(read, pieces)
    flying, resting = pieces.where(~pieces.at_rest), pieces.where(pieces.at_rest)
    densities = _floor(flying, resting, imu).tolist()
    result: dict[str, Any] = {
        **read.numbers(),
        "flying_s": PIECE_S * len(flying.floors),
        "resting_s": PIECE_S * len(resting.floors),
        "axes": _axes(flying, resting, imu, densities),
        "parameters": {
            "imu.angle_random_walk": densities[:3],
            "imu.velocity_random_walk": densities[3:],
        },
        "warning": "; ".join(read.warnings()) or None,
    }
    head = _HEAD.format(name=Path(bag).name, **result) + flight_table(result["axes"])
    name = os.fsencode(Path(bag).name).decode(errors="replace")  # fonts take valid UTF-8 only
    title = f"{name}: {result['flying_s']} s in flight"
    files = (
        (output, lambda: parameters_yaml({"ekf_node": result["parameters"]}, head)),
        (picture, lambda: spectra_png(flying, resting, result["axes"], title)),
    )
    return {"input": os.fspath(bag)} | written(files, result, reader)


def _check_flight(read: ReadImu, pieces: Pieces) -> None:
    """Raise CalibrationError (one line) for a record that does not show noise in flight."""
    step_s, jitter_s = read.record.step_s, read.record.jitter_s
    recorded_s = sum(map(len, read.record.runs)) * step_s
    flying_s = PIECE_S * int((~pieces.at_rest).sum())
    resting_s = PIECE_S * int(pieces.at_rest.sum())
    few = flying_s < LEAST_FLIGHT_S
    needed = f"{LEAST_FLIGHT_S:.0f} s of flight are needed"
    faults = {
        f"{1 / step_s:.3g} samples a second are too few above {MOTION_HZ:.0f} Hz; record "
        "at 50 Hz or more": 1 / step_s < _LEAST_HZ,
        f"stamps jitter by {jitter_s * 1e3:.2g} ms where samples are {step_s * 1e3:.2g} ms apart; "
        "record with the sensor's own stamps": jitter_s > _SHAKY * step_s,
        f"{recorded_s:.0f} s are too short; {needed}": recorded_s < LEAST_FLIGHT_S,
        f"the IMU lies still for {resting_s} of {recorded_s:.0f} s: no flight; use tirgeo "
        "calibrate allan for the noise at rest": few
        and resting_s > recorded_s - 2 * LEAST_FLIGHT_S,
        f"only {flying_s} s of flight have their samples; {needed}, without loss": few,
    }
    for reason, is_so in faults.items():
        if is_so:
            raise CalibrationError(f"{read.where}: {reason}")
    check_alive(read.where, pieces.differences)


def _floor(flying: Pieces, resting: Pieces, imu: ImuConfig) -> Array:
    """Return the densities (6,) below the noise that the filter follows by itself.

    They come from the calmest tenth of the flight: the floor between the spectral lines, or what
    the filter derives there from its second differences if that is less. They are never less than
    configured, nor than the sensor's noise at rest.
    """
    floors, differences = np.percentile((flying.floors, flying.differences), _LOW, axis=1)
    shares = np.repeat([imu.gyro_vibration_share, imu.accel_vibration_share], 3)
    followed = np.where(shares > 0, shares * differences, np.inf)
    least = np.array([*imu.angle_random_walk, *imu.velocity_random_walk])
    if len(resting.floors) >= _ENOUGH_REST:
        least = np.maximum(least, np.median(resting.floors, axis=0))
    return np.asarray(np.maximum(least, np.minimum(floors, followed)))


def _axes(
    flying: Pieces, resting: Pieces, imu: ImuConfig, written: Sequence[float]
) -> list[dict[str, Any]]:
    """Return the result of each axis in flight, in SI units."""
    low, median, high = np.percentile(flying.floors, (_LOW, 50, _HIGH), axis=0).tolist()
    columns: dict[str, Sequence[Any]] = {
        "axis": CHANNELS,
        "density_low": low,
        "density": median,
        "density_high": high,
        "second_difference": np.median(flying.differences, axis=0).tolist(),
        "density_at_rest": [None] * 6,
        "configured": [*imu.angle_random_walk, *imu.velocity_random_walk],
        "written": written,
        "lines": [[line._asdict() for line in flying.lines(k)] for k in range(6)],
    }
    if len(resting.floors):
        columns["density_at_rest"] = np.median(resting.floors, axis=0).tolist()
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def flight_table(axes: Sequence[Axis]) -> str:
    """Return the axes in flight as a text table, the gyroscope's above the accelerometer's."""

    def density(key: str) -> Any:
        return lambda axis: "-" if axis[key] is None else f"{axis[key]:.2e}"

    def lines(axis: Axis) -> str:
        named = [f"{x['frequency_hz']:.1f} ({x['amplitude']:.2g})" for x in axis["lines"]]
        return ", ".join(named[:_LINES]) or "-"

    columns = {
        "10 %": density("density_low"),
        "median": density("density"),
        "90 %": density("density_high"),
        "2nd diff.": density("second_difference"),
        "at rest": density("density_at_rest"),
        "configured": density("configured"),
        "written": density("written"),
        "lines: Hz (amplitude)": lines,
    }
    return axes_table(axes, "densities in {density}; lines in {unit}", columns)


def spectra_png(
    flying: Pieces, resting: Pieces, axes: Sequence[Mapping[str, Any]], what: str
) -> bytes:
    """Return a PNG: density over frequency, its spread over the flight, estimated densities."""
    made, panels = axis_panels("density", DENSITIES, "frequency [Hz]")
    made.suptitle(what)
    # Without the mean, which was subtracted, and the last, which is half a bin.
    shown = slice(1, -1)
    hz = flying.frequencies_hz[shown]
    for channel, (panel, axis) in enumerate(zip(panels.flat, axes, strict=True)):
        spectra = flying.spectra[:, shown, channel]
        low, median, high = np.percentile(spectra, (_LOW, 50, _HIGH), axis=0)
        panel.axvspan(0, MOTION_HZ, color="#eeeeee", lw=0, label="motion: not looked at")
        panel.fill_between(hz, low, high, color=COLOURS[0], alpha=0.25, lw=0, label="10 to 90 %")
        panel.semilogy(hz, median, color=COLOURS[0], lw=1.0, label="in flight")
        if len(resting.floors):
            still = np.median(resting.spectra[:, shown, channel], axis=0)
            panel.semilogy(hz, still, color="#999999", lw=1.0, label="at rest")
        for name, style, colour in (
            ("second_difference", ":", COLOURS[4]),
            ("written", "-", COLOURS[1]),
            ("configured", "--", COLOURS[6]),
        ):
            label = name.replace("_", " ")
            panel.axhline(axis[name], ls=style, color=colour, lw=1.4, label=label)
        panel.set_xlim(0, float(flying.frequencies_hz[-1]))
    made.supxlabel(" ", fontsize=12)  # the place of the legend
    handles, labels = panels.flat[0].get_legend_handles_labels()
    made.legend(handles, labels, loc="lower center", ncols=8, fontsize=8)
    return png(made)
