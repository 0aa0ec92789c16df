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
"""Layers of files and style sheets, the features of each format, and files to watch."""

from __future__ import annotations

import itertools
import json
import math
import sqlite3
import struct
import sys
import zipfile
from contextlib import closing

import numpy as np
import pytest
from map_files import HOLE, RING, fill_geopackage, gpb, wkb, write_geopackage, write_shapefile
from wild_map_files import LINE as KML_LINE, collection, feature, kml, mark

from tirgeo_ros.core.map.vector_map import LayerStyle
from tirgeo_ros.core.types.errors import ConfigError, MapError
from tirgeo_ros.io.maps import load_layers, map_files
from tirgeo_ros.io.maps.layers import read_layers

RED = (0, 0, 255)


@pytest.fixture
def folder(tmp_path):
    """roads.gpkg of two tables, houses.geojson of one feature, wells.shp."""
    line = gpb(wkb("LineString", RING))
    write_geopackage(
        tmp_path / "roads.gpkg",
        {"main": (4326, [(line, "A1", 1)]), "paths": (4326, [(line, "P", 2)]), "no": (4326, [])},
    )
    house = {
        "type": "Feature",
        "properties": {"name": "Haus", "street": "Gasse", "number": 7},
        "geometry": {"type": "Polygon", "coordinates": [RING]},
    }
    (tmp_path / "houses.geojson").write_text(json.dumps(house))
    write_shapefile(tmp_path / "wells.shp", [RING])
    return tmp_path


@pytest.fixture
def styled(folder):
    def load(sheet, *files, label_field="name"):
        (folder / "sub").mkdir(exist_ok=True)
        path = folder / "sub" / "style.yaml"
        path.write_text(sheet)
        return read_layers(named(folder, *files), str(path), label_field)

    return load


def named(folder, *files):
    return ", ".join(str(folder / file) for file in files)


def names(layers):
    return [layer.name for layer in layers]


def test_several_files_each_table_a_layer(folder):
    layers = read_layers(named(folder, "houses.geojson", "roads.gpkg", "wells.shp") + ",")
    assert names(layers) == ["houses", "main", "paths", "wells"]
    assert all(layer.style == LayerStyle() and layer.sigma_m is None for layer in layers)


def test_a_name_with_a_comma(folder):
    path = folder / "a, b.geojson"
    (folder / "houses.geojson").rename(path)
    assert names(read_layers(str(path))) == ["a, b"]
    assert map_files(str(path)) == [path]


def test_a_sheet_with_its_own_files(styled):
    layers = styled(
        """
        layers:
          - {file: ../roads.gpkg, layer: paths, colour: red, sigma: 0.5}
          - {file: ../houses.geojson, label: "{street} {number}"}
          - {file: ../roads.gpkg, label: false}
        """
    )
    assert names(layers) == ["paths", "houses", "main", "paths"]
    assert (layers[0].style.line_bgr, layers[0].sigma_m) == (RED, 0.5)
    assert [layer.features[0].label for layer in layers] == ["P", "Gasse 7", "", ""]
    assert not layers[3].style.labels


def test_entries_without_a_file_draw_the_map(styled):
    layers = styled("layers: [{colour: red}, {layer: main}]", "roads.gpkg")
    assert names(layers) == ["main", "paths", "main"]
    assert [layer.style.line_bgr == RED for layer in layers] == [True, True, False]
    with pytest.raises(ConfigError, match=r"style.yaml: layer 1: no key file, and parameter map"):
        styled("layers: [{colour: red}]")


def test_files_that_the_sheet_does_not_draw_come_first(styled):
    layers = styled("layers: [{file: ../roads.gpkg, layer: main}]", "roads.gpkg", "wells.shp")
    assert names(layers) == ["wells", "main"]


def test_the_label_field_if_the_sheet_names_none(styled):
    layers = styled("layers: [{}, {label: name}]", "houses.geojson", label_field="street")
    assert [layer.features[0].label for layer in layers] == ["Gasse", "Haus"]


