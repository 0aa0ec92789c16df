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
"""Kill -9 of a process that edits targets: every confirmed edit is in the file."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time

import pytest
from project import PROJECT
from target_writer import edit, state_of

from tirgeo_ros.core.types.errors import TargetError
from tirgeo_ros.io.targets.store import TargetStore


def states_after_each(folder, edits):
    """What the store holds after 0, 1, 2, ... edits."""
    store = TargetStore(folder / "expected.gpkg")
    result = [state_of(store)]
    for number in range(edits):
        edit(store, number)
        result.append(state_of(store))
    store.close()
    return result


def writer(path, edits):
    script = PROJECT / "test" / "support" / "target_writer.py"
    return subprocess.Popen(
        [sys.executable, script, path, str(edits)],
        stdout=subprocess.PIPE,
        cwd=PROJECT,
        env={"PYTHONPATH": f"{PROJECT}:{script.parent}"},
    )


def confirmed_before_kill(path, edits, wanted, delay_s):
    """Kill a writer some time after a number of edits; return how many it confirmed."""
    with writer(path, edits) as process:
        for _ in range(wanted):
            assert process.stdout.readline()
        time.sleep(delay_s)
        process.send_signal(signal.SIGKILL)
        return wanted + len(process.stdout.read().splitlines())


def test_three_kills_lose_no_confirmed_edit(tmp_path):
    edits, rng = 60, random.Random(1)
    expected = states_after_each(tmp_path, edits)
    for kill in range(3):
        path = tmp_path / f"{kill}.gpkg"
        wanted = rng.randrange(1, edits)
        confirmed = confirmed_before_kill(path, edits, wanted, rng.uniform(0, 0.03))
        assert confirmed <= edits
        store = TargetStore(path)
        # one more may be on disk, whose confirmation was not yet said
        assert state_of(store) in expected[confirmed : confirmed + 2], (kill, confirmed)
        assert store.undo()
        store.close()


def test_a_file_whose_making_was_killed_can_be_opened(tmp_path):
    for kill, delay_s in enumerate((0.0, 0.3, 0.6)):
        path = tmp_path / f"{kill}.gpkg"
        confirmed_before_kill(path, 1, 0, delay_s)
        TargetStore(path).close()


def test_a_second_process_is_refused_and_the_first_goes_on(tmp_path):
    path = tmp_path / "targets.gpkg"
    with writer(path, 10_000) as process:
        assert process.stdout.readline()
        with pytest.raises(TargetError, match=r"targets\.gpkg: another program has it open"):
            TargetStore(path)
        assert process.stdout.readline()
        process.kill()
