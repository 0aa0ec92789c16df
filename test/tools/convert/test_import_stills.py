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
"""A folder of stills through ``tirgeo import``: each with its bytes, whenever it was taken."""

from __future__ import annotations

import csv
import json

import cv2
import numpy as np
from flir_files import flir_jpeg
from made_stills import still
from stills import RAW

from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.pictures.temperatures import DJI_NOTE
from tirgeo_ros.tools.cli.main import main

#: Seconds: shots by hand come in bursts, and alone.
TIMES = (0, 1, 2, 3, 4, 300, 900)


def test_a_folder_becomes_a_bag_with_each_still_s_bytes(tmp_path, capsys):
    folder, bag = tmp_path / "DCIM", tmp_path / "a.mcap"
    folder.mkdir()
    stills = [still(UTCAtExposure=f"2024:05:10 08:{s // 60:02}:{s % 60:02}.5") for s in TIMES]
    for number, data in enumerate(stills):
        (folder / f"DJI_{number:04}_T.JPG").write_bytes(data)
    (folder / "notes.txt").write_text("of the flight")
    assert main(["import", str(folder), "-o", str(bag), "--json"]) == 0
    (log,) = json.loads(capsys.readouterr().out)["files"]
    assert (log["form"], log["read"]) == ("stills", {"still": len(TIMES)})
    refused = {row["record"]: row["reason"] for row in log["refused"]}
    assert refused["notes.txt"] == "it is no JPEG or TIFF"
    messages: dict[str, list] = {}
    for message in BagReader(bag).messages():
        messages.setdefault(message.topic, []).append(message)
    pictures = messages["/thermal/image_raw/compressed"]
    assert all(data in each.data for data, each in zip(stills, pictures, strict=True))
    begin_ns = pictures[0].log_time_ns
    assert [(each.log_time_ns - begin_ns) / 1e9 for each in pictures] == list(TIMES)
    for topic in ("/rtk/fix", "/gimbal/attitude", "/thermal/camera_info"):
        assert len(messages[topic]) == len(TIMES)


def test_a_folder_without_a_still_fails_in_one_line_with_each_name(tmp_path, capsys):
    (tmp_path / "a.jpg").write_bytes(b"")
    (tmp_path / "b.jpg").write_bytes(still()[:-3000])
    assert main(["import", str(tmp_path), "-o", str(tmp_path / "a.mcap")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "a.jpg: it is empty" in line
    assert "b.jpg: it is cut off" in line


def test_stills_have_temperatures_from_the_folder_and_from_the_bag(tmp_path, capsys):
    folder, bag, pixels = (tmp_path / name for name in ("DCIM", "a.mcap", "pixels.csv"))
    table, kml = tmp_path / "a.csv", tmp_path / "a.kml"
    folder.mkdir()
    flir = flir_jpeg(np.array([[17000, 16000], [18000, 20000]]))
    # FLIR's raw data, a TIFF beside DJI's, and twice DJI's alone.
    for number, part in enumerate((flir[2 : flir.index(b"\xff\xe0")], RAW, RAW, RAW)):
        data = still(UTCAtExposure=f"2024:05:10 08:00:0{number}.5")
        (folder / f"DJI_{number:04}_T.JPG").write_bytes(data[:2] + part + data[2:])
    degrees = np.array([[1.25, 2.5]], np.float32)
    (folder / "DJI_0001_T.tiff").write_bytes(cv2.imencode(".tiff", degrees)[1].tobytes())
    assert main(["import", str(folder), "-o", str(bag), "--json"]) == 0
    (log,) = json.loads(capsys.readouterr().out)["files"]
    noted = [note for note in log["notes"] if note.startswith("temperatures")]
    assert noted == [f"temperatures: {DJI_NOTE}"]
    rows = ["id,picture,u,v", *(f"{n},DJI_{n:04}_T.JPG,100,100" for n in range(4))]
    pixels.write_text("\n".join(rows))
    words = ["--pixels", str(pixels), "--ground-height", "155", "-o"]
    for flight in (folder, bag):
        assert main(["locate", str(flight), *words, str(table)]) == 0
        located = csv.DictReader(table.read_text("utf-8-sig").splitlines())
        warmth = [row["temperature_c"] for row in located]
        assert warmth == ["17.41", "1.25", "", ""]  # in steps of 0.02
    assert main(["locate", str(bag), *words, str(kml)]) == 0
    assert "ellipsoid; 17.4 deg C" in kml.read_text()
