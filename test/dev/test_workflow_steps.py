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
"""The steps of a workflow's job, run here: a clone, the matrix, the shell, the first failure."""

from __future__ import annotations

import subprocess

import pytest

from dev.workflow_steps import filled, run_job


@pytest.fixture
def source(tmp_path):
    """A repository with one commit of one file, and a change that is not committed."""
    folder = tmp_path / "source"
    folder.mkdir()
    (folder / "file").write_text("committed\n")
    name = ("-c", "user.name=tirgeo", "-c", "user.email=tirgeo@localhost")
    for words in (["init", "--quiet"], ["add", "."], [*name, "commit", "--quiet", "-m", "One"]):
        subprocess.run(["git", *words], cwd=folder, check=True)
    (folder / "file").write_text("changed\n")
    return folder


@pytest.fixture
def work(tmp_path):
    folder = tmp_path / "work"
    folder.mkdir()
    return folder


CHECKOUT = {"uses": "actions/checkout@0123", "with": {"path": "src/it"}}


def test_steps_run_in_a_clone_of_what_is_committed_until_one_fails(source, work, capfd):
    steps = [{"run": "cat src/it/file; echo ${{ matrix.python }} $KIND"}, {"run": "exit 7"}]
    job = {"steps": [CHECKOUT, *steps, {"run": "touch late"}], "env": {"KIND": "wheels"}}
    assert run_job(job, {"python": "3.11"}, source, work) == 7
    text = capfd.readouterr().out
    assert "committed\n3.11 wheels\n" in text
    assert "= exit code 7 after 0 s" in text
    assert not (work / "late").exists()


@pytest.mark.parametrize(("shell", "code"), [(None, 0), ("bash", 1)])
def test_only_a_shell_that_is_named_sees_a_failure_within_a_pipe(source, work, shell, code):
    job = {"steps": [{"run": "false | cat"}]}
    if shell:
        job["defaults"] = {"run": {"shell": shell}}
    assert run_job(job, {}, source, work) == code


def test_a_value_of_the_matrix_that_is_not_given():
    with pytest.raises(KeyError, match="runner"):
        filled("${{ matrix.runner }}", {})
