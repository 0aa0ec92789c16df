"""Every edit that the page confirmed is in the file after ``kill -9`` of its server."""

from __future__ import annotations

import asyncio
import os
import re
import subprocess
import sys

import aiohttp
import pytest
from project import PROJECT, wait_until

from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.io.targets.store import TargetStore

pytestmark = pytest.mark.slow

KILLS, EDITS = 20, 50
LIMIT_S = 60.0


@pytest.fixture
def start(tmp_path):
    """Start the server on one file; return its process and its address."""
    running = []

    def begin():
        log = tmp_path / "log"
        with log.open("w") as out:
            command = [sys.executable, str(PROJECT / "test/support/page_backend.py")]
            words = ["--listen", "127.0.0.1:0", "--targets", str(tmp_path / "targets.gpkg")]
            paths = os.pathsep.join([str(PROJECT), str(PROJECT / "test/support")])
            env = {**os.environ, "PYTHONPATH": paths, "PYTHONUNBUFFERED": "1"}
            running.append(subprocess.Popen([*command, *words], env=env, stdout=out, stderr=out))
        found = wait_until(
            lambda: re.search(r"http://127\.0\.0\.1:\d+", log.read_text()),
            running=running[-1],
            tell=log.read_text,
        )
        return running[-1], found[0]

    yield begin
    for process in running:
        process.kill()
        process.wait()


async def confirmed(url, process, target_id, name, first, kill_after):
    """Edit as fast as answers come, kill the server after some; return the last confirmed name."""
    async with (
        aiohttp.ClientSession(headers={"Origin": url}) as session,
        session.ws_connect(f"{url}/state") as state,
    ):
        for number in range(first, first + 2 * EDITS):
            edit = {"type": "edit", "request": f"e{number}", "id": target_id}
            await state.send_json({**edit, "was": {"name": name}, "name": f"edit {number}"})
            if number == first + kill_after:  # this one is on its way, or being written
                await asyncio.sleep(0.0005 * (kill_after % KILLS))
                process.kill()
            async for message in state:
                told = message.json()
                if told["type"] == "answer" and told["request"] == f"e{number}":
                    assert told["ok"], told
                    name = f"edit {number}"
                    break
            else:
                return name
    return name


def test_twenty_kills_during_a_thousand_edits_lose_no_confirmed_one(start, tmp_path):
    store = TargetStore(tmp_path / "targets.gpkg")
    target_id = store.add(Located(1, 48.0, 16.0, 0.0, (1, 0, 0, 0, 1, 0, 0, 0, 1)), now_ns=1).id
    store.close()
    name = ""
    for kill in range(KILLS):
        process, url = start()
        kill_after = EDITS - 10 + kill
        last = asyncio.run(confirmed(url, process, target_id, name, 1000 * kill, kill_after))
        assert last != name
        process.wait()
        store = TargetStore(tmp_path / "targets.gpkg")
        name = store.get(target_id).name
        store.close()
        # The one that was on its way may be there too.
        found = int(name.removeprefix("edit "))
        assert found - int(last.removeprefix("edit ")) in {0, 1}
