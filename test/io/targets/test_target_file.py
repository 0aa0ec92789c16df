"""Files that cannot be used: one clear error each, and what is in them stays."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys

import numpy as np
import pyogrio
import pytest
from target_samples import click

from tirgeo_ros.core.types.errors import TargetError
from tirgeo_ros.io.targets.store import TargetStore


@pytest.fixture
def path(tmp_path):
    return tmp_path / "targets.gpkg"


def filled(path, number=30):
    store = TargetStore(path)
    for k in range(number):
        store.add(click(k), name=f"target {k}", picture=b"\xff\xd8" + bytes(2000), now_ns=k)
    found = store.all()
    store.close()
    return found


def refused(path, said):
    """The file is refused by its name, with what to do, and left as it is."""
    before = path.read_bytes()
    with pytest.raises(TargetError, match=said) as error:
        TargetStore(path)
    assert str(error.value).startswith(f"{path}: ")
    assert path.read_bytes() == before


def test_a_text_is_no_geopackage(path):
    path.write_text("id,lat,lon\n1,2,3\n" * 100)
    refused(path, "it is no GeoPackage; give the targets another name")


def test_another_program_s_database_is_left_alone(path):
    with sqlite3.connect(path) as db:
        db.execute("CREATE TABLE targets (id)")
    db.close()
    refused(path, "a database that tirgeo did not make; give the targets another name")


def test_another_program_s_geopackage_is_left_alone(path):
    point = bytes.fromhex("0101000000" + "00" * 16)
    names = [np.array(["a"], object)]
    pyogrio.raw.write(
        path,
        np.array([point], object),
        field_data=names,
        fields=["name"],
        layer="targets",
        geometry_type="Point",
        crs="EPSG:4326",
    )
    refused(path, "a database that tirgeo did not make")


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_a_file_that_is_cut_off_is_damaged(path, share):
    filled(path)
    os.truncate(path, int(path.stat().st_size * share))
    refused(path, "it is damaged and was left as it is: move it away")


def test_a_file_with_overwritten_pages_is_damaged(path):
    filled(path)
    size = path.stat().st_size
    with path.open("r+b") as file:
        file.seek(size // 3)
        file.write(os.urandom(8192))
    refused(path, "it is damaged and was left as it is")


@pytest.mark.parametrize(
    "change",
    [
        "UPDATE clicks SET latitude_deg = 'north' WHERE fid = 2",
        "UPDATE clicks SET latitude_deg = 200 WHERE fid = 2",
        "UPDATE clicks SET covariance_enu = '1 2 3' WHERE fid = 2",
        "UPDATE clicks SET covariance_enu = x'00' WHERE fid = 2",
        "UPDATE targets SET created_ns = NULL WHERE fid = 2",
    ],
)
def test_rows_that_are_none_of_ours_are_named_as_damage(path, change):
    filled(path, 3)
    with sqlite3.connect(path) as db:
        db.execute(change)
    db.close()
    refused(path, "it is damaged and was left as it is")


def test_what_a_gis_changed_is_taken(path):
    """Names, notes and new points of another program: no reason to lose the rest."""
    found = filled(path, 3)
    with sqlite3.connect(path) as db:
        db.execute("UPDATE targets SET name = 'Huber', target_kind = 'Cow', note = NULL")
        db.execute("INSERT INTO targets (id, number, name) VALUES ('x', 77, 'drawn by hand')")
        db.execute("DELETE FROM targets WHERE number = 2")
    db.close()
    store = TargetStore(path)
    assert [(one.number, one.name, one.kind, one.note) for one in store.all()] == [
        (1, "Huber", "other", ""),
        (3, "Huber", "other", ""),
    ]
    assert [store.undo(), store.undo(), store.undo()] == [
        "target 3 removed again",
        "target 1 removed again",  # 2 is gone
        "",
    ]
    assert store.add(found[1].place, now_ns=1).number == 78
    store.close()


def test_an_empty_file_is_a_new_one(path):
    path.touch()
    store = TargetStore(path)
    store.add(click(), now_ns=1)
    store.close()


@pytest.mark.parametrize(
    ("place", "said"),
    [
        ("absent/targets.gpkg", "no such folder; make it"),
        (".", "not a file"),
        ("/proc/targets.gpkg", "its folder cannot be written: choose another place"),
    ],
)
def test_places_without_a_file(tmp_path, place, said):
    with pytest.raises(TargetError, match=said):
        TargetStore(tmp_path / place)


def test_a_file_that_cannot_be_written_is_refused_at_the_start(path, monkeypatch):
    """Root may write everywhere: SQLite itself is asked to write nothing."""
    filled(path, 1)
    connect = sqlite3.connect

    def read_only(name, *args, **kwargs):
        return connect(f"file:{name}?immutable=1", *args, uri=True, **kwargs)

    monkeypatch.setattr(sqlite3, "connect", read_only)
    refused(path, "it is read-only: choose a place that can be written")


def test_a_full_disk_loses_nothing_and_the_next_try_may_succeed(path):
    store = TargetStore(path)
    one = store.add(click(), now_ns=1)
    pages = store._db.execute("PRAGMA page_count").fetchone()[0]
    store._db.execute(f"PRAGMA max_page_count = {pages + 2}")  # SQLite's own "disk is full"
    with pytest.raises(TargetError, match=r"targets\.gpkg: no room on the disk: make some"):
        store.add(click(), picture=b"\xff\xd8" + bytes(100_000), now_ns=2)
    assert store.all() == [one]
    store._db.execute("PRAGMA max_page_count = 100000")
    two = store.add(click(), picture=b"\xff\xd8" + bytes(100_000), now_ns=2)
    assert two.number == 2
    store.close()
    store = TargetStore(path)
    assert store.all() == [one, two]
    store.close()


@pytest.mark.parametrize("moved", [True, False])
def test_a_file_that_is_taken_away_confirms_nothing_more(path, moved):
    """SQLite would go on writing into a file without a name."""
    store = TargetStore(path)
    one = store.add(click(), now_ns=1)
    if moved:
        path.rename(path.with_name("elsewhere.gpkg"))
        path.write_bytes(b"another")
    else:
        path.unlink()
    with pytest.raises(TargetError, match="moved or deleted while it is in use; put it back"):
        store.edit(one.id, 2, name="x")
    assert store.all() == [one]
    if moved:
        path.with_name("elsewhere.gpkg").replace(path)
        assert store.edit(one.id, 3, name="x").name == "x"
    store.close()


def test_it_is_a_geopackage_for_gdal(path):
    found = filled(path, 3)
    assert path.read_bytes()[68:72] == b"GPKG"
    layers = [name for name, _ in pyogrio.list_layers(path).tolist()]
    assert layers == ["targets", "ellipses", "clicks", "pictures", "marks"]
    meta, _, shapes, columns = pyogrio.raw.read(path, layer="targets")
    assert (meta["crs"], meta["geometry_type"]) == ("EPSG:4326", "Point")
    said = dict(zip(meta["fields"], columns, strict=True))
    assert said["name"].tolist() == [one.name for one in found]
    assert str(said["time"][0]) == "2021-10-20T12:00:35.605"
    for shape, one in zip(shapes, found, strict=True):
        place = one.place.longitude_deg, one.place.latitude_deg
        assert tuple(np.frombuffer(shape, "<f8", 2, 5)) == place
    meta, _, shapes, _ = pyogrio.raw.read(path, layer="ellipses")
    assert (meta["crs"], meta["geometry_type"], len(shapes)) == ("EPSG:4326", "Polygon", 3)


def test_gdal_may_add_a_layer_and_a_point_and_the_store_goes_on(path):
    filled(path, 2)
    point = np.array([bytes.fromhex("0101000000" + "00" * 16)], object)
    for layer, fields in (("notes", ["text"]), ("targets", ["name"])):
        pyogrio.raw.write(
            path,
            point,
            field_data=[np.array(["x"], object)],
            fields=fields,
            layer=layer,
            geometry_type="Point",
            crs="EPSG:4326",
            append=True,
        )
    store = TargetStore(path)
    one = store.add(click(), now_ns=1)
    store.edit(one.id, 2, name="y")
    store.delete(store.all()[0].id, 3)
    store.close()
    assert len(pyogrio.raw.read(path, layer="targets")[2]) == 3


def test_what_qgis_left_in_its_write_ahead_log_is_taken_over(path):
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
    assert [one.name for one in store.all()] == ["1848"]
    store.add(click(), now_ns=1)
    assert not path.with_name("targets.gpkg-wal").exists()  # all is in the one file
    store.close()
