"""The season's page: whole in itself, true to the records, sorted and readable in a browser."""

from __future__ import annotations

import os
import re

import numpy as np
import pytest
from browser import DESK, PHONE, Screen, chromium
from html_pages import Page, embedded
from pyproj import Geod

from tirgeo_ros import __version__
from tirgeo_ros.tools.many_flights.flights_page import flights_html, track_maps, write_page

JPEG = b"\xff\xd8 a picture"


def finding(severity, evidence="5 gaps"):
    parts = {"parameter": "imu/data", "mend": "look at the cable", "check": "gaps"}
    return {"severity": severity, "evidence": evidence, **parts}


def record(name, begin="2026-05-01T10:00:00Z", **more):
    """A record as ``process`` leaves it, of what the page reads."""
    facts = {
        "begin_utc": begin,
        "track_deg": [[47.4, 8.55], [47.401, 8.551]],
        "distance_m": 134.0,
        "heading_sigma_deg": 0.123,
        "horizontal_sigma_m": 0.0123,
        "vertical_sigma_m": 0.0234,
        "nis": {"rtk_position": 0.91},
        "test_ratios": {"rtk_position": 0.4},
    }
    summary = {
        "input": f"{name}.mcap",
        "output": f"{name}.mcap",
        "error": None,
        "duration_s": 75.0,
        "states_s": {"running": 70, "aligning": 5},
        "verdicts": {"rtk_position used": 97, "rtk_position gated": 3},
        "undecodable": {},
        "unreadable": {},
        "unreadable_because": {},
        "findings": [],
        "overlay": {"drawn": 600, "notices": 4},
    }
    season = {"name": name, "outputs": {f"{name}.mcap": 1, f"{name}.mp4": 1}, "facts": facts}
    season["made_from"] = {"version": __version__}
    return summary | {"season": season} | more


def failed(name):
    season = {"name": name, "outputs": {}, "facts": {}}
    return {"input": name, "output": None, "error": f"{name}.mcap: no bag", "season": season}


def html(*records, pictures=None):
    named = {one["season"]["name"]: one for one in records}
    return flights_html("May", named, pictures or {})


def words(page):
    return " ".join(" ".join(page.text).split())


def test_the_page_is_whole_in_itself():
    text = html(record("a"), failed("b"), pictures={"a": JPEG})
    page = Page(text)
    assert embedded(page, "image/jpeg") == [JPEG]
    links = [one for one in page.sources if not one.startswith("data:")]
    assert links == ["#flight-a", "a.mcap", "a.mp4", "a.json", "b.json"]
    assert not re.findall(r"url[(]|@import|<link|https?:", text)
    # The head, the choice of an order and a row's cells have the same columns.
    heads = re.findall(r"<button>(.*?)</button>", text)
    assert re.findall(r'data-title="(.*?)"', text) == 2 * heads
    orders = [f"{head} {arrow}" for head in heads for arrow in "\u25b2\u25bc"]
    assert re.findall(r"<option[^>]*>(.*?)</option>", text) == orders


def test_a_flight_is_told_as_its_record_has_it():
    found = words(Page(html(record("a", findings=[finding("stop"), finding("note")]))))
    for told in (
        "2026-05-01 10:00",
        "47.4000° N",
        "8.5500° E",
        "1:15",
        "134 m",
        "aligning 0:05, running 1:10",
        "heading 0.12°",
        "level 1.23 cm",
        "height 2.34 cm",
        "rtk position 0.91",
        "rtk_position 3 of 100 gated",
        "1 fault",
        "1 note",
        "5 gaps: imu/data: look at the cable",
        "done",
    ):
        assert told in found, told


def test_a_smoothed_flight_says_so():
    assert "done, smoothed" in words(Page(html(record("a", smoothed=True))))
    assert "smoothed" not in words(Page(html(record("a", smoothed=False))))


def test_totals_are_those_of_all_flights():
    damaged = record("c", begin="2026-05-03T10:00:00Z", error="c.mcap: cut off")
    text = html(record("a", findings=[finding("caution")]), failed("b"), damaged)
    found = words(Page(text))
    for told in ("flights 3", "with an error 2", "flown 2:30", "distance 0.27 km"):
        assert told in found, told
    for told in ("pictures with the map 1200", "findings 1 caution", "running 2:20"):
        assert told in found, told
    assert "failed b.mcap: no bag" in found
    assert "in part c.mcap: cut off" in found


def test_rows_are_in_the_order_of_their_begin_and_failed_ones_last():
    late, early = record("a", "2026-05-02T10:00:00Z"), record("z", "2026-05-01T10:00:00Z")
    text = html(failed("f"), late, early)
    assert re.findall(r'<tr id="flight-(\w)"', text) == ["z", "a", "f"]


def test_names_are_text_and_links_are_quoted():
    name = "<b>&'\" 1#?%"
    text = html(record(name, error="<u>", findings=[finding("stop", "<i>")]))
    page = Page(text)
    assert {name, "<u>"} <= {one.strip() for one in page.text}
    assert "<i>: imu/data" in words(page)
    assert "%3Cb%3E%26%27%22%201%23%3F%25.mcap" in page.sources
    assert not re.findall(r"<[bui]>&|<u>|<i>", text)


