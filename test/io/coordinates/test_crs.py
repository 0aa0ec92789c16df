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
"""Coordinate reference systems: axes, datums, heights, what is not known; and places as texts."""

from __future__ import annotations

import json
import math
import re
from concurrent.futures import ThreadPoolExecutor

import mgrs
import numpy as np
import pyproj
import pytest
from hypothesis import given, strategies as st
from map_files import UTM33_PRJ

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.coordinates.crs import to_wgs84, written
from tirgeo_ros.io.maps import load_layers

NAN = float("nan")


def transformed(name, *points):
    return to_wgs84(np.array(points, float), name, "a.map")


@pytest.mark.parametrize("name", ["EPSG:32633", UTM33_PRJ, "+proj=utm +zone=33 +datum=WGS84"])
def test_codes_wkt_and_proj(name):
    points, remarks = transformed(name, [500000.0, 0.0, 3.5])
    np.testing.assert_allclose(points, [[15.0, 0.0, 3.5]], atol=1e-9)
    assert remarks == ()


def test_x_comes_first_whatever_the_system_says():
    """EPSG:31468 is northing before easting, EPSG:4326 latitude before longitude."""
    for name, point in (("EPSG:31468", [4500000.0, 5400000.0]), ("EPSG:4326", [12.0, 48.7])):
        points, _ = transformed(name, [*point, NAN])
        np.testing.assert_allclose(points[0, :2], [12.0, 48.7], atol=0.1)


# Coefficients of EPSG's coordinate operation 1314 (OSGB36 to WGS84), position vector.
OSGB36 = (446.448, -125.157, 542.06, 0.15, 0.247, 0.842, -20.489)


def test_a_shift_of_datum_and_how_well_it_is_known():
    """Airy's ellipsoid by seven parameters, against the arithmetic written out here."""
    text = "+proj=longlat +ellps=airy +towgs84=" + ",".join(map(str, OSGB36)) + " +type=crs"
    points, _ = transformed(text, [-1.5, 52.5, NAN])
    a, b = 6377563.396, 6356256.909
    e2 = 1 - (b / a) ** 2
    lon, lat = np.radians([-1.5, 52.5])
    radius = a / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    ecef = radius * np.array(
        [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), (1 - e2) * np.sin(lat)]
    )
    rx, ry, rz = np.radians(np.array(OSGB36[3:6]) / 3600)
    turn = np.array([[1, -rz, ry], [rz, 1, -rx], [-ry, rx, 1]])
    moved = np.array(OSGB36[:3]) + (1 + OSGB36[6] * 1e-6) * turn @ ecef
    to_geodetic = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
    wanted = to_geodetic.transform(*moved)
    # 1e-9 deg is 0.1 mm; PROJ's turn is the exact one, 1e-11 of the radius beside this.
    np.testing.assert_allclose(points[0, :2], wanted[:2], atol=2e-9)
    _, remarks = transformed("EPSG:27700", [400000.0, 300000.0, NAN])
    assert "from OSGB36 / British National Grid to WGS84 is known only to" in remarks[0]


def test_a_datum_that_is_not_known():
    points, remarks = transformed("+proj=utm +zone=33 +ellps=GRS80", [500000.0, 0.0, NAN])
    np.testing.assert_allclose(points[0, :2], [15.0, 0.0], atol=1e-9)
    assert "names no datum: taken as WGS84: within 2 m for a modern datum" in remarks[0]
    for name in ("+proj=utm +zone=33 +ellps=bessel", "+proj=longlat +ellps=bessel", "EPSG:4610"):
        with pytest.raises(
            MapError, match=r"a.map: the transformation from the datum of .* give its EPSG code or"
        ):
            transformed(name, [50.0, 0.0, NAN])


PLATES = {
    "CGCS2000": (4490, 4480, 4547),
    "GDA2020": (7844, 7856),
    "NAD83(2011)": (6318, 6345),
    "JGD2011": (6668, 6677),
    "ETRS89": (4258, 25832),
}


@pytest.mark.parametrize("datum", PLATES)
@pytest.mark.parametrize("form", ["code", "WKT1_ESRI", "WKT1_GDAL", "WKT2_2019"])
def test_a_datum_that_is_named_is_not_remarked_upon(datum, form):
    """Whether a code names it, or the text alone, as a .prj does."""
    for code in PLATES[datum]:
        name = f"EPSG:{code}"
        if form != "code":
            if code == 4480:
                continue  # a system of three axes has no WKT of the first kind
            text = pyproj.CRS(name).to_wkt(form)
            name = re.sub(r',\s*(AUTHORITY|ID)\["EPSG",\s*"?\d+"?\]', "", text)
            assert "EPSG" not in name
        assert transformed(name, [100.0, 40.0, NAN])[1] == (), name


GEOGCS = (
    'GEOGCS["site",DATUM["{}",SPHEROID["GRS 1980",6378137.0,298.257222101]],'
    'PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]]'
)


@pytest.mark.parametrize(
    ("datum", "remark"),
    [
        ("WGS84", ""),
        ("D_WGS_1984", ""),
        ("D_China_2000", ""),
        ("Unknown based on WGS 84 ellipsoid", "site names no datum: taken as WGS84"),
        ("Not_specified_based_on_GRS_1980_ellipsoid", "site names no datum: taken as WGS84"),
        ("my mine", "a.map: the datum 'my mine' of site is not known: taken as WGS84"),
    ],
)
def test_names_of_datums_without_a_code(datum, remark):
    _, remarks = transformed(GEOGCS.format(datum), [16.0, 48.0, NAN])
    assert len(remarks) == bool(remark)
    assert remark in "".join(remarks)


