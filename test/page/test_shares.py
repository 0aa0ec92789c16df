"""What floods leave for honest users: who has a session has a share of his own."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import time

import aiohttp
import pytest
from page_clients import OPERATOR_TOKEN, TOKENS, VIEWER_TOKEN, Page, Served, http, status

from tirgeo_ros.page import actions
from tirgeo_ros.page.access import OPERATOR, VIEWER, Shares, WrongTokens
from tirgeo_ros.page.connections import MOST

MEASURE = {"type": "measure", "from": [48, 16], "to": [48, 17]}


@pytest.fixture
def fresh(tmp_path):
    """A page whose shares nobody has used yet."""
    with Served(tmp_path, **TOKENS) as one:
        yield one


@contextlib.contextmanager
def idle(one, addresses, count):
    """Hold so many connections of each address, as far as the server lets them live."""
    with contextlib.ExitStack() as stack:
        for address in addresses:
            for _ in range(count):
                opened = socket.create_connection(("127.0.0.1", one.port), 20, (address, 0))
                stack.enter_context(opened)
        yield


async def is_in(one, address):
    connector = aiohttp.TCPConnector(local_addr=(address, 0))
    with contextlib.suppress(aiohttp.ClientError):
        async with Page(one.url, connector=connector) as page:
            return await page.enter(OPERATOR_TOKEN) == 200
    return False


@pytest.mark.parametrize("newcomer", ["127.0.0.99", "127.0.0.11"], ids=["other", "flooding"])
def test_five_addresses_of_idle_connections_leave_room_for_newcomers(fresh, monkeypatch, newcomer):
    monkeypatch.setattr("tirgeo_ros.page.connections._FIRST_REQUEST_S", 60)
    with idle(fresh, [f"127.0.0.{k}" for k in range(11, 16)], 85):
        found = [asyncio.run(is_in(fresh, newcomer)) for _ in range(10)]
    assert found == [True] * 10


def test_idle_connections_do_not_end_those_of_a_session(fresh):
    async def ask():
        async with Page(fresh.url) as page:
            await page.enter(OPERATOR_TOKEN)
            async with page.state() as state:
                with idle(fresh, ["127.0.0.1"], MOST[None][1] + 20):
                    return await state.ask("mark", text="still here")

    assert asyncio.run(ask())["ok"]


@pytest.fixture
def asked_out(tmp_path, monkeypatch):
    """A page of small shares; a stranger at this address has used up his."""
    monkeypatch.setattr("tirgeo_ros.page.guard._REQUESTS_A_S", 0.1)
    monkeypatch.setattr("tirgeo_ros.page.guard._REQUESTS_AT_ONCE", 15)
    with Served(tmp_path, **TOKENS) as one:
        request = http("/enter", f"Host: 127.0.0.1:{one.port}", "Connection: close")
        assert {status(one.port, request) for _ in range(15)} == {401}
        yield one


def test_strangers_requests_take_nothing_from_a_session_of_their_address(asked_out):
    async def ask():
        async with Page(asked_out.url) as page:
            return await page.enter(OPERATOR_TOKEN), [
                (await page.get("/enter"))[0] for _ in range(10)
            ]

    assert asyncio.run(ask()) == (200, [200] * 10)


def test_a_stranger_at_a_flooding_address_waits_and_sees_the_page(asked_out):
    request = http("/static/js/main.js", "Host: localhost", "Connection: close")
    begun_s = time.monotonic()
    assert [status(asked_out.port, request) for _ in range(3)] == [200] * 3
    assert time.monotonic() - begun_s > 1.2  # each of them half a second, so a flood is slow too


async def measure_without_end(page, sockets):
    """Ask to measure on some WebSockets, until cancelled."""

    async def one():
        async with page.state() as state:
            while True:
                await state.socket.send_str(json.dumps({"request": "m", **MEASURE}))
                await asyncio.sleep(0.002)

    await asyncio.gather(*(one() for _ in range(sockets)))


@pytest.mark.slow
def test_a_viewers_flood_refuses_no_change_of_an_operator_at_his_address(fresh):
    async def ask():
        async with Page(fresh.url) as page, Page(fresh.url) as other:
            await page.enter(OPERATOR_TOKEN)
            await other.enter(VIEWER_TOKEN)
            flood = asyncio.create_task(measure_without_end(other, 5))
            await asyncio.sleep(2)
            async with page.state() as state:
                said = [await state.ask("mark", text=f"{k}") for k in range(40)]
            flood.cancel()
            await asyncio.gather(flood, return_exceptions=True)
            return [answer["ok"] for answer in said]

    assert asyncio.run(ask()) == [True] * 40


def test_viewers_share_a_common_limit_and_operators_do_not():
    shares = Shares(1.0, 10.0)
    seen = [shares.take(VIEWER, f"session {k % 100}", 0.0) for k in range(1000)]
    assert sum(seen) == 40
    assert all(shares.take(OPERATOR, f"operator {k % 100}", 0.0) for k in range(1000))


def test_a_viewers_requests_do_not_make_the_server_forget_an_operators_change(fresh, monkeypatch):
    monkeypatch.setattr(actions, "_REMEMBERED", 5)

    async def ask():
        async with Page(fresh.url) as page, Page(fresh.url) as other:
            await page.enter(OPERATOR_TOKEN)
            await other.enter(VIEWER_TOKEN)
            async with page.state() as state, other.state() as looking:
                sent = {"text": "once", "request": "the operator's request"}
                await state.ask("mark", **sent)
                for k in range(10):
                    fields = {"from": [48, 16], "to": [48, 17]}
                    await looking.ask("measure", request=f"a viewer's request {k}", **fields)
                return await state.ask("mark", **sent)

    assert asyncio.run(ask())["ok"]
    assert len(fresh.backend.targets.marks()) == 1


def test_while_many_guess_a_typing_error_costs_no_minute():
    wrong = WrongTokens()
    for _ in range(3):
        for k in range(80):
            wrong.add(f"guesser {k}", 0.0)
    wrong.add("honest", 0.0)
    assert wrong.wait_s("honest", 0.0) == 0.5
    assert wrong.wait_s("guesser 79", 0.0) == 60
