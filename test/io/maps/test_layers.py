"""Which files make which layers, with and without a style sheet; and what a reload watches."""

import json
import math

import pytest
from map_files import RING, gpb, wkb, write_geopackage, write_shapefile

from tirgeo_ros.core.map.map_layers import LayerStyle
from tirgeo_ros.core.types.errors import ConfigError, MapError
from tirgeo_ros.io.maps import map_files
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


def test_entries_without_a_file_are_of_the_map(styled):
    layers = styled("layers: [{colour: red}, {layer: main}]", "roads.gpkg")
    assert names(layers) == ["main", "paths", "main"]
    assert [layer.style.line_bgr == RED for layer in layers] == [True, True, False]
    with pytest.raises(ConfigError, match=r"style.yaml: layer 1: has no file, and the parameter"):
        styled("layers: [{colour: red}]")


def test_files_that_the_sheet_does_not_draw_come_first(styled):
    layers = styled("layers: [{file: ../roads.gpkg, layer: main}]", "roads.gpkg", "wells.shp")
    assert names(layers) == ["wells", "main"]


def test_the_label_field_where_the_sheet_does_not_say(styled):
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


def test_what_a_sheet_asks_for_in_vain(styled):
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
    told = f"{where}: feature 4 (9): a LineString of 1 positions is too short; left out"
    assert [layer.left_out for layer in layers] == [(told,), (), ()]  # of the file, so once


def test_a_condition_on_what_is_not_there(kinds, styled):
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
    with pytest.raises(ConfigError, match=r"style.yaml: it matches no feature of the map: .*pump"):
        styled("layers: [{where: kind == hydrant}]", "kinds.geojson")


def test_what_is_watched(folder):
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
