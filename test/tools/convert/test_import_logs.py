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
"""tirgeo import of logs: several of one flight, every real one, damaged ones, and the command."""

from __future__ import annotations

import json
import math
import sys
from contextlib import suppress
from dataclasses import replace

import pytest
from autopilot_logs import MAGIC
from foreign_logs import IMU, IMU_COLUMNS, OPTIONS, POS, SRT, pvt, relposned, samples
from hypothesis import given, settings, strategies as st
from project import PROJECT

from tirgeo_ros.core.types.errors import LogError, TirgeoError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.convert.import_flight import import_flight


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "imu.csv").write_text(IMU)
    (tmp_path / "imu.yaml").write_text(IMU_COLUMNS)
    (tmp_path / "rover.pos").write_text(POS)
    (tmp_path / "clip.srt").write_text(SRT)
    return tmp_path


def imported(folder, *names, **more):
    paths = [folder / name for name in names]
    return import_flight(paths, folder / "out.mcap", **{"logs": OPTIONS} | more)


def test_logs_of_one_flight_are_merged_by_their_stamps(folder):
    options = replace(OPTIONS, set_heading_rad=1.0)
    columns = [folder / "imu.yaml"]
    names = ("rover.pos", "imu.csv", "clip.srt")
    result = imported(folder, *names, columns=columns, logs=options)
    assert {topic: observed["messages"] for topic, observed in result["written"].items()} == {
        "/imu/data": 19,
        "/rtk/fix": 2,
        "/gps/fix": 2,
        "/gimbal/attitude": 2,
        "/ekf_node/set_heading": 1,
    }
    logged = [m.log_time_ns for m in BagReader(folder / "out.mcap").messages()]
    assert logged == sorted(logged)
    outcome = samples(folder / "out.mcap")
    assert outcome["ekf_node/set_heading"][0].heading_rad == pytest.approx(1.0)
    for each in outcome.values():
        assert {s.stamp_ns for s in each} <= set(logged)
    forms = [log["form"] for log in result["files"]]
    assert forms == ["RTKLIB .pos", "CSV", "DJI subtitles (SRT)"]
    assert "imu.csv: refused 1 imu: imu.gyro.columns.3 is not a number" in result["warning"]
    assert "geoid" not in result["warning"]  # of DJI's receivers
    again = folder / "again.mcap"
    import_flight([folder / name for name in names], again, logs=options, columns=columns)
    assert again.read_bytes() == (folder / "out.mcap").read_bytes()


def test_a_topic_comes_from_the_first_log_that_has_it(folder):
    """Two receivers on one topic would look like one that jumps between two places."""
    moved = POS.replace("48.137", "48.138")
    (folder / "base.pos").write_text(moved)
    result = imported(folder, "base.pos", "rover.pos")
    assert "rover.pos: refused 2 rtk/fix: " in result["warning"]
    assert "base.pos, named earlier, has it" in result["warning"]
    outcome = samples(folder / "out.mcap")["rtk/fix"]
    assert [math.degrees(s.latitude_rad) > 48.138 for s in outcome] == [True, True]
    (folder / "part2.pos").write_text(POS.replace("07:44:5", "07:45:0"))
    result = imported(folder, "rover.pos", "part2.pos")  # parts of one recording
    assert result["written"]["/rtk/fix"]["messages"] == 4


def test_a_receivers_record_gives_a_position_at_each_picture(folder):
    """On the line between its epochs, with the worse status; SRT has a cue each 33 ms."""
    at = "07:44:57.{}00 48.13715{} 11.576124000 560.{}000"
    rest = "1 20 0.01 0.02 0.03 0.005 -0.006 0.007 0.20 99.0"
    header = POS.splitlines()[:2]
    fixes = [f"2024/06/11 {at.format(k, k, k)} {rest}" for k in (0, 2)]
    fixes[1] = fixes[1].replace(" 1 20", " 2 20")
    (folder / "fast.pos").write_text("\n".join([*header, *fixes]))
    result = imported(folder, "fast.pos", "clip.srt")
    outcome = samples(folder / "out.mcap")
    assert [s.stamp_ns for s in outcome["gps/fix"]] == [s.stamp_ns for s in outcome["imu/data"]]
    stamps = [sample.stamp_ns for sample in outcome["rtk/fix"]]
    pictures = [sample.stamp_ns for sample in outcome["gimbal/attitude"]]
    assert sorted({*stamps, *pictures}) == stamps
    assert len(stamps) == 4
    made = outcome["rtk/fix"][1]
    share = (made.stamp_ns - stamps[0]) / 2e8
    assert math.degrees(made.latitude_rad) == pytest.approx(48.13715 + 2e-6 * share, abs=1e-9)
    assert made.height_m == pytest.approx(560.0 + 0.2 * share)
    assert made.status == 1
    assert result["error"] is None
    (folder / "rover.pos").write_text(POS.replace("07:44:58", "07:44:59"))
    imported(folder, "rover.pos", "clip.srt")  # its epochs are further apart than a second
    assert len(samples(folder / "out.mcap")["rtk/fix"]) == 2


