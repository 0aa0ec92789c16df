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
"""Estimate the white noise of an IMU in flight: the work of ``tirgeo calibrate imu``."""

from __future__ import annotations

import math
import os
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.calibration.flight_noise import MOTION_HZ, PIECE_S, Pieces, pieces_of
from tirgeo_ros.core.calibration.imu_record import ImuRecord, record_of
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.filter_parameters import ImuConfig
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.errors import BagError, CalibrationError
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs
from tirgeo_ros.io.messages.topics import resolved
from tirgeo_ros.io.parameters.parameter_file import Files, ParameterFile, parameters_yaml, paths_of
from tirgeo_ros.tools.calibrate.result import written
from tirgeo_ros.tools.presentation.plots import COLOURS, figure, png
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.presentation.results import table
from tirgeo_ros.tools.replay.node_configs import node_configs

_ORDERS = {b"\0\1": "<", b"\0\0": ">"}
#: Numbers of a message: orientation, rate and acceleration, each followed by its covariance (9).
_NUMBERS, _RATE, _FORCE = 37, slice(13, 16), slice(25, 28)
_TYPE = "sensor_msgs/msg/Imu"
_BLOCK = 1 << 15  # messages decoded together
_SLACK_S = 60.0  # stop reading at messages logged this long after the last wanted stamp
CHANNELS = tuple(f"{sensor} {axis}" for sensor in ("gyro", "accel") for axis in "xyz")
#: Units of the samples and of their noise density.
UNITS = {"gyro": "rad/s", "accel": "m/s2"}
DENSITIES = {"gyro": "rad/sqrt(s)", "accel": "m/s/sqrt(s)"}
#: The result of an axis: name -> value.
Axis = Mapping[str, Any]
#: Limits of a record at rest, and of one in flight.
_LEAST_REST_HZ, _LEAST_HZ = 5.0, 40.0
LEAST_FLIGHT_S = 20.0  # a shorter flight does not determine the noise
_MUCH = 0.01  # share of lost, disordered or equal samples that causes a warning
_SHAKY = 0.4  # jitter as a fraction of the step
_ENOUGH_REST = 3  # pieces at rest needed for a density that is accurate to 3 %
_LOW, _HIGH = 10, 90  # percentiles
_LINES = 3  # most spectral lines of an axis that are shown
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
    needed("scipy", "estimating the noise", CalibrationError)
    if picture is not None:
        needed("matplotlib", f"drawing {picture}", CalibrationError)
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
    """Raise CalibrationError (one line) if a record cannot show the noise in flight."""
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
        f"a record of {recorded_s:.0f} s is too short; {needed}": recorded_s < LEAST_FLIGHT_S,
        f"the IMU lies still for {resting_s} of {recorded_s:.0f} s: no flight; use tirgeo "
        "calibrate allan for the noise at rest": few
        and resting_s > recorded_s - 2 * LEAST_FLIGHT_S,
        f"only {flying_s} s of flight have all samples; {needed}, without loss": few,
    }
    for reason, is_so in faults.items():
        if is_so:
            raise CalibrationError(f"{read.where}: {reason}")
    check_alive(read.where, pieces.differences)


