"""The budget's numbers, its files and its command, and Equation 22 on errors that are known."""

from __future__ import annotations

import csv
import json
import math

import cv2
import numpy as np
import pytest

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.frames.rotations import matrix_from_quat, quat_from_matrix, rotation_z
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.core.types.measurements import FixStatus, ImuSample, PositionSample, Source
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.bags.bag import BagReader, BagWriter
from tirgeo_ros.io.pictures.camera_file import camera_yaml
from tirgeo_ros.tools.budget.budget import Setting, budget, make_budget
from tirgeo_ros.tools.budget.sensor_errors import camera_track, gps_less_rtk_n
from tirgeo_ros.tools.cli import main as command


def row(rows, factor, form="general"):
    return next(r for r in rows if (r["factor"], r["form"]) == (factor, form))


def test_the_forms_agree_for_a_pinhole_camera_and_factors_add_up_in_squares():
    made = budget(Setting(Camera(640, 512, 800.0, 800.0, 319.5, 255.5)))
    for factor in ("position", "height", "position 3d", "heading"):
        np.testing.assert_allclose(made.general[factor], made.closed[factor], rtol=1e-9)
    squares = {name: picture**2 for name, picture in made.general.items()}
    parts = sum(squares[name] for name in ("position", "height", "heading", "tilt"))
    np.testing.assert_allclose(squares["pose"], parts, rtol=1e-9)
    others = sum(squares[name] for name in ("latency", "lens", "ground"))
    np.testing.assert_allclose(squares["all"] - squares["pose"], others, rtol=1e-9)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"height_m": 0.0}, "the camera is 0 m above the ground"),
        ({"depression_deg": -5.0}, "the camera looks down by -5 deg: give above 0 to 90"),
        ({"roll_error_deg": -1.0}, "roll_error_deg is -1: must be 0 or more"),
        ({"east_error_m": math.nan}, "east_error_m is nan: must be 0 or more"),
    ],
)
def test_what_makes_no_sense_is_refused(values, said):
    with pytest.raises(CalibrationError, match=said):
        make_budget(values)


def test_a_view_of_the_sky_is_refused():
    camera = Camera(640, 200, 800.0, 800.0, 319.5, 900.0)  # sees only what is over its axis
    with pytest.raises(CalibrationError, match="sees no ground: look further down"):
        budget(Setting(camera, depression_deg=1.0)).rows()


