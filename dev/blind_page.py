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
"""Watch what the operator's page says while its graph fails: ``python -m dev.blind_page``.

``tirgeo demo --page`` flies the soak's figure eight, and Chromium has its page open with three
targets, *Record* and *Share*. Left alone the page must say GO and sound no alarm. Then each node
is stopped, starved, and killed: from then on the page may say GO for 1.5 s; its alarm sounds once
in 4 s; it says GO again; targets, *Record* and *Share* stay. What is missed has a ``!``.
"""

from __future__ import annotations

import argparse
import math
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any

from playwright.sync_api import Page

from dev.flights import make_soak_flight
from dev.graphs import chromium, listening_team, node_pid, shown_demo
from dev.judging import MarkedTable

_NODES = ("ekf_node", "gimbal_node", "overlay_node", "viewer_node", "bag_player")
#: What happens to each node: the share of its time that it gets, and for how long (s).
_EVENTS = {"stopped": (0, 9), "at 10 %": (0.1, 15), "at 30 %": (0.3, 15), "killed": (0, 20)}
_ALARM_S, _CALM_S, _LIMIT_S = 4.0, 10.0, 90.0
_WELL = [3, True, True]  # targets, records, shares
#: The most of each figure: of a node that is gone, of one that is slow, and of none.
_MOST = {"go_s": 1.5, "changes": math.inf, "alarms_in_4_s": 1, "go_again_s": _LIMIT_S, "lost": 0}
_MOST_SLOW = _MOST | {"go_s": math.inf}  # it still gives something: the GO may be right
_MOST_ALONE = _MOST_SLOW | {"changes": 0, "alarms_in_4_s": 0}
#: Writes down each change of what the page says (s since 1970; verdict, banner, words on the
#: video), and each sound of the alarm.
_WATCH = """(() => {
  const now = () => (performance.timeOrigin + performance.now()) / 1000;
  Object.assign(window, { said: [], sounds: [] });
  const make = AudioContext.prototype.createOscillator;
  AudioContext.prototype.createOscillator = function () {
    if (!(now() - window.sounds.at(-1) < 0.2)) window.sounds.push(now()); // of three tones
    return make.call(this);
  };
  const shown = (part) => (part?.checkVisibility() ? part.textContent : "");
  setInterval(() => {
    const words = ["#verdict", "#banner strong", ".words-over"]
      .map((part) => shown(document.querySelector(part)));
    if (words.join() !== window.said.at(-1)?.slice(1).join()) window.said.push([now(), ...words]);
  }, 50);
})()"""
_PRESS = """async () => {
  const { stageOf } = await import("/static/js/video/stages.js");
  const { ask } = await import("/static/js/link/state_link.js");
  const stamp_ns = stageOf("")?.frame?.stampNs ?? "0";
  await ask("click", { aircraft: "", stamp_ns, u: 320, v: 300, kind: "fire", refine: null });
}"""
_KEPT = """() => [document.querySelectorAll("#target-list .row").length,
  ...["record", "share"].map((id) => document.getElementById(id)?.ariaPressed === "true")]"""


