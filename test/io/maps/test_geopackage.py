"""GeoPackages: their tables, systems and frames of geometries, and one that is in use."""

import math
import sqlite3
import sys
from contextlib import closing

import numpy as np
import pytest
from map_files import HOLE, RING, fill_geopackage, gpb, wkb, write_geopackage

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.maps import load_layers

LINE = gpb(wkb("LineString", RING))


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a map #1?.gpkg"


def degrees(feature):
    return np.degrees(feature.points[:, 1::-1])


def test_tables_are_layers_in_their_order(path):
    polygon = gpb(wkb("Polygon", [RING, HOLE]))
    write_geopackage(
        path,
        {
            'road "A"': (4326, [(LINE, "Ringstraße", 7), (None, "none", 8), (LINE, None, 9)]),
            "houses": (4326, [(polygon, "Haus", 1)]),
        },
    )
    roads, houses = load_layers(str(path))
    assert [(f.label, f.group, f.closed) for f in roads.features] == [
        ("Ringstraße", 0, False),
        ("", 2, False),
    ]
    assert [(f.label, f.group, f.closed) for f in houses.features] == [("Haus", 0, True)] * 2
    assert (roads.name, houses.name) == ('road "A"', "houses")
    np.testing.assert_allclose(degrees(houses.features[1]), HOLE, atol=1e-12)
    assert [f.label for f in load_layers(str(path), "", "REF")[0].features] == ["7", "9"]


@pytest.mark.parametrize("envelope", range(5))
def test_every_envelope(path, envelope):
    write_geopackage(path, {"a": (4326, [(gpb(wkb("LineString", RING), envelope), "a", 1)])})
    np.testing.assert_allclose(degrees(load_layers(str(path))[0].features[0]), RING, atol=1e-12)


def test_heights_and_empty_geometries(path):
    line = wkb("LineString", [(16.0, 48.0, 171.5, 1.0), (16.1, 48.0, math.nan, 2.0)], dims="ZM")
    nowhere = wkb("Point", (math.nan, math.nan))
    rows = [(gpb(nowhere, empty=True), "a", 1), (gpb(nowhere), "b", 2), (gpb(line), "c", 3)]
    write_geopackage(path, {"a": (4326, rows)})
    (layer,) = load_layers(str(path))
    (feature,) = layer.features
    np.testing.assert_array_equal(feature.points[:, 2], [171.5, np.nan])
    assert layer.left_out == (f"{path}: layer a: 2 features without a geometry left out",)


@pytest.mark.parametrize("srs_id", [32633, 100001, 100003])
def test_systems_by_code_and_by_definition(path, srs_id):
    """UTM 33N has its central meridian at 15 deg, 500 km east."""
    line = gpb(wkb("LineString", [(500000.0, 0.0), (500000.0, 1000.0)]))
    write_geopackage(path, {"a": (srs_id, [(line, "a", 1)])})
    layer = load_layers(str(path))[0]
    np.testing.assert_allclose(degrees(layer.features[0])[0], [15.0, 0.0], atol=1e-9)
    assert layer.left_out == ()


def test_a_column_of_geometries_that_is_absent(path):
    write_geopackage(path, {"a": (4326, [(LINE, "a", 1)])})
    with closing(sqlite3.connect(path)) as database:
        database.execute("UPDATE gpkg_geometry_columns SET column_name = 'shape'")
        database.commit()
    with pytest.raises(MapError, match="layer a: there is no column 'shape', which is to hold"):
        load_layers(str(path))


@pytest.mark.parametrize("journal", ["delete", "wal"])
def test_a_package_that_another_program_writes(path, journal):
    """What that has written last is read, and nothing is left beside the file."""
    tables = {"a": (4326, [(LINE, "old", 1)])}
    with closing(sqlite3.connect(path)) as writer:
        fill_geopackage(writer, tables, journal)
        writer.execute("UPDATE a SET name = 'new'")
        writer.commit()
        before = sorted(path.parent.iterdir())
        assert load_layers(str(path))[0].features[0].label == "new"
        assert sorted(path.parent.iterdir()) == before
        writer.execute("UPDATE a SET name = 'not yet'")  # and not committed
        assert load_layers(str(path))[0].features[0].label == "new"
    assert load_layers(str(path))[0].features[0].label == "new"
    assert list(path.parent.iterdir()) == [path]


BAD = {
    "text": ("text", "its geometry is none of a GeoPackage's"),
    "version": (b"GP\1" + LINE[3:], "its geometry is none of a GeoPackage's"),
    "envelope": (b"GP\0\x0f" + LINE[4:], "its geometry is of an extended or unknown form"),
    "extended": (b"GP\0\x21" + LINE[4:], "its geometry is of an extended or unknown form"),
    "cut": (LINE[:-3], "its geometry (WKB) ends before the 4 parts that it tells of"),
    "nan": (gpb(wkb("LineString", [RING[0], (math.nan, 1.0)])), "(nan, 1, nan) is not finite"),
    "range": (gpb(wkb("Point", (16.0, 190.5))), "(16, 190.5) is not a longitude and a latitude"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_feature_is_left_out_and_named(path, case):
    blob, why = BAD[case]
    write_geopackage(path, {"a": (4326, [(LINE, "good", 1), (blob, "bad", 2)])})
    (layer,) = load_layers(str(path))
    assert [f.label for f in layer.features] == ["good"]
    assert layer.left_out == (f"{path}: layer a: feature 2 (bad): {why}; left out",)


def test_a_bad_table_beside_a_good_one(path):
    """What is wrong with the bad one is told, and it takes nothing from the other."""
    far = gpb(wkb("Point", (500_000.0, 5_300_000.0)))
    write_geopackage(path, {"far": (0, [(far, "f", 1)]), "near": (4326, [(LINE, "n", 1)])})
    far_layer, near = load_layers(str(path))
    assert (len(far_layer.features), len(near.features)) == (0, 1)
    assert "feature 1 (f): (500000, 5.3e+06) is not a longitude and" in far_layer.left_out[0]


def test_a_table_that_is_told_of_but_absent(path):
    write_geopackage(path, {"a": (4326, [(LINE, "a", 1)])})
    with closing(sqlite3.connect(path)) as database:
        database.execute("DROP TABLE a")
    with pytest.raises(MapError, match="no GeoPackage that can be read: no such table: a"):
        load_layers(str(path))


def test_a_schema_that_is_no_text(path):
    write_geopackage(path, {"a": (4326, [(LINE, "a", 1)])})
    path.write_bytes(path.read_bytes().replace(b"TABLE gpkg_contents", b"TABL\xef gpkg_contents"))
    with pytest.raises(MapError, match="no GeoPackage that can be read"):
        load_layers(str(path))


def test_views(path):
    """A table may be a view; a function that SQLite has not is said."""
    write_geopackage(path, {"a": (4326, [(LINE, "a", 1)])})
    with closing(sqlite3.connect(path)) as database:
        database.executescript(
            "ALTER TABLE a RENAME TO b; CREATE VIEW a AS SELECT fid, geom, name, ref FROM b"
        )
    assert load_layers(str(path))[0].features[0].label == "a"
    with closing(sqlite3.connect(path)) as database:
        database.executescript("DROP VIEW a; CREATE VIEW a AS SELECT ST_Buffer(geom) geom FROM b")
    with pytest.raises(MapError, match=r"no GeoPackage .* no such function: ST_Buffer"):
        load_layers(str(path))


def test_an_sqlite_file_of_something_else(path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyogrio", None)
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE notes (text TEXT)")
        database.commit()
    with pytest.raises(MapError, match="none of GeoJSON, GeoPackage"):
        load_layers(str(path))