@pytest.mark.parametrize("names", [("imu.csv", "clip.srt"), ("clip.srt", "imu.csv")])
def test_an_attitude_of_pictures_gives_way_to_an_imu(folder, names):
    result = imported(folder, *names, columns=[folder / "imu.yaml"])
    outcome = samples(folder / "out.mcap")
    assert len(outcome["imu/data"]) == result["written"]["/imu/data"]["messages"] == 19
    assert all(math.isfinite(sample.specific_force_b[2]) for sample in outcome["imu/data"])
    assert "clip.srt: refused 2 imu/data: " in result["warning"]


def test_logs_without_a_common_time_are_refused(folder):
    """Local times that are taken as UTC, for example."""
    options = LogOptions(utc_offset_s=0, geoid_undulation_m=0.0)
    with pytest.raises(LogError, match=r"no time in common: .*rover\.pos is of 2024-06-11 07:44"):
        imported(folder, "rover.pos", "clip.srt", logs=options)
    assert not (folder / "out.mcap").exists()


def test_the_parameters_give_undulation_and_baseline(folder):
    pytest.importorskip("pyubx2")
    (folder / "params.yaml").write_text(
        "/**:\n  ros__parameters:\n    geoid_undulation_m: 45.0\n"
        "    aircraft.rtk_antenna_m: [0.0, 0.6, 0.0]\n"
        "    aircraft.second_antenna_m: [0.0, -0.6, 0.0]\n"
    )
    (folder / "rover.ubx").write_bytes(pvt() + relposned() + pvt(second=40))
    params, options = folder / "params.yaml", LogOptions(utc_offset_s=7200)
    result = imported(folder, "rover.ubx", "clip.srt", params=params, logs=options)
    outcome = samples(folder / "out.mcap")
    assert outcome["gps/fix"][0].height_m == pytest.approx(585.25)
    assert math.degrees(outcome["rtk/heading"][0].heading_rad) % 360 == pytest.approx(110.0)
    assert "aircraft.second_antenna_m is not set" not in str(result["warning"])


def test_the_antenna_of_a_position(folder):
    """The rover's, unless the base's log is named first or the rover is the first antenna."""
    pytest.importorskip("pyubx2")
    rover, base = folder / "rover.ubx", folder / "base.ubx"
    rover.write_bytes(pvt() + relposned() + pvt(second=40))
    base.write_bytes(pvt(lat=48.2) + pvt(second=40))
    warned = "rtk/fix is of the rover's antenna"
    assert warned in imported(folder, "rover.ubx")["warning"]
    options = replace(OPTIONS, rover_first=True)
    assert warned not in imported(folder, "rover.ubx", logs=options)["warning"]
    result = imported(folder, "base.ubx", "rover.ubx")
    assert warned not in result["warning"]
    outcome = samples(folder / "out.mcap")
    assert math.degrees(outcome["rtk/fix"][0].latitude_rad) == pytest.approx(48.2)
    assert math.degrees(outcome["rtk/heading"][0].heading_rad) % 360 == pytest.approx(200.0)


def test_impossible_samples_are_refused(folder):
    text = SRT.replace("48.137155", "0.000000").replace("11.576126", "0.000000")
    (folder / "clip.srt").write_text(text)
    result = imported(folder, "clip.srt")
    refused = result["files"][0]["refused"]
    assert [(item["record"], item["count"]) for item in refused] == [("gps/fix", 1)]
    assert refused[0]["reason"].startswith("position is 0, 0")
    (folder / "clip.srt").write_text(SRT.replace("2024-06", "1960-06"))
    with pytest.raises(LogError, match=r"nothing in it can be used: .* not between 1970 and 2038"):
        imported(folder, "clip.srt")


def test_times_that_go_back_are_noted(folder):
    first, *rest = IMU.splitlines(keepends=True)
    (folder / "imu.csv").write_text("".join([*rest, first]))
    result = imported(folder, "imu.csv", columns=[folder / "imu.yaml"])
    reports = "imu/data: its time goes back 1 times; it is sorted by time"
    assert reports in result["files"][0]["notes"]
    stamps = [s.stamp_ns for s in samples(folder / "out.mcap")["imu/data"]]
    assert stamps == sorted(stamps)


