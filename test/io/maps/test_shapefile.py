"""Shapefiles: every type of shape, its companions, their capitals, code pages and absence."""

import struct
import zipfile

import numpy as np
import pytest
import shapefile
from map_files import HOLE, RING, UTM33_PRJ, write_shapefile

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.coordinates.crs import ASSUMED
from tirgeo_ros.io.maps import load_layers, map_files

# Outer rings are clockwise in a shapefile; pyshp's writer turns none.
OUTER = RING[::-1]
TYPES = {
    "point": ([RING[0]], [([RING[0]], False)]),
    "multipoint": ([RING[:2]], [([RING[0]], False), ([RING[1]], False)]),
    "line": ([[RING, HOLE]], [(RING, False), (HOLE, False)]),
    "poly": ([[OUTER, HOLE]], [(OUTER, True), (HOLE, True)]),
}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "roads.shp"


def degrees(feature):
    return np.degrees(feature.points[:, 1::-1])


def with_more(shape, more):
    if isinstance(shape, tuple):
        return (*shape, *more)
    return [with_more(each, more) for each in shape]


@pytest.mark.parametrize("kind", TYPES)
@pytest.mark.parametrize("dims", ["", "z", "m"])
def test_every_type(path, kind, dims):
    shapes, wanted = TYPES[kind]
    more = {"": (), "z": (171.5, 3.0), "m": (3.0,)}[dims]
    write_shapefile(path, kind + dims, [with_more(shape, more) for shape in shapes])
    (layer,) = load_layers(str(path))
    assert layer.name == "roads"
    assert layer.left_out == ()
    assert [f.closed for f in layer.features] == [closed for _, closed in wanted]
    assert {(f.group, f.label) for f in layer.features} == {(0, "n0")}
    for feature, (points, _) in zip(layer.features, wanted, strict=True):
        np.testing.assert_allclose(degrees(feature), points, atol=1e-12)
        heights = feature.points[:, 2]
        assert (heights == 171.5).all() if dims == "z" else np.isnan(heights).all()


def test_null_shapes_keep_their_number(path):
    write_shapefile(path, "line", [[RING], None, [HOLE]])
    (layer,) = load_layers(str(path))
    assert [(f.group, f.label) for f in layer.features] == [(0, "n0"), (2, "n2")]
    assert layer.left_out == (f"{path}: 1 features without a geometry left out",)


def test_deleted_records_are_not_drawn(path):
    write_shapefile(path, "line", [[RING], [HOLE], [RING]])
    table = bytearray(path.with_suffix(".dbf").read_bytes())
    head, length = struct.unpack_from("<HH", table, 8)
    table[head + length] = ord("*")
    path.with_suffix(".dbf").write_bytes(table)
    (layer,) = load_layers(str(path))
    assert [f.label for f in layer.features] == ["n0", "n2"]
    assert layer.left_out == ()


def test_without_a_prj(path):
    write_shapefile(path, "line", [[RING]], prj=None)
    (layer,) = load_layers(str(path))
    assert layer.left_out == (f"{path}: has no .prj: {ASSUMED}",)
    plane = [[(500000.0, 0.0), (500000.0, 1.0)]]
    write_shapefile(path, "line", [[RING], plane, plane], prj=None)
    with pytest.raises(MapError, match=r"feature 2 .n1.: \(500000, 0\) .* crs in the style sheet"):
        load_layers(str(path))


@pytest.mark.parametrize(
    ("cpg", "encoding"),
    [
        ("UTF-8", "utf-8"),
        ("1252", "cp1252"),
        ("ANSI 1252", "cp1252"),
        ("OEM 850", "cp850"),
        ("ISO 8859-1", "latin-1"),
    ],
)
def test_code_pages(path, cpg, encoding):
    write_shapefile(path, "line", [[RING]], ["Grünfläche"], encoding=encoding)
    path.with_suffix(".CPG").write_text(cpg)
    assert load_layers(str(path))[0].features[0].label == "Grünfläche"


def test_the_code_page_that_the_table_names_and_none(path):
    write_shapefile(path, "line", [[RING]], ["улица"], encoding="cp1251")
    table = bytearray(path.with_suffix(".dbf").read_bytes())
    table[29] = 0xC9
    path.with_suffix(".dbf").write_bytes(table)
    assert load_layers(str(path))[0].features[0].label == "улица"
    for encoding in ("utf-8", "cp1252"):
        write_shapefile(path, "line", [[RING]], ["Grünfläche"], encoding=encoding)
        assert load_layers(str(path))[0].features[0].label == "Grünfläche"


