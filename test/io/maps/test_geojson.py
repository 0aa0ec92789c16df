"""Maps from GeoJSON: every geometry, other reference systems, and all that is no map."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.maps import load_layers

RING = [[16.0, 48.0], [16.001, 48.0], [16.001, 48.001], [16.0, 48.0]]
HOLE = [[16.0003, 48.0003], [16.0006, 48.0003], [16.0006, 48.0006], [16.0003, 48.0003]]


@pytest.fixture
def written(tmp_path):
    def write(content):
        path = tmp_path / "map.geojson"
        path.write_text(content if isinstance(content, str) else json.dumps(content), "utf-8")
        return path

    return write


def load_map(path, label_field="name"):
    (layer,) = load_layers(str(path), "", label_field)
    return layer.features


def collection(*geometries, properties=None, **members):
    features = [
        {"type": "Feature", "properties": properties, "geometry": geometry}
        for geometry in geometries
    ]
    return {"type": "FeatureCollection", "features": features, **members}


def geometry(kind, coordinates):
    return {"type": kind, "coordinates": coordinates}


def degrees(feature):
    return np.degrees(feature.points[:, 1::-1])


SHAPES = {
    "Point": (RING[0], [([RING[0]], False)]),
    "MultiPoint": (RING[:2], [([RING[0]], False), ([RING[1]], False)]),
    "LineString": (RING, [(RING, False)]),
    "MultiLineString": ([RING, HOLE], [(RING, False), (HOLE, False)]),
    "Polygon": ([RING, HOLE], [(RING, True), (HOLE, True)]),
    "MultiPolygon": ([[RING], [HOLE]], [(RING, True), (HOLE, True)]),
}


@pytest.mark.parametrize("kind", SHAPES)
@pytest.mark.parametrize("wrap", ["geometry", "feature", "collection", "geometries"])
def test_every_geometry(written, kind, wrap):
    coordinates, wanted = SHAPES[kind]
    shape = geometry(kind, coordinates)
    root = {
        "geometry": shape,
        "feature": {"type": "Feature", "properties": {}, "geometry": shape},
        "collection": collection(shape),
        "geometries": collection({"type": "GeometryCollection", "geometries": [shape]}),
    }[wrap]
    features = load_map(written(root))
    assert [f.closed for f in features] == [closed for _, closed in wanted]
    assert {f.group for f in features} == {0}
    for got, (points, _) in zip(features, wanted, strict=True):
        np.testing.assert_allclose(degrees(got), points, rtol=0, atol=1e-12)
        assert np.isnan(got.points[:, 2]).all()


@pytest.mark.parametrize(
    ("properties", "field", "label"),
    [
        ({"name": " Grünfläche 花坛 "}, "name", "Grünfläche 花坛"),
        ({"name": 7}, "name", "7"),
        ({"name": None}, "name", ""),
        ({"name": "a", "id": "b"}, "id", "b"),
        ({}, "name", ""),
        (None, "name", ""),
    ],
)
def test_labels(written, properties, field, label):
    root = collection(geometry("Point", RING[0]), properties=properties)
    assert load_map(written(root), field)[0].label == label


@pytest.mark.parametrize("name", ["urn:ogc:def:crs:OGC:1.3:CRS84", "urn:ogc:def:crs:EPSG::4326"])
def test_longitude_comes_first_in_every_crs(written, name):
    crs = {"type": "name", "properties": {"name": name}}
    feature = load_map(written(collection(geometry("Point", [16.0, 48.0]), crs=crs)))[0]
    np.testing.assert_allclose(degrees(feature), [[16.0, 48.0]], atol=1e-9)


def line(*positions):
    return collection(geometry("LineString", list(positions)))


BAD = {
    "deep": ("[" * 100_000, "not JSON"),
    "a list": ([1, 2], "JSON, but not GeoJSON"),
    "other": ({"type": "Topologie"}, "JSON, but not GeoJSON"),
    "no features": ({"type": "FeatureCollection"}, "no list of features"),
    "not a feature": (
        {"type": "FeatureCollection", "features": [3]},
        "feature 1: it is not a GeoJSON",
    ),
    "unknown shape": (collection(geometry("Circle", [1, 2])), "feature 1: its geometry is none"),
    "odd shape": (collection({"type": {}}), "feature 1: its geometry is none"),
    "nesting": (
        collection(geometry("Polygon", [[16, 48], [17, 48]])),
        "feature 1: 16 is not a pos",
    ),
    "numbers": (collection(geometry("Polygon", [16, 48])), "feature 1: .* not nested"),
    "text": (line(["16", "48"], [1, 2]), "is not a position of two or three numbers"),
    "one number": (line([16], [1, 2]), "is not a position"),
    "nan": ('{"type": "LineString", "coordinates": [[NaN, 1], [2, 3]]}', "is not finite"),
    "infinite": ('{"type": "Point", "coordinates": [1, 2, Infinity]}', "is not finite"),
    "huge": (line([10**400, 1], [2, 3]), "is not finite"),
    "flat ring": (collection(geometry("Polygon", [RING[:2]])), "a Polygon of 2 positions is none"),
    "heights alone": (
        collection(geometry("Point", [1, 2]), crs={"properties": {"name": "EPSG:5773"}}),
        "'EPSG:5773' is a Vertical CRS, and a map needs",
    ),
    "odd crs": (
        collection(geometry("Point", [1, 2]), crs=4326),
        "unknown coordinate reference system 'crs member 4326'; save the map in WGS84",
    ),
    "off the crs": (
        collection(geometry("Point", [1e9, 1e9]), crs={"properties": {"name": "EPSG:32633"}}),
        "is not a longitude",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_no_map_is_said_in_one_line_that_names_the_file(written, case):
    content, message = BAD[case]
    path = written(content)
    with pytest.raises(MapError, match=message) as caught:
        load_map(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_the_few_that_happen_to_lie_on_the_earth_are_not_drawn_where_most_do_not(written):
    """A plane of metres has some places that could be degrees."""
    points = [[16.0, 48.0], [316.0, 148.0], [916.0, 48.0], [-500.0, 2.0]]
    path = written(collection(*(geometry("Point", point) for point in points)))
    with pytest.raises(MapError, match=r"feature 2: \(316, 148\) is not a .* \(none of 4 fea"):
        load_map(path)
    path = written(collection(*(geometry("Point", point) for point in points[:2])))
    (layer,) = load_layers(str(path))
    assert [f.group for f in layer.features] == [0]  # no more than half
    (note,) = layer.left_out
    assert note.endswith("feature 2: (316, 148) is not a longitude and a latitude; left out")


@pytest.mark.parametrize("bad", ["nesting", "no ring", "text", "position", "half", "short"])
def test_the_rest_of_a_file_is_where_it_was(written, bad):
    """One feature that is bad in any way changes neither place nor number of the others."""
    wrong = {
        "nesting": geometry("Polygon", RING),
        "no ring": geometry("Polygon", [[]]),
        "text": geometry("LineString", [["16", "48"], ["17", "48"]]),
        "position": geometry("LineString", [[16.0], [17.0]]),
        "half": geometry("MultiLineString", [RING, [[16.0], [17.0]]]),
        "short": geometry("MultiLineString", [RING[:1], RING]),
    }[bad]
    good = [geometry("Polygon", [RING, HOLE]), geometry("LineString", [[16, 48, 3], [17, 48]])]
    wanted = load_map(written(collection(good[0], None, good[1])))
    features = load_map(written(collection(good[0], wrong, good[1])))
    if bad == "short":  # its other line is drawn
        part = features.pop(2)
        np.testing.assert_allclose(degrees(part), RING, rtol=0, atol=1e-12)
        assert part.group == 1
    assert [(f.group, f.closed) for f in features] == [(f.group, f.closed) for f in wanted]
    for one, other in zip(features, wanted, strict=True):
        np.testing.assert_array_equal(one.points, other.points)


def test_an_id_is_a_property(written):
    feature = {"type": "Feature", "id": "w7", "geometry": geometry("Point", RING[0])}
    assert load_map(written(feature), "id")[0].label == "w7"


def test_no_file_and_a_folder(tmp_path):
    with pytest.raises(MapError, match="there is no such map"):
        load_map(tmp_path / "absent.geojson")
    with pytest.raises(MapError, match="cannot be read: Is a directory"):
        load_map(tmp_path)


JUNK = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=5)
    | st.sampled_from(["Feature", "Polygon", "GeometryCollection", "LineString"]),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(
                ["type", "coordinates", "geometry", "geometries", "properties", "crs"]
            ),
            inner,
        )
    ),
    max_leaves=12,
)


@pytest.mark.slow
@given(kind=st.sampled_from([*SHAPES, "GeometryCollection"]), junk=JUNK)
def test_any_junk_is_a_map_error_or_a_map(tmp_path_factory, kind, junk):
    path = tmp_path_factory.mktemp("junk") / "map.geojson"
    path.write_text(
        json.dumps(collection({"type": kind, "coordinates": junk, "geometries": junk}))
    )
    try:
        features = load_map(path)
    except MapError as error:
        assert str(error).startswith(str(path))  # noqa: PT017  # either outcome is right
    else:
        assert all(np.isfinite(f.points[:, :2]).all() for f in features)
