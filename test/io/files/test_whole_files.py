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
"""Text files: memory by their size, and bytes that are not UTF-8."""

from __future__ import annotations

import tracemalloc

import pytest

from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.io.files.whole_files import read_text


def test_memory_is_by_the_size_of_the_file_not_by_the_limit(tmp_path):
    path = tmp_path / "small.pos"
    path.write_text("% GPST\n" * 250)
    tracemalloc.start()
    try:
        assert len(read_text(path, LogError, 1 << 30)) == path.stat().st_size
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 4 << 20  # some copies of a file of 2 kB, and the buffer that reads it


@pytest.mark.parametrize(("number", "fits"), [(99, True), (100, True), (101, False)])
def test_the_limit(tmp_path, number, fits):
    path = tmp_path / "a.txt"
    path.write_text("x" * number)
    if fits:
        assert read_text(path, LogError, 100) == "x" * number
        return
    with pytest.raises(LogError, match=r"a\.txt: larger than .* MB"):
        read_text(path, LogError, 100)


def test_a_byte_that_is_not_utf_8_costs_itself(tmp_path):
    path = tmp_path / "a.txt"
    degrees = "yaw 12°\r\n"
    path.write_bytes(degrees.encode() + b"\xff bad\n" + degrees.encode())
    assert read_text(path, LogError, damaged=True) == "yaw 12°\nÿ bad\nyaw 12°\n"
    with pytest.raises(LogError, match="not a text file in UTF-8"):
        read_text(path, LogError)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_encodings_of_other_programs(tmp_path, encoding):
    path = tmp_path / "a.txt"
    path.write_text("9,81 m/s²; 12°; Höhe\n", encoding=encoding)
    assert read_text(path, LogError, damaged=True) == "9,81 m/s²; 12°; Höhe\n"
