"""tirgeo import of logs: several of one flight, every real one, damaged ones, and the command."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from foreign_logs import CDR, IMU, IMU_COLUMNS, OPTIONS, POS, SRT, pvt, relposned, samples
from hypothesis import given, settings
from hypothesis import strategies as st
from project import PROJECT

from tirgeo_ros.core.types.errors import LogError, TirgeoError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.messages import stamp_ns
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
    result = imported(folder, "rover.pos", "imu.csv", "clip.srt", columns=[folder / "imu.yaml"])
    assert {topic: seen["messages"] for topic, seen in result["written"].items()} == {
        "/imu/data": 19,
        "/rtk/fix": 2,
        "/gps/fix": 2,
        "/gimbal/attitude": 2,
    }
    logged = [m.log_time_ns for m in BagReader(folder / "out.mcap").messages()]
    assert logged == sorted(logged)
    for found in samples(folder / "out.mcap").values():
        assert {s.stamp_ns for s in found} <= set(logged)
    forms = [log["form"] for log in result["files"]]
    assert forms == ["RTKLIB .pos", "CSV", "DJI subtitles (SRT)"]
    assert "imu.csv: refused 1 imu: imu.gyro.columns.3 is not a number" in result["warning"]
    assert "geoid" not in result["warning"]  # of DJI's receivers
    again = folder / "again.mcap"
    paths = [folder / "rover.pos", folder / "imu.csv", folder / "clip.srt"]
    import_flight(paths, again, logs=OPTIONS, columns=[folder / "imu.yaml"])
    assert again.read_bytes() == (folder / "out.mcap").read_bytes()


def test_a_topic_comes_from_the_first_log_that_has_it(folder):
    """Two receivers on one topic would be one that jumps between two places."""
    moved = POS.replace("48.137", "48.138")
    (folder / "base.pos").write_text(moved)
    result = imported(folder, "base.pos", "rover.pos")
    assert "rover.pos: refused 2 rtk/fix: " in result["warning"]
    assert "base.pos, named before, has it" in result["warning"]
    found = samples(folder / "out.mcap")["rtk/fix"]
    assert [math.degrees(s.latitude_rad) > 48.138 for s in found] == [True, True]
    (folder / "part2.pos").write_text(POS.replace("07:44:5", "07:45:0"))
    result = imported(folder, "rover.pos", "part2.pos")  # parts of one recording
    assert result["written"]["/rtk/fix"]["messages"] == 4


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
    found = samples(folder / "out.mcap")
    assert found["gps/fix"][0].height_m == pytest.approx(585.25)
    assert math.degrees(found["rtk/heading"][0].heading_rad) % 360 == pytest.approx(110.0)
    assert "aircraft.second_antenna_m is not set" not in str(result["warning"])


def test_whose_antenna_a_position_is_of(folder):
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
    found = samples(folder / "out.mcap")
    assert math.degrees(found["rtk/fix"][0].latitude_rad) == pytest.approx(48.2)
    assert math.degrees(found["rtk/heading"][0].heading_rad) % 360 == pytest.approx(200.0)


def test_a_heading_that_a_person_knows(folder):
    options = LogOptions(set_heading_rad=1.0)
    result = imported(folder, "rover.pos", logs=options)
    assert result["written"]["/ekf_node/set_heading"]["messages"] == 1
    (heading,) = samples(folder / "out.mcap")["ekf_node/set_heading"]
    assert heading.heading_rad == pytest.approx(1.0)


def test_impossible_samples_are_refused(folder):
    text = SRT.replace("48.137155", "0.000000").replace("11.576126", "0.000000")
    (folder / "clip.srt").write_text(text)
    result = imported(folder, "clip.srt")
    refused = result["files"][0]["refused"]
    assert [(one["record"], one["count"]) for one in refused] == [("gps/fix", 1)]
    assert refused[0]["reason"].startswith("position is 0, 0")
    (folder / "clip.srt").write_text(SRT.replace("2024-06", "1960-06"))
    with pytest.raises(LogError, match=r"nothing in it can be used: .* not between 1970 and 2038"):
        imported(folder, "clip.srt")


def test_times_that_go_back_are_told(folder):
    first, *rest = IMU.splitlines(keepends=True)
    (folder / "imu.csv").write_text("".join([*rest, first]))
    result = imported(folder, "imu.csv", columns=[folder / "imu.yaml"])
    told = "imu/data: its time goes back 1 times; it is sorted by time"
    assert told in result["files"][0]["notes"]
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
        (("imu.csv",), (), r"imu\.csv: text in columns: say what they mean with --columns"),
        (("rover.pos",), ("imu.yaml",), r"imu\.yaml: --columns is for CSV files, and there is no"),
        (("imu.csv", "rover.pos"), ("imu.yaml",) * 2, "2 --columns for 1 CSV files"),
        (
            ("rover.pos", "noise.bin"),
            (),
            r"noise\.bin: no log that can be merged: import it alone",
        ),
        (("log.nmea",), (), r"log\.nmea: NMEA: it has no covariances"),
    ],
)
def test_what_cannot_be_imported(folder, names, columns, message):
    (folder / "noise.bin").write_bytes(bytes(range(256)) * 8)
    (folder / "log.nmea").write_text("# comment\n$GNGGA,1,2\n")
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
def test_a_row_that_jumps_alone_is_left_out_with_a_warning(folder, capsys, off_s):
    """One IMU row in another time would be between others of another attitude."""
    rows = [f"{1718091879 + k / 100:.2f},0.0,0.0,1.0,0.001,0.002,0.003" for k in range(40)]
    (folder / "imu.csv").write_text("\n".join(rows))
    arguments = ["import", str(folder / "imu.csv"), "--columns", str(folder / "imu.yaml"), "-o"]
    assert main([*arguments, str(folder / "right.mcap")]) == 0
    assert "jump" not in capsys.readouterr().err
    rows[9] = rows[9].replace("1718091879.09", f"{1718091879.09 + off_s:.2f}")
    (folder / "imu.csv").write_text("\n".join(rows))
    assert main([*arguments, str(folder / "out.mcap")]) == 0
    assert "refused 1 imu/data: its time jumps alone" in capsys.readouterr().err
    expected = samples(folder / "right.mcap")["imu/data"]
    del expected[9]
    found = samples(folder / "out.mcap")["imu/data"]
    assert [s.stamp_ns for s in found] == [s.stamp_ns for s in expected]


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
def test_no_real_log_fails_otherwise_than_in_one_line(shared, tmp_path):
    """Each gives a bag whose every message is good, or a line; none loses a row by its time."""
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
        written = sum(seen["messages"] for seen in result["written"].values())
        assert written == sum(map(len, samples(output).values())) > 0
        reasons = {row["reason"] for row in result["files"][0]["refused"]}
        assert not any("jump" in why or "contradict" in why for why in reasons), path
    assert all(str(path) in line and "\n" not in line for path, line in lines.items())
    assert len(list(tmp_path.iterdir())) == len(real_logs(shared)) - len(lines)
    assert {path.stem for path in lines} == {
        # no height, or no position
        *("mavic_2_style", "mavic_2pro", "mavic_air_no_gps"),
        *("nmea_rtk", "sensor_fusion_nav_att"),
    }


@pytest.mark.slow
def test_the_walk_flies_as_its_own_bag(shared, tmp_path, capsys):
    """IMU and solution of the walk, imported and filtered, against the bag made of them.

    That bag has heights above the sea and GPS time, and an orientation where this import has a
    heading that a person sets. Both filters know the position to 1 cm where RTK is fixed, and
    their clocks come to differ by 3 cm of walking: 5 cm bound how far they may be apart.
    """
    folder, bag = shared / "foreign_logs" / "rtklib", tmp_path / "walk.mcap"
    # By the mounting angles of the source, rpy (180, 0, -90) deg.
    columns = (COLUMNS / "imu_since_start.yaml").read_text().replace("flu", "[left, back, up]")
    (tmp_path / "imu.yaml").write_text(columns)
    logs = [str(folder / "walk_0827_imu_raw_120s.csv"), str(folder / "walk_0827_120s.pos")]
    heights = ["--height", "msl", "--geoid-undulation", "-21.387"]
    begun = ["--start-time", "2025-08-28T17:30:22.961", "--set-heading", "136.5"]
    more = ["--columns", str(tmp_path / "imu.yaml"), *heights, *begun]
    assert main(["import", *logs, "-o", str(bag), *more]) == 0
    reference = shared / "real_flights" / "walk_0827.mcap"
    found, known = samples(bag), samples(reference)
    imu = found["imu/data"]
    for own, other in zip(imu, known["imu/data"][: len(imu)], strict=True):
        np.testing.assert_allclose(own.specific_force_b, other.specific_force_b, atol=1e-9)
        np.testing.assert_allclose(own.angular_rate_b, other.angular_rate_b, atol=1e-9)
    # The bag's clock of the IMU was scaled: 18 ms at the end, 3 cm at the walker's 1.5 m/s.
    apart_s = [
        (b.stamp_ns - a.stamp_ns) * 1e-9 - 18 for a, b in zip(imu, known["imu/data"], strict=False)
    ]
    assert apart_s == pytest.approx(np.linspace(0, apart_s[-1], len(apart_s)), abs=1e-3)
    assert 0 < apart_s[-1] < 0.02
    for own, other in zip(found["rtk/fix"], known["rtk/fix"][:480], strict=True):
        assert own.latitude_rad == pytest.approx(other.latitude_rad, abs=1e-15)
        assert other.height_m - own.height_m == pytest.approx(21.387)
        assert own.status is other.status
    tracks = []
    for path in (bag, reference):
        output = tmp_path / f"out_{path.name}"
        how = ["-o", str(output), "--method", "ekf", "--no-images"]
        assert main(["process", str(path), *how]) == 0
        tracks.append(track(output))
    capsys.readouterr()
    (times, own), (known_times, other) = tracks
    times = times + 18.0
    assert len(times) > 1000
    between = [np.interp(times, known_times, column) for column in other.T]
    apart_m = (own - np.stack(between, axis=1)) * [6.37e6, 6.37e6 * math.cos(0.7), 1.0]
    apart_m[:, 2] += 21.387
    assert np.abs(apart_m).max() < 0.05


def track(path):
    """Times, s, and latitude, longitude, rad, and height, m, of a processed bag."""
    found = [
        CDR.deserialize(m.data, m.typename) for m in BagReader(path).messages(["/tirgeo/fix"])
    ]
    places = [(math.radians(m.latitude), math.radians(m.longitude), m.altitude) for m in found]
    return np.array([stamp_ns(m) * 1e-9 for m in found]), np.array(places)


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
