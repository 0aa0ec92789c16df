"""tirgeo import of every real log, of damaged ones, and of a flight up to its poses."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np
import pytest
from foreign_logs import CDR, IMU, IMU_COLUMNS, OPTIONS, POS, SRT, pvt, relposned, samples
from hypothesis import given, settings
from hypothesis import strategies as st
from project import PROJECT

from tirgeo_ros.core.types.errors import BagError, LogError, TirgeoError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.messages import stamp_ns
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.convert.import_flight import import_flight

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
FOLDERS = ("dji/srt", "rtklib", "rtklib/variants", "ublox")


def real_logs(shared):
    """Every log of these forms, the tables with their columns."""
    root = shared / "foreign_logs"
    others = [path for name in FOLDERS for path in sorted((root / name).iterdir())]
    plain = [(p, ()) for p in others if p.is_file() and p.suffix != ".csv"]
    return plain + [(root / name, (COLUMNS / f"{c}.yaml",)) for name, c in REAL.items()]


@pytest.mark.slow
def test_no_real_log_fails_otherwise_than_in_one_line(shared, tmp_path):
    """Each gives a bag whose every message is good, or a line; none of them anything else."""
    pytest.importorskip("pyubx2")
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


@pytest.mark.slow
def test_the_logs_of_others_have_no_lone_jumps(shared, tmp_path):
    """No clean log loses a row."""
    for reader in ("pyulog", "pymavlink", "pyubx2"):
        pytest.importorskip(reader)
    logs = shared / "foreign_logs"
    others = [
        path
        for kind in (
            "px4/*.ulg",
            "ublox/*.ubx",
            "rtklib/**/*.pos",
            "dji/srt/*.srt",
            "ardupilot/*.BIN",
        )
        for path in sorted(logs.glob(kind))
    ]
    assert len(others) > 30
    named = {logs / name: [COLUMNS / f"{kind}.yaml"] for name, kind in REAL.items()}
    for path, tables_of in (dict.fromkeys(others, ()) | named).items():
        try:
            result = import_flight(path, tmp_path / "out.mcap", logs=OPTIONS, columns=tables_of)
        except (BagError, LogError):  # nothing in it that is asked for
            continue
        reasons = {one["reason"] for one in result["files"][0]["refused"]}
        assert not any("jump" in why or "contradict" in why for why in reasons), path
