"""KML and KMZ: placemarks in folders, every geometry, what is left out, and traps."""

import zipfile

import numpy as np
import pytest
from map_files import HOLE, RING

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.maps import load_layers

HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2">'


@pytest.fixture
def path(tmp_path):
    return tmp_path / "site.kml"


def coordinates(points, end=""):
    return f"<coordinates>\n {' '.join(f'{x},{y}{end}' for x, y in points)}\n</coordinates>"


def mark(name, *geometries, more=""):
    inner = "".join(geometries)
    if len(geometries) > 1:
        inner = f"<MultiGeometry>{inner}</MultiGeometry>"
    return f"<Placemark><name>{name}</name>{more}{inner}</Placemark>"


def line(points=RING, end="", more=""):
    return f"<LineString>{more}{coordinates(points, end)}</LineString>"


def polygon():
    outer, inner = (f"<LinearRing>{coordinates(ring)}</LinearRing>" for ring in (RING, HOLE))
    return (
        f"<Polygon><outerBoundaryIs>{outer}</outerBoundaryIs>"
        f"<innerBoundaryIs>{inner}</innerBoundaryIs></Polygon>"
    )


def written(path, *content, head=HEAD):
    path.write_text(
        f"{head}<Document><name>all</name>{''.join(content)}</Document></kml>", "utf-8"
    )
    return str(path)


def degrees(feature):
    return np.degrees(feature.points[:, 1::-1])


def test_every_geometry(path):
    point = f"<Point>{coordinates(RING[:1], ',12.5')}</Point>"
    ring = f"<LinearRing>{coordinates(RING[:3])}</LinearRing>"
    text = written(path, mark("p", point), mark("Fläche &amp; 花", polygon(), line(), ring))
    (layer,) = load_layers(text)
    assert layer.name == "site"
    assert [(f.label, f.group, f.closed) for f in layer.features] == [
        ("p", 0, False),
        *[("Fläche & 花", 1, closed) for closed in (True, True, False, False)],
    ]
    wanted = [RING[:1], RING, HOLE, RING, [*RING[:3], RING[0]]]
    for feature, points in zip(layer.features, wanted, strict=True):
        np.testing.assert_allclose(degrees(feature), points, atol=1e-12)
        assert np.isnan(feature.points[:, 2]).all()


@pytest.mark.parametrize(
    "head",
    [
        "<kml>",
        '<kml xmlns="http://earth.google.com/kml/2.0">',
        '<?xml version="1.0"?><!-- by hand --><kml xmlns:x="http://www.opengis.net/kml/2.3">',
    ],
)
def test_every_version(path, head):
    assert len(load_layers(written(path, mark("a", line()), head=head))[0].features) == 1


def test_folders_are_layers_where_one_is_asked_for(path, tmp_path):
    inner = f"<Folder><name>wells</name>{mark('w', line(HOLE))}</Folder>"
    outer = f"<Folder><name>water</name>{mark('p', line())}{inner}</Folder>"
    text = written(path, outer, mark("road", line()))
    assert [f.label for f in load_layers(text)[0].features] == ["p", "w", "road"]
    sheet = tmp_path / "style.yaml"
    sheet.write_text("layers: [{layer: wells}, {layer: water, colour: red}]")
    wells, water = load_layers(text, str(sheet))
    assert [f.label for f in wells.features] == ["w"]
    assert [f.label for f in water.features] == ["p", "w"]
    assert (wells.name, water.style.line_bgr) == ("wells", (0, 0, 255))
    sheet.write_text("layers: [{layer: well}]")
    with pytest.raises(MapError, match=r"site.kml: there is no layer 'well' \(did you mean wells"):
        load_layers(text, str(sheet))


def test_data_as_labels(path):
    more = (
        '<ExtendedData><Data name="ref"><value>H7</value></Data><SchemaData>'
        '<SimpleData name="flow">96</SimpleData></SchemaData></ExtendedData>'
    )
    text = written(path, mark("a", line(), more=more))
    assert load_layers(text, "", "ref")[0].features[0].label == "H7"
    assert load_layers(text, "", "flow")[0].features[0].label == "96"