def test_units_that_gravity_contradicts(folder):
    """At rest for 6 s, in m/s2 as if they were g, and upside down."""
    rows = "".join(f"{1718091879 + k / 50:.2f},0,0,9.8,0,0,0\n" for k in range(300))
    (folder / "imu.csv").write_text(rows)
    result = imported(folder, "imu.csv", columns=[folder / "imu.yaml"])
    assert "96.1 m/s2 on average, not 9.8" in result["warning"]
    assert "in --columns: imu.accel.unit" in result["warning"]
    columns = IMU_COLUMNS.replace("unit: g", "unit: m/s2").replace("axes: flu", "axes: frd")
    (folder / "imu.yaml").write_text(columns)
    result = imported(folder, "imu.csv", columns=[folder / "imu.yaml"])
    assert "the sign is wrong" in result["warning"]
    assert "in --columns: imu.axes" in result["warning"]


@pytest.mark.parametrize(
    ("names", "columns", "message"),
    [
        (("rover.pos",), ("imu.yaml",), r"imu\.yaml: --columns is for CSV files, and there is no"),
        (("imu.csv", "rover.pos"), ("imu.yaml",) * 2, "2 --columns for 1 CSV files"),
        (
            ("rover.pos", "noise.bin"),
            (),
            r"noise\.bin: not a log to be merged: import it alone",
        ),
    ],
)
def test_files_that_cannot_be_imported(folder, names, columns, message):
    (folder / "noise.bin").write_bytes(bytes(range(256)) * 8)
    with pytest.raises(LogError, match=message):
        imported(folder, *names, columns=[folder / name for name in columns])
    assert not (folder / "out.mcap").exists()


