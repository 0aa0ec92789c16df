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
"""Folders, databases and compressed files that are incomplete: read as far as they go, or said."""

from __future__ import annotations

import os
import random
import sqlite3
from collections import Counter
from contextlib import closing
from types import SimpleNamespace

import pytest
import zstandard
from recorded_bags import (
    MESSAGES,
    THIRDS,
    compressed,
    record,
    write_mcap,
    write_metadata,
    write_sqlite,
)

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags import packed
from tirgeo_ros.io.bags.bag import BagReader


@pytest.fixture(autouse=True)
def nothing_left(scratch):
    """Every reader leaves the folder for temporary files empty."""
    yield
    assert list(scratch.iterdir()) == []


def read(path):
    reader = BagReader(path)
    return list(reader.messages()), reader.damage


# a part is lost


def absent(folder):
    (folder / "bag_1.mcap").unlink()
    return THIRDS[0] + THIRDS[2], "bag_1.mcap, named in metadata.yaml, is absent"


def renamed(folder):
    for path in folder.glob("*.mcap"):
        path.rename(folder / path.name.replace("bag", "flight"))
    text = (f"bag_{number}.mcap, named in metadata.yaml, is absent" for number in range(3))
    return MESSAGES, "; ".join(text)


def empty_last(folder):
    (folder / "metadata.yaml").unlink()
    (folder / "bag_2.mcap").write_bytes(b"")
    return THIRDS[0] + THIRDS[1], "bag_2.mcap: the file is empty"


def metadata(text):
    def change(folder):
        (folder / "metadata.yaml").write_text(text)
        return MESSAGES, "metadata.yaml is damaged"

    return change


@pytest.mark.parametrize(
    "change",
    [absent, renamed, empty_last, *map(metadata, ("", "a: [", "rosbag2_bagfile_information: {}"))],
)
def test_a_part_that_is_lost_is_told_and_the_rest_is_read(tmp_path, change):
    folder = record(tmp_path / "bag", THIRDS)
    wanted, text = change(folder)
    result, damage = read(folder)
    assert result == wanted
    assert damage == f"{text}; {len(wanted)} messages were read"


def test_metadata_that_are_a_pipe(tmp_path):
    """Nobody writes to it: who reads it waits without end."""
    folder = record(tmp_path / "bag", THIRDS, metadata=False)
    os.mkfifo(folder / "metadata.yaml")
    assert read(folder) == (MESSAGES, None)


