"""A SubRip file: its clock, and that it is complete or absent."""

from __future__ import annotations

import pytest

from tirgeo_ros.core.types.errors import ExportError
from tirgeo_ros.tools.export.subtitles import SubtitleFile

S = 1_000_000_000


def test_the_clock_counts_hours_and_rounds_to_milliseconds(tmp_path):
    file = SubtitleFile(tmp_path / "out.srt")
    file.add(0, 1_555_555_556, "first")
    file.add(59_999_600_000, 3599 * S + 999_400_000, "second\nline \u00b0")
    file.add(36_061 * S + 7_000_000, 360_000 * S, "third")
    file.finish()
    assert (tmp_path / "out.srt").read_text(encoding="utf-8") == (
        "1\n00:00:00,000 --> 00:00:01,556\nfirst\n\n"
        "2\n00:01:00,000 --> 00:59:59,999\nsecond\nline \u00b0\n\n"
        "3\n10:01:01,007 --> 100:00:00,000\nthird\n\n"
    )
    assert [one.name for one in tmp_path.iterdir()] == ["out.srt"]


def test_an_older_file_stays_until_the_new_one_is_complete(tmp_path):
    (tmp_path / "out.srt").write_text("old")
    file = SubtitleFile(tmp_path / "out.srt")
    file.add(0, S, "new")
    assert (tmp_path / "out.srt").read_text() == "old"
    file.finish()
    assert "new" in (tmp_path / "out.srt").read_text()


def test_a_place_that_is_no_file_is_named(tmp_path):
    (tmp_path / "out.srt").mkdir()
    with pytest.raises(ExportError, match=r"out.srt: not a file"):
        SubtitleFile(tmp_path / "out.srt")
