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
"""filter_flight gives what tirgeo process gives, to the last digit, whatever holds the columns."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest
from library_flights import filtered

import tirgeo_ros
from tirgeo_ros import ConfigError, PoseError, TableError
from tirgeo_ros.tools.replay.process import process
from tirgeo_ros.tools.replay.process_outputs import PoseOutputs

FIELDS = ("stamp_ns", "latitude_rad", "longitude_rad", "height_m", "velocity_n", "q_nb")


def processed(monkeypatch, bag, target, **options):
    """What process publishes: solutions, body poses, camera poses; and its summary."""
    result = []
    add = PoseOutputs.add

    def kept(self, registered, *others):
        result.append(registered)
        add(self, registered, *others)

    monkeypatch.setattr(PoseOutputs, "add", kept)
    summary = process(bag, target, images=False, **options)
    navigated = [item for item in result if item.solution is not None]
    cameras = [pose for item in result for pose in item.cameras]
    return navigated, cameras, summary


def same_as_process(monkeypatch, bag, flight, target, **options):
    navigated, cameras, summary = processed(monkeypatch, bag, target, **options)
    assert len(navigated) == len(flight) > 100
    for name in (*FIELDS, "angular_rate_b", "covariance"):
        expected = np.array([getattr(item.solution, name) for item in navigated])
        assert np.array_equal(getattr(flight, name), expected), name
    assert np.array_equal(flight.position_n, [item.body.position_n for item in navigated])
    for pose in cameras[5:-5:7]:
        latency_ns = round(flight.video_latency_s * 1e9)
        mine = flight.picture_pose(pose.stamp_ns + latency_ns).pose
        for name in ("position_n", "q_nc", "covariance"):
            assert np.array_equal(getattr(mine, name), getattr(pose, name)), name
    counts = {
        f"{a} {b}": n for a, of_source in flight.verdicts.items() for b, n in of_source.items()
    }
    assert counts == summary["verdicts"]
    assert (flight.method, flight.state) == (summary["method"], summary["state"])


def test_the_numbers_are_those_of_process(short, flight, params, tmp_path, monkeypatch):
    same_as_process(monkeypatch, short, flight, tmp_path / "out.mcap", params=params)


def test_smoothed_numbers_are_those_of_process(short, tables, params, tmp_path, monkeypatch):
    flight = filtered(tables, config=params, smooth=True)
    options = {"params": params, "smooth": True}
    same_as_process(monkeypatch, short, flight, tmp_path / "out.mcap", **options)
    with pytest.raises(ConfigError, match="method rtk has no filter to smooth"):
        filtered(tables, config={"method": "rtk"}, smooth=True)


def test_what_a_written_bag_holds_is_the_same(short, flight, params, tmp_path):
    process(short, tmp_path / "out.mcap", images=False, params=params)
    odometry = tirgeo_ros.read_bag(tmp_path / "out.mcap", ["tirgeo/odometry"])["tirgeo/odometry"]
    for axis, name in enumerate(("north_m", "east_m", "down_m")):
        assert np.array_equal(odometry[name], flight.position_n[:, axis])
    variance = odometry["covariance_phi_down_rad_phi_down_rad"]
    # The plane's axes differ from those at the aircraft by 1e-5 rad: 60 m over the earth's radius.
    assert np.allclose(np.sqrt(variance), flight.sigma[:, 5], rtol=1e-4)


def structured(table):
    rows = np.zeros(len(table["stamp_ns"]), [(name, item.dtype) for name, item in table.items()])
    for name, item in table.items():
        rows[name] = item
    return rows


@pytest.mark.parametrize(
    "kind", [pd.DataFrame, structured, lambda t: {k: list(v) for k, v in t.items()}]
)
def test_any_table_gives_the_same(kind, tables, flight, params):
    again = filtered({topic: kind(table) for topic, table in tables.items()}, config=params)
    for name in FIELDS:
        assert np.array_equal(getattr(again, name), getattr(flight, name))
    assert isinstance(again.table, pd.DataFrame if kind is pd.DataFrame else dict)
    assert np.array_equal(again.table["heading_rad"], flight.rpy_rad[:, 2])


def test_the_table_says_what_the_arrays_say(flight):
    table = flight.table
    assert {item.shape for item in table.values()} == {(len(flight),)}
    assert not any(np.isnan(item).any() for item in table.values())
    assert np.allclose(table["sigma_heading_rad"] ** 2, flight.covariance[:, 5, 5], rtol=1e-12)
    assert np.array_equal(table["velocity_down_m_s"], flight.velocity_n[:, 2])


def test_degrees_sigmas_and_datetimes_are_taken_too(tables, flight, params):
    fix, heading = dict(tables["rtk/fix"]), dict(tables["rtk/heading"])
    fix["latitude_deg"] = np.degrees(fix.pop("latitude_rad"))
    fix["sigma_down_m"] = np.sqrt(fix.pop("variance_down_m2"))
    heading["sigma_deg"] = np.degrees(np.sqrt(heading.pop("variance_rad2")))
    others = {"rtk/fix": fix, "rtk/heading": heading}
    stamped = {
        topic: table | {"stamp_ns": table["stamp_ns"].astype("datetime64[ns]")}
        for topic, table in (tables | others).items()
    }
    again = filtered(stamped, config=params)
    assert np.array_equal(again.stamp_ns, flight.stamp_ns)
    assert np.allclose(again.position_n, flight.position_n, atol=1e-6, rtol=0)


def test_without_heading_the_method_is_the_one_without(tables, params):
    flight = filtered(tables, heading=None, joints=None, camera_attitude=None, config=params)
    assert flight.method == "ekf"
    with pytest.raises(PoseError, match="give filter_flight joints or camera_attitude"):
        flight.picture_pose(int(flight.stamp_ns[-1]))


def test_pressure_and_a_heading_that_was_set_are_taken(tables, params):
    """The bag has neither: 30 m up in the standard atmosphere; the nose roughly south."""
    stamps = tables["rtk/heading"]["stamp_ns"]
    level = np.zeros(len(stamps))
    pressure = {"stamp_ns": stamps, "pressure_pa": level + 100_965.0, "sigma_pa": level + 5.0}
    set_heading = {"stamp_ns": stamps[20:21], "heading_deg": [200.0], "sigma_deg": [3.0]}
    flight = filtered(tables, pressure=pressure, set_heading=set_heading, config=params)
    assert sum(flight.verdicts["barometer"].values()) >= len(stamps)
    assert flight.verdicts["set_heading"]["standby"] == 1  # RTK's heading is there


def test_parameters_may_be_a_mapping(tables, flight):
    """Those of the sample's file that are not the defaults."""
    config = {
        "aircraft.rtk_antenna_m": np.array([-0.1, 0.32, 0.38]),  # NumPy's numbers are numbers
        "aircraft.second_antenna_m": [0.9, 0.32, 0.38],
        "aircraft.gps_antenna_m": [0.0, 0.0, 0.28],
        "aircraft.gimbal_pivot_m": [0.08, 0.0, -0.25],
        "aircraft.camera_from_pivot_m": [0.05, 0.02, -0.01],
        "origin_lat_lon_h": [39.85, 116.7, 11.5],
        "ground_height_m": np.float64(11.5),
    }
    assert np.array_equal(filtered(tables, config=config).position_n, flight.position_n)
    with pytest.raises(
        ConfigError, match=r"unknown parameter orign_lat_lon_h \(did you mean origin"
    ):
        filtered(tables, config={"orign_lat_lon_h": []})
    with pytest.raises(ConfigError, match=r"no_such.yaml"):
        filtered(tables, config="no_such.yaml")
    with pytest.raises(ConfigError, match="dict cannot be the name of a file"):
        filtered(tables, config=[config])


