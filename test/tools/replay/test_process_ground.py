"""tirgeo process: clicks in a bag, an elevation model under the map, a heading that was set."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flights import flight
from process_bags import messages_of, write_hover

from tirgeo_ros.core.config import EkfConfig, OverlayConfig
from tirgeo_ros.core.frames.rotations import heading_of, wrapped
from tirgeo_ros.core.types.measurements import SetHeading
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, BagWriter, Cdr
from tirgeo_ros.io.messages import TOPIC_TYPES, body_pose, ground_point
from tirgeo_ros.io.parameters.parameter_file import load_config
from tirgeo_ros.tools.replay.process import process

CDR = Cdr()
CUT_S = 4.0  # alignment takes one second of it
IMAGES, PIXEL = "/thermal/image_raw/compressed", "/tirgeo/locate/pixel"
UV = (320.0, 300.0)


def click(stamp_ns):
    kind, header = CDR.types(TOPIC_TYPES["tirgeo/locate/pixel"]), CDR.types("std_msgs/msg/Header")
    time, point = (
        CDR.types("builtin_interfaces/msg/Time"),
        CDR.types("geometry_msgs/msg/Point"),
    )
    stamp = time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return kind(header=header(stamp=stamp, frame_id=""), point=point(x=UV[0], y=UV[1], z=0.0))


@pytest.fixture(scope="module")
def clicked(sample, tmp_path_factory):
    """The sample's first seconds with a click on its 20th picture, and that picture's stamp."""
    path = tmp_path_factory.mktemp("clicked") / "flight.mcap"
    reader = BagReader(sample / "flight.mcap")
    start_ns, stamps = reader.span_ns[0], []
    with BagWriter(path) as writer:
        for item in reader.messages():
            if item.log_time_ns > start_ns + CUT_S * 1e9:
                break
            writer.write(item.topic, item.typename, item.data, item.log_time_ns)
            if item.topic == IMAGES:
                stamps.append(convert.stamp_ns(CDR.deserialize(item.data, item.typename)))
        message = click(stamps[19])
        end_ns = start_ns + round(CUT_S * 1e9)
        writer.write(PIXEL, TOPIC_TYPES["tirgeo/locate/pixel"], message, end_ns)
    return path, stamps[19]


def located(path):
    """Stamp, point and covariance of the one point in a bag of outputs."""
    items = list(BagReader(path).messages(["/tirgeo/locate/point"]))
    assert len(items) == 1
    return ground_point(CDR.deserialize(items[0].data, items[0].typename))


def test_a_click_in_the_bag_becomes_a_point(clicked, sample, tmp_path):
    bag, stamp_ns = clicked
    output = tmp_path / "out.mcap"
    options = {"params": sample / "params.yaml", "map": sample / "map.geojson"}
    summary = process(bag, output, **options)
    stamp, point_n, covariance_n = located(output)
    assert stamp == stamp_ns
    # The ground is the plane's own height there: the Earth's bend over 100 m is below 1 mm.
    assert point_n[2] == pytest.approx(0.0, abs=0.001)
    assert 10 < np.linalg.norm(point_n[:2]) < 300
    assert np.linalg.eigvalsh(covariance_n)[0] > 0
    assert summary["overlay"]["drawn"] > 10
    assert summary["written"]["/tirgeo/locate/fix"] == 1


def model(path, sample, height_m):
    """A level elevation model, ellipsoidal, around the sample flight."""
    rasterio = pytest.importorskip("rasterio", reason="elevation models need rasterio")
    from rasterio.transform import from_origin  # noqa: PLC0415 after it is known to be there

    step_deg = 1e-4
    plane = load_config(sample / "params.yaml", "ekf_node", EkfConfig).origin_lat_lon_h
    west, north = plane[1] - 100 * step_deg, plane[0] + 100 * step_deg
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        height=200,
        width=200,
        count=1,
        dtype="float32",
        crs="EPSG:4979",
        transform=from_origin(west, north, step_deg, step_deg),
    ) as target:
        target.write(np.full((200, 200), height_m, np.float32), 1)
    return path


def test_an_elevation_model_stands_before_the_parameters_height(clicked, sample, tmp_path):
    ground_m = load_config(sample / "params.yaml", "overlay_node", OverlayConfig).ground_height_m
    dem = model(tmp_path / "dem.tif", sample, ground_m + 2.0)
    output = tmp_path / "out.mcap"
    options = {"params": sample / "params.yaml", "map": sample / "map.geojson"}
    process(clicked[0], output, dem=dem, **options)
    # 1 mm of the Earth's bend, and what float32 leaves of the height
    assert located(output)[1][2] == pytest.approx(-2.0, abs=0.002)


def kml(path, sample):
    """A line at the sample's origin, one 3 deg away, and a link that is not followed."""
    north, east, _ = load_config(sample / "params.yaml", "ekf_node", EkfConfig).origin_lat_lon_h
    marks = "".join(
        f"<Placemark><LineString><coordinates>{east + off},{north} {east + off},{north + 0.001}"
        "</coordinates></LineString></Placemark>"
        for off in (0.0, 3.0)
    )
    head = '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>'
    path.write_text(f"{head}{marks}</Document></kml>")
    return path


def test_a_map_that_goes_beyond_the_elevation_model_is_in_the_summary(clicked, sample, tmp_path):
    dem = model(tmp_path / "dem.tif", sample, 20.0)
    path = kml(tmp_path / "map.kml", sample)
    options = {"params": sample / "params.yaml", "map": path, "dem": dem}
    notes = process(clicked[0], tmp_path / "out.mcap", **options)["notes"]
    assert any(note.startswith("map: 1 of 2 features lie where the elev") for note in notes)


SIGMA = math.radians(2.0)


def test_a_set_heading_in_a_bag_begins_the_filter(tmp_path):
    flown = flight(1, 6.0, "hover")
    begin_ns, true_rad = flown.truth.stamp_ns[0], heading_of(flown.truth.q_nb[0])
    told = SetHeading(begin_ns + 3_000_000_000, true_rad + SIGMA, SIGMA**2)
    poses = []
    for name, given in (("without", ()), ("with", (told,))):
        bag = write_hover(tmp_path / f"{name}.mcap", flown, *given)
        out = tmp_path / f"{name}_out.mcap"
        process(bag, out, method="ekf", images=False)
        poses.append([body_pose(one) for _, one in messages_of(out, "/tirgeo/odometry")])
    silent, flying = poses
    assert not silent
    assert flying[0].stamp_ns - told.stamp_ns < 1_500_000_000
    off_rad = wrapped(heading_of(flying[0].q_nb) - true_rad)
    assert abs(off_rad - SIGMA) < 0.5 * SIGMA  # it is what was said, turned with the aircraft
