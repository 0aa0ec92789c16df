"""Format the noise of an IMU in flight on each axis, for programs and for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tirgeo_ros.core.calibration.allan.flight_noise import Pieces
from tirgeo_ros.core.config.filter import ImuConfig
from tirgeo_ros.core.navigation.imu_clipping import CHANNELS as CLIPPED
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.calibrate.imu_record import CHANNELS

_UNITS = {"gyro": "rad/s", "accel": "m/s2"}
#: Sensor -> the unit of its noise density.
DENSITIES = {"gyro": "rad/sqrt(s)", "accel": "m/s/sqrt(s)"}
_COLUMNS = (
    *("axis", "10 %", "median", "90 %", "2nd diff.", "at rest", "configured", "written"),
    *("rms", "peak", "clipped", "lines: Hz (amplitude)"),
)
#: Percentiles of low and high.
LOW, HIGH = 10, 90
_NAMED_LINES = 3


def axes_of(
    flying: Pieces,
    resting: Pieces,
    clipped: Mapping[str, int],
    imu: ImuConfig,
    written: Sequence[float],
) -> list[dict[str, Any]]:
    """Return the result of each axis (gyroscope x, y, z, accelerometer x, y, z) in SI units."""
    low, median, high = np.percentile(flying.floors, (LOW, 50, HIGH), axis=0).tolist()
    rest = np.median(resting.floors, axis=0).tolist() if len(resting.starts_s) else [None] * 6
    configured = [*imu.angle_random_walk, *imu.velocity_random_walk]
    return [
        {
            "axis": name,
            "density_low": low[channel],
            "density": median[channel],
            "density_high": high[channel],
            "second_difference": float(np.median(flying.differences[:, channel])),
            "density_at_rest": rest[channel],
            "configured": configured[channel],
            "written": written[channel],
            "vibration_rms": _rms(flying.rms[:, channel]),
            "vibration_peak": float(flying.peaks[:, channel].max()),
            "clipped": clipped.get(CLIPPED[(channel + 3) % 6], 0),
            "lines": [
                {"frequency_hz": line.frequency_hz, "amplitude": line.amplitude}
                for line in flying.lines(channel)
            ],
        }
        for channel, name in enumerate(CHANNELS)
    ]


def _rms(parts: Array) -> float:
    return float(np.sqrt(np.mean(parts**2)))


def table(axes: Sequence[Mapping[str, Any]]) -> str:
    """Return the axes as a text table, the gyroscope's above the accelerometer's."""
    lines = []
    for sensor, unit in _UNITS.items():
        rows = [_row(axis) for axis in axes if axis["axis"].startswith(sensor)]
        lines.append(f"{sensor}: densities in {DENSITIES[sensor]}; rms, peak and lines in {unit}")
        widths = [max(map(len, column)) for column in zip(_COLUMNS, *rows, strict=True)]
        lines += [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in (_COLUMNS, *rows)
        ]
    return "\n".join(lines)


def _row(axis: Mapping[str, Any]) -> tuple[str, ...]:
    rest = axis["density_at_rest"]
    lines = ", ".join(
        f"{line['frequency_hz']:.1f} ({line['amplitude']:.2g})"
        for line in axis["lines"][:_NAMED_LINES]
    )
    return (
        axis["axis"][-1],
        *(f"{axis[name]:.2e}" for name in ("density_low", "density", "density_high")),
        f"{axis['second_difference']:.2e}",
        "-" if rest is None else f"{rest:.2e}",
        *(f"{axis[name]:.2e}" for name in ("configured", "written")),
        *(f"{axis[name]:.3g}" for name in ("vibration_rms", "vibration_peak")),
        str(axis["clipped"]),
        lines or "-",
    )