def test_a_line_across_the_antimeridian_stays_short(tmp_path):
    """UTM 60 goes on beyond 180 deg; the line is 20 km long there and on the tangent plane."""
    path = tmp_path / "a.geojson"
    line = [[823000.0 + x, 0.0] for x in (0.0, 10e3, 20e3)]
    crs = {"type": "name", "properties": {"name": "EPSG:32660"}}
    path.write_text(json.dumps({"type": "LineString", "coordinates": line, "crs": crs}))
    (feature,) = load_layers(str(path))[0].features
    lons = np.degrees(feature.points[:, 1])
    assert lons[0] > 179
    assert lons[-1] < -179
    plane = TangentPlane(*feature.points[1, :2], 0.0)
    ned = plane.ned_from_geodetic(feature.points[:, 0], feature.points[:, 1], np.zeros(3))
    # 0.9996 at the central meridian grows by (x / R)^2 / 2, 0.13 %, so far from it.
    assert np.hypot(*np.diff(ned[[0, -1], :2], axis=0)[0]) == pytest.approx(20e3, rel=2e-3)


GEOD = pyproj.Geod(ellps="WGS84")
DMS = re.compile(r"(\d+)°(\d\d)'(\d\d\.\d\d)\"([NS]) (\d+)°(\d\d)'(\d\d\.\d\d)\"([EW])")
places = st.tuples(st.floats(-90, 90), st.floats(-180, 180))
utm_places = st.tuples(st.floats(-79.99, 83.99), st.floats(-180, 180))


def apart_m(item, other):
    return GEOD.inv(item[1], item[0], other[1], other[0])[2]


def from_dms(text):
    parts = DMS.fullmatch(text).groups()
    for degrees, minutes, seconds, side in (parts[:4], parts[4:]):
        assert int(minutes) < 60
        assert float(seconds) < 60
        value = int(degrees) + int(minutes) / 60 + float(seconds) / 3600
        yield -value if side in "SW" else value


@given(places)
def test_degrees_read_back(place):
    texts = written(*place)
    decimal = tuple(float(word) for word in texts.decimal.split(", "))
    np.testing.assert_allclose(decimal, place, rtol=0, atol=0.5001e-6)
    # half of a hundredth of a second
    np.testing.assert_allclose(list(from_dms(texts.dms)), place, rtol=0, atol=0.005001 / 3600)


@pytest.mark.parametrize("degrees", [9.9999999, 47 + 59 / 60 + 59.996 / 3600, 0.99999999])
def test_rounding_never_gives_60_seconds(degrees):
    text = written(degrees, -degrees).dms
    whole = math.ceil(degrees)
    assert text == f"{whole}°00'00.00\"N {whole}°00'00.00\"W"


@given(places)
def test_the_place_is_in_its_square(place):
    """The library gives a corner for a square: a metre to the north and east at most."""
    back = mgrs.MGRS().toLatLon(written(*place).mgrs.replace(" ", ""))
    # half of the diagonal from the middle, or all of it from the corner, and rounding
    assert apart_m(place, back) <= math.sqrt(2) + 0.01


@given(utm_places)
def test_utm_reads_back_in_the_zone_and_with_the_digits_of_the_square(place):
    texts = written(*place)
    zone, easting, northing = texts.utm.split()
    assert texts.mgrs.startswith(zone)
    code = (32600 if zone[2] >= "N" else 32700) + int(zone[:2])
    way = pyproj.Transformer.from_crs(f"EPSG:{code}", "EPSG:4326", always_xy=True)
    longitude, latitude = way.transform(float(easting), float(northing))
    # half of a decimetre in both
    assert apart_m(place, (latitude, longitude)) <= 0.08
    _, _, *digits = texts.mgrs.split()
    for metres, five in zip((easting, northing), digits, strict=True):
        # UTM is rounded to a decimetre, which at the edge of a square can be the next one
        past = (float(metres) - int(five)) % 100_000
        assert min(past, 100_000 - past) <= 1.051


@pytest.mark.parametrize(
    ("place", "square", "utm"),
    [
        ((48.2081743, 16.3738189), "33U XP 02066 40350", "33U 602066.7 5340350.8"),
        ((60.39, 5.32), "32V KN 97230 00510", "32V "),  # Norway: not zone 31
        ((78.2, 8.9), "31X ", "31X "),  # Svalbard: zones 31, 33, 35, 37
        ((78.2, 9.1), "33X ", "33X "),
        ((78.2, 20.9), "33X ", "33X "),
        ((78.2, 21.1), "35X ", "35X "),
        ((78.2, 33.1), "37X ", "37X "),
        ((5.0, -3.0), "30N WL 00000 ", "30N 500000.0 "),
        ((-33.86, 151.21), "56H ", "56H "),
        ((0.0, 180.0), "01N ", "01N "),
        ((0.0, -180.0), "01N ", "01N "),
        ((90.0, 10.0), "Z AH 00000 00000", ""),  # near the poles there is no UTM
        ((85.0, 10.0), "Z ", ""),
        ((-85.0, 10.0), "B ", ""),
        ((-90.0, 10.0), "B ", ""),
    ],
)
def test_known_places(place, square, utm):
    texts = written(*place)
    assert texts.mgrs.startswith(square)
    assert texts.utm.startswith(utm)
    assert utm or not texts.utm


def test_threads_do_not_mix_their_zones():
    """The library has globals in C."""
    some = [(60.0 - k % 97, -170.0 + 3.4 * (k % 100)) for k in range(400)]
    expected = [written(*place) for place in some]
    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(lambda place: written(*place), some)) == expected