@pytest.mark.parametrize("mode", ["", "file"])
def test_a_cut_file_among_others(tmp_path, mode):
    folder = record(tmp_path / "bag", THIRDS, "mcap", mode)
    (middle,) = folder.glob("bag_1.*")
    data = middle.read_bytes()
    middle.write_bytes(data[: len(data) // 2])
    result, damage = read(folder)
    assert result == [item for item in MESSAGES if item in result]
    assert 200 <= len(result) < 300
    assert damage.startswith(f"{middle.name}: ")
    assert damage.endswith(f"; {len(result)} messages were read")


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_message_whose_compression_is_damaged(tmp_path, storage):
    parts = [[item._replace(data=zstandard.compress(item.data)) for item in MESSAGES]]
    parts[0][5] = parts[0][5]._replace(data=parts[0][5].data[:-9])
    result, damage = read(record(tmp_path / "bag", parts, storage))
    assert result == MESSAGES[:5] + MESSAGES[6:]
    assert "a message" in damage
    assert "is cut off or damaged; 299 messages were read" in damage


@pytest.mark.parametrize("name", ["a.db3", "a.db3.zstd", "a.mcap.zstd"])
def test_no_damage_raises_anything_else(tmp_path, name):
    """Many random hits and cuts: messages with damage told, or one line.

    What is in a message can be wrong: neither SQLite nor rosbag2's compression has checksums.
    """
    path = tmp_path / name.removesuffix(".zstd")
    (write_mcap if ".mcap" in name else write_sqlite)(path, MESSAGES * 3)
    path = compressed(path) if name.endswith(".zstd") else path
    whole, rng, counts = path.read_bytes(), random.Random(5), Counter()
    for _ in range(150):
        data = bytearray(whole)
        at, size = rng.randrange(16, len(data)), rng.choice([1, 8, 200, 4096])
        data[at : at + size] = rng.randbytes(size)
        path.write_bytes(data if rng.random() < 0.7 else data[: rng.randrange(20, len(data))])
        try:
            result, damage = read(path)
        except BagError as error:
            counts["refused" if "\n" not in str(error) else "several lines"] += 1
        else:
            counts["all" if damage is None else "a part"] += 1
            assert all(isinstance(item.log_time_ns, int) for item in result)
    assert {"refused", "a part"} <= counts.keys() <= {"refused", "a part", "all"}


def test_rows_without_time_or_data_or_with_a_time_that_no_stamp_holds(tmp_path):
    path = tmp_path / "a.db3"
    write_sqlite(path, MESSAGES)
    with closing(sqlite3.connect(path)) as base, base:
        base.execute("UPDATE messages SET data = 5000000000 WHERE id = 8")
        base.execute("UPDATE messages SET timestamp = 'late' WHERE id = 300")
    read_messages, damage = read(path)
    assert read_messages == MESSAGES[:7] + MESSAGES[8:299]
    assert damage == "a message has no time or no data; 298 messages were read"
    late = [message._replace(log_time_ns=1 << 62) for message in MESSAGES[5:7]]
    write_sqlite(tmp_path / "b.db3", [*MESSAGES[:5], *late])
    reader = BagReader(tmp_path / "b.db3")
    assert list(reader.messages()) == MESSAGES[:5]
    assert reader.span_ns == (0, 4)
    assert reader.damage == (
        "2 messages with a log time after 2038 left out; 5 messages were read"
    )


# refused


def cut_database(folder):
    path = folder / "a.db3"
    write_sqlite(path, MESSAGES * 10)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    return path


def another_database(folder):
    with closing(sqlite3.connect(folder / "a.db3")) as base, base:
        base.execute("CREATE TABLE points(id INTEGER PRIMARY KEY)")
    return folder / "a.db3"


def database(messages, form="cdr"):
    def make(folder):
        write_sqlite(folder / "a.db3", messages, form)
        return folder / "a.db3"

    return make


def cut_compression(folder):
    write_sqlite(folder / "a.db3", MESSAGES)
    path = compressed(folder / "a.db3")
    path.write_bytes(path.read_bytes()[:40])
    return path


def two_recordings(folder):
    for name in ("first_0", "first_1", "other_0"):
        write_mcap(folder / f"{name}.mcap", MESSAGES)
    return folder


def naming(*names, **how):
    """A folder whose metadata name files that are absent."""

    def make(folder):
        write_metadata(folder, names, **how)
        return folder

    return make


@pytest.mark.parametrize(
    ("make", "output"),
    [
        (lambda folder: folder, "{}: no bag in this folder: no .mcap and no .db3 file"),
        (lambda folder: folder / "a.mcap", "{}/a.mcap: cannot be read: No such file"),
        (two_recordings, "{}: 2 recordings without a metadata.yaml (first, other): give one"),
        (
            naming("bag_0.mcap", "bag_1.mcap"),
            "{}: no bag in this folder: no .mcap and no .db3 file",
        ),
        (
            naming("bag_0.dat", storage="of_my_own"),
            "{}/metadata.yaml: storage 'of_my_own' is not supported, only mcap, sqlite3",
        ),
        (
            naming("a.mcap.lz4", mode="file", form="lz4"),
            "{}/metadata.yaml: compression 'lz4' is not supported, only zstd;",
        ),
        (naming("x" * 300), "{}: cannot be read: File name too long"),
        (cut_database, "{}/a.db3: the database is cut off or damaged (database disk image is"),
        (another_database, "{}/a.db3: a SQLite database, but not of rosbag2"),
        (database([]), "{}/a.db3: no message can be read; the bag has none"),
        (
            database(MESSAGES, "json"),
            "{}/a.db3: topic /a is encoded as json; record it with ROS 2 (cdr)",
        ),
        (cut_compression, "{}/a.db3.zstd: the compressed file is cut off or damaged: nothing"),
    ],
)
def test_one_clear_line(tmp_path, make, output):
    path = make(tmp_path)
    with pytest.raises(BagError) as raised:
        read(path)
    assert str(raised.value).startswith(output.format(tmp_path))
    assert "\n" not in str(raised.value)


def test_a_file_that_unpacks_to_far_more(tmp_path, monkeypatch):
    monkeypatch.setattr(packed, "_SMALL_BYTES", 1 << 20)
    path = tmp_path / "a.mcap.zstd"
    path.write_bytes(zstandard.compress(bytes(32 << 20)))
    with pytest.raises(BagError, match=r"a\.mcap\.zstd: unpacks to more than 1000 times its size"):
        BagReader(path)


def test_a_disk_that_is_full(tmp_path, scratch, monkeypatch):
    write_mcap(tmp_path / "a.mcap", MESSAGES)
    path = compressed(tmp_path / "a.mcap")
    full = SimpleNamespace(free=packed._FREE_BYTES + 1000)
    monkeypatch.setattr(packed.shutil, "disk_usage", lambda _: full)
    text = rf"{path}: cannot be unpacked to {scratch}: only 0 MiB are free there; set TMPDIR to"
    with pytest.raises(BagError, match=text):
        BagReader(path)
