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
"""Files that are unusable or damaged: one clear error each, and they stay unchanged."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys

import numpy as np
import pyogrio
import pytest
from layers_by_gdal import layers_in, rows_of
from target_samples import click

from tirgeo_ros.core.types.errors import TargetError
from tirgeo_ros.io.targets.geopackage import read_targets
from tirgeo_ros.io.targets.store import TargetStore

NEWEST = "WHERE revision = (SELECT max(revision) FROM tirgeo_changes)"
POINT = np.array([bytes.fromhex("0101000000" + "00" * 16)], object)
DAMAGED = "it is damaged and was left as it is: move it away"


def filled(path, number=30):
    store = TargetStore(path)
    for k in range(number):
        store.add(click(k), name=f"target {k}", picture=b"\xff\xd8" + bytes(2000), now_ns=k)
    targets = store.all()
    store.close()
    return targets


def add_by_gdal(path, layer, field, **how):
    pyogrio.raw.write(
        path,
        POINT,
        field_data=[np.array(["x"], object)],
        fields=[field],
        layer=layer,
        geometry_type="Point",
        crs="EPSG:4326",
        **how,
    )


def refused(path, words):
    """The file is refused by its name, with what to do, and left as it is."""
    before = path.read_bytes()
    with pytest.raises(TargetError, match=words) as error:
        TargetStore(path)
    assert str(error.value).startswith(f"{path}: ")
    assert path.read_bytes() == before


def test_files_of_other_programs_are_left_alone(path, tmp_path):
    path.write_text("id,lat,lon\n1,2,3\n" * 100)
    refused(path, "it is not a GeoPackage; give another file for the targets")
    path.unlink()
    with sqlite3.connect(path) as db:
        db.execute("CREATE TABLE targets (id)")
    db.close()
    refused(path, "a database that tirgeo did not make; give another file for the targets")
    add_by_gdal(tmp_path / "gis.gpkg", "targets", "name")
    refused(tmp_path / "gis.gpkg", "a database that tirgeo did not make")


def overwritten(path):
    with path.open("r+b") as file:
        file.seek(path.stat().st_size // 3)
        file.write(os.urandom(8192))


@pytest.mark.parametrize(
    "damage",
    [
        lambda path: os.truncate(path, path.stat().st_size // 10),
        lambda path: os.truncate(path, path.stat().st_size * 9 // 10),
        overwritten,
        "UPDATE clicks SET latitude_deg = 200 WHERE fid = 2",
        "UPDATE clicks SET covariance_enu = x'00' WHERE fid = 2",
        "UPDATE targets SET created_ns = NULL WHERE fid = 2",
    ],
)
def test_a_file_with_damage_or_foreign_rows_is_refused(path, changed, damage):
    filled(path)
    if isinstance(damage, str):
        changed(damage)
    else:
        damage(path)
    refused(path, DAMAGED)


def test_changes_of_a_gis_are_accepted(path, changed):
    """Names, notes and new points of another program; the other targets stay."""
    targets = filled(path, 3)
    changed(
        "UPDATE targets SET name = 'Huber', target_kind = 'Cow', note = NULL",
        "INSERT INTO targets (id, number, name) VALUES ('x', 77, 'drawn by hand')",
        "DELETE FROM targets WHERE number = 2",
    )
    store = TargetStore(path)
    assert [(item.number, item.name, item.kind, item.note) for item in store.all()] == [
        (1, "Huber", "other", ""),
        (3, "Huber", "other", ""),
    ]
    assert [store.undo(), store.undo(), store.undo()] == [
        "target 3 removed again",
        "target 1 removed again",  # 2 is gone
        "",
    ]
    assert store.add(targets[1].place, now_ns=1).number == 78
    store.close()


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("absent/targets.gpkg", "no such folder; make it"),
        (".", "not a file"),
        ("/proc/targets.gpkg", "its folder cannot be written: choose another place"),
    ],
)
def test_places_without_a_file(tmp_path, place, words):
    with pytest.raises(TargetError, match=words):
        TargetStore(tmp_path / place)


def test_a_file_that_cannot_be_written_is_refused_at_the_start(path, monkeypatch):
    """Root may write everywhere: SQLite itself is asked to write nothing."""
    filled(path, 1)
    connect = sqlite3.connect

    def read_only(name, *args, **kwargs):
        return connect(f"file:{name}?immutable=1", *args, uri=True, **kwargs)

    monkeypatch.setattr(sqlite3, "connect", read_only)
    refused(path, "it is read-only: choose another place")


def test_a_full_disk_loses_nothing_and_the_next_try_may_succeed(store):
    item = store.add(click(), now_ns=1)
    pages = store._db.execute("PRAGMA page_count").fetchone()[0]
    store._db.execute(f"PRAGMA max_page_count = {pages + 2}")  # SQLite's own "disk is full"
    with pytest.raises(TargetError, match=r"targets\.gpkg: no room on the disk: free some"):
        store.add(click(), picture=b"\xff\xd8" + bytes(100_000), now_ns=2)
    assert store.all() == [item]
    store._db.execute("PRAGMA max_page_count = 100000")
    two = store.add(click(), picture=b"\xff\xd8" + bytes(100_000), now_ns=2)
    assert two.number == 2
    store.close()
    assert read_targets(store.path) == [item, two]


@pytest.mark.parametrize("moved", [True, False])
def test_after_the_file_is_moved_no_change_is_confirmed(path, store, moved):
    """SQLite would go on writing into a file without a name."""
    item = store.add(click(), now_ns=1)
    if moved:
        path.rename(path.with_name("elsewhere.gpkg"))
        path.write_bytes(b"another")
    else:
        path.unlink()
    with pytest.raises(TargetError, match="moved or deleted while it is in use; put it back"):
        store.edit(item.id, 2, name="x")
    assert store.all() == [item]
    if moved:
        path.with_name("elsewhere.gpkg").replace(path)
        assert store.edit(item.id, 3, name="x").name == "x"


def test_it_is_a_geopackage_for_gdal_which_may_add_a_layer_and_a_point(path):
    targets = filled(path, 3)
    assert path.read_bytes()[68:72] == b"GPKG"
    assert [*layers_in(path)] == ["targets", "ellipses", "clicks", "pictures", "marks"]
    assert (layers_in(path)["targets"], layers_in(path)["ellipses"]) == ("Point", "Polygon")
    rows = rows_of(path, "targets")
    assert [row["name"] for row in rows] == [target.name for target in targets]
    assert rows[0]["time"].startswith("2021-10-20T12:00:35.605")
    for row, target in zip(rows, targets, strict=True):
        place = [target.place.longitude_deg, target.place.latitude_deg]
        assert row["positions"].tolist() == [place]
    assert pyogrio.read_info(path, layer="targets")["crs"] == "EPSG:4326"
    assert pyogrio.read_info(path, layer="ellipses")["crs"] == "EPSG:4326"
    assert len(rows_of(path, "ellipses")) == 3
    for layer, field in (("notes", "text"), ("targets", "name")):
        add_by_gdal(path, layer, field, append=True)
    store = TargetStore(path)
    item = store.add(click(), now_ns=1)
    store.edit(item.id, 2, name="y")
    store.delete(store.all()[0].id, 3)
    store.close()
    assert len(rows_of(path, "targets")) == 4


def test_changes_in_the_write_ahead_log_of_qgis_are_kept(path):
    """QGIS turns a file to WAL; a crash of it leaves changes beside the file."""
    filled(path, 1)
    change = (
        "import os, sqlite3\n"
        f"db = sqlite3.connect({str(path)!r})\n"
        "db.execute('PRAGMA journal_mode = WAL')\n"
        "db.execute('UPDATE targets SET name = 1848')\n"
        "db.commit()\n"
        "os.kill(os.getpid(), 9)"
    )
    subprocess.run([sys.executable, "-c", change], check=False)
    assert path.with_name("targets.gpkg-wal").exists()
    store = TargetStore(path)
    assert [item.name for item in store.all()] == ["1848"]
    store.add(click(), now_ns=1)
    assert not path.with_name("targets.gpkg-wal").exists()  # all is in the one file
    store.close()


def test_a_file_that_was_cut_short_by_a_kill_is_read(path, store):
    """A journal beside the file belongs to a change that was never confirmed."""
    store.add(click(), now_ns=1)
    store._db.execute("PRAGMA cache_size = 1")
    store._db.execute("BEGIN EXCLUSIVE")
    store._db.execute("UPDATE clicks SET height_m = 7")
    store._db.execute("INSERT INTO pictures (target, jpeg) VALUES ('x', zeroblob(500000))")
    copy = path.with_name("copy.gpkg")
    for end in ("", "-journal"):
        path.with_name(f"copy.gpkg{end}").write_bytes(path.with_name(path.name + end).read_bytes())
    store._db.execute("ROLLBACK")
    assert read_targets(copy) == store.all()


def test_many_targets_that_another_program_removed_leave_nothing_to_undo(path, changed):
    """As many as the journal holds."""
    TargetStore(path).close()
    numbers = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n LIMIT 999)"
    row = "INSERT INTO tirgeo_changes (action, target, undone)"
    changed(f"{row} {numbers} SELECT 'add', i, 0 FROM n")
    store = TargetStore(path)
    assert store.undo() == store.undo() == ""
    store.close()


def edited(path):
    """Two targets, the first edited twice."""
    path.touch()  # an empty file is a new one
    store = TargetStore(path)
    item = store.add(click(), kind="person", now_ns=1)
    other = store.add(click(3), now_ns=2)
    store.edit(item.id, 3, name="Anna")
    store.edit(item.id, 4, name="Berta")
    store.close()
    return item, other


@pytest.mark.parametrize(
    "change",
    [
        "before = substr(before, 2)",
        "before = '7'",
        pytest.param(f"before = '{'[' * 100_000}'", id="deep"),
        "before = NULL",
        "before = CAST(x'ff00' AS TEXT)",
        "before = replace(before, 'person', 'persoo')",
        "before = replace(before, '\"changed_ns\": 3', '\"changed_ns\": 9634731235605555556')",
        "before = replace(before, 'stamp_ns\": ', 'stamp_ns\": 9')",
        "before = replace(before, 'number\": 1', 'number\": \"1\"')",
        "action = 'add'",
        "action = CAST(x'ff' AS TEXT)",
        "target = replace(target, substr(target, 1, 1), 'x')",
    ],
)
def test_a_damaged_record_is_named_and_undo_goes_on_before_it(path, changed, change):
    item, other = edited(path)
    changed(f"UPDATE tirgeo_changes SET {change} {NEWEST}")
    store = TargetStore(path)
    before = store.all()
    with pytest.raises(TargetError, match="record of the last change is damaged: Undo again for"):
        store.undo()
    assert store.all() == before
    assert store.undo() == "target 1 as before"
    assert store.all() == [item, other]
    assert [store.undo() for _ in range(3)] == [
        "target 2 removed again",
        "target 1 removed again",
        "",
    ]
    store.close()


@pytest.mark.parametrize("share", ["target IN (SELECT id FROM targets)", "fid = 2"])
def test_a_target_whose_clicks_are_gone_stays_and_is_named(path, changed, share):
    store = TargetStore(path)
    item = store.add(click(), now_ns=1)
    item = store.refine(item.id, click(1, after_s=60), 2)
    other = store.add(click(3), now_ns=3)
    store.close()
    changed(f"DELETE FROM clicks WHERE {share} AND target != '{other.id}'")
    store = TargetStore(path)
    left, same = store.all()
    assert (left.id, left.number, len(left.clicks), same) == (item.id, 1, 1, other)
    # Rows are written to 1e-9 deg, 0.1 mm; the two clicks are 1 m apart.
    far_deg = 1e-9 if "IN" in share else 2e-5
    assert left.place.longitude_deg == pytest.approx(item.place.longitude_deg, abs=far_deg)
    assert store.lost_clicks == [1]
    store.close()
    assert read_targets(path) == [left, same]


def test_a_damaged_byte_of_an_alternative_costs_a_letter(path, changed):
    item, _ = edited(path)
    store = TargetStore(path)
    store.edit(item.id, 5, {"name": "Anna"}, name="Gerda")
    store.close()
    changed("UPDATE tirgeo_alternatives SET text = CAST(x'ff65' AS TEXT)")
    store = TargetStore(path)
    assert store.alternatives() == {item.id: [["name", "\ufffde"]]}
    store.close()


#: What a file of the version before targets had a status lacks.
WITHOUT_STATUS = (
    "DROP TRIGGER tirgeo_keep_status",
    "DROP TRIGGER tirgeo_put_status",
    "DROP TABLE tirgeo_statuses",
    "ALTER TABLE targets DROP COLUMN status",
    "ALTER TABLE tirgeo_changes DROP COLUMN status",
)


def test_a_file_of_before_targets_had_a_status_opens_and_all_are_new(path, changed):
    targets = filled(path, 2)
    changed(*WITHOUT_STATUS)
    assert read_targets(path) == targets
    store = TargetStore(path)
    assert store.all() == targets
    found = store.edit(targets[0].id, 9, status="found")
    store.close()
    assert read_targets(path) == [found, targets[1]]
    store = TargetStore(path)
    assert store.undo() == "target 1 as before"
    assert store.all() == targets
    store.close()


def test_an_earlier_version_that_writes_a_target_anew_leaves_its_status(path, changed):
    targets = filled(path, 2)
    store = TargetStore(path)
    store.edit(targets[0].id, 9, status="found")
    store.close()
    columns = "fid, geom, id, number, name, target_kind, created_ns, changed_ns"
    changed(
        "CREATE TEMP TABLE old AS SELECT * FROM targets",
        "DELETE FROM targets",
        f"INSERT INTO targets ({columns}) SELECT {columns} FROM old",
    )
    assert [target.status for target in read_targets(path)] == ["found", "new"]