def test_what_is_left_out_is_told(path):
    model = "<Model><Location><longitude>16</longitude></Location></Model>"
    high = line(end=",7", more="<altitudeMode>absolute</altitudeMode>")
    low = line(end=",7", more="<altitudeMode>relativeToGround</altitudeMode>")
    link = "<NetworkLink><name>more</name></NetworkLink>"
    text = written(path, mark("m", model), mark("h", high), mark("l", low), link)
    (layer,) = load_layers(text)
    assert [f.label for f in layer.features] == ["h", "l"]
    assert sorted(layer.left_out) == [
        f"{path}: 1 LineString with heights above the sea: the heights left out",
        f"{path}: 1 Model left out",
        f"{path}: 1 NetworkLink left out",
    ]


TRACK = (
    "<gx:Track><when>2026-01-01T00:00:00Z</when><gx:coord>16 48 3</gx:coord>"
    "<when>2026-01-01T00:00:01Z</when><gx:coord> 16.5 48.25 </gx:coord><gx:coord/></gx:Track>"
)


def test_tracks_are_lines(path):
    several = f"<gx:MultiTrack><gx:interpolate>0</gx:interpolate>{TRACK * 2}</gx:MultiTrack>"
    short = "<gx:Track><gx:coord>16 48 3</gx:coord></gx:Track>"
    (layer,) = load_layers(written(path, mark("t", TRACK), mark("m", several), mark("s", short)))
    assert [(f.label, f.group) for f in layer.features] == [("t", 0), ("m", 1), ("m", 1)]
    for feature in layer.features:
        np.testing.assert_allclose(degrees(feature), [[16, 48], [16.5, 48.25]], atol=1e-12)
    assert layer.left_out == (
        f"{path}: feature 3 (s): a LineString of 1 positions is none; left out",
    )


@pytest.mark.parametrize(
    "text", ["16.0, 48.0, 3\n17.0 ,48.0,3", "16,48,3 17,48", "\t16.0,48.0\r\n\r\n17,48 "]
)
def test_coordinates_as_programs_write_them(path, text):
    shape = f"<LineString><coordinates>{text}</coordinates></LineString>"
    (feature,) = load_layers(written(path, mark("a", shape)))[0].features
    np.testing.assert_allclose(degrees(feature), [[16, 48], [17, 48]], atol=1e-12)


def test_a_placemark_without_a_geometry_is_told_of_and_data_may_name_one(path):
    data = '<ExtendedData><Data name="name"><value>said here</value></Data></ExtendedData>'
    text = written(path, mark("none"), mark("", line(), more=data))
    (layer,) = load_layers(text)
    assert [f.label for f in layer.features] == ["said here"]
    assert layer.left_out == (f"{path}: 1 features without a geometry left out",)


def test_a_kmz(tmp_path):
    path = tmp_path / "site.kmz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("files/other.kml", f"{HEAD}{mark('other', line())}</kml>")
        archive.writestr("doc.kml", f"{HEAD}{mark('main', line())}</kml>")
    (layer,) = load_layers(str(path))
    assert [f.label for f in layer.features] == ["main"]
    assert layer.left_out == (f"{path}: of 2 .kml in it doc.kml alone is read",)


BOMB = '<!DOCTYPE kml [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><kml>&b;</kml>'
BAD = {
    "entities": (BOMB, "no KML that can be read: it declares entities of its own"),
    "external": ('<!DOCTYPE kml [<!ENTITY a SYSTEM "file:///etc/passwd">]><kml/>', "entities"),
    "deep": ("<kml>" + "<Folder>" * 10_000, "it is nested too deeply"),
    "cut": (f"{HEAD}{mark('a', line())}", "no KML that can be read: no element found"),
    "no KML": ("<svg>kml</svg>", "XML, but not KML: it begins with svg"),
    "words": (
        f"<kml>{mark('a', line(end=',x'))}</kml>",
        "feature 1 .a.: .* no coord",
    ),
    "one number": (
        "<kml><Placemark><Point><coordinates>16</coordinates></Point></Placemark></kml>",
        "feature 1: '16' are no coordinates",
    ),
    "underscore": (
        f"<kml>{mark('a', line(end='_1'))}</kml>",
        "feature 1 .a.: .* are no coordinates",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_wrong_is_said(path, case):
    content, message = BAD[case]
    path.write_text(content)
    with pytest.raises(MapError, match=message) as caught:
        load_layers(str(path))
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_a_bomb_in_a_kmz_is_not_unpacked(tmp_path):
    path = tmp_path / "bomb.kmz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", "<kml>" + " " * (1 << 25))
    with pytest.raises(MapError, match=r"doc.kml in the zip would unpack to 33554437 bytes"):
        load_layers(str(path))