def test_a_name_that_is_no_utf8_is_linked_by_its_bytes():
    page = Page(html(record(os.fsdecode(b"S\xfcd"))))
    assert {"#flight-S%FCd", "S%FCd.mcap", "S%FCd.json"} <= set(page.sources)


def test_a_flight_without_a_pose_and_one_of_hours():
    lost = record("a", states_s={"lost": 3}, duration_s=3723.0)
    lost["season"]["facts"] = {"heading_sigma_deg": None, "nis": {}, "test_ratios": {}}
    found = words(Page(html(lost)))
    assert "lost 0:03" in found
    assert "1:02:03" in found
    assert "nan" not in found.lower()
    assert "None" not in found


def test_what_another_version_tells_differently_is_a_dash():
    other = record("a", verdicts={"radar swallowed": 3}, states_s={"dreaming": 4, "running": 6})
    with pytest.raises(ValueError, match="swallowed"):
        html(other)
    other["season"]["made_from"]["version"] = "99.0"
    found = words(Page(html(other)))
    assert "running 0:06, dreaming 0:04" in found
    assert found.partition("none - ")[2].startswith("done")  # checks, refused, result


def test_an_empty_folder_has_a_page(tmp_path):
    write_page(tmp_path)
    assert "flights 0" in words(Page((tmp_path / "index.html").read_text()))


def points_of(text):
    return [
        np.array([pair.split(",") for pair in one.split()], float)
        for one in re.findall(r'points="([^"]*)"', text)
    ]


def test_sites_have_a_map_each_to_scale():
    """Two flights of one field, and one far away; lengths by pyproj."""
    north = [[47.4000, 8.5500], [47.4020, 8.5500]]
    east = [[47.4010, 8.5500], [47.4010, 8.5530]]
    far = [[40.0, 116.0], [40.001, 116.0]]
    text = track_maps({"a": north, "far": far, "b": east})
    assert re.findall(r"<figcaption>(.*?)</figcaption>", text) == [
        "47.4000° N 8.5500° E: 2 flights",
        "40.0000° N 116.0000° E: 1 flight",
    ]
    geod = Geod(ellps="WGS84")
    scales = []
    for track, drawn in zip((north, east, far), points_of(text), strict=True):
        assert ((drawn >= 0) & (drawn <= [320, 220])).all()
        (lat, lon), (lat2, lon2) = track
        azimuth_deg, _, length_m = geod.inv(lon, lat, lon2, lat2)
        right, down = drawn[1] - drawn[0]
        assert np.degrees(np.arctan2(right, -down)) == pytest.approx(azimuth_deg, abs=0.1)
        scales.append(np.hypot(right, down) / length_m)
    # The drawing has tenths of a unit, of lengths of 150 and more.
    assert scales[0] == pytest.approx(scales[1], rel=2e-3)
    bars = re.findall(r'd="M16 210V214H([\d.]+)V210"/><text[^>]*>(\d+) m<', text)
    for (end, metres), scale in zip(bars, scales[1:], strict=True):
        assert (float(end) - 16) / float(metres) == pytest.approx(scale, rel=2e-3)


def test_a_chain_of_flights_is_one_site():
    """Each begins 445 m north of another, by the length of a degree there."""

    def track(steps):
        return [[47.4 + 0.004 * steps, 8.55], [47.4 + 0.004 * steps + 0.001, 8.55]]

    apart = {"a": track(0), "c": track(2), "e": track(5)}
    assert track_maps(apart).count("<svg") == 3
    assert track_maps(apart | {"b": track(1)}).count("<svg") == 2
    assert track_maps(apart | {"b": track(1), "d": track(3), "f": track(4)}).count("<svg") == 1
    assert track_maps({}) == ""


@pytest.mark.slow
def test_in_a_browser(tmp_path):
    """No sideways scrolling, from a phone to a desk; rows sorted by column; no complaints."""
    flights = [
        record("b", states_s={"running": 75}, findings=[finding("caution")] * 3),
        record("a", "2026-05-02T10:00:00Z", duration_s=1000.0, findings=[finding("stop")]),
        record("c", "2026-05-03T10:00:00Z", duration_s=300.0),
        failed("d"),
    ]
    path = tmp_path / "index.html"
    path.write_text(html(*flights))
    order = "[...document.querySelectorAll('tbody tr')].map(row => row.id.at(-1)).join('')"
    with chromium() as browser:
        for size in (PHONE, DESK):
            screen = Screen(browser, size, color_scheme="dark").open(path.as_uri())
            assert screen.page.evaluate("document.documentElement.scrollWidth") <= size[0]
            assert screen.page.evaluate(order) == "bacd"
            narrow = size == PHONE
            assert screen.page.locator(".sort select").is_visible() == narrow
            if narrow:
                screen.page.select_option(".sort select", "0 1")
                assert screen.page.evaluate(order) == "dcba"
            else:
                for title, expected in (("flown", "dbca"), ("flown", "acbd"), ("flight", "abcd")):
                    screen.page.click(f"th button:text-is('{title}')")
                    assert screen.page.evaluate(order) == expected
                screen.page.click("th button:text-is('checks')")
                assert screen.page.evaluate(order)[-2:] == "ba"  # one fault is more than cautions
            screen.page.locator("summary").first.click()
            assert screen.page.locator("details li").first.is_visible()
            assert screen.complaints == []
            assert screen.hosts <= {""}