def test_a_flight_without_a_position_warns_and_is_empty(tables, params):
    why = "filter_flight: no solution: there is no position: give rtk_fix or gps_fix"
    with pytest.warns(UserWarning, match=why):
        flight = tirgeo_ros.filter_flight(tables["imu/data"], config=params)
    assert len(flight) == 0
    assert flight.covariance.shape == (0, 9, 9)
    assert flight.state == "waiting"
    assert {item.shape for item in flight.table.values()} == {(0,)}


def test_the_warning_says_what_was_refused(tables, params):
    """The filter needs rtk/fix, and has 30 of them, each with an impossible latitude."""
    fix = tables["rtk/fix"] | {"latitude_rad": np.degrees(tables["rtk/fix"]["latitude_rad"])}
    count = len(fix["stamp_ns"])
    refused = rf"no solution: needs rtk/fix.* \(refused: {count} rtk_position invalid\)"
    with (
        pytest.warns(UserWarning, match="name it latitude_deg"),
        pytest.warns(UserWarning, match=refused),
    ):
        filtered(tables, rtk_fix=fix, gps_fix=None, config=params)


def test_samples_that_are_no_numbers_are_refused_and_counted(tables, params):
    fix = {name: item.copy() for name, item in tables["rtk/fix"].items()}
    fix["height_m"][10:13] = np.nan
    with pytest.warns(UserWarning, match=r"^rtk_fix: 3 of \d+ rows have a nan, as in height_m"):
        result = filtered(tables | {"rtk/fix": fix}, config=params)
    assert result.verdicts["rtk_position"]["invalid"] == 3


@pytest.mark.parametrize("column", ["stamp_ns", "force_down_m_s2"])
def test_masked_values_and_another_table_are_refused_by_the_arguments_name(tables, column):
    """NumPy would take what is below the mask."""
    imu = dict(tables["imu/data"])
    imu[column] = np.ma.masked_array(imu[column], np.arange(len(imu[column])) < 7)
    with pytest.raises(TableError, match=rf"^imu: column {column} has 7 masked values"):
        tirgeo_ros.filter_flight(imu)
    with pytest.raises(TableError, match=r"^heading: no column heading_rad or heading_deg"):
        tirgeo_ros.filter_flight(tables["imu/data"], heading=tables["gps/vel"])


@pytest.mark.parametrize("axes", ["down", "down right", "down right forward"])
def test_an_imu_whose_gravity_has_the_wrong_sign_is_named(tables, params, axes):
    """z up, flipped about the roll axis, or all signs."""
    imu = dict(tables["imu/data"])
    for axis in axes.split():
        imu[f"force_{axis}_m_s2"] = -imu[f"force_{axis}_m_s2"]
    why = r"no solution: .*not \(0, 0, \+9\.8\): .*the sign is wrong: at rest z is"
    with pytest.warns(UserWarning, match=why):
        filtered(tables | {"imu/data": imu}, config=params)


@pytest.mark.parametrize(
    ("stamp_ns", "reason"),
    [
        *(
            (stamp, "stamp_ns: must be a number of ns, is")
            for stamp in ("x", None, math.nan, math.inf, [1])
        ),
        (0, "before the first"),
        (int(2e18), "after the last, at 16347"),
    ],
)
def test_a_stamp_that_is_none_or_has_no_pose(flight, stamp_ns, reason):
    with pytest.raises(PoseError, match=reason):
        flight.picture_pose(stamp_ns)