def test_the_command(folder, capsys):
    args = [str(folder / "imu.csv"), str(folder / "clip.srt"), "-o", str(folder / "out.mcap")]
    more = ["--columns", str(folder / "imu.yaml"), "--utc-offset", "+02:00"]
    height = ["--takeoff-height", "500"]
    assert main(["import", *args, *more, *height]) == 0
    out, err = capsys.readouterr()
    assert "clip.srt: DJI subtitles (SRT)" in out
    assert "note: heights: rel_alt as takeoff" in out
    assert err.startswith("tirgeo import: warning: ")
    assert main(["import", *args, *more]) == 1
    assert "give the geoid's height there with --geoid-undulation" in capsys.readouterr().err
    assert main(["import", *args, *more, *height, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["kind"] == "logs"
    for wrong in (["import"], ["import", "x.csv"], ["import", *args, "--utc-offset", "CET"]):
        with pytest.raises(SystemExit, match="2"):
            main(wrong)


@pytest.mark.parametrize("off_s", [-20.0, 20.0])
def test_a_row_with_an_outlying_stamp_is_left_out_with_a_warning(folder, capsys, off_s):
    """One IMU row in another time would be between others of another attitude."""
    rows = [f"{1718091879 + k / 100:.2f},0.0,0.0,1.0,0.001,0.002,0.003" for k in range(40)]
    (folder / "imu.csv").write_text("\n".join(rows))
    arguments = ["import", str(folder / "imu.csv"), "--columns", str(folder / "imu.yaml"), "-o"]
    assert main([*arguments, str(folder / "right.mcap")]) == 0
    assert "outlier" not in capsys.readouterr().err
    rows[9] = rows[9].replace("1718091879.09", f"{1718091879.09 + off_s:.2f}")
    (folder / "imu.csv").write_text("\n".join(rows))
    assert main([*arguments, str(folder / "out.mcap")]) == 0
    assert "refused 1 imu/data: its stamp is an outlier" in capsys.readouterr().err
    expected = samples(folder / "right.mcap")["imu/data"]
    del expected[9]
    outcome = samples(folder / "out.mcap")["imu/data"]
    assert [s.stamp_ns for s in outcome] == [s.stamp_ns for s in expected]


@pytest.mark.parametrize(
    ("head", "package"), [(MAGIC + bytes(9), "pyulog"), (b"\xa3\x95\x80" + bytes(86), "pymavlink")]
)
def test_a_reader_that_is_not_installed_is_named(tmp_path, capsys, monkeypatch, head, package):
    for name in [item for item in sys.modules if item.partition(".")[0] == package] + [package]:
        monkeypatch.setitem(sys.modules, name, None)
    (tmp_path / "a.log").write_bytes(head)
    assert main(["import", str(tmp_path / "a.log"), "-o", str(tmp_path / "a.mcap")]) == 1
    remedy = f'a.log needs {package}: pip install "tirgeo[logs]"\n'
    assert capsys.readouterr().err.endswith(remedy)
    assert not (tmp_path / "a.mcap").exists()


def test_a_cut_log_ends_as_a_cut_bag_does(shared, tmp_path, capsys):
    """With exit code 1 and a line on stderr, and what could be read."""
    pytest.importorskip("pyulog")
    data = (shared / "foreign_logs" / "px4" / "fmu_v6c.ulg").read_bytes()
    (tmp_path / "a.ulg").write_bytes(data[: len(data) * 9 // 10])
    assert main(["import", str(tmp_path / "a.ulg"), "-o", str(tmp_path / "a.mcap")]) == 1
    assert "a.ulg: the file is cut off or damaged: what could be" in capsys.readouterr().err
    assert len(list(BagReader(tmp_path / "a.mcap").messages(["/imu/data"]))) > 500


COLUMNS = PROJECT / "config" / "columns"
#: Real logs of these forms, with the columns of the tables.
REAL = {
    "rtklib/walk_0827_imu_gpst_60s.csv": "imu_gpst",
    "rtklib/walk_0827_imu_raw_120s.csv": "imu_since_start",
    "ins/vn310_imu_16s.csv": "vectornav_imu",
    "ins/vn310_gnss_16s.csv": "vectornav_gnss",
    "px4/ecl_replay_iris_gps_20s.csv": "px4_replay",
    "dji/airdata_2023-12-22_with_DJI_0031.csv": "airdata",
    "dji/airdata_2024-01-04_120s.csv": "airdata",
}
FOLDERS = ("dji/srt", "rtklib", "rtklib/variants", "ublox", "px4", "ardupilot")


def real_logs(shared):
    """Every log of these forms, the tables with their columns."""
    root = shared / "foreign_logs"
    others = [path for name in FOLDERS for path in sorted((root / name).iterdir())]
    plain = [(p, ()) for p in others if p.is_file() and p.suffix != ".csv"]
    return plain + [(root / name, (COLUMNS / f"{c}.yaml",)) for name, c in REAL.items()]


@pytest.mark.slow
def test_each_real_log_is_imported_or_fails_in_one_line(shared, tmp_path):
    """Each gives a bag of good messages, or a line; none loses a row because of its stamp."""
    for reader in ("pyulog", "pymavlink", "pyubx2"):
        pytest.importorskip(reader)
    lines = {}
    for path, columns in real_logs(shared):
        output = tmp_path / f"{path.name}.mcap"
        try:
            result = import_flight(path, output, logs=OPTIONS, columns=columns)
        except TirgeoError as error:
            lines[path] = str(error)
            continue
        written = sum(observed["messages"] for observed in result["written"].values())
        assert written == sum(map(len, samples(output).values())) > 0
        reasons = {row["reason"] for row in result["files"][0]["refused"]}
        words = ("jump", "outlier", "contradict")
        assert not any(word in why for why in reasons for word in words), path
    assert all(str(path) in line and "\n" not in line for path, line in lines.items())
    assert len(list(tmp_path.iterdir())) == len(real_logs(shared)) - len(lines)
    assert {path.stem for path in lines} == {
        # no height, or no position
        *("mavic_2_style", "mavic_2pro", "mavic_air_no_gps"),
        "sensor_fusion_nav_att",
    }


BASES = {
    "log.pos": (POS.encode(), ()),
    "clip.srt": (SRT.encode(), ()),
    "imu.csv": (IMU.encode(), ("imu.yaml",)),
    "columns": (IMU_COLUMNS.encode(), ()),
    "rover.ubx": (b"", ()),
}


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder for damaged files, with the columns file of a whole one."""
    folder = tmp_path_factory.mktemp("damaged")
    (folder / "imu.yaml").write_text(IMU_COLUMNS)
    (folder / "imu.csv").write_text(IMU)
    return folder


@pytest.mark.parametrize("name", BASES)
@settings(max_examples=20)
@given(data=st.data())
def test_damaged_files_give_one_line_or_a_bag(place, name, data):
    """Cut anywhere, with flipped bits."""
    content, columns = BASES[name]
    if name == "rover.ubx":
        pytest.importorskip("pyubx2")
        content = pvt() + relposned() + pvt(second=40, iTOW=200_698_000)
    damaged = bytearray(content[: data.draw(st.integers(1, len(content)))])
    for _ in range(data.draw(st.integers(0, 4))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    path, tables = place / f"damaged_{name}", [place / column for column in columns]
    path.write_bytes(damaged)
    if name == "columns":
        path, tables = place / "imu.csv", [path]
    with suppress(TirgeoError):  # anything else fails
        import_flight(path, place / "out.mcap", logs=OPTIONS, columns=tables)
        assert samples(place / "out.mcap")
