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
"""Who may enter: by server name, origin, token, session and number of typing errors."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import ssl
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
    http,
    next_picture,
    raw_answer,
    status,
)
from signed_certificates import certificate

from tirgeo_ros.page import access


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1.evil.example", "localhost.evil", "", "a b", "x@127.0.0.1"]
)
@pytest.mark.parametrize("path", ["/", "/state", "/map/", "/static/index.html"])
def test_a_name_that_is_not_the_servers_is_refused(served, host, path):
    request = http(path, f"Host: {host}", "Connection: close")
    assert status(served.port, request) in {400, 403}


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "LOCALHOST:9000", "[::1]:80"])
def test_addresses_and_own_names_are_taken(served, host):
    assert status(served.port, http("/", f"Host: {host}", "Connection: close")) == 200


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "null",
        "https://127.0.0.1:{port}",
        "http://127.0.0.1",
        "http://127.0.0.1:{port}.evil.example",
        None,
    ],
)
@pytest.mark.parametrize("path", ["/state", "/video/"])
def test_websockets_of_other_origins_are_refused(served, origin, path):
    host = f"127.0.0.1:{served.port}"
    sent = [] if origin is None else [f"Origin: {origin.format(port=served.port)}"]
    assert status(served.port, http(path, f"Host: {host}", *UPGRADE, *sent)) == 403


def test_a_websocket_of_the_own_origin_is_taken(served):
    host = f"127.0.0.1:{served.port}"
    request = http("/state", f"Host: {host}", *UPGRADE, f"Origin: http://{host}")
    assert status(served.port, request) == 101


@pytest.mark.parametrize("path", ["/map/", "/export/geojson", "/targets/x/picture"])
def test_other_sites_do_not_embed_what_the_page_has(served, path):
    host = f"Host: 127.0.0.1:{served.port}"
    request = http(path, host, "Sec-Fetch-Site: cross-site", "Connection: close")
    assert status(served.port, request) == 403


def test_answers_tell_the_browser_what_the_page_may_do(served):
    message_text = raw_answer(
        served.port, http("/", "Host: localhost", "Connection: close")
    ).decode()
    policy = next(
        line for line in message_text.splitlines() if line.startswith("Content-Security-Policy")
    )
    assert "default-src 'none'" in policy
    assert "connect-src 'self' ws://localhost wss://localhost;" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy
    assert "X-Content-Type-Options: nosniff" in message_text
    assert "Referrer-Policy: no-referrer" in message_text


PATHS = ["/state", "/video/", "/map/", "/export/geojson", "/targets/x/picture", "/tiles/1/1/1"]


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize(
    "cookie",
    [
        None,
        "operator",
        "operator.9999999999.x.y",
        f"operator.9999999999.x.{'0' * 64}",
        ".9999999999.x.",
        "operator.\N{LATIN SMALL LETTER E WITH ACUTE}.x.y",
    ],
)
def test_without_a_session_there_is_nothing_but_the_empty_page(guarded, path, cookie):
    host = f"127.0.0.1:{guarded.port}"
    sent = [] if cookie is None else [f"Cookie: tirgeo_{guarded.port}={cookie}"]
    request = http(path, f"Host: {host}", f"Origin: http://{host}", *UPGRADE[:2], *sent)
    assert status(guarded.port, request) in {400, 401}


def test_tokens_give_roles_and_a_cookie_that_scripts_do_not_see(guarded):
    async def enter(token):
        async with Page(guarded.url) as page:
            before = (await page.get("/enter"))[0]
            sent = {"json": {"token": token}}
            async with page.session.post(f"{page.url}/enter", **sent) as answer:
                reports, cookie = await answer.json(), answer.headers["Set-Cookie"]
            after = (await page.get("/enter"))[0]
            async with page.state() as state:
                hello = await state.until("hello")
            return before, reports, cookie, after, hello["role"]

    for token, role in ((OPERATOR_TOKEN, "operator"), (VIEWER_TOKEN, "viewer")):
        before, reports, cookie, after, observed = asyncio.run(enter(token))
        assert (before, reports, after, observed) == (401, {"role": role}, 200, role)
        assert "HttpOnly" in cookie
        assert "SameSite=Strict" in cookie
        assert token not in cookie


def test_a_session_outlives_a_restart_but_not_another_token(tmp_path):
    async def session(one):
        async with Page(one.url) as page:
            assert await page.enter(VIEWER_TOKEN) == 200
            return next(iter(page.session.cookie_jar)).value

    async def role(one, cookie):
        headers = {"Cookie": f"tirgeo_{one.port}={cookie}"}
        async with Page(one.url) as page:
            return (await page.get("/enter", headers=headers))[0]

    with Served(tmp_path, **TOKENS) as one:
        cookie = asyncio.run(session(one))
    with Served(tmp_path, **TOKENS) as one:
        assert asyncio.run(role(one, cookie)) == 200
        assert asyncio.run(role(one, cookie.replace("viewer", "operator", 1))) == 401
    with Served(tmp_path, token=OPERATOR_TOKEN, viewer_token="another-viewer") as one:
        assert asyncio.run(role(one, cookie)) == 401


def test_a_session_outlives_that_the_clock_is_set(fresh, monkeypatch):
    """A computer without a battery for its clock may be days behind until it has the time."""

    async def look():
        async with Page(fresh.url) as page:
            assert await page.enter(OPERATOR_TOKEN) == 200
            (cookie,) = page.session.cookie_jar
        headers = {"Cookie": f"{cookie.key}={cookie.value}"}  # the browser's clock is right
        later_s = time.time() + 10 * 24 * 3600
        monkeypatch.setattr(access.time, "time", lambda: later_s)
        async with Page(fresh.url) as page:
            return (await page.get("/enter", headers=headers))[0]

    assert asyncio.run(look()) == 200


@pytest.mark.parametrize(
    "body", [b"", b"{", b"[" * 512, b"[]", b'"x"', b'{"token": 1}', b'{"token": ""}', b"\xff"]
)
def test_a_wrong_body_is_refused_as_token(tmp_path, body):
    async def enter():
        async with (
            Page(one.url) as page,
            page.session.post(f"{page.url}/enter", data=body) as answer,
        ):
            return answer.status

    with Served(tmp_path, **TOKENS) as one:
        assert asyncio.run(enter()) == 403


def test_a_viewer_sees_all_and_changes_nothing(guarded):
    target = "0" * 32
    requests = (
        ("edit", {"id": target, "was": {}, "name": "x"}),
        ("delete", {"id": target, "was": {}}),
        ("leave_out", {"id": target, "field": "note", "text": "x"}),
        ("undo", {}),
        ("record", {"aircraft": "", "on": True}),
        ("share", {"on": True}),
        ("mark", {"text": "x"}),
    )

    async def ask():
        async with Page(guarded.url) as page:
            await page.enter(VIEWER_TOKEN)
            async with page.state() as state, page.video() as video:
                stamp_ns, _ = await next_picture(video)
                message_text = [await state.click(stamp_ns)]
                message_text += [await state.ask(kind, **fields) for kind, fields in requests]
                may = {"from": [48, 16], "to": [48, 17]}
                return (
                    message_text,
                    await state.ask("measure", **may),
                    await page.get("/export/csv"),
                )

    revision = guarded.backend.targets.revision
    message_text, measure, export = asyncio.run(ask())
    assert {answer["reason"] for answer in message_text} == {"a viewer may not change anything"}
    assert measure["ok"]
    assert export[0] == 200
    assert guarded.backend.targets.revision == revision
    assert not guarded.backend.targets.marks()


@pytest.mark.parametrize(
    "path",
    [
        "/../pyproject.toml",
        "/static/../server.py",
        "/static/%2e%2e/server.py",
        "/static/..%2fserver.py",
        "/static/..%5cserver.py",
        "/static/..\\server.py",
        "/static//etc/passwd",
        "/static/%2fetc%2fpasswd",
        "/static/index.html%00.js",
        "/static/index.html\x00",
        "/static/....//server.py",
        "/static/%252e%252e/server.py",
        "/static/%c0%ae%c0%ae/server.py",
        "/static/",
        "/static",
        "/video/../state",
        "/map/../../etc/passwd",
        "/export/../../x",
        "/export/geojson%00",
        "/targets/../../etc/passwd/picture",
        "/targets/%2e%2e%2f%2e%2e%2fx/picture",
        "/targets/' or 1=1 --/picture",
        "/tiles/-1/0/0",
        "/tiles/1/1/../../../x",
        "/tiles/99/99999999/99999999",
        "http://evil.example/",
        "/static/" + "a" * 3000,
        "/" + "a" * 9000,
    ],
)
def test_no_path_leads_to_the_disk(served, path):
    message_text = raw_answer(served.port, http(path, "Host: localhost", "Connection: close"))
    assert int(message_text.split()[1]) in {400, 403, 404, 414}
    assert b"import" not in message_text
    assert b"root:" not in message_text


def test_over_tls_the_cookie_is_for_tls_alone(tmp_path):
    pem, key = certificate(tmp_path)
    trusting = ssl.create_default_context(cafile=pem)

    async def enter():
        connector = aiohttp.TCPConnector(ssl=trusting)
        async with Page(one.url, connector=connector) as page:
            async with page.session.post(
                f"{page.url}/enter", json={"token": OPERATOR_TOKEN}
            ) as answer:
                cookie = answer.headers["Set-Cookie"]
            async with page.video() as video:
                await next_picture(video)
            return cookie

    with Served(tmp_path, certificate=str(pem), key=str(key), **TOKENS) as one:
        assert one.server.operator_url == f"https://127.0.0.1:{one.port}/?token={OPERATOR_TOKEN}"
        assert one.server.viewer_url == f"{one.url}/?token={VIEWER_TOKEN}"
        assert "Secure" in asyncio.run(enter())


def test_a_request_that_comes_with_the_end_of_the_handshake_is_answered(tmp_path):
    """As browsers send it, in one piece."""
    pem, key = certificate(tmp_path)
    incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
    context = ssl.create_default_context(cafile=pem)
    tls = context.wrap_bio(incoming, outgoing, server_hostname="127.0.0.1")

    def until_done(step, own):
        while True:
            with contextlib.suppress(ssl.SSLWantReadError):
                return step()
            own.sendall(outgoing.read())
            incoming.write(own.recv(65536))

    with (
        Served(tmp_path, certificate=str(pem), key=str(key)) as one,
        socket.create_connection(("127.0.0.1", one.port), 20) as own,
    ):
        until_done(tls.do_handshake, own)
        tls.write(http("/", "Host: 127.0.0.1"))
        own.sendall(outgoing.read())  # the handshake's last part and the request
        assert until_done(lambda: tls.read(15), own) == b"HTTP/1.1 200 OK"


WRONG = json.dumps({"token": "wrong-token-here"}).encode()


def head_of(one, length):
    host = f"127.0.0.1:{one.port}"
    lines = (f"Host: {host}", f"Origin: http://{host}", f"Content-Length: {length}")
    return http("/enter", *lines, "Connection: close", method="POST")


async def after_the_wait(page, token):
    for _ in range(300):
        if (status := await page.enter(token)) != 429:
            return status
        await asyncio.sleep(0.1)
    return 429


def statuses_of(answers):
    return [int(answer.split()[1]) for answer in answers]


def test_tokens_whose_headers_came_before_the_first_was_wrong_wait_too(fresh):
    async def ask():
        opened = [await asyncio.open_connection("127.0.0.1", fresh.port) for _ in range(40)]
        for _, writer in opened:
            writer.write(head_of(fresh, len(WRONG)))
        await asyncio.sleep(0.5)  # all have asked whether they must wait
        for _, writer in opened:
            writer.write(WRONG)
        message_text = [await reader.read() for reader, _ in opened]
        for _, writer in opened:
            writer.close()
        return message_text

    result = statuses_of(asyncio.run(asyncio.wait_for(ask(), 30)))
    assert sorted(result) == [403] + [429] * 39


@pytest.mark.slow
def test_a_viewers_own_token_does_not_end_the_wait_of_who_guesses_the_operators(fresh):
    async def ask():
        message_text = []
        async with Page(fresh.url) as page:
            for _ in range(3):
                message_text.append(await page.enter("wrong-token-here"))
                assert await after_the_wait(page, VIEWER_TOKEN) == 200
            message_text.append(await page.enter("wrong-token-here"))
            loop = asyncio.get_running_loop()
            begun_s = loop.time()
            assert await after_the_wait(page, OPERATOR_TOKEN) == 200
            return message_text, loop.time() - begun_s

    message_text, waited_s = asyncio.run(ask())
    assert message_text == [403] * 4
    assert waited_s > 3  # the fourth wrong one costs 4 s


@pytest.mark.parametrize("body", [b"[" * 2000, b'{"a":' * 400], ids=["lists", "objects"])
def test_a_body_that_is_deeper_than_json_goes_is_refused_and_counted(fresh, caplog, body):
    message_text = [raw_answer(fresh.port, head_of(fresh, len(body)) + body) for _ in range(4)]
    assert statuses_of(message_text)[:2] == [400, 429]
    assert len(caplog.records) == 1
    assert "\n" not in caplog.text.strip()


def test_wrong_tokens_are_one_line_a_minute(fresh, caplog):
    async def ask():
        for k in range(2, 12):
            with contextlib.suppress(ConnectionError):
                reader, writer = await asyncio.open_connection(
                    "127.0.0.1", fresh.port, local_addr=(f"127.0.0.{k}", 0)
                )
                writer.write(head_of(fresh, len(WRONG)) + WRONG)
                assert b" 403 " in await reader.read()
                writer.close()

    asyncio.run(ask())
    assert [record.getMessage() for record in caplog.records] == [
        "wrong tokens: 1, the last from 127.0.0.2"
    ]


def test_a_fault_of_ours_is_logged_once_a_minute(fresh, caplog, monkeypatch):
    def fail(_):
        raise RuntimeError("not from the network")

    async def ask():
        async with Page(fresh.url) as page:
            await page.enter(VIEWER_TOKEN)
            return [(await page.get("/map/"))[0] for _ in range(4)]

    monkeypatch.setattr(fresh.backend, "vector_map", fail)
    assert asyncio.run(ask()) == [500] * 4
    assert len(caplog.records) == 1
