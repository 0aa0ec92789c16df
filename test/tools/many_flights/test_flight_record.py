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
"""Records and names of flights: what is read, what is processed anew, what is kept."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path

import cv2
import numpy as np
import pytest
from process_bags import messages_of, rewritten
from pyproj import Geod

from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.tools.many_flights import flight_record
from tirgeo_ros.tools.many_flights.flight_process import flight_facts
from tirgeo_ros.tools.many_flights.flight_record import (
    FlightTask,
    bag_stamps,
    digests_of,
    is_done,
    made_from,
    read_records,
    written_record,
)
from tirgeo_ros.tools.many_flights.many_flights import flight_names
from tirgeo_ros.tools.replay.process import process


@pytest.fixture
def made(tmp_path):
    """A flight with its parameter file, processed: a function of its task, and the record."""
    bag, params = tmp_path / "flight.mcap", tmp_path / "params.yaml"
    bag.write_bytes(b"bag")
    params.write_text("a: 1")
    out = tmp_path / "out"
    out.mkdir()
    (out / "flight.mcap").write_bytes(b"output")

    def task(**options):
        digests = digests_of([params, tmp_path / "no"])
        source = made_from(bag_stamps(bag), {"method": None} | options, digests)
        here = str(tmp_path)
        return FlightTask("flight", str(bag), str(out), here, options, "", source)

    result = {"output": "out/flight.mcap", "error": None, "speed": float("nan")}
    season = {"outputs": {"flight.mcap": 6}, "facts": {"begin_utc": "2026-05-01T10:00:00Z"}}
    written_record(task(), result | {"season": season}, 1)
    return task, read_records(out)["flight"]


def test_a_record_comes_back(made, tmp_path):
    task, record = made
    assert is_done(record, task())
    assert record["speed"] is None
    assert record["season"]["bag"] == str(tmp_path / "flight.mcap")
    assert record["season"]["facts"] == {"begin_utc": "2026-05-01T10:00:00Z"}
    os.utime(tmp_path / "params.yaml", ns=(5, 5))
    assert is_done(record, task())  # with a file that was only touched
    assert not is_done(None, task())
    assert not is_done(written_record(task(), {"error": "no space"}, 1), task())


def changed_flight(folder):
    (folder / "flight.mcap").write_bytes(b"BAG")
    os.utime(folder / "flight.mcap", ns=(5, 5))


@pytest.mark.parametrize(
    "change",
    [
        changed_flight,
        lambda folder: (folder / "params.yaml").write_text("a: 2"),
        lambda folder: (folder / "no").write_text("the map is there now"),
        lambda folder: (folder / "out/flight.mcap").write_bytes(b"cut"),
        lambda folder: (folder / "out/flight.mcap").unlink(),
    ],
    ids=["flight", "parameters", "new file", "output", "no output"],
)
def test_a_changed_input_needs_a_new_run(made, tmp_path, monkeypatch, change):
    task, record = made
    assert not is_done(record, task(method="rtk"))
    with monkeypatch.context() as other:
        other.setattr(flight_record, "__version__", "99.0")
        assert not is_done(record, task())
    assert is_done(record, task())
    change(tmp_path)
    assert not is_done(record, task())


def test_other_files_are_ignored(made, tmp_path):
    season = '{"season": {"name": "x"}}'
    for text in ("", "{", "[]", "3", "{}", '{"season": {}}', season, "[" * 99999):
        (tmp_path / "out/other.json").write_text(text)
        assert list(read_records(tmp_path / "out")) == ["flight"]
    _, record = made
    for needed in ("name", "bag", "made_from", "outputs", "facts"):
        season = {key: value for key, value in record["season"].items() if key != needed}
        (tmp_path / "out/other.json").write_text(json.dumps(record | {"season": season}))
        assert list(read_records(tmp_path / "out")) == ["flight"]


def test_stamps_of_a_folder_are_those_of_its_bag(tmp_path):
    for name in ("rec_0.mcap", "rec_1.mcap", "notes.txt"):
        (tmp_path / name).write_bytes(b"x")
    assert [name for name, _, _ in bag_stamps(tmp_path)] == ["rec_0.mcap", "rec_1.mcap"]
    assert bag_stamps(tmp_path / "absent.mcap") == [["absent.mcap", None, None]]


def test_a_record_that_cannot_be_written_is_an_error_of_its_flight(made, tmp_path):
    task = made[0]
    (tmp_path / "out/flight.json").unlink()
    (tmp_path / "out/flight.json").mkdir()
    record = written_record(task(), {"output": "out/flight.mcap", "error": None}, 1)
    assert (
        record["error"] == f"{tmp_path}/out/flight.json: not a file; give the output another name"
    )
    assert written_record(task(), {"error": "worse"}, 1)["error"] == "worse"
    record = written_record(replace(task(), name="n" * 255), {"output": None, "error": None}, 1)
    assert record["error"].endswith(".json: cannot be written: File name too long")


def test_facts_of_a_flight(season, flights):
    folder, _, records = season
    facts = records["east_flight"]["season"]["facts"]
    begin = datetime.fromtimestamp(BagReader(flights[0]).span_ns[0] // 10**9, timezone.utc)
    assert facts["begin_utc"] == begin.isoformat().replace("+00:00", "Z")
    fixes = [m for _, m in messages_of(folder / "east_flight.mcap", "/tirgeo/fix")]
    assert facts["place_deg"] == [fixes[0].latitude, fixes[0].longitude]
    seconds = {convert.stamp_ns(m) // 10**9: m for m in reversed(fixes)}
    chosen = [seconds[key] for key in sorted(seconds)]
    length_m = Geod(ellps="WGS84").line_length(
        [m.longitude for m in chosen], [m.latitude for m in chosen]
    )
    # By chords at height zero: of some metres the geodesics differ by far less than a millimetre.
    assert facts["distance_m"] == pytest.approx(length_m, abs=1e-3)


@pytest.mark.slow
def test_the_small_picture_is_one_of_the_overlays(sample, tmp_path):
    """With a namespace."""
    flight = rewritten(
        sample / "flight.mcap",
        tmp_path / "flight.mcap",
        lambda item: (f"/uav1{item.topic}", item.data),
        seconds=9.0,
    )
    out = tmp_path / "out.mcap"
    options = {"params": sample / "params.yaml", "map": sample / "map.geojson"}
    process(flight, out, namespace="uav1", **options)
    _, jpeg = flight_facts(out, "uav1", 9.0)
    small = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert small.shape == (256, 320, 3)
    pictures = [
        cv2.resize(cv2.imdecode(np.frombuffer(bytes(m.data), np.uint8), 1), (320, 256), 0, 0, 0, 3)
        for _, m in messages_of(out, "/uav1/tirgeo/overlay/image/compressed")
    ]
    errors = [np.abs(each.astype(float) - small).mean() for each in pictures]
    assert abs(np.argmin(errors) - len(pictures) / 2) <= 5  # in the middle; the first are late


def record(bag, stamps=()):
    return {"season": {"bag": str(bag), "made_from": {"flight": list(stamps)}}}


def stamps_of(path):
    return [[Path(path).name, 100, hash(path)]]


def named(*paths, records=None):
    flights = {Path(path): stamps_of(path) for path in paths}
    names = flight_names(flights, records or {})
    return [names[Path(path)] for path in paths]


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (["/a/one.mcap", "/a/two.db3"], ["one", "two"]),
        (["/a/rosbag2_2026.05", "/a/x.mcap.zstd"], ["rosbag2_2026.05", "x"]),
        (["/a/may/metadata.yaml"], ["may"]),
        (["/a/flight.mcap", "/b/flight.mcap", "/b/c.mcap"], ["a_flight", "b_flight", "c"]),
        (["/x/a/f.mcap", "/y/a/f.mcap", "/y/b/f.mcap"], ["x_a_f", "y_a_f", "b_f"]),
        (["/a/f.mcap", "/a/f.db3"], ["a_f", "a_f-2"]),
        (["/a/b_c.mcap", "/a_b/c.mcap", "/q/c.mcap", "/q/b_c.mcap"],
         ["a_b_c", "a_b_c-2", "q_c", "q_b_c"]),
    ],
)  # fmt: skip
def test_names(paths, names):
    assert named(*paths) == names
    assert len(set(names)) == len(names)


def test_a_flight_keeps_its_name_also_moved_or_as_a_link_and_no_other_gets_it(tmp_path):
    """Recognised by its files' names, sizes and times of change."""
    records = {"flight": record("/a/flight.mcap", stamps_of("/a/flight.mcap"))}
    assert named("/a/flight.mcap", "/b/flight.mcap", records=records) == ["flight", "b_flight"]
    assert named("/b/flight.mcap", records=records) == ["b_flight"]
    link = tmp_path / "may.mcap"
    link.symlink_to(tmp_path / "disk_1.mcap")
    assert flight_names({link: stamps_of(link)}, {}) == {link: "may"}
    link.unlink()
    link.symlink_to(tmp_path / "disk_2.mcap")  # which leads elsewhere
    assert flight_names({link: stamps_of(link)}, {"spring": record(link)}) == {link: "spring"}
    stamps = stamps_of("/old/flight.mcap")
    records = {"may": record("/old/flight.mcap", stamps)}
    moved, copy = Path("/new/flight.mcap"), Path("/copy/flight.mcap")
    assert flight_names({moved: stamps}, records) == {moved: "may"}
    assert flight_names({moved: stamps, copy: stamps}, records) == {moved: "may", copy: "flight"}
    absent = [["flight.mcap", None, None]]  # is no other absent one
    records = {"flight": record("/old/flight.mcap", absent)}
    assert flight_names({moved: absent}, records) == {moved: "new_flight"}
