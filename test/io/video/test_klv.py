"""Packets of MISB ST 0601: by the standard's numbers, a parser of others and one of the tests."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from klv_reader import (
    SIGNED,
    UNSIGNED,
    by_klvdata,
    items_in,
    length_at,
    number_of,
    step_of,
    values_in,
)
from klvdata.common import ber_encode
from project import PROJECT

from tirgeo_ros.io.video.frame_metadata import ITEMS, ber, packet

TIME_NS = 1_231_798_102_000_000_000
#: 2009-01-12 22:08:22 in Vienna, worked out by hand.
WORKED = bytes.fromhex(
    "060e2b34020b01010e01030101000000 1d 0208 000460 5058 4e0180 4101 13 0d04 44900f84"
    "0e04 0ba4c344 0102 ce65"
)
MAPPED = sorted(UNSIGNED | SIGNED)
#: By the tests of jmisb: tag, value, bytes.
VECTORS = [
    (5, 159.974, "71c2"),
    (6, -0.4315, "fd3d"),
    (7, 3.4058, "08b8"),
    (13, 60.1768229669783, "5595b66d"),
    (14, 128.426759042045, "5b5360c4"),
    (15, 14190.72, "c221"),
    (16, 144.5713, "cd9c"),
    (17, 152.6436, "d917"),
    (18, 160.719211474397, "724a0a20"),
    (19, -168.792324833941, "87f84b86"),
    (20, 176.865437690572, "7dc55ece"),
    (22, 722.82, "1281"),
    (45, 425.2, "1a95"),
    (46, 608.9, "2611"),
]


def range_of(tag):
    if tag in UNSIGNED:
        return UNSIGNED[tag][:2]
    return -SIGNED[tag][0], SIGNED[tag][0]


def test_the_worked_example():
    assert packet(TIME_NS + 999, {13: 48.2081743, 14: 16.3738189}) == WORKED
    found = by_klvdata(WORKED)
    assert found[2] == "2009-01-12 22:08:22+00:00"
    assert float(found[13]) == 48.208174299545675
    assert float(found[14]) == 16.373818859632053


@pytest.mark.parametrize(("tag", "value", "content"), VECTORS)
def test_vectors(tag, value, content):
    assert dict(items_in(packet(TIME_NS, {tag: value})))[tag] == bytes.fromhex(content)


@pytest.mark.parametrize(
    ("length", "content"),
    [(0, "00"), (127, "7f"), (128, "8180"), (233, "81e9"), (256, "820100"), (65535, "82ffff")],
)
def test_lengths(length, content):
    assert ber(length) == bytes.fromhex(content) == ber_encode(length)


def test_every_mapped_item_is_known_to_the_tests_and_to_the_page():
    assert {tag for tag, item in ITEMS.items() if not math.isnan(item.low)} == set(MAPPED)
    page = (PROJECT / "docs" / "video.md").read_text()
    rows = re.findall(r"^\| (\d[\d, -]*) \|", page, re.MULTILINE)
    written = {tag for row in rows for part in row.split(",") for tag in spread(part)}
    assert written == set(ITEMS)


def spread(words):
    first, _, last = words.partition("-")
    return range(int(first), int(last or first) + 1)


@pytest.mark.parametrize("tag", MAPPED)
@settings(max_examples=40)
@given(data=st.data())
def test_a_value_comes_back_to_half_a_step(tag, data):
    low, high = range_of(tag)
    value = data.draw(st.floats(low, high))
    made = packet(TIME_NS, {tag: value})
    # Half a step, and the rounding of numbers of this size.
    assert abs(values_in(made)[tag] - value) <= 0.5 * step_of(tag) + 1e-15 * max(-low, high)
    # klvdata refuses values that its own rounding carries past the end of the range.
    if low + step_of(tag) < value < high - step_of(tag):
        assert float(by_klvdata(made)[tag]) == pytest.approx(values_in(made)[tag], abs=1e-9)


@pytest.mark.parametrize("tag", MAPPED)
def test_ends_of_a_range_and_what_is_beyond(tag):
    low, high = range_of(tag)
    for value in (low, high):
        assert values_in(packet(TIME_NS, {tag: value}))[tag] == pytest.approx(value, abs=1e-9)
    beyond = [math.nextafter(low, -math.inf), math.nextafter(high, math.inf)]
    for value in (*beyond, math.nan, math.inf, -math.inf):
        assert packet(TIME_NS, {tag: value}) == packet(TIME_NS, {})


@given(st.dictionaries(st.sampled_from(MAPPED), st.floats(allow_nan=True)), st.integers(0, 2**63))
def test_any_values_make_a_good_packet(values, time_ns):
    """Never an error code, whatever comes; the time is cut to microseconds."""
    found = values_in(packet(time_ns, values))
    assert found.pop(2) == time_ns // 1000
    low_high = {tag: range_of(tag) for tag in values}
    kept = {t: v for t, v in values.items() if low_high[t][0] <= v <= low_high[t][1]}
    assert found.keys() == kept.keys()


@given(st.text(max_size=200))
def test_texts_of_any_length_and_both_parities(text):
    made = packet(TIME_NS, {10: text, 13: 1.0})
    items = dict(items_in(made))
    kept = items.get(10, b"").decode()  # a character is never cut in two
    assert text.startswith(kept)
    assert len(kept.encode()) > 123 or kept == text
    by_klvdata(made)


def test_the_checksum_of_odd_and_even_packets():
    made = [packet(TIME_NS, {10: "x" * count}) for count in range(1, 128)]
    assert {len(one) % 2 for one in made} == {0, 1}
    assert any(length_at(one, 16)[0] > 127 for one in made)
    for one in made:
        by_klvdata(one)  # compares with klvdata's own checksum


def test_time_before_1970_is_1970():
    assert items_in(packet(-1, {}))[0] == (2, bytes(8))
    assert number_of(5, b"\xff\xff") == 360.0