def test_the_sheets_system_takes_precedence(folder, styled):
    point = {"type": "Point", "coordinates": [500_000, 5_300_000]}
    (folder / "odd.geojson").write_text(json.dumps(point))
    (layer,) = styled("layers: [{file: ../odd.geojson, crs: 32633}]")
    # on the middle meridian of zone 33
    assert math.degrees(layer.features[0].points[0, 1]) == pytest.approx(15, abs=1e-9)
    with pytest.raises(MapError, match=r"odd\.geojson: .* is not a longitude and a latitude"):
        styled("layers: [{file: ../odd.geojson}]")


def test_a_sheet_that_names_absent_files_layers_or_fields(styled):
    with pytest.raises(
        MapError, match=r"roads.gpkg: there is no layer 'pats' \(did you mean paths"
    ):
        styled("layers: [{layer: pats}]", "roads.gpkg")
    with pytest.raises(MapError, match="there is no layer 'a'"):
        styled("layers: [{layer: a}]", "houses.geojson")
    with pytest.raises(ConfigError, match=r"layer 1: label: .*layer houses has no field 'nmae'"):
        styled("layers: [{label: nmae}]", "houses.geojson")
    with pytest.raises(MapError, match=r"absent.kml: there is no such map; check its name"):
        styled("layers: [{file: absent.kml}]")


def test_links_in_a_loop(folder, styled):
    (folder / "a.kml").symlink_to("a.kml")
    with pytest.raises(MapError, match=r"a\.kml: "):
        styled("layers: [{file: ../roads.gpkg}]", "a.kml")
    with pytest.raises(MapError, match=r"a\.kml: "):
        styled("layers: [{file: ../a.kml}]", "roads.gpkg")


def test_a_line_of_no_length_is_counted(folder):
    path = folder / "a.geojson"
    shapes = [
        {"type": "LineString", "coordinates": [p, p, q]} for p, q in (RING[:2], [RING[0]] * 2)
    ]
    path.write_text(json.dumps({"type": "GeometryCollection", "geometries": shapes}))
    (layer,) = read_layers(str(path))
    assert [len(f.points) for f in layer.features] == [2]
    assert layer.left_out == (
        f"{path}: layer a: part of feature 1: a line without length; left out",
    )


@pytest.fixture
def kinds(folder):
    """kinds.geojson: a well that gives 60, a pump that gives "96", and one of no kind."""
    rows = [{"kind": "well", "flow": 60}, {"kind": "pump", "flow": "96"}, {"name": "none"}]
    features = [
        {
            "type": "Feature",
            "properties": row,
            "geometry": {"type": "Point", "coordinates": [16 + number, 48]},
        }
        for number, row in enumerate(rows)
    ]
    line = {"type": "LineString", "coordinates": [[16, 48]]}
    bad = {"type": "Feature", "properties": {"name": "9"}, "geometry": line}
    root = {"type": "FeatureCollection", "features": [*features, bad]}
    (folder / "kinds.geojson").write_text(json.dumps(root))
    return folder / "kinds.geojson"


def test_one_file_in_several_layers_by_a_property(kinds, styled):
    layers = styled(
        "layers: [{where: kind == well, colour: red}, {where: flow > 60}, {where: kind != well}]",
        "kinds.geojson",
    )
    assert [[f.group for f in layer.features] for layer in layers] == [[0], [1], [1, 2]]
    assert layers[0].style.line_bgr == RED
    where = f"{kinds}: layer kinds"
    reports = f"{where}: feature 4 (9): a LineString of 1 positions is too short; left out"
    assert [layer.left_out for layer in layers] == [(reports,), (), ()]  # of the file, so once


def test_a_condition_on_an_absent_property(kinds, styled):
    good = "{where: kind == well}"
    _, layer = styled(f"layers: [{good}, {{where: kidn == well}}]", "kinds.geojson")
    assert layer.features == []
    (note,) = layer.left_out
    sheet = kinds.parent / "sub" / "style.yaml"
    assert note == (
        f"{sheet}: layer 2: where: {kinds}: layer kinds has no property 'kidn' "
        "(did you mean kind?)"
    )
    _, layer = styled(f"layers: [{good}, {{where: kind == hydrant}}]", "kinds.geojson")
    (note,) = layer.left_out
    assert note.startswith(
        f"{sheet}: layer 2: where: no feature of {kinds}: layer kinds matches: "
    )
    assert note.endswith("kind is pump, well")
    with pytest.raises(
        ConfigError, match=r"style.yaml: its conditions match no feature of the map: .*pump"
    ):
        styled("layers: [{where: kind == hydrant}]", "kinds.geojson")


