"""What is read from a processed flight: against the poses, and pyproj's geodesics."""

from __future__ import annotations

from datetime import datetime, timezone

import cv2
import numpy as np
import pytest
from process_bags import messages_of, rewritten
from pyproj import Geod

from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.tools.replay.process import process
from tirgeo_ros.tools.season.flight_facts import flight_facts


def test_facts_of_a_flight(season, flights):
    """The medians of the positions' sigmas are those of the odometry, which has ten times more."""
    folder, _, records = season
    facts = records["east_flight"]["season"]["facts"]
    begin = datetime.fromtimestamp(BagReader(flights[0]).span_ns[0] // 10**9, timezone.utc)
    assert facts["begin_utc"] == begin.isoformat().replace("+00:00", "Z")
    odometry = [m for _, m in messages_of(folder / "east_flight.mcap", "/tirgeo/odometry")]
    variances = [np.reshape(m.pose.covariance, (6, 6)).diagonal() for m in odometry]
    level_m, up_m = np.median(
        [(np.sqrt(east + north), np.sqrt(up)) for east, north, up, *_ in variances], axis=0
    )
    # Sigmas fall by some per cent from one fix to the next: the tenths have nearly their median.
    assert facts["horizontal_sigma_m"] == pytest.approx(level_m, rel=0.05)
    assert facts["vertical_sigma_m"] == pytest.approx(up_m, rel=0.05)
    places = [m for _, m in messages_of(folder / "east_flight.mcap", "/tirgeo/fix")]
    assert len(facts["track_deg"]) == len(places)  # fewer than 200
    assert facts["track_deg"][-1] == pytest.approx(
        [places[-1].latitude, places[-1].longitude], abs=1e-7
    )  # seven digits


def test_the_distance_is_that_over_the_ground(season):
    folder, _, records = season
    fixes = [m for _, m in messages_of(folder / "east_flight.mcap", "/tirgeo/fix")]
    begin_ns = convert.stamp_ns(fixes[0])
    seconds = {(convert.stamp_ns(m) - begin_ns) // 10**9: m for m in reversed(fixes)}
    chosen = [seconds[key] for key in sorted(seconds)]
    length_m = Geod(ellps="WGS84").line_length(
        [m.longitude for m in chosen], [m.latitude for m in chosen]
    )
    # By chords at height zero: of some metres the geodesics differ by far less than a millimetre.
    assert records["east_flight"]["season"]["facts"]["distance_m"] == pytest.approx(
        length_m, abs=1e-3
    )


def test_heading_and_innovations_are_those_of_the_diagnostics(season):
    folder, _, records = season
    found = [
        convert.navigation_status(item)
        for _, array in messages_of(folder / "east_flight.mcap", "/diagnostics")
        for item in array.status
        if item.name == "/ekf_node: navigation"
    ]
    facts = records["east_flight"]["season"]["facts"]
    sigmas_deg = np.degrees([one.heading_sigma_rad for one in found])
    assert facts["heading_sigma_deg"] == pytest.approx(np.nanmedian(sigmas_deg))
    for source in ("rtk_position", "gps_position"):
        ratios = [one.test_ratios.get(source, 0.0) for one in found]
        assert facts["test_ratios"][source] == max(ratios)


@pytest.mark.slow
def test_the_small_picture_is_one_of_the_overlays(sample, tmp_path):
    """And the means of NIS are of all that the diagnostics have; with a namespace."""
    flight = rewritten(
        sample / "flight.mcap",
        tmp_path / "flight.mcap",
        lambda item: (f"/uav1{item.topic}", item.data),
        seconds=9.0,
    )
    out = tmp_path / "out.mcap"
    given = {"params": sample / "params.yaml", "map": sample / "map.geojson"}
    process(flight, out, namespace="uav1", **given)
    facts, jpeg = flight_facts(out, "uav1", 9.0)
    small = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert small.shape == (256, 320, 3)
    pictures = [
        cv2.resize(cv2.imdecode(np.frombuffer(bytes(m.data), np.uint8), 1), (320, 256), 0, 0, 0, 3)
        for _, m in messages_of(out, "/uav1/tirgeo/overlay/image/compressed")
    ]
    errors = [np.abs(one.astype(float) - small).mean() for one in pictures]
    assert abs(np.argmin(errors) - len(pictures) / 2) <= 5  # in the middle; the first are late
    assert facts["nis"].keys() >= {"rtk_position", "rtk_velocity", "rtk_heading"}
    found = [
        convert.navigation_status(item).nis.get("rtk_position")
        for _, array in messages_of(out, "/diagnostics")
        for item in array.status
        if item.name == "/uav1/ekf_node: navigation"
    ]
    known = [nis for nis in found if nis is not None]
    assert facts["nis"]["rtk_position"] == pytest.approx(np.mean(known))
