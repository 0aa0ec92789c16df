"""Estimate antennas, delays and the IMU's level from a flight: ``tirgeo calibrate aircraft``."""

from __future__ import annotations

import os
from collections.abc import Collection, Sequence

from tirgeo_ros.core.aircraft_calibration.filter_run import FlightRuns
from tirgeo_ros.core.aircraft_calibration.fit import PARTS, AircraftFit, fit
from tirgeo_ros.core.aircraft_calibration.mounting_level import LEVEL, mounting_level
from tirgeo_ros.core.aircraft_calibration.parameters import ANTENNA, PARAMETERS
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, write_files
from tirgeo_ros.io.parameters.parameter_file import Files, parameters_yaml, paths_of
from tirgeo_ros.tools.calibrate.aircraft_flight import read_aircraft
from tirgeo_ros.tools.calibrate.aircraft_result import KEYS, aircraft_lines, summary
from tirgeo_ros.tools.calibrate.estimates import head
from tirgeo_ros.tools.calibrate.residual_plots import innovations_png
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.node_configs import node_configs

#: Names of ``hold`` and the parameters that each holds.
HOLDS = {
    "antenna": PARAMETERS[ANTENNA],
    "baseline": ("baseline_azimuth",),
    **{name: (name,) for name in ("position_delay", "velocity_delay", "heading_delay")},
    "level": LEVEL,
    # Holds the delay of its positions, so that the IMU's delay is estimated instead.
    "rtk": ("rtk",),
}
_USUAL_RUNS = 18


def calibrate_aircraft(
    bag_in: PathLike,
    output: PathLike | None = None,
    *,
    params: Files = None,
    hold: Collection[str] = (),
    namespace: str = "",
    plot: PathLike | None = None,
    progress: Report = silent,
) -> dict[str, object]:
    """Estimate the aircraft's parameters from a flight and write them; return a summary.

    ``hold`` lists keys of HOLDS; their parameters keep their values. ``plot`` is a PNG of the
    innovations. Raise CalibrationError if no parameter is determined, BagError, ConfigError.
    """
    configs = node_configs(params, namespace)
    config = configs.ekf
    check_outputs((bag_in, *paths_of(params), *configs.files), (output, plot), CalibrationError)
    held = [name for key in hold for name in HOLDS[key]]
    reader = BagReader(bag_in)
    read = read_aircraft(reader, namespace, config.max_imu_gap_s)
    runs = FlightRuns(read.recorded, config)
    found = _fitted(reader, runs, held, progress)
    level = mounting_level(found.after, runs.recorded.imu, PARTS)
    result = summary(config, found, level, held)
    numbers = {"parameters": result.estimates, "not_told": result.untold, "nis": result.nis}
    notes = read.notes + result.notes
    contents: dict[PathLike, str | bytes] = {}
    if output is not None:
        lines = head("aircraft", os.fspath(bag_in), aircraft_lines(numbers), notes)
        contents[output] = parameters_yaml(result.nodes, lines)
    if plot is not None:
        contents[plot] = innovations_png(found)
    write_files(contents, CalibrationError)
    return {
        "input": os.fspath(bag_in),
        "output": [os.fspath(path) for path in contents],
        **numbers,
        "seconds": read.seconds,
        "imu_samples": len(read.recorded.imu),
        "measurements": len(read.recorded.aids),
        "notes": notes,
        "error": None if reader.damage is None else f"{reader.path}: {reader.damage}",
    }


def _fitted(
    reader: BagReader, runs: FlightRuns, held: Sequence[str], progress: Report
) -> AircraftFit:
    """Return the fit; raise CalibrationError, with each reason once, if it has no parameter."""
    try:
        found = fit(runs, held, lambda done: progress(done, max(_USUAL_RUNS, done + 1)))
    except CalibrationError as error:
        raise CalibrationError(f"{reader.path}: {error}") from None
    if not found.told:
        names: dict[str, list[str]] = {}
        for name, reason in found.untold.items():
            names.setdefault(reason, []).append(f"{name} ({KEYS[name]})")
        named = "; ".join(f"{', '.join(some)}: {reason}" for reason, some in names.items())
        raise CalibrationError(f"{reader.path}: the flight shows no parameter: {named}")
    return found