def _floor(flying: Pieces, resting: Pieces, imu: ImuConfig) -> Array:
    """Return the densities (6,) to write: a floor below the noise that the filter itself follows.

    They come from the calmest tenth of the flight: the floor between the spectral lines or, if
    less, the density that the filter derives there from second differences. They are never less
    than the configured densities, nor than the sensor's noise at rest.
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
    flying: Pieces, resting: Pieces, axes: Sequence[Mapping[str, Any]], title: str
) -> bytes:
    """Return a PNG: density over frequency, its spread over the flight, estimated densities."""
    chart, panels = axis_panels("density", DENSITIES, "frequency [Hz]")
    chart.suptitle(title)
    # Leave out the mean, which was subtracted, and the last bin, which is half as wide.
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
    chart.supxlabel(" ", fontsize=12)  # the place of the legend
    handles, labels = panels.flat[0].get_legend_handles_labels()
    chart.legend(handles, labels, loc="lower center", ncols=8, fontsize=8)
    return png(chart)


class ImuBlock(NamedTuple):
    """Hold samples in the order of their messages, FLU as in the message."""

    stamps_ns: npt.NDArray[np.int64]  # (n,)
    values: Array  # (n, 6) angular rate (rad/s), specific force (m/s2); NaN where absent
    unreadable: int  # messages that are not an Imu


def imu_block(messages: Sequence[bytes]) -> ImuBlock:
    """Decode the readable ones of these CDR messages; those of one layout are decoded together."""
    number = len(messages)
    stamps_ns, values = np.zeros(number, np.int64), np.zeros((number, 6))
    readable = np.zeros(number, bool)
    layouts: dict[tuple[bytes, bytes, int], list[int]] = defaultdict(list)
    for place, data in enumerate(messages):
        layouts[data[:2], data[12:16], len(data)].append(place)  # byte order, length of the frame
    for (mark, length, size), places in layouts.items():
        order = _ORDERS.get(mark, "")
        frame = int.from_bytes(length, "little" if order == "<" else "big")
        begin = 4 + (12 + frame + 7) // 8 * 8  # numbers are aligned to 8 behind the encapsulation
        end = begin + 8 * _NUMBERS
        if not order or len(length) < 4 or end > size:
            continue
        rows = np.frombuffer(b"".join(messages[k] for k in places), np.uint8).reshape(-1, size)
        times = rows[:, 4:12].copy().view(f"{order}i4").astype(np.int64)
        numbers = rows[:, begin:end].copy().view(f"{order}f8").astype(float)
        stamps_ns[places], readable[places] = times @ [1_000_000_000, 1], True
        for first, part in ((0, _RATE), (3, _FORCE)):
            absent = numbers[:, part.stop : part.stop + 1] == -1.0  # of the covariance
            values[places, first : first + 3] = np.where(absent, np.nan, numbers[:, part])
    return ImuBlock(stamps_ns[readable], values[readable], int((~readable).sum()))


@dataclass(frozen=True)
class ReadImu:
    """Hold the record of a topic."""

    where: str  # bag and topic
    topic: str
    record: ImuRecord
    messages: int
    unreadable: int

    def numbers(self) -> dict[str, object]:
        """Return the numbers of the record that the results of all calibrations have."""
        return {
            "topic": self.topic,
            "messages": self.messages,
            "samples": self.record.samples,
            "rate_hz": 1 / self.record.step_s,
            "jitter_ms": self.record.jitter_s * 1e3,
            "irregular": {"unreadable": self.unreadable, **self.record.irregular},
        }

    def warnings(self) -> list[str]:
        """Return what is wrong with the samples, at rest or in flight."""
        faults, samples = self.record.irregular, max(self.record.samples, 1)
        lost = faults["missing"] + faults["not_finite"] + self.unreadable
        texts = {
            f"{lost} samples are missing, unreadable or not finite; {samples} are usable": lost,
            "stamps repeat the previous one or go back; their samples are left out": (
                faults["repeated_stamps"] + faults["late_stamps"]
            ),
            "samples equal the one before: the topic is faster than the sensor, or the sensor's "
            "resolution is coarse": faults["same_as_before"],
        }
        return [text for text, number in texts.items() if number > _MUCH * samples]


def read_imu(
    reader: BagReader, topic: str, from_s: float, to_s: float, progress: Report
) -> ReadImu:
    """Read a topic between two times (s) since its first message.

    Raise BagError if the topic is absent or of another type, CalibrationError for an unusable
    record.
    """
    _check_topic(reader, topic)
    where = f"{reader.path}: {topic}"
    begin_ns, end_ns = reader.span_ns
    blocks: list[tuple[IntArray, Array]] = []  # stamps and values
    number = unreadable = 0
    first_ns: int | None = None
    messages = reader.messages([topic])
    while chunk := list(islice(messages, _BLOCK)):
        block = imu_block([message.data for message in chunk])
        number, unreadable = number + len(chunk), unreadable + block.unreadable
        if first_ns is None and len(block.stamps_ns):
            first_ns = int(block.stamps_ns[0])
        since_s = (block.stamps_ns - (first_ns or 0)) * 1e-9
        wanted = (since_s >= from_s) & (since_s <= to_s)
        blocks.append((block.stamps_ns[wanted], block.values[wanted]))
        done_s = (chunk[-1].log_time_ns - begin_ns) * 1e-9
        progress(done_s, min((end_ns - begin_ns) * 1e-9, to_s))
        if done_s > to_s + _SLACK_S:
            break
    if not any(np.isfinite(values).all(axis=1).any() for _, values in blocks):
        raise CalibrationError(
            f"{where}: none of {number} messages has a sample between these times; check --from "
            "and --to"
        )
    stamps_ns = np.concatenate([stamps for stamps, _ in blocks])
    values = np.concatenate([values for _, values in blocks])
    blocks.clear()
    try:
        record = record_of(stamps_ns, values)
    except CalibrationError as error:
        raise CalibrationError(f"{where}: {error}") from None
    if 1 / record.step_s < _LEAST_REST_HZ:
        raise CalibrationError(
            f"{where}: {1 / record.step_s:.3g} samples a second are too few; record at 50 Hz or "
            "more"
        )
    return ReadImu(where=where, topic=topic, record=record, messages=number, unreadable=unreadable)


def _check_topic(reader: BagReader, name: str) -> None:
    topics = reader.topics()
    if topics.get(name) != _TYPE:
        others = ", ".join(topic for topic, kind in topics.items() if kind == _TYPE) or "none"
        what = f"is of type {topics[name] or 'nothing'}" if name in topics else "is absent"
        raise BagError(
            f"{reader.path}: {name} {what}; topics of {_TYPE}: {others}; "
            "give --topic or --namespace"
        )


def channel_names(flags: Iterable[object]) -> str:
    """Return the names of the channels whose flag (6,) is true."""
    return ", ".join(name for name, flag in zip(CHANNELS, flags, strict=True) if flag)


def check_alive(where: str, sizes: Array) -> None:
    """Raise CalibrationError if the sizes of change (n, 6) of an axis are all zero."""
    dead = channel_names((sizes == 0).all(axis=0).tolist())
    if dead:
        raise CalibrationError(f"{where}: {dead}: never changes; record measured values")


def axes_table(
    axes: Sequence[Axis], head: str, columns: Mapping[str, Callable[[Axis], str]]
) -> str:
    """Return a table of the axes for each sensor, below a head; ``columns`` map title -> text.

    ``head`` names in braces the unit of the samples and that of the noise density.
    """
    parts = []
    for sensor, unit in UNITS.items():
        own = [axis for axis in axes if axis["axis"].startswith(sensor)]
        rows = [[axis["axis"][-1], *(text(axis) for text in columns.values())] for axis in own]
        parts.append(f"{sensor}: {head.format(unit=unit, density=DENSITIES[sensor])}")
        parts.append(table([["axis", *columns], *rows]))
    return "\n".join(parts)


def axis_panels(quantity: str, units: Mapping[str, str], x_label: str) -> tuple[Any, Any]:
    """Return a figure and (2, 3) panels, one for each axis."""
    chart, panels = figure(12.0, 7.2, 2, 3, sharex=True, sharey="row")
    for panel, name in zip(panels.flat, CHANNELS, strict=True):
        panel.set_title(name)
    for row, unit in zip(panels, units.values(), strict=True):
        row[0].set_ylabel(f"{quantity} [{unit}]")
    for panel in panels[1]:
        panel.set_xlabel(x_label)
    return chart, panels
