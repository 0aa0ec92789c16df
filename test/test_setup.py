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
"""Setting up the environment: without a network, interrupted, and made smaller afterwards."""

from __future__ import annotations

import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from project import PROJECT

SCRIPTS = PROJECT / "scripts"
#: Makes an "environment" of itself, whose pip finds no network.
STUB = f"""#!/bin/sh
case "$2" in
venv)
    for folder; do :; done
    mkdir -p "$folder/bin"
    cp "$0" "$folder/bin/python" ;;
pip)
    echo "WARNING: Retrying (Retry(total=0)) after connection broken by 'NewConnectionError'"
    exit 1 ;;
*) exec {sys.executable} "$@" ;;
esac
"""


def executable(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)
    return path


def test_pip_without_a_network_is_one_line(tmp_path):
    """pip's own words, as this Python's pip has them; port 9 is closed."""
    pytest.importorskip("pip")
    python = executable(tmp_path / "bin" / "python", f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    (tmp_path / "constraints.txt").touch()
    closed = {"PIP_INDEX_URL": "http://127.0.0.1:9/simple", "PIP_CONFIG_FILE": os.devnull}
    nowhere = dict.fromkeys(("PIP_EXTRA_INDEX_URL", "PIP_FIND_LINKS"), "")
    run = subprocess.run(
        [SCRIPTS / "pip_install.sh", python.parents[1], "tirgeo-no-such-package"],
        env={**os.environ, **nowhere, **closed, "PIP_RETRIES": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 1
    (line,) = run.stderr.splitlines()
    assert line.startswith("tirgeo: cannot reach the package index: connect this machine")


@pytest.mark.parametrize(("words", "slow"), [([], False), (["-m", "slow and not long"], True)])
def test_pytest_runs_no_slow_tests_unless_asked(words, slow):
    """``colcon test`` calls it so, and ``make test-slow``."""
    line = [
        sys.executable,
        *["-m", "pytest", "--collect-only", "-q", "test/test_examples.py"],
        *words,
    ]
    text = subprocess.run(line, cwd=PROJECT, stdout=subprocess.PIPE, text=True, check=True).stdout
    assert ("test_rtk_outage" in text, "test_the_readme" in text) == (slow, not slow)


@pytest.fixture
def set_up(tmp_path):
    """Run setup.sh in ``tmp_path``, where pip finds no network: what it says."""
    python = executable(tmp_path / "python3", STUB)

    def run() -> str:
        done = subprocess.run(
            [SCRIPTS / "setup.sh", ".venv", "user"],
            cwd=tmp_path,
            env={"PATH": os.environ["PATH"], "PYTHON": str(python)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 1
        return done.stderr

    return run


@pytest.mark.parametrize("left", [(), (".venv/whole",), (".venv.old/whole", ".venv/half")])
def test_the_environment_of_before_outlives_a_failed_or_a_killed_set_up(set_up, tmp_path, left):
    for name in left:
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).touch()
    assert "cannot reach the package index" in set_up()
    assert [path.name for path in tmp_path.glob(".venv*/*")] == ["whole"][: len(left)]
    assert left or not list(tmp_path.glob(".venv*"))  # no half environment


def test_equal_libraries_become_one_file(tmp_path):
    link_same = runpy.run_path(str(SCRIPTS / "slim.py"))["link_same"]
    paths = [tmp_path / name for name in ("a.so", "a.so.1", "b.so", "c.so")]
    for path, data in zip(paths, (b"same", b"same", b"else", b"same"), strict=True):
        path.write_bytes(data)
    link_same(paths)
    link_same(paths)
    assert paths[0].samefile(paths[1])
    assert paths[0].samefile(paths[3])
    assert [path.read_bytes() for path in paths] == [b"same", b"same", b"else", b"same"]
    assert len(list(tmp_path.iterdir())) == 4


def test_a_browser_that_is_there_is_enough_and_who_cannot_install_one_learns_how(tmp_path):
    def browser(folder: str) -> subprocess.CompletedProcess[str]:
        script, env = ["/bin/sh", SCRIPTS / "browser.sh"], {"PATH": str(tmp_path / folder)}
        return subprocess.run(script, env=env, capture_output=True, text=True, check=False)

    executable(tmp_path / "with" / "chromium", "#!/bin/sh\nexit 9\n")
    assert browser("with").returncode == 0
    executable(tmp_path / "without" / "id", "#!/bin/sh\necho 1000\n")
    executable(tmp_path / "without" / "apt-get", "#!/bin/sh\nexit 0\n")
    run = browser("without")
    assert run.returncode == 1
    assert "sudo apt install chromium" in run.stderr
