"""The page of an evaluation: whole in itself, readable by machine, the same each time."""

from __future__ import annotations

import dataclasses
import re
from xml.etree import ElementTree as ET

import cv2
import numpy as np
import pytest
from html_pages import Page, embedded

from tirgeo_ros.tools.evaluate.report import report_html
from tirgeo_ros.tools.evaluate.summary import summary

pytestmark = pytest.mark.slow

FIGURES = [
    "Errors of the control points",
    "Sigma against error",
    "Track",
    "Attitude before and after",
    "Innovations and test ratios",
]


def report(found):
    return report_html(found, summary(found))


@pytest.fixture(scope="module")
def text(found):
    return report(found)


@pytest.fixture(scope="module")
def page(text):
    return Page(text)


def test_the_page_is_whole_in_itself(found, text, page):
    assert all(source.startswith("data:image/") for source in page.sources)
    assert not re.findall(r"url[(]|@import|<script|<link", text)
    assert [text for text in page.text if text in FIGURES] == FIGURES
    figures = embedded(page, "image/svg+xml")
    of_methods, of_sources = len(found.methods), len(found.methods[-1].series.sources)
    assert len(figures) == len(FIGURES) - 2 + of_methods + of_sources
    for figure in figures:
        assert ET.fromstring(figure).tag == "{http://www.w3.org/2000/svg}svg"
    assert report(found) == text


def test_the_tables_hold_the_numbers(found, page):
    for method in found.methods:
        told = [method.errors.mean_point_rmse_m, method.errors.ce90_m]
        told += method.errors.point_rmse_m.values()
        assert {f"{error:.3f}" for error in told} <= set(page.text)
    assert {one.id for one in found.methods[0].located} <= set(page.text)


def test_stills_are_pictures_with_the_map_and_the_clicks(found, page):
    stills = [
        cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR).astype(int)
        for jpeg in embedded(page, "image/jpeg")
    ]
    assert 3 <= len(stills) <= 4  # one of four has no pose: the flight begins there
    for still, (caption, _) in zip(stills, found.stills, strict=True):
        assert still.shape == (512, 640, 3)
        blue, green, red = np.moveaxis(still, -1, 0)
        assert (np.minimum(red, green) - blue > 100).sum() > 2000  # yellow lines of the map
        assert ((red - blue > 150) & (np.abs(green - 140) < 40)).sum() >= 10  # orange crosses
        assert set(caption.partition(" at ")[0].split(", ")) <= set(found.control)
        assert caption.endswith("the map by calibrated")


def test_names_are_text_and_no_tags(found):
    first = found.methods[0]
    clicked = dataclasses.replace(first.located[0], id="<b>&'\"")
    odd = dataclasses.replace(found.control[first.located[0].id], id=clicked.id)
    changed = dataclasses.replace(
        found,
        control={odd.id: odd},
        methods=[dataclasses.replace(first, located=[clicked], refused=[])],
        notes=["<i>"],
        error="<u>",
    )
    text = report(changed)
    assert not re.findall(r"<[biu]>", text)
    assert {odd.id, "<i>", "<u>"} <= set(Page(text).text)