def test_files(tmp_path, capsys):
    out = tmp_path / "budget"
    assert command.main(["budget", "--height", "60", "--tilt", "45", "-o", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "camera 60 m above the ground, 45 deg down" in shown
    with (out / "budget.csv").open() as file:
        height = row(list(csv.DictReader(file)), "height")
    assert f"{float(height['mean_m']):.3f}" in shown
    for name in ("height", "heading", "all"):
        assert cv2.imread(str(out / f"{name}.png")).shape[2] == 3


def test_a_middle_over_the_horizon_has_no_number(capsys, tmp_path):
    (tmp_path / "camera.yaml").write_text(
        camera_yaml(Camera(640, 512, 800.0, 800.0, 319.5, 300.0)), encoding="utf-8"
    )
    arguments = ["budget", "--tilt", "1", "--camera", str(tmp_path / "camera.yaml")]
    assert command.main(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    # 800 px * tan(1 deg) = 13.96 px above row 300 is the horizon: of rows 0, 4 ... 284 of 508.
    assert any(line.startswith("56% of the picture lies above the horizon") for line in lines)
    assert next(line for line in lines if line.startswith("all  ")).split()[2] == "-"
    table = [line for line in lines if " general " in line or " closed " in line]
    assert {len(line.split()) for line in table} == {7, 8, 9}  # no two numbers run together
    assert command.main([*arguments, "--json"]) == 0
    told = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert row(told["rows"], "all")["middle_m"] is None
    assert told["ground_share"] == pytest.approx(56 / 128)


def test_of_a_flight(sample):
    """The sample's errors are those that it was made with, and its filter is far better."""
    result = make_budget({}, bag=sample / "flight.mcap", params=[sample / "params.yaml"])
    told = result["flight"]
    # DJI's GPS errs by 2.8 m in height over this flight's 45 s, the autopilot's north by 1 deg.
    assert 1.0 < told["height_error_m"] < 5.0
    assert 0.3 < told["heading_error_deg"] < 3.0
    assert result["height_m"] == pytest.approx(20.0, abs=0.5)
    assert result["depression_deg"] == pytest.approx(30.0, abs=0.5)
    assert row(result["rows_of_the_filter"], "pose")["mean_m"] < 0.5
    assert row(result["rows"], "pose")["mean_m"] > 3.0
    assert result["warning"] is None


@pytest.mark.slow
def test_a_flight_without_gps_and_with_messages_that_cannot_be_read(sample, tmp_path, capsys):
    reader = BagReader(sample / "flight.mcap")
    with BagWriter(tmp_path / "nogps.mcap") as writer:
        for k, item in enumerate(reader.messages()):
            if not item.topic.startswith(("/gps/", "/thermal/image")):
                cut = item.topic == "/imu/data" and k % 500 == 0
                data = item.data[:20] if cut else item.data
                writer.write(item.topic, item.typename, data, item.log_time_ns)
    arguments = ["budget", str(tmp_path / "nogps.mcap"), "--params", str(sample / "params.yaml")]
    assert command.main(arguments) == 0
    told, complaint = capsys.readouterr()
    assert "nan" not in told
    assert told.count("not recorded: the paper's is used") == 3  # east, north, height
    assert "nogps.mcap: " in complaint
    assert " messages could not be used" in complaint


@pytest.mark.slow
def test_a_flight_over_unknown_ground(sample):
    with pytest.raises(CalibrationError, match=r"flight\.mcap: height of the ground not known"):
        make_budget({}, bag=sample / "flight.mcap")
    assert make_budget({"height_m": 20.0}, bag=sample / "flight.mcap")["height_m"] == 20.0


PLANE = TangentPlane(0.6955, 2.0368, 11.5)
Q_NB = quat_from_matrix(rotation_z(np.radians(90.0)))  # the nose to the east
ARMS = {"aircraft.rtk_antenna_m": (0.5, 0, 0.4), "aircraft.gps_antenna_m": (0, 0.3, 0.1)}  # FLU
CONFIG = config_from(EkfConfig, ARMS)
OFF_N = np.array([1.0, -2.0, 3.0])


def imu(count=200):
    force, rate = np.array([0, 0, -9.8]), np.zeros(3)
    return [ImuSample(10**9 + k * 10_000_000, force, rate, Q_NB) for k in range(count)]


def track(source, rate_hz, arm_b, off_n=(0, 0, 0), status=FixStatus.FIXED, seconds=2.0):
    """Flown to the north-east at 5 m/s, as an antenna finds it."""
    found = []
    for k in range(int(seconds * rate_hz)):
        t_s = k / rate_hz
        place_n = np.array([3.0, 4.0, 0.1]) * t_s + matrix_from_quat(Q_NB) @ arm_b + off_n
        place = map(float, PLANE.geodetic_from_ned(place_n))
        stamp_ns = 10**9 + round(t_s * 1e9)
        found.append(PositionSample(stamp_ns, source, status, *place, np.eye(3)))
    return found


def test_the_antennas_places_and_rates_do_not_matter_but_rtk_must_be_fixed():
    rtk = track(Source.RTK_POSITION, 5, CONFIG.aircraft.rtk_lever_b)
    gps = track(Source.GPS_POSITION, 7, CONFIG.aircraft.gps_lever_b, OFF_N, FixStatus.SINGLE)
    errors = gps_less_rtk_n([*gps, *rtk], imu(), PLANE, CONFIG)
    # the last RTK is at 1.8 s: 13 of the GPS's come before
    np.testing.assert_allclose(errors, np.tile(OFF_N, (13, 1)), atol=1e-6)
    rtk = track(Source.RTK_POSITION, 5, CONFIG.aircraft.rtk_lever_b, status=FixStatus.FLOAT)
    assert gps_less_rtk_n([*rtk, *gps], imu(), PLANE, CONFIG).shape == (0, 3)


def test_no_truth_across_a_gap():
    rtk = track(Source.RTK_POSITION, 5, CONFIG.aircraft.rtk_lever_b, seconds=4.0)
    gps = track(Source.GPS_POSITION, 5, CONFIG.aircraft.gps_lever_b, OFF_N, FixStatus.SINGLE, 4.0)
    left = [p for k, p in enumerate(rtk) if not 5 <= k <= 10]  # none from 0.8 to 2.2 s
    # five up to 0.8 s, eight after 2.2 s, whose own RTK ends the gap
    errors = gps_less_rtk_n([*left, *gps], imu(400), PLANE, CONFIG)
    np.testing.assert_allclose(errors, np.tile(OFF_N, (13, 1)), atol=1e-6)


def test_the_cameras_way_and_its_covariance_along_it():
    """A camera to the east, 40 deg down, whose error ahead is the largest."""
    down = np.radians(40.0)
    ahead_n = np.array([0.0, np.cos(down), np.sin(down)])
    right_n = np.array([-1.0, 0.0, 0.0])
    rotation_nc = np.stack([right_n, np.cross(ahead_n, right_n), ahead_n], axis=1)
    q_nc = quat_from_matrix(rotation_nc)
    covariance = np.diag([1.0, 9.0, 4.0, 1e-4, 9e-4, 4e-4])
    poses = [
        CameraPose(k * 10**8, np.array([0, 0.2 * k, -20]), q_nc, covariance) for k in range(5)
    ]
    found = camera_track(poses, PLANE)
    assert found.depression_deg == pytest.approx(40.0)
    assert found.speed_m_s == pytest.approx(2.0)
    assert found.height_m == pytest.approx(31.5, abs=1e-6)
    np.testing.assert_allclose(
        found.covariance_a, np.diag([9.0, 1.0, 4.0, 9e-4, 1e-4, 4e-4]), atol=1e-12
    )
