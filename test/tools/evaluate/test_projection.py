"""The projected plane: zones, names, scale, and the axes at a place."""

from __future__ import annotations

import math

import numpy as np
import pyproj
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.frames.wgs84 import radii_of_curvature
from tirgeo_ros.core.types.errors import SurveyError
from tirgeo_ros.tools.evaluate.projection import projection_of

KINDS = ("gauss-krueger", "utm")


def at(kind, latitude_deg, longitude_deg):
    return projection_of(kind, np.radians([latitude_deg]), np.radians([longitude_deg]))


@pytest.mark.parametrize(
    ("longitude_deg", "meridian_deg", "named"),
    [
        (115.4, 114, "114 deg E"),
        (115.6, 117, "117 deg E"),
        (-71.2, -72, "72 deg W"),
        (-179.9, -180, "180 deg W"),
    ],
)
def test_gauss_krueger_has_the_nearest_meridian(longitude_deg, meridian_deg, named):
    found = at("gauss-krueger", 40, longitude_deg)
    assert named in found.name
    east_m, north_m = found.project(math.radians(40), math.radians(meridian_deg))
    assert east_m == pytest.approx(500e3, abs=1e-6)
    # the meridian's arc from the equator to 40 deg, by PROJ's geodesics
    _, _, arc_m = pyproj.Geod(ellps="WGS84").inv(0, 0, 0, 40)
    assert north_m == pytest.approx(arc_m, abs=1e-3)


@pytest.mark.parametrize(
    ("latitude_deg", "longitude_deg", "code"),
    [(39.85, 116.7, 32650), (-33.9, 151.2, 32756), (0.1, -179.99, 32601), (10, 180.0, 32601)],
)
def test_utm_is_that_of_epsg(latitude_deg, longitude_deg, code):
    found = at("utm", latitude_deg, longitude_deg)
    assert str(code) in found.name
    transform = pyproj.Transformer.from_crs(4326, code, always_xy=True)
    expected = transform.transform(longitude_deg, latitude_deg)
    place = found.project(math.radians(latitude_deg), math.radians(longitude_deg))
    np.testing.assert_allclose(place, expected, atol=1e-4)  # PROJ's own inverse is that good


@given(
    st.sampled_from(KINDS),
    st.floats(-80, 80),
    st.floats(-179.9, 179.9),
    st.floats(-1.4, 1.4),
)
def test_local_axes_are_the_derivative(kind, latitude_deg, longitude_deg, off_deg):
    plane = at(kind, latitude_deg, longitude_deg)
    lat, lon = math.radians(latitude_deg), math.radians(longitude_deg + off_deg)
    meridional_m, transverse_m = radii_of_curvature(lat)
    step_m = 10.0
    steps = [(step_m / meridional_m, 0.0), (0.0, step_m / (transverse_m * math.cos(lat)))]
    slopes = [
        (plane.project(lat + a, lon + b) - plane.project(lat - a, lon - b)) / (2 * step_m)
        for a, b in steps
    ]
    # coordinates of up to 1e7 m carry 2e-9 m each, 2e-10 of the step; PROJ takes convergence and
    # scale from differences over 1e-5 rad, whose own error is of second order: some 1e-10
    np.testing.assert_allclose(plane.local_axes(lat, lon), np.stack(slopes, -1), atol=1e-8)


def test_a_survey_across_the_date_line_and_at_a_pole():
    latitudes, longitudes = np.radians([-17.0, -17.0]), np.radians([179.99, -179.98])
    found = projection_of("gauss-krueger", latitudes, longitudes)
    # 0.03 deg at 17 deg south
    assert np.ptp(found.project(latitudes, longitudes)[:, 0]) == pytest.approx(3196, rel=1e-2)
    with pytest.raises(SurveyError, match=r"latitude 85\.0: no transverse Mercator zone"):
        at("utm", 85, 20)
