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
"""Every source file says whose it is and under which licence."""

from __future__ import annotations

import runpy
import subprocess
import sys

import pytest
from project import PROJECT

SCRIPT = PROJECT / "scripts" / "licence_lines.py"
lines = runpy.run_path(str(SCRIPT))


def test_every_source_file_has_the_lines():
    if not (PROJECT / ".git").exists():
        pytest.skip("an unpacked source distribution has no list of its files")
    files = lines["source_files"]()
    assert {path.suffix for path in files} == lines["HEADS"].keys()
    assert len(files) > 700
    assert lines["lacking"](files) == []


NOTICE = "".join(f"# {line}".rstrip() + "\n" for line in lines["NOTICE"].splitlines())


@pytest.mark.parametrize(
    ("name", "text", "result"),
    [
        ("a.py", '"""Do."""\n', f'# {{}}\n# {{}}\n{NOTICE}"""Do."""\n'),
        ("a.sh", "#!/bin/sh\nset -e\n", "#!/bin/sh\n# {}\n# {}\nset -e\n"),
        ("a", "#!/bin/sh\n# Runs.\n", "#!/bin/sh\n# {}\n# {}\n\n# Runs.\n"),
        ("a.js", "/** Do. */\n", "// {}\n// {}\n/** Do. */\n"),
        ("a.css", "a { }\n", "/* {}\n * {} */\na {{ }}\n"),
        ("empty.py", "", ""),
    ],
)
def test_they_are_added_once(tmp_path, name, text, result):
    path = tmp_path / name
    path.write_text(text)
    for _ in range(2):
        subprocess.run([sys.executable, SCRIPT, path], check=True, capture_output=True)
    assert path.read_text() == result.format(*lines["LINES"])
    assert lines["lacking"]([path]) == []


def test_the_notice_is_the_licence_s_own():
    """With it ament_copyright knows the licence; it compares words, whatever stands between."""
    own = (PROJECT / "LICENSE").read_text().rpartition("[name of copyright owner]")[2]
    assert own.split()[: len(lines["NOTICE"].split())] == lines["NOTICE"].split()
