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
"""The command's frame: exit codes, one-line errors, JSON, quick start; with verbs made here."""

from __future__ import annotations

import json
import math
import signal
import subprocess
import sys
import time
from datetime import datetime, timezone
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from project import verb_parsers

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.tools.cli import main as command
from tirgeo_ros.tools.cli._verb import UsageError, utc_time


def verb(run, **more):
    text = "Work.\n\nexample:\n  tirgeo work"
    return SimpleNamespace(__name__="work", __doc__=text, OPTIONS=(), run=run, **more)


@pytest.fixture
def run_verb(monkeypatch, capsys):
    def run(work, *argv, **more):
        monkeypatch.setattr(command, "verbs", lambda: [verb(work, **more)])
        code = command.main(["work", *argv])
        return code, *capsys.readouterr()

    return run


def raising(error):
    def run(args):
        raise error

    return run


def test_a_result_is_a_line_for_each_key_in_words(run_verb):
    """As ``process`` prints: problems are first. Names of topics and files are not changed."""
    result = {"frames_drawn": 3, "rms": {"heading_deg": 0.25, "rtk/fix_m": 1}, "no": None}
    result |= {"smoothed": False, "notes": [], "latency_ms": [1.5, 2.0], "not_used": {"late": 2}}
    code, out, err = run_verb(lambda _: result)
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        "! not used      late: 2",
        "  frames drawn  3",
        "  rms           heading: 0.25 deg; rtk/fix_m: 1",
        "  smoothed      no",
        "  latency       1.5, 2 ms",
    ]


def test_json_is_one_object_with_null_for_nan(run_verb):
    result = {
        "nan": math.nan,
        "array": np.array([1.0, -np.inf]),
        "count": np.int64(7),
        "path": Path("a") / "b",
        "nested": {"pair": (1, True), "text": "Übersicht"},
    }
    code, out, _ = run_verb(lambda _: result, "--json")
    assert code == 0
    assert out.count("\n") == 1
    assert json.loads(out) == {
        "nan": None,
        "array": [1.0, None],
        "count": 7,
        "path": "a/b",
        "nested": {"pair": [1, True], "text": "Übersicht"},
    }


def test_errors_are_one_line_of_the_verb(run_verb, tmp_path):
    """Tirgeo's errors with code 1, the system's with the file's name, and Ctrl-C with 130."""
    absent = tmp_path / "none"
    for work, expected, said in (
        (raising(BagError("a.mcap: not an\nMCAP file")), 1, "a.mcap: not an\\nMCAP file"),
        (lambda _: absent.open(), 1, f"{absent}: No such file or directory"),
        (raising(KeyboardInterrupt()), 130, "interrupted"),
    ):
        assert run_verb(work) == (expected, "", f"tirgeo work: {said}\n")


def test_a_bug_keeps_its_traceback(run_verb):
    with pytest.raises(ZeroDivisionError):
        run_verb(lambda _: 1 // 0)


@pytest.mark.parametrize(
    ("argv", "message"),
    [([], "VERB"), (["fly"], "invalid choice: 'fly'"), (["work", "-x"], "unrecognized arguments")],
)
def test_wrong_use_has_exit_code_2(monkeypatch, capsys, argv, message):
    monkeypatch.setattr(command, "verbs", lambda: [verb(lambda _: 0)])
    with pytest.raises(SystemExit) as left:
        command.main(argv)
    assert left.value.code == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "micros"),
    [
        ("2021-10-20T12:00:36", 0),
        ("2021-10-20T12:00:36.5Z", 500_000),
        ("2021-10-20 14:00:36.25+02:00", 250_000),
        ("2021-10-20T12:00:36.123456789", 123_456),
    ],
)
def test_a_time_is_read_on_every_python(text, micros):
    """Python 3.10 itself refuses fractions of other than three or six digits."""
    assert utc_time(text) == datetime(2021, 10, 20, 12, 0, 36, micros, timezone.utc)


_BORESIGHT = "calibrate boresight a.mcap --survey s --observations o -o y"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("proces a", "(did you mean process?)"),
        ("calibrate lenz a", "(did you mean lens?)"),
        ("process a -o b --parms=c", "(did you mean --params?)"),
        ("locate a -o b --method ekf_headin", "(did you mean ekf_heading?)"),
        *(
            (f"import a.bin -o b.mcap --start-time {t}", f"{t}: give a time from 1970 to 2038")
            for t in ("2100-01-01", "1969-12-31", "noon")
        ),
        ("cut a.mcap -o b.mcap --to 1e300", "--to: 1e300: not seconds, nor a time as"),
        ("export a.mcap -o b --degrees nan 0", "--degrees: invalid number value: 'nan'"),
        ("export a.mcap -o b --degrees 0 1", "--degrees: SCALE must not be 0"),
        ("export a.mcap -o b --gsd inf", "--gsd: invalid number value: 'inf'"),
        ("process a b -o out.mcap", "several flights need a folder, not out.mcap"),
        ("process a b -o out --workers 0", "--workers must be 1 or more"),
        ("process a b -o out --workers 2 --scheduler a:1", "cannot be used with --scheduler"),
        ("process a b -o out --video out.mp4", "--video out.mp4: give one of .mp4, .ts for"),
        ("process a -o b --workers 2", "--workers and --scheduler are for several flights"),
        ("process a -o b --scheduler a:1", "--workers and --scheduler are for several flights"),
        ("process a -o b --video", "--video needs a name, as OUT.mp4"),
        (f"{_BORESIGHT} --estimate roll --hold roll", "roll: name it in --estimate or in --hold"),
        (f"{_BORESIGHT} --estimate ,", "nothing to estimate"),
        ("calibrate imu a.mcap --from 10 --to 5", "--from must be 0 or more, and less than --to"),
    ],
)
def test_wrong_use_is_named_with_usage(capsys, words, message):
    with pytest.raises(SystemExit) as left:
        command.main(words.split())
    assert left.value.code == 2
    *_, last = capsys.readouterr().err.splitlines()
    assert last.startswith("tirgeo")
    assert message in last