def test_letters_are_told_from_the_records_alone(path):
    """The header's numbers are no letters: 200 records, and 0x57 as many programs write it."""
    names = ["Grünfläche", "ü" * 15 + "x"] * 100
    for encoding in ("utf-8", "cp1252"):
        write_shapefile(path, "line", [[RING]] * 200, names, encoding=encoding)
        table = bytearray(path.with_suffix(".dbf").read_bytes())
        table[29] = 0x57
        assert b"\xc8" in table[4:8]
        path.with_suffix(".dbf").write_bytes(table)
        features = load_layers(str(path))[0].features
        assert [feature.label for feature in features] == names


def test_a_letter_that_the_fields_end_cuts_is_lost_alone(path):
    write_shapefile(path, "line", [[RING]], ["ü" * 20], encoding="utf-8")
    table = path.with_suffix(".dbf").read_bytes()
    path.with_suffix(".dbf").write_bytes(
        table.replace("ü".encode() * 20, b"x" + "ü".encode() * 19 + b"\xc3")
    )
    (feature,) = load_layers(str(path))[0].features
    assert feature.label.startswith("x" + "ü" * 19)


def test_companions_in_capitals_and_named_instead(path):
    write_shapefile(path, "line", [[[(500000.0, 0.0), (500000.0, 1000.0)]]], prj=UTM33_PRJ)
    for suffix in (".dbf", ".prj"):
        path.with_suffix(suffix).rename(path.with_suffix(suffix.upper()))
    (layer,) = load_layers(str(path.with_suffix(".DBF")))
    np.testing.assert_allclose(degrees(layer.features[0])[0], [15.0, 0.0], atol=1e-9)
    assert layer.features[0].label == "n0"
    watched = {each.name for each in map_files(str(path))}
    assert watched >= {"roads.shp", "roads.shx", "roads.DBF", "roads.PRJ", "roads.cpg"}


def test_without_a_table(path):
    write_shapefile(path, "line", [[RING]])
    path.with_suffix(".dbf").unlink()
    (layer,) = load_layers(str(path))
    assert layer.features[0].label == ""
    assert layer.left_out == (f"{path}: has no .dbf: no labels",)


def zipped(folder, names):
    target = folder / "maps.zip"
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in names:
            for file in folder.glob(f"{name}.*"):
                archive.write(file, f"deep/{file.name}")
    return target


def test_zipped(tmp_path):
    write_shapefile(tmp_path / "roads.shp", "line", [[RING]])
    write_shapefile(tmp_path / "houses.shp", "poly", [[OUTER]], prj=UTM33_PRJ)
    write_shapefile(tmp_path / "houses.shp", "poly", [[OUTER]], ["Haus"])
    target = zipped(tmp_path, ["roads", "houses"])
    layers = load_layers(str(target))
    assert {layer.name: layer.features[0].label for layer in layers} == {
        "roads": "n0",
        "houses": "Haus",
    }


def multipatch(path):
    with shapefile.Writer(str(path.with_suffix(""))) as writer:
        writer.field("NAME")
        writer.multipatch([[(*point, 3.0) for point in RING]], [0])
        writer.record("n0")


def overlapping(path):
    write_shapefile(path, "line", [[RING, HOLE]])
    content = bytearray(path.read_bytes())
    struct.pack_into("<2i", content, 152, 4, 0)
    path.write_bytes(content)


def unknown(path):
    write_shapefile(path, "line", [[RING]])
    content = bytearray(path.read_bytes())
    struct.pack_into("<i", content, 108, 77)
    path.write_bytes(content)


def cut(path):
    write_shapefile(path, "line", [[RING]] * 3)
    path.write_bytes(path.read_bytes()[: 100 + 8 + 48 + 64])  # behind the first record


def looping(path):
    write_shapefile(path, "line", [[RING, HOLE]] * 3)
    content = bytearray(path.read_bytes())
    struct.pack_into(">i", content, 104, -4)  # words: back to its own head
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (multipatch, "feature 1 .n0.: a MultiPatch is not drawn; save it as outlines"),
        (overlapping, "feature 1 .n0.: it is damaged: its parts overlap"),
        (unknown, "unknown type 77|a damaged shapefile: 77"),
        (cut, "a damaged shapefile: 220 bytes, to be "),
        (looping, "a damaged shapefile: a record leads back to another"),
    ],
)
def test_what_is_not_drawn(path, spoil, message):
    spoil(path)
    with pytest.raises(MapError, match=message) as caught:
        load_layers(str(path))
    assert str(caught.value).startswith(f"{path}: ")
