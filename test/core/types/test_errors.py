"""Errors and text from outside: how much of it is shown, and in what form."""

from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.types.errors import MOST, MapError, cut, shown


def test_what_is_short_and_plain_stays():
    for text in ("needs rtk/fix", "größer als 5°", "地図.geojson"):
        assert cut(text) == shown(text) == text


@given(st.text(max_size=50), st.integers(1, 60))
def test_it_is_one_line_of_a_bounded_length(text, most):
    assert len(cut(text, most)) <= most
    line = shown(text, most)
    assert line.isprintable()
    assert len(line) <= 10 * most  # of what one character may be written with: \U0001f600
    line.encode()  # half a character too


def test_what_a_terminal_would_obey_is_written_out():
    assert shown("a\x1b[2J\nb\udc80") == "a\\x1b[2J\\nb\\udc80"


def test_an_error_is_one_line_whatever_it_quotes():
    line = str(MapError("layer " + "\n" * 1_000_000))
    assert line.isprintable()
    assert len(line) <= 2 * MOST
    assert line.startswith("layer \\n")
    assert str(MapError("plain")) == "plain"
