"""Files that are whole or not there."""

from __future__ import annotations

import pytest

from tirgeo_ros.core.types.errors import SurveyError
from tirgeo_ros.io.files.whole_files import write_files


def test_all_files_are_written_or_none(tmp_path):
    (tmp_path / "old").write_text("old")
    with pytest.raises(SurveyError, match=r"absent/b: cannot be written: No such file"):
        write_files({tmp_path / "old": "new", tmp_path / "absent" / "b": "b"}, SurveyError)
    assert (tmp_path / "old").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["old"]
    write_files({tmp_path / "old": "néw", str(tmp_path / "b"): b"bytes"}, SurveyError)
    assert (tmp_path / "old").read_text(encoding="utf-8") == "néw"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b", "old"]