class Watched:
    """The demo and its page; ``stack`` ends the demo, also nodes of it that stand still."""

    def __init__(self, stack: ExitStack, page: Page, folder: Path, *words: object) -> None:
        self._stack, self.page, self._folder, self._words = stack, page, folder, words

    def begin(self) -> None:
        """Start the demo, anew if there was one; return once all is well."""
        self._stack.close()
        url, self.demo = self._stack.enter_context(shown_demo(self._folder, *self._words))
        self.page.goto(url)
        self._until(lambda: self.verdicts()[-1][1] == "GO")
        self.page.mouse.click(5, 5)  # browsers allow sound after a press
        self._until(lambda: self.kept()[0] >= _WELL[0] or self.page.evaluate(_PRESS))
        for at, name in ((1, "#record"), (2, "#share")):
            if not self.kept()[at]:
                self.page.click(name)
                self.page.wait_for_function(f"() => ({_KEPT})()[{at}]")
        if math.isinf(self._go_again_s(time.time())) or self.kept() != _WELL:
            raise SystemExit(f"blind_page: not well: {self.kept()} {self.verdicts()[-3:]}")

    def happens(self, node: str, event: str, share: float, lasts_s: float) -> dict[str, Any]:
        """Let one thing happen to a node; return what the page then said and kept."""
        before, begin_s, again = self.kept(), time.time(), True
        if event == "killed":
            again = self._kill(node, lasts_s)
        elif node:
            self._slow(node_pid(self.demo.pid, node), share, lasts_s)
        else:
            self.page.wait_for_timeout(1000 * lasts_s)
        end_s, lives = time.time(), self.demo.poll() is None
        again_s = self._go_again_s(end_s) if lives else math.inf
        statements, sounds = self.verdicts(begin_s), self.page.evaluate("() => window.sounds")
        near = [[0 <= b - a < _ALARM_S for b in sounds] for a in sounds if a >= begin_s]
        spans = [(min(b[0], end_s) - a[0], a[1]) for a, b in pairwise([*statements, [end_s]])]
        return {
            "event": f"{node} {event}" + ("" if again else ", not started again"),
            "go_s": max([0.0, *(span_s for span_s, words in spans if words == "GO")]),
            "changes": len(statements) - 1,
            "alarms_in_4_s": max(map(sum, near), default=0),
            "go_again_s": again_s,
            "lost": sum(a != b for a, b in zip(before, self.kept(), strict=True)) + (not lives),
        }

    def kept(self) -> list[Any]:
        """Return the number of targets, and whether it records and shares."""
        return list(self.page.evaluate(_KEPT))

    def verdicts(self, begin_s: float = 0.0) -> list[list[Any]]:
        """Return the changes of the verdict from a time on: time (s), verdict, other words."""
        statements = self.page.evaluate("() => window.said") or [[0.0, "", "", ""]]
        first = [[begin_s, *words] for at, *words in statements if at < begin_s][-1:]
        statements = first + [item for item in statements if item[0] >= begin_s]
        return statements[:1] + [new for old, new in pairwise(statements) if old[1] != new[1]]

    def _go_again_s(self, begin_s: float) -> float:
        """Wait for a GO that stays; return when it came, s from a time on; inf if it did not."""

        def calm_since() -> float:
            at, verdict, *_ = self.verdicts()[-1]
            return at if verdict == "GO" and at < time.time() - _CALM_S else 0.0

        at = self._until(calm_since)
        return max(0.0, at - begin_s) if at else math.inf

    def _kill(self, node: str, limit_s: float) -> bool:
        """Kill a node; return whether another takes its place."""
        old = node_pid(self.demo.pid, node)
        os.kill(old, signal.SIGKILL)

        def replaced() -> bool:
            return node_pid(self.demo.pid, node) not in {0, old}

        self._until(lambda: self.demo.poll() is not None or replaced(), limit_s)
        return self.demo.poll() is None and replaced()

    def _slow(self, pid: int, share: float, lasts_s: float) -> None:
        """Give a process a share of each second, or none at all."""
        turn_s = 1.0 if share else lasts_s
        try:
            for _ in range(round(lasts_s / turn_s)):
                os.kill(pid, signal.SIGSTOP)
                time.sleep(turn_s * (1 - share))
                os.kill(pid, signal.SIGCONT)
                time.sleep(turn_s * share)
        finally:
            os.kill(pid, signal.SIGCONT)

    def _until(self, what: Callable[[], Any], limit_s: float = _LIMIT_S) -> Any:
        """Return what is true in the end, or false after so long."""
        end_s = time.monotonic() + limit_s
        while not (true := what()) and time.monotonic() < end_s:
            self.page.wait_for_timeout(100)
        return true


def results(minutes: float, only: str) -> Iterator[dict[str, Any]]:
    """Yield what the page said and kept while it was left alone, then at each event."""
    happen = [(node, event) for event in _EVENTS for node in _NODES if only in f"{node} {event}"]
    with (
        tempfile.TemporaryDirectory() as name,
        listening_team() as cot,
        chromium() as page,
        ExitStack() as stack,
    ):
        page.add_init_script(_WATCH)
        flight = make_soak_flight(Path(name) / "flight")
        lasts_s = 60 * minutes + 60 * len(happen) + 2 * _LIMIT_S
        bag = flight.write_rounds(Path(name) / "rounds.mcap", lasts_s)
        beside = "--params", flight.folder / "params.yaml", "--map", flight.folder / "map.geojson"
        watched = Watched(stack, page, Path(name), "--bag", bag, *beside, "--cot", cot)
        watched.begin()
        yield watched.happens("", f"left alone for {minutes:g} min", 1.0, 60 * minutes)
        for node, event in happen:
            if watched.demo.poll() is not None or watched.kept() != _WELL:
                watched.begin()
            yield watched.happens(node, event, *_EVENTS[event])


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; return 1 where a figure is missed."""
    parser = argparse.ArgumentParser(prog="python -m dev.blind_page", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0, help="that it is left alone")
    parser.add_argument("--only", default="", metavar="WORDS", help="as: overlay_node stopped")
    args = parser.parse_args(argv)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that nothing is left running
    table = MarkedTable(46, 15)
    sys.stdout.write(table.row("", list(_MOST)) + "\n")
    for item in results(args.minutes, args.only):
        alone, slow = item["event"].startswith(" "), "%" in item["event"]
        most = _MOST_ALONE if alone else _MOST_SLOW if slow else _MOST
        cells = [table.cell(item[name], high=high, digits=1) for name, high in most.items()]
        sys.stdout.write(table.row(item["event"].strip(), cells) + "\n")
        sys.stdout.flush()
    return 1 if table.missed else 0


if __name__ == "__main__":
    sys.exit(main())