def test_files_on_which_the_layers_depend(folder):
    (folder / "site.prj").write_text("")
    sheet = folder / "style.yaml"
    sheet.write_text("layers: [{file: wells.shp, crs: 4326}, {file: houses.geojson}]")
    watched = map_files(named(folder, "houses.geojson", "roads.gpkg"), str(sheet))
    wanted = ["houses.geojson", "roads.gpkg", "roads.gpkg-wal", "style.yaml", "wells.shp"]
    wanted += ["wells.shx", "wells.dbf", "wells.prj", "wells.cpg"]
    assert [each.name for each in watched] == wanted
    sheet.write_text("layers: [")
    assert [each.name for each in map_files("", str(sheet))] == ["style.yaml"]
    assert map_files("", "") == []


LINE = gpb(wkb("LineString", RING))
CLOSE_DEG = 1e-12
#: Coordinates, and the parts of each geometry: positions, and whether it is a ring.
SHAPES = {
    "Point": (RING[0], [([RING[0]], False)]),
    "MultiPoint": (RING[:2], [([RING[0]], False), ([RING[1]], False)]),
    "LineString": (RING, [(RING, False)]),
    "MultiLineString": ([RING, HOLE], [(RING, False), (HOLE, False)]),
    "Polygon": ([RING, HOLE], [(RING, True), (HOLE, True)]),
    "MultiPolygon": ([[RING], [HOLE]], [(RING, True), (HOLE, True)]),
}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a map #1?.geojson"


def degrees(feature):
    return np.degrees(feature.points[:, 1::-1])


def check_parts(features, wanted, heights=np.nan):
    assert [f.closed for f in features] == [closed for _, closed in wanted]
    for got, (points, _) in zip(features, wanted, strict=True):
        np.testing.assert_allclose(degrees(got), points, rtol=0, atol=CLOSE_DEG)
        np.testing.assert_array_equal(got.points[:, 2], heights)


@pytest.mark.parametrize("kind", SHAPES)
@pytest.mark.parametrize("height", [np.nan, 170.5])
@pytest.mark.parametrize("suffix", [".geojson", ".gpkg"])
def test_every_geometry_and_its_height(path, kind, height, suffix):
    coordinates, wanted = SHAPES[kind]
    deep = np.isfinite(height)
    if deep:
        coordinates = with_more(coordinates, height)
    path = path.with_suffix(suffix)
    if suffix == ".geojson":
        path.write_text(collection(feature(kind, coordinates)))
    else:
        blob = gpb(wkb(kind, coordinates, dims="Z" if deep else ""))
        write_geopackage(path, {"a": (4326, [(blob, "a", 1)])})
    (layer,) = read_layers(str(path))
    assert layer.left_out == ()
    check_parts(layer.features, wanted, height)


def with_more(coordinates, height):
    if isinstance(coordinates, tuple):
        return (*coordinates, height)
    return [with_more(each, height) for each in coordinates]


def test_collections_in_collections(path):
    inner = [(kind, coordinates) for kind, (coordinates, _) in SHAPES.items()]
    blob = gpb(wkb("GeometryCollection", [("GeometryCollection", inner), ("Point", RING[0])]))
    path = path.with_suffix(".gpkg")
    write_geopackage(path, {"a": (4326, [(blob, "a", 1)])})
    wanted = [part for _, parts in SHAPES.values() for part in parts]
    check_parts(read_layers(str(path))[0].features, [*wanted, ([RING[0]], False)])


def test_arcs_become_lines(path):
    arc = struct.pack("<BII", 1, 8, 3) + struct.pack("<6d", 16, 48, 16.001, 48.001, 16.002, 48)
    path = path.with_suffix(".gpkg")
    write_geopackage(path, {"a": (4326, [(gpb(arc), "a", 1)])})
    (drawn,) = read_layers(str(path))[0].features
    radii = np.hypot(*(degrees(drawn) - [16.001, 48.0]).T)
    np.testing.assert_allclose(radii, 0.001, rtol=1e-5)
    assert len(radii) > 10


