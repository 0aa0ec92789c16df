"""The page of the real nodes on the sample flight, in a real browser."""

from __future__ import annotations

import time

import numpy as np
import pytest
from flown_page import FlownPage, TrueSight
from served_page import ELLIPSE

from tirgeo_ros.io.targets.store import TargetStore

pytestmark = [pytest.mark.graph, pytest.mark.slow]

PRESSES = 3
LIMIT_S = 100.0


@pytest.fixture
def flight(sample, tmp_path):
    page = FlownPage.of_bag(sample, tmp_path)
    yield page
    page.close()


def press_on_surveyed_point(screen, sight):
    """Touch a surveyed point in a still picture with a map; return its north, east and down."""
    end_s = time.monotonic() + LIMIT_S
    while True:
        assert time.monotonic() < end_s, "no picture with a map and a surveyed point"
        screen.await_picture(screen.stamp_ns())
        stamp_ns = screen.hold_still()
        points = sight.in_view(stamp_ns)
        if points and not screen.page.locator("#banner").is_visible():
            point, (u, v) = points[0]
            screen.tap(*screen.on_screen(u, v))
            screen.wait("() => document.querySelector('.answer').dataset.tone !== 'wait'")
            taken = screen.page.evaluate("() => document.querySelector('.answer').dataset.tone")
        else:
            point, taken = None, ""
        screen.tap_on("#still")
        if taken == "good":
            return point


def test_presses_on_surveyed_points_are_targets_within_their_ellipses(
    flight, sample, tablet, tmp_path
):
    """The middle one of three, for each ellipse holds 95 of 100."""
    screen = tablet(flight.url)
    sight = TrueSight(sample)
    truths = [press_on_surveyed_point(screen, sight) for _ in range(PRESSES)]
    screen.wait("(n) => document.querySelectorAll('.row').length === n", PRESSES)
    flight.close()
    targets = TargetStore(tmp_path / "targets.gpkg").all()
    squares = []
    for target, truth in zip(targets, truths, strict=True):
        spot = target.place
        place = np.radians([spot.latitude_deg, spot.longitude_deg])
        off = sight.plane.ned_from_geodetic(*place, spot.height_m) - truth
        covariance = np.reshape(spot.covariance_enu, (3, 3))[:2, :2]
        east_north = off[[1, 0]]
        assert np.linalg.norm(east_north) < 3.0
        squares.append(east_north @ np.linalg.solve(covariance, east_north))
    assert np.median(squares) < ELLIPSE
