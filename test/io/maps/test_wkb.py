"""Well-known binary: every geometry in every byte order and number of dimensions."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from map_files import HOLE, RING, WKB_TYPES, wkb

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.maps.wkb import wkb_parts

SHAPES = {
    "Point": (RING[0], [("Point", [RING[0]])]),
    "MultiPoint": (RING[:2], [("Point", [RING[0]]), ("Point", [RING[1]])]),
    "LineString": (RING, [("LineString", RING)]),
    "MultiLineString": ([RING, HOLE], [("LineString", RING), ("LineString", HOLE)]),
    "Polygon": ([RING, HOLE], [("Polygon", RING), ("Polygon", HOLE)]),
    "MultiPolygon": ([[RING, HOLE], [RING]], [("Polygon", r) for r in (RING, HOLE, RING)]),
    "GeometryCollection": (
        [("Point", RING[1]), ("GeometryCollection", [("LineString", HOLE)])],
        [("Point", [RING[1]]), ("LineString", HOLE)],
    ),
}


def parts(data, start=0):
    return list(wkb_parts(data, start))


def with_more(coordinates, more):
    """The coordinates with more numbers in each position."""
    if isinstance(coordinates, tuple) and isinstance(coordinates[0], float):
        return (*coordinates, *more)
    if isinstance(coordinates, tuple):
        return (coordinates[0], with_more(coordinates[1], more))
    return [with_more(each, more) for each in coordinates]


@pytest.mark.parametrize("kind", SHAPES)
@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("dims", ["", "Z", "M", "ZM"])
@pytest.mark.parametrize("ewkb", [False, True])
def test_every_geometry(kind, order, dims, ewkb):
    coordinates, wanted = SHAPES[kind]
    more = {"": (), "Z": (170.5,), "M": (9.0,), "ZM": (170.5, 9.0)}[dims]
    data = wkb(kind, with_more(coordinates, more), order, dims, ewkb, srid=4326)
    got = parts(b"head" + data, 4)
    assert [each for each, _ in got] == [each for each, _ in wanted]
    for (_, points), (_, plain) in zip(got, wanted, strict=True):
        np.testing.assert_array_equal(points[:, :2], plain)
        assert points.shape[1] == (3 if "Z" in dims else 2)
        assert (points[:, 2:] == 170.5).all()


def test_a_surface_of_faces_is_polygons():
    faces = wkb("MultiPolygon", [[RING], [HOLE]])
    for code in (15, 16):  # polyhedral surface, TIN
        assert len(parts(faces[:1] + struct.pack("<I", code) + faces[5:])) == 2
    triangle = wkb("Polygon", [RING])
    assert parts(triangle[:1] + struct.pack("<I", 17) + triangle[5:])[0][0] == "Polygon"


@pytest.mark.parametrize("kind", WKB_TYPES)
def test_an_empty_geometry_has_no_parts(kind):
    empty = [] if kind != "Point" else (math.nan, math.nan)
    assert sum(len(points) for _, points in parts(wkb(kind, empty))) == 0


def holding(code, *members):
    return struct.pack("<BII", 1, code, len(members)) + b"".join(members)


def test_containers_for_curves_that_hold_straight_lines():
    """As databases write them whose columns may hold arcs."""
    first, rest = wkb("LineString", RING[:3]), wkb("LineString", RING[2:])
    (curve,) = parts(holding(9, first, rest))
    assert curve[0] == "LineString"
    np.testing.assert_array_equal(curve[1], [*RING[:3], *RING[2:]])
    rings = parts(holding(10, holding(9, first, rest), wkb("LineString", HOLE)))
    assert [kind for kind, _ in rings] == ["Polygon", "Polygon"]
    np.testing.assert_array_equal(rings[1][1], HOLE)
    assert [kind for kind, _ in parts(holding(11, first, rest))] == ["LineString"] * 2
    surfaces = parts(holding(12, wkb("Polygon", [RING]), holding(10, wkb("LineString", HOLE))))
    assert [kind for kind, _ in surfaces] == ["Polygon", "Polygon"]
    with_z = wkb("LineString", [(*point, 5.0) for point in RING], dims="Z")
    np.testing.assert_array_equal(parts(holding(1009, with_z))[0][1][:, 2], 5)
    assert len(parts(holding(9))[0][1]) == 0


@pytest.mark.parametrize("code", [None, 9, 1010, 11, 12])
def test_arcs_are_refused_by_name(code):
    arc = struct.pack("<BII", 1, 8, 3) + struct.pack("<6d", *RING[0], *RING[1], *RING[2])
    with pytest.raises(MapError, match=r"^a CircularString has arcs; save it as lines"):
        parts(arc if code is None else holding(code, arc))


BAD = {
    "nothing": (b"", "no byte order"),
    "byte order": (b"\7" + wkb("Point", RING[0])[1:], "no byte order"),
    "type": (struct.pack("<BII", 1, 99, 0), "unknown type 99"),
    "thousands": (struct.pack("<BII", 1, 7001, 0), "unknown type 7001"),
    "short head": (b"\1\1", "ends too early"),
    "short point": (wkb("Point", RING[0])[:-1], "ends too early"),
    "short line": (wkb("LineString", RING)[:-1], "ends before the 4 parts"),
    "many points": (struct.pack("<BII", 1, 2, 0xFFFFFFFF), "before the 4294967295 parts"),
    "many rings": (struct.pack("<BII", 1, 3, 0xFFFFFFFF), "before the 4294967295 parts"),
    "many members": (struct.pack("<BII", 1, 7, 0xFFFFFFFF), "before the 4294967295 parts"),
    "deep": (struct.pack("<BII", 1, 7, 1) * 1000 + wkb("Point", RING[0]), "nested too deeply"),
}


@pytest.mark.parametrize("case", BAD)
def test_damage_is_said(case):
    data, message = BAD[case]
    with pytest.raises(MapError, match=message):
        parts(data)


@given(
    kind=st.sampled_from(list(SHAPES)),
    flips=st.lists(st.tuples(st.integers(0, 200), st.integers(1, 255)), min_size=1, max_size=4),
    end=st.integers(0, 300),
)
def test_any_damage_is_a_map_error_or_parts_no_larger_than_the_data(kind, flips, end):
    data = bytearray(wkb(kind, SHAPES[kind][0]))
    for at, bits in flips:
        data[at % len(data)] ^= bits
    try:
        got = parts(bytes(data[:end]))
    except MapError as error:
        assert "\n" not in str(error)  # noqa: PT017  # either outcome is right
    else:
        assert sum(points.nbytes for _, points in got) <= len(data)
