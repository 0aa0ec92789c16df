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
"""Too much of anything is refused: memory stays, the video goes on, users keep a share."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import time

import aiohttp
import pytest
from page_clients import (
    OPERATOR_TOKEN,
    TOKENS,
    UPGRADE,
    VIEWER_TOKEN,
    Page,
    Served,
    ServedApart,
    http,
    next_picture,
    received,
    status,
)
from signed_certificates import certificate

from tirgeo_ros.page import actions, connections
from tirgeo_ros.page.access import Shares, WrongTokens
from tirgeo_ros.page.connections import MOST, OPERATOR, VIEWER

WIDE = 10_000_000
#: What a server may take more under an attack: buffers of 100 connections, and what Python keeps.
MOST_GROWN = 60 * 2**20


@pytest.fixture(scope="module")
def apart():
    with ServedApart() as one:
        yield one


@contextlib.contextmanager
def watched(one):
    """While something happens, the video goes on and the server's memory stays."""
    asyncio.run(see_pictures(one, 60))
    before = one.memory_bytes
    yield
    assert one.memory_bytes - before < MOST_GROWN
    asyncio.run(see_pictures(one, 3))


async def see_pictures(one, count):
    async with Page(one.url) as page, page.video() as video:
        for _ in range(count):
            await next_picture(video)


async def beside(one, attack):
    """Run an attack while somebody looks on; nobody may wait for a picture for long."""
    async with Page(one.url) as page, page.video() as video:
        task, observed = asyncio.create_task(attack), 0
        while not task.done() or observed < 10:
            await next_picture(video)
            observed += 1
        return await task


def opened(one):
    return socket.create_connection(("127.0.0.1", one.port), 20)


def upgrade(one, path):
    return http(path, f"Host: 127.0.0.1:{one.port}", f"Origin: {one.url}", *UPGRADE)


def upgraded(one, path):
    own = opened(one)
    own.sendall(upgrade(one, path))
    assert own.recv(12).endswith(b"101")
    return own


def ends(own):
    """Wait until the page ends a connection."""
    deadline = time.monotonic() + 5
    with contextlib.suppress(ConnectionResetError):
        while own.recv(65536):
            assert time.monotonic() < deadline, "the connection goes on"


