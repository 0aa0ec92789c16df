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
"""Bags in folders, split, compressed, in SQLite: the same messages come as from one MCAP file."""

from __future__ import annotations

import re
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from recorded_bags import (
    MESSAGES,
    THIRDS,
    TYPE,
    compressed,
    insert,
    message,
    record,
    write_mcap,
    write_metadata,
    write_sqlite,
)

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.bag import BagMessage, BagReader, by_numbers, is_bag

pytestmark = pytest.mark.usefixtures("scratch")


@pytest.mark.parametrize("metadata", [True, False])
@pytest.mark.parametrize("parts", [[MESSAGES], THIRDS], ids=["one file", "split"])
@pytest.mark.parametrize("mode", ["", "file", "message"])
@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_every_form(tmp_path, scratch, storage, mode, parts, metadata):
    folder = record(tmp_path / "bag", parts, storage, mode, metadata=metadata)
    there = {item: item.read_bytes() for item in folder.iterdir()}
    reader = BagReader(folder)
    assert list(reader.messages()) == MESSAGES
    assert list(reader.messages(["/b"], start_ns=150)) == MESSAGES[151::2]
    assert reader.topics() == {"/a": TYPE, "/b": TYPE}
    assert (reader.span_ns, reader.damage) == ((0, 299), None)
    assert len(list(scratch.iterdir())) == (len(parts) if mode == "file" else 0)
    del reader
    assert list(scratch.iterdir()) == []
    assert {item: item.read_bytes() for item in folder.iterdir()} == there


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("mode", ["", "file", "message"])
def test_one_file_of_a_folder(tmp_path, storage, mode):
    folder = record(tmp_path / "bag", THIRDS, storage, mode)
    (middle,) = folder.glob("bag_1.*")
    assert list(BagReader(middle).messages()) == THIRDS[1]
    assert list(BagReader(folder / "metadata.yaml").messages()) == MESSAGES


def test_files_that_overlap_in_time(tmp_path):
    """At one time the file whose first message is the earlier comes first."""
    parts = [[message(n, text=f"{k}") for n in range(3 * k, 100, 7 - k)] for k in range(4)]
    result = list(BagReader(record(tmp_path / "bag", parts)).messages())
    placed = [(m.log_time_ns, place, m) for place, part in enumerate(parts) for m in part]
    assert result == [m for *_, m in sorted(placed, key=lambda item: item[:2])]


def test_a_file_is_begun_when_its_time_has_come(tmp_path):
    reader = BagReader(record(tmp_path / "bag", THIRDS, "sqlite3"))
    messages = reader.messages()
    for _ in range(50):
        next(messages)
    assert [file.read for file in reader._files] == [50, 0, 0]


def test_files_without_metadata_come_by_their_numbers(tmp_path):
    parts = [[message(7, text=f"{number}")] for number in range(12)]
    result = list(BagReader(record(tmp_path / "bag", parts, metadata=False)).messages())
    assert result == [item for (item,) in parts]
    assert by_numbers(Path("b_2.mcap")) < by_numbers(Path("b_10.mcap"))


@pytest.mark.parametrize("metadata", [True, False])
def test_a_recorder_that_was_killed_while_it_compressed(tmp_path, metadata):
    """The last file is plain, and a beginning of it compressed."""
    folder = record(tmp_path / "bag", THIRDS, "sqlite3", "file", metadata=metadata)
    last = folder / "bag_2.db3.zstd"
    last.write_bytes(last.read_bytes()[:100])
    write_sqlite(folder / "bag_2.db3", THIRDS[2])
    if metadata:
        last.unlink()
    assert list(BagReader(folder).messages()) == MESSAGES


def test_a_power_cut_leaves_the_last_messages_in_the_log_beside(tmp_path, scratch):
    """As with the preset ``resilient``; what is beside the database is only read."""
    folder = tmp_path / "bag"
    folder.mkdir()
    live = tmp_path / "live.db3"
    write_sqlite(live, MESSAGES[:10])
    with closing(sqlite3.connect(live)) as base:
        base.execute("PRAGMA journal_mode = WAL")
        base.execute("PRAGMA wal_autocheckpoint = 0")
        base.execute("DELETE FROM topics")
        base.execute("DELETE FROM messages")
        insert(base, MESSAGES)
        base.commit()
        for end in ("", "-wal"):
            copy = folder / f"bag_0.db3{end}"
            copy.write_bytes((tmp_path / f"live.db3{end}").read_bytes())
    there = {item: item.read_bytes() for item in folder.iterdir()}
    reader = BagReader(folder)
    assert list(reader.messages()) == list(reader.messages()) == MESSAGES
    del reader
    assert list(scratch.iterdir()) == []
    assert {item: item.read_bytes() for item in folder.iterdir()} == there


