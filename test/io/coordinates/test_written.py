"""Places as texts: read back they are where they were, also at the edges of zones."""

from __future__ import annotations

import math
import re
from concurrent.futures import ThreadPoolExecutor

import mgrs
import numpy as np
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.io.coordinates.crs import written

GEOD = pyproj.Geod(ellps="WGS84")
DMS = re.compile(r"(\d+)°(\d\d)'(\d\d\.\d\d)\"([NS]) (\d+)°(\d\d)'(\d\d\.\d\d)\"([EW])")
places = st.tuples(st.floats(-90, 90), st.floats(-180, 180))
utm_places = st.tuples(st.floats(-79.99, 83.99), st.floats(-180, 180))


def apart_m(one, other):
    return GEOD.inv(one[1], one[0], other[1], other[0])[2]


def from_dms(text):
    parts = DMS.fullmatch(text).groups()
    for degrees, minutes, seconds, side in (parts[:4], parts[4:]):
        assert int(minutes) < 60
        assert float(seconds) < 60
        value = int(degrees) + int(minutes) / 60 + float(seconds) / 3600
        yield -value if side in "SW" else value


@given(places)
def test_decimal_degrees_read_back(place):
    read = tuple(float(word) for word in written(*place).decimal.split(", "))
    np.testing.assert_allclose(read, place, rtol=0, atol=0.5001e-6)


@given(places)
def test_degrees_minutes_seconds_read_back(place):
    # half of a hundredth of a second
    read = list(from_dms(written(*place).dms))
    np.testing.assert_allclose(read, place, rtol=0, atol=0.5001 * 0.01 / 3600)


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
def test_utm_reads_back_in_the_zone_of_the_square(place):
    texts = written(*place)
    zone, easting, northing = texts.utm.split()
    assert texts.mgrs.startswith(zone)
    code = (32600 if zone[2] >= "N" else 32700) + int(zone[:2])
    way = pyproj.Transformer.from_crs(f"EPSG:{code}", "EPSG:4326", always_xy=True)
    longitude, latitude = way.transform(float(easting), float(northing))
    # half of a decimetre in both
    assert apart_m(place, (latitude, longitude)) <= 0.08


@given(utm_places)
def test_the_digits_of_the_square_are_those_of_utm_cut(place):
    texts = written(*place)
    _, easting, northing = texts.utm.split()
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
    ],
)
def test_known_places(place, square, utm):
    texts = written(*place)
    assert texts.mgrs.startswith(square)
    assert texts.utm.startswith(utm)


@pytest.mark.parametrize(
    ("latitude", "square"),
    [(90.0, "Z AH 00000 00000"), (85.0, "Z "), (-85.0, "B "), (-90.0, "B ")],
)
def test_near_the_poles_there_is_no_utm(latitude, square):
    texts = written(latitude, 10.0)
    assert texts.utm == ""
    assert texts.mgrs.startswith(square)


def test_threads_do_not_mix_their_zones():
    """The library has globals in C."""
    some = [(60.0 - k % 97, -170.0 + 3.4 * (k % 100)) for k in range(400)]
    expected = [written(*place) for place in some]
    with ThreadPoolExecutor(8) as pool:
        assert list(pool.map(lambda place: written(*place), some)) == expected
