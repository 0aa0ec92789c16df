"""Every edit that the page confirmed is in the file after ``kill -9`` of its server."""

from __future__ import annotations

import asyncio
from contextlib import closing

import aiohttp
import pytest
from page_clients import ServedApart

from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.io.targets.store import TargetStore

pytestmark = pytest.mark.slow

KILLS, EDITS = 20, 50


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


def test_twenty_kills_during_a_thousand_edits_lose_no_confirmed_one(tmp_path):
    file = tmp_path / "targets.gpkg"
    with closing(TargetStore(file)) as store:
        place = Located(1, 48.0, 16.0, 0.0, (1, 0, 0, 0, 1, 0, 0, 0, 1))
        target_id, name = store.add(place, now_ns=1).id, ""
    for kill in range(KILLS):
        with ServedApart("--targets", file) as page:
            words = page.url, page.process, target_id, name, 1000 * kill, EDITS - 10 + kill
            last = asyncio.run(confirmed(*words))
        assert last != name
        with closing(TargetStore(file)) as store:
            name = store.get(target_id).name
        # The one that was on its way may be there too.
        found = int(name.removeprefix("edit "))
        assert found - int(last.removeprefix("edit ")) in {0, 1}