def test_a_database_without_the_index_of_times_gets_nothing_beside_it(tmp_path):
    path = tmp_path / "a.db3"
    rng = np.random.default_rng(2)
    write_sqlite(path, [MESSAGES[number] for number in rng.permutation(300)])
    with closing(sqlite3.connect(path)) as base:
        base.execute("DROP INDEX timestamp_idx")
        base.execute("PRAGMA journal_mode = WAL")
    assert list(BagReader(path).messages()) == MESSAGES
    assert list(tmp_path.iterdir()) == [path]


def test_a_page_of_a_database_with_fewer_rows_is_told(tmp_path):
    """Each page but the first has lost its last row by its own count."""
    path, page_bytes = tmp_path / "a.db3", 4096
    write_sqlite(path, MESSAGES)
    whole, lost = path.read_bytes(), 0
    for page in range(page_bytes, len(whole), page_bytes):
        data = bytearray(whole)
        data[page + 4] -= bool(data[page + 4])  # the low byte of the count
        path.write_bytes(data)
        try:
            reader = BagReader(path)
            result = list(reader.messages())
        except BagError:  # of the page that has the topics
            continue
        lost += result != MESSAGES
        assert result == MESSAGES or reader.damage
    assert lost > 0


def test_a_message_of_no_topic_costs_no_topic(tmp_path):
    path = tmp_path / "a.db3"
    write_sqlite(path, MESSAGES)
    with closing(sqlite3.connect(path)) as base, base:
        base.execute("UPDATE messages SET topic_id = 77 WHERE id = 1")
    reader = BagReader(path)
    assert list(reader.messages()) == MESSAGES[1:]
    assert "1 messages belong to no known topic" in reader.damage


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_long_bag_is_never_in_memory(tmp_path, storage):
    data = np.random.default_rng(1).bytes(100_000)
    parts = [[BagMessage("/a", TYPE, 100 * k + n, data) for n in range(100)] for k in range(4)]
    reader = BagReader(record(tmp_path / "bag", parts, storage))
    next(reader.messages())  # what the libraries load
    begun, most, count = resident_bytes(), 0, 0
    for _ in reader.messages():
        count += 1
        most = max(most, resident_bytes() - begun)
    assert count == 400  # 40 MB
    assert most < 10 << 20  # SQLite keeps 2 MB of pages, MCAP a chunk


def resident_bytes():
    status = Path("/proc/self/status").read_text()
    return int(re.search(r"VmRSS:\s+(\d+) kB", status)[1]) << 10


def test_what_looks_like_a_bag(tmp_path):
    """A folder of pictures is none, even if a bag lies among them."""
    folder = record(tmp_path / "bag", THIRDS, "sqlite3", "file")
    assert is_bag(folder)
    assert all(map(is_bag, folder.iterdir()))
    (folder / "metadata.yaml").unlink()
    assert is_bag(folder)
    (folder / "picture.png").touch()
    assert not is_bag(folder)
    assert not is_bag(folder / "picture.png")


def test_metadata_choose_among_files_and_of_old_versions_name_the_folder_too(tmp_path):
    folder = record(tmp_path / "bag", THIRDS)
    write_mcap(folder / "another.mcap", MESSAGES)
    assert list(BagReader(folder).messages()) == MESSAGES
    write_metadata(folder, [f"bag/bag_{number}.mcap" for number in range(3)])
    assert list(BagReader(folder).messages()) == MESSAGES


def test_a_compressed_file_by_any_name(tmp_path):
    write_mcap(tmp_path / "a.mcap", MESSAGES)
    packed = compressed(tmp_path / "a.mcap").rename(tmp_path / "b.mcap")
    assert list(BagReader(packed).messages()) == MESSAGES
