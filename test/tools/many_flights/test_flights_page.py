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
"""The season's page: whole in itself, true to the records, sorted and readable in a browser."""

from __future__ import annotations

import os
import re

import pytest
from browser import DESK, PHONE, Screen, chromium
from html_pages import Page, embedded

from tirgeo_ros import __version__
from tirgeo_ros.tools.many_flights.flights_page import flights_html, write_page

JPEG = b"\xff\xd8 a picture"


def finding(severity, evidence="5 gaps"):
    parts = {"parameter": "imu/data", "mend": "look at the cable", "check": "gaps"}
    return {"severity": severity, "evidence": evidence, **parts}


def record(name, begin="2026-05-01T10:00:00Z", **more):
    """A record as ``process`` leaves it, of what the page reads."""
    facts = {
        "begin_utc": begin,
        "place_deg": [47.4, 8.55],
        "distance_m": 134.0,
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
    named = {item["season"]["name"]: item for item in records}
    return flights_html("May", named, pictures or {})


def words(page):
    return " ".join(" ".join(page.text).split())


def test_the_page_is_whole_in_itself(tmp_path):
    text = html(record("a"), failed("b"), pictures={"a": JPEG})
    page = Page(text)
    assert embedded(page, "image/jpeg") == [JPEG]
    links = [item for item in page.sources if not item.startswith("data:")]
    assert links == ["a.mcap", "a.mp4", "a.json", "b.json"]
    assert not re.findall(r"url[(]|@import|<link|https?:", text)
    # The head and a row's cells have the same columns.
    heads = re.findall(r"<button>(.*?)</button>", text)
    assert re.findall(r'data-title="(.*?)"', text) == 2 * heads
    write_page(tmp_path)  # of an empty folder
    assert "flights 0" in words(Page((tmp_path / "index.html").read_text()))


def test_a_row_has_the_contents_of_its_record():
    result = words(Page(html(record("a", findings=[finding("stop"), finding("note")]))))
    for text in (
        "2026-05-01 10:00",
        "47.4000° N",
        "8.5500° E",
        "1:15",
        "134 m",
        "aligning 0:05, running 1:10",
        "rtk_position 3 of 100 gated",
        "1 fault",
        "1 note",
        "5 gaps: imu/data: look at the cable",
        "done",
    ):
        assert text in result, text
    assert "smoothed" not in result
    assert "done, smoothed" in words(Page(html(record("a", smoothed=True))))


def test_totals_are_those_of_all_flights_in_the_order_of_their_begin():
    damaged = record("c", begin="2026-05-03T10:00:00Z", error="c.mcap: cut off")
    text = html(failed("b"), damaged, record("a", findings=[finding("caution")]))
    assert re.findall(r'<tr id="flight-(\w)"', text) == ["a", "c", "b"]  # by time, failed last
    result = words(Page(text))
    for output in ("flights 3", "with an error 2", "flown 2:30", "distance 0.27 km"):
        assert output in result, output
    for output in ("pictures with the map 1200", "findings 1 caution", "running 2:20"):
        assert output in result, output
    assert "failed b.mcap: no bag" in result
    assert "in part c.mcap: cut off" in result


def test_names_are_text_and_links_are_quoted():
    name = "<b>&'\" 1#?%"
    text = html(record(name, error="<u>", findings=[finding("stop", "<i>")]))
    page = Page(text)
    assert {name, "<u>"} <= {item.strip() for item in page.text}
    assert "<i>: imu/data" in words(page)
    assert "%3Cb%3E%26%27%22%201%23%3F%25.mcap" in page.sources
    assert not re.findall(r"<[bui]>&|<u>|<i>", text)
    no_utf8 = Page(html(record(os.fsdecode(b"S\xfcd"))))
    assert {"S%FCd.mcap", "S%FCd.json"} <= set(no_utf8.sources)


def test_a_flight_without_a_pose_and_one_of_hours():
    lost = record("a", states_s={"lost": 3}, duration_s=3723.0)
    lost["season"]["facts"] = {}
    result = words(Page(html(lost)))
    assert "lost 0:03" in result
    assert "1:02:03" in result
    assert "nan" not in result.lower()
    assert "None" not in result


def test_a_value_of_another_version_is_a_dash():
    other = record("a", verdicts={"radar swallowed": 3}, states_s={"dreaming": 4, "running": 6})
    with pytest.raises(ValueError, match="swallowed"):
        html(other)
    other["season"]["made_from"]["version"] = "99.0"
    result = words(Page(html(other)))
    assert "running 0:06, dreaming 0:04" in result
    assert result.partition("none - ")[2].startswith("done")  # checks, refused, result


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
            if size == DESK:
                for title, expected in (("flown", "dbca"), ("flown", "acbd"), ("flight", "abcd")):
                    screen.page.click(f"th button:text-is('{title}')")
                    assert screen.page.evaluate(order) == expected
                screen.page.click("th button:text-is('checks')")
                assert screen.page.evaluate(order)[-2:] == "ba"  # one fault is more than cautions
            screen.page.locator("summary").first.click()
            assert screen.page.locator("details li").first.is_visible()
            assert screen.complaints == []
            assert screen.hosts <= {""}