def test_features_on_the_earth_are_not_drawn_if_most_others_are_off_it(path):
    """Coordinates in metres include some that could be degrees."""
    points = [[16.0, 48.0], [316.0, 148.0], [916.0, 48.0], [-500.0, 2.0]]
    path.write_text(collection(*(feature("Point", point) for point in points)))
    with pytest.raises(MapError, match=r"feature 1 .*uncertain|feature 2 .*\(none of 4 fea"):
        read_layers(str(path))
    path.write_text(collection(*(feature("Point", point) for point in points[:2])))
    (layer,) = read_layers(str(path))
    assert [f.group for f in layer.features] == [0]  # no more than half
    (note,) = layer.left_out
    assert note.endswith("feature 2 (a): (316, 148) is not a longitude and a latitude; left out")


@pytest.mark.parametrize(
    "wrong",
    [
        feature("Polygon", RING),
        feature("LineString", [["16", "48"], ["17", "48"]]),
        feature("MultiLineString", [RING[:1]]),
        feature("Point", [None, 48]),
        {"type": "Feature", "properties": {}, "geometry": {"type": "Circle"}},
        {"type": "Feature", "properties": None, "geometry": None},
    ],
)
def test_a_bad_feature_does_not_move_the_others(path, wrong):
    """A bad feature changes neither position nor number of the others."""
    good = [feature("Polygon", [RING, HOLE]), feature("LineString", [[16, 48, 3], [17, 48]])]
    path.write_text(collection(good[0], wrong, good[1]))
    (layer,) = read_layers(str(path))
    assert [(f.group, f.closed) for f in layer.features] == [(0, True), (0, True), (2, False)]
    np.testing.assert_allclose(degrees(layer.features[2]), [[16, 48], [17, 48]], atol=CLOSE_DEG)
    assert layer.left_out


def test_unreadable_files_and_pyogrio_not_installed(tmp_path, monkeypatch):
    path = tmp_path / "a.xyz"
    path.write_bytes(b"\0\1\2 no map at all")
    with pytest.raises(MapError, match=r"a.xyz: not a readable map: not recogn") as caught:
        read_layers(str(path))
    assert "\n" not in str(caught.value)
    monkeypatch.setitem(sys.modules, "pyogrio", None)
    with pytest.raises(MapError, match=r'a.xyz needs pyogrio: pip install "tirgeo\[maps\]"'):
        read_layers(str(path))


def test_tables_of_a_geopackage_are_layers_in_their_order(path):
    path = path.with_suffix(".gpkg")
    roads = [(LINE, "Ringstraße", 7), (None, "none", 8), (LINE, None, 9)]
    write_geopackage(path, {'road "A"': (4326, roads), "houses": (4326, [(LINE, "Haus", 1)])})
    first, second = read_layers(str(path))
    assert [(f.label, f.group) for f in first.features] == [("Ringstraße", 0), ("", 2)]
    assert first.left_out == (f'{path}: layer road "A": 1 features without a geometry left out',)
    assert (first.name, second.name) == ('road "A"', "houses")
    assert [f.label for f in read_layers(str(path), "", "REF")[0].features] == ["7", "9"]


def test_a_bad_table_beside_a_good_one(path):
    """The bad one is reported, and the good one is complete."""
    path = path.with_suffix(".gpkg")
    far = gpb(wkb("Point", (500_000.0, 5_300_000.0)))
    write_geopackage(path, {"far": (0, [(far, "f", 1)]), "near": (4326, [(LINE, "n", 1)])})
    far_layer, near = read_layers(str(path))
    assert (len(far_layer.features), len(near.features)) == (0, 1)
    assert "feature 1 (f): (500000, 5.3e+06) is not a longitude and" in far_layer.left_out[0]