def test_a_verb_may_find_wrong_use_itself(run_verb, capsys):
    with pytest.raises(SystemExit) as left:
        run_verb(raising(UsageError("-o and --video name the same file")))
    assert left.value.code == 2
    assert capsys.readouterr().err.endswith(
        "tirgeo work: error: -o and --video name the same file\n"
    )


@pytest.mark.parametrize(("words", "parser"), list(verb_parsers().items()), ids=str)
def test_each_verbs_help_has_an_example_and_json(words, parser):
    text = parser.format_help()
    assert f"\n  tirgeo {words} " in f"{text.partition('example')[2]} "
    assert "--json" in text
    assert parser.prog == f"tirgeo {words}"  # which begins its errors


def test_help_imports_nothing_heavy():
    code = (
        "import sys, tirgeo_ros.tools.cli.main as m\n"
        "m.parser_of(m.verbs()).format_help()\n"
        "print(*sorted({'numpy', 'cv2', 'pyproj', 'rclpy', 'rosbags', 'yaml', 'mcap'} "
        "& set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == []


# The two below need a real process: a closed pipe and a signal. Their verb is made on the fly.
ENDLESS = (
    "import sys, time, types, tirgeo_ros.tools.cli.main as m\n"
    "def run(args):\n"
    "    try:\n"
    "        print('begun', flush=True)\n"
    "        while True: {body}\n"
    "    finally:\n"
    "        print('tidied', file=sys.stderr)\n"
    "module = types.SimpleNamespace(__name__='work', __doc__='Work.', OPTIONS=(), run=run)\n"
    "m.verbs = lambda: [module]\n"
    "sys.argv = ['tirgeo', 'work']\n"
    "m.console()\n"
)


def start(body, *ignored):
    def ignore():
        for number in (signal.SIGINT, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN if number in ignored else signal.SIG_DFL)

    return subprocess.Popen(
        [sys.executable, "-c", ENDLESS.format(body=body)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=ignore,  # noqa: PLW1509  in the child
    )


def test_a_closed_pipe_is_silent():
    with start("print('x' * 1000)") as process:
        assert process.stdout.readline() == "begun\n"
        process.stdout.close()
        assert process.stderr.read() == "tidied\n"
        assert process.wait(10) == command.BROKEN_PIPE


@pytest.mark.parametrize(
    ("ignored", "numbers", "code", "said"),
    [
        # A shell without job control lets what it puts in the background ignore Ctrl-C.
        ([signal.SIGINT], [signal.SIGTERM], command.TERMINATED, ""),
        ([signal.SIGINT], [signal.SIGHUP], command.HUNG_UP, ""),
        ([signal.SIGINT], [signal.SIGINT], command.INTERRUPTED, "tirgeo work: interrupted\n"),
        # nohup
        ([signal.SIGINT, signal.SIGHUP], [signal.SIGHUP, signal.SIGTERM], command.TERMINATED, ""),
    ],
)
def test_signals_unwind_the_stack(ignored, numbers, code, said):
    with start("time.sleep(0.01)", *ignored) as process:
        assert process.stdout.readline() == "begun\n"
        for number in numbers:
            time.sleep(0.05)
            process.send_signal(number)
        assert process.stderr.read() == f"tidied\n{said}"
        assert process.wait(10) == code


def test_a_lost_terminals_second_signal_does_not_cut_the_tidying():
    tidying = (
        "time.sleep(0.01)\n"
        "    except SystemExit:\n"
        "        print('tidying', flush=True)\n"
        "        time.sleep(0.5)\n"
        "        raise"
    )
    with start(tidying) as process:
        assert process.stdout.readline() == "begun\n"
        process.send_signal(signal.SIGHUP)
        assert process.stdout.readline() == "tidying\n"
        process.send_signal(signal.SIGHUP)
        process.send_signal(signal.SIGTERM)
        assert process.stderr.read() == "tidied\n"
        assert process.wait(10) == command.HUNG_UP