def sent(own, data, pieces=200):
    """Send as much of the data as the peer takes."""
    with contextlib.suppress(OSError):
        for at in range(0, len(data), max(1, len(data) // pieces)):
            own.sendall(data[at : at + max(1, len(data) // pieces)])


@pytest.mark.parametrize("path", ["/state", "/video/"])
def test_a_message_of_ten_megabytes_ends_its_connection(served, path):
    async def send():
        async with (
            Page(served.url) as page,
            page.session.ws_connect(f"{page.url}{path}") as socket_,
        ):
            with contextlib.suppress(OSError, aiohttp.ClientError):
                await socket_.send_str("x" * WIDE)
            async for _ in socket_:
                pass
            return socket_.closed

    assert asyncio.run(asyncio.wait_for(beside(served, send()), 60))


def test_a_body_and_headers_of_ten_megabytes_are_refused(served):
    head = (f"Host: 127.0.0.1:{served.port}", f"Origin: {served.url}")
    body = http("/enter", *head, f"Content-Length: {WIDE}", method="POST") + b"x" * WIDE
    for attack in (body, http("/", *head, "X: " + "x" * WIDE), b"x" * WIDE):
        with opened(served) as own:
            sent(own, attack)
            assert b" 200 " not in received(own)


@pytest.mark.parametrize("piece", [b"G", b"GET / HTTP/1.1\r\nHost: localhost\r\nX: "])
def test_a_request_that_never_ends_is_ended(served, monkeypatch, piece):
    monkeypatch.setattr(connections, "_FIRST_REQUEST_S", 0.3)
    with opened(served) as own:
        own.sendall(piece)
        assert received(own) == b""


def test_a_second_request_that_never_ends_is_ended(tmp_path, monkeypatch):
    monkeypatch.setattr(connections, "_KEEP_ALIVE_S", 0.5)
    with Served(tmp_path) as one, opened(one) as own:
        own.sendall(http("/", "Host: localhost"))
        assert own.recv(15).startswith(b"HTTP/1.1 200")
        own.sendall(b"GET / HT")
        deadline = time.monotonic() + 20
        while own.recv(65536):
            assert time.monotonic() < deadline


def test_a_tls_handshake_that_never_comes_is_ended(tmp_path, monkeypatch):
    monkeypatch.setattr(connections, "_HANDSHAKE_S", 0.3)
    pem, key = certificate(tmp_path)
    with (
        Served(tmp_path, certificate=str(pem), key=str(key)) as one,
        socket.create_connection(("127.0.0.1", one.port), 20) as own,
    ):
        own.sendall(b"\x16\x03\x01")
        assert received(own) == b""


def test_tls_handshakes_that_never_come_make_room(tmp_path, monkeypatch):
    monkeypatch.setitem(connections.MOST, None, (4, 4))
    pem, key = certificate(tmp_path)
    with (
        Served(tmp_path, certificate=str(pem), key=str(key)) as one,
        contextlib.ExitStack() as stack,
    ):
        held = [stack.enter_context(opened(one)) for _ in range(7)]
        assert [received(own) for own in held[:3]] == [b""] * 3
        held[-1].settimeout(0.2)
        with pytest.raises(TimeoutError):
            held[-1].recv(1)


def test_a_body_that_never_comes_is_not_waited_for(served, monkeypatch):
    monkeypatch.setattr("tirgeo_ros.page.access._BODY_S", 0.2)
    head = (f"Host: 127.0.0.1:{served.port}", f"Origin: {served.url}", "Content-Length: 30")
    assert status(served.port, http("/enter", *head, method="POST") + b'{"token"') == 408


def test_who_does_not_take_the_answer_is_ended(served, monkeypatch):
    monkeypatch.setattr(connections, "_ANSWERS_S", 0.3)
    with opened(served) as own:
        own.sendall(http("/", "Host: localhost") * 3)
        deadline = time.monotonic() + 20
        with contextlib.suppress(ConnectionResetError):
            while own.recv(65536):
                assert time.monotonic() < deadline


@pytest.mark.parametrize("text", ["hello", "shown", "shown -1", "shown x", "shown 1 2", ""])
def test_what_is_no_answer_to_a_picture_ends_the_video(served, text):
    async def send():
        async with Page(served.url) as page, page.video() as video:
            await video.send_str(text)
            async for _ in video:
                pass
            return video.close_code

    assert asyncio.run(asyncio.wait_for(send(), 30)) == 1008


MASKED = bytes([0x81, 0x82]) + b"mask" + bytes(a ^ b for a, b in zip(b"{}", b"mask", strict=False))
LONG = bytes([0x81, 0xFE, 0, 200]) + b"\0\0\0\0" + b" " * 200


@pytest.mark.parametrize("path", ["/state", "/video/"])
@pytest.mark.parametrize("before", [b"", MASKED, LONG], ids=["first", "second", "long"])
def test_a_frame_without_a_mask_ends_its_connection(served, path, before):
    if path == "/video/" and before:
        before = bytes([0x81, 0x87]) + b"\0\0\0\0" + b"shown 1"
    with upgraded(served, path) as own:
        for byte in before:
            own.sendall(bytes([byte]))
        own.sendall(bytes([0x81, 7]) + b"shown 2")
        ends(own)


@pytest.mark.parametrize("path", ["/state", "/video/"])
def test_frames_that_come_with_the_request_end_its_connection(served, path):
    with opened(served) as own:
        own.sendall(upgrade(served, path) + bytes([0x81, 7]) + b"shown 2")
        ends(own)


def test_masked_frames_of_all_lengths_are_taken(served):
    async def ask():
        async with Page(served.url) as page, page.state() as state:
            texts = ["", "a" * 90, "b" * 190]
            return [(await state.ask("mark", text=text))["ok"] for text in texts]

    assert asyncio.run(ask()) == [True] * 3


@pytest.mark.slow
def test_too_many_requests_are_refused_each_with_an_answer(served):
    async def ask():
        async with Page(served.url) as page, page.state() as state:
            measure = {"type": "measure", "from": [0, 0], "to": [1, 1]}
            for k in range(400):
                await state.socket.send_str(json.dumps({"request": f"r{k}", **measure}))
            names = {f"r{k}" for k in range(400)}
            answers = [await state.until("answer") for _ in range(400)]
            assert {one["request"] for one in answers} == names
            return [one["ok"] for one in answers]

    good = asyncio.run(ask())
    assert 60 < sum(good) < 400


@pytest.mark.parametrize("lines", ["GET / HTTP/1.1\r\nno header\r\n", "GET / HTTP/9.9.9\r\n"])
def test_what_is_no_http_is_refused_and_does_not_fill_the_log(served, caplog, lines):
    assert status(served.port, f"{lines}\r\n".encode()) == 400
    assert caplog.text == ""


@pytest.mark.slow
def test_too_many_gets_are_refused():
    with ServedApart() as one, opened(one) as own:
        flood = http("/enter", f"Host: 127.0.0.1:{one.port}") * 600
        sent(own, flood)
        message_text = b""
        while b" 429 " not in message_text:
            part = own.recv(65536)
            assert part, "ended without a refusal"
            message_text = message_text[-10:] + part


@pytest.mark.slow
def test_a_thousand_connections_leave_those_who_look_on_alone(apart):
    async def attack():
        held = []
        for _ in range(1000):
            with contextlib.suppress(OSError):
                held.append(await asyncio.open_connection("127.0.0.1", apart.port))
        deadline = time.monotonic() + 30
        while sum(not reader.at_eof() for reader, _ in held) > connections.MOST_OF_ADDRESS:
            assert time.monotonic() < deadline, "more are taken than one address may have"
            await asyncio.sleep(0.05)
        for _, writer in held:
            writer.close()

    with watched(apart):
        asyncio.run(beside(apart, attack()))


@pytest.mark.slow
def test_frames_that_never_end_and_messages_that_are_too_long_cost_no_memory(apart):
    with watched(apart), contextlib.ExitStack() as stack:
        many = [stack.enter_context(upgraded(apart, "/state")) for _ in range(40)]
        long = bytes([0x81, 0xFF]) + WIDE.to_bytes(8, "big") + b"mask"
        unfinished = bytes([0x01, 0xFE]) + (60_000).to_bytes(2, "big") + b"mask"
        for own in many[:20]:
            sent(own, long + b"x" * WIDE, 20)
        for own in many[20:]:
            for _ in range(20):
                sent(own, unfinished + b"x" * 60_000)
        asyncio.run(see_pictures(apart, 10))


@pytest.mark.slow
def test_who_looks_and_never_reads_costs_no_memory(apart):
    with watched(apart), contextlib.ExitStack() as stack:
        for _ in range(40):
            own = stack.enter_context(upgraded(apart, "/video/"))
            for number in range(60):  # answers before anything was shown
                text = f"shown {number}".encode()
                sent(own, bytes([0x81, 0x80 + len(text)]) + b"\0\0\0\0" + text)
        asyncio.run(see_pictures(apart, 60))


MEASURE = {"type": "measure", "from": [48, 16], "to": [48, 17]}


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
        result = [asyncio.run(is_in(fresh, newcomer)) for _ in range(10)]
    assert result == [True] * 10


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
    monkeypatch.setattr("tirgeo_ros.page.access._REQUESTS_A_S", 0.1)
    monkeypatch.setattr("tirgeo_ros.page.access._REQUESTS_AT_ONCE", 15)
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
                message_text = [await state.ask("mark", text=f"{k}") for k in range(40)]
            flood.cancel()
            await asyncio.gather(flood, return_exceptions=True)
            return [answer["ok"] for answer in message_text]

    assert asyncio.run(ask()) == [True] * 40


def test_viewers_share_a_common_limit_and_operators_do_not():
    shares = Shares(1.0, 10.0)
    observed = [shares.take(VIEWER, f"session {k % 100}", 0.0) for k in range(1000)]
    assert sum(observed) == 40
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