@pytest.mark.parametrize("journal", ["delete", "wal"])
def test_a_package_that_another_program_writes(path, journal):
    """Its last committed change is read, and no file beside the package changes."""
    path = path.with_suffix(".gpkg")
    with closing(sqlite3.connect(path)) as writer:
        fill_geopackage(writer, {"a": (4326, [(LINE, "old", 1)])}, journal)
        writer.execute("UPDATE a SET name = 'new'")
        writer.commit()
        before = sorted(path.parent.iterdir())
        assert load_layers(str(path))[0].features[0].label == "new"
        assert sorted(path.parent.iterdir()) == before
        writer.execute("UPDATE a SET name = 'not yet'")  # and not committed
        assert load_layers(str(path))[0].features[0].label == "new"
    assert load_layers(str(path))[0].features[0].label == "new"
    assert list(path.parent.iterdir()) == [path]


def test_null_shapes_keep_their_number(path):
    path = write_shapefile(path.with_suffix(".shp"), [RING, None, HOLE])
    (layer,) = read_layers(str(path))
    assert [(f.group, f.label) for f in layer.features] == [(0, "n0"), (2, "n2")]
    assert layer.left_out[0].endswith("1 features without a geometry left out")


@pytest.mark.parametrize("encoding", ["utf-8", "cp1252", "cp1251"])
def test_a_shapefile_without_its_encoding(path, encoding):
    """Or with the code of one in its table: 0xC9 is Windows' Cyrillic."""
    name = "улица" if encoding == "cp1251" else "Grünfläche"
    path = write_shapefile(path.with_suffix(".shp"), [RING], [name], encoding=encoding)
    table = bytearray(path.with_suffix(".dbf").read_bytes())
    table[29] = 0xC9 if encoding == "cp1251" else 0x57
    path.with_suffix(".dbf").write_bytes(table)
    assert read_layers(str(path))[0].features[0].label == name


def test_a_shapefile_that_is_cut_is_refused(path):
    path = write_shapefile(path.with_suffix(".shp"), [RING] * 3)
    path.write_bytes(path.read_bytes()[: 100 + 8 + 48 + 64])  # behind the first record
    with pytest.raises(MapError, match="a damaged shapefile: 220 bytes, and its header says"):
        read_layers(str(path))


def test_shapefiles_in_a_folder_of_a_zip(tmp_path):
    with zipfile.ZipFile(tmp_path / "maps.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("roads", "houses"):
            write_shapefile(tmp_path / f"{name}.shp", [RING], [name])
            for file in tmp_path.glob(f"{name}.*"):
                archive.write(file, f"deep/{file.name}")
    layers = read_layers(str(tmp_path / "maps.zip"))
    assert {layer.name: layer.features[0].label for layer in layers} == {
        "roads": "roads",
        "houses": "houses",
    }


def test_folders_of_a_kml_are_layers_and_its_heights_are_not_taken(path, tmp_path):
    path = path.with_suffix(".kml")
    high = KML_LINE.replace(",48.0 ", ",48.0,77 ")
    data = '<ExtendedData><Data name="ref"><value>H7</value></Data></ExtendedData>'
    inner = f"<Folder><name>wells</name>{mark('w', data + high)}</Folder>"
    path.write_text(kml(f"{inner}{mark('road', KML_LINE)}"))
    sheet = tmp_path / "style.yaml"
    sheet.write_text("layers: [{layer: wells, label: ref}]")
    (wells,) = read_layers(str(path), str(sheet))
    assert [(f.label, len(f.points)) for f in wells.features] == [("H7", 4)]
    assert np.isnan(wells.features[0].points[:, 2]).all()
    assert "heights of a KML are above the sea or ground: left out" in wells.left_out[0]


def test_an_entity_bomb(path):
    path = path.with_suffix(".kml")
    names = "abcdefghij"
    pairs = itertools.pairwise(names)
    entities = "".join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in pairs)
    path.write_text(f'<!DOCTYPE kml [<!ENTITY a "aaaa">{entities}]><kml>&j;</kml>')
    with pytest.raises(MapError, match="not a readable map"):
        read_layers(str(path))


def test_an_id_is_a_property(path):
    path.write_text(json.dumps(feature("Point", RING[0], id="w7")))
    assert read_layers(str(path), "", "id")[0].features[0].label == "w7"
