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
"""The reference of the public interface: what is missing or wrong in a docstring is a line."""

from __future__ import annotations

import subprocess
import sys
import types
import warnings
from dataclasses import dataclass

import pytest
from project import PROJECT

import tirgeo_ros
from dev.api_reference import faults, main, public_names


class Described:
    """Hold a part; raise KeyError."""

    def part(self):
        """Return it."""

    def hidden(self): ...

    @property
    def mistaken(self):
        """Return it; raise ``PartError`` or KeyError."""


@dataclass
class Bare:
    number: int


def test_every_public_name_is_described():
    assert faults(public_names()) == []


def test_what_is_missing_or_does_not_exist_is_a_line():
    assert faults({"Described": Described, "Bare": Bare}) == [
        "Described.hidden: no docstring",
        "Described.mistaken: its docstring names PartError, which is not public",
        "Bare: no docstring",
    ]


def test_a_warning_of_pdoc_fails(monkeypatch, tmp_path, capsys):
    message_text = []
    pdoc = types.SimpleNamespace(
        pdoc=lambda *_, **__: [warnings.warn(text, stacklevel=1) for text in message_text],
        render=types.SimpleNamespace(configure=lambda **_: None),
    )
    monkeypatch.setitem(sys.modules, "pdoc", pdoc)
    assert main([str(tmp_path)]) == 0
    message_text.append("Error parsing type annotation Nowhere\nand a traceback")
    assert main([str(tmp_path)]) == 1
    assert capsys.readouterr().err == "pdoc: Error parsing type annotation Nowhere\n"


@pytest.mark.slow
def test_pdoc_writes_a_page_of_all_names(tmp_path):
    pytest.importorskip("pdoc", reason="pdoc comes with make api")
    command = [sys.executable, "-m", "dev.api_reference", tmp_path]
    done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    page = (tmp_path / "tirgeo_ros.html").read_text()
    places = [page.index(f'id="{name}"') for name in tirgeo_ros.__all__]
    assert places == sorted(places)
    assert (tmp_path / "index.html").exists()
