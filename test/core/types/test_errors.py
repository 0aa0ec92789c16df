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
"""How errors show text from outside: cut to a length, with unprintable characters escaped."""

from hypothesis import given, strategies as st

from tirgeo_ros.core.types.errors import MOST, MapError, cut, shown


def test_a_short_plain_text_stays():
    for text in ("needs rtk/fix", "größer als 5°", "地図.geojson"):
        assert cut(text) == shown(text) == text


@given(st.text(max_size=50), st.integers(1, 60))
def test_a_text_is_shown_as_one_line_of_bounded_length(text, most):
    assert len(cut(text, most)) <= most
    line = shown(text, most)
    assert line.isprintable()
    assert len(line) <= 10 * most  # the longest escape of a character: \U0001f600
    line.encode()  # half a character too


def test_terminal_sequences_are_escaped():
    assert shown("a\x1b[2J\nb\udc80") == "a\\x1b[2J\\nb\\udc80"


def test_an_error_is_one_line_whatever_it_quotes():
    line = str(MapError("layer " + "\n" * 1_000_000))
    assert line.isprintable()
    assert len(line) <= 2 * MOST
    assert line.startswith("layer \\n")
    assert str(MapError("plain")) == "plain"
