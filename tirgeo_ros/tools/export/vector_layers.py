"""Define the layers of a flight's GeoPackage: columns with units, and how QGIS draws them."""

from __future__ import annotations

from tirgeo_ros.core.targets.target import KINDS
from tirgeo_ros.io.geopackage.layer_file import Layer
from tirgeo_ros.io.geopackage.qgis_style import area, by_value, line, marker, single
from tirgeo_ros.io.targets.properties import COLUMNS

_WHEN = {"stamp_ns": "INTEGER", "time": "DATETIME"}
_COLOURS = ("228,26,28,255", "255,127,0,255", "55,126,184,255", "0,170,200,255", "152,78,163,255")
_OTHER = "90,90,90,255"
_NAMED = """coalesce(nullif("name", ''), "number" || ' ' || "target_kind")"""

FOOTPRINTS = Layer(
    "footprints",
    "Polygon",
    {
        "picture": "INTEGER",  # its number in the flight, from 0
        **_WHEN,  # of the exposure
        "latitude_deg": "REAL",  # of the camera
        "longitude_deg": "REAL",
        "height_m": "REAL",  # ellipsoidal
        "above_ground_m": "REAL",
        "heading_deg": "REAL",  # of the view, from true north, clockwise
        "pitch_deg": "REAL",  # of the line of sight, 0 level, negative down
        "gsd_m": "REAL",  # ground that the middle pixel spans along its row
        "slant_range_m": "REAL",  # to the ground in the picture's middle
        "ce90_m": "REAL",  # of that ground point
        "le90_m": "REAL",
    },
    "what the pictures show of the ground, with where they were taken",
    single(area("255,170,0,0", "220,120,0,200", 0.3)),
)
TRACK = Layer(
    "track",
    "LineString Z",
    {"begin": "DATETIME", "end": "DATETIME", "points": "INTEGER", "length_m": "REAL"},
    "the aircraft's way, a line for each unbroken part; ellipsoidal heights",
    single(line("30,90,200,255", 0.6)),
)
TRACK_POINTS = Layer(
    "track_points",
    "Point Z",
    {
        "picture": "INTEGER",
        **_WHEN,
        "state": "TEXT",  # of the filter
        "height_m": "REAL",
        "speed_m_s": "REAL",  # in space, the mean since the point before
        "roll_deg": "REAL",  # of the aircraft
        "pitch_deg": "REAL",
        "heading_deg": "REAL",
        "sigma_north_m": "REAL",  # one standard deviation
        "sigma_east_m": "REAL",
        "sigma_height_m": "REAL",
        "sigma_heading_deg": "REAL",
    },
    "the aircraft, at its IMU, when pictures were taken; ellipsoidal heights",
    single(marker("arrow", "30,90,200,255", 3.0, angle_field="heading_deg")),
)
TARGETS = Layer(
    "targets",
    "Point",
    COLUMNS,
    "places, each the average of its clicks",
    by_value(
        "target_kind",
        {
            kind: marker("circle", colour, 3.4)
            for kind, colour in zip(KINDS, (*_COLOURS, _OTHER), strict=True)
        },
        label=_NAMED,
    ),
)
ELLIPSES = Layer(
    "ellipses",
    "Polygon",
    {"target": "TEXT", "number": "INTEGER", "name": "TEXT"},
    "95 % ellipses of the targets",
    single(area("228,26,28,30", "228,26,28,255", 0.4)),
)
