"""Tokens at the entrance: wrong ones cost time however they are sent, and fill no log."""

from __future__ import annotations

import asyncio
import contextlib
import json

import pytest
from page_clients import OPERATOR_TOKEN, TOKENS, VIEWER_TOKEN, Page, Served, http, raw_answer

WRONG = json.dumps({"token": "wrong-token-here"}).encode()


@pytest.fixture
def fresh(tmp_path):
    """A page that has seen no wrong token yet."""
    with Served(tmp_path, **TOKENS) as one:
        yield one


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
        said = [await reader.read() for reader, _ in opened]
        for _, writer in opened:
            writer.close()
        return said

    found = statuses_of(asyncio.run(asyncio.wait_for(ask(), 30)))
    assert sorted(found) == [403] + [429] * 39


@pytest.mark.slow
def test_a_viewers_own_token_does_not_end_the_wait_of_who_guesses_the_operators(fresh):
    async def ask():
        said = []
        async with Page(fresh.url) as page:
            for _ in range(3):
                said.append(await page.enter("wrong-token-here"))
                assert await after_the_wait(page, VIEWER_TOKEN) == 200
            said.append(await page.enter("wrong-token-here"))
            loop = asyncio.get_running_loop()
            begun_s = loop.time()
            assert await after_the_wait(page, OPERATOR_TOKEN) == 200
            return said, loop.time() - begun_s

    said, waited_s = asyncio.run(ask())
    assert said == [403] * 4
    assert waited_s > 3  # the fourth wrong one costs 4 s


@pytest.mark.parametrize("body", [b"[" * 2000, b'{"a":' * 400], ids=["lists", "objects"])
def test_a_body_that_is_deeper_than_json_goes_is_refused_and_counted(fresh, caplog, body):
    said = [raw_answer(fresh.port, head_of(fresh, len(body)) + body) for _ in range(4)]
    assert statuses_of(said)[:2] == [400, 429]
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
